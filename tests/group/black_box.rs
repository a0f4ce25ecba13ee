//! The black box: the last seconds of all channels, in a file, after a fault.

use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

use mcap::{MessageStream, Summary, read};
use pipeline::{message::CHANNELS, stage::StageKind};
use rustix::process::Signal;

use crate::harness::{
    hydraxis, is_running,
    place::{FullMemory, in_own_place},
    running::Running,
    shared, signal, wait_for,
};

/// Black boxes in a folder, the oldest first.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Numbers in the schema of a message, and the first of them as it is in a message.
fn is_number(line: &str) -> bool {
    ["uint8", "uint32", "uint64", "int64", "float64"].iter().any(|name| line.starts_with(name))
}

#[test]
fn a_killed_acquisition_leaves_a_file_with_what_came_before_and_after() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let boxes = folder.path().join("boxes");
    // A busy computer meets this time-out, and a stage that starts again does not.
    let patient = ["--set", "timing.feedback_timeout=150ms"];
    let boxes_there = ["--duration", "60s", "--black-box", boxes.to_str().unwrap()];
    let mut running = Running::start_with("black-box", &[&boxes_there[..], &patient].concat());
    std::thread::sleep(std::time::Duration::from_secs(2));
    let was_at = signalled(&running);
    let file =
        wait_for("a black box", || files(&boxes).pop().filter(|file| Summary::read(&fs::read(file).unwrap()).is_ok()));
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    let said = running.interrupt().stderr;
    assert!(said.contains(&format!("black box: sensor-proc killed by SIGKILL: {}", file.display())), "{said}");

    let bytes = fs::read(&file).unwrap();
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let facts = read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap().metadata;
    assert_eq!((&*facts["cause"], &*facts["axes"]), ("sensor-proc killed by SIGKILL", "boom arm telescope bucket"));
    assert_eq!(facts["valve-command lost"], "0");
    let cause: u64 = facts["cause_monotonic_ns"].parse().unwrap();
    let to_utc: u64 = facts["realtime_minus_monotonic_ns"].parse().unwrap();
    assert!(cause.abs_diff(was_at) < 1_000_000_000, "{cause} {was_at}");

    let mut channels: BTreeMap<String, Vec<(u64, u64)>> = BTreeMap::new();
    let mut before = 0;
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= before, "{}: {} after {before}", message.channel.topic, message.log_time);
        before = message.log_time;
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!((&*message.channel.message_encoding, &*schema.encoding), ("cdr", "ros2msg"));
        assert!(std::str::from_utf8(&schema.data).unwrap().lines().any(is_number));
        // Behind the four bytes that begin CDR comes the header, which begins with the number of the sample.
        let sequence = u64::from_le_bytes(message.data[4..12].try_into().unwrap());
        channels.entry(message.channel.topic.clone()).or_default().push((message.log_time - to_utc, sequence));
    }
    // Nobody has written a reference or a request. The last channel is that of recordings alone.
    let sent = CHANNELS.iter().filter(|name| !["reference", "request"].contains(name));
    let expected = sent.chain(&["controller-state"]);
    assert!(expected.clone().all(|name| channels.contains_key(*name)), "{:?}", channels.keys());
    assert_eq!(channels.len(), expected.count());
    let commands = &channels["valve-command"];
    assert!(commands.windows(2).all(|pair| pair[0].0 <= pair[1].0 && pair[0].1 <= pair[1].1));
    let (first, last) = (commands[0].0, commands[commands.len() - 1].0);
    assert!(first + 1_500_000_000 < cause && last > cause + 500_000_000, "{first} {cause} {last}");
}

/// Kills the acquisition. The time, ns.
fn signalled(running: &Running) -> u64 {
    signal(running.pid(StageKind::SensorProc), Signal::KILL);
    pipeline::stage::monotonic_ns()
}

/// What a file says about its fault, and the times of its commands, ns.
fn facts_and_commands(file: &Path) -> (BTreeMap<String, String>, Vec<u64>) {
    let bytes = fs::read(file).unwrap();
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let facts = read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap().metadata;
    let messages = MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let commands = messages.filter(|message| message.channel.topic == "valve-command");
    (facts, commands.map(|message| message.log_time).collect())
}

/// The messages are in shared memory, which outlives the supervisor and all stages.
#[test]
fn what_a_killed_supervisor_has_kept_is_written_by_clean_or_by_the_next_run() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    for (name, next_run) in [("black-box-clean", false), ("black-box-next", true)] {
        let boxes = folder.path().join(name);
        // A busy computer latches nothing by itself.
        let patient = ["--set", "timing.feedback_timeout=5s", "--set", "timing.period=20ms"];
        let arguments = ["--duration", "60s", "--black-box", boxes.to_str().unwrap(), "--no-record"];
        let mut running = Running::start_with(name, &[&arguments[..], &patient].concat());
        let kept = running.group.black_box();
        assert_eq!(fs::metadata(&kept).unwrap().permissions().mode() & 0o777, 0o600);
        std::thread::sleep(std::time::Duration::from_secs(2));
        let clean = || {
            let prefix = running.group.prefix.to_string();
            let mut command = hydraxis();
            if next_run {
                let quiet = ["--duration", "200ms", "--off", "--no-record", "--set", "timing.feedback_timeout=5s"];
                command.args(["run", "--black-box", boxes.to_str().unwrap()]).args(quiet);
            } else {
                command.args(["clean", "--prefix", &prefix]);
            }
            String::from_utf8(command.output().unwrap().stderr).unwrap()
        };
        if !next_run {
            let said = clean();
            assert!(
                said.contains("is alive") && kept.exists() && files(&boxes).is_empty(),
                "{said} {:?}",
                files(&boxes)
            );
        }
        signal(running.supervisor.id(), Signal::KILL);
        running.supervisor.wait().unwrap();
        wait_for("the end of the stages", || running.none_runs().then_some(()));
        assert!(kept.exists() && files(&boxes).is_empty());
        let said = clean();
        let [file] = &files(&boxes)[..] else { panic!("{:?}: {said}", files(&boxes)) };
        assert!(said.contains(&format!("black box: the supervisor was killed: {}", file.display())), "{said}");
        assert!(!kept.exists());
        let (facts, commands) = facts_and_commands(file);
        assert_eq!(
            (&*facts["cause"], &*facts["group"]),
            ("the supervisor was killed", &*running.group.prefix.to_string())
        );
        assert!(commands.len() > 50 && commands[commands.len() - 1] - commands[0] > 1_500_000_000, "{commands:?}");
        let page = folder.path().join("page.html");
        let told = hydraxis().arg("report").arg(file).arg("--output").arg(&page).output().unwrap().stdout;
        let told = String::from_utf8(told).unwrap();
        assert!(told.contains("Something went wrong") && told.contains(": the supervisor was killed."), "{told}");
    }
}

