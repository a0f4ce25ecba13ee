//! Small motions about a working point compared with a linear transfer function: equation (10), derived from (3), (6)
//! and (9) with a pressure for each chamber.
//!
//! ```text
//! D1 p1 - C_ip p2 = K_q1 x - A1 v          D_i = V_i/beta_i s + K_ci + C_ip + C_ep
//! D2 p2 - C_ip p1 = -K_q2 x + A2 v         D  = D1 D2 - C_ip^2
//! (m s + B_p) v = A1 p1 - A2 p2            v = s y
//!
//!  Y       A1 (K_q1 D2 - C_ip K_q2) + A2 (K_q2 D1 - C_ip K_q1)
//! --- = ----------------------------------------------------------------------
//!  X    s ((m s + B_p) D + A1^2 D2 + A2^2 D1 - 2 A1 A2 C_ip)
//! ```
//!
//! K_qi = dq_i/dX and K_ci = |dq_i/dp_i| of the control edges at the working point. With one chamber, D2 constant, and
//! K_q in place of A1 K_q1 this is the printed (10). The printed valve term therefore lacks the factor A1.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix4, Vector4};
use pipeline::machine::{Change, DeadBand, Parameter};
use plant_sim::TrueState;

use super::*;

/// p_tr, Pa.
const TRANSITION: f64 = 2e4;

/// The built-in machine with axes that are linear except for their control edges: no dry friction, no dead band,
/// constant load.
fn smooth_machine() -> Machine {
    let mut machine = excavator();
    machine.hydraulics.as_mut().unwrap().supply.flow = 1.0;
    for axis in 0..4 {
        let plant = plant_of(&mut machine, axis);
        plant.load_force = LoadForce::constant(plant.load_force.middle);
        (plant.coulomb_friction, plant.static_friction) = (0.0, 0.0);
        (plant.bristle_stiffness, plant.bristle_damping) = (0.0, 0.0);
        plant.dead_band = DeadBand { extend: 0.0, retract: 0.0 };
        (plant.hysteresis, plant.dead_time) = (0.0, 0.0);
    }
    machine
}

/// [`smooth_machine`] with so much viscous friction that a response at the natural frequency decays faster than the
/// moving piston changes the volumes. The working point is then almost constant.
fn damped_machine() -> Machine {
    let mut machine = smooth_machine();
    (0..4).for_each(|axis| plant_of(&mut machine, axis).viscous_friction *= 10.0);
    machine
}

/// V/beta_e of both chambers with their hoses, and the compliance of the hoses, m3/Pa.
fn compliances(machine: &Machine, axis: usize, state: &TrueState) -> (f64, f64) {
    let plant = machine.axes[axis].plant.as_ref().unwrap();
    let ports = &plant.ports;
    let piston = plant.piston_dead_volume + plant.piston_area * state.position;
    let rod = plant.rod_dead_volume + plant.rod_area * (machine.axes[axis].stroke - state.position);
    let of = |chamber: f64, hose: f64, pressure: f64| {
        (chamber + hose) * compressibility(machine, pressure) + hose / ports.hose_modulus
    };
    (of(piston, ports.piston_hose_volume, state.piston_pressure), of(rod, ports.rod_hose_volume, state.rod_pressure))
}

