//! Stops: what has to work while everything else hangs, is full or is gone.

use std::{
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Board, Group, Reader},
    message::{AxisCommand, StageHealth, StageState, ValveCommand, control_flag},
    stage::StageKind,
};
use rustix::process::Signal;

use crate::harness::{
    FOUR_AXES, TestGroup,
    channel::await_message,
    hydraxis,
    running::{Running, text},
    shared, signal, wait_for,
};

/// A time that a busy computer meets, and far below what a person would call late.
const SOON: Duration = Duration::from_millis(500);

fn is_disarmed(axis: &AxisCommand) -> bool {
    axis.flags & control_flag::DISARMED != 0 && axis.command == 0.0
}

fn all(command: &ValveCommand, is_it: impl Fn(&AxisCommand) -> bool) -> bool {
    command.axes[..4].iter().all(is_it)
}

/// A running group whose axes track, and its commands.
struct Tracking {
    commands: Reader<ValveCommand>,
    _channels: Group,
    running: Running,
}

impl Tracking {
    /// Starts a group with a feedback time-out that a busy machine meets.
    fn start(test: &str) -> Self {
        let running = Running::start_with(test, &["--duration", "120s", "--set", "timing.feedback_timeout=1s"]);
        let channels = running.group.join();
        let mut tracking = Self { commands: channels.reader().unwrap(), _channels: channels, running };
        tracking.wait_until("motion", |command| all(command, |axis| axis.operation == 4));
        tracking
    }

    fn prefix(&self) -> String {
        self.running.group.prefix.to_string()
    }

    fn wait_until(&mut self, what: &str, is_it: impl Fn(&ValveCommand) -> bool) -> ValveCommand {
        await_message(&mut self.commands, what, is_it)
    }

    /// The next command; those that have come before count as read.
    fn next(&mut self) -> ValveCommand {
        while self.commands.read().unwrap().if_new().is_some() {}
        self.wait_until("a command", |_| true)
    }

    /// Runs a command that has to succeed. Returns what it prints, and how long it took.
    fn succeed(&self, arguments: &[&str]) -> (String, Duration) {
        let started = Instant::now();
        let output = hydraxis().args(arguments).args(["--prefix", &self.prefix()]).output().unwrap();
        let took = started.elapsed();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        (String::from_utf8(output.stdout).unwrap(), took)
    }

    /// Starts `operate`, and waits until all axes hold.
    fn hold(&mut self) -> Child {
        let mut operator = hydraxis();
        operator.args(["operate", "--prefix", &self.prefix(), "--mode", "hold"]);
        let operator = operator.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        self.wait_until("hold", |command| all(command, |axis| axis.operation == 3));
        operator
    }

    fn end(self) {
        let Self { mut running, commands, _channels } = self;
        drop((commands, _channels));
        running.interrupt();
    }
}

/// A stopped operator keeps its place on the channel of requests, and its session.
#[test]
fn a_stop_works_while_an_operator_hangs() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-hung");
    let mut operator = tracking.hold();
    signal(operator.id(), Signal::STOP);
    let (said, took) = tracking.succeed(&["disarm"]);
    println!("disarm while an operator hangs: {took:?}");
    assert!(said.contains("axis.boom: off (disarmed)"), "{said}");
    assert!(took < SOON, "{took:?}");
    tracking.wait_until("neutral", |command| all(command, is_disarmed));
    // It goes on with its requests, which do not arm the axes again.
    signal(operator.id(), Signal::CONT);
    let status = wait_for("the operator to end", || operator.try_wait().unwrap());
    assert_eq!(status.code(), Some(1));
    let last = tracking.wait_until("a command", |_| true);
    assert!(all(&last, is_disarmed));
    tracking.end();
}

/// An operator that ends because of an emergency stop acknowledges nothing.
#[test]
fn the_end_of_an_operator_releases_no_emergency_stop() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-end");
    let mut operator = tracking.hold();
    tracking.succeed(&["disarm", "--emergency"]);
    let status = wait_for("the operator to end", || operator.try_wait().unwrap());
    assert_eq!(status.code(), Some(1));
    let said = text(operator.stdout.take());
    assert!(said.contains("axis.boom: off (emergency-stop)"), "{said}");
    for _ in 0..5 {
        let command = tracking.next();
        assert_eq!(command.cut_off, 1);
        assert!(all(&command, |axis| axis.flags & control_flag::EMERGENCY_STOP != 0), "{:?}", command.axes[0]);
    }
    tracking.succeed(&["reset"]);
    tracking.wait_until("the release", |command| command.cut_off == 0 && all(command, is_disarmed));
    tracking.end();
}

