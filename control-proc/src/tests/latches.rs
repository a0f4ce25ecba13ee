//! Faults that latch an axis, other than lost feedback; and the emergency stop.

use pipeline::message::{AxisMode, ControlMode, EncoderSample, ValveCommand, control_flag, model_fault, sample_fault};

use super::{Loop, SINES, machine, machine_with, models::actuator, modes::Operated, plant::Actuator, sample, snapshot};
use crate::{Controller, axis::UNSOLVED_LIMIT};

/// A reference of 0.15 m/s at all times, to and fro.
const RAMPS: &str = "kind = \"ramps\"\ntimes = [0.0, 4.0, 8.0]\npositions = [0.35, 0.95, 0.35]\n";

fn press(sample: &mut EncoderSample) {
    sample.emergency_stop = 1;
}

/// Whether the axis is neutral and latched by this cause.
fn is_latched(command: &ValveCommand, cause: u32) -> bool {
    let axis = command.axes[0];
    let is_neutral = axis.command == 0.0 && axis.mode == ControlMode::Neutral as u32;
    is_neutral && axis.flags & control_flag::LATCHED == cause && axis.operation == AxisMode::Off as u32
}

/// Whether the axis stays latched by this cause for a second of healthy ticks after another `arm`, until it is
/// disarmed.
fn stays_latched(axis: &mut Loop, cause: u32) -> bool {
    axis.controller.arm();
    let stays = axis.run(100, Some(actuator())).iter().all(|command| is_latched(command, cause));
    // Another fault does not replace the first one.
    axis.controller.feedback_lost();
    let keeps = axis.controller.is_latched() && is_latched(&axis.tick(None), cause);
    axis.controller.disarm();
    stays && keeps && !axis.controller.is_latched()
}

/// Ticks until a fault latches the axis, 300 at most.
fn until_latched(axis: &mut Loop, mut tick: impl FnMut(&mut Loop) -> ValveCommand) -> usize {
    (0..300).take_while(|_| tick(axis).axes[0].flags & control_flag::LATCHED == 0).count()
}

#[test]
fn an_encoder_that_repeats_itself_latches_without_a_fault_bit_of_the_sample() {
    let mut axis = Loop::new(&machine_with(SINES, RAMPS), 0.05);
    axis.run(500, Some(actuator()));
    let frozen = (axis.plant.position * 1e4).round() / 1e4;
    let ticks = until_latched(&mut axis, |axis| {
        let model = snapshot(axis.sequence - 1, actuator());
        axis.tick_with(Some(&model), None, |sample| sample.axes[0].position = frozen)
    });
    // 300 ms and the dead time of 50 ms.
    assert!((25..=35).contains(&ticks), "{ticks}");
    assert!(stays_latched(&mut axis, control_flag::FEEDBACK));
}

#[test]
fn two_unusable_samples_in_three_latch_and_one_in_six_does_not() {
    let latched_after = |bad: u64, of: u64| {
        let mut axis = Loop::new(&machine_with(SINES, RAMPS), 0.05);
        axis.run(500, Some(actuator()));
        (0..1000).find(|k| {
            let model = snapshot(axis.sequence - 1, actuator());
            let is_bad = k % of < bad;
            let command = axis.tick_with(Some(&model), None, |sample| {
                sample.axes[0].faults = if is_bad { sample_fault::ENCODER } else { 0 };
            });
            command.axes[0].flags & control_flag::FEEDBACK != 0
        })
    };
    assert!(latched_after(2, 3).is_some_and(|ticks| ticks < 20), "{:?}", latched_after(2, 3));
    assert!(latched_after(1, 2).is_some_and(|ticks| ticks < 30), "{:?}", latched_after(1, 2));
    assert_eq!((latched_after(1, 6), latched_after(2, 12)), (None, None));
}

#[test]
fn a_source_that_has_started_again_latches_and_is_followed_after_a_reset() {
    let mut axis = Loop::new(&machine_with(SINES, RAMPS), 0.05);
    axis.run(500, Some(actuator()));
    axis.sequence = 0;
    let again = |sample: &mut EncoderSample| sample.header.session = 7;
    let command = axis.tick_with(None, None, again);
    assert_ne!(command.axes[0].flags & control_flag::FEEDBACK, 0);
    assert_eq!(command.axes[0].command, 0.0);
    for _ in 0..10 {
        let command = axis.tick_with(None, None, again);
        assert_ne!(command.axes[0].flags & control_flag::FEEDBACK, 0, "it stays latched");
    }
    axis.controller.disarm();
    axis.controller.arm();
    let is_followed = |command: ValveCommand| command.axes[0].mode == ControlMode::Fallback as u32;
    let follows = (0..200).any(|_| is_followed(axis.tick_with(None, None, again)));
    assert!(follows, "it follows the new numbers");
}

