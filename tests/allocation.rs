//! The loops of all four stages allocate nothing after the start. An allocator counts on the threads of the stages.

mod harness;

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Duration,
};

use harness::{
    TestGroup,
    bus::{self, Devices},
    mechanism::joint_sensors,
    wait_for,
};
use pipeline::{
    channel::Prefix,
    hammerstein::{Basis, InputMap, Structure},
    machine::{Form, IdentifiedOutput, Machine, Source},
    message::{AxisMode, AxisRequest, CoefficientSnapshot, EncoderSample, Request, ValveCommand},
    stage::{Clock, StageError, StageKind, StageOptions},
};

static COUNTING: AtomicBool = AtomicBool::new(false);
static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static IS_STAGE: Cell<bool> = const { Cell::new(false) };
}

/// The system's allocator. It counts the calls that come from threads of stages.
struct Counting;

fn count() {
    if COUNTING.load(Ordering::Relaxed) && IS_STAGE.with(Cell::get) {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call is passed on unchanged to the system's allocator, and counting uses no heap memory.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count();
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

type Run = fn(&Machine, StageOptions) -> Result<(), StageError>;

const STAGES: [(StageKind, Run); 4] = [
    (StageKind::PlantSim, plant_sim::process::run),
    (StageKind::SensorProc, sensor_proc::process::run),
    (StageKind::IdentProc, ident_proc::process::run),
    (StageKind::ControlProc, control_proc::process::run),
];

/// A program that changes the modes of the axes all the time. Some of its requests are invalid.
struct Restless {
    requests: pipeline::channel::Publisher<Request>,
    commands: pipeline::channel::Reader<ValveCommand>,
    request: Request,
    /// Modes in which the first axis was seen.
    seen: [bool; 6],
}

impl Restless {
    fn join(channels: &pipeline::channel::Group) -> Self {
        let (requests, commands) = (channels.publisher().unwrap(), channels.reader().unwrap());
        Self { requests, commands, request: Request { session: 1, ..Request::default() }, seen: [false; 6] }
    }

    fn ask(&mut self) {
        while let Some(command) = self.commands.read().unwrap().if_new() {
            self.seen[command.axes[0].operation as usize] = true;
            self.request.header.sequence = command.header.sequence;
            self.request.header.machine = command.header.machine;
        }
        let turn = self.request.header.sequence / 60;
        self.request.header.axis_count = 4;
        let enable = self.request.axes[0].enable + 1;
        self.request.axes[..4].fill(AxisRequest {
            mode: [AxisMode::Manual, AxisMode::Hold, AxisMode::Commission, AxisMode::Track, AxisMode::Off]
                [turn as usize % 5] as u32,
            enable,
            command: if turn % 7 == 6 { f64::NAN } else { 0.3 * (turn as f64).sin() },
            target: 0.6 + 0.05 * (turn as f64).sin(),
            has_target: 1,
            hold_to_run: 0,
            gain: [0.0, 0.8, 1.0][turn as usize % 3],
        });
        self.requests.send(&self.request).unwrap();
    }
}

/// Runs all stages on threads and counts what they allocate and free between two ticks, both included.
fn allocations(name: &str, machine: &Machine, clock: Clock, from: u64, to: u64) -> u64 {
    allocations_with(name, machine, clock, from, to, false)
}

/// Runs all stages on threads, with a program that operates the axes if `is_operated`. Counts what the stages allocate
/// and free between two ticks, both included.
fn allocations_with(name: &str, machine: &Machine, clock: Clock, from: u64, to: u64, is_operated: bool) -> u64 {
    let group = TestGroup::new(name);
    let channels = group.join();
    let mut snapshots = channels.reader::<CoefficientSnapshot>().unwrap();
    let mut operator = is_operated.then(|| Restless::join(&channels));
    let stop = Arc::new(AtomicBool::new(false));
    let threads: Vec<_> = STAGES
        .into_iter()
        .map(|(kind, run)| {
            let options = options(&group.prefix, clock, &stop);
            let machine = machine.clone();
            let is_bus = kind == StageKind::PlantSim && machine.source == Source::Can;
            let run: Run = if is_bus { can_proc::process::run } else { run };
            std::thread::spawn(move || {
                IS_STAGE.with(|stage| stage.set(true));
                let ended = run(&machine, options);
                IS_STAGE.with(|stage| stage.set(false));
                ended.map_err(|error| error.to_string())
            })
        })
        .collect();
    let mut wait_until = |tick| {
        wait_for("the tick", || {
            snapshots.newest().unwrap();
            operator.iter_mut().for_each(Restless::ask);
            snapshots.last().is_some_and(|snapshot| snapshot.header.sequence >= tick).then_some(())
        });
    };
    wait_until(from);
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    COUNTING.store(true, Ordering::Relaxed);
    wait_until(to);
    COUNTING.store(false, Ordering::Relaxed);
    let counted = ALLOCATIONS.load(Ordering::Relaxed) - before;
    stop.store(true, Ordering::Relaxed);
    if let Some(operator) = operator {
        assert_eq!(operator.seen, [false, true, true, true, true, true], "it was in every mode");
    }
    for thread in threads {
        thread.join().unwrap().unwrap();
    }
    counted
}

fn options(prefix: &Prefix, clock: Clock, stop: &Arc<AtomicBool>) -> StageOptions {
    let (prefix, stop, reset) = (prefix.clone(), Arc::clone(stop), Arc::default());
    StageOptions {
        prefix,
        clock,
        ticks: None,
        seed: 1,
        arm: true,
        first_tick: 0,
        is_recorded: false,
        warn: true,
        stop,
        reset,
        off: Arc::default(),
    }
}

/// Allocations of two thousand notifications for which the listener waits only after the last one.
fn unheard_bells() -> u64 {
    let group = TestGroup::new("events");
    let channels = group.join();
    let (listener, notifier) =
        (channels.listener::<EncoderSample>().unwrap(), channels.notifier::<EncoderSample>().unwrap());
    notifier.notify().unwrap();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    COUNTING.store(true, Ordering::Relaxed);
    IS_STAGE.with(|stage| stage.set(true));
    (0..2000).for_each(|_| notifier.notify().unwrap());
    listener.wait(Duration::from_millis(1)).unwrap();
    IS_STAGE.with(|stage| stage.set(false));
    COUNTING.store(false, Ordering::Relaxed);
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

/// Allocations of a group whose devices are on a CAN bus.
fn on_bus() -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("bus");
    let mut settings = bus::settings(&at);
    settings.push(("timing.feedback_timeout".to_owned(), "1s".to_owned()));
    let machine = Machine::four_axes(&settings).unwrap();
    let _devices = Devices::start(&at);
    allocations("bus", &machine, Clock::RealTime, 100, 400)
}

/// A single test, since the allocator counts for the whole process.
#[test]
fn the_stage_loops_allocate_nothing_after_start() {
    // First a check that the allocator counts, with this thread as a stage.
    COUNTING.store(true, Ordering::Relaxed);
    IS_STAGE.with(|stage| stage.set(true));
    drop(std::hint::black_box(vec![1u8; 100]));
    IS_STAGE.with(|stage| stage.set(false));
    COUNTING.store(false, Ordering::Relaxed);
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed), 2);

    // Notifications that nobody waits for.
    assert_eq!(unheard_bells(), 0);

    // Lock-step: the end of training (tick 800), the change from the fallback to the model, and heartbeats.
    let mut machine = Machine::four_axes(&[]).unwrap();
    assert_eq!(allocations("lockstep", &machine, Clock::LockStep, 100, 3000), 0);
    // The full form, which separates b, f and g at every tick.
    machine.axes.iter_mut().for_each(|axis| axis.identification.form = Form::Full);
    assert_eq!(allocations("full", &machine, Clock::LockStep, 100, 2000), 0);
    // Every option of the structure, and an axis whose velocity is identified.
    for axis in &mut machine.axes {
        let input = InputMap { dead_band: (0.05, 0.07), basis: Basis::hinges(&[0.0, 0.2, 0.5]).unwrap() };
        let structure = axis.identification.structure;
        axis.identification.structure = Structure { na: 2, integrator: true, drift: true, input, ..structure };
    }
    machine.axes[1].identification.output = IdentifiedOutput::Velocity;
    machine.axes[2].identification.form = Form::Linear;
    assert_eq!(allocations("options", &machine, Clock::LockStep, 100, 2000), 0);
    // Estimators other than the default one.
    let kinds = ["fuzzy:0.9", "fortescue:100", "directional:0.99", "window:300"];
    for (axis, kind) in machine.axes.iter_mut().zip(kinds) {
        axis.identification.estimator = kind.parse().unwrap();
    }
    assert_eq!(allocations("forgetting", &machine, Clock::LockStep, 100, 2000), 0);
    // Sensors at joints, and pressures.
    let mut settings = joint_sensors("inclinometer", 1e-4);
    settings.push(("axis.boom.pressure.resolution".to_owned(), "1e4".to_owned()));
    settings.push(("axis.boom.plant.angle_bandwidth".to_owned(), "10".to_owned()));
    let machine = Machine::load(None, &settings).unwrap();
    assert_eq!(allocations("joints", &machine, Clock::LockStep, 100, 500), 0);
    // Real time: timers, notifications, and the end of training after 200 ticks of 2 ms.
    let mut machine = Machine::four_axes(&[("timing.period".to_owned(), "2ms".to_owned())]).unwrap();
    machine.axes.iter_mut().for_each(|axis| axis.identification.training = 400);
    machine.timing.feedback_timeout = Duration::from_secs(1);
    assert_eq!(allocations("realtime", &machine, Clock::RealTime, 100, 1200), 0);
    // Encoders and valves on a CAN bus.
    assert_eq!(on_bus(), 0);
    // Modes that change all the time.
    assert_eq!(allocations_with("modes", &machine, Clock::RealTime, 100, 2000, true), 0);
}