/// Y/U at `frequency` Hz: the transfer function above in series with the valve's lag and a hold of half a step.
fn transfer(machine: &Machine, axis: usize, state: &TrueState, frequency: f64) -> Complex<f64> {
    let (plant, supply) = (machine.axes[axis].plant.as_ref().unwrap(), machine.hydraulics.unwrap().supply);
    let s = Complex::new(0.0, TAU * frequency);
    let k = plant.rated_flow / plant.rated_pressure_drop.sqrt();
    let (p1, p2, x) = (state.piston_pressure, state.rod_pressure, state.spool_position);
    let drops = if x > 0.0 {
        (supply.pressure - p1, p2 - supply.return_pressure)
    } else {
        (p1 - supply.return_pressure, supply.pressure - p2)
    };
    // f = dp/(dp^2 + p_tr^2)^(1/4), and its slope.
    let f = |dp: f64| dp / (dp * dp + TRANSITION * TRANSITION).powf(0.25);
    let slope = |dp: f64| (0.5 * dp * dp + TRANSITION * TRANSITION) / (dp * dp + TRANSITION * TRANSITION).powf(1.25);
    let (kq1, kq2) = (k * f(drops.0), k * f(drops.1));
    let (kc1, kc2) = (k * x.abs() * slope(drops.0), k * x.abs() * slope(drops.1));
    let (c1, c2) = compliances(machine, axis, state);
    let (a1, a2, internal) = (plant.piston_area, plant.rod_area, plant.internal_leakage);
    let leakage = internal + plant.external_leakage;
    let (d1, d2) = (s * c1 + kc1 + leakage, s * c2 + kc2 + leakage);
    let drive = (d2 * kq1 - internal * kq2) * a1 + (d1 * kq2 - internal * kq1) * a2;
    let stiffness = d2 * (a1 * a1) + d1 * (a2 * a2) - 2.0 * a1 * a2 * internal;
    let motion = s * ((s * plant.mass + plant.viscous_friction) * (d1 * d2 - internal * internal) + stiffness);
    let lag = 1.0 / (s * plant.valve_time_constant + 1.0);
    drive / motion * lag * (-s * 0.5 * STEP.as_secs_f64()).exp()
}

/// Undamped natural frequency of the piston between both chambers, Hz.
fn natural_frequency(machine: &Machine, axis: usize, state: &TrueState) -> f64 {
    let plant = machine.axes[axis].plant.as_ref().unwrap();
    let (c1, c2) = compliances(machine, axis, state);
    ((plant.piston_area.powi(2) / c1 + plant.rod_area.powi(2) / c2) / plant.mass).sqrt() / TAU
}

/// Natural frequency by the printed (8) in the middle of the stroke, Hz: V_t = 4 V1/(1 + n^3) and V1 = L A1/2, to which
/// the dead volume is added.
///
/// (8) assumes that p2 follows p1 as in steady flow. At the natural frequency both chambers are springs instead, so
/// that 1 + n takes the place of 1 + n^3. The frequency is higher by about sqrt((1 + n)/(1 + n^3)), 15 % for n = 1/2.
fn papers_natural_frequency(machine: &Machine, axis: usize, state: &TrueState) -> f64 {
    let (plant, stroke) = (machine.axes[axis].plant.as_ref().unwrap(), machine.axes[axis].stroke);
    let n = plant.rod_area / plant.piston_area;
    let volume = plant.piston_dead_volume + 0.5 * stroke * plant.piston_area;
    let compliance = volume * compressibility(machine, state.piston_pressure);
    (plant.piston_area.powi(2) * (1.0 + n.powi(3)) / (compliance * plant.mass)).sqrt() / TAU
}

/// Response of the position to a small sine added to `opening`, measured while the axis passes `position`, and the
/// state of an axis without the sine at that position.
fn measure(axis: usize, position: f64, opening: f64, frequency: f64) -> (Complex<f64>, TrueState) {
    const AMPLITUDE: f64 = 0.01;
    let settle = 50_000u32;
    let period = 1e4 / frequency;
    let window = (period * (1e4 / period).ceil()).round() as u32;
    let mut machine = damped_machine();
    // The axis starts where it has to, so that it is at `position` in the middle of the window.
    let mut probe = simulate(&machine);
    hold(&mut probe, opening, 1.0);
    let speed = probe.axes()[axis].velocity;
    plant_of(&mut machine, axis).initial_position = position - speed * 1e-4 * f64::from(settle + window / 2);

    let (mut excited, mut quiet) = (simulate(&machine), simulate(&machine));
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    let mut middle = quiet.axes()[axis];
    for i in 0..settle + window {
        let phase = TAU * frequency * f64::from(i) * 1e-4;
        excited.command(&all(opening * (1.0 + AMPLITUDE * phase.sin())));
        quiet.command(&all(opening));
        excited.advance(STEP);
        quiet.advance(STEP);
        if i == settle + window / 2 {
            middle = quiet.axes()[axis];
        }
        if i >= settle {
            let phase = TAU * frequency * f64::from(i + 1) * 1e-4;
            let row = Vector4::new(1.0, f64::from(i) * 1e-4, phase.sin(), phase.cos());
            normal += row * row.transpose();
            right += row * (excited.axes()[axis].position - quiet.axes()[axis].position);
        }
    }
    let fit = normal.lu().solve(&right).unwrap();
    (Complex::new(fit[2], fit[3]) / (AMPLITUDE * opening), middle)
}

