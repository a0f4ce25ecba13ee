use pipeline::machine::Machine;

use super::*;

/// The built-in machine's axes coupled by the linkage of an excavator of 20 t.
fn excavator() -> (Machine, Coupling) {
    let machine = Machine::four_axes(&[]).unwrap();
    let mechanism = machine.mechanism.unwrap_or_else(mechanism_of_20_tonnes);
    let axes: &[Axis; AXES] = machine.axes.first_chunk().unwrap();
    let coupling = Coupling::new(&mechanism, axes.each_ref().map(|axis| axis.stroke), None).unwrap();
    (machine, coupling)
}

fn mechanism_of_20_tonnes() -> mechanism::Mechanism {
    let tables = include_str!("../../../../examples/mechanism.toml");
    let keys = ["mass =", "load_force =", "load_stiffness ="];
    let own = pipeline::machine::FOUR_AXES.lines().filter(|line| keys.iter().all(|key| !line.starts_with(key)));
    let text: Vec<&str> = own.chain([tables]).collect();
    let machine = Machine::parse(&text.join("\n"), "excavator", std::path::Path::new("."), &[]);
    machine.unwrap().mechanism.unwrap()
}

/// Springs and dampers of every axis, N/m and N s/m.
fn parts(machine: &Machine) -> [Parts; AXES] {
    std::array::from_fn(|i| {
        let axis = &machine.axes[i];
        Parts::new(axis, axis.plant.as_ref().unwrap(), &machine.hydraulics.unwrap(), &[], i, 1e5)
    })
}

#[test]
fn the_bound_of_the_eigenvalue_is_within_three_percent_of_it() {
    let (machine, coupling) = excavator();
    let springs = parts(&machine).map(|parts| parts.springs);
    for positions in postures(&coupling).step_by(37) {
        let bound = eigenvalue(&coupling, &positions, springs, 0.0).sqrt() / std::f64::consts::TAU;
        let highest = mechanism::natural_frequencies(&coupling.mass(&positions), &springs)[AXES - 1];
        // The frequency is the root of the eigenvalue.
        assert!((1.0 - 1e-12..1.015).contains(&(bound / highest)), "{bound} Hz for {highest} Hz");
    }
}

#[test]
fn no_posture_between_those_of_the_grid_is_faster_by_one_percent() {
    let (machine, coupling) = excavator();
    let parts = parts(&machine);
    for own in [parts.map(|parts| parts.springs), parts.map(|parts| parts.damping)] {
        let rate = |positions: [f64; AXES]| eigenvalue(&coupling, &positions, own, 0.0);
        let grid = postures(&coupling).map(rate).fold(0.0, f64::max);
        let strokes = *coupling.strokes();
        let part = |number: usize, of: usize| (number % of) as f64 / (of - 1) as f64;
        let between = (0..5 * 23 * 5 * 23).map(|n| [part(n, 5), part(n / 5, 23), part(n / 115, 5), part(n / 575, 23)]);
        let finest = between.map(|part| rate(std::array::from_fn(|i| part[i] * strokes[i]))).fold(0.0, f64::max);
        println!("grid {grid:.4e}, finer grid {finest:.4e}: {:+.2} %", 100.0 * (finest / grid - 1.0));
        assert!(finest < 1.01 * grid);
    }
}
