//! Messages between the cores: the bytes say how the messages of a working control loop are changed.
//!
//! When the bytes come in, the loop has been trained and tracks a reference. The bytes are steps of [`STEP`] bytes: an
//! action, an axis or a place in a message, and a value. One more step is therefore one more fault of a machine that
//! works otherwise. Random messages alone would be refused for their headers.

use std::{cell::RefCell, thread_local};

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    machine::{Estimator, Machine, ModelChoice},
    message::{
        AxisMode, AxisRequest, CoefficientSnapshot, Header, MAX_PREVIEW, Message, Reference, Request, ValveCommand,
        control_flag,
    },
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// Bytes of one step: action (1), place (2), variant (1), value (8).
const STEP: usize = 12;
/// Largest number of ticks for one input.
const MOST_TICKS: u32 = 96;
/// Ticks before the bytes come in: the training, and some ticks under the predictive controller.
const WARM_UP: u64 = 1000;
/// Values that are likely to break unchecked code.
const EXTREME_VALUES: [f64; 16] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    0.0,
    -0.0,
    f64::MIN_POSITIVE,
    1e-320,
    1.0,
    -1.0,
    1.000_000_1,
    -2.0,
    0.65,
    1e9,
    -1e300,
    f64::MAX,
    f64::EPSILON,
];
/// Flags of an axis whose command has to be neutral.
const NEUTRAL: u32 = control_flag::DISARMED | control_flag::SETTLING | control_flag::LATCHED;

thread_local! {
    /// The trained loop with which every input begins.
    static BEGIN: RefCell<Option<ControlLoop>> = const { RefCell::new(None) };
}

/// Runs a working loop whose messages are changed as the bytes say.
pub fn messages(data: &[u8]) {
    let mut work = BEGIN.with_borrow_mut(|begin| begin.get_or_insert_with(ControlLoop::warm).clone());
    for step in data.chunks_exact(STEP) {
        work.step(step);
        if work.ticks >= MOST_TICKS {
            break;
        }
    }
    work.tick();
}

/// Bytes that are written over a part of a message.
#[derive(Clone, Copy)]
struct Overwrite {
    place: usize,
    value: [u8; 8],
    length: usize,
}

/// Messages of the loop that can be overwritten, in the order of [`ControlLoop::overwrites`].
#[derive(Clone, Copy)]
enum Overwritten {
    Reading,
    Sample,
    Command,
    Snapshot,
}

/// The cores of all stages, called one after the other.
#[derive(Clone)]
struct ControlLoop {
    machine: Machine,
    plant: PlantSim,
    acquisition: Acquisition,
    identifiers: Identifiers,
    controller: Controller,
    /// A controller that is never armed and gets no request.
    disarmed: Controller,
    tick: u64,
    ticks: u32,
    command: ValveCommand,
    snapshot: CoefficientSnapshot,
    reference: Option<Reference>,
    request: Request,
    /// Overwrites of the next reading, sample, command and snapshot.
    overwrites: [Vec<Overwrite>; 4],
    /// Whether the reading of this tick arrives.
    is_read: bool,
    /// Whether the identifiers learn from the sample of this tick.
    is_learned: bool,
    /// Whether the sample of this tick has the number of the one before.
    is_repeated: bool,
}

impl ControlLoop {
    /// A loop that has been trained and tracks its references.
    fn warm() -> Self {
        let all = Machine::four_axes(&[("scenario".to_owned(), "nominal".to_owned())]).expect("the built-in machine");
        let (mut boom, mut bucket) = (all.axes[0].clone(), all.axes[3].clone());
        boom.identification.training = 800;
        // The two axes use different estimators and different models.
        bucket.identification.training = 800;
        bucket.identification.estimator = Estimator::Constant(0.995);
        bucket.control.model = ModelChoice::Classical;
        let machine = Machine { axes: vec![boom, bucket], ..all };
        let mut work = Self {
            plant: PlantSim::new(&machine, 1).expect("the built-in plant"),
            acquisition: Acquisition::new(&machine),
            identifiers: Identifiers::new(&machine),
            controller: Controller::new(&machine).expect("no file to read"),
            disarmed: Controller::new(&machine).expect("no file to read"),
            tick: 0,
            ticks: 0,
            command: ValveCommand::default(),
            snapshot: CoefficientSnapshot::default(),
            reference: None,
            request: Request { session: 1, ..Request::default() },
            overwrites: [const { Vec::new() }; 4],
            is_read: true,
            is_learned: true,
            is_repeated: false,
            machine,
        };
        work.controller.arm();
        for _ in 0..WARM_UP {
            work.tick();
        }
        assert!(
            work.command.axes[..2].iter().all(|axis| axis.flags & NEUTRAL == 0),
            "the loop works before the bytes come in"
        );
        work.ticks = 0;
        work
    }

    /// Performs one step of the bytes.
    fn step(&mut self, bytes: &[u8]) {
        let place = usize::from(u16::from_le_bytes([bytes[1], bytes[2]]));
        let (how, mut value) = (bytes[3], [0; 8]);
        value.copy_from_slice(&bytes[4..STEP]);
        if how & 1 == 1 {
            value = EXTREME_VALUES[usize::from(how >> 4)].to_le_bytes();
        }
        let overwrite = Overwrite { place, value, length: if how & 2 == 2 { 4 } else { 8 } };
        match bytes[0] % 16 {
            0 => (0..1 + bytes[1] % 32).for_each(|_| self.tick()),
            1 => self.controller.arm(),
            2 => self.controller.disarm(),
            3 => self.controller.feedback_lost(),
            kind @ 4..=7 => self.overwrites[usize::from(kind) - 4].push(overwrite),
            8 => {
                apply(self.reference.get_or_insert_with(|| reference(&self.machine, self.tick)), &overwrite);
            }
            9 => self.reference = Some(reference(&self.machine, self.tick)),
            10 => {
                apply(&mut self.request, &overwrite);
                self.controller.ask(&self.request);
            }
            11 => self.ask(place % 2, how, f64::from_le_bytes(value)),
            12 => self.is_read = false,
            13 => self.is_learned = false,
            14 => self.is_repeated = true,
            _ => self.tick = u64::from_le_bytes(value),
        }
    }