#[test]
fn small_motions_follow_the_transfer_function_up_to_the_natural_frequency() {
    // Boom extending in the middle, boom retracting near its lower end, bucket extending near its upper end.
    for (axis, position, opening) in [(0, 0.667, 0.03), (0, 0.3, -0.03), (3, 0.9, 0.02)] {
        let natural = natural_frequency(&damped_machine(), axis, &measure(axis, position, opening, 5.0).1);
        let mut worst = (0.0f64, 0.0f64);
        for part in [0.05, 0.1, 0.2, 0.4, 0.6, 0.75, 0.9, 1.0] {
            let frequency = part * natural;
            let (measured, state) = measure(axis, position, opening, frequency);
            let ratio = measured / transfer(&damped_machine(), axis, &state, frequency);
            let (decibels, degrees) = (20.0 * ratio.norm().log10(), ratio.arg().to_degrees());
            println!("axis {axis} at {position} m, {frequency:6.2} Hz: {decibels:+.3} dB, {degrees:+.2} degrees off");
            worst = (worst.0.max(decibels.abs()), worst.1.max(degrees.abs()));
        }
        assert!(worst.0 < 1.0 && worst.1 < 5.0, "axis {axis} at {position} m: {worst:?}");
    }
}

#[test]
fn a_pushed_axis_rings_at_its_natural_frequency() {
    for (part, hose) in [(0.1, 0.0), (0.5, 0.0), (0.9, 0.0), (0.1, 2e-3), (0.5, 2e-3)] {
        let mut machine = smooth_machine();
        for axis in 0..4 {
            let stroke = machine.axes[axis].stroke;
            let plant = plant_of(&mut machine, axis);
            (plant.ports.piston_hose_volume, plant.ports.rod_hose_volume) = (hose, 0.5 * hose);
            plant.initial_position = part * stroke;
            plant.internal_leakage = 0.0; // a creeping axis does not cross zero speed evenly
        }
        machine.scenario.changes = vec![
            Change { axis: None, parameter: Parameter::ExternalForce, start: 0.0, end: 0.0, to: 0.0 },
            Change { axis: None, parameter: Parameter::ExternalForce, start: 0.01, end: 0.01, to: 1e-3 },
        ];
        let mut sim = simulate(&machine);
        let rest = sim.axes().to_vec();
        // Times at which the velocity becomes positive, in steps.
        let mut crossings = vec![Vec::new(); 4];
        let mut before = [0.0; 4];
        for i in 0..20_000 {
            sim.advance(STEP);
            for (axis, state) in sim.axes().iter().enumerate() {
                if before[axis] < 0.0 && state.velocity >= 0.0 {
                    crossings[axis].push(f64::from(i) - state.velocity / (state.velocity - before[axis]));
                }
                before[axis] = state.velocity;
            }
        }
        for (axis, crossings) in crossings.iter().enumerate() {
            let periods = crossings.len() - 1;
            let measured = periods as f64 / ((crossings[periods] - crossings[0]) * 1e-4);
            let expected = natural_frequency(&machine, axis, &rest[axis]);
            println!("axis {axis} at {part} of its stroke, hose {hose} m3: {measured:.3} Hz, formula {expected:.3} Hz");
            assert!(periods > 5 && (measured / expected - 1.0).abs() < 0.02);
            if part == 0.5 && hose == 0.0 {
                let papers = papers_natural_frequency(&machine, axis, &rest[axis]);
                println!("axis {axis}: the paper's equivalent volume gives {papers:.3} Hz");
                assert!((1.11..1.19).contains(&(measured / papers)), "{papers}");
            }
        }
    }
}
