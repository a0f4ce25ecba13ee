//! The stages but for ident-proc, whose core is the test's.
//!
//! What the controller commands is held against the same core in this process, bit for bit: at every tick, and where
//! snapshots are spoilt against one that gets the last good snapshot again and again.

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    channel::{Group, Publisher, Reader},
    hammerstein::Coefficients,
    message::{
        AxisCommand, CoefficientSnapshot, ControlMode, EncoderSample, Header, REFUSALS, Request, ValveCommand,
        control_flag,
    },
    stage::{StageKind, monotonic_ns},
};

use super::{machine, set};
use crate::harness::{
    TestGroup,
    channel::{AXES, receive},
};

/// Why a model may be refused, the first of what is wrong with it.
pub type Reasons = &'static [&'static str];

/// Ticks of spoilt snapshots, and of good ones after.
pub const SPOILT: usize = 6;
const GOOD: usize = 4;

/// The stages but for ident-proc, whose core is here.
pub struct Identified {
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    snapshots: Publisher<CoefficientSnapshot>,
    requests: Publisher<Request>,
    core: Identifiers,
    /// What control-proc runs, fed with the same.
    pub twin: Controller,
    pub good: CoefficientSnapshot,
    is_trained: bool,
    /// What the last command was made with.
    judged: CoefficientSnapshot,
    /// As it was sent last.
    pub sent: Option<CoefficientSnapshot>,
    pub request: Option<Request>,
    asked: u64,
    pub sample: EncoderSample,
    pub command: ValveCommand,
    tick: u64,
    // Removes what is left of the group, so after all that is in it.
    _channels: Group,
    _group: TestGroup,
}

impl Identified {
    /// Starts, and trains until the model controls every axis and has done so for half a second; then it learns no more.
    pub fn start(test: &str, settings: &[&str]) -> Self {
        // Trained for 8 s as it is: a model of less is not trusted for as long as these tests take.
        let all: Vec<String> = ["scenario=nominal"].iter().chain(settings).map(|pair| (*pair).to_owned()).collect();
        let machine = machine(&all);
        let mut group = TestGroup::new(test);
        let channels = group.join();
        let (samples, commands) = (channels.reader().unwrap(), channels.reader().unwrap());
        let (snapshots, requests) = (channels.publisher().unwrap(), channels.publisher().unwrap());
        group.start_all_but(StageKind::IdentProc, &[&["--lockstep", "--arm"], &set(&all)[..]].concat());
        let mut twin = Controller::new(&machine).unwrap();
        twin.arm();
        let mut identified = Self {
            _group: group,
            samples,
            commands,
            snapshots,
            requests,
            _channels: channels,
            core: Identifiers::new(&machine),
            twin,
            good: CoefficientSnapshot::default(),
            is_trained: false,
            judged: CoefficientSnapshot::default(),
            sent: None,
            request: None,
            asked: 0,
            sample: EncoderSample::default(),
            command: ValveCommand::default(),
            tick: 0,
        };
        identified.await_model();
        identified
    }

    fn await_model(&mut self) {
        let is_good = |axis: &AxisCommand| is_by_model(axis) && axis.flags & control_flag::MODEL_REFUSED == 0;
        let mut good = 0;
        while good < 50 {
            self.step(|_| ());
            good = if self.command.axes[..AXES].iter().all(is_good) { good + 1 } else { 0 };
            assert!(self.tick < 3000, "no model: {:?}", self.command.axes[..AXES].iter().map(|axis| axis.flags));
        }
        // What was accepted last is what is good from here on: what an identifier finds next need not be.
        self.is_trained = true;
        self.good = self.judged;
    }

