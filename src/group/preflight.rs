//! Everything that can be known to be wrong before the first process starts, all of it at once.
//!
//! The machine file and what it points at, the programs in the place of stages, the name of the group, the places that
//! it needs, and the rights that the machine file is strict about.

use std::{env::split_paths, path::Path};

use pipeline::{
    channel::{Prefix, remove_leftovers},
    machine::Machine,
    stage::{Clock, StageKind, missing},
};
use rustix::fs::{Access, access, statvfs};

use crate::failure::Failure;

/// Shared memory that a group may need, bytes.
const SHARED_MEMORY: u64 = 32 << 20;
/// Room for its small files, bytes.
const SMALL_FILES: u64 = 1 << 20;

/// What was found wrong so far.
#[derive(Default)]
pub struct Findings(Vec<Failure>);

impl Findings {
    /// What `result` gives, or nothing and one finding more.
    pub fn take<T>(&mut self, result: Result<T, Failure>) -> Option<T> {
        result.map_err(|failure| self.0.push(failure)).ok()
    }

    /// One finding more.
    pub fn add(&mut self, failure: Failure) {
        self.0.push(failure);
    }

    /// What was checked, if nothing was found; else all findings in one failure, of usage if any is, else of the run.
    pub fn verdict<T>(self, checked: Option<T>) -> Result<T, Failure> {
        if let Some(checked) = checked.filter(|_| self.0.is_empty()) {
            return Ok(checked);
        }
        let text: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        let is_usage = self.0.iter().any(|failure| matches!(failure, Failure::Usage(_)));
        let failure = if is_usage { Failure::Usage } else { Failure::Run };
        Err(failure(text.join("\n")))
    }

    /// The group and the places that its files go to; removes what a dead group of this name has left.
    pub fn places(&mut self, prefix: &Prefix, log_folder: Option<&Path>) {
        self.take(remove_leftovers(prefix).map_err(Failure::run));
        self.take(place(Path::new("/dev/shm"), SHARED_MEMORY, "the channels").map_err(Failure::Run));
        let folder = prefix.folder();
        let temporary = folder.parent().unwrap_or(Path::new("/"));
        self.take(place(temporary, SMALL_FILES, "the group's files").map_err(Failure::Run));
        if let Some(folder) = log_folder {
            // What does not exist is created in the first folder above it that does.
            let existing = folder.ancestors().map(current).find(|folder| folder.exists()).unwrap_or(folder);
            let found = place(existing, SMALL_FILES, "the log");
            self.take(found.map_err(|error| Failure::Usage(format!("--log-folder: {error}"))));
        }
    }

    /// The programs that stand in the place of these stages.
    pub fn programs(&mut self, machine: &Machine, kinds: impl IntoIterator<Item = StageKind>) {
        for kind in kinds {
            let program = machine.stage(kind).command.as_ref().and_then(|words| words.first());
            if let Some(program) = program.filter(|program| !is_executable(program)) {
                let (name, allowed) =
                    (kind.name(), "a program by its path, or by its name in one of the folders of PATH");
                self.0.push(Failure::Usage(format!(
                    "stage.{name}.command: found \"{program}\", which cannot be executed; allowed: {allowed}"
                )));
            }
        }
    }

    /// The rights that the machine file asks for; those that it is not strict about are returned, to be said.
    pub fn rights(&mut self, machine: &Machine, clock: Clock) -> Vec<String> {
        let (strict, others): (Vec<_>, Vec<_>) = missing(machine, clock).into_iter().partition(|right| right.strict);
        let strict = strict.into_iter().map(|right| format!("{} (the machine file is strict)", right.text));
        self.0.extend(strict.map(Failure::Run));
        others.into_iter().map(|right| right.text).collect()
    }
}

/// The folder itself, where an empty path means the one that this process works in.
fn current(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Whether files for `what` can be created in a folder.
fn place(folder: &Path, room: u64, what: &str) -> Result<(), String> {
    let refuse = |found: String| Err(format!("{}: found {found}; allowed: a folder for {what}", folder.display()));
    if !folder.is_dir() {
        return refuse("no folder".to_owned());
    }
    if let Err(error) = access(folder, Access::WRITE_OK | Access::EXEC_OK) {
        return refuse(format!("one that cannot be written ({error})"));
    }
    match statvfs(folder) {
        Ok(found) if found.f_bavail.saturating_mul(found.f_frsize) < room => {
            refuse(format!("{} bytes free, {room} are needed", found.f_bavail.saturating_mul(found.f_frsize)))
        }
        // Where nobody can say how much room there is, it will turn out.
        _ => Ok(()),
    }
}

fn is_executable(program: &str) -> bool {
    let is_one = |path: &Path| path.is_file() && access(path, Access::EXEC_OK).is_ok();
    if program.contains('/') {
        return is_one(Path::new(program));
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    split_paths(&folders).any(|folder| is_one(&folder.join(program)))
}
