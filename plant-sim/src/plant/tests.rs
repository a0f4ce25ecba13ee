use std::f64::consts::TAU;

use pipeline::machine::Machine;

use super::*;

/// Positions of the built-in machine under its default scenario at every tick of 10 s, with the command
/// `command(axis, time)`.
fn positions(step_ns: u64, command: impl Fn(usize, f64) -> f64) -> Vec<Vec<f64>> {
    let machine = Machine::four_axes(&[]).unwrap();
    let mut sim = PlantSim::with_step(&machine, 1, step_ns).unwrap();
    let tick = |i: u32| {
        let mut message = ValveCommand::default();
        for (index, axis) in message.axes.iter_mut().enumerate() {
            axis.command = command(index, f64::from(i) * 0.01);
        }
        sim.command(&message);
        sim.advance(Duration::from_millis(10));
        sim.axes().iter().map(|axis| axis.position).collect()
    };
    (0..1000).map(tick).collect()
}

/// Largest change of the position of each axis when the step is halved, m.
fn halving(command: impl Fn(usize, f64) -> f64) -> [f64; 4] {
    let (step, half) = (positions(STEP_NS, &command), positions(STEP_NS / 2, &command));
    std::array::from_fn(|axis| {
        let moved = step.iter().map(|x| x[axis]);
        assert!(
            moved.clone().fold(0.0, f64::max) - moved.fold(9.0, f64::min) > 0.1,
            "the axis moves by more than 0.1 m"
        );
        step.iter().zip(&half).map(|(a, b)| (a[axis] - b[axis]).abs()).fold(0.0, f64::max)
    })
}

#[test]
fn halving_the_step_changes_positions_under_sines_by_less_than_a_tenth_of_a_millimetre() {
    let sines = |axis: usize, time: f64| {
        0.35 * (TAU * (0.2 + 0.1 * axis as f64) * time).sin() + 0.15 * (TAU * 1.3 * time).sin()
    };
    let changes = halving(sines);
    println!("{changes:?}");
    assert!(changes.iter().all(|change| *change < 1e-4), "{changes:?}");
}

#[test]
fn halving_the_step_changes_positions_between_the_end_stops_by_less_than_a_tenth_of_a_millimetre() {
    let changes = halving(|_, time| if time % 7.0 < 3.5 { 1.0 } else { -1.0 });
    println!("{changes:?}");
    assert!(changes.iter().all(|change| *change < 1e-4), "{changes:?}");
}
