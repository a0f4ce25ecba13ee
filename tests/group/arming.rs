//! `hydraxis arm`, `disarm` and `reset` on a controller whose acquisition is played by the test.

use std::{
    process::{Child, Output, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering},
    },
    thread::{JoinHandle, sleep},
    time::{Duration, Instant},
};

use crate::harness::{Cores, TestGroup, channel::await_message, hydraxis, shared};
use pipeline::{
    channel::{Group, Prefix, Reader},
    message::{AxisCommand, AxisMode, EncoderSample, Header, Request, ValveCommand, control_flag, sample_fault},
    stage::{StageKind, monotonic_ns},
};

/// Time between two samples. Settling needs ten samples without a gap, which a busy computer meets with this period.
const PERIOD: Duration = Duration::from_millis(20);
/// Settings for that period, with a time-out that a busy computer meets. All references hold, since an axis that is
/// driven and does not move would latch.
const MACHINE: [&str; 12] = [
    "--set",
    "timing.period=20ms",
    "--set",
    "timing.feedback_timeout=5s",
    "--set",
    "axis.boom.reference.kind=hold",
    "--set",
    "axis.arm.reference.kind=hold",
    "--set",
    "axis.telescope.reference.kind=hold",
    "--set",
    "axis.bucket.reference.kind=hold",
];

/// What the samples of a played sensor say; the test sets it.
#[derive(Default)]
struct Script {
    faults: [AtomicU32; 4],
    /// The emergency stop.
    is_pressed: AtomicBool,
    /// Ticks without a sample, once a request has come that arms an axis.
    gap: AtomicU64,
    stop: AtomicBool,
}

/// A control-proc that gets samples of axes at rest in the middle.
struct Played {
    script: Arc<Script>,
    sensor: Option<JoinHandle<()>>,
    commands: Reader<ValveCommand>,
    _channels: Group,
    // Dropped after the channels, since the last member removes the files.
    group: TestGroup,
    _cores: Cores,
}

impl Played {
    fn start(test: &str) -> Self {
        let cores = shared();
        let mut group = TestGroup::new(test);
        let channels = group.join();
        let commands = channels.reader().unwrap();
        let script = Arc::<Script>::default();
        let sensor = std::thread::spawn({
            let (prefix, script) = (group.prefix.clone(), Arc::clone(&script));
            move || play_sensor(&prefix, &script)
        });
        group.start(StageKind::ControlProc, &MACHINE);
        let mut played = Self { script, sensor: Some(sensor), commands, _channels: channels, group, _cores: cores };
        played.wait_until("its first command", |_| true);
        played
    }

    fn run(&self, command: &str, arguments: &[&str]) -> Output {
        let mut hydraxis = hydraxis();
        hydraxis.args([command, "--prefix", &self.group.prefix.to_string()]).args(arguments);
        hydraxis.output().unwrap()
    }

