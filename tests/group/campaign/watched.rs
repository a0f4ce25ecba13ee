//! A running group, the stops that it was asked for, and the rules that hold after a stop.

use std::{
    process::{Child, Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

use pipeline::{
    MAX_AXES,
    channel::{Board, Group, Reader},
    message::{AxisCommand, AxisMode, StageHealth, StageState, ValveCommand, control_flag},
    stage::{StageKind, monotonic_ns},
};

use rustix::process::Signal;

use crate::harness::{
    PATIENCE, hydraxis, is_running,
    running::{Running, text},
    signal, wait_for,
};

pub const AXES: usize = 4;
pub const NAMES: [&str; AXES] = ["boom", "arm", "telescope", "bucket"];
/// Flags of an axis that a fault, a person or its start keeps at neutral.
const OFF: u32 = control_flag::DISARMED | control_flag::LATCHED;

/// What the commands of an axis must be from now on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kept {
    Free,
    /// Neutral, disarmed or latched.
    Off,
    /// Neutral, and latched by an emergency stop with the pilot cut off.
    Emergency,
}

/// A stop that was asked for.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    pub axes: [bool; AXES],
    pub is_emergency: bool,
    pub at_ns: u64,
}

/// A group, its commands and the pids of its stages.
pub struct Watched {
    commands: Reader<ValveCommand>,
    health: Reader<StageHealth>,
    pub board: Board,
    pub channels: Group,
    pub running: Running,
    last: Option<ValveCommand>,
    kept: [Kept; AXES],
    asked: Option<Asked>,
    /// When the last stop was asked for.
    asked_ns: u64,
    /// When the first command was sent that does what was asked.
    answered_ns: Option<u64>,
    /// The counters on the board before the stop, and when they were first seen to be raised.
    counters: [u32; MAX_AXES + 1],
    raised_ns: Option<u64>,
    /// The present step, for a message about a rule that is broken.
    pub step: String,
}

impl Watched {
    pub fn start(test: &str) -> Self {
        // With this time-out a busy computer latches nothing by itself.
        let arguments = ["--duration", "6h", "--set", "timing.feedback_timeout=5s"];
        let running = Running::start_with(test, &arguments);
        let channels = running.group.join();
        Self {
            commands: channels.reader().unwrap(),
            health: channels.reader().unwrap(),
            board: Board::find(&running.group.prefix).unwrap().unwrap(),
            channels,
            running,
            last: None,
            kept: [Kept::Free; AXES],
            asked: None,
            asked_ns: 0,
            answered_ns: None,
            counters: [0; MAX_AXES + 1],
            raised_ns: None,
            step: String::new(),
        }
    }

    pub fn prefix(&self) -> String {
        self.running.group.prefix.to_string()
    }

    /// Reads all that has come and checks it.
    pub fn poll(&mut self) {
        if self.raised_ns.is_none() && self.board.asked() != self.counters {
            self.raised_ns = Some(monotonic_ns());
        }
        while let Some(health) = self.health.read().unwrap().if_new() {
            if health.state != StageState::Stopped as u32 {
                self.running.pids[health.stage as usize] = health.pid;
            }
        }
        while let Some(command) = self.commands.read().unwrap().if_new().copied() {
            self.take(&command);
        }
    }

    fn take(&mut self, command: &ValveCommand) {
        if let Some(asked) = self.asked.filter(|asked| command.header.sent_ns > asked.at_ns) {
            let wanted = if asked.is_emergency { Kept::Emergency } else { Kept::Off };
            let axes = || (0..AXES).filter(|axis| asked.axes[*axis]);
            if axes().all(|axis| is_kept(command, axis, wanted)) {
                for axis in axes() {
                    let kept = &mut self.kept[axis];
                    *kept = if *kept == Kept::Emergency { Kept::Emergency } else { wanted };
                }
                (self.asked, self.answered_ns) = (None, Some(command.header.sent_ns));
            }
        }
        for (axis, name) in NAMES.iter().enumerate().take(AXES) {
            let (kept, found) = (self.kept[axis], command.axes[axis]);
            assert!(
                is_kept(command, axis, kept),
                "{}: {name} is no longer {kept:?}: command {}, operation {}, flags {:#x}, cut off {}, tick {}",
                self.step,
                found.command,
                found.operation,
                found.flags,
                command.cut_off,
                command.header.sequence
            );
        }
        self.last = Some(*command);
    }

    fn axis(&self, axis: usize) -> Option<&AxisCommand> {
        self.last.as_ref().map(|command| &command.axes[axis])
    }

    /// The axes that may move.
    pub fn armed(&self) -> Vec<usize> {
        let is_armed = |axis: &usize| self.axis(*axis).is_some_and(|axis| axis.flags & OFF == 0 && axis.operation != 1);
        (0..AXES).filter(is_armed).collect()
    }

    pub fn are_in(&self, axes: &[usize], mode: AxisMode) -> bool {
        axes.iter().all(|axis| self.axis(*axis).is_some_and(|axis| axis.operation == mode as u32))
    }

