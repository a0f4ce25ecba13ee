//! What files and groups of other users of this computer do to the commands of this one. As root only.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use pipeline::channel::{GroupState, groups};
use rustix::{
    fs::{CWD, FileType, Mode, mknodat},
    process::geteuid,
};

use crate::harness::{hydraxis, is_running, place::in_own_place, running::Running, shared, wait_for};

/// User and group of nobody.
const NOBODY: u32 = 65534;

/// Only root can be two users.
fn is_root() -> bool {
    let is_root = geteuid().is_root();
    if !is_root {
        eprintln!("skipped: only root can start a process of another user");
    }
    is_root
}

/// A program as another user, ended after 20 s.
fn as_nobody(program: &Path) -> Command {
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups", "timeout", "20"]).arg(program);
    command.stdin(Stdio::null());
    command
}

/// A copy of the program that another user may start, in a folder that it may enter.
fn copy(folder: &tempfile::TempDir) -> PathBuf {
    let copy = folder.path().join("hydraxis");
    fs::copy(hydraxis().get_program(), &copy).unwrap();
    std::os::unix::fs::chown(folder.path(), Some(NOBODY), Some(NOBODY)).unwrap();
    copy
}

/// What a command of this user says within 20 s.
fn said(arguments: &[&str]) -> Output {
    Command::new("timeout").arg("20").arg(hydraxis().get_program()).args(arguments).output().unwrap()
}

fn errors(output: &Output) -> String {
    assert_ne!(output.status.code(), Some(124), "it hangs");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Regression: a file of another user beside those of a group made `status` deny that the group runs.
#[test]
fn a_file_of_another_user_beside_a_group_hides_no_group() {
    if !is_root() {
        return;
    }
    let _cores = shared();
    let mut running = Running::start("beside");
    let name = format!("{}.{}_1.data", running.group.prefix, "0".repeat(40));
    let foreign = Path::new("/dev/shm").join(name);
    fs::write(&foreign, "").unwrap();
    std::os::unix::fs::chown(&foreign, Some(NOBODY), Some(NOBODY)).unwrap();
    let prefix = running.group.prefix.to_string();
    let state = groups().into_iter().find(|group| group.prefix == running.group.prefix).unwrap().state;
    let (status, disarmed) = (said(&["status", "--prefix", &prefix]), said(&["disarm", "--prefix", &prefix]));
    fs::remove_file(&foreign).unwrap();
    running.interrupt();
    assert_eq!(state, GroupState::Alive);
    assert!(status.status.success(), "{}", errors(&status));
    assert!(disarmed.status.success(), "{}", errors(&disarmed));
}

/// Regression: `status`, `clean` and `disarm` waited at the FIFO of another user without end.
#[test]
fn a_fifo_of_another_user_in_the_place_of_a_group_keeps_no_command_waiting() {
    if !is_root() {
        return;
    }
    let _cores = shared();
    in_own_place("strangers::a_fifo_of_another_user_in_the_place_of_a_group_keeps_no_command_waiting", |is_private| {
        if !is_private {
            return;
        }
        let folder = Path::new("/dev/shm/hydraxis.fifo");
        fs::create_dir(folder).unwrap();
        for name in ["members", "run"] {
            mknodat(CWD, folder.join(name), FileType::Fifo, Mode::RUSR | Mode::WUSR | Mode::ROTH, 0).unwrap();
        }
        std::os::unix::fs::chown(folder, Some(NOBODY), Some(NOBODY)).unwrap();
        let status = said(&["status"]);
        assert!(errors(&status).contains("no group"), "{}", errors(&status));
        let cleaned = said(&["clean", "--prefix", "fifo"]);
        assert!(errors(&cleaned).contains("of user 65534"), "{}", errors(&cleaned));
        for arguments in [&["disarm", "--prefix", "fifo"][..], &["disarm", "--prefix", "fif"], &["disarm"]] {
            let disarmed = said(arguments);
            assert!(errors(&disarmed).contains("no group"), "{arguments:?}: {}", errors(&disarmed));
        }
        fs::remove_dir_all(folder).unwrap();
    });
}

#[test]
fn a_group_of_another_user_is_named_with_the_way_to_stop_it() {
    if !is_root() {
        return;
    }
    let _cores = shared();
    in_own_place("strangers::a_group_of_another_user_is_named_with_the_way_to_stop_it", |is_private| {
        if !is_private {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let mut run = as_nobody(&copy(&folder));
        let program = run.args(["run", "--prefix", "theirs", "--off", "--duration", "15s"]);
        let mut program = program.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        wait_for("its board", || {
            let mut all = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
            all.find(|path| path.to_string_lossy().ends_with("_board.stop"))
        });
        for arguments in [&["disarm", "--prefix", "theirs"][..], &["disarm"]] {
            let disarmed = said(arguments);
            let told = errors(&disarmed);
            assert!(disarmed.status.code() == Some(1) && told.contains("sudo -u '#65534'"), "{told}");
        }
        assert!(is_running(program.id()));
        let pid = rustix::process::Pid::from_raw(program.id() as i32).unwrap();
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        program.wait().unwrap();
    });
}
