//! The coupled modes: cylinders with shut valves swing together on their oil.

use std::f64::consts::TAU;

use nalgebra::{Matrix4, SymmetricEigen, Vector4};
use plant_sim::{actuator::cylinder::Cylinder, conditions::Conditions, hydraulics::supply::Pump};

use super::*;

/// Air that is left in the oil: the least that is allowed, so that the oil is almost a linear spring.
const AIR: f64 = 2e-3;

/// The machine without anything that damps.
fn undamped(mut machine: Machine) -> Machine {
    without_leakage(&mut machine);
    for plant in plants(&mut machine) {
        (plant.coulomb_friction, plant.static_friction, plant.viscous_friction) = (0.0, 0.0, 0.0);
        (plant.bristle_stiffness, plant.bristle_damping) = (0.0, 0.0);
    }
    machine
}

/// Stiffness of the oil on each cylinder at rest, in chambers without hoses, N/m.
fn stiffness(machine: &Machine, sim: &PlantSim) -> [f64; AXES] {
    const ATMOSPHERE: f64 = 101_325.0;
    let oil = machine.hydraulics.unwrap().oil;
    let modulus = |pressure: f64| {
        let absolute = pressure + ATMOSPHERE;
        let air = AIR * (ATMOSPHERE / absolute).powf(1.0 / 1.4);
        (1.0 + air) / (1.0 / oil.bulk_modulus + air / (1.4 * absolute))
    };
    std::array::from_fn(|i| {
        let (axis, state) = (&machine.axes[i], &sim.axes()[i]);
        let plant = axis.plant.as_ref().unwrap();
        let piston = plant.piston_dead_volume + plant.piston_area * state.position;
        let rod = plant.rod_dead_volume + plant.rod_area * (axis.stroke - state.position);
        modulus(state.piston_pressure) * plant.piston_area.powi(2) / piston
            + modulus(state.rod_pressure) * plant.rod_area.powi(2) / rod
    })
}

/// Each coupled mode on `springs`, N/m: the frequency at which the machine rings, and the expected one, Hz.
fn ring(mut machine: Machine, springs: [f64; AXES]) -> [(f64, f64); AXES] {
    let rest = simulate(&machine);
    let prepared = mechanism().prepared();
    let mass = prepared.dynamics(&prepared.pose(&positions(&rest)), &[0.0; AXES], Vector::default()).mass;
    // M^-1 K is similar to the symmetric K^1/2 M^-1 K^1/2.
    let root = Matrix4::from_diagonal(&Vector4::from(springs.map(f64::sqrt)));
    let mass = Matrix4::from_fn(|i, j| mass[i][j]);
    let modes = SymmetricEigen::new(root * mass.try_inverse().unwrap() * root);
    std::array::from_fn(|mode| {
        // A force along K x the mode's shape bends nothing but this mode; then it is let go.
        let force = root * modes.eigenvectors.column(mode);
        let shape = root.try_inverse().unwrap() * modes.eigenvectors.column(mode);
        let axis = shape.iamax();
        let scale = 2e-5 / shape[axis];
        machine.scenario.changes.clear();
        for (i, axis) in machine.axes.iter().enumerate() {
            let full = machine.hydraulics.unwrap().supply.pressure * axis.plant.as_ref().unwrap().piston_area;
            let to = -scale * force[i] / full;
            let change = Change { axis: Some(i), parameter: Parameter::ExternalForce, start: 0.01, end: 0.01, to };
            machine.scenario.changes.push(change);
        }
        let mut sim = simulate(&machine);
        let (mut crossings, mut before) = (Vec::new(), 0.0);
        for i in 0..30_000 {
            sim.advance(STEP);
            let velocity = sim.axes()[axis].velocity;
            if before < 0.0 && velocity >= 0.0 {
                crossings.push(f64::from(i) - velocity / (velocity - before));
            }
            before = velocity;
        }
        let periods = crossings.len() - 1;
        assert!(periods > 4, "{periods} periods");
        (periods as f64 / ((crossings[periods] - crossings[0]) * 1e-4), modes.eigenvalues[mode].sqrt() / TAU)
    })
}

#[test]
fn each_coupled_mode_rings_at_its_natural_frequency() {
    for parts in [[0.5, 0.5, 0.5, 0.5], [0.3, 0.2, 0.8, 0.7]] {
        let mut machine = undamped(excavator());
        machine.hydraulics.as_mut().unwrap().oil.air = AIR;
        for (axis, part) in machine.axes.iter_mut().zip(parts) {
            axis.plant.as_mut().unwrap().initial_position = part * axis.stroke;
        }
        let springs = stiffness(&machine, &simulate(&machine));
        for (found, expected) in ring(machine, springs) {
            println!("{parts:?}: {found:.3} Hz, expected {expected:.3} Hz");
            assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
        }
    }
}

#[test]
fn a_machine_with_hoses_and_air_rings_at_the_frequencies_of_its_oil_at_rest() {
    let machine = undamped(of_20_tonnes());
    let (rest, hydraulics) = (simulate(&machine), machine.hydraulics.unwrap());
    let idle = Pump::new(&hydraulics.supply, 1.0, 1.0).pressure;
    let prepared = mechanism().prepared();
    let load = prepared.dynamics(&prepared.pose(&positions(&rest)), &[0.0; AXES], Vector::default()).load;
    let springs = std::array::from_fn(|i| {
        let (axis, state) = (&machine.axes[i], &rest.axes()[i]);
        let cylinder = Cylinder::new(axis.plant.as_ref().unwrap(), axis.stroke, &hydraulics, &Conditions::NOMINAL);
        let pressures = cylinder.pressures_at_rest(load[i], idle);
        assert!((pressures.0 / state.piston_pressure - 1.0).abs() < 1e-9, "{pressures:?} {state:?}");
        cylinder.oil_stiffness(state.position, pressures)
    });
    for (found, expected) in ring(machine, springs) {
        println!("with hoses and air: {found:.3} Hz, expected {expected:.3} Hz");
        assert!((found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
    }
}
