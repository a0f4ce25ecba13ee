//! `hydraxis clean` removes the files of killed groups, and nothing else.

use std::{
    path::{Path, PathBuf},
    process::{Child, Output, Stdio},
};

use crate::harness::{TestGroup, files, hydraxis, wait_for};
use pipeline::channel::Prefix;

/// A stage under a prefix of its own, whose group's folder is in a folder of the test.
struct Member {
    // Removes the shared memory where a test fails.
    group: TestGroup,
    process: Child,
}

impl Member {
    fn start(test: &str, folder: &Path) -> Self {
        let group = TestGroup::new(test);
        let process = hydraxis()
            .args(["control-proc", "--prefix", &group.prefix.to_string()])
            .env("TMPDIR", folder)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let member = Self { group, process };
        // What wakes the stage is opened last.
        wait_for("all its channels", || {
            let files = member.files();
            let of = |kind: &str| files.iter().filter(|path| path.extension().is_some_and(|end| end == kind)).count();
            (of("data") == 3 && of("event_mgmt") == 1).then_some(())
        });
        member
    }

    fn prefix(&self) -> &Prefix {
        &self.group.prefix
    }

    /// Files of the stage in shared memory.
    fn files(&self) -> Vec<PathBuf> {
        files(self.prefix())
    }

    fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A foreign file in shared memory. It is removed at the end of the test.
struct Foreign(PathBuf);

impl Foreign {
    fn create(name: String) -> Self {
        let path = Path::new("/dev/shm").join(name);
        std::fs::write(&path, "foreign").unwrap();
        Self(path)
    }
}

impl Drop for Foreign {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn clean(folder: &Path, arguments: &[&str]) -> Output {
    hydraxis().arg("clean").args(arguments).env("TMPDIR", folder).output().unwrap()
}

fn printed(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Words in the line of a group in the printed table.
fn line(text: &str, prefix: &Prefix) -> Vec<String> {
    let mut lines = text.lines().map(|line| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>());
    lines.find(|words| words.first() == Some(&prefix.to_string())).unwrap_or_else(|| panic!("{prefix}: {text}"))
}

#[test]
fn clean_removes_dead_groups_and_leaves_running_ones_and_foreign_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut dead = Member::start("dead", folder.path());
    let alive = Member::start("alive", folder.path());
    dead.kill();
    let memory = dead.files();
    assert!(memory.len() > 5, "{memory:?}");
    let foreign = [
        Foreign::create(format!("{}.txt", dead.prefix())),
        Foreign::create(format!("{}.{}_1.data", dead.prefix(), "0".repeat(39))),
        Foreign::create(format!("{}-other.{}_1.data", dead.prefix(), "0".repeat(40))),
    ];
    let foreign_folder = folder.path().join("hydraxis.notes");
    std::fs::create_dir(&foreign_folder).unwrap();
    let own_folder = folder.path().join(format!("hydraxis.{}", dead.prefix()));
    assert!(own_folder.join("members").exists());

    let text = printed(&clean(folder.path(), &["--dry-run"]));
    // The folder counts as one more file.
    assert_eq!(line(&text, dead.prefix())[1..], ["dead", &(memory.len() + 1).to_string(), "0"], "{text}");
    assert_eq!(line(&text, alive.prefix())[1], "alive", "{text}");
    assert!(text.contains("nothing was removed; without --dry-run"), "{text}");
    assert!(memory.iter().all(|path| path.exists()) && own_folder.exists());

    let output = clean(folder.path(), &["--json", "-"]);
    let found: serde_json::Value = serde_json::from_str(&printed(&output)).unwrap();
    let group = |prefix: &Prefix| {
        let groups = found.as_array().unwrap();
        groups.iter().find(|group| group["prefix"] == prefix.to_string()).unwrap().clone()
    };
    let gone = group(dead.prefix());
    assert_eq!(gone["removed"].as_array().unwrap().len(), memory.len() + 1);
    assert_eq!((&gone["removed"], gone["left"].as_array().unwrap().len()), (&gone["files"], 0));
    let kept = group(alive.prefix());
    assert_eq!((kept["state"].as_str(), kept["removed"].as_array().unwrap().len()), (Some("alive"), 0));
    assert!(!kept["files"].as_array().unwrap().is_empty());

    assert!(memory.iter().all(|path| !path.exists()) && !own_folder.exists());
    assert!(!alive.files().is_empty());
    assert!(foreign.iter().all(|foreign| foreign.0.exists()) && foreign_folder.exists());
}

#[test]
fn a_group_by_its_name_is_removed_when_it_is_dead_and_refused_while_it_lives() {
    let folder = tempfile::tempdir().unwrap();
    let mut one = Member::start("one", folder.path());
    let mut other = Member::start("other", folder.path());
    other.kill();
    let name = one.prefix().to_string();
    let memory = one.files();
    let output = clean(folder.path(), &["--prefix", &name]);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains(&format!("group \"{name}\" is alive, nothing was removed; end it first")), "{said}");
    assert!(memory.iter().all(|path| path.exists()));

