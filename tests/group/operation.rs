//! Groups that are operated: by `hydraxis operate`, and by a commissioning over the channels.

use std::{
    io::{Read, Write},
    process::{Command, Output, Stdio},
    time::Duration,
};

use crate::harness::{
    Cores, FOUR_AXES, TestGroup,
    channel::await_message,
    hydraxis,
    running::{Running, Said},
    shared, signal, succeed, wait_for,
};
use control_proc::commission::{Experiment, ExperimentOptions, ExperimentRecord, Outcome, analyse};
use pipeline::{
    channel::{Group, Reader},
    machine::{Commissioned, Machine},
    message::{
        AxisMode, AxisRequest, CoefficientSnapshot, EncoderSample, Header, Request, ValveCommand, control_flag,
        model_fault,
    },
    stage::{StageKind, monotonic_ns},
};
use plant_sim::PlantSim;
use rustix::process::Signal;
use sensor_proc::Acquisition;

/// A running group whose axes are off, and a program that operates it.
struct Operated {
    running: Running,
    commands: Reader<ValveCommand>,
    // After the readers, and before the cores: others may start their group only when this one is gone.
    channels: Group,
    _cores: Cores,
}

impl Operated {
    /// Starts a group in real time, with a feedback time-out that a busy machine meets.
    fn start(test: &str) -> Self {
        Self::start_with(test, &[])
    }

    /// Starts a group in real time with more arguments.
    fn start_with(test: &str, arguments: &[&str]) -> Self {
        let cores = shared();
        let common = ["--off", "--duration", "10min", "--scenario", "nominal", "--set", "timing.feedback_timeout=5s"];
        let running = Running::spawn(test, &[&common, arguments].concat(), &StageKind::ALL, |_| ());
        let channels = running.group.join();
        let commands = channels.reader().unwrap();
        let mut operated = Self { running, commands, channels, _cores: cores };
        operated.wait_until("its first command", |_| true);
        operated
    }

    fn prefix(&self) -> String {
        self.running.group.prefix.to_string()
    }

    /// Waits for a command for which this holds.
    fn wait_until(&mut self, what: &str, is_it: impl FnMut(&ValveCommand) -> bool) -> ValveCommand {
        await_message(&mut self.commands, what, is_it)
    }

