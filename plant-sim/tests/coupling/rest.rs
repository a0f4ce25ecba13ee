//! The excavator at rest.

use pipeline::machine::LoadForce;

use super::*;

#[test]
fn oil_holds_the_weight_in_every_posture_and_nothing_moves() {
    for part in [[0.5; 4], [0.1, 0.1, 0.9, 0.1], [0.9, 0.2, 0.2, 0.8], [0.3, 0.9, 0.5, 0.5]] {
        for payload in [0.0, 1500.0] {
            let mut machine = excavator();
            without_leakage(&mut machine);
            machine.mechanism.as_mut().unwrap().masses.payload.mass = payload;
            for (axis, part) in machine.axes.iter_mut().zip(part) {
                axis.plant.as_mut().unwrap().initial_position = part * axis.stroke;
            }
            let mut sim = simulate(&machine);
            let begin = positions(&sim);
            let prepared = machine.mechanism.unwrap().prepared();
            let weights = prepared.dynamics(&prepared.pose(&begin), &[0.0; AXES], Vector::default()).load;
            for (axis, state) in sim.axes().iter().enumerate() {
                let plant = machine.axes[axis].plant.as_ref().unwrap();
                let oil = plant.piston_area * state.piston_pressure - plant.rod_area * state.rod_pressure;
                assert!((oil - weights[axis]).abs() < 1e-6 * weights[axis].abs(), "{part:?}, {axis}: {oil}");
            }
            sim.advance(Duration::from_secs(20));
            for (now, begin) in positions(&sim).into_iter().zip(begin) {
                assert!((now - begin).abs() < 1e-9, "{part:?}, {payload} kg: {}", now - begin);
            }
        }
    }
}

#[test]
fn the_masses_and_loads_of_the_axes_themselves_do_not_matter() {
    let run = |mass: f64, force: f64| {
        let mut machine = under("everything");
        for plant in plants(&mut machine) {
            (plant.mass, plant.load_force) = (mass, LoadForce::constant(force));
        }
        let mut sim = simulate(&machine);
        for tick in 0..1500 {
            sim.command(&commands(mixed(0.01 * f64::from(tick))));
            sim.advance(Duration::from_millis(10));
        }
        sim.axes().to_vec()
    };
    assert_eq!(run(0.0, 0.0), run(7e3, 5e4));
}

#[test]
fn after_motion_the_excavator_stands_still_without_leakage() {
    let mut machine = excavator();
    without_leakage(&mut machine);
    let mut sim = simulate(&machine);
    for tick in 0..200 {
        sim.command(&commands(mixed(0.01 * f64::from(tick))));
        sim.advance(Duration::from_millis(10));
    }
    // Weight and oil oscillate until friction holds them.
    sim.advance(Duration::from_secs(60));
    let stopped = positions(&sim);
    sim.advance(Duration::from_secs(60));
    for (axis, (now, stopped)) in positions(&sim).into_iter().zip(stopped).enumerate() {
        println!("axis {axis}: {:+.1e} m in 60 s", now - stopped);
        assert!((now - stopped).abs() < 1e-7, "axis {axis}: {:e} m", now - stopped);
    }
}
