//! Rows 41 to 43: several starts of one name, other users of the computer, and shared memory that is full.

use std::{
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Write},
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use pipeline::stage::StageKind;
use rustix::{
    fs::FallocateFlags,
    process::{Signal, geteuid},
};

use crate::harness::{
    FOUR_AXES, TestGroup, hydraxis, processes,
    running::{Running, is_orderly, text},
    shared, signal, wait_for,
};

/// Starts the same group several times at once. Returns the one that goes on, and what the others have said.
fn start_at_once(prefix: &str, count: usize) -> (Child, Vec<String>) {
    let arguments = ["run", FOUR_AXES, "--duration", "60s", "--prefix", prefix];
    let start = || hydraxis().args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut starts: Vec<Child> = (0..count).map(|_| start()).collect();
    let mut said = Vec::new();
    wait_for("the end of all starts but one", || {
        let ended = starts.iter_mut().position(|start| start.try_wait().unwrap().is_some());
        if let Some(index) = ended {
            let mut ended = starts.remove(index);
            assert_eq!(ended.wait().unwrap().code(), Some(1));
            said.push(text(ended.stderr.take()));
        }
        (starts.len() <= 1).then_some(())
    });
    (starts.pop().expect("a start that goes on"), said)
}

/// Row 41: of several starts of one name at the same time, exactly one goes on, and the others say which.
#[test]
fn row_41_of_several_starts_at_once_exactly_one_goes_on() {
    let _cores = shared();
    let group = TestGroup::new("row-41");
    let prefix = group.prefix.to_string();
    for round in 0..12 {
        let (mut winner, said) = start_at_once(&prefix, 3 + round % 3);
        let expected = format!("group \"{prefix}\" is running: process {} since ", winner.id());
        for said in &said {
            assert!(said.contains(&expected) && said.contains("take another --prefix"), "round {round}: {said}");
        }
        let is_up = || processes(&group.prefix).len() == 5;
        wait_for("its stages", || (is_up() || winner.try_wait().unwrap().is_some()).then_some(()));
        // A claim ends with its process, however that ends.
        let is_killed = round % 2 == 1;
        signal(winner.id(), if is_killed { Signal::KILL } else { Signal::INT });
        let status = wait_for("its end", || winner.try_wait().unwrap());
        let said = text(winner.stderr.take());
        assert!(is_killed || is_orderly(status, &said), "round {round}: {status}: {said}");
        wait_for("the end of its stages", || processes(&group.prefix).is_empty().then_some(()));
        assert!(is_killed || group.files().is_empty(), "{:?}", group.files());
    }
}

/// A command as another user; nothing, with a printed reason, where this test may not become one.
fn other_user(row: &str) -> Option<impl Fn(&str, &[PathBuf]) -> Command> {
    if !geteuid().is_root() {
        eprintln!("{row}: skipped: only root can become another user");
        return None;
    }
    let user = |script: &str, paths: &[PathBuf]| {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups", "sh", "-c", script, "sh"]);
        command.args(paths).stdin(Stdio::null()).stderr(Stdio::null());
        command
    };
    Some(user)
}

/// Everything below a path.
fn all_below(path: PathBuf) -> Vec<PathBuf> {
    let entries = path.is_dir().then(|| std::fs::read_dir(&path).unwrap().flatten());
    let below: Vec<PathBuf> = entries.into_iter().flatten().flat_map(|entry| all_below(entry.path())).collect();
    std::iter::once(path).chain(below).collect()
}

/// Tries everything on every path, and says what has worked.
const TRIES: &str = r#"
for f; do
    # A file that is gone by now would be made anew.
    [ -e "$f" ] || [ ! -x "${f%/*}" ] || continue
    cat "$f" > /dev/null && echo "read $f"
    ls "$f/" > /dev/null && echo "listed $f"
    (: >> "$f") && echo "opened for writing $f"
    truncate -c -s 0 "$f" && [ -e "$f" ] && echo "truncated $f"
    flock -n "$f" true && echo "locked $f"
    mv "$f" "$f.moved" && echo "renamed $f"
    chmod 666 "$f" && echo "changed the mode of $f"
    rm -f "$f" && [ -d "${f%/*}" ] && [ -x "${f%/*}" ] && echo "removed $f"