#[test]
fn axes_that_latch_at_once_share_a_file() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let boxes = folder.path().join("boxes");
    let arguments = ["--duration", "60s", "--black-box", boxes.to_str().unwrap(), "--no-record"];
    let patient = ["--set", "timing.feedback_timeout=5s"];
    let mut running = Running::start_with("black-box-all", &[&arguments[..], &patient].concat());
    let stop = ["disarm", "--emergency", "--prefix", &running.group.prefix.to_string()];
    assert!(hydraxis().args(stop).output().unwrap().status.success());
    running.interrupt();
    let [file] = &files(&boxes)[..] else { panic!("{:?}", files(&boxes)) };
    let cause = facts_and_commands(file).0["cause"].clone();
    let expected = ["boom", "arm", "telescope", "bucket"].map(|axis| format!("axis.{axis} latched by emergency-stop"));
    assert_eq!(cause, expected.join("; "));
}

#[test]
fn a_folder_without_room_costs_the_black_box_and_nothing_else() {
    in_own_place("black_box::a_folder_without_room_costs_the_black_box_and_nothing_else", |is_private| {
        if !is_private {
            return;
        }
        let boxes = Path::new("/dev/shm/boxes");
        let arguments = ["--duration", "60s", "--black-box", boxes.to_str().unwrap(), "--no-record"];
        let patient = ["--set", "timing.feedback_timeout=5s"];
        let mut running = Running::start_with("black-box-full", &[&arguments[..], &patient].concat());
        let full = FullMemory::take();
        let stop = ["disarm", "--emergency", "--prefix", &running.group.prefix.to_string()];
        assert!(hydraxis().args(stop).output().unwrap().status.success());
        let before = running.pids;
        std::thread::sleep(std::time::Duration::from_secs(2));
        assert!(before.iter().all(|pid| is_running(*pid)), "a stage has ended");
        drop(full);
        let said = running.interrupt().stderr;
        assert!(said.contains("warning: no black box of \"axis.boom latched by emergency-stop; "), "{said}");
        assert!(said.contains("No space left"), "{said}");
        assert!(files(boxes).is_empty(), "{:?}", files(boxes));
        fs::remove_dir(boxes).unwrap();
    });
}

/// Also the end of the simulated machine, which ends the run.
#[test]
fn the_death_of_any_stage_leaves_a_file() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    for kind in [StageKind::IdentProc, StageKind::ControlProc, StageKind::PlantSim] {
        let boxes = folder.path().join(kind.name());
        let arguments = ["--duration", "60s", "--black-box", boxes.to_str().unwrap()];
        let mut running = Running::start_with(
            "black-box-death",
            &[&arguments[..], &["--set", "timing.feedback_timeout=1s"]].concat(),
        );
        signal(running.pid(kind), Signal::KILL);
        let is_whole = |file: &PathBuf| Summary::read(&fs::read(file).unwrap()).is_ok();
        let file = wait_for("a black box", || files(&boxes).pop().filter(is_whole));
        let bytes = fs::read(&file).unwrap();
        let summary = Summary::read(&bytes).unwrap().unwrap();
        let facts = read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap().metadata;
        assert!(facts["cause"].contains(&format!("{} killed by SIGKILL", kind.name())), "{facts:?}");
        if kind == StageKind::PlantSim {
            running.expect_end(1);
        } else {
            running.interrupt();
        }
    }
}

#[test]
fn a_run_writes_no_black_box_without_a_fault_nor_where_none_is_wanted() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let prefix = format!("t{}-no-box", std::process::id());
        let patient = "timing.feedback_timeout=1s";
        let common = ["run", "--prefix", &prefix, "--duration", "500ms", "--off", "--set", patient];
        let mut command = hydraxis();
        command.args(common).args(arguments).env("XDG_STATE_HOME", folder.path());
        let said = command.output().unwrap();
        assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
        String::from_utf8(said.stderr).unwrap()
    };
    run(&["--no-black-box"]);
    assert!(files(folder.path()).is_empty());
    run(&[]);
    assert!(files(&folder.path().join("hydraxis")).is_empty() && folder.path().join("hydraxis").exists());
    // A folder that cannot be made is a warning: the machine is not to stand still for it.
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let said = run(&["--black-box", file.to_str().unwrap()]);
    assert!(said.contains("warning: no black box: ") && said.contains("--black-box"), "{said}");
}
