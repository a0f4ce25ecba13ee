//! Starting, following, switching.

use pipeline::message::{ControlMode, control_flag};

use super::{Loop, SINES, machine, machine_with, models::actuator, snapshot};
use crate::Controller;

/// The largest change of command from tick to tick.
fn largest_step(commands: &[pipeline::message::ValveCommand]) -> f64 {
    commands.windows(2).map(|p| (p[1].axes[0].command - p[0].axes[0].command).abs()).fold(0.0, f64::max)
}

#[test]
fn pi_moves_an_axis_with_a_dead_band_to_its_target() {
    let machine = machine_with(SINES, "kind = \"ramps\"\ntimes = [0.0, 1.0, 100.0]\npositions = [0.8, 0.8, 0.8]\n");
    let mut axis = Loop::new(&machine, 0.10);
    let commands = axis.run(1500, None);
    let end = commands[1499].axes[0];
    assert!((axis.plant.position - 0.8).abs() < 2e-3, "{}", axis.plant.position);
    assert_eq!((end.mode, end.flags), (ControlMode::Fallback as u32, control_flag::NO_MODEL));
    assert!(commands.iter().all(|c| c.axes[0].command.abs() <= 1.0));
}

#[test]
fn it_starts_without_motion_and_without_a_jump() {
    for model in [None, Some(actuator())] {
        let mut axis = Loop::new(&machine(1), 0.0);
        let commands = axis.run(1000, model);
        for command in &commands[..20] {
            assert_eq!(command.axes[0].command, 0.0);
            assert_ne!(command.axes[0].flags & control_flag::SETTLING, 0);
        }
        // The first tick that follows has the target where the axis stands.
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

/// A regression: without the noise polynomial one count of the encoder moved the command by the whole rate limit.
#[test]
fn the_steps_of_the_encoder_do_not_shake_the_valve() {
    let commands = Loop::new(&machine(1), 0.0).run(3000, Some(actuator()));
    let squares = commands[300..].windows(2).map(|p| (p[1].axes[0].command - p[0].axes[0].command).powi(2));
    let rms = (squares.sum::<f64>() / 2699.0).sqrt();
    assert!(rms < 0.04, "{rms} of command from tick to tick");
}

#[test]
fn the_model_is_tried_and_left_without_a_bump() {
    let mut axis = Loop::new(&machine(1), 0.0);
    let mut commands = axis.run(35, None);
    commands.extend(axis.run(400, Some(actuator())));
    // 10 ticks of probation, from tick 35 on.
    assert_eq!(commands[44].axes[0].mode, ControlMode::Fallback as u32);
    assert_eq!(commands[45].axes[0].mode, ControlMode::Model as u32);
    let last = commands[434].axes[0];
    commands.extend(axis.run(10, None));
    let first = commands[435].axes[0];
    assert_eq!((first.mode, first.flags), (ControlMode::Fallback as u32, control_flag::NO_MODEL));
    assert!((first.command - last.command).abs() < 1e-9, "{} after {}", first.command, last.command);
    assert!(largest_step(&commands) <= 0.1 + 1e-12);
}

#[test]
fn a_stale_model_is_left_and_flagged() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(100, Some(actuator()));
    let old = snapshot(99, actuator());
    // 2 s of the default time-out: tick 299 is the last that may use it.
    for k in 100..400 {
        let command = axis.tick(Some(&old)).axes[0];
        let (mode, flags) = if k <= 299 {
            (ControlMode::Model as u32, 0)
        } else {
            (ControlMode::Fallback as u32, control_flag::MODEL_STALE)
        };
        assert_eq!((command.mode, command.flags), (mode, flags), "tick {k}");
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
fn the_same_inputs_give_the_same_commands() {
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
    for k in 0..200u64 {
        let command = controller.update(&super::sample(k, &[0.6, 0.65, 0.7, 0.75]), Some(&fresh(k)), None);
        assert_eq!((command.header.sequence, command.header.axis_count), (k, 4));
        assert_eq!(command.axes[0].command == 0.0, k <= 20, "tick {k}");
        assert_eq!(command.axes[4].mode, 0);
    }
}
