//! Each bound ends the experiment, and the command stays neutral afterwards. Machines of many kinds stay within the
//! bounds.

use std::collections::VecDeque;

use super::*;
use control_proc::commission::{Abort, Phase};
use pipeline::{
    machine::{Axis, DeadBand},
    message::{AxisSample, sample_fault},
};

/// An axis with dead band 0.1, dead time 50 ms, lag 50 ms and 1 m/s at full opening, and with possible faults.
struct Servo {
    position: f64,
    spool: f64,
    under_way: [f64; 5],
    gain: f64,
    drift: f64,
}

impl Servo {
    fn new() -> Self {
        Self { position: 0.65, spool: 0.0, under_way: [0.0; 5], gain: 1.0, drift: 0.0 }
    }

    fn step(&mut self, command: f64) {
        self.under_way.rotate_right(1);
        self.spool += 0.18 * (self.under_way[0] - self.spool);
        self.under_way[0] = command;
        let opening = (self.spool.abs() - 0.1).max(0.0).copysign(self.spool);
        self.position += 0.01 * (self.gain * opening + self.drift);
    }

    fn sample(&self) -> AxisSample {
        AxisSample { position: (self.position * 1e4).round() / 1e4, ..AxisSample::default() }
    }
}

fn boom() -> Axis {
    under("nominal").axes[0].clone()
}

/// Runs an experiment to its abort with a servo that `change` changes at each tick. Expects a neutral command
/// afterwards.
fn abort(
    options: &ExperimentOptions,
    mut change: impl FnMut(Phase, &mut Servo, &mut AxisSample),
) -> (Abort, Experiment) {
    let mut servo = Servo::new();
    let mut experiment = Experiment::new(&boom(), &under("nominal").timing, options);
    for _ in 0..10_000 {
        let mut sample = servo.sample();
        change(experiment.phase(), &mut servo, &mut sample);
        let command = experiment.update(Some(&sample));
        servo.step(command);
        if let Some(outcome) = experiment.outcome() {
            assert_eq!(command, 0.0);
            let Outcome::Aborted(abort) = outcome else { panic!("finished") };
            for _ in 0..500 {
                let sample = servo.sample();
                assert_eq!(experiment.update(Some(&sample)), 0.0, "after {abort}");
                servo.step(0.0);
            }
            assert_eq!(experiment.outcome(), Some(outcome), "the first reason stays");
            println!("{abort}");
            return (abort, experiment);
        }
    }
    panic!("no end");
}

#[test]
fn readings_that_fail_to_come_are_waited_for_at_neutral_until_the_time_out() {
    let commissioned = |gap: usize| {
        let mut machine = under("nominal");
        machine.timing.feedback_timeout = Duration::from_millis(300);
        let mut servo = Servo::new();
        let mut experiment = Experiment::new(&boom(), &machine.timing, &minute());
        for tick in 0.. {
            let mut sample = servo.sample();
            let missing = tick % 1000;
            let is_missing = tick >= 1000 && missing < gap;
            if is_missing {
                sample.faults = sample_fault::STALE;
            }
            // A sample may be missing as well as a reading in it.
            let command = experiment.update(Some(&sample).filter(|_| !is_missing || missing % 2 == 0));
            servo.step(command);
            assert!(tick < 1000 || !(2..gap).contains(&missing) || command == 0.0, "tick {tick}: {command}");
            if let Some(outcome) = experiment.outcome() {
                return (outcome, experiment);
            }
        }
        unreachable!()
    };
    let (outcome, experiment) = commissioned(20);
    assert_eq!(outcome, Outcome::Finished);
    let found = control_proc::commission::analyse(experiment.record()).unwrap();
    assert!((found.dead_time - 0.05).abs() < 0.01 && (found.time_constant - 0.05).abs() < 0.01, "{found:?}");
    let faults = sample_fault::STALE;
    assert_eq!(commissioned(30).0, Outcome::Aborted(Abort::Feedback { faults }));
}

