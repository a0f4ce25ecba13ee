//! Every kind of event is provoked in a real group, and told on standard error when it happens.

use std::{
    collections::BTreeSet,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::Stdio,
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, Reader},
    machine::BUILT_IN,
    message::{AxisMode, Header, Reference, Request, ValveCommand},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

use crate::harness::{
    Cores, FOUR_AXES, PATIENCE, alone, channel::await_message, hydraxis, running::Running, signal, wait_for,
};

const MACHINE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator.toml");
const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator-model.toml");

/// A group whose standard error is read while it runs.
struct Told {
    // Dropped before the group, whose last member removes the files.
    channels: Group,
    running: Running,
    text: Arc<Mutex<String>>,
    _cores: Cores,
}

impl Told {
    fn start(test: &str, arguments: &[&str]) -> Self {
        let cores = alone();
        let common = ["--duration", "10min", "--set", "timing.feedback_timeout=1s"];
        let arguments = [&common, arguments].concat();
        let mut running = Running::spawn(test, &arguments, &StageKind::ALL, |_| ());
        let stderr = BufReader::new(running.supervisor.stderr.take().unwrap());
        let text = Arc::new(Mutex::new(String::new()));
        let all = Arc::clone(&text);
        thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                *all.lock().unwrap() += &(line + "\n");
            }
        });
        let channels = running.group.join();
        Self { running, text, channels, _cores: cores }
    }

    /// Waits for an event with these words.
    fn expect(&self, words: &str) {
        self.expect_after(words, || ());
    }

    /// Waits for an event with these words, and acts again and again meanwhile.
    fn expect_after(&self, words: &str, mut act: impl FnMut()) {
        let until = Instant::now() + PATIENCE;
        while !self.text.lock().unwrap().contains(words) {
            assert!(Instant::now() < until, "no {words:?} in\n{}", self.text.lock().unwrap());
            act();
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// `hydraxis` with this group's name.
    fn command(&self, arguments: &[&str]) -> std::process::Command {
        let mut command = hydraxis();
        command.args(arguments).args(["--prefix", &self.running.group.prefix.to_string()]);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    fn pause(&self, kind: StageKind, until: &[&str]) {
        let pid = self.running.pid(kind);
        signal(pid, Signal::STOP);
        until.iter().for_each(|words| self.expect(words));
        signal(pid, Signal::CONT);
    }

    /// A header with a wrong age, about the machine of the group.
    fn header(&self) -> Header {
        let mut commands: Reader<ValveCommand> = self.channels.reader().unwrap();
        let command = await_message(&mut commands, "a command", |_| true);
        let now = monotonic_ns();
        Header { acquired_ns: now, sent_ns: now, ..command.header }
    }

    /// Ends the group, and returns the kinds of the events that were told.
    fn end(self) -> BTreeSet<String> {
        let Self { mut running, text, channels, _cores } = self;
        drop(channels);
        assert!(running.supervisor.try_wait().unwrap().is_none(), "it has ended: {}", text.lock().unwrap());
        signal(running.supervisor.id(), Signal::INT);
        wait_for("the end", || running.supervisor.try_wait().unwrap());
        let text = text.lock().unwrap().clone();
        println!("{text}");
        let kind = |line: &str| {
            let (_, rest) = line.split_once(" s ")?;
            let rest = if rest.starts_with("axis.") { rest.split_once(": ")?.1 } else { rest };
            Some(rest.split_once(": ")?.0.to_owned())
        };
        text.lines().filter_map(kind).collect()
    }
}

/// A machine file of the built-in machine whose bucket follows a program.
fn with_channel(folder: &Path) -> PathBuf {
    let file = folder.join("machine.toml");
    let (before, reference) = BUILT_IN.split_once("[axis.bucket.reference]\n").unwrap();
    let after = reference.split_once("\n[").map_or("", |(_, after)| after);
    std::fs::write(&file, format!("{before}[axis.bucket.reference]\nkind = \"channel\"\n[{after}")).unwrap();
    file
}

/// Sends a request and references that make no sense, until both are refused, and leaves.
fn send_nonsense(group: &Told) {
    let requests = group.channels.publisher::<Request>().unwrap();
    let mut request = Request { session: 1, takes_over: 1, ..Request::default() };
    request.axes[0].mode = AxisMode::Manual as u32;
    request.axes[0].command = 7.0;
    group.expect_after("axis.boom: request: a request was refused", || {
        request.header = group.header();
        requests.send(&request).unwrap();
    });
    let references = group.channels.publisher::<Reference>().unwrap();
    group.expect_after("axis.bucket: reference: the reference stopped", || {
        let mut reference = Reference { header: group.header(), preview: 1, ..Reference::default() };
        reference.positions.iter_mut().for_each(|positions| positions[0] = f64::NAN);
        references.send(&reference).unwrap();
    });
}

#[test]
fn what_happens_to_a_group_is_told_in_every_kind_of_event() {
    let quick = ["timing.model_timeout=300ms", "timing.model_lifetime=1s"].map(|key| ["--set", key]).concat();
    let folder = tempfile::tempdir().unwrap();
    let machine = with_channel(folder.path());
    let arguments = [machine.to_str().unwrap(), "--model", MODEL];
    let mut group = Told::start("events", &[&arguments[..], &quick].concat());
    group.expect("axis.arm: controller: the model controls");
    group.pause(
        StageKind::IdentProc,
        &[
            "axis.arm: model-stale: no new model for timing.model_timeout, 300ms; is ident-proc there?",
            "axis.arm: half-speed: no usable model for timing.model_lifetime, 1s: half speed",
            "axis.arm: controller: the fallback controls",
        ],
    );

    let mut tool = group
        .command(&["operate", "--axis", "boom", "--mode", "manual", "--command", "0.02", "--enable"])
        .spawn()
        .unwrap();
    group.expect("operator: a program operates the group");
    group.expect("axis.boom: mode: manual, after");
    signal(tool.id(), Signal::KILL);
    tool.wait().unwrap();
    group
        .expect("axis.boom: request-stopped: requests stopped while the axis needed them: it is off; operate it again");

    send_nonsense(&group);

    signal(group.running.pid(StageKind::IdentProc), Signal::KILL);
    group.expect("ident-proc killed by SIGKILL; starts again in 0.2 s");
    group.pause(StageKind::SensorProc, &["axis.arm: wait: ", "axis.arm: latch: feedback: ", "reset --prefix"]);
    wait_for("a reset", || group.command(&["reset"]).status().unwrap().success().then_some(()));
    group.expect("axis.arm: release: the latch was released");
    assert!(group.command(&["disarm", "--emergency"]).status().unwrap().success());
    group.expect("axis.arm: latch: emergency-stop: ");

    group.running.pids = [0; 4];
    let kinds = group.end();
    let expected = [
        "controller",
        "half-speed",
        "latch",
        "mode",
        "model-stale",
        "operator",
        "reference",
        "release",
        "request",
        "request-stopped",
        "wait",
    ];
    for kind in expected {
        assert!(kinds.contains(kind), "{kind}: {kinds:?}");
    }
}

#[test]
fn what_is_lost_and_why_no_model_controls_is_told() {
    let keys = ["axis.boom.max_speed=100", "axis.boom.identification.training=400", "timing.period=5ms"];
    let refused = keys.map(|key| ["--set", key]);
    let group = Told::start("events-refused", &[&[FOUR_AXES], &refused.concat()[..]].concat());
    group.expect("axis.boom: model-refused: the model may not control: ");
    // Its channels keep 256 messages, 1.28 s; after 2 s it would be killed.
    let pid = group.running.pid(StageKind::IdentProc);
    signal(pid, Signal::STOP);
    thread::sleep(Duration::from_millis(1600));
    signal(pid, Signal::CONT);
    group.expect("loss: ident-proc has not read ");
    group.end();

    let wrong = ["--set", "axis.telescope.control.smith_kp=0", "--scenario", "nominal"];
    let group = Told::start("events-worse", &[&[MACHINE, "--model", MODEL][..], &wrong].concat());
    group.expect("axis.telescope: model-trial: the model may be worse than the fallback, or swings");
    group.expect("axis.telescope: model-worse: the model followed worse than the fallback, as a trial has shown");
    group.end();
}
