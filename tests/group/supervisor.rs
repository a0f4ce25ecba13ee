//! The supervisor, `hydraxis run`: stages that are killed, hang, do not end, or cannot be started.

use std::{
    io::{BufRead, BufReader},
    os::unix::net::UnixDatagram,
    path::PathBuf,
    process::{ChildStdin, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::harness::{
    PATIENCE, TestGroup, alone, hydraxis, is_running,
    running::{Running, is_orderly, text},
    shared, signal, wait_for,
};
use pipeline::{
    channel::Reader,
    message::{ControlMode, EncoderSample, StageHealth, ValveCommand, control_flag},
    stage::StageKind,
};
use rustix::process::Signal;
use serde_json::json;

const NOTHING: Vec<PathBuf> = Vec::new();

/// A setting by which a shell script is run in the place of ident-proc.
fn script(script: &str) -> String {
    let words = serde_json::to_string(&["/bin/sh", "-c", script, "sh"]).unwrap();
    format!("stage.ident-proc.command={words}")
}

#[test]
fn a_killed_identifier_comes_back_and_the_run_ends_well() {
    let _cores = shared();
    let mut running = Running::start_with("ident", &["--duration", "3s", "--json", "-"]);
    let channels = running.group.join();
    let mut health = channels.reader().unwrap();
    signal(running.pid(StageKind::IdentProc), Signal::KILL);
    running.await_next(StageKind::IdentProc, &mut health);
    drop((channels, health));
    let said = running.expect_orderly_end();
    let report: serde_json::Value = serde_json::from_str(&said.stdout).unwrap();
    assert_eq!(report["stages"]["ident-proc"]["restarts"], 1, "{}", said.stderr);
    assert_eq!(report["stages"]["ident-proc"]["restart_causes"], json!(["killed by SIGKILL"]));
    assert_eq!(report["stages"]["control-proc"]["restarts"], 0);
    assert!(said.stderr.contains("ident-proc killed by SIGKILL; starts again in 0.2 s"), "{}", said.stderr);
    assert_eq!(running.group.files(), NOTHING);
}

/// Waits until the boom moves.
fn await_motion(commands: &mut Reader<ValveCommand>) {
    wait_for("motion", || {
        commands.newest().unwrap().if_new().filter(|command| command.axes[0].command != 0.0).map(drop)
    });
}

#[test]
fn a_controller_that_was_killed_in_motion_comes_back_disarmed() {
    let _cores = shared();
    let mut running = Running::start_with("control", &["--duration", "60s", "--set", "timing.feedback_timeout=5s"]);
    let channels = running.group.join();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    await_motion(&mut commands);
    signal(running.pid(StageKind::ControlProc), Signal::KILL);
    let mut first = Vec::new();
    wait_for("commands of the next controller", || {
        let command = commands.read().unwrap().if_new().copied();
        first.extend(command.filter(|_| commands.restarts() == 1));
        (first.len() >= 10).then_some(())
    });
    for axis in first.iter().flat_map(|command| &command.axes[..4]) {
        assert_eq!((axis.command, axis.mode), (0.0, ControlMode::Neutral as u32));
        assert_ne!(axis.flags & control_flag::DISARMED, 0);
    }
    assert_eq!(first[0].header.number, 0, "from the first command on");
    drop((commands, channels));
    let said = running.interrupt();
    let hint = format!("hydraxis arm --prefix {}", running.group.prefix);
    assert!(said.stderr.contains("control-proc: started again, disarmed") && said.stderr.contains(&hint));
    assert!(said.stdout.contains("control-proc: started again once: killed by SIGKILL."), "{}", said.stdout);
}

#[test]
fn a_killed_acquisition_latches_the_controller_and_comes_back_with_higher_numbers() {
    let _cores = alone();
    let mut running = Running::start("sensor");
    let channels = running.group.join();
    let mut samples: Reader<EncoderSample> = channels.reader().unwrap();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    await_motion(&mut commands);
    let killed = Instant::now();
    signal(running.pid(StageKind::SensorProc), Signal::KILL);
    let latched = |command: &ValveCommand| {
        command.axes[..4].iter().all(|axis| axis.command == 0.0 && axis.flags & control_flag::FEEDBACK != 0)
    };
    wait_for("the latch", || commands.newest().unwrap().if_new().is_some_and(latched).then_some(()));
    let (mut last, mut gap) = (0, 0);
    wait_for("samples after the restart", || {
        let sample = samples.read().unwrap().if_new()?;
        let sequence = sample.header.sequence;
        assert!(last == 0 || sequence > last, "{sequence} after {last}");
        gap = gap.max(sequence.saturating_sub(last.max(1)));
        last = sequence;
        (samples.restarts() == 1).then_some(())
    });
    let dead = killed.elapsed().as_millis() as u64 / 10;
    assert!((10..=dead + 1).contains(&gap), "{gap} ticks left out in {dead} periods");
    // The new samples do not release the axes.
    wait_for("commands from the new samples", || {
        let command = commands.read().unwrap().if_new()?;
        assert!(command.header.sequence < last || latched(command));
        (command.header.sequence >= last + 10).then_some(())
    });
    drop((samples, commands, channels));
    running.interrupt();
}

#[test]
fn too_many_deaths_end_the_run_with_the_first_cause() {
    let _cores = shared();
    let mut running = Running::start("limit");
    let channels = running.group.join();
    let mut health = channels.reader().unwrap();
    signal(running.pid(StageKind::IdentProc), Signal::ABORT);
    for _ in 0..5 {
        running.await_next(StageKind::IdentProc, &mut health);
        signal(running.pid(StageKind::IdentProc), Signal::KILL);
    }
    let said = running.expect_end(1);
    let last = said.stderr.lines().last().unwrap_or_default();
    assert_eq!(last, "ident-proc killed by SIGABRT, first of 6 times within 30s", "{}", said.stderr);
    assert!(said.stderr.contains("starts again in 3.2 s"), "{}", said.stderr);
    assert!(running.none_runs());
}

#[test]
fn a_killed_machine_ends_the_run_and_the_first_of_two_deaths_is_the_cause() {
    let _cores = shared();
    let mut running = Running::start("plant");
    let ident = running.pid(StageKind::IdentProc);
    signal(ident, Signal::KILL);
    wait_for("its death", || (!is_running(ident)).then_some(()));
    signal(running.pid(StageKind::PlantSim), Signal::KILL);
    let said = running.expect_end(1);
    let last = said.stderr.lines().last().unwrap_or_default();
    assert_eq!(last, "ident-proc killed by SIGKILL; then plant-sim killed by SIGKILL", "{}", said.stderr);
    assert!(running.none_runs());
    assert_eq!(running.group.files(), NOTHING);
}

#[test]
fn a_stage_that_hangs_is_killed_and_starts_again() {
    let _cores = shared();
    let mut running = Running::start("hung");
    let channels = running.group.join();
    let mut health = channels.reader().unwrap();
    let before = running.pid(StageKind::IdentProc);
    signal(before, Signal::STOP);
    running.await_next(StageKind::IdentProc, &mut health);
    assert!(!is_running(before));
    drop((channels, health));
    signal(running.supervisor.id(), Signal::TERM);
    let said = running.expect_orderly_end();
    assert!(said.stderr.contains("ident-proc killed: no heartbeat for 2s; starts again"), "{}", said.stderr);
    assert!(said.stderr.contains("control-proc: asked to end\ncontrol-proc: ended\n"), "{}", said.stderr);
}

#[test]
fn a_stage_ends_when_its_input_does() {
    let group = TestGroup::new("eof");
    let channels = group.join();
    let mut health: Reader<StageHealth> = channels.reader().unwrap();
    let mut stage = hydraxis()
        .args(["control-proc", "--prefix", &group.prefix.to_string(), "--parent", &std::process::id().to_string()])
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for("the stage", || health.read().unwrap().if_new().map(|_| ()));
    let mut stdin: Option<ChildStdin> = stage.stdin.take();
    // Text on standard input is ignored.
    std::io::Write::write_all(stdin.as_mut().unwrap(), b"text\n").unwrap();
    assert!(stage.try_wait().unwrap().is_none());
    drop(stdin);
    let status = wait_for("its end", || stage.try_wait().unwrap());
    assert!(status.success(), "{status}");
}

#[test]
fn a_stage_that_does_not_end_with_its_input_is_ended() {
    let (group, folder) = (TestGroup::new("eof-stuck"), tempfile::tempdir().unwrap());
    let fifo = folder.path().join("path.csv");
    rustix::fs::mknodat(rustix::fs::CWD, &fifo, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    // The stage reads its reference from a pipe without a writer, and so it never comes to read its stop flag.
    let mut stage = hydraxis()
        .args(["control-proc", "--prefix", &group.prefix.to_string(), "--parent", &std::process::id().to_string()])
        .args(["--set", "axis.boom.reference.kind=trajectory"])
        .args(["--set", &format!("axis.boom.reference.file={}", fifo.display())])
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let _writer = wait_for("the stage to read", || {
        let open = rustix::fs::OFlags::WRONLY | rustix::fs::OFlags::NONBLOCK;
        rustix::fs::open(&fifo, open, rustix::fs::Mode::empty()).ok()
    });
    drop(stage.stdin.take());
    let status = wait_for("its end", || stage.try_wait().unwrap());
    let said = text(stage.stderr.take());
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("control-proc: its supervisor has ended, and it did not end within 500ms"), "{said}");
}

#[test]
fn a_supervisor_that_is_asked_to_end_ends_well() {
    let _cores = shared();
    for asked in [Signal::TERM, Signal::HUP] {
        let mut running = Running::start("asked");
        signal(running.supervisor.id(), asked);
        let said = running.expect_orderly_end();
        let steps = ["control-proc: asked to end", "control-proc: ended", "ident-proc: asked to end"];
        let places = steps.map(|step| said.stderr.find(step).unwrap_or_else(|| panic!("{step}: {}", said.stderr)));
        assert!(places.is_sorted(), "{}", said.stderr);
        assert!(running.none_runs());
        assert_eq!(running.group.files(), NOTHING);
    }
}

#[test]
fn a_program_that_ignores_the_signal_is_killed_with_its_child() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pid");
    let stubborn = script(&format!("trap '' TERM; sleep 1000 & echo $! > {}; wait; sleep 1000", file.display()));
    let others = [StageKind::PlantSim, StageKind::ControlProc, StageKind::SensorProc];
    for hurry in [false, true] {
        let mut running = Running::spawn("stubborn", &["--duration", "60s", "--set", &stubborn], &others, |command| {
            command.env("IGNORED", "");
        });
        let child = wait_for("its child", || std::fs::read_to_string(&file).ok()?.trim().parse::<u32>().ok());
        assert!(is_running(child));
        let started = Instant::now();
        signal(running.supervisor.id(), Signal::INT);
        let mut lines = BufReader::new(running.supervisor.stderr.take().unwrap()).lines();
        let mut said = String::new();
        for line in lines.by_ref().map(Result::unwrap) {
            if hurry && line == "control-proc: asked to end" {
                signal(running.supervisor.id(), Signal::INT);
            }
            said += &format!("{line}\n");
        }
        running.expect_end(1);
        let expected =
            if hurry { "ident-proc: killed in a hurry" } else { "ident-proc: did not end within 600ms: killed" };
        assert!(said.contains(expected) && said.contains("control-proc: ended"), "{said}");
        wait_for("the child's end", || (!is_running(child)).then_some(()));
        assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
        assert_eq!(running.group.files(), NOTHING);
        std::fs::remove_file(&file).unwrap();
    }
}

#[test]
fn a_stage_that_cannot_be_set_up_ends_the_run_with_its_message() {
    let _cores = shared();
    let group = TestGroup::new("setup");
    let broken = script("echo there is no bus >&2; exit 3");
    let output = hydraxis().args(["run", "--prefix", &group.prefix.to_string(), "--set", &broken]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.ends_with("ident-proc ended with exit code 3\n  ident-proc | there is no bus\n"), "{said}");
    assert!(!said.contains("starts again"), "{said}");
    assert_eq!(group.files(), NOTHING);
}

#[test]
fn a_stage_that_ends_well_before_its_time_starts_again() {
    let _cores = shared();
    let group = TestGroup::new("early");
    let early = script("sleep 1.5");
    let arguments = ["run", "--prefix", &group.prefix.to_string(), "--duration", "2s", "--set", &early];
    let output = hydraxis().args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(is_orderly(output.status, &said), "{said}");
    assert!(said.contains("ident-proc ended before its time; starts again in 0.2 s"), "{said}");
}

#[test]
fn lines_of_the_stages_are_whole_and_go_to_a_file_too() {
    let _cores = shared();
    let (group, folder) = (TestGroup::new("lines"), tempfile::tempdir().unwrap());
    let talk =
        "trap 'exit 0' TERM; while :; do printf 'one '; printf 'uno ' >&2; sleep 0.01; echo two; echo due >&2; done";
    let logs = folder.path().join("logs");
    let output = hydraxis()
        .args(["run", "--prefix", &group.prefix.to_string(), "--duration", "1s", "--set", &script(talk)])
        .args([std::ffi::OsStr::new("--log-folder"), logs.as_os_str()])
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(is_orderly(output.status, &said), "{said}");
    // After that the shell itself may write a message about its killed child.
    let before = said.lines().take_while(|line| *line != "ident-proc: asked to end");
    let talked = before.filter_map(|line| line.strip_prefix("ident-proc | "));
    // It may do so a moment before the end is reported.
    let talked: Vec<&str> = talked.map(|line| line.strip_suffix("Terminated").unwrap_or(line)).collect();
    assert!(talked.len() > 5 && talked.contains(&"one two") && talked.contains(&"uno due"), "{said}");
    let whole = |line: &&str| ["one two", "uno due", "one ", "uno ", ""].contains(line);
    assert!(talked.iter().all(whole), "{said}");
    assert!(talked.iter().filter(|line| line.ends_with(' ')).count() <= 2, "only what the end cuts off: {said}");
    let file = std::fs::read_dir(&logs).unwrap().next().unwrap().unwrap();
    let name = file.file_name().into_string().unwrap();
    assert!(name.starts_with(&format!("{}-20", group.prefix)) && name.ends_with("Z.log"), "{name}");
    let text = std::fs::read_to_string(file.path()).unwrap();
    assert!(text.lines().all(|line| line.starts_with("20") && line[20..].contains("Z ")), "{text}");
    assert_eq!(text.matches("ident-proc | one two").count(), said.matches("ident-proc | one two").count());
    assert!(text.contains("hydraxis | 20 t excavator"), "{text}");
}

#[test]
fn a_flood_of_unread_lines_delays_no_stage() {
    let _cores = alone();
    let flood = script("exec yes a line that nobody reads");
    let mut running = Running::spawn(
        "flood",
        &["--duration", "1s", "--set", &flood, "--set", "timing.feedback_timeout=5s", "--json", "-"],
        &[StageKind::PlantSim, StageKind::ControlProc, StageKind::SensorProc],
        |_| (),
    );
    // The pipe of standard error is full within milliseconds. It is read only after the stages have ended.
    wait_for("the stages' end", || running.none_runs().then_some(()));
    let said = running.expect_orderly_end();
    assert!(said.stderr.contains("ident-proc | a line that nobody reads\n"));
    assert!(said.stderr.contains(" lines left out: "));
}

#[test]
fn all_problems_are_reported_at_once_and_nothing_is_started() {
    let group = TestGroup::new("preflight");
    let run = |arguments: &[&str]| {
        let output = hydraxis().args(["run", "--prefix", &group.prefix.to_string()]).args(arguments).output().unwrap();
        assert_eq!(group.files(), NOTHING);
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, said) = run(&[
        "--set",
        "stage.ident-proc.command=[\"/no/such/program\"]",
        "--set",
        "stage.control-proc.command=[\"no-such-program\"]",
        "--set",
        "stage.plant-sim.core=1000",
        "--set",
        "realtime.affinity=strict",
        "--log-folder",
        "/proc/nobody",
    ]);
    assert_eq!(code, Some(2), "{said}");
    assert_eq!(said.lines().count(), 4, "{said}");
    assert!(said.contains("stage.ident-proc.command: found \"/no/such/program\", which cannot be executed"), "{said}");
    assert!(said.contains("stage.control-proc.command: found \"no-such-program\""), "{said}");
    assert!(said.contains("core 1000: not to be had") && said.contains("strict"), "{said}");
    assert!(said.contains("--log-folder: /proc"), "{said}");

    let strict = ["--set", "stage.plant-sim.core=1000", "--set", "realtime.affinity=strict"];
    let (code, said) = run(&strict);
    assert_eq!(code, Some(1), "the file is right, the computer is not: {said}");
    let (code, said) = run(&["--set", "stage.plant-sim.core=1000", "--lockstep", "--duration", "1s"]);
    assert_eq!((code, said.matches("core 1000").count()), (Some(0), 1), "warned of once: {said}");
}

/// Messages to the service manager, with their times, up to the first one that begins with `until`.
fn listen(socket: &UnixDatagram, until: &str) -> Vec<(String, Instant)> {
    let (mut heard, mut bytes) = (Vec::new(), [0; 4096]);
    loop {
        let length = socket.recv(&mut bytes).unwrap_or_else(|error| panic!("waiting for {until}: {error}, {heard:?}"));
        let text = String::from_utf8(bytes[..length].to_vec()).unwrap();
        let is_it = text.starts_with(until);
        heard.push((text, Instant::now()));
        if is_it {
            return heard;
        }
    }
}

#[test]
fn a_service_manager_is_notified_of_start_watchdog_and_end() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let heard = thread::spawn(move || {
        let start = listen(&socket, "READY=1");
        (start, listen(&socket, "STOPPING=1"))
    });
    let arguments = ["--duration", "60s", "--set", "stage.ident-proc.restart=never"];
    let mut running = Running::spawn("notify", &arguments, &StageKind::ALL, |command| {
        command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "400000");
    });
    let ready = Instant::now();
    wait_for("some life", || (ready.elapsed() > Duration::from_millis(1500)).then_some(()));
    let stopped = Instant::now();
    signal(running.pid(StageKind::IdentProc), Signal::STOP);
    let said = running.expect_end(1);
    assert!(said.stderr.ends_with("ident-proc killed: no heartbeat for 2s\n"), "{}", said.stderr);
    let (start, life) = heard.join().unwrap();
    assert!(start.iter().all(|(text, _)| !text.starts_with("STOPPING")));
    let of = |what: &'static str| life.iter().filter(move |(text, _)| text.starts_with(what));
    assert!(of("WATCHDOG=1").filter(|(_, at)| *at < stopped).count() >= 5, "{life:?}");
    assert!(of("STATUS=").any(|(text, _)| text.contains("boom")), "{life:?}");
    let (last, end) = (of("WATCHDOG=1").next_back().unwrap().1, life.last().unwrap().1);
    assert!(end - last > Duration::from_millis(500), "not fed any more: {:?} before the end", end - last);
}
