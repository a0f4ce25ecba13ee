//! The black box of a group: the last seconds of all channels, in a file, when a fault latches an axis or a stage dies.
//!
//! The messages are in shared memory until then ([`super::kept`]). A thread of its own writes the file, because the
//! supervisor has other things to watch. A file holds what came before the fault and [`AFTER`] of what came after it;
//! further faults within the span share it. What a supervisor that was killed has left in shared memory, the next
//! `hydraxis run` or `hydraxis clean` writes.

use std::{
    fs, io,
    path::{Path, PathBuf},
    thread::{JoinHandle, sleep},
    time::{Duration, Instant, SystemTime},
};

use mcap::McapError;
use pipeline::{
    MAX_AXES,
    channel::Prefix,
    machine::Machine,
    message::{ValveCommand, bit_names, control_flag},
    stage::monotonic_ns,
};

use super::{
    Facts, axes_in, clock_ns, default_folder,
    file::{Encoded, RecordingFile, cause},
    kept::{self, About, KeptFile, LeftFile},
    tapes::{Messages, SPAN, Strips, Tapes},
};

/// Part of a file that comes after the fault.
const AFTER: Duration = Duration::from_secs(1);
/// Longest wait for the disk at the end of a run. What was written by then is in the memory of the system, from which
/// the disk takes it later.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time between two looks at the writer while the run ends.
const LOOK: Duration = Duration::from_millis(5);
/// Files that are kept in a folder.
pub const MOST_FILES: usize = 20;
/// Beginning and end of their names.
const NAME: (&str, &str) = ("fault-", ".mcap");

/// Writes a new file with all messages into a folder, and removes the oldest ones there. What is to be said about it,
/// also where it could not be written.
fn write(
    folder: &Path,
    prefix: &Prefix,
    mut facts: Facts,
    fault: &Fault,
    channels: &[Box<dyn Messages>],
) -> Result<String, String> {
    let clock_ns = clock_ns();
    facts.extend(
        [
            ("cause", fault.cause.clone()),
            ("cause_monotonic_ns", fault.at.to_string()),
            ("realtime_minus_monotonic_ns", clock_ns.to_string()),
        ]
        .map(|(name, fact)| (name.to_owned(), fact)),
    );
    facts.extend(channels.iter().map(|channel| {
        let (name, lost) = channel.lost();
        (format!("{name} lost"), lost.to_string())
    }));
    let path = folder.join(file_name(prefix, SystemTime::now()));
    let written = RecordingFile::create(&path, &facts, &[], clock_ns).and_then(|mut file| {
        let written = add_all(&mut file, channels);
        written.and_then(|()| file.finish(&Facts::new())).inspect_err(|_| {
            // Half a file explains nothing; the disk may be full.
            let _ = fs::remove_file(&path);
        })
    });
    let is_written = written.is_ok();
    let said = match written {
        Ok(()) => format!("black box: {}: {}", fault.cause, path.display()),
        Err(error) => {
            format!("warning: no black box of \"{}\": {}: {}", fault.cause, path.display(), cause(&error))
        }
    };
    let said = match remove_oldest(folder) {
        Err(error) if is_written => format!("{said}; older files could not be removed: {error}"),
        _ => said,
    };
    if is_written { Ok(said) } else { Err(said) }
}

/// Adds all messages in the order in which they were read, as a recording has them.
fn add_all(file: &mut RecordingFile, channels: &[Box<dyn Messages>]) -> Result<(), McapError> {
    channels.iter().try_for_each(|channel| channel.add_to(file))?;
    let mut messages: Vec<Encoded> = channels.iter().flat_map(|channel| channel.encoded()).collect();
    messages.sort_by_key(|message| message.read_ns);
    messages.iter().try_for_each(|message| file.write(message))
}

fn file_name(prefix: &Prefix, now: SystemTime) -> String {
    let now = humantime::format_rfc3339_millis(now).to_string().replace(':', "-");
    format!("{}{now}-{prefix}{}", NAME.0, NAME.1)
}

