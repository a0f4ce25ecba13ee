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
            PlantError::Linkage { axis: found, position } => {
                assert_eq!(found, name);
                assert!(position > 0.5 * machine.axes[axis].stroke, "{position}");
            }
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
