//! Loops that swing though their reference does not ask for it, whoever closes them.

use pipeline::message::{AxisCommand, ControlMode, control_flag};

use super::{Loop, machine_with};

/// 30 s of an axis whose fallback has this kp.
fn run(kp: &str) -> Vec<AxisCommand> {
    let machine = machine_with("kp = 4.0", &format!("kp = {kp}"));
    Loop::new(&machine, 0.08).run(3000, None).iter().map(|command| command.axes[0]).collect()
}

fn first(commands: &[AxisCommand], flag: u32) -> Option<usize> {
    commands.iter().position(|command| command.flags & flag != 0)
}

/// Least and largest command in the last 5 s.
fn reach(commands: &[AxisCommand]) -> (f64, f64) {
    let last = commands[2500..].iter().map(|command| command.command);
    (last.clone().fold(0.0, f64::min), last.fold(0.0, f64::max))
}

#[test]
fn a_fallback_that_swings_goes_on_with_lower_gains_and_swings_no_more() {
    let commands = run("80.0");
    let cautious = first(&commands, control_flag::CAUTION).unwrap();
    assert!(cautious < 220, "within 2 s of following: {cautious}");
    assert_eq!(first(&commands, control_flag::LATCHED), None);
    assert!(commands[cautious..].iter().all(|command| command.mode == ControlMode::Fallback as u32));
    // The sine asks for 0.226 m/s, so for a command of 0.46 beyond the dead band.
    let (low, high) = reach(&commands);
    assert!(low > -0.7 && high < 0.7, "{low} {high}");
}

#[test]
fn an_axis_that_swings_with_the_lowest_gains_is_stopped_for_that() {
    let commands = run("400.0");
    let cautious = first(&commands, control_flag::CAUTION).unwrap();
    let stopped = first(&commands, control_flag::LATCHED).unwrap();
    assert!(cautious < 220 && stopped < 1000, "{cautious} {stopped}");
    let last = commands[2999];
    assert_eq!((last.flags & control_flag::LATCHED, last.command), (control_flag::SWING, 0.0));
}

#[test]
fn an_axis_that_follows_well_is_left_alone() {
    let commands = run("4.0");
    assert_eq!(first(&commands, control_flag::CAUTION | control_flag::LATCHED), None);
}