    /// Works one tick; `spoil` changes the snapshot after it, which the command of the next tick is made with.
    pub fn step(&mut self, spoil: impl FnOnce(&mut CoefficientSnapshot)) -> ValveCommand {
        let sample: EncoderSample = receive(&mut self.samples, self.tick, || self.snapshots.greet());
        let command: ValveCommand = receive(&mut self.commands, self.tick, || self.snapshots.greet());
        let expected = self.twin.update(&sample, self.sent.as_ref(), None);
        for (axis, expected) in command.axes[..AXES].iter().zip(&expected.axes) {
            assert_eq!(axis, expected, "tick {}: the process is its core", self.tick);
        }
        self.judged = self.sent.unwrap_or_default();
        let before = (self.tick > 0).then_some(&self.command);
        if !self.is_trained {
            self.core.update(&sample, before, &mut self.good);
        }
        let now = monotonic_ns();
        let header = Header {
            sequence: self.tick,
            acquired_ns: now,
            sent_ns: now,
            axis_count: AXES as u32,
            ..Header::default()
        };
        self.good.header = header;
        let mut sent = self.good;
        spoil(&mut sent);
        // Before the snapshot, for which the next command waits: so it is known which of them is the first to know.
        if let Some(request) = self.request {
            let number = self.asked;
            self.asked += 1;
            let request = Request { header: Header { number, ..header }, ..request };
            self.requests.send(&request).unwrap();
            self.twin.ask(&request);
        }
        self.snapshots.send(&sent).unwrap();
        (self.sample, self.command, self.sent) = (sample, command, Some(sent));
        self.tick += 1;
        command
    }

    pub fn steps(&mut self, ticks: usize) -> ValveCommand {
        (0..ticks).map(|_| self.step(|_| ())).last().unwrap()
    }

    /// Spoils both models of every axis for some ticks. The commands must be those of the last good snapshot, every
    /// spoilt one must be refused for the reason that `spoil` says, and good ones must be taken again after.
    pub fn refused(&mut self, what: &str, spoil: impl Fn(usize, &mut Coefficients) -> Reasons) {
        let mut without = self.twin.clone();
        let last_good = self.sent;
        let before = self.command;
        for k in 0..=SPOILT {
            // The last one is good again, and the command that shows it is the next.
            let command = self.step(|snapshot| {
                let axes = snapshot.axes[..AXES].iter_mut().enumerate().filter(|_| k < SPOILT);
                for (i, axis) in axes {
                    spoil(i, &mut axis.adaptive);
                    spoil(i, &mut axis.classical);
                }
            });
            let expected = without.update(&self.sample, last_good.as_ref(), None);
            for (i, (axis, expected)) in command.axes[..AXES].iter().zip(&expected.axes).enumerate() {
                let place = format!("{what}, axis {i}, tick {k}");
                assert_eq!(axis.command.to_bits(), expected.command.to_bits(), "{place}");
                assert_eq!((axis.mode, axis.flags & control_flag::LATCHED), (ControlMode::Model as u32, 0), "{place}");
                assert_eq!(axis.flags & control_flag::MODEL_REFUSED != 0, k > 0, "{place}");
                let mut model = last_good.unwrap().axes[i].adaptive;
                let more = |reasons: &[&str]| -> u64 {
                    let counts = |axis: &AxisCommand| -> u64 {
                        reasons.iter().map(|reason| axis.rejected_snapshots[number(reason)]).sum()
                    };
                    counts(axis) - counts(&before.axes[i])
                };
                assert_eq!((more(spoil(i, &mut model)), more(&REFUSALS)), (k as u64, k as u64), "{place}");
            }
        }
        self.accepted(what);
    }

    /// Good snapshots are taken, and nothing more is refused but what was sent before.
    pub fn accepted(&mut self, what: &str) {
        let first = self.step(|_| ());
        let last = self.steps(GOOD);
        for (i, (first, last)) in first.axes[..AXES].iter().zip(&last.axes).enumerate() {
            assert_eq!(last.flags & (control_flag::MODEL_REFUSED | control_flag::LATCHED), 0, "{what}, axis {i}");
            assert!(is_by_model(last), "{what}, axis {i}");
            assert_eq!(first.rejected_snapshots, last.rejected_snapshots, "{what}, axis {i}");
        }
    }
}

/// Whether the model makes the command.
pub fn is_by_model(axis: &AxisCommand) -> bool {
    axis.mode == ControlMode::Model as u32
}

/// The place of a reason among the counts.
pub fn number(reason: &str) -> usize {
    REFUSALS.iter().position(|name| *name == reason).unwrap()
}