    /// Runs a command that has to succeed. Returns its standard output.
    fn succeed(&self, command: &str, arguments: &[&str]) -> String {
        let output = self.run(command, arguments);
        assert!(output.status.success(), "{command} {arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a command that has to fail with exit code 1. Returns its standard error.
    fn fail(&self, command: &str, arguments: &[&str]) -> String {
        let output = self.run(command, arguments);
        assert_eq!(output.status.code(), Some(1), "{command} {arguments:?}");
        assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
        String::from_utf8(output.stderr).unwrap()
    }

    /// Waits for a command for which this holds.
    fn wait_until(&mut self, what: &str, is_it: impl Fn(&ValveCommand) -> bool) -> ValveCommand {
        await_message(&mut self.commands, what, is_it)
    }

    /// All commands that have come since the last call, and one more.
    fn seen(&mut self) -> Vec<ValveCommand> {
        let mut seen = Vec::new();
        while let Some(command) = self.commands.read().unwrap().if_new() {
            seen.push(*command);
        }
        seen.push(self.wait_until("a command", |_| true));
        seen
    }

    /// Present modes of the axes.
    fn modes(&mut self) -> [AxisMode; 4] {
        let last = *self.seen().last().unwrap();
        [0, 1, 2, 3].map(|axis: usize| AxisMode::from_number(last.axes[axis].operation).unwrap())
    }

    fn set_fault(&self, axis: usize, fault: u32) {
        self.script.faults[axis].store(fault, Ordering::Relaxed);
    }

    fn latch(&mut self, axis: usize) {
        self.set_fault(axis, sample_fault::RANGE);
        self.wait_until("the latch", |command| command.axes[axis].flags & control_flag::FEEDBACK != 0);
        self.set_fault(axis, 0);
    }

    /// The first axis is armed by a program that is killed before it has settled, and has stale samples from then on.
    fn leave_settling(&mut self) {
        self.seen();
        let mut arm = self.spawn_arm(&["--axis", "boom"]);
        self.wait_until("an axis that settles", |command| command.axes[0].flags & control_flag::SETTLING != 0);
        self.set_fault(0, sample_fault::STALE);
        arm.kill().unwrap();
        arm.wait().unwrap();
    }

    fn spawn_arm(&self, axes: &[&str]) -> Child {
        let mut arm = hydraxis();
        arm.arg("arm").args(axes).args(["--prefix", &self.group.prefix.to_string()]);
        arm.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }
}

impl Drop for Played {
    fn drop(&mut self) {
        self.script.stop.store(true, Ordering::Relaxed);
        if let Some(sensor) = self.sensor.take() {
            let _ = sensor.join();
        }
    }
}

fn play_sensor(prefix: &Prefix, script: &Script) {
    let channels = Group::join(prefix, "sensor").unwrap();
    let mut requests: Reader<Request> = channels.reader().unwrap();
    let samples = channels.publisher::<EncoderSample>().unwrap();
    let notifier = channels.notifier::<EncoderSample>().unwrap();
    let mut sequence = 0;
    while !script.stop.load(Ordering::Relaxed) {
        let now = monotonic_ns();
        let header = Header { sequence, acquired_ns: now, sent_ns: now, axis_count: 4, ..Header::default() };
        let emergency_stop = u32::from(script.is_pressed.load(Ordering::Relaxed));
        let mut sample = EncoderSample { header, emergency_stop, ..EncoderSample::default() };
        for (axis, fault) in sample.axes.iter_mut().zip(&script.faults) {
            (axis.position, axis.faults) = (0.65, fault.load(Ordering::Relaxed));
        }
        samples.send(&sample).unwrap();
        notifier.notify().unwrap();
        sequence += 1;
        sleep(PERIOD);
        while let Some(request) = requests.read().unwrap().if_new() {
            if request.axes.iter().any(|axis| axis.enable != 0) {
                sequence += script.gap.swap(0, Ordering::Relaxed);
            }
        }
    }
}

use AxisMode::{Hold, Off, Track};

#[test]
fn arm_waits_for_an_axis_that_another_has_armed_and_that_does_not_settle() {
    let mut played = Played::start("arm-settling");
    played.leave_settling();
    std::thread::scope(|scope| {
        let script = Arc::clone(&played.script);
        scope.spawn(move || {
            sleep(Duration::from_secs(1));
            script.faults[0].store(0, Ordering::Relaxed);
        });
        let begin = Instant::now();
        let said = played.succeed("arm", &["--axis", "boom"]);
        assert!(begin.elapsed() > Duration::from_secs(1) && said == "axis.boom: track\n", "{said}");
    });
    // While it stands.
    played.succeed("disarm", &["--axis", "boom"]);
    played.leave_settling();
    let said = played.fail("arm", &["--axis", "boom"]);
    assert!(said.contains("axis.boom: its samples are stale") || said.contains("(feedback"), "{said}");
    played.wait_until("a latch", |command| command.axes[0].flags & control_flag::FEEDBACK != 0);
    played.set_fault(0, 0);
    played.succeed("reset", &[]);
    assert_eq!(played.succeed("arm", &["--axis", "boom"]), "axis.boom: track\n");
}

#[test]
fn arm_arms_nothing_while_a_fault_stands_and_all_axes_together_once_it_is_over() {
    let mut played = Played::start("arm-faulty");
    played.set_fault(0, sample_fault::ENCODER);
    let mut killed = played.spawn_arm(&[]);
    sleep(Duration::from_secs(1));
    killed.kill().unwrap();
    killed.wait().unwrap();
    played.set_fault(0, 0);
    sleep(Duration::from_secs(1));
    let is_off = |command: &AxisCommand| command.flags & control_flag::DISARMED != 0;
    assert!(played.seen().iter().all(|command| command.axes[..4].iter().all(is_off)));

    played.set_fault(0, sample_fault::ENCODER);
    let mut arm = played.spawn_arm(&[]);
    sleep(Duration::from_secs(1));
    assert!(played.seen().iter().all(|command| command.axes[..4].iter().all(is_off)));
    played.set_fault(0, 0);
    assert!(arm.wait().unwrap().success());
    assert_eq!(played.modes(), [Track; 4]);
}

#[test]
fn arm_enables_what_is_off_and_leaves_it_so_and_disarm_ends_it() {
    let mut played = Played::start("arm");
    assert_eq!(played.modes(), [Off; 4]);
    assert_eq!(played.succeed("arm", &["--axis", "boom", "--axis", "arm"]), "axis.boom: track\naxis.arm: track\n");
    // Longer than the time-out of requests in the direct modes.
    sleep(Duration::from_millis(300));
    assert_eq!(played.modes(), [Track, Track, Off, Off]);
    // Arming an armed axis is no fault and changes nothing.
    assert_eq!(played.succeed("arm", &["--axis", "boom"]), "axis.boom: track\n");
    assert!(played.seen().iter().all(|command| command.axes[0].operation == Track as u32));

    let said = played.fail("arm", &["--mode", "hold"]);
    assert!(said.contains("axis.boom: track") && said.contains("; allowed: off, or hold already"), "{said}");
    let typed = format!("hydraxis operate --prefix {} --axis boom --mode hold --leave", played.group.prefix);
    assert!(said.contains(&typed), "{said}");
    assert_eq!(played.modes(), [Track, Track, Off, Off], "all or none");

    assert_eq!(played.succeed("arm", &["--mode", "hold", "--axis", "bucket"]), "axis.bucket: hold\n");
    assert_eq!(played.modes(), [Track, Track, Off, Hold]);
    assert_eq!(played.succeed("disarm", &["--axis", "boom"]), "axis.boom: off (disarmed)\n");
    assert_eq!(played.modes(), [Off, Track, Off, Hold]);
    played.succeed("disarm", &[]);
    let off = *played.seen().last().unwrap();
    assert!(off.axes[..4].iter().all(|axis| axis.command == 0.0 && axis.operation == Off as u32));
}

#[test]
fn a_request_that_comes_too_late_is_asked_for_again() {
    let mut played = Played::start("arm-late");
    // The controller refuses a message that is older than 100 ms, five samples: the edge that arms is lost with it.
    played.script.gap.store(100, Ordering::Relaxed);
    assert_eq!(played.succeed("arm", &["--mode", "hold", "--axis", "boom"]), "axis.boom: hold\n");
    assert_eq!(played.script.gap.load(Ordering::Relaxed), 0, "no request has been too late");
    assert_eq!(played.modes(), [Hold, Off, Off, Off]);
}

#[test]
fn reset_names_and_releases_what_is_latched_and_touches_nothing_else() {
    let mut played = Played::start("reset");
    let prefix = played.group.prefix.to_string();
    played.succeed("arm", &["--axis", "boom", "--axis", "arm"]);
    played.latch(0);

    let said = played.fail("arm", &[]);
    assert!(said.contains("axis.boom: off (feedback)"), "{said}");
    assert!(said.contains(&format!("type: hydraxis reset --prefix {prefix} --axis boom\n")), "{said}");
    let said = played.succeed("disarm", &["--axis", "boom"]);
    assert_eq!(said, format!("axis.boom: off (feedback)\nnext: hydraxis reset --prefix {prefix} --axis boom\n"));
    assert_eq!(played.modes(), [Off, Track, Off, Off]);

    let said = played.succeed("reset", &[]);
    assert!(said.starts_with("axis.boom: off (disarmed): was latched by feedback\naxis.arm: track"), "{said}");
    assert!(said.contains("axis.telescope: off (disarmed): not latched\n"), "{said}");
    assert!(said.ends_with(&format!("next: hydraxis arm --prefix {prefix} --axis boom\n")), "{said}");
    let seen = played.seen();
    assert!(seen.iter().all(|command| command.axes[1].operation == Track as u32), "the arm goes on");
    let boom = seen.last().unwrap().axes[0];
    assert_eq!((boom.operation, boom.flags & control_flag::LATCHED), (Off as u32, 0), "released, not armed");

    let said = played.succeed("reset", &["--axis", "boom"]);
    assert_eq!(said, "axis.boom: off (disarmed): not latched\n");
    assert_eq!(played.succeed("arm", &["--axis", "boom"]), "axis.boom: track\n");
}

/// It says so at once, and does not wait for an answer that cannot come.
#[test]
fn reset_under_a_pressed_stop_is_refused_at_once_and_works_when_the_stop_is_released() {
    let mut played = Played::start("reset-pressed");
    played.succeed("arm", &["--axis", "boom"]);
    played.script.is_pressed.store(true, Ordering::Relaxed);
    played.wait_until("the latch", |command| command.axes[0].flags & control_flag::EMERGENCY_STOP != 0);
    let began = Instant::now();
    let said = played.fail("reset", &[]);
    let took = began.elapsed();
    assert!(said.contains("the emergency stop is pressed, so its latch cannot be released"), "{said}");
    assert!(took < Duration::from_millis(2500), "{took:?}; a controller without an answer is given 5 s");
    let is_latched = |command: &ValveCommand| {
        command.cut_off == 1
            && command.axes[..4]
                .iter()
                .all(|axis| axis.flags & control_flag::EMERGENCY_STOP != 0 && axis.command == 0.0)
    };
    assert!(played.seen().iter().all(is_latched));
    played.script.is_pressed.store(false, Ordering::Relaxed);
    sleep(5 * PERIOD);
    assert!(played.seen().last().is_some_and(is_latched), "the end of the press releases nothing");
    let said = played.succeed("reset", &[]);
    assert!(said.starts_with("axis.boom: off (disarmed): was latched by emergency-stop\n"), "{said}");
    // A busy computer may slow the axis down meanwhile, which is said as well.
    assert!(played.succeed("arm", &["--axis", "boom"]).starts_with("axis.boom: track"));
}

#[test]
fn an_axis_without_pilot_pressure_is_told_which_latched_axes_cut_it_off() {
    let mut played = Played::start("arm-cut-off");
    played.succeed("arm", &[]);
    played.succeed("disarm", &["--emergency"]);
    played.wait_until("the latch", |command| command.axes[1].flags & control_flag::EMERGENCY_STOP != 0);
    played.succeed("reset", &["--axis", "boom", "--axis", "telescope", "--axis", "bucket"]);
    let expected = format!(
        "axis.arm: off (emergency-stop): cuts the pilot pressure of all axes off\nlook at why, then type: hydraxis \
         reset --prefix {} --axis arm\n",
        played.group.prefix
    );
    let said = played.fail("arm", &["--axis", "boom"]);
    assert!(said.ends_with(&expected), "{said}");
    let output = played.run("operate", &["--axis", "boom", "--mode", "hold", "--enable"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.ends_with(&expected), "{said}");
}

#[test]
fn operate_shows_what_had_latched_an_axis_that_it_enables_or_switches_off() {
    let mut played = Played::start("operate-latched");
    let hold = ["--axis", "boom", "--mode", "hold", "--leave"];
    played.succeed("arm", &["--axis", "boom"]);
    played.latch(0);
    let output = played.run("operate", &hold);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("axis.boom: off (feedback); allowed: with --enable"), "{said}");
    assert!(said.contains(&format!("type: hydraxis reset --prefix {} --axis boom", played.group.prefix)), "{said}");

    let said = played.succeed("operate", &[&hold[..], &["--enable"]].concat());
    assert_eq!(said, "axis.boom: off (disarmed): was latched by feedback\naxis.boom: hold\n");
    assert_eq!(played.modes(), [Hold, Off, Off, Off]);
    played.latch(0);
    let said = played.succeed("operate", &["--axis", "boom", "--mode", "off"]);
    assert!(said.starts_with("axis.boom: off (disarmed): was latched by feedback\n"), "{said}");
    let said = played.succeed("operate", &[&hold[..], &["--enable"]].concat());
    assert_eq!(said, "axis.boom: hold\n", "nothing was latched");
}

#[test]
fn a_fault_on_the_way_ends_the_arming_of_all_and_stays_latched() {
    let mut played = Played::start("arm-fault");
    let arm = played.spawn_arm(&[]);
    played.wait_until("an axis that settles", |command| command.axes[2].flags & control_flag::SETTLING != 0);
    played.set_fault(2, sample_fault::RANGE);
    let output = arm.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("axis.telescope: off (feedback): not track, a fault has latched it"), "{said}");
    assert!(said.contains("look at why, then type: hydraxis reset --prefix"), "{said}");
    assert_eq!(played.modes(), [Off; 4]);
    let last = *played.seen().last().unwrap();
    assert_ne!(last.axes[2].flags & control_flag::FEEDBACK, 0);
}

#[test]
fn without_a_group_or_with_another_axis_nothing_is_asked() {
    // Without --prefix, `arm` and `reset` would take the group of a test beside this one.
    let nobody = "no group \"nobody\" runs; start one with: hydraxis run MACHINE.toml --prefix nobody";
    for (arguments, code, expected) in [
        (&["arm", "--prefix", "nobody"][..], 1, nobody),
        (&["reset", "--prefix", "nobody"], 1, nobody),
        (&["disarm", "--prefix", "nobody"], 1, nobody),
        (&["disarm", "--axis", "boom"], 2, "--prefix: found nothing, and another option here needs it"),
    ] {
        let output = hydraxis().args(arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{said}");
        assert!(said.contains(expected), "{arguments:?}\n{said}");
    }
    let played = Played::start("unknown-axis");
    for command in ["arm", "disarm", "reset"] {
        let output = played.run(command, &["--axis", "blade"]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{command}\n{said}");
        assert!(said.contains("--axis: found \"blade\"; allowed: one of boom, arm, telescope, bucket"), "{said}");
    }
}
