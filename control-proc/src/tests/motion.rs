//! Starting, following, and switching between fallback and model.

use pipeline::message::{ControlMode, control_flag, model_fault};

use super::{Loop, SINES, machine, machine_with, models::actuator, snapshot};
use crate::Controller;

/// The largest change of command from tick to tick.
fn largest_step(commands: &[pipeline::message::ValveCommand]) -> f64 {
    commands.windows(2).map(|p| (p[1].axes[0].command - p[0].axes[0].command).abs()).fold(0.0, f64::max)
}

#[test]
fn pi_moves_an_axis_with_a_dead_band_to_its_reference() {
    let machine = machine_with(SINES, "kind = \"ramps\"\ntimes = [0.0, 1.0, 100.0]\npositions = [0.8, 0.8, 0.8]\n");
    let mut axis = Loop::new(&machine, 0.10);
    let commands = axis.run(1500, None);
    let end = commands[1499].axes[0];
    assert!((axis.plant.position - 0.8).abs() < 2e-3, "{}", axis.plant.position);
    assert_eq!((end.mode, end.flags), (ControlMode::Fallback as u32, control_flag::NO_MODEL));
    assert!(commands.iter().all(|c| c.axes[0].command.abs() <= 1.0));
}

#[test]
fn the_axis_starts_without_motion_and_without_a_jump() {
    for model in [None, Some(actuator())] {
        let mut axis = Loop::new(&machine(1), 0.0);
        let commands = axis.run(1000, model);
        for command in &commands[..20] {
            assert_eq!(command.axes[0].command, 0.0);
            assert_ne!(command.axes[0].flags & control_flag::SETTLING, 0);
        }
        // At the first tick that follows, the reference is where the axis stands.
        assert_eq!((commands[20].axes[0].command, commands[20].axes[0].error), (0.0, 0.0));
        assert!(largest_step(&commands[20..30]) < 0.02, "{}", largest_step(&commands[20..30]));
        assert!(largest_step(&commands) <= 0.1 + 1e-12);
        let speeds = commands.windows(2).skip(20).map(|p| (p[1].axes[0].reference - p[0].axes[0].reference).abs());
        assert!(speeds.fold(0.0, f64::max) < 1.0 * 0.01);
    }
}

#[test]
fn the_model_follows_a_sine_clearly_better_than_the_fallback() {
    let rmse = |model| {
        let mut axis = Loop::new(&machine(1), 0.0);
        let end = axis.run(3000, model)[2999].axes[0];
        assert_eq!(end.mode == ControlMode::Model as u32, model.is_some());
        assert_eq!(end.tracking.count, 3000 - 20 - 200);
        end.tracking.rmse()
    };
    let (fallback, model) = (rmse(None), rmse(Some(actuator())));
    println!("rmse: fallback {:.3} mm, model {:.3} mm", fallback * 1e3, model * 1e3);
    assert!(model < 0.2 * fallback, "fallback {fallback} m, model {model} m");
}

#[test]
fn the_tracking_errors_of_a_run_are_those_of_all_times_that_the_axis_was_armed() {
    let mut axis = Loop::new(&machine(1), 0.0);
    let first = axis.run(1000, None)[999].axes[0].tracking;
    assert_eq!(first.count, 1000 - 20 - 200);
    axis.controller.disarm();
    assert_eq!(axis.run(100, None)[99].axes[0].tracking, first, "nobody controls it");
    axis.controller.arm();
    let commands = axis.run(1000, Some(actuator()));
    assert_eq!(commands[219].axes[0].tracking, first, "it settles and approaches its reference");
    let end = commands[999].axes[0];
    assert_eq!((end.tracking.count, end.model_tracking.count), (2 * first.count, first.count));
    assert_eq!(end.tracking.max, first.max, "the model follows better than the fallback has done");
}

/// Regression: without the noise polynomial one count of the encoder moved the command by the whole rate limit.
#[test]
fn the_steps_of_the_encoder_do_not_shake_the_valve() {
    let commands = Loop::new(&machine(1), 0.0).run(3000, Some(actuator()));
    let squares = commands[300..].windows(2).map(|p| (p[1].axes[0].command - p[0].axes[0].command).powi(2));
    let rms = (squares.sum::<f64>() / 2699.0).sqrt();
    assert!(rms < 0.04, "{rms} of command from tick to tick");
}

#[test]
fn the_command_does_not_jump_when_the_model_takes_over_and_when_it_expires() {
    let mut machine = machine(1);
    let lifetime = std::time::Duration::from_millis(20);
    (machine.timing.model_timeout, machine.timing.model_lifetime) = (lifetime, lifetime);
    let mut axis = Loop::new(&machine, 0.0);
    let mut commands = axis.run(35, None);
    commands.extend(axis.run(400, Some(actuator())));
    // 10 ticks of probation, from tick 35 on.
    assert_eq!(commands[44].axes[0].mode, ControlMode::Fallback as u32);
    assert_eq!(commands[45].axes[0].mode, ControlMode::Model as u32);
    commands.extend(axis.run(10, None));
    // The last model was made after tick 433 and is used for two more ticks.
    let (last, first) = (commands[435].axes[0], commands[436].axes[0]);
    assert_eq!((last.mode, last.flags), (ControlMode::Model as u32, control_flag::NO_MODEL));
    let flags = control_flag::NO_MODEL | control_flag::MODEL_STALE | control_flag::HALF_SPEED;
    assert_eq!((first.mode, first.flags), (ControlMode::Fallback as u32, flags));
    assert!((first.command - last.command).abs() < 1e-9, "{} after {}", first.command, last.command);
    assert!(largest_step(&commands) <= 0.1 + 1e-12);
}

