//! `hydraxis status`: what it shows of a running group, and that it does not disturb the group.

use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    process::Stdio,
};

use crate::harness::{TestGroup, hydraxis, running::Running, shared, signal, wait_for};
use pipeline::{channel::Reader, message::EncoderSample, stage::StageKind};
use rustix::process::Signal;
use serde_json::Value;

/// Starts a group that runs longer than any of these tests.
fn start(test: &str) -> Running {
    Running::start_with(test, &["--duration", "600s"])
}

/// The JSON report of `status`, and its exit code.
fn status(running: &Running, arguments: &[&str]) -> (Value, Option<i32>) {
    let prefix = running.group.prefix.to_string();
    let output = hydraxis().args(["status", "--json", "-", "--prefix", &prefix]).args(arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {text}")), output.status.code())
}

#[test]
fn a_running_group_is_shown_with_its_stages_channels_and_axes() {
    let _cores = shared();
    let running = start("status");
    let (status, code) = status(&running, &[]);
    assert_eq!(code, Some(0));
    assert_eq!(status["group"], running.group.prefix.to_string());
    for kind in StageKind::ALL {
        let stage = &status["stages"][kind.name()];
        assert_eq!(stage["state"], "running", "{stage}");
        let rate = stage["rate_hz"].as_f64().unwrap();
        let expected = if kind == StageKind::PlantSim { 1000.0 } else { 100.0 };
        // The rate is that between two heartbeats, which may be late on a busy computer.
        assert!(rate > 0.3 * expected && rate < 3.0 * expected, "{}: {rate}", kind.name());
        assert!(stage["heartbeat_age_ns"].as_u64().is_some() && stage["lost"].as_u64().is_some());
    }
    let channels = &status["stages"]["control-proc"]["channels"];
    for (channel, comes) in
        [("encoder-sample", true), ("coefficient-snapshot", true), ("reference", false), ("request", false)]
    {
        assert_eq!(channels[channel]["received"].as_u64().unwrap() > 0, comes, "{channel}");
        assert_eq!(channels[channel]["age_ns"].is_u64(), comes, "{channel}");
    }
    let names: Vec<&str> = status["axes"].as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names, ["arm", "boom", "bucket", "telescope"]);
    assert_eq!(status["axes"]["boom"]["mode"], "track");
    assert!(status["axes"]["boom"]["position"].as_f64().is_some_and(|position| position > 0.1));

    let prefix = running.group.prefix.to_string();
    let tables = hydraxis().args(["status", "--prefix", &prefix]).output().unwrap();
    let text = String::from_utf8_lossy(&tables.stdout).into_owned();
    for expected in ["control-proc <- encoder-sample", "sensor-proc release jitter", "telescope", "last late tick"] {
        assert!(text.contains(expected), "{expected}\n{text}");
    }
}

#[test]
fn watching_ends_when_nobody_reads_any_more() {
    let _cores = shared();
    let running = start("status-watch");
    let prefix = running.group.prefix.to_string();
    let mut watch = hydraxis().args(["status", "--watch", "--prefix", &prefix]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    // The pipe closes at the end of this line, as with `| head -n 1`.
    BufReader::new(watch.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with("Group ") && !line.contains('\x1b'), "plain text, since it is no terminal: {line:?}");
    let status = wait_for("the command to end", || watch.try_wait().unwrap());
    assert!(status.success(), "{status}");
}

/// Regression: the screen went on without its terminal, took a core and could only be killed.
#[test]
fn a_screen_ends_when_its_terminal_is_gone() {
    let _cores = shared();
    let running = start("status-gone");
    let (master, path) = can::bus::pseudo_terminal().unwrap();
    let mut terminal = File::from(master);
    let slave = || File::options().read(true).write(true).open(&path).unwrap();
    let mut command = hydraxis();
    command.args(["status", "--watch", "--prefix", &running.group.prefix.to_string()]).env("TERM", "xterm");
    let mut watch = command.stdin(slave()).stdout(slave()).stderr(slave()).spawn().unwrap();
    // The streams of this process would keep the terminal.
    drop(command);
    let mut drawn = [0; 1000];
    let length = terminal.read(&mut drawn).unwrap();
    assert!(drawn[..length].contains(&0x1b), "{:?}", String::from_utf8_lossy(&drawn[..length]));
    drop(terminal);
    let status = wait_for("the command to end", || watch.try_wait().unwrap());
    assert!(status.success(), "{status}");
}

#[test]
fn a_reset_counts_from_zero_again_without_a_gap() {
    let _cores = shared();
    let running = start("status-reset");
    let channels = running.group.join();
    let mut samples: Reader<EncoderSample> = channels.reader().unwrap();
    let before = wait_for("300 ticks", || {
        let (status, _) = status(&running, &[]);
        status["stages"]["ident-proc"]["samples"].as_u64().filter(|samples| *samples > 300)
    });
    status(&running, &["--reset"]);
    let after = wait_for("the reset", || {
        let (status, _) = status(&running, &[]);
        let stage = &status["stages"]["ident-proc"];
        stage["samples"].as_u64().filter(|samples| *samples < before).map(|samples| (samples, stage["tick"].clone()))
    });
    assert!(after.1.as_u64().unwrap() > before, "the ticks go on: {after:?}");
    // A signal causes neither an early nor a missing tick.
    let mut last: Option<u64> = None;
    while let Some(sample) = samples.read().unwrap().if_new() {
        let header = sample.header;
        assert!(last.is_none_or(|last| header.sequence > last));
        last = Some(header.sequence);
    }
    assert!(last.is_some());
}

#[test]
fn a_stage_that_is_silent_is_named() {
    let _cores = shared();
    let running = start("status-silent");
    let (status, _) = status(&running, &[]);
    let pid = status["stages"]["ident-proc"]["pid"].as_u64().unwrap() as u32;
    signal(pid, Signal::STOP);
    let prefix = running.group.prefix.to_string();
    let text = wait_for("the silence", || {
        let output = hydraxis().args(["status", "--prefix", &prefix]).output().unwrap();
        (output.status.code() == Some(1)).then(|| String::from_utf8_lossy(&output.stderr).into_owned())
    });
    signal(pid, Signal::CONT);
    assert!(text.contains("silent for more than a second: ident-proc"), "{text}");
}

#[test]
fn without_a_group_status_says_so_and_makes_none() {
    let group = TestGroup::new("status-none");
    let prefix = group.prefix.to_string();
    for option in [&[][..], &["--watch"]] {
        let output = hydraxis().args(["status", "--prefix", &prefix]).args(option).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1));
        assert!(
            text.contains("no group") && text.contains(&format!("hydraxis run MACHINE.toml --prefix {prefix}")),
            "{text}"
        );
    }
    assert_eq!(group.files(), Vec::<std::path::PathBuf>::new());
}