/// A fault that is to be written.
struct Fault {
    /// When, ns.
    at: u64,
    cause: String,
}

/// The black box of one run.
pub struct BlackBox {
    folder: PathBuf,
    prefix: Prefix,
    facts: Facts,
    axes: Vec<String>,
    /// Latches of each axis so far, as its commands count them.
    latches: [u64; MAX_AXES],
    /// The first fault that is not in a file yet.
    fault: Option<Fault>,
    /// When the last file was begun, ns.
    last: Option<u64>,
    writer: Option<JoinHandle<String>>,
    /// Removed when the run ends.
    kept: Option<KeptFile>,
}

impl BlackBox {
    /// Of a group that runs this machine, with files in `folder`, which is made.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new(folder: PathBuf, prefix: &Prefix, machine: &Machine) -> io::Result<Self> {
        fs::create_dir_all(&folder)?;
        Ok(Self {
            folder,
            prefix: prefix.clone(),
            facts: facts(prefix, machine),
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            latches: [0; MAX_AXES],
            fault: None,
            last: None,
            writer: None,
            kept: None,
        })
    }

    /// Keeps the messages of all channels in shared memory, from now until the end of the run. Begins to write what
    /// other supervisors have left there.
    ///
    /// # Errors
    /// The file in shared memory is there, or there is no room for it; with its path.
    pub fn keep(&mut self, period: Duration, tapes: &mut Tapes) -> Result<(), String> {
        let about =
            About { folder: self.folder.clone(), facts: self.facts.clone(), period_ns: period.as_nanos() as u64 };
        let made = KeptFile::create(&self.prefix, &about).and_then(|mut file| tapes.keep(&mut file).map(|()| file));
        let file = made.map_err(|error| format!("{}: {error}", kept::path(&self.prefix).display()))?;
        self.kept = Some(file);
        // A start does not wait for a disk.
        self.writer = Some(std::thread::spawn(|| write_left(None).join("\n")));
        Ok(())
    }

    /// Notes that something has failed.
    pub fn note(&mut self, cause: impl Into<String>) {
        self.fault.get_or_insert_with(|| Fault { at: monotonic_ns(), cause: cause.into() });
    }

    /// Looks at a command: whether a fault has latched axes.
    pub fn look(&mut self, command: &ValveCommand) {
        let mut latched = Vec::new();
        for ((axis, name), before) in command.axes.iter().zip(&self.axes).zip(&mut self.latches) {
            // A controller that is started again counts from 0.
            if axis.latches > std::mem::replace(before, axis.latches) {
                let faults: Vec<&str> = bit_names(axis.latched_by, &control_flag::NAMES).collect();
                latched.push(format!("axis.{name} latched by {}", faults.join(", ")));
            }
        }
        if !latched.is_empty() {
            self.note(latched.join("; "));
        }
    }

    /// Begins a file if one is due; `ends`: there will be no more messages. What is to be said to a person, if
    /// anything.
    pub fn step(&mut self, tapes: &mut Tapes, ends: bool) -> Option<String> {
        if self.writer.is_some() {
            return self.written(ends);
        }
        let now = monotonic_ns();
        let due = self.due()?;
        if now < due && !ends {
            return None;
        }
        let fault = self.fault.take()?;
        self.last = Some(now);
        let channels = match tapes.take() {
            Ok(strips) => strips.channels(&self.axes),
            Err(error) => return Some(format!("warning: no black box of \"{}\": {error}", fault.cause)),
        };
        let (folder, prefix, facts) = (self.folder.clone(), self.prefix.clone(), self.facts.clone());
        self.writer = Some(std::thread::spawn(move || match write(&folder, &prefix, facts, &fault, &channels) {
            Ok(said) | Err(said) => said,
        }));
        self.written(ends)
    }

    /// When the next file is due, ns; none without a fault.
    fn due(&self) -> Option<u64> {
        let after = |time: u64, wait: Duration| time.saturating_add(wait.as_nanos() as u64);
        let fault = after(self.fault.as_ref()?.at, AFTER);
        Some(self.last.map_or(fault, |last| fault.max(after(last, SPAN - AFTER))))
    }

    /// What the writer says once it has ended; `waits` for it, but not for a disk that takes nothing.
    fn written(&mut self, waits: bool) -> Option<String> {
        let until = Instant::now() + if waits { PATIENCE } else { Duration::ZERO };
        while self.writer.as_ref().is_some_and(|writer| !writer.is_finished()) && Instant::now() < until {
            sleep(LOOK);
        }
        let writer = self.writer.take_if(|writer| waits || writer.is_finished())?;
        if !writer.is_finished() {
            let patience = humantime::format_duration(PATIENCE);
            let folder = self.folder.display();
            return Some(format!("warning: {folder}: the disk has not confirmed the black box within {patience}"));
        }
        let said = writer.join().unwrap_or_else(|_| "warning: the black box could not be written".to_owned());
        Some(said).filter(|said| !said.is_empty())
    }
}

