//! A group of real processes for one test: it has its own prefix and leaves nothing behind.

use std::{
    io::Read,
    path::PathBuf,
    process::{Child, Stdio},
};

use pipeline::{
    channel::{Group, Prefix, remove_leftovers},
    stage::StageKind,
};

use super::{hydraxis, wait_for, with_machine};

/// A prefix of the test's own, and the stages that were started under it.
pub struct TestGroup {
    pub prefix: Prefix,
    children: Vec<Child>,
}

impl TestGroup {
    pub fn new(test: &str) -> Self {
        Self { prefix: format!("t{}-{test}", std::process::id()).parse().unwrap(), children: Vec::new() }
    }

    /// Joins the group as one more process.
    pub fn join(&self) -> Group {
        Group::join(&self.prefix, "test").unwrap()
    }

    /// Starts one stage as a process of its own. Returns its pid.
    pub fn start(&mut self, kind: StageKind, arguments: &[&str]) -> u32 {
        let child = hydraxis()
            .arg(kind.name())
            .args(["--prefix", &self.prefix.to_string()])
            .args(with_machine(arguments))
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let pid = child.id();
        self.children.push(child);
        pid
    }

    /// Starts all stages but one, whose part the test plays.
    pub fn start_all_but(&mut self, played: StageKind, arguments: &[&str]) {
        for kind in StageKind::ALL.into_iter().filter(|kind| *kind != played) {
            self.start(kind, arguments);
        }
    }

    /// Waits until every stage has ended with exit code 0.
    pub fn expect_end(&mut self) {
        for mut child in self.children.drain(..) {
            let status = wait_for("the stage to end", || child.try_wait().unwrap());
            let mut text = String::new();
            if let Some(mut stderr) = child.stderr.take() {
                stderr.read_to_string(&mut text).unwrap();
            }
            assert!(status.success(), "{status}: {text}");
        }
    }

    /// The file in which the supervisor keeps messages for a black box.
    pub fn black_box(&self) -> PathBuf {
        PathBuf::from(format!("/dev/shm/hydraxis-black-box.{}", self.prefix))
    }

    /// Files of the group, in shared memory and elsewhere.
    pub fn files(&self) -> Vec<PathBuf> {
        files(&self.prefix)
    }
}

impl Drop for TestGroup {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _ = child.kill();
            let _ = child.wait();
        }
        // A process that is still attached belongs to a test that has failed.
        let _ = remove_leftovers(&self.prefix);
        // A supervisor that was killed leaves it to `hydraxis clean`, which writes it to the folder of its run.
        let _ = std::fs::remove_file(self.black_box());
    }
}

/// Files that belong to a prefix, in shared memory and elsewhere.
pub fn files(prefix: &Prefix) -> Vec<PathBuf> {
    let start = format!("{prefix}.");
    let shared = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> =
        shared.filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&start))).collect();
    found.extend(Some(prefix.folder()).filter(|folder| folder.exists()));
    found
}

/// Command lines of the processes that name a group.
pub fn processes(prefix: &Prefix) -> Vec<String> {
    let is_of = |line: &String| line.split('\0').any(|word| word == prefix.to_string());
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let lines = processes.filter_map(|process| std::fs::read_to_string(process.path().join("cmdline")).ok());
    lines.filter(is_of).map(|line| line.replace('\0', " ")).collect()
}
