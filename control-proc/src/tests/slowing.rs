//! References that ask for more than an axis can give.

use std::path::Path;

use pipeline::{
    machine::Machine,
    message::{AxisMode, ValveCommand, control_flag},
};

use super::{machine_text, machine_with, modes::Operated, plant::Actuator, sample};
use crate::Controller;

/// Largest speed of the plant at full command, m/s: that of [`Actuator`] behind a dead band of 0.1.
const REACHED: f64 = 0.54;
/// Ticks of a test: the settling, and both ways of the ramps at a third of their speed.
const TICKS: usize = 1600;

/// Two axes that are commissioned as they are. The ramps of the first ask for `speed`, those of the second go half as
/// far in the same time.
fn machine(speed: f64, slows: bool) -> Machine {
    let way = 1.0;
    let (up, down) = (way / speed, way / speed + 2.0 + way / 0.2);
    let mut text = machine_text(2);
    for (axis, part) in [("a0", 1.0), ("a1", 0.5)] {
        let (low, high) = (0.15, 0.15 + part * way);
        let (begin, end) = text.split_once(&format!("[axis.{axis}.reference]\n")).unwrap();
        let rest = end.split_once("]\n").unwrap().1;
        text = format!(
            "{begin}[axis.{axis}.commissioned]\ndead_time = 0.05\ntime_constant = 0.045\ndead_band_extend = 0.1\n\
             dead_band_retract = 0.1\nopenings = [0.9]\nspeeds_extend = [{REACHED}]\nspeeds_retract = [{REACHED}]\n\
             fit_percent = 100.0\n[axis.{axis}.reference]\nkind = \"ramps\"\n\
             times = [0.0, 4.0, {}, {}, {}, 40.0]\npositions = [{low}, {low}, {high}, {high}, {low}, {low}]\n{rest}",
            4.0 + up,
            6.0 + up,
            4.0 + down
        );
    }
    let text = text.replace("following_error = 0.5\n", "following_error = 0.05\nfeedforward = true\n");
    let settings = if slows { vec![("axis.a0.control.slow_references".to_owned(), "true".to_owned())] } else { vec![] };
    Machine::parse(&text, "test.toml", Path::new("."), &settings).unwrap()
}

/// The commands of two axes that start where their references do.
fn run(machine: &Machine) -> Vec<ValveCommand> {
    let mut controller = Controller::new(machine).unwrap();
    controller.arm();
    let mut plants = [Actuator::new(0.15, 0.1), Actuator::new(0.15, 0.1)];
    let tick = |sequence| {
        let positions = plants.each_ref().map(|plant| (plant.position * 1e4).round() / 1e4);
        let command = controller.update(&sample(sequence, &positions), None, None);
        plants.iter_mut().zip(&command.axes).for_each(|(plant, axis)| plant.step(axis.command));
        command
    };
    (0..TICKS as u64).map(tick).collect()
}

/// Largest following error of the first axis, m.
fn largest_error(commands: &[ValveCommand]) -> f64 {
    commands.iter().map(|command| command.axes[0].error.abs()).fold(0.0, f64::max)
}

#[test]
fn a_ramp_that_the_axis_cannot_follow_latches_it_without_the_key_and_is_slowed_with_it() {
    let fast = 1.5 * REACHED;
    let unslowed = run(&machine(fast, false));
    let last = unslowed[TICKS - 1].axes[0];
    assert_eq!(last.latched_by & control_flag::FOLLOWING, control_flag::FOLLOWING, "{last:?}");
    assert_eq!(last.slowed_ticks, 0);

    let slowed = run(&machine(fast, true));
    let last = slowed[TICKS - 1].axes[0];
    assert_eq!(last.latches, 0, "{last:?}");
    // The same axis on a ramp that it can follow.
    let usual = run(&machine(0.8 * REACHED, false));
    assert!(largest_error(&slowed) < 1.5 * largest_error(&usual));
    let flagged = slowed.iter().filter(|command| command.axes[0].flags & control_flag::SLOWED != 0).count();
    // 1 m at 0.486 m/s, and as long more as the soft stop takes near its limit.
    assert!((200..400).contains(&flagged) && last.slowed_ticks as usize == flagged, "{flagged}");
    let speeds = slowed.windows(2).map(|pair| (pair[1].axes[0].reference - pair[0].axes[0].reference) / 0.01);
    let fastest = speeds.fold(0.0, f64::max);
    assert!((0.45..0.9 * REACHED * 1.001).contains(&fastest), "{fastest}");
    // It arrives.
    assert!(slowed.iter().any(|command| (command.axes[0].reference - 1.15).abs() < 1e-9));
}

#[test]
fn the_path_of_two_axes_is_kept_and_the_other_axis_waits() {
    let slowed = run(&machine(1.5 * REACHED, true));
    let begins = slowed.iter().position(|command| command.axes[0].flags & control_flag::SETTLING == 0).unwrap();
    for command in &slowed[begins..] {
        let [first, second] = [0, 1].map(|i| command.axes[i].reference - 0.15);
        assert!((second - 0.5 * first).abs() < 1e-9, "{first} m, {second} m");
    }
    let flagged = |i: usize| slowed.iter().filter(|command| command.axes[i].flags & control_flag::SLOWED != 0).count();
    assert_eq!(flagged(0), flagged(1));
}

#[test]
fn a_reference_that_the_axis_can_follow_is_the_same_with_the_key() {
    let (with, without) = (run(&machine(0.4 * REACHED, true)), run(&machine(0.4 * REACHED, false)));
    let differs = with.iter().zip(&without).position(|(with, without)| with.axes[0] != without.axes[0]);
    assert_eq!(differs, None);
}

/// An axis that holds, is sent 0.6 m away and reaches 0.15 m/s, of 0.25 m/s that its set point is planned with.
#[test]
fn a_set_point_waits_for_an_axis_that_is_slower_than_planned() {
    let limited = "command_limit = 0.35\nfollowing_error = 0.1\n";
    let mut axis = Operated::of(&machine_with("command_limit = 1.0\nfollowing_error = 0.5\n", limited));
    axis.enable(AxisMode::Hold);
    let commands = axis.asks(800, AxisMode::Hold, 0.0, Some(1.2));
    let last = commands[799].axes[0];
    assert!(last.latches == 0 && last.error.abs() < 5e-3 && last.reference == 1.2, "{last:?}");
    let speeds = commands.windows(2).map(|pair| (pair[1].axes[0].reference - pair[0].axes[0].reference) / 0.01);
    let fastest = speeds.fold(0.0, f64::max);
    assert!(fastest > 1.3 * 0.15, "it begins as it is planned: {fastest}");
}

#[test]
fn a_set_point_does_not_wait_for_an_axis_that_moves_away_from_it() {
    let mut axis = Operated::of(&machine_with("following_error = 0.5", "following_error = 0.1"));
    axis.enable(AxisMode::Hold);
    let latched = (0..400).position(|_| {
        let command = axis.ask(AxisMode::Hold, 0.0, Some(1.2)).axes[0];
        // The load falls.
        axis.axis.plant.position -= 0.004;
        command.latches != 0
    });
    assert!(latched.is_some_and(|tick| tick < 150), "{latched:?}");
}
