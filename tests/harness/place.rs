//! A place of its own for a test: a mount namespace with a small `/dev/shm`. In it shared memory can be filled up, and
//! a stop of all groups reaches no group of anybody else.

use std::{
    fs::OpenOptions,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use rustix::fs::{FallocateFlags, fallocate, statvfs};

/// Set in a test that runs in its own place.
const INSIDE: &str = "HYDRAXIS_TEST_PLACE";
const MOUNT: &str = "mount -t tmpfs -o size=64m tmpfs /dev/shm";

/// Runs the test of this name once more, in a place of its own. `work` is called there with true. It is called here,
/// with false, where this computer allows no such place.
pub fn in_own_place(test: &str, work: impl FnOnce(bool)) {
    if std::env::var_os(INSIDE).is_some() {
        work(true);
        let left: Vec<PathBuf> = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path()).collect();
        return assert!(left.is_empty(), "{test} has left {left:?}");
    }
    let unshared = |flags: &[&str], script: &str| {
        let mut command = Command::new("unshare");
        command.args(flags).args(["--mount", "sh", "-c", script]).stdin(Stdio::null());
        command
    };
    // The rights of root outside are wanted inside as well, where they are to be had.
    let all_flags: [&[&str]; 2] = [&[], &["--user", "--map-root-user"]];
    let is_allowed = |flags: &&&[&str]| {
        let status = unshared(flags, MOUNT).stderr(Stdio::null()).status();
        status.is_ok_and(|status| status.success())
    };
    let Some(flags) = all_flags.iter().find(is_allowed) else {
        println!("{test}: this computer allows no mount namespaces: without full memory");
        return work(false);
    };
    let output = unshared(flags, &format!("{MOUNT} && exec \"$0\" \"$@\""))
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", test, "--include-ignored", "--nocapture"])
        .env(INSIDE, "1")
        .env_remove("TMPDIR")
        .output()
        .unwrap();
    print!("{}", String::from_utf8_lossy(&output.stdout));
    eprint!("{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{test} in its own place: {}", output.status);
    assert!(String::from_utf8_lossy(&output.stdout).contains("1 passed"), "{test} has not run in its own place");
}

/// All free memory of `/dev/shm`, taken until it is dropped. Only for a test in its own place.
pub struct FullMemory(PathBuf);

impl FullMemory {
    pub fn take() -> Self {
        assert!(std::env::var_os(INSIDE).is_some(), "other groups of this computer would have no memory either");
        let memory = Path::new("/dev/shm");
        let path = memory.join("fill");
        let file = OpenOptions::new().create(true).append(true).open(&path).unwrap();
        let full = Self(path);
        // Memory that is freed meanwhile is taken in the next round.
        for _ in 0..100 {
            let (free, taken) = (statvfs(memory).unwrap(), file.metadata().unwrap().len());
            if free.f_bavail == 0 {
                break;
            }
            let _ = fallocate(&file, FallocateFlags::empty(), taken, free.f_bavail * free.f_frsize);
        }
        full
    }
}

impl Drop for FullMemory {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A busy process for each core, at the priority of all others, until it is dropped.
pub struct Hogs(Vec<Child>);

impl Hogs {
    pub fn start() -> Self {
        let hog = |_| Command::new("sh").args(["-c", "while :; do :; done"]).stdin(Stdio::null()).spawn().unwrap();
        Self((0..std::thread::available_parallelism().map_or(2, usize::from)).map(hog).collect())
    }
}

impl Drop for Hogs {
    fn drop(&mut self) {
        for hog in &mut self.0 {
            let _ = hog.kill();
            let _ = hog.wait();
        }
    }
}
