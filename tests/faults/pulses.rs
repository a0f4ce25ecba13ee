//! Row 34: short pulses of the emergency stop input, with sensor-proc as a real stage and the encoders played by the
//! test.
//!
//! A pulse of 4 ms is shorter than the control period of 10 ms, so that most samples do not show it.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    thread::{JoinHandle, sleep, spawn},
    time::Duration,
};

use pipeline::{
    channel::{Board, Group, Prefix, Reader, Stops},
    machine::Machine,
    message::{EncoderReading, EncoderSample, Header, ValveCommand, control_flag},
    stage::{Clock, StageKind, StageOptions, monotonic_ns, sleep_until},
};
use rustix::process::Signal;

use crate::harness::{
    Dice, TestGroup,
    channel::{AXES, await_message},
    shared, signal, succeed, wait_for,
};

/// Time between two readings, ns.
const READING_NS: u64 = 1_000_000;
/// Readings of a pulse of 4 ms.
const PULSE: u32 = 4;
/// Counts of axes that stand in the middle.
const COUNTS: [i64; AXES] = [6500, 7500, 6000, 5500];

/// Encoders that are read every millisecond, and an emergency stop that is pressed for some readings.
struct Encoders {
    /// Readings for which the emergency stop is still pressed, and one after them.
    pressed: Arc<AtomicU32>,
    end: Arc<AtomicBool>,
    player: Option<JoinHandle<()>>,
}

impl Encoders {
    fn start(prefix: &Prefix) -> Self {
        let (pressed, end) = (Arc::<AtomicU32>::default(), Arc::<AtomicBool>::default());
        let player = spawn({
            let (prefix, pressed, end) = (prefix.clone(), Arc::clone(&pressed), Arc::clone(&end));
            move || play(&prefix, &pressed, &end)
        });
        Self { pressed, end, player: Some(player) }
    }

    /// Presses the emergency stop for so many readings, and waits until it is released.
    fn press(&self, readings: u32) {
        self.pressed.store(readings + 1, Ordering::Release);
        wait_for("the release", || (self.pressed.load(Ordering::Acquire) == 0).then_some(()));
    }
}

impl Drop for Encoders {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Release);
        if let Some(player) = self.player.take() {
            let _ = player.join();
        }
    }
}

fn play(prefix: &Prefix, pressed: &AtomicU32, end: &AtomicBool) {
    let channels = Group::join(prefix, "encoders").unwrap();
    let readings = channels.publisher::<EncoderReading>().unwrap();
    let mut due = monotonic_ns();
    for sequence in 0.. {
        if end.load(Ordering::Acquire) {
            break;
        }
        due += READING_NS;
        sleep_until(due);
        let now = monotonic_ns();
        let header = Header { sequence, acquired_ns: now, sent_ns: now, axis_count: AXES as u32, ..Header::default() };
        let mut reading = EncoderReading { header, ..EncoderReading::default() };
        for (encoder, counts) in reading.encoders.iter_mut().zip(COUNTS) {
            encoder.counts = counts;
        }
        let left = pressed.load(Ordering::Acquire);
        reading.emergency_stop = u32::from(left > 1);
        readings.send(&reading).unwrap();
        if left > 0 {
            pressed.store(left - 1, Ordering::Release);
        }
    }
}