/// What is known of a run at its begin.
fn facts(prefix: &Prefix, machine: &Machine) -> Facts {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("group", prefix.to_string()),
        ("machine", machine.name.clone()),
        ("axes", axes.join(" ")),
    ]
    .map(|(name, fact)| (name.to_owned(), fact))
    .into()
}

/// Writes what dead supervisors have left in shared memory, of this group or of all groups of this user, and removes
/// it there. A line for each.
pub fn write_left(prefix: Option<&Prefix>) -> Vec<String> {
    let paths = prefix.map_or_else(kept::paths, |prefix| vec![kept::path(prefix)]);
    paths
        .iter()
        .filter_map(|path| {
            written_left(path).unwrap_or_else(|error| {
                let is_none = matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied);
                let is_removed = kept::remove_unreadable(path);
                let removed = if is_removed { "; removed" } else { "" };
                let path = path.display();
                (is_removed || !is_none)
                    .then(|| format!("warning: {path}: no black box can be read from it: {error}{removed}"))
            })
        })
        .collect()
}

fn written_left(path: &Path) -> io::Result<Option<String>> {
    let Some(mut left) = LeftFile::open(path)? else { return Ok(None) };
    let facts = left.about.facts.clone();
    let fact = |name: &str| facts.get(name).cloned().unwrap_or_default();
    if fact("version") != env!("CARGO_PKG_VERSION") {
        let (path, version) = (path.display(), fact("version"));
        return Ok(Some(format!(
            "warning: {path}: it was kept by version {version}, whose `hydraxis clean` writes it"
        )));
    }
    let Ok(prefix) = fact("group").parse() else {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "it names no group"));
    };
    let strips = Strips::left(&mut left)?;
    let at = strips.health.messages.last().map_or(0, |(read_ns, _)| *read_ns);
    let fault = Fault { at, cause: "the supervisor was killed".to_owned() };
    let channels = strips.channels(&axes_in(&facts));
    let folder = &left.about.folder;
    // The folder of that run may be gone, or be full.
    let said = write(folder, &prefix, facts.clone(), &fault, &channels)
        .or_else(|_| write(&default_folder(), &prefix, facts, &fault, &channels));
    if said.is_ok() {
        left.remove()?;
    }
    Ok(Some(said.unwrap_or_else(|said| said)))
}

