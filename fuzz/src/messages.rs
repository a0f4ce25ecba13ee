//! Messages between the cores: a loop that works, of which the bytes say what happens to its messages.
//!
//! The loop has been trained and tracks when the bytes come in. They are steps of [`STEP`] bytes: what to do, to which axis
//! or where in the message, and a value. So a byte more is one thing more that goes wrong in a machine that is otherwise
//! well; noise from end to end would be refused at the first header.

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
use sensor_proc::source::Acquisition;

/// Bytes of one step: what, where (2), how, value (8).
const STEP: usize = 12;
/// Ticks that one input is worked for at most.
const MOST_TICKS: u32 = 96;
/// Ticks before the bytes come in: the training, and some on the model.
const WARM_UP: u64 = 1000;
/// Values that break what is not watched.
const NASTY: [f64; 16] = [
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
/// Bits of the flags that stand for an axis that must not be driven.
const NEUTRAL: u32 = control_flag::DISARMED | control_flag::SETTLING | control_flag::LATCHED;

thread_local! {
    /// The loop that every input starts with.
    static BEGIN: RefCell<Option<Loop>> = const { RefCell::new(None) };
}

/// What happens to the messages of a loop that works.
pub fn messages(data: &[u8]) {
    let mut work = BEGIN.with_borrow_mut(|begin| begin.get_or_insert_with(Loop::warm).clone());
    for step in data.chunks_exact(STEP) {
        work.step(step);
        if work.ticks >= MOST_TICKS {
            break;
        }
    }
    work.tick();
}

/// One message that is to be changed.
#[derive(Clone, Copy)]
struct Change {
    place: usize,
    value: [u8; 8],
    length: usize,
}

#[derive(Clone)]
struct Loop {
    machine: Machine,
    plant: PlantSim,
    acquisition: Acquisition,
    identifiers: Identifiers,
    controller: Controller,
    /// One that nobody ever arms or asks for anything.
    disarmed: Controller,
    tick: u64,
    ticks: u32,
    command: ValveCommand,
    snapshot: CoefficientSnapshot,
    reference: Option<Reference>,
    request: Request,
    /// To the next reading, sample, command and snapshot.
    changes: [Vec<Change>; 4],
    is_read: bool,
    is_learned: bool,
    is_repeated: bool,
}

impl Loop {
    /// Trained, and on its way.
    fn warm() -> Self {
        let all = Machine::load(None, &[("scenario".to_owned(), "nominal".to_owned())]).expect("the built-in machine");
        let (mut boom, mut bucket) = (all.axes[0].clone(), all.axes[3].clone());
        boom.identification.training = 800;
        // Each half of what a model can be.
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
            changes: [const { Vec::new() }; 4],
            is_read: true,
            is_learned: true,
            is_repeated: false,
            machine,
        };
        work.controller.arm();
        for _ in 0..WARM_UP {
            work.tick();
        }
        assert!(work.command.axes[..2].iter().all(|axis| axis.flags & NEUTRAL == 0), "it works before it is disturbed");
        work.ticks = 0;
        work
    }

    fn step(&mut self, bytes: &[u8]) {
        let place = usize::from(u16::from_le_bytes([bytes[1], bytes[2]]));
        let (how, mut value) = (bytes[3], [0; 8]);
        value.copy_from_slice(&bytes[4..STEP]);
        if how & 1 == 1 {
            value = NASTY[usize::from(how >> 4)].to_le_bytes();
        }
        let change = Change { place, value, length: if how & 2 == 2 { 4 } else { 8 } };
        match bytes[0] % 16 {
            0 => (0..1 + bytes[1] % 32).for_each(|_| self.tick()),
            1 => self.controller.arm(),
            2 => self.controller.disarm(),
            3 => self.controller.feedback_lost(),
            kind @ 4..=7 => self.changes[usize::from(kind) - 4].push(change),
            8 => {
                apply(self.reference.get_or_insert_with(|| reference(&self.machine, self.tick)), &change);
            }
            9 => self.reference = Some(reference(&self.machine, self.tick)),
            10 => {
                apply(&mut self.request, &change);
                self.controller.ask(&self.request);
            }
            11 => self.ask(place % 2, how, f64::from_le_bytes(value)),
            12 => self.is_read = false,
            13 => self.is_learned = false,
            14 => self.is_repeated = true,
            _ => self.tick = u64::from_le_bytes(value),
        }
    }

    /// A request that is in order but for its value.
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
            reserved: 0,
        };
        self.controller.ask(request);
    }

    fn tick(&mut self) {
        let mut reading = self.plant.read();
        self.change(0, &mut reading);
        let is_read = std::mem::replace(&mut self.is_read, true);
        let mut sample = self.acquisition.update(self.tick, is_read.then_some(&reading));
        assert!(sample.axes.iter().all(|axis| axis.position.is_finite()), "{sample:?}");
        self.change(1, &mut sample);
        if std::mem::take(&mut self.is_repeated) {
            sample.header.sequence = self.tick.wrapping_sub(1);
        }
        let mut applied = self.command;
        self.change(2, &mut applied);
        if std::mem::replace(&mut self.is_learned, true) {
            self.identifiers.update(&sample, Some(&applied), &mut self.snapshot);
        }
        let mut snapshot = self.snapshot;
        self.change(3, &mut snapshot);

        let command = self.controller.update(&sample, Some(&snapshot), self.reference.as_ref());
        let neutral = self.disarmed.update(&sample, Some(&snapshot), self.reference.as_ref());
        self.judge(&command);
        assert!(neutral.axes.iter().all(|axis| axis.command == 0.0), "disarmed: {neutral:?}");
        let at_once = self.controller.neutral(self.tick);
        assert!(at_once.axes.iter().all(|axis| axis.command == 0.0), "{at_once:?}");

        // What the drive gets is what was sent, or what becomes of it on the way.
        applied = command;
        self.change(2, &mut applied);
        self.plant.command(&applied);
        self.plant.advance(self.machine.timing.period);
        for (state, axis) in self.plant.axes().iter().zip(&self.machine.axes) {
            assert!(state.position.is_finite() && state.velocity.is_finite(), "{state:?}");
            assert!(state.position > -axis.stroke && state.position < 2.0 * axis.stroke, "{state:?}");
        }
        self.changes.iter_mut().for_each(Vec::clear);
        self.command = command;
        self.tick = self.tick.wrapping_add(1);
        self.ticks += 1;
    }

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

    fn change<M: Message>(&self, which: usize, message: &mut M) {
        self.changes[which].iter().for_each(|change| apply(message, change));
    }
}

/// A reference that is in order: the middle of every axis.
fn reference(machine: &Machine, tick: u64) -> Reference {
    let mut reference = Reference { preview: MAX_PREVIEW as u32, ..Reference::default() };
    reference.header = Header { sequence: tick, axis_count: 2, ..Header::default() };
    for (positions, axis) in reference.positions.iter_mut().zip(&machine.axes) {
        positions.fill((axis.soft_limits.0 + axis.soft_limits.1) / 2.0);
    }
    reference
}

/// Puts bytes somewhere into a message, four by four as its fields lie.
#[expect(
    unsafe_code,
    reason = "a message is plain numbers without a gap, so any bytes are one; just that is tried here"
)]
fn apply<M: Message>(message: &mut M, change: &Change) {
    let words = size_of::<M>() / 4;
    let place = 4 * (change.place % words);
    let length = change.length.min(size_of::<M>() - place);
    // SAFETY: the bytes lie inside the message, which nobody else holds, and any bytes are a valid number.
    let bytes = unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(message).cast::<u8>(), size_of::<M>()) };
    bytes[place..place + length].copy_from_slice(&change.value[..length]);
}