#[test]
fn a_stale_model_stays_in_use_and_after_its_lifetime_the_axis_goes_at_half_speed() {
    // A fast sine, of more than half of the axis' speed.
    let fast = machine_with("frequency = 0.3", "frequency = 0.6");
    let mut axis = Loop::new(&fast, 0.0);
    axis.run(400, Some(actuator()));
    let old = snapshot(399, actuator());
    // The default time-outs, 2 and 30 s: ticks 599 and 3399 are the last within them.
    let half = 0.07 + 0.5 * (1.0 - 0.07);
    let mut last = axis.controller.neutral(0).axes[0].command;
    let (mut slowed, mut stood) = (0, false);
    for k in 400..4400 {
        // A restarted identifier reports that it has no model yet. The last approved model stays in use.
        let mut restarted = snapshot(k - 1, actuator());
        restarted.axes[0].faults = model_fault::TRAINING;
        let command = axis.tick(Some(if k > 500 { &restarted } else { &old })).axes[0];
        let said = if k > 500 { control_flag::NO_MODEL } else { 0 };
        let (mode, flags) = match k {
            ..=599 => (ControlMode::Model, 0),
            600..=3399 => (ControlMode::Model, control_flag::MODEL_STALE),
            _ => (ControlMode::Fallback, control_flag::MODEL_STALE | control_flag::HALF_SPEED),
        };
        let without_limit = command.flags & !control_flag::SOFT_LIMIT;
        assert_eq!((command.mode, without_limit), (mode as u32, flags | said), "tick {k}");
        if k > 400 {
            assert!((command.command - last).abs() <= 0.1 + 1e-12, "tick {k}");
        }
        last = command.command;
        if k >= 3420 {
            assert!(command.command.abs() <= half + 1e-12, "tick {k}: {}", command.command);
            slowed += u32::from(command.command.abs() > half - 1e-9);
        } else if k > 600 {
            stood |= command.command.abs() > half + 0.1;
        }
    }
    assert!(stood && slowed > 50, "{slowed}");
    // Another model ends the half speed.
    let commands = axis.run(50, Some(actuator()));
    let last = commands[49].axes[0];
    assert_eq!((last.mode, last.flags & !control_flag::SOFT_LIMIT), (ControlMode::Model as u32, 0));
}

#[test]
fn half_speed_is_half_of_the_commissioned_speed_where_that_is_less() {
    let mut machine = machine_with("frequency = 0.3", "frequency = 0.6");
    // At half of the opening twice as fast as a straight line.
    let mut model = super::models::commissioned();
    (model.openings, model.speeds_extend, model.speeds_retract) = (vec![0.4, 0.8], vec![0.4, 0.5], vec![0.4, 0.5]);
    let fastest = model.speed(1.0).max(-model.speed(-1.0));
    machine.axes[0].commissioned = Some(model.clone());
    let mut axis = Loop::new(&machine, 0.0);
    axis.run(400, Some(actuator()));
    let old = snapshot(399, actuator());
    let commands: Vec<_> = (0..4000).map(|_| axis.tick(Some(&old)).axes[0]).collect();
    let largest = commands[3100..].iter().map(|command| command.command.abs()).fold(0.0, f64::max);
    assert!(model.speed(largest) <= 0.5 * fastest + 1e-9 && model.speed(largest) > 0.4 * fastest, "{largest}");
}

#[test]
fn an_axis_without_any_model_goes_at_full_speed() {
    for command in &Loop::new(&machine(1), 0.0).run(3600, None)[20..] {
        assert_eq!(command.axes[0].flags, control_flag::NO_MODEL);
    }
}

#[test]
fn the_choice_none_never_uses_a_model() {
    let machine = machine_with("command_rate = 10.0\n", "command_rate = 10.0\nmodel = \"none\"\n");
    let mut axis = Loop::new(&machine, 0.0);
    for command in &axis.run(300, Some(actuator()))[20..] {
        assert_eq!((command.axes[0].mode, command.axes[0].flags), (ControlMode::Fallback as u32, 0));
    }
}

#[test]
fn equal_inputs_give_equal_commands() {
    let run = || Loop::new(&machine(1), 0.05).run(500, Some(actuator()));
    let (one, two) = (run(), run());
    for (a, b) in one.iter().zip(&two) {
        assert_eq!(a.axes[0].command.to_bits(), b.axes[0].command.to_bits());
    }
}

#[test]
fn all_axes_of_a_machine_are_commanded() {
    let mut controller = Controller::new(&machine(4)).unwrap();
    controller.arm();
    let fresh = |k: u64| snapshot(k, actuator());
    for k in 0..60u64 {
        // The axes move by one count of their encoders.
        let positions = [0.6, 0.65, 0.7, 0.75].map(|position| position + 1e-4 * (k % 2) as f64);
        let command = controller.update(&super::sample(k, &positions), Some(&fresh(k)), None);
        assert_eq!((command.header.sequence, command.header.axis_count), (k, 4));
        assert_eq!(command.axes[0].command == 0.0, k <= 20, "tick {k}");
        assert_eq!(command.axes[4].mode, 0);
    }
}