/// Removes the oldest black boxes of a folder until [`MOST_FILES`] are left. Their names begin with the time.
fn remove_oldest(folder: &Path) -> io::Result<()> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if name.is_some_and(|name| name.starts_with(NAME.0) && name.ends_with(NAME.1)) {
            files.push(path);
        }
    }
    files.sort();
    let surplus = files.len().saturating_sub(MOST_FILES);
    files[..surplus].iter().map(fs::remove_file).try_for_each(|removed| match removed {
        // Another run has removed it.
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black_box(folder: &Path) -> BlackBox {
        let machine = Machine::load(None, &[]).unwrap();
        BlackBox::new(folder.to_owned(), &"t-box".parse().unwrap(), &machine).unwrap()
    }

    #[test]
    fn what_is_no_black_box_is_removed_from_shared_memory_once_it_is_old() {
        let prefix: Prefix = format!("t{}-none", std::process::id()).parse().unwrap();
        let path = kept::path(&prefix);
        fs::write(&path, [0x55; 100]).unwrap();
        let said = write_left(Some(&prefix));
        assert!(said[0].contains("no black box can be read") && path.exists(), "{said:?}");
        let minute_ago = SystemTime::now() - Duration::from_secs(60);
        fs::File::options().write(true).open(&path).unwrap().set_modified(minute_ago).unwrap();
        let said = write_left(Some(&prefix));
        assert!(said[0].ends_with("; removed") && !path.exists(), "{said:?}");
        // A FIFO keeps nobody waiting.
        rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RUSR).unwrap();
        assert!(write_left(Some(&prefix)).is_empty() && path.exists());
        fs::remove_file(&path).unwrap();
        assert!(write_left(Some(&prefix)).is_empty());
    }

    #[test]
    fn a_latch_is_noted_once_and_again_after_a_restart_of_the_controller() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        let mut command = ValveCommand::default();
        black_box.look(&command);
        assert!(black_box.fault.is_none());
        for axis in &mut command.axes[1..3] {
            (axis.latches, axis.latched_by) = (1, control_flag::STALL);
        }
        black_box.look(&command);
        let causes = |fault: Option<Fault>| fault.map(|fault| fault.cause);
        assert_eq!(
            causes(black_box.fault.take()).unwrap(),
            "axis.arm latched by stall; axis.telescope latched by stall"
        );
        black_box.look(&command);
        assert!(black_box.fault.is_none());
        black_box.look(&ValveCommand::default());
        black_box.look(&command);
        assert!(black_box.fault.is_some());
    }

    #[test]
    fn a_file_is_due_a_second_after_the_first_fault_and_not_sooner_than_its_span_after_the_last_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        assert_eq!(black_box.due(), None);
        black_box.fault = Some(Fault { at: 5_000_000_000, cause: String::new() });
        black_box.note("a second one, which shares the file");
        assert_eq!(black_box.due(), Some(6_000_000_000));
        black_box.last = Some(4_000_000_000);
        assert_eq!(black_box.due(), Some(13_000_000_000));
    }

    #[test]
    fn the_end_of_a_run_does_not_wait_for_a_disk_that_takes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        black_box.writer = Some(std::thread::spawn(|| {
            sleep(20 * PATIENCE);
            String::new()
        }));
        assert_eq!(black_box.written(false), None);
        let began = Instant::now();
        assert!(black_box.written(true).unwrap().contains("not confirmed"));
        assert!(began.elapsed() < 2 * PATIENCE && black_box.writer.is_none());
        black_box.writer = Some(std::thread::spawn(|| "done".to_owned()));
        assert_eq!(black_box.written(true).unwrap(), "done");
    }

    #[test]
    fn the_oldest_files_go_and_foreign_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..MOST_FILES + 3 {
            fs::write(folder.path().join(format!("fault-2026-01-{i:02}.mcap")), "").unwrap();
        }
        let foreign = ["a-first.mcap", "fault-0000.txt"].map(|name| folder.path().join(name));
        foreign.iter().for_each(|path| fs::write(path, "").unwrap());
        remove_oldest(folder.path()).unwrap();
        assert!(foreign.iter().all(|path| path.exists()));
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), MOST_FILES + 2);
        assert!(!folder.path().join("fault-2026-01-02.mcap").exists());
        assert!(folder.path().join("fault-2026-01-03.mcap").exists());
    }
}