    /// Ends the test with all that is known of the group.
    pub fn fail(&mut self, why: &str) -> ! {
        let axes: String = (0..AXES)
            .filter_map(|axis| self.axis(axis))
            .map(|axis| format!("operation {}, flags {:#x}; ", axis.operation, axis.flags))
            .collect();
        let last = self.last.map_or(0, |last| last.header.sent_ns);
        let silent = monotonic_ns().saturating_sub(last) / 1_000_000;
        let alive: Vec<bool> = self.running.pids.iter().map(|pid| is_running(*pid)).collect();
        signal(self.running.supervisor.id(), Signal::INT);
        let said = text(self.running.supervisor.stderr.take());
        panic!(
            "{}: {why}\n{axes}\nlast command {silent} ms ago; stages that run: {alive:?}; asked {:?}, answered {:?}\n\
             {said}",
            self.step, self.asked, self.answered_ns
        )
    }

    /// Reads all channels for a time.
    pub fn look_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.poll();
            std::thread::sleep(Duration::from_micros(300));
        }
    }

    /// Reads all channels until this holds; false where it does not within [`PATIENCE`].
    pub fn look_until(&mut self, mut is_it: impl FnMut(&mut Self) -> bool) -> bool {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            self.poll();
            if is_it(self) {
                return true;
            }
            std::thread::sleep(Duration::from_micros(300));
        }
        false
    }

    /// Another command about this group.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = hydraxis();
        command.args(arguments).args(["--prefix", &self.prefix()]).stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    /// Starts another command about this group.
    pub fn client(&self, arguments: &[&str]) -> Child {
        self.command(arguments).spawn().unwrap()
    }

    /// Reads all channels until another command has ended.
    pub fn finish(&mut self, client: &mut Child) -> ExitStatus {
        let mut status = None;
        let is_over = self.look_until(|_| {
            status = client.try_wait().unwrap();
            status.is_some()
        });
        if !is_over {
            let at = std::fs::read_to_string(format!("/proc/{}/stat", client.id()));
            self.fail(&format!("waited {PATIENCE:?} for {client:?}: {at:?}"));
        }
        status.expect("it has ended")
    }

    /// From now on a stop is looked for in the commands.
    pub fn expect(&mut self, asked: Asked) {
        self.poll();
        (self.asked, self.asked_ns, self.answered_ns) = (Some(asked), asked.at_ns, None);
        (self.counters, self.raised_ns) = (self.board.asked(), None);
    }

    /// Waits for the first command that does what was asked. Returns the ms from the stop, and from the counter on the
    /// board as this process has seen it raised, to that command; none where none comes.
    pub fn answer(&mut self) -> Option<(f64, Option<f64>)> {
        self.look_until(|watched| watched.answered_ns.is_some());
        let since = |from: u64| self.answered_ns.map(|answered| answered.saturating_sub(from) as f64 * 1e-6);
        Some((since(self.asked_ns)?, self.raised_ns.and_then(since)))
    }

    /// Resets what is latched, and arms all axes.
    pub fn arm(&mut self) {
        let until = Instant::now() + 2 * PATIENCE;
        while self.armed().len() < AXES || !self.are_in(&[0, 1, 2, 3], AxisMode::Track) {
            assert!(Instant::now() < until, "{}: the axes cannot be armed: {:?}", self.step, self.last);
            if self.running.supervisor.try_wait().unwrap().is_some() {
                panic!("{}: the run has ended: {}", self.step, text(self.running.supervisor.stderr.take()));
            }
            self.kept = [Kept::Free; AXES];
            if (0..AXES).any(|axis| self.axis(axis).is_some_and(|axis| axis.flags & control_flag::LATCHED != 0)) {
                let mut reset = self.client(&["reset"]);
                self.finish(&mut reset);
            }
            let mut arm = self.client(&["operate", "--mode", "track", "--enable", "--leave"]);
            self.finish(&mut arm);
            self.look_for(Duration::from_millis(1));
        }
    }

    /// Ends the group in order.
    pub fn end(self) {
        let Self { commands, health, board, channels, mut running, .. } = self;
        drop((commands, health, board, channels));
        running.interrupt();
        wait_for("the end of its files", || running.group.files().is_empty().then_some(()));
    }

    pub fn pid(&self, kind: StageKind) -> u32 {
        self.running.pids[kind as usize]
    }
}

/// Whether the command of an axis is as it must be.
fn is_kept(command: &ValveCommand, axis: usize, kept: Kept) -> bool {
    let found = &command.axes[axis];
    let is_off = found.command == 0.0 && found.flags & OFF != 0;
    match kept {
        Kept::Free => true,
        Kept::Off => is_off,
        Kept::Emergency => is_off && found.flags & control_flag::EMERGENCY_STOP != 0 && command.cut_off == 1,
    }
}

/// Stops all groups of this user.
pub fn everywhere() -> Command {
    let mut command = hydraxis();
    command.arg("disarm").stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// The present time, ns.
pub fn now() -> u64 {
    monotonic_ns()
}