    /// Sends a request that is valid except for its value.
    fn ask(&mut self, axis: usize, how: u8, value: f64) {
        let Self { request, tick, .. } = self;
        let number = request.header.number.wrapping_add(1);
        request.header = Header { number, sequence: tick.saturating_sub(1), axis_count: 2, ..Header::default() };
        request.axes[axis] = AxisRequest {
            mode: AxisMode::ALL[usize::from(how >> 2) % AxisMode::ALL.len()] as u32,
            enable: request.axes[axis].enable.wrapping_add(u32::from(how >> 5 & 1)),
            command: value,
            target: value,
            has_target: u32::from(how >> 6 & 1),
            hold_to_run: 0,
            gain: if how >> 7 & 1 == 1 { value } else { 0.0 },
        };
        self.controller.ask(request);
    }

    /// Works one tick and checks the commands.
    fn tick(&mut self) {
        let mut reading = self.plant.read();
        self.overwrite(Overwritten::Reading, &mut reading);
        let is_read = std::mem::replace(&mut self.is_read, true);
        let mut sample = self.acquisition.update(self.tick, is_read.then_some(&reading));
        assert!(sample.axes.iter().all(|axis| axis.position.is_finite()), "{sample:?}");
        self.overwrite(Overwritten::Sample, &mut sample);
        if std::mem::take(&mut self.is_repeated) {
            sample.header.sequence = self.tick.wrapping_sub(1);
        }
        let mut applied = self.command;
        self.overwrite(Overwritten::Command, &mut applied);
        if std::mem::replace(&mut self.is_learned, true) {
            self.identifiers.update(&sample, Some(&applied), &mut self.snapshot);
        }
        let mut snapshot = self.snapshot;
        self.overwrite(Overwritten::Snapshot, &mut snapshot);

        let command = self.controller.update(&sample, Some(&snapshot), self.reference.as_ref());
        let neutral = self.disarmed.update(&sample, Some(&snapshot), self.reference.as_ref());
        self.judge(&command);
        assert!(neutral.axes.iter().all(|axis| axis.command == 0.0), "disarmed: {neutral:?}");
        let at_once = self.controller.neutral(self.tick);
        assert!(at_once.axes.iter().all(|axis| axis.command == 0.0), "{at_once:?}");

        // The drive gets the command that was sent, with the overwrites.
        applied = command;
        self.overwrite(Overwritten::Command, &mut applied);
        self.plant.command(&applied);
        self.plant.advance(self.machine.timing.period);
        for (state, axis) in self.plant.axes().iter().zip(&self.machine.axes) {
            assert!(state.position.is_finite() && state.velocity.is_finite(), "{state:?}");
            assert!(state.position > -axis.stroke && state.position < 2.0 * axis.stroke, "{state:?}");
        }
        self.overwrites.iter_mut().for_each(Vec::clear);
        self.command = command;
        self.tick = self.tick.wrapping_add(1);
        self.ticks += 1;
    }

    /// Checks that every command is one, and neutral where it has to be.
    fn judge(&self, command: &ValveCommand) {
        assert_eq!(command.header.axis_count, 2);
        for axis in &command.axes {
            assert!((-1.0..=1.0).contains(&axis.command), "{axis:?}");
            assert!(axis.flags & NEUTRAL == 0 || axis.command == 0.0, "{axis:?}");
            assert!(axis.operation != AxisMode::Off as u32 || axis.command == 0.0, "{axis:?}");
            assert!(axis.reference.is_finite() && axis.error.is_finite(), "{axis:?}");
        }
        assert!(command.axes[2..].iter().all(|axis| axis.command == 0.0));
    }

    fn overwrite<M: Message>(&self, which: Overwritten, message: &mut M) {
        self.overwrites[which as usize].iter().for_each(|overwrite| apply(message, overwrite));
    }
}

/// A valid reference: the middle of the stroke of every axis.
fn reference(machine: &Machine, tick: u64) -> Reference {
    let mut reference = Reference { preview: MAX_PREVIEW as u32, ..Reference::default() };
    reference.header = Header { sequence: tick, axis_count: 2, ..Header::default() };
    for (positions, axis) in reference.positions.iter_mut().zip(&machine.axes) {
        positions.fill((axis.soft_limits.0 + axis.soft_limits.1) / 2.0);
    }
    reference
}

/// Writes bytes over a part of a message. The part begins at a multiple of four bytes, as fields do.
#[expect(
    unsafe_code,
    reason = "a message is plain numbers without padding, so any bytes are a valid message; that is tested here"
)]
fn apply<M: Message>(message: &mut M, overwrite: &Overwrite) {
    let words = size_of::<M>() / 4;
    let place = 4 * (overwrite.place % words);
    let length = overwrite.length.min(size_of::<M>() - place);
    // SAFETY: the bytes lie inside the message, to which this is the only reference, and any bytes are a valid number.
    let bytes = unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(message).cast::<u8>(), size_of::<M>()) };
    bytes[place..place + length].copy_from_slice(&overwrite.value[..length]);
}