/// A person typed `arm` before the stop, and the program was suspended meanwhile.
#[test]
fn an_arm_that_was_typed_before_a_stop_and_suspended_arms_nothing_after_it() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-arm");
    let prefix = tracking.prefix();
    tracking.succeed(&["disarm"]);
    let mut suspended = 0;
    for _ in 0..4 {
        let taken = tracking.next().axes[0].taken_requests;
        let mut arm = hydraxis();
        arm.args(["arm", "--prefix", &prefix]).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut arm = arm.spawn().unwrap();
        // Its first request asks for nothing; the ones that arm come after it.
        tracking.wait_until("a request", |command| command.axes[0].taken_requests > taken);
        signal(arm.id(), Signal::STOP);
        tracking.succeed(&["disarm"]);
        // So many samples that the suspended program has lost those from before the stop.
        let until = tracking.next().header.sequence + 270;
        tracking.wait_until("later samples", |command| command.header.sequence > until);
        signal(arm.id(), Signal::CONT);
        let status = wait_for("arm to end", || arm.try_wait().unwrap());
        let said = text(arm.stderr.take());
        assert_eq!(status.code(), Some(1), "{said}");
        suspended += u32::from(said.contains("a stop was asked for after this command was typed"));
        assert!(all(&tracking.next(), is_disarmed), "{said}");
    }
    println!("{suspended} of 4 were suspended before they armed");
    tracking.succeed(&["arm"]);
    tracking.end();
}

#[test]
fn a_stop_works_when_all_places_on_the_channels_are_taken() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-places");
    let channels = tracking.running.group.join();
    let readers: Vec<Reader<ValveCommand>> = std::iter::from_fn(|| channels.reader().ok()).collect();
    assert!(readers.len() > 5, "{}", readers.len());
    let output = hydraxis().args(["arm", "--prefix", &tracking.prefix()]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "no place is left");
    let (said, took) = tracking.succeed(&["disarm", "--axis", "arm", "--axis", "bucket"]);
    assert_eq!(said, "axis.arm: off (disarmed)\naxis.bucket: off (disarmed)\n");
    assert!(took < SOON, "{took:?}");
    let command = tracking.wait_until("neutral", |command| is_disarmed(&command.axes[1]));
    assert!(is_disarmed(&command.axes[3]) && !is_disarmed(&command.axes[0]), "only the named axes");
    drop((readers, channels));
    tracking.end();
}

#[test]
fn an_emergency_stop_latches_also_a_controller_that_is_started_again_until_a_person_resets_it() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-emergency");
    let (said, took) = tracking.succeed(&["disarm", "--emergency"]);
    assert!(said.contains("axis.boom: off (emergency-stop)") && said.contains("next: hydraxis reset"), "{said}");
    assert!(took < SOON, "{took:?}");
    let is_cut_off = |command: &ValveCommand| command.cut_off == 1 && all(command, |axis| axis.command == 0.0);
    tracking.wait_until("the cut-off", is_cut_off);
    let before = tracking.running.pids[StageKind::ControlProc as usize];
    signal(before, Signal::KILL);
    let mut health: Reader<StageHealth> = tracking._channels.reader().unwrap();
    await_message(&mut health, "another controller", |health| {
        health.stage == StageKind::ControlProc as u32
            && health.pid != before
            && health.state == StageState::Running as u32
    });
    let command = tracking.next();
    assert!(is_cut_off(&command) && all(&command, |axis| axis.flags & control_flag::EMERGENCY_STOP != 0));
    tracking.succeed(&["reset"]);
    tracking.wait_until("the release", |command| command.cut_off == 0 && all(command, is_disarmed));
    tracking.end();
}

#[test]
fn a_signal_to_the_controller_disarms() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-signal");
    for pid in tracking.running.pids {
        signal(pid, Signal::USR2);
    }
    tracking.wait_until("neutral", |command| all(command, is_disarmed));
    tracking.end();
}

