//! All stages but ident-proc, whose core runs in the test.
//!
//! The commands of the controller are compared, bit for bit, with those of a controller core in this process: at every
//! tick, and, while snapshots are spoilt, with a core that gets the last good snapshot again and again.

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

/// Reasons for which a model may be refused; the first one that the judge finds counts.
pub type Reasons = &'static [&'static str];

/// Number of ticks with spoilt snapshots, and with good ones after them.
pub const SPOILT: usize = 6;
const GOOD: usize = 4;

/// All stages but ident-proc, and the core of ident-proc.
pub struct Identified {
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    snapshots: Publisher<CoefficientSnapshot>,
    requests: Publisher<Request>,
    core: Identifiers,
    /// A controller core that gets the same messages as control-proc.
    pub twin: Controller,
    pub good: CoefficientSnapshot,
    is_trained: bool,
    /// The snapshot with which the last command was made.
    judged: CoefficientSnapshot,
    /// The snapshot that was sent last.
    pub sent: Option<CoefficientSnapshot>,
    pub request: Option<Request>,
    asked: u64,
    pub sample: EncoderSample,
    pub command: ValveCommand,
    tick: u64,
    // Dropped last, since it removes what is left of the group.
    _channels: Group,
    _group: TestGroup,
}

impl Identified {
    /// Starts the stages and identifies until the model has controlled every axis for half a second. After that the
    /// model stays as it is.
    pub fn start(test: &str, settings: &[&str]) -> Self {
        // With the usual 8 s of training: a model of a shorter one is distrusted before these tests end.
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
        // The model that was accepted last is the good one from here on. A later one might be refused.
        self.is_trained = true;
        self.good = self.judged;
    }

    /// Works one tick. `spoil` changes the snapshot of this tick, with which the command of the next tick is made.
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
            machine: sample.header.machine,
            ..Header::default()
        };
        self.good.header = header;
        let mut sent = self.good;
        spoil(&mut sent);
        // Sent before the snapshot, for which the next command waits. So the next command is the first that knows it.
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

    /// Spoils both models of every axis for some ticks. The commands must be those of the last good snapshot. Every
    /// spoilt snapshot must be refused for a reason that `spoil` returns. Good snapshots must be accepted again
    /// afterwards.
    pub fn refused(&mut self, what: &str, spoil: impl Fn(usize, &mut Coefficients) -> Reasons) {
        let mut without = self.twin.clone();
        let last_good = self.sent;
        let before = self.command;
        for k in 0..=SPOILT {
            // The last snapshot is good again; the command that uses it is the next one.
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

    /// Expects that good snapshots are accepted, and that nothing is refused but what was sent before.
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

/// Whether the axis is commanded by the predictive controller.
pub fn is_by_model(axis: &AxisCommand) -> bool {
    axis.mode == ControlMode::Model as u32
}

/// Index of a reason in the counts of refusals.
pub fn number(reason: &str) -> usize {
    REFUSALS.iter().position(|name| *name == reason).unwrap()
}