#[test]
fn the_servo_itself_is_commissioned() {
    let mut servo = Servo::new();
    let mut experiment = Experiment::new(&boom(), &under("nominal").timing, &minute());
    while experiment.outcome().is_none() {
        servo.step(experiment.update(Some(&servo.sample())));
    }
    assert_eq!(experiment.outcome(), Some(Outcome::Finished));
    let found = control_proc::commission::analyse(experiment.record()).unwrap();
    // The command of tick k is in the spool from k + 5 on; 0.18 in 10 ms is 50 ms.
    println!("{found:?}");
    assert!((found.dead_time - 0.05).abs() < 0.01 && (found.time_constant - 0.05).abs() < 0.01, "{found:?}");
    assert!((found.dead_band.extend - 0.1).abs() < 0.003 && (found.dead_band.retract - 0.1).abs() < 0.003, "{found:?}");
    assert!(found.fit_percent > 99.0, "{found:?}");
    for opening in [0.05, 0.1, 0.2] {
        assert!((found.speed(0.1 + opening) / opening - 1.0).abs() < 0.03, "{opening}: {}", found.speed(0.1 + opening));
        assert!((-found.speed(-0.1 - opening) / opening - 1.0).abs() < 0.03, "{opening}");
    }
}

#[test]
fn an_axis_that_moves_without_a_command_ends_the_experiment() {
    let (reason, _) = abort(&minute(), |phase, servo, _| servo.drift = if phase == Phase::Random { 0.3 } else { 0.0 });
    assert!(matches!(reason, Abort::Speed { .. } | Abort::Against { .. } | Abort::Window { .. }), "{reason}");
    let (reason, _) = abort(&minute(), |_, servo, _| servo.drift = -0.05);
    assert!(matches!(reason, Abort::Against { command: 0.0, .. }), "an axis that moves without a command: {reason}");
}

#[test]
fn a_speed_beyond_the_bound_ends_the_experiment() {
    let (reason, _) = abort(&minute(), |phase, servo, _| servo.gain = if phase == Phase::Random { 3.0 } else { 1.0 });
    let Abort::Speed { found, allowed } = reason else { panic!("{reason}") };
    assert!(found > allowed && (allowed - 1.5 * 0.25).abs() < 1e-12, "{reason}");
    assert!(reason.to_string().contains("a greater --speed"), "{reason}");
}

#[test]
fn a_creep_out_of_the_window_ends_the_experiment() {
    let (reason, experiment) =
        abort(&minute(), |phase, servo, _| servo.drift = if phase == Phase::Pulses { 0.02 } else { 0.0 });
    let Abort::Creep { position, speed, .. } = reason else { panic!("{reason}") };
    let ((_, high), margin) = experiment.window();
    assert!(position > high + margin && position < high + margin + 0.01, "{reason}");
    assert!((speed - 0.02).abs() < 2e-3, "{reason}");
    assert!(reason.to_string().contains("at neutral it goes by +2"), "{reason}");
}

#[test]
fn an_axis_that_leaves_the_window_under_commands_is_asked_for_a_wider_one() {
    let (reason, _) = abort(&minute(), |phase, servo, _| {
        (servo.gain, servo.drift) = if phase == Phase::Random { (0.1, 0.04) } else { (1.0, 0.0) }
    });
    assert!(matches!(reason, Abort::Window { .. }), "{reason}");
    assert!(reason.to_string().ends_with("a wider --travel or a smaller --speed"), "{reason}");
}

#[test]
fn a_slow_axis_has_the_time_to_show_a_motion() {
    // 5 mm/s at the highest level of the pulses: 1 mm in half a second only just, behind its dead time and lag.
    let slow = Axis { max_speed: 0.02, ..boom() };
    let mut servo = Servo { gain: 0.006, ..Servo::new() };
    let options = ExperimentOptions { duration: Duration::from_secs(120), ..minute() };
    let mut experiment = Experiment::new(&slow, &under("nominal").timing, &options);
    while experiment.outcome().is_none() {
        servo.step(experiment.update(Some(&servo.sample())));
    }
    assert_eq!(experiment.outcome(), Some(Outcome::Finished));
}