#[test]
fn an_axis_without_supply_stalls_within_half_a_second_and_does_not_move_when_the_supply_is_back() {
    for model in [None, Some(actuator())] {
        let mut axis = Loop::new(&machine_with(SINES, RAMPS), 0.05);
        axis.run(500, model);
        let stood = axis.plant.position;
        let ticks = until_latched(&mut axis, |axis| {
            let flicker = 1e-4 * (axis.sequence % 2) as f64;
            let fresh = model.map(|model| snapshot(axis.sequence - 1, model));
            axis.plant.position = stood;
            axis.tick_with(fresh.as_ref(), None, |sample| sample.axes[0].position += flicker)
        });
        assert!((40..=50).contains(&ticks), "{ticks}");
        // The supply is back a little later; the axis does not move.
        axis.run(30, model);
        axis.plant.position = stood;
        axis.run(300, model);
        assert!((axis.plant.position - stood).abs() < 1e-3, "{}", axis.plant.position - stood);
        assert!(stays_latched(&mut axis, control_flag::STALL));
    }
}

#[test]
fn in_manual_an_axis_may_stand_against_an_obstacle() {
    let mut axis = Operated::new();
    axis.enable(AxisMode::Manual);
    for k in 0..200 {
        axis.axis.plant.position = 0.6 + 1e-4 * f64::from(k % 2);
        let command = axis.ask(AxisMode::Manual, 0.5, None).axes[0];
        assert_eq!(command.flags & control_flag::LATCHED, 0);
    }
}

#[test]
fn an_axis_that_is_too_far_from_its_reference_for_too_long_is_stopped() {
    let mut machine = machine_with(SINES, "kind = \"hold\"\n");
    machine.axes[0].control.following_error = 0.03;
    // The axis is off by `off` m for `long` ticks. At rest the bound is its floor.
    let latched = |off: f64, long: usize| {
        let mut axis = Loop::new(&machine, 0.0);
        axis.run(100, Some(actuator()));
        let from = axis.plant.position;
        for k in 0..40 {
            let flicker = 1e-4 * (k % 2) as f64;
            let model = snapshot(axis.sequence - 1, actuator());
            axis.plant.position = if k < long { from + off + flicker } else { from };
            let command = axis.tick(Some(&model));
            if command.axes[0].flags & control_flag::LATCHED != 0 {
                assert!(is_latched(&command, control_flag::FOLLOWING), "{off} {k}: {:?}", command.axes[0]);
                assert!(stays_latched(&mut axis, control_flag::FOLLOWING));
                return Some(k);
            }
        }
        None
    };
    // The twentieth tick is 190 ms after the first.
    assert_eq!(latched(0.031, 40), Some(19));
    assert_eq!(latched(-0.031, 40), Some(19));
    assert_eq!(latched(0.031, 19), None);
    assert_eq!(latched(0.0298, 40), None);
}

#[test]
fn plans_without_an_answer_are_counted_and_five_in_a_row_latch() {
    let mut machine = machine(1);
    // With this weight the cost of every plan is not finite.
    machine.axes[0].control.plan.move_weight = Some(f64::INFINITY);
    // A model has expired at the next tick.
    let lifetime = machine.timing.period / 2;
    (machine.timing.model_timeout, machine.timing.model_lifetime) = (lifetime, lifetime);
    // Unsolved plans for `plans` ticks in a row, then no plan for as many ticks.
    let run = |plans: u64| {
        let mut axis = Loop::new(&machine, 0.05);
        axis.run(200, None);
        let commands: Vec<_> = (0..60)
            .map(|k| {
                let mut fresh = snapshot(axis.sequence - 1, actuator());
                if k / plans % 2 == 1 {
                    fresh.axes[0].faults = model_fault::TRAINING;
                }
                axis.tick(Some(&fresh))
            })
            .collect();
        (axis, commands)
    };
    let (mut axis, commands) = run(5);
    let latched = commands.iter().position(|command| command.axes[0].flags & control_flag::LATCHED != 0);
    assert_eq!(latched, Some(UNSOLVED_LIMIT as usize - 1));
    for (k, command) in commands[..4].iter().enumerate() {
        // Meanwhile the fallback controls.
        let axis = command.axes[0];
        assert_eq!((axis.mode, axis.unsolved_plans), (ControlMode::Fallback as u32, k as u64 + 1));
        assert_ne!(axis.flags & control_flag::MODEL_REFUSED, 0);
    }
    assert!(is_latched(&commands[10], control_flag::SOLVER));
    assert!(stays_latched(&mut axis, control_flag::SOLVER));
    let commands = run(4).1;
    assert!(commands.iter().all(|command| command.axes[0].flags & control_flag::LATCHED == 0));
    assert!(commands[59].axes[0].unsolved_plans >= 28);
}