/// Ctrl-Z stops the supervisor, and with it the motion.
#[test]
fn a_suspended_supervisor_leaves_no_axis_armed() {
    let _cores = shared();
    let mut tracking = Tracking::start("stop-suspended");
    let supervisor = tracking.running.supervisor.id();
    signal(supervisor, Signal::TSTP);
    tracking.wait_until("neutral", |command| all(command, is_disarmed));
    wait_for("the supervisor to be suspended", || {
        let stat = std::fs::read_to_string(format!("/proc/{supervisor}/stat")).unwrap();
        stat.rsplit(')').next().unwrap().trim_start().starts_with('T').then_some(())
    });
    signal(supervisor, Signal::CONT);
    tracking.succeed(&["arm"]);
    tracking.wait_until("motion again", |command| all(command, |axis| axis.operation == 4));
    tracking.end();
}

/// With the axes in another order, a program would move another axis than the one it names.
#[test]
fn a_program_or_stage_of_another_machine_is_refused() {
    let _cores = shared();
    let mut group = TestGroup::new("stop-machine");
    group.start(StageKind::ControlProc, &[]);
    let board = wait_for("the board", || Board::find(&group.prefix).unwrap());
    assert_eq!(board.machine().names().collect::<Vec<_>>(), ["boom", "arm", "telescope", "bucket"]);
    let folder = tempfile::tempdir().unwrap();
    let (other, prefix) = (folder.path().join("other.toml"), group.prefix.to_string());
    std::fs::write(&other, pipeline::machine::FOUR_AXES.replace("[axis.arm", "[axis.stick")).unwrap();
    let other = other.to_str().unwrap();
    let commands: [&[&str]; 3] = [&["sensor-proc"], &["control-proc"], &["commission", "--enable"]];
    for arguments in commands {
        let output = hydraxis().args(arguments).args([other, "--prefix", &prefix]).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{arguments:?}");
        let both = "axes boom, arm, telescope, bucket, where this program has axes boom, stick, telescope, bucket";
        assert!(said.contains(both), "{arguments:?}: {said}");
    }
    let slower = ["--set", "axis.boom.control.kp=0.1"];
    let output = hydraxis().args(["ident-proc", "--prefix", &prefix]).args(slower).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("runs another machine: settings"), "{said}");
}

/// Without a name every group of this user is stopped. In a place of its own, so that no other group is.
#[test]
fn without_a_name_all_groups_are_stopped() {
    let _cores = shared();
    let groups = tempfile::tempdir().unwrap();
    let script = format!(
        "mount -t tmpfs tmpfs /dev/shm || exit 77; H={}
        $H disarm; echo none: $?
        run() {{ exec $H run {FOUR_AXES} --prefix $1 --duration 60s --set timing.feedback_timeout=2s; }}
        run a & run b &
        started() {{ for i in $(seq 200); do $H status --prefix $1 > /dev/null && break; sleep 0.1; done; }}
        started a; started b
        $H disarm; echo two: $?
        kill -INT %1 %2; wait",
        env!("CARGO_BIN_EXE_hydraxis")
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "bash", "-c", &script])
        .env("TMPDIR", groups.path())
        .current_dir(folder)
        .output();
    let Some(output) = output.ok().filter(|output| output.status.code() != Some(77)) else {
        return println!("skipped: this computer allows no mount namespaces");
    };
    let (said, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if errors.contains("unshare:") {
        return println!("skipped: {errors}");
    }
    assert!(said.contains("none: 1") && errors.contains("no group of this user runs"), "{said}\n{errors}");
    for group in ["a", "b"] {
        assert!(said.contains(&format!("group \"{group}\"\naxis.boom: off (disarmed)")), "{said}\n{errors}");
    }
    assert!(said.contains("two: 0"), "{said}\n{errors}");
}

#[test]
fn figures_of_an_interrupted_run_are_kept_when_the_reader_of_its_pipe_has_ended() {
    let _cores = shared();
    let mut running = Running::start_with("stop-pipe", &["--duration", "120s"]);
    // Ctrl-C ends `cat` in `hydraxis run | cat` as well.
    drop(running.supervisor.stdout.take());
    let said = running.interrupt();
    assert!(said.stderr.contains("Tracking error, mm") && said.stderr.contains(" control-proc "), "{}", said.stderr);
    assert!(!said.stderr.contains("panicked") && !said.stderr.contains('\x1b'), "{}", said.stderr);
}