#[test]
fn an_axis_outside_its_soft_limits_does_not_begin_the_experiment() {
    let (reason, experiment) = abort(&minute(), |_, servo, sample| {
        servo.position = 0.03;
        sample.position = 0.03;
    });
    assert!(matches!(reason, Abort::Start { .. }), "{reason}");
    assert!(reason.to_string().contains("the soft_limits: move the axis there with `hydraxis operate`"), "{reason}");
    assert!(experiment.record().commands.iter().all(|command| *command == 0.0));
}

#[test]
fn without_motion_the_abort_asks_for_the_pump() {
    let (reason, experiment) = abort(&minute(), |_, servo, _| servo.gain = 0.0);
    assert!(matches!(reason, Abort::NoMotion { extend: true, level: 0.6, .. }), "{reason}");
    assert!(reason.to_string().contains("is the pump on, and control.command_limit beyond"), "{reason}");
    assert!(experiment.record().commands.iter().all(|command| command.abs() <= 0.6));
    // A pump that fails later.
    let (reason, _) = abort(&minute(), |phase, servo, _| servo.gain = if phase == Phase::Strokes { 0.0 } else { 1.0 });
    assert!(matches!(reason, Abort::NoMotion { .. }), "{reason}");
}

#[test]
fn a_reversed_sign_ends_the_experiment() {
    let (reason, _) = abort(&minute(), |_, servo, _| servo.gain = -1.0);
    assert!(matches!(reason, Abort::Against { .. }), "{reason}");
    assert!(reason.to_string().ends_with("are valve and encoder of the same sign?"), "{reason}");
    // An axis that has followed has the right sign.
    let (reason, _) = abort(&minute(), |phase, servo, _| servo.gain = if phase == Phase::Random { -1.0 } else { 1.0 });
    assert!(matches!(reason, Abort::Against { .. }), "{reason}");
    assert!(reason.to_string().contains("followed both directions before, so its load swings or sinks"), "{reason}");
}

#[test]
fn a_stuck_encoder_ends_the_experiment() {
    let mut held = None;
    let (reason, _) = abort(&minute(), |phase, _, sample| {
        if phase == Phase::Random {
            sample.position = *held.get_or_insert(sample.position);
        }
    });
    assert!(matches!(reason, Abort::Stuck { .. }), "{reason}");
}

#[test]
fn steps_too_short_to_open_the_valve_are_no_stuck_encoder() {
    let mut servo = Servo::new();
    let options = ExperimentOptions { seed: 5, ..minute() };
    let mut experiment = Experiment::new(&boom(), &under("nominal").timing, &options);
    // The pump needs 200 ms to raise its pressure, so the short ones of the random steps move nothing.
    let mut open = 0;
    while experiment.outcome().is_none() {
        open = if servo.spool.abs() > 0.1 { open + 1 } else { 0 };
        servo.gain = if experiment.phase() == Phase::Random && open < 20 { 0.0 } else { 1.0 };
        servo.step(experiment.update(Some(&servo.sample())));
    }
    assert_eq!(experiment.outcome(), Some(Outcome::Finished));
}

#[test]
fn a_valve_that_opens_long_after_the_pulses_is_commissioned() {
    // The level at which a pulse has moved the axis is far above the dead band then, and little more is many times as
    // fast as a parabola from there.
    for (dead_time, lag) in [(25, 0.05), (30, 0.04)] {
        let mut servo = Servo { gain: 1.3, ..Servo::new() };
        let mut experiment = Experiment::new(&boom(), &under("nominal").timing, &minute());
        let (mut under_way, mut pilot) = (VecDeque::from(vec![0.0; dead_time]), 0.0);
        while experiment.outcome().is_none() {
            under_way.push_back(experiment.update(Some(&servo.sample())));
            pilot += lag * (under_way.pop_front().unwrap_or_default() - pilot);
            servo.step(pilot);
        }
        assert_eq!(experiment.outcome(), Some(Outcome::Finished), "{dead_time} ticks");
    }
}