#[test]
fn a_latch_from_outside_acts_at_once_and_the_neutral_message_shows_its_cause() {
    for cause in [control_flag::DEADLINE, control_flag::FEEDBACK] {
        let mut axis = Loop::new(&machine(1), 0.0);
        axis.run(300, Some(actuator()));
        axis.controller.latch(cause);
        let neutral = axis.controller.neutral(7);
        assert_eq!((neutral.header.sequence, neutral.cut_off), (7, 0));
        assert!(is_latched(&neutral, cause));
        assert!(stays_latched(&mut axis, cause));
    }
}

#[test]
fn an_emergency_stop_is_neutral_in_the_same_tick_in_every_mode_and_cuts_the_pilot_off_until_it_is_reset() {
    for mode in [AxisMode::Off, AxisMode::Manual, AxisMode::Hold, AxisMode::Track, AxisMode::Commission] {
        let mut axis = Operated::new();
        if mode != AxisMode::Off {
            axis.enable(mode);
            let before = axis.asks(60, mode, 0.3, Some(0.9))[59];
            assert!(before.axes[0].command != 0.0 && before.cut_off == 0, "{mode:?}");
        }
        let pressed = axis.ask_with(mode, 0.3, press);
        assert!(is_latched(&pressed, control_flag::EMERGENCY_STOP) && pressed.cut_off == 1, "{mode:?}");
        assert_eq!(axis.axis.controller.neutral(0).cut_off, 1);
        // While the stop is pressed, every kind of reset is refused.
        let refused = pressed.axes[0].refused_requests;
        let off = axis.ask_with(AxisMode::Off, 0.0, press);
        assert!(is_latched(&off, control_flag::EMERGENCY_STOP) && off.cut_off == 1, "{mode:?}");
        assert_ne!(off.axes[0].flags & control_flag::REQUEST, 0);
        assert_eq!(off.axes[0].refused_requests, refused + 1);
        axis.axis.controller.disarm();
        axis.axis.controller.arm();
        assert_eq!(axis.axis.controller.neutral(0).cut_off, 1);
        // After the stop is released, the axis stays latched and the pilot cut off.
        axis.enable += 1;
        let again = if mode == AxisMode::Off { AxisMode::Manual } else { mode };
        for command in axis.asks(50, again, 0.3, None) {
            assert!(is_latched(&command, control_flag::EMERGENCY_STOP) && command.cut_off == 1, "{mode:?}");
        }
        let off = axis.ask(AxisMode::Off, 0.0, None);
        assert_eq!((off.axes[0].flags & control_flag::LATCHED, off.cut_off), (0, 0), "{mode:?}");
        axis.enable(AxisMode::Manual);
        assert!(axis.ask(AxisMode::Manual, 0.3, None).axes[0].command > 0.0);
    }
}

/// Regression: the other axes stayed armed without pressure and would have jumped when it came back.
#[test]
fn an_axis_whose_pressure_another_one_has_cut_off_is_disarmed() {
    let mut controller = Controller::new(&machine(2)).unwrap();
    controller.arm();
    let mut plants = [Actuator::new(0.6, 0.05), Actuator::new(0.6, 0.05)];
    let mut commands = (0..400).map(|tick| {
        let mut sample = sample(tick, &plants.each_ref().map(|plant| plant.position));
        if tick >= 300 {
            sample.axes[1].faults = sample_fault::RUNAWAY | sample_fault::SPEED;
        }
        if tick == 350 {
            controller.arm();
        }
        let command = controller.update(&sample, None, None);
        plants.iter_mut().zip(&command.axes).for_each(|(plant, axis)| plant.step(axis.command));
        command
    });
    let before = commands.nth(299).unwrap();
    assert_eq!((before.cut_off, before.axes[0].operation), (0, AxisMode::Track as u32));
    for command in commands {
        let [other, runaway] = [command.axes[0], command.axes[1]];
        assert_eq!((command.cut_off, runaway.flags & control_flag::LATCHED), (1, control_flag::MOTION));
        assert_eq!((other.command, other.operation), (0.0, AxisMode::Off as u32));
        assert_eq!(other.flags & (control_flag::DISARMED | control_flag::LATCHED), control_flag::DISARMED);
    }
}

/// Regression: an axis with a stuck spool that was disarmed on its way was found only after the whole way again.
#[test]
fn an_axis_that_runs_away_is_found_as_early_when_it_is_disarmed_on_its_way() {
    let latched_at = |disarm: bool| {
        let mut controller = Controller::new(&machine(1)).unwrap();
        // It stands for 10 s, and then goes with 0.1 m/s.
        (0..1200u64).find(|tick| {
            let noise = 1e-4 * (tick % 2) as f64;
            let position = 0.6 + 1e-3 * tick.saturating_sub(1000) as f64 + noise;
            if disarm && [1008, 1012].contains(tick) {
                controller.stop(pipeline::channel::Stop::ALL);
            }
            let command = controller.update(&sample(*tick, &[position]), None, None);
            command.axes[0].flags & control_flag::MOTION != 0
        })
    };
    let disarmed = latched_at(true).unwrap();
    assert!((1013..=1032).contains(&disarmed), "{disarmed}");
}
