//! Machines whose axes cannot be coupled, or are too fast together.

use plant_sim::PlantError;

use super::*;

#[test]
fn a_mechanism_needs_four_axes() {
    let mut machine = excavator();
    machine.axes.truncate(3);
    assert_eq!(PlantSim::new(&machine, 1).unwrap_err(), PlantError::TooFewAxes { found: 3 });
}

#[test]
fn a_stroke_at_whose_end_the_pins_do_not_close_is_refused_and_named() {
    for (axis, name) in [(0, "boom"), (1, "arm"), (3, "bucket")] {
        let mut machine = excavator();
        machine.axes[axis].stroke += 0.5;
        match PlantSim::new(&machine, 1).unwrap_err() {
            PlantError::Linkage { axis, .. } => assert_eq!(axis, name),
            other => panic!("{other}"),
        }
    }
}

#[test]
fn coupled_axes_that_are_too_fast_for_the_step_are_refused() {
    type Edit = fn(&mut Machine);
    let edits: [Edit; 4] = [
        |machine| {
            let masses = &mut machine.mechanism.as_mut().unwrap().masses;
            (masses.bucket.mass, masses.bucket.inertia) = (5.0, 0.5);
            (masses.inner.mass, masses.inner.inertia) = (5.0, 0.5);
        },
        |machine| plants(machine).for_each(|plant| plant.end_stop_damping = 1e8),
        |machine| plants(machine).for_each(|plant| plant.end_stop_stiffness = 1e12),
        |machine| plants(machine).for_each(|plant| plant.piston_dead_volume = 1e-5),
    ];
    for (case, edit) in edits.into_iter().enumerate() {
        let mut machine = excavator();
        edit(&mut machine);
        match PlantSim::new(&machine, 1) {
            Err(PlantError::TooStiffTogether { rate, limit }) => assert!(rate > limit),
            other => panic!("case {case}: {:?}", other.err()),
        }
    }
}

/// The fastest excavator that is accepted, by a factor that `edit` gets and that grows by a tenth each time.
fn fastest_accepted(edit: impl Fn(&mut Machine, f64)) -> (Machine, f64) {
    let machine = |factor: f64| {
        let mut machine = excavator();
        edit(&mut machine, factor);
        machine
    };
    let mut factor = 1.0;
    while PlantSim::new(&machine(1.1 * factor), 1).is_ok() {
        factor *= 1.1;
    }
    (machine(factor), factor)
}

#[test]
fn coupled_axes_just_below_the_limit_come_to_rest_in_their_stops() {
    type Edit = fn(&mut Machine, f64);
    let edits: [(&str, Edit); 2] = [
        ("damping", |machine, factor| plants(machine).for_each(|plant| plant.end_stop_damping *= factor)),
        ("light", |machine, factor| {
            let masses = &mut machine.mechanism.as_mut().unwrap().masses;
            for body in [&mut masses.boom, &mut masses.arm, &mut masses.inner, &mut masses.bucket] {
                (body.mass, body.inertia) = (body.mass / factor, body.inertia / factor);
            }
        }),
    ];
    for (name, edit) in edits {
        let (machine, factor) = fastest_accepted(edit);
        let mut sim = simulate(&machine);
        println!("{name}: by a factor of {factor:.2}");
        for (command, rest) in [(1.0, 1.0), (-1.0, 0.0)] {
            for _ in 0..1000 {
                sim.command(&commands([command; AXES]));
                sim.advance(Duration::from_millis(10));
            }
            for (state, axis) in sim.axes().iter().zip(&machine.axes) {
                let sunk = state.position - rest * axis.stroke;
                assert!(sunk.abs() < 6e-3 && state.velocity.abs() < 1e-3, "{name}, {}: {state:?}", axis.name);
            }
        }
    }
}