#[test]
fn lost_feedback_ends_the_experiment_after_three_samples() {
    for faults in [sample_fault::STALE, sample_fault::SPEED, sample_fault::ENCODER] {
        let mut ticks = 0;
        let (reason, experiment) = abort(&minute(), |phase, _, sample| {
            if phase == Phase::Strokes {
                ticks += 1;
                sample.faults = faults;
            }
        });
        assert_eq!((reason, ticks), (Abort::Feedback { faults }, 3));
        let commands = &experiment.record().commands;
        assert_eq!(commands.last(), Some(&0.0));
    }
    let (reason, _) = abort(&minute(), |phase, _, sample| {
        sample.faults = if phase == Phase::Pulses { sample_fault::RANGE } else { 0 };
    });
    assert_eq!(reason, Abort::Feedback { faults: sample_fault::RANGE });
    let (reason, _) = abort(&minute(), |phase, _, sample| {
        if phase == Phase::Pulses {
            sample.position = f64::NAN;
        }
    });
    assert!(matches!(reason, Abort::Feedback { .. }), "{reason}");
}

#[test]
fn one_or_two_missing_samples_are_bridged() {
    let mut servo = Servo::new();
    let mut experiment = Experiment::new(&boom(), &under("nominal").timing, &minute());
    let mut tick = 0;
    while experiment.outcome().is_none() {
        let sample = servo.sample();
        servo.step(experiment.update((tick % 50 > 1).then_some(&sample)));
        tick += 1;
    }
    assert_eq!(experiment.outcome(), Some(Outcome::Finished));
    assert!(experiment.record().positions.iter().any(|position| position.is_nan()));
    let found = control_proc::commission::analyse(experiment.record()).unwrap();
    assert!(found.fit_percent > 97.0, "{found:?}");
}

#[test]
fn a_window_that_is_too_small_and_a_time_that_is_too_short_are_refused() {
    let (reason, _) = abort(&ExperimentOptions { travel: Some(0.01), ..minute() }, |_, _, _| ());
    assert!(matches!(reason, Abort::TooSmall { .. }) && reason.to_string().contains("a wider --travel"), "{reason}");
    let (reason, _) = abort(&ExperimentOptions { duration: Duration::from_secs(12), ..minute() }, |_, _, _| ());
    assert!(matches!(reason, Abort::TooShort { .. }) && reason.to_string().contains("a longer --duration"), "{reason}");
}

#[test]
fn the_experiment_can_be_stopped_at_any_time() {
    let mut servo = Servo::new();
    let mut experiment = Experiment::new(&boom(), &under("nominal").timing, &minute());
    while experiment.phase() != Phase::Random {
        servo.step(experiment.update(Some(&servo.sample())));
    }
    experiment.stop();
    assert_eq!(experiment.update(Some(&servo.sample())), 0.0);
    assert_eq!(experiment.outcome(), Some(Outcome::Aborted(Abort::Stopped)));
}