done
exit 0
"#;

/// Row 42: another user can read, write, lock, truncate and remove no file of a running group, whatever the umask.
#[test]
fn row_42_another_user_reaches_no_file_of_a_running_group() {
    let Some(other) = other_user("row 42") else { return };
    let _cores = shared();
    let mut running = Running::spawn("row-42", &["--duration", "60s"], &StageKind::ALL, |command| {
        let program = command.get_program().to_owned();
        let arguments: Vec<_> = command.get_args().map(ToOwned::to_owned).collect();
        *command = Command::new("sh");
        command.args(["-c", "umask 0; exec \"$0\" \"$@\""]).arg(program).args(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    });
    // The connections of this test are removed after a while.
    let mut files = Vec::new();
    wait_for("files that stay", || {
        let before = std::mem::replace(&mut files, running.group.files());
        thread::sleep(Duration::from_millis(200));
        (before == files).then_some(())
    });
    files.push(running.group.black_box());
    for file in &files {
        let mode = file.symlink_metadata().unwrap().permissions().mode() & 0o777;
        assert_eq!(mode & 0o077, 0, "{}: {mode:o}", file.display());
    }
    let all: Vec<PathBuf> = files.into_iter().flat_map(all_below).collect();
    assert!(all.len() > 60, "{all:?}");
    let tried = other(TRIES, &all).output().unwrap();
    assert!(tried.status.success());
    assert_eq!(String::from_utf8_lossy(&tried.stdout), "", "another user did this");
    assert!(all.iter().all(|path| path.symlink_metadata().is_ok()));
    let prefix = running.group.prefix.to_string();
    for command in ["status", "disarm"] {
        let output = hydraxis().args([command, "--prefix", &prefix]).output().unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
    eprintln!("row 42: {} paths tried", all.len());
    let pids = running.pids;
    let said = running.interrupt();
    assert!(!said.stderr.contains("starts again"), "{pids:?}: {}", said.stderr);
}

/// Paths that another user has made. They are removed at the end of the test.
struct Planted(Vec<PathBuf>, Option<Child>);

impl Drop for Planted {
    fn drop(&mut self) {
        if let Some(holder) = &mut self.1 {
            let _ = holder.kill();
            let _ = holder.wait();
        }
        for path in &self.0 {
            let _ = std::fs::remove_dir_all(path);
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Row 42: a folder or a file that another user has made before is named, left alone, and told by `doctor`.
#[test]
fn row_42_what_another_user_has_made_before_is_named_and_left_alone() {
    let Some(other) = other_user("row 42") else { return };
    let group = TestGroup::new("row-42-before");
    let prefix = group.prefix.to_string();
    let node = format!("/dev/shm/{prefix}.9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt");
    // The folder with a lock that is never released; a file with a name that iceoryx2 gives; a link to a folder.
    let scripts = [
        ("mkdir \"$1\" && touch \"$1/members\" && exec flock -F -s \"$1/members\" sleep 1000", group.prefix.folder()),
        ("echo 0123456789abcdef > \"$1\"; chmod 666 \"$1\"; exec sleep 1000", PathBuf::from(node)),
        ("ln -s /tmp \"$1\"; exec sleep 1000", group.prefix.folder()),
    ];
    for (script, path) in scripts {
        let holder = other(script, std::slice::from_ref(&path)).spawn().unwrap();
        let planted = Planted(vec![path.clone()], Some(holder));
        let is_there = || {
            let found = path.symlink_metadata().ok()?;
            let is_ready = if found.is_dir() { locked(&path) } else { found.len() > 0 };
            is_ready.then_some(())
        };
        wait_for("the file of the other user", is_there);
        let before = path.symlink_metadata().unwrap();
        for arguments in [&["run", FOUR_AXES, "--duration", "1s"][..], &["clean"], &["control-proc", FOUR_AXES]] {
            let output = hydraxis().args(arguments).args(["--prefix", &prefix]).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{script}: {arguments:?}: {said}");
            assert!(said.contains(&format!("found {}", path.display())), "{script}: {arguments:?}: {said}");
            assert!(said.contains("take another --prefix"), "{arguments:?}: {said}");
        }
        let doctor = hydraxis().args(["doctor", "--seconds", "1"]).output().unwrap();
        let told = String::from_utf8_lossy(&doctor.stdout).into_owned();
        let line = told.lines().find(|line| line.contains("other users")).unwrap();
        assert!(line.contains(&format!("{} (user 65534", path.display())), "{line}");
        let after = path.symlink_metadata().unwrap();
        assert_eq!((after.ino(), after.len(), after.uid()), (before.ino(), before.len(), before.uid()));
        drop(planted);
    }
}

/// Whether another process has locked the file of members in a folder.
fn locked(folder: &Path) -> bool {
    File::open(folder.join("members")).is_ok_and(|file| file.try_lock().is_err())
}

/// A run whose `/dev/shm` is a small one of its own, and the lines that it has written.
struct Confined {
    group: TestGroup,
    run: Child,
    lines: Arc<Mutex<Vec<String>>>,
}

impl Confined {
    /// Nothing where this test may not mount anything.
    fn start(test: &str) -> Option<Self> {
        const MOUNT: &str = "mount -t tmpfs -o size=64m tmpfs /dev/shm";
        let allowed = Command::new("unshare").args(["-m", "sh", "-c", MOUNT]).stderr(Stdio::null()).status();
        if !allowed.is_ok_and(|status| status.success()) {
            eprintln!("{test}: skipped: unshare -m and mount are not allowed here");
            return None;
        }
        let group = TestGroup::new(test);
        let mut run = Command::new("unshare")
            .args(["-m", "sh", "-c", &format!("{MOUNT} && exec \"$0\" \"$@\"")])
            .arg(hydraxis().get_program())
            .args(["run", FOUR_AXES, "--duration", "60s", "--prefix", &group.prefix.to_string()])
            .args(["--set", "timing.feedback_timeout=5s"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = Arc::new(Mutex::new(Vec::new()));
        let (stderr, kept) = (run.stderr.take().unwrap(), Arc::clone(&lines));
        thread::spawn(move || {
            BufReader::new(stderr).lines().map_while(Result::ok).for_each(|line| kept.lock().unwrap().push(line));
        });
        Some(Self { group, run, lines })
    }

    fn said(&self) -> String {
        self.lines.lock().unwrap().join("\n")
    }

    /// Its shared memory, seen from here.
    fn memory(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/root/dev/shm", self.run.id()))
    }

    /// What `status` says in its place.
    fn status(&self) -> serde_json::Value {
        let output = Command::new("nsenter")
            .args(["-m", "-t", &self.run.id().to_string()])
            .arg(hydraxis().get_program())
            .args(["status", "--json", "-", "--prefix", &self.group.prefix.to_string()])
            .output()
            .unwrap();
        serde_json::from_slice(&output.stdout).unwrap_or_default()
    }

    /// Numbers of the processes of the stages; nothing while one is missing.
    fn stages(&self) -> Option<[u64; 4]> {
        let status = self.status();
        let pids = StageKind::ALL.map(|kind| status["stages"][kind.name()]["pid"].as_u64());
        pids.iter().all(Option::is_some).then(|| pids.map(Option::unwrap))
    }
}

impl Drop for Confined {
    fn drop(&mut self) {
        let _ = self.run.kill();
        let _ = self.run.wait();
        wait_for("the end of its stages", || processes(&self.group.prefix).is_empty().then_some(()));
    }
}

/// Row 43: when a stage could not start again with the room that is left, log and `status` say so, once.
#[test]
fn row_43_the_log_says_once_that_a_stage_could_not_start_again() {
    let _cores = shared();
    let Some(mut confined) = Confined::start("row-43-room") else { return };
    wait_for("running stages", || confined.stages());
    let fill = OpenOptions::new().create_new(true).write(true).open(confined.memory().join("fill")).unwrap();
    let left = || {
        let space = rustix::fs::statvfs(confined.memory()).unwrap();
        space.f_bavail * space.f_frsize
    };
    let leave = |bytes: u64| {
        let used = fill.metadata().unwrap().blocks() * 512;
        rustix::fs::fallocate(&fill, FallocateFlags::empty(), 0, used + left() - bytes).unwrap();
    };
    let warnings = || confined.status()["warnings"].as_array().cloned().unwrap_or_default();
    let count = |what: &str| confined.said().matches(what).count();
    let (short, enough) = ("MB to start again: it cannot", "MB to start again: it can\n");
    // The largest stage has 9 MB.
    leave(13 << 20);
    thread::sleep(Duration::from_millis(2500));
    assert_eq!((warnings().len(), count(short)), (0, 0), "{}", confined.said());
    leave(6 << 20);
    wait_for("the warning", || (count(short) > 0).then_some(()));
    let found = warnings();
    assert!(found.len() == 1 && found[0].as_str().unwrap().ends_with(short), "{found:?}");
    thread::sleep(Duration::from_millis(2500));
    fill.set_len(0).unwrap();
    wait_for("the line that takes it back", || (count("to start again: it can") > 1).then_some(()));
    assert_eq!(warnings().len(), 0);
    signal(confined.run.id(), Signal::INT);
    let status = wait_for("the end", || confined.run.try_wait().unwrap());
    assert!(is_orderly(status, &confined.said()), "{status}: {}", confined.said());
    let said = confined.said() + "\n";
    assert_eq!((said.matches(short).count(), said.matches(enough).count()), (1, 1), "{said}");
}

/// Row 43: with shared memory full, a stage that dies cannot start again, and its neighbours go on; with room it can.
#[test]
fn row_43_full_shared_memory_ends_no_neighbour_of_a_stage_that_starts_again() {
    let _cores = shared();
    let Some(mut confined) = Confined::start("row-43") else { return };
    let before = wait_for("running stages", || confined.stages());
    let entries = std::fs::read_dir(confined.memory()).unwrap().flatten();
    // A file of a process that starts may be gone by now.
    let known = entries.filter_map(|entry| Some((entry.metadata().ok()?, entry)));
    let files: Vec<_> = known.filter(|(file, _)| file.is_file()).collect();
    assert!(files.len() > 10, "{files:?}");
    for (file, entry) in files {
        assert!(file.blocks() * 512 >= file.len(), "{:?}: not all of it is allocated", entry.file_name());
    }
    let fill = confined.memory().join("fill");
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut file = OpenOptions::new().create(true).append(true).open(&fill).unwrap();
            while !stop.load(Ordering::Relaxed) {
                if file.write_all(&[0; 4096]).is_err() {
                    thread::sleep(Duration::from_micros(500));
                }
            }
        });
        let seen = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let free = || rustix::fs::statvfs(confined.memory()).unwrap().f_bavail;
            wait_for("full memory", || (free() == 0).then_some(()));
            signal(u32::try_from(before[StageKind::IdentProc as usize]).unwrap(), Signal::KILL);
            let again = "ident-proc ended with exit code 1; starts again";
            let wait =
                || wait_for("two starts that fail", || (confined.said().matches(again).count() >= 2).then_some(()));
            wait();
        }));
        stop.store(true, Ordering::Relaxed);
        if let Err(panic) = seen {
            eprintln!("{}", confined.said());
            std::panic::resume_unwind(panic);
        }
    });
    std::fs::remove_file(&fill).unwrap();
    let after = wait_for("the stage that was started again", || {
        confined.stages().filter(|pids| pids[StageKind::IdentProc as usize] != before[StageKind::IdentProc as usize])
    });
    for kind in StageKind::ALL.into_iter().filter(|kind| *kind != StageKind::IdentProc) {
        assert_eq!(before[kind as usize], after[kind as usize], "{}: {}", kind.name(), confined.said());
    }
    assert!(!confined.said().contains("SIGBUS"), "{}", confined.said());
    signal(confined.run.id(), Signal::INT);
    let status = wait_for("the end", || confined.run.try_wait().unwrap());
    assert!(is_orderly(status, &confined.said()), "{status}: {}", confined.said());
}