    /// `hydraxis operate` on this group.
    fn operate(&self, arguments: &[&str]) -> Command {
        let mut command = hydraxis();
        command.args(["operate", "--prefix", &self.prefix()]).args(arguments);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn operated(&self, arguments: &[&str]) -> Output {
        self.operate(arguments).output().unwrap()
    }

    /// Ends the group. Returns its report.
    fn end(self) -> String {
        self.end_with_log().stdout
    }

    /// Ends the group. Returns its report and its log.
    fn end_with_log(self) -> Said {
        let Self { mut running, commands, channels, _cores } = self;
        drop((commands, channels));
        running.interrupt()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn is_off(command: &ValveCommand) -> bool {
    command.axes[..4].iter().all(|axis| axis.command == 0.0 && axis.operation == AxisMode::Off as u32)
}

#[test]
fn a_person_moves_one_axis_and_ctrl_c_makes_it_neutral() {
    let mut running = Operated::start("by-hand");
    let refused = running.operated(&["--axis", "boom", "--mode", "manual", "--command", "0.3"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("axis.boom: off (disarmed") && said.contains("allowed: with --enable"), "{said}");
    assert!(running.wait_until("a command", |_| true).axes[0].command == 0.0);

    let arguments = ["--axis", "boom", "--mode", "manual", "--command", "0.3", "--enable"];
    let mut tool = running.operate(&arguments).spawn().unwrap();
    let moving = running.wait_until("the boom to be commanded", |command| command.axes[0].command == 0.3);
    assert_eq!(moving.axes[0].operation, AxisMode::Manual as u32);
    assert!(moving.axes[1..4].iter().all(|axis| axis.command == 0.0), "the others are off");
    // Only one program may operate a group at a time.
    let other = running.operated(&["--mode", "off"]);
    assert_eq!(other.status.code(), Some(1));
    assert!(text(&other.stderr).contains("another program operates group"), "{}", text(&other.stderr));

    signal(tool.id(), Signal::INT);
    running.wait_until("neutral", is_off);
    let status = wait_for("the tool to end", || tool.try_wait().unwrap());
    assert!(status.success(), "{status}");
    let report = running.end();
    assert!(report.contains("boom: off after "), "{report}");
}

#[test]
fn a_program_takes_over_from_one_that_hangs_which_moves_nothing_after_that() {
    let mut running = Operated::start("take-over");
    let arguments = ["--axis", "boom", "--mode", "hold", "--enable"];
    let mut tool = running.operate(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    let before = running.wait_until("the boom to hold", |command| command.axes[0].operation == AxisMode::Hold as u32);
    signal(tool.id(), Signal::STOP);
    let refused = running.operated(&["--axis", "arm", "--mode", "hold", "--enable", "--leave"]);
    assert!(text(&refused.stderr).contains("or take its place with --take-over"), "{}", text(&refused.stderr));
    let taken = running.operated(&["--axis", "arm", "--mode", "hold", "--enable", "--leave", "--take-over"]);
    assert!(taken.status.success(), "{}", text(&taken.stderr));
    let after = running.wait_until("the arm to hold", |command| command.axes[1].operation == AxisMode::Hold as u32);
    assert_ne!(after.operator, before.operator);
    // The one that hung goes on: it asks for the same again, and for off at its end.
    signal(tool.id(), Signal::CONT);
    let status = wait_for("the tool to end", || tool.try_wait().unwrap());
    assert_eq!(status.code(), Some(1));
    let mut said = String::new();
    tool.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("another program has taken over the operation of group"), "{said}");
    let now = running.wait_until("a command", |_| true);
    assert_eq!(now.operator, after.operator);
    assert!(now.axes[..2].iter().all(|axis| axis.operation == AxisMode::Hold as u32), "both hold on");
    // The place is free, and a session that has been silent needs no --take-over.
    let off = running.operated(&["--mode", "off"]);
    assert!(off.status.success(), "{}", text(&off.stderr));
    let said = running.end_with_log().stderr;
    assert!(said.contains("a program has taken over the operation of the group"), "{said}");
}

#[test]
fn an_axis_is_neutral_when_its_operating_program_is_killed() {
    let mut running = Operated::start("killed-hand");
    let arguments = ["--axis", "arm", "--mode", "manual", "--command", "-0.3", "--enable"];
    let mut tool = running.operate(&arguments).spawn().unwrap();
    running.wait_until("the arm to be commanded", |command| command.axes[1].command == -0.3);
    tool.kill().unwrap();
    tool.wait().unwrap();
    let stopped = running.wait_until("neutral", is_off);
    assert_ne!(stopped.axes[1].flags & control_flag::REQUEST_STOPPED, 0);
    // The next program finds the axis off, and may arm it again.
    let again = running.operated(&["--axis", "arm", "--mode", "hold", "--enable", "--leave"]);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert!(text(&again.stdout).contains("axis.arm: hold"), "{}", text(&again.stdout));
    running.end();
}

/// Waits until all axes are off after a signal to the operating program, and prints how long that took, and how far the
/// boom went meanwhile.
fn off_after(running: &mut Operated, tool: u32, how: Signal, what: &str) {
    let mut samples: Reader<EncoderSample> = running.channels.reader().unwrap();
    let from = await_message(&mut samples, "a sample", |_| true).axes[0].position;
    let at = monotonic_ns();
    signal(tool, how);
    let off = running.wait_until("neutral", is_off);
    let took = off.header.sent_ns.saturating_sub(at) / 1_000_000;
    assert!(off.axes[..4].iter().all(|axis| axis.flags & control_flag::REQUEST_STOPPED != 0), "{what}");
    // The valve shuts, and the axis runs out.
    let until = at + 800_000_000;
    let to = await_message(&mut samples, "a later sample", |sample| sample.header.acquired_ns > until).axes[0].position;
    println!("{what}, {how:?}: off after {took} ms, the boom went {:.1} mm", 1e3 * (to - from));
    assert!(took < 1000, "{what}: {took} ms");
}

#[test]
fn what_is_held_to_run_is_off_in_every_mode_when_its_program_dies_or_hangs_and_nothing_arms_it_again() {
    let mut running = Operated::start_with("hold-to-run", &["--set", "axis.bucket.control.hold_to_run=true"]);
    let modes = [("manual", AxisMode::Manual), ("hold", AxisMode::Hold), ("track", AxisMode::Track)];
    for (name, mode) in modes {
        for how in [Signal::KILL, Signal::STOP] {
            let mut arguments = vec!["--mode", name, "--enable", "--hold-to-run"];
            arguments.extend(if mode == AxisMode::Manual { &["--command", "0.3"][..] } else { &[] });
            let mut tool = running.operate(&arguments).spawn().unwrap();
            running.wait_until("the mode", |command| {
                command.axes[..4]
                    .iter()
                    .all(|axis| axis.operation == mode as u32 && axis.flags & control_flag::SETTLING == 0)
            });
            off_after(&mut running, tool.id(), how, name);
            // A program that hung asks for the mode again.
            signal(tool.id(), Signal::CONT);
            wait_for("the program to end", || tool.try_wait().unwrap());
            let refused = running.operated(&["--mode", "hold"]);
            assert_eq!(refused.status.code(), Some(2), "without --enable: {}", text(&refused.stderr));
            assert!(is_off(&running.wait_until("a command", |_| true)), "{name} {how:?}");
        }
    }
    // The key makes it the rule for the bucket: what `arm` leaves behind does not last.
    assert!(running.operated(&["--mode", "hold", "--enable", "--leave"]).status.success());
    let hold = |command: &ValveCommand, axis: usize| command.axes[axis].operation == AxisMode::Hold as u32;
    running.wait_until("all to hold", |command| (0..4).all(|axis| hold(command, axis)));
    let after = running.wait_until("the bucket to be off", |command| {
        command.axes[3].operation == AxisMode::Off as u32 && command.axes[3].command == 0.0
    });
    assert!((0..3).all(|axis| hold(&after, axis)), "the others hold");
    running.end();
}

#[test]
fn an_axis_is_brought_to_a_target_and_left_there() {
    let mut running = Operated::start("hold");
    let hold = ["--axis", "bucket", "--mode", "hold", "--target", "0.6", "--enable", "--leave"];
    let output = running.operated(&hold);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let there = |command: &ValveCommand| command.axes[3].reference == 0.6 && command.axes[3].error.abs() < 0.002;
    running.wait_until("the bucket to arrive", there);
    // An armed axis changes its mode without being armed again.
    let output = running.operated(&["--axis", "bucket", "--mode", "track", "--leave"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    running.wait_until("the bucket to track", |command| command.axes[3].operation == AxisMode::Track as u32);
    let output = running.operated(&["--mode", "off"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    running.wait_until("neutral", is_off);
    running.end();
}

/// A group of the excavator whose axes follow programs.
fn excavator_for_programs(test: &str) -> Operated {
    let settings: Vec<String> = ["boom", "arm", "telescope", "bucket"]
        .iter()
        .flat_map(|axis| ["--set".to_owned(), format!("axis.{axis}.reference.kind=channel")])
        .collect();
    let files = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator");
    let (machine, model) = (format!("{files}.toml"), format!("{files}-model.toml"));
    let mut arguments = vec![machine.as_str(), "--model", &model];
    arguments.extend(settings.iter().map(String::as_str));
    Operated::start_with(test, &arguments)
}

#[test]
fn the_teeth_go_from_place_to_place_as_a_program_writes_them() {
    let mut running = excavator_for_programs("places");
    let start = running.wait_until("the teeth", |command| command.teeth.state != 0).teeth;
    let places = |running: &Operated| {
        let mut tool = running.operate(&["--tip", "-", "--enable", "--leave"]);
        tool.stdin(Stdio::piped()).spawn().unwrap()
    };
    let away = |command: &ValveCommand, x: f64| (command.teeth.x - x).hypot(command.teeth.z - start.z);
    let is_held = |command: &ValveCommand| command.axes[..4].iter().all(|a| a.operation == AxisMode::Hold as u32);

    let mut tool = places(&running);
    let mut input = tool.stdin.take().unwrap();
    writeln!(input, "x,z,pitch,speed\n# there\n{},{}", start.x - 0.2, start.z).unwrap();
    let there = running.wait_until("the teeth at the first place", |command| away(command, start.x - 0.2) < 0.02);
    // They wait there, followed by the axes, until the program says more.
    let until = there.header.sequence + 200;
    let waiting = running.wait_until("two more seconds", |command| command.header.sequence >= until);
    assert!(away(&waiting, start.x - 0.2) < 0.03, "{:?}", waiting.teeth);
    assert!(waiting.axes[..4].iter().all(|axis| axis.operation == AxisMode::Track as u32));
    // Another program that has no place to go to yet has no part in the group, and its end changes nothing.
    let mut other = running.operate(&["--tip", "-", "--enable", "--take-over"]);
    let mut other = other.stdin(Stdio::piped()).spawn().unwrap();
    let until = until + 150;
    running.wait_until("the other program to wait", |command| command.header.sequence >= until);
    other.kill().and_then(|()| other.wait()).unwrap();
    let until = until + 50;
    let still = running.wait_until("half a second", |command| command.header.sequence >= until);
    assert!(still.axes[..4].iter().all(|axis| axis.operation == AxisMode::Track as u32));
    assert_eq!(still.operator, waiting.operator);
    writeln!(input, "{},{},,0.15", start.x, start.z).unwrap();
    drop(input);
    running.wait_until("all axes to hold", is_held);
    let output = tool.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).matches("at the end: ").count(), 2, "{}", text(&output.stdout));
    let end = running.wait_until("a command", |_| true);
    assert!(away(&end, start.x) < 0.03, "{:?}", end.teeth);

    // Without a place nothing changes. A line that is none, and a place out of reach, end the motion.
    for (lines, expected) in [
        ("".to_owned(), "--tip: found no place on standard input"),
        ("5\n".to_owned(), "--tip: line 1 of standard input: found \"5\""),
    ] {
        let mut tool = places(&running);
        tool.stdin.take().unwrap().write_all(lines.as_bytes()).unwrap();
        let output = tool.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{lines}");
        assert!(text(&output.stderr).contains(expected), "{lines}\n{}", text(&output.stderr));
        assert!(is_held(&running.wait_until("a command", |_| true)), "{lines}");
    }
    for (second, expected) in [("here,there", "--tip: line 2 of standard input"), ("20,1", "--tip: found [")] {
        let mut tool = places(&running);
        write!(tool.stdin.take().unwrap(), "{},{}\n{second}\n", start.x - 0.02, start.z).unwrap();
        let output = tool.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{second}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains(expected), "{second}\n{}", text(&output.stderr));
        running.wait_until("the axes to be off", is_off);
    }
    running.end();
}

#[test]
fn the_teeth_go_to_a_place_in_a_straight_line() {
    let mut running = excavator_for_programs("teeth");
    let start = running.wait_until("the teeth", |command| command.teeth.state != 0).teeth;

    let refused = |arguments: &[&str], code, expected: &str| {
        let output = running.operated(arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert!(text(&output.stderr).contains(expected), "{arguments:?}\n{}", text(&output.stderr));
    };
    let near = format!("{},{}", start.x - 0.3, start.z);
    refused(&["--tip", "20,1", "--enable"], 2, "--tip: found [");
    refused(&["--tip", &near], 2, "allowed: with --enable, and then it may move");
    refused(&["--tip", &near, "--axis", "boom", "--enable"], 2, "--tip: found together with --axis");
    assert!(is_off(&running.wait_until("a command", |_| true)));

    let mut tool = running.operate(&["--tip", &near, "--speed", "0.1", "--enable", "--leave"]).spawn().unwrap();
    let (mut off_the_line, mut nearest): (f64, f64) = (0.0, start.x);
    running.wait_until("the teeth at their place", |command| {
        off_the_line = off_the_line.max((command.teeth.z - start.z).abs());
        nearest = nearest.min(command.teeth.x);
        command.axes[..4].iter().all(|axis| axis.operation == AxisMode::Hold as u32)
    });
    let status = wait_for("the tool to end", || tool.try_wait().unwrap());
    assert!(status.success(), "{}", text(&tool.wait_with_output().unwrap().stderr));
    let end = running.wait_until("a command", |_| true).teeth;
    println!("{off_the_line} m off the line, {} and {} m off the place", end.x - (start.x - 0.3), end.z - start.z);
    assert!((end.x - (start.x - 0.3)).hypot(end.z - start.z) < 0.05, "{end:?}");
    assert!(nearest > start.x - 0.4 && off_the_line < 0.1, "{nearest} {off_the_line}");
    // One that dies on its way, or is suspended, ends it: nothing goes on, nor begins again.
    let back = format!("{},{}", start.x, start.z);
    let mut tool = running.operate(&["--tip", &back, "--enable"]).spawn().unwrap();
    running.wait_until("the teeth on their way", |command| command.teeth.x > end.x + 0.05);
    signal(tool.id(), Signal::STOP);
    running.wait_until("the axes to be off", is_off);
    signal(tool.id(), Signal::CONT);
    let status = wait_for("the tool to end", || tool.try_wait().unwrap());
    assert_eq!(status.code(), Some(1));
    assert!(is_off(&running.wait_until("a command", |_| true)));
    let mut tool = running.operate(&["--tip", &back, "--enable"]).spawn().unwrap();
    running.wait_until("the teeth on their way", |command| command.teeth.x > end.x + 0.1);
    tool.kill().unwrap();
    tool.wait().unwrap();
    running.wait_until("the axes to be off", is_off);
    // A time in which the teeth cannot come there.
    let output = running.operated(&["--tip", &near, "--speed", "0.05", "--enable", "--duration", "3s"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("--tip: found the teeth "), "{}", text(&output.stderr));
    running.end();
}

#[test]
fn invalid_requests_are_refused() {
    for (arguments, code, expected) in [
        (
            &["--prefix", "nobody", "--mode", "off"][..],
            1,
            "no group \"nobody\" runs; start one with: hydraxis run MACHINE.toml",
        ),
        (&["--prefix", "x", "--mode", "manual"][..], 2, "--command: found none; allowed: a valve command in [-1, 1]"),
        (&["--prefix", "x", "--mode", "manual", "--command", "NaN"][..], 2, "--command: found \"NaN\""),
        (&["--prefix", "x", "--mode", "manual", "--command", "1.1"][..], 2, "--command: found \"1.1\""),
        (&["--prefix", "x", "--mode", "hold", "--command", "0.1"][..], 2, "found one with --mode hold; allowed: with"),
        (&["--prefix", "x", "--mode", "hold", "--target", "NaN"][..], 2, "--target: found \"NaN\""),
        (&["--prefix", "x", "--mode", "track", "--target", "0.6"][..], 2, "--target: found one with --mode track"),
        (&["--prefix", "x", "--mode", "hold", "--pitch", "5"][..], 2, "--pitch, --speed: found without --tip"),
        (&["--prefix", "x", "--tip", "5"][..], 2, "--tip: found \"5\"; allowed: X,Z in m"),
        (&["--prefix", "x", "--tip", "1e300,0"][..], 2, "--tip: found \"1e300,0\"; allowed: X,Z in m"),
        (&["--prefix", "x", "--tip", "5,0", "--speed", "-1"][..], 2, "--speed: found \"-1\"; allowed: 0.001 to 10 m/s"),
        (&["--prefix", "x", "--tip", "5,0", "--speed", "11"][..], 2, "--speed: found \"11\"; allowed: 0.001 to 10 m/s"),
        (&["--prefix", "x", "--tip", "5,0", "--target", "1"][..], 2, "--tip: found with --target; allowed: without it"),
        (&["--prefix", "x", "--mode", "hold", "--tip", "5,0"][..], 2, "--mode: found with --tip; allowed: without it"),
        (&["--prefix", "x", "--mode", "off", "--leave"][..], 2, "--leave: found with --mode off"),
        (&["--prefix", "x", "--mode", "fly"][..], 2, "--mode: found \"fly\"; allowed: one of off, manual, hold, track"),
    ] {
        let output = hydraxis().arg("operate").args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert!(text(&output.stderr).contains(expected), "{arguments:?}\n{}", text(&output.stderr));
    }
    let output = hydraxis().args(["commission", "--prefix", "x"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--prefix: found \"x\", a running group, without --enable"));
}

/// Expects that a commissioning over the channels finds what one in a single process finds, within bounds.
fn expect_close(live: &Commissioned, single: &Commissioned) {
    println!("over the channels {live:?}\nin one process    {single:?}");
    // The channels add a tick of delay, so the records differ. Both are of the same plant, with the commands at its
    // valve.
    let reaction = |model: &Commissioned| model.dead_time + model.time_constant;
    assert!((reaction(live) - reaction(single)).abs() < 0.002, "{} s", reaction(live) - reaction(single));
    assert!((live.dead_band.extend - single.dead_band.extend).abs() < 0.003);
    assert!((live.dead_band.retract - single.dead_band.retract).abs() < 0.003);
    let tested = live.openings.last().unwrap().min(*single.openings.last().unwrap());
    for (sign, closed) in [(1.0, single.dead_band.extend), (-1.0, single.dead_band.retract)] {
        for part in [0.4, 0.7, 1.0] {
            let command = sign * (closed + part * tested);
            let ratio = live.speed(command) / single.speed(command);
            assert!((ratio - 1.0).abs() < 0.03, "{command}: {ratio}");
        }
    }
    assert!(live.fit_percent > 90.0, "{}", live.fit_percent);
}

/// The experiment in one process, where every command is at the valve without delay.
fn in_one_process(machine: &Machine, axis: usize, options: &ExperimentOptions) -> Commissioned {
    let mut plant = PlantSim::new(machine, 1).unwrap();
    let mut acquisition = Acquisition::new(machine);
    let mut experiment = Experiment::new(&machine.axes[axis], &machine.timing, options);
    let mut command = ValveCommand::default();
    for tick in 0.. {
        let sample = acquisition.update(tick, Some(&plant.read()));
        command.axes[axis].command = experiment.update(Some(&sample.axes[axis]));
        if experiment.outcome().is_some() {
            break;
        }
        plant.command(&command);
        plant.advance(machine.timing.period);
    }
    analyse(experiment.record()).unwrap()
}

/// In lock-step, so that nothing depends on time. The test plays the identifier, for which all stages wait: so the
/// experiment answers every sample before the next one.
#[test]
fn an_axis_is_commissioned_over_the_channels_as_in_one_process() {
    const AXIS: usize = 3;
    let _cores = shared();
    let machine = Machine::four_axes(&[("scenario".to_owned(), "nominal".to_owned())]).unwrap();
    let options = ExperimentOptions { duration: Duration::from_secs(60), ..ExperimentOptions::default() };
    let mut group = TestGroup::new("experiment");
    let channels = group.join();
    let (snapshots, requests) = (channels.publisher::<CoefficientSnapshot>().unwrap(), channels.publisher().unwrap());
    let (mut samples, mut commands) = (channels.reader::<EncoderSample>().unwrap(), channels.reader().unwrap());
    let ticks = 6500;
    let arguments = ["--lockstep", "--scenario", "nominal", "--ticks", &ticks.to_string()];
    group.start_all_but(StageKind::IdentProc, &arguments);

    let mut experiment = Experiment::new(&machine.axes[AXIS], &machine.timing, &options);
    let mut record = ExperimentRecord::new(0.01, 0);
    for tick in 0..ticks {
        let sample: EncoderSample = wait_for("a sample", || {
            snapshots.greet();
            samples.reach(tick).unwrap().then(|| *samples.last().unwrap())
        });
        let sent: ValveCommand = wait_for("a command", || {
            snapshots.greet();
            Reader::<ValveCommand>::reach(&mut commands, tick).unwrap().then(|| *commands.last().unwrap())
        });
        let now = monotonic_ns();
        let machine = sample.header.machine;
        let header =
            Header { sequence: tick, acquired_ns: now, sent_ns: now, axis_count: 4, machine, ..Header::default() };
        let mut request = Request { header, session: 1, ..Request::default() };
        request.axes[AXIS] =
            AxisRequest { mode: AxisMode::Commission as u32, enable: u32::from(tick > 3), ..AxisRequest::default() };
        assert!(sent.axes[..AXIS].iter().all(|axis| axis.command == 0.0), "one axis at a time");
        let axis = sent.axes[AXIS];
        if axis.operation == AxisMode::Commission as u32 && axis.flags & control_flag::SETTLING == 0 {
            if experiment.outcome().is_none() {
                record.positions.push(sample.axes[AXIS].position);
                record.commands.push(axis.command);
            }
            request.axes[AXIS].command = experiment.update(Some(&sample.axes[AXIS]));
        } else {
            assert_eq!(axis.command, 0.0, "nothing moves before it is enabled");
            assert!(tick < 30, "tick {tick}: {axis:?}");
        }
        requests.send(&request).unwrap();
        let mut snapshot = CoefficientSnapshot { header, ..CoefficientSnapshot::default() };
        snapshot.axes.iter_mut().for_each(|axis| axis.faults = model_fault::TRAINING);
        snapshots.send(&snapshot).unwrap();
    }
    group.expect_end();
    assert_eq!(experiment.outcome(), Some(Outcome::Finished));
    assert_eq!(record.commands.len(), 6000);
    expect_close(&analyse(&record).unwrap(), &in_one_process(&machine, AXIS, &options));
}

/// A commissioning by the command itself, on a group in real time.
#[test]
fn a_running_machine_is_commissioned() {
    // Three missing samples in a row end the experiment. With this period a busy computer without a real-time kernel
    // rarely misses three.
    const PERIOD: [&str; 2] = ["--set", "timing.period=20ms"];
    let running = Operated::start_with("commission", &PERIOD);
    let folder = tempfile::tempdir().unwrap();
    let model = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let found = |output: &Output| -> f64 {
        let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let bucket = &figures[0];
        assert!(bucket["fit_percent"].as_f64().unwrap() > 90.0, "{bucket}");
        assert!((bucket["dead_band_extend"].as_f64().unwrap() - 0.1).abs() < 0.015, "{bucket}");
        assert!((bucket["dead_band_retract"].as_f64().unwrap() - 0.1).abs() < 0.015, "{bucket}");
        println!("{bucket}");
        bucket["dead_time_s"].as_f64().unwrap() + bucket["time_constant_s"].as_f64().unwrap()
    };
    let quick = ["commission", FOUR_AXES, "--scenario", "nominal", "--axis", "bucket", "--duration", "40s"];
    let quick = [&quick[..], &PERIOD, &["--json", "-", "--out"]].concat();
    let prefix = running.prefix();
    let live = model("live.toml");
    // The group knows its machine.
    let live = ["commission", "--axis", "bucket", "--duration", "40s", "--json", "-", "--out", &live, "--enable"];
    let live = [&live[..], &["--prefix", &prefix]].concat();
    // Where the computer was too busy for three samples, the experiment has ended for that reason, and is repeated.
    let live = (0..3).find_map(|_| {
        let output = hydraxis().args(&live).output().unwrap();
        let said = text(&output.stderr);
        assert!(output.status.success() || said.contains("off (feedback)"), "{said}");
        output.status.success().then_some(output)
    });
    let live = live.expect("one of three in which no three samples are missing");
    let single = succeed(&[&quick[..], &[&model("single.toml")]].concat());
    // In real time a command waits for the next reading, up to 1 ms, and the jitter of the samples adds to that.
    let more = found(&live) - found(&single);
    assert!(more.abs() < 0.005, "{more} s");
    succeed(&["check", FOUR_AXES, "--model", &model("live.toml")]);
    running.end();
}

#[test]
fn a_commissioning_that_is_stopped_leaves_all_neutral_and_writes_nothing() {
    let mut running = Operated::start("stopped");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.toml");
    let mut commissioning = hydraxis()
        .args(["commission", FOUR_AXES, "--scenario", "nominal", "--prefix", &running.prefix(), "--enable"])
        .args(["--axis", "boom", "--out", file.to_str().unwrap()])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    running.wait_until("a pulse", |command| command.axes[0].command > 0.05);
    signal(commissioning.id(), Signal::INT);
    running.wait_until("neutral", is_off);
    let status = wait_for("the commissioning to end", || commissioning.try_wait().unwrap());
    let mut said = String::new();
    commissioning.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("axis.boom: ended, valve neutral: stopped"), "{said}");
    assert!(!file.exists());
    running.end();
}