#[test]
fn machines_of_all_kinds_stay_in_the_window() {
    let mut random = 7u64;
    let mut uniform = move |low: f64, high: f64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (random >> 11) as f64 / (1u64 << 53) as f64
    };
    let nominal = under("nominal");
    let mut machine_of = |seed: u64| {
        let mut machine = nominal.clone();
        let axis = (seed % 4) as usize;
        machine.axes = vec![machine.axes[axis].clone()];
        let (low, high) = machine.axes[0].soft_limits;
        let plant = machine.axes[0].plant.as_mut().unwrap();
        plant.dead_time = uniform(0.0, 0.5);
        plant.dead_band.extend = uniform(0.02, 0.4);
        plant.dead_band.retract = uniform(0.02, 0.4);
        plant.rated_flow *= uniform(0.5, 1.5);
        plant.mass *= uniform(0.5, 2.0);
        let load = uniform(0.3, 1.5);
        let force = &mut plant.load_force;
        (force.retracted, force.middle, force.extended) =
            (load * force.retracted, load * force.middle, load * force.extended);
        plant.initial_position = uniform(low + 0.02, high - 0.02);
        if seed.is_multiple_of(3) {
            plant.valve_curve = pipeline::machine::ValveCurve::S;
            plant.saturation.extend = plant.dead_band.extend + uniform(0.3, 0.5);
            plant.saturation.retract = plant.dead_band.retract + uniform(0.3, 0.5);
        }
        (seed, machine)
    };
    let machines: Vec<(u64, Machine)> = (0..200).map(&mut machine_of).collect();
    let runs = in_parallel(&machines, |(seed, machine)| {
        Run::of(machine, 0, &ExperimentOptions { seed: *seed, ..minute() }, *seed)
    });
    let (mut worst, mut ended) = (f64::NEG_INFINITY, 0);
    for ((seed, machine), run) in machines.iter().zip(&runs) {
        let start = machine.axes[0].plant.as_ref().unwrap().initial_position;
        let ((low, high), margin) = run.experiment.window();
        worst = worst.max(run.beyond);
        if run.experiment.outcome() != Some(Outcome::Finished) {
            ended += 1;
            println!("{seed}: start {start:.3} in {low:.3} to {high:.3}: {}", run.reason());
        }
        assert!(run.beyond <= margin, "{seed}: {} m beyond {low} to {high}, margin {margin}", run.beyond);
    }
    // A few experiments end early and safely: a boom that swings, or an end of the window that is near.
    assert!(ended <= 8, "{ended}");
    println!("worst {:.1} mm beyond the window; {ended} of 200 ended early", 1e3 * worst);
}

/// Machines that experiments once refused: with coarse encoders, or with valves so fast that a stroke follows within
/// half a second of the one before. They move as they are commanded.
#[test]
fn coarse_encoders_and_fast_valves_are_no_reason_to_refuse() {
    let mut cases = Vec::new();
    for resolution in [4e-4, 8e-4] {
        for (extend, retract) in [(0.1, 0.1), (0.37, 0.23), (0.13, 0.27)] {
            for (dead_time, time_constant) in [(0.01, 0.004), (0.1, 0.05), (0.35, 0.03)] {
                for axis in 0..4 {
                    let mut machine = under("nominal");
                    let settings = &mut machine.axes[axis];
                    settings.encoder.resolution = resolution;
                    let plant = settings.plant.as_mut().unwrap();
                    plant.sensor_errors.encoder_noise = 0.3 * resolution;
                    plant.dead_band = DeadBand { extend, retract };
                    (plant.dead_time, plant.valve_time_constant) = (dead_time, time_constant);
                    cases.push((
                        format!("{resolution} m, {extend}, {retract}, {dead_time} s, axis {axis}"),
                        machine,
                        axis,
                    ));
                }
            }
        }
    }
    let reasons = in_parallel(&cases, |(name, machine, axis)| {
        let run = Run::of(machine, *axis, &minute(), 1);
        (run.experiment.outcome() != Some(Outcome::Finished)).then(|| format!("{name}: {}", run.reason()))
    });
    let refused: Vec<String> = reasons.into_iter().flatten().collect();
    assert!(refused.is_empty(), "{} of {} refused:\n{}", refused.len(), cases.len(), refused.join("\n"));
}

/// The pump sees the load through an open valve alone, and takes a second to come up to the pressure that lifts it.
#[test]
fn pulses_and_strokes_wait_for_a_slow_pump() {
    let machine =
        |response: &str| Machine::load(None, &[("supply.response_time".to_owned(), response.to_owned())]).unwrap();
    for response in ["0.1", "0.2", "0.3"] {
        Run::of(&machine(response), 0, &ExperimentOptions::default(), 1).expect_finished();
    }
}