/// Row 34: sensor-proc passes every pulse of 4 ms on, at whatever time in its period, also one of a single reading.
#[test]
fn row_34_no_short_pulse_of_the_emergency_stop_is_lost_at_any_phase() {
    let _cores = shared();
    let group = TestGroup::new("row-34-phase");
    let machine = Machine::four_axes(&[]).unwrap();
    let encoders = Encoders::start(&group.prefix);
    let mut stops = Stops::new(Board::of(&group.prefix, &machine).unwrap());
    let channels = group.join();
    let mut samples: Reader<EncoderSample> = channels.reader().unwrap();
    let end = Arc::<AtomicBool>::default();
    let options = StageOptions {
        prefix: group.prefix.clone(),
        clock: Clock::RealTime,
        ticks: None,
        seed: 1,
        arm: false,
        first_tick: 0,
        is_recorded: false,
        warn: false,
        stop: Arc::clone(&end),
        reset: Arc::default(),
        off: Arc::default(),
    };
    let stage = spawn(move || sensor_proc::process::run(&machine, options));
    await_message(&mut samples, "the first sample", |_| true);
    let mut dice = Dice::new("pulses", "HYDRAXIS_CHAOS_SEED", "200 pulses");
    let mut in_samples = 0;
    for _ in 0..200 {
        sleep(Duration::from_micros(dice.below(20_000)));
        while samples.read().unwrap().if_new().is_some() {}
        encoders.press(dice.one_of(&[1, 2, PULSE, PULSE]));
        wait_for("the pulse on the board", || stops.take().emergency.then_some(()));
        while let Some(sample) = samples.read().unwrap().if_new() {
            in_samples += u32::from(sample.emergency_stop != 0);
        }
    }
    end.store(true, Ordering::Release);
    stage.join().unwrap().unwrap();
    eprintln!("row 34: 200 pulses of 1 to 4 readings, all on the board; {in_samples} samples show one");
    // Otherwise the samples alone would do, and this test would show nothing.
    assert!(in_samples < 190, "{in_samples}");
}

/// Row 34: every pulse of 4 ms latches, also while sensor-proc or control-proc is stopped and late afterwards.
#[test]
fn row_34_a_short_pulse_of_the_emergency_stop_latches_also_while_stages_are_late() {
    let _cores = shared();
    let mut group = TestGroup::new("row-34-pulse");
    let prefix = group.prefix.to_string();
    let encoders = Encoders::start(&group.prefix);
    let channels = group.join();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    // With this time-out a stage that is stopped latches nothing by itself.
    let patient = ["--set", "timing.feedback_timeout=5s"];
    let sensor = group.start(StageKind::SensorProc, &patient);
    let control = group.start(StageKind::ControlProc, &patient);
    let mut dice = Dice::new("pulses", "HYDRAXIS_CHAOS_SEED", "25 pulses");
    let released = |command: &ValveCommand| {
        command.cut_off == 0 && command.axes[..AXES].iter().all(|axis| axis.flags & control_flag::DISARMED != 0)
    };
    let latched = |command: &ValveCommand| {
        let mut axes = command.axes[..AXES].iter();
        command.cut_off == 1 && axes.all(|axis| axis.flags & control_flag::EMERGENCY_STOP != 0 && axis.command == 0.0)
    };
    let mut longest = Duration::ZERO;
    let stopped = [(None, 0), (Some(control), 60), (Some(sensor), 25), (Some(sensor), 60), (Some(sensor), 200)];
    for (pid, milliseconds) in (0..5).flat_map(|_| stopped) {
        await_message(&mut commands, "released axes", released);
        sleep(Duration::from_micros(dice.below(10_000)));
        pid.into_iter().for_each(|pid| signal(pid, Signal::STOP));
        // The pulse comes at any time of the stop.
        let before =
            Duration::from_micros(dice.below(1000 * milliseconds + 1)).saturating_sub(Duration::from_millis(5));
        sleep(before);
        encoders.press(PULSE);
        sleep(Duration::from_millis(milliseconds).saturating_sub(before));
        pid.into_iter().for_each(|pid| signal(pid, Signal::CONT));
        let from_ns = monotonic_ns();
        let command = await_message(&mut commands, &format!("the latch, {milliseconds} ms"), latched);
        longest = longest.max(Duration::from_nanos(command.header.sent_ns.saturating_sub(from_ns)));
        succeed(&["reset", "--prefix", &prefix]);
    }
    eprintln!("row 34: 25 pulses, latched within {longest:.1?} of the release of the input or of the late stage");
    drop((commands, channels));
}
