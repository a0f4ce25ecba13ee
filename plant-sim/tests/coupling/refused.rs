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
            Err(PlantError::TooStiffTogether { rate, limit, .. }) => assert!(rate > limit),
            other => panic!("case {case}: {:?}", other.err()),
        }
    }
}

#[test]
fn the_axis_that_is_too_fast_is_named() {
    type Edit = fn(&mut Machine);
    let edits: [(&str, &str, Edit); 3] = [
        ("axis.arm.plant", "damping of", |machine| plants(machine).nth(1).unwrap().end_stop_damping = 1e8),
        ("axis.bucket.plant", "the stiffness of", |machine| plants(machine).nth(3).unwrap().end_stop_stiffness = 1e12),
        ("axis.telescope.plant", "valve, leakage", |machine| plants(machine).nth(2).unwrap().rod_dead_volume = 1e-5),
    ];
    for (place, by, edit) in edits {
        let mut machine = excavator();
        edit(&mut machine);
        let error = PlantSim::new(&machine, 1).unwrap_err().to_string();
        let expected = format!("{place}: found, with the axes that the mechanism couples, a motion at ");
        assert!(error.starts_with(&expected) && error.contains(by), "{error}");
    }
}

#[test]
fn end_stops_into_which_pistons_sink_beyond_the_linkage_are_refused() {
    // The boom's linkage closes down to 0.071 m before position 0, and ever smaller moment arms lie before that.
    let with = |stiffness: f64| {
        let mut machine = excavator();
        plants(&mut machine).next().unwrap().end_stop_stiffness = stiffness;
        PlantSim::new(&machine, 1)
    };
    for accepted in [2e8, 5e7, 2e7] {
        with(accepted).unwrap_or_else(|error| panic!("{accepted}: {error}"));
    }
    for refused in [1e5, 5e5] {
        let error = with(refused).unwrap_err().to_string();
        assert!(error.starts_with("axis.boom.plant.end_stop_stiffness: found stops into which pump"), "{error}");
    }
}

#[test]
fn the_pose_follows_a_piston_into_soft_stops() {
    let mut machine = excavator();
    let boom = plants(&mut machine).next().unwrap();
    (boom.end_stop_stiffness, boom.initial_position) = (1.8e7, 1.2);
    (boom.piston_dead_volume, boom.rod_dead_volume) = (3e-3, 3e-3);
    let mut sim = simulate(&machine);
    for _ in 0..1000 {
        sim.command(&commands([1.0, 0.0, 0.0, 0.0]));
        sim.advance(Duration::from_millis(10));
    }
    // At rest in the stop: oil against weight and stop, with the weight of the pose that the piston has.
    let (state, plant) = (sim.axes()[0], machine.axes[0].plant.as_ref().unwrap());
    let depth = state.position - machine.axes[0].stroke;
    let prepared = mechanism().prepared();
    let weight = prepared.dynamics(&prepared.pose(&positions(&sim)), &[0.0; AXES], Vector::default()).load[0];
    let oil = plant.piston_area * state.piston_pressure - plant.rod_area * state.rod_pressure;
    println!("{depth} m deep, {} N left", oil - weight - 1.8e7 * depth);
    assert!(depth > 0.021 && (oil - weight - 1.8e7 * depth).abs() < 2.0 * plant.static_friction, "{state:?}");
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