    one.kill();
    let memory = one.files();
    let text = printed(&clean(folder.path(), &["--prefix", &name]));
    assert_eq!(
        line(&text, one.prefix())[1..],
        ["dead", &(memory.len() + 1).to_string(), &(memory.len() + 1).to_string()]
    );
    assert!(one.files().is_empty());
    assert!(!other.files().is_empty(), "only the one that was named");
    assert_eq!(printed(&clean(folder.path(), &["--prefix", &name])), format!("group \"{name}\" has left nothing\n"));
}

#[test]
fn memory_whose_folder_is_elsewhere_goes_only_by_name_and_when_nobody_has_it_mapped() {
    let (here, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut member = Member::start("elsewhere", elsewhere.path());
    let name = member.prefix().to_string();
    let memory = member.files();
    // A group with another TMPDIR, such as a service: a person with a different TMPDIR must not remove its memory.
    assert_eq!(line(&printed(&clean(here.path(), &[])), member.prefix())[1], "alive");
    assert_eq!(clean(here.path(), &["--prefix", &name]).status.code(), Some(1));
    let run = hydraxis().args(["run", "--duration", "1s", "--prefix", &name]).env("TMPDIR", here.path()).output();
    let run = run.unwrap();
    assert_eq!(run.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&run.stderr).contains("is running"), "{run:?}");
    assert!(memory.iter().all(|path| path.exists()));

    member.kill();
    let memory = member.files();
    let text = printed(&clean(here.path(), &[]));
    assert_eq!(line(&text, member.prefix())[1..], ["unknown", &memory.len().to_string(), "0"], "{text}");
    assert!(text.contains(&format!("once you do: hydraxis clean --prefix {name}")), "{text}");
    assert_eq!(member.files(), memory);
    printed(&clean(here.path(), &["--prefix", &name]));
    assert!(member.files().is_empty());
}

/// The kernel hides the maps of a process with a capability from other processes of its user.
#[test]
fn memory_of_a_process_that_hides_its_maps_is_not_removed() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only root can give a capability to another user");
        return;
    }
    let (here, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for folder in [&here, &elsewhere] {
        std::os::unix::fs::chown(folder.path(), Some(65534), Some(65534)).unwrap();
    }
    let group = TestGroup::new("hidden");
    let copy = elsewhere.path().join("hydraxis");
    std::fs::copy(hydraxis().get_program(), &copy).unwrap();
    let nobody = |capabilities: &[&str], folder: &Path| {
        let mut command = std::process::Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).args(capabilities).arg(&copy);
        command.env("TMPDIR", folder).stdin(Stdio::null());
        command
    };
    let prefix = group.prefix.to_string();
    let mut process = nobody(&["--inh-caps", "+sys_nice", "--ambient-caps", "+sys_nice"], elsewhere.path())
        .args(["control-proc", "--prefix", &prefix])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_for("its memory", || (files(&group.prefix).len() > 5).then_some(()));
    let before = files(&group.prefix);
    let output = nobody(&[], here.path()).args(["clean", "--prefix", &prefix]).output().unwrap();
    let after = files(&group.prefix);
    process.kill().unwrap();
    process.wait().unwrap();
    let cleaned = nobody(&[], here.path()).args(["clean", "--prefix", &prefix]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("is alive, nothing was removed"), "{said}");
    assert!(before.iter().all(|path| after.contains(path)), "{before:?}, {after:?}");
    assert!(cleaned.status.success() && files(&group.prefix).is_empty(), "{cleaned:?}");
}
