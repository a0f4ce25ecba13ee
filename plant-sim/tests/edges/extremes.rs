//! Machines with one or a few parameters at the end of their range, or as close to it as the step allows.

use toml::Value;

use super::{bounds, text};

/// Checks a machine with four such axes, each of which gets other commands.
fn check(what: &str, edits: &[(&'static str, f64)], hydraulics: &[(&str, f64)]) {
    let axis: text::Edits = edits.iter().map(|(key, value)| (*key, Value::Float(*value))).collect();
    bounds::check(&text::machine(&vec![axis; 4], hydraulics), what);
}

#[test]
fn no_friction_no_damping_no_dead_band() {
    let nothing = [
        ("coulomb_friction", 0.0),
        ("static_friction", 0.0),
        ("viscous_friction", 0.0),
        ("end_stop_damping", 0.0),
        ("internal_leakage", 0.0),
        ("dead_band_extend", 0.0),
        ("dead_band_retract", 0.0),
        ("hysteresis", 0.0),
        ("dead_time", 0.0),
        ("valve_time_constant", 1e-3),
    ];
    check("nothing", &nothing, &[]);
}

#[test]
fn the_widest_dead_band_hysteresis_and_delays() {
    let valve = [
        ("dead_band_extend", 0.9),
        ("dead_band_retract", 0.9),
        ("hysteresis", 0.2),
        ("dead_time", 0.5),
        ("valve_time_constant", 10.0),
    ];
    check("slow valve", &valve, &[]);
}

#[test]
fn an_s_shaped_curve_with_the_least_span() {
    let spans = [
        ("dead_band_extend", 0.0),
        ("saturation_extend", 0.05),
        ("dead_band_retract", 0.5),
        ("saturation_retract", 0.55),
        ("valve_time_constant", 1e-3),
    ];
    let mut axis: text::Edits = spans.iter().map(|(key, value)| (*key, Value::Float(*value))).collect();
    axis.push(("valve_curve", "s".into()));
    bounds::check(&text::machine(&vec![axis; 4], &[]), "steep S");
}

#[test]
fn the_heaviest_mass_between_the_softest_stops() {
    // The piston pushes so soft a stop through all the dead volume. With less dead volume the step would be too long.
    let volumes = [("piston_dead_volume", 5e-3), ("rod_dead_volume", 5e-3)];
    let soft = [("mass", 1e6), ("end_stop_stiffness", 1e5), ("end_stop_damping", 0.0)];
    check("heavy", &[volumes.as_slice(), soft.as_slice()].concat(), &[]);
}

#[test]
fn the_largest_areas_and_volumes() {
    let large = [("piston_area", 1.0), ("rod_area", 1.0), ("piston_dead_volume", 1.0), ("rod_dead_volume", 1.0)];
    let others = [("mass", 1e6), ("rated_flow", 1.0)];
    check("large", &[large.as_slice(), others.as_slice()].concat(), &[("supply.flow", 10.0)]);
}

#[test]
fn the_smallest_areas_with_the_smallest_flow() {
    let small = [("piston_area", 1e-5), ("rod_area", 1e-5), ("rated_flow", 1e-6), ("load_force", 10.0)];
    let friction = [("coulomb_friction", 10.0), ("static_friction", 20.0), ("mass", 100.0), ("end_stop_damping", 1e4)];
    check("small", &[small, friction].concat(), &[]);
}

#[test]
fn a_relief_pressure_below_that_of_the_pump() {
    check("early relief", &[("relief_pressure", 5e6)], &[]);
}

#[test]
fn loads_beyond_what_the_pump_holds() {
    for load in [6e5, -6e5] {
        check("load", &[("load_force", load)], &[]);
    }
}

#[test]
fn the_smallest_pump() {
    check("small pump", &[], &[("supply.flow", 1e-6)]);
}

#[test]
fn most_and_least_air_in_the_softest_and_the_hardest_oil() {
    check("foam", &[], &[("oil.air", 0.3), ("oil.bulk_modulus", 1e8)]);
    check("hard oil", &[("rated_flow", 1e-3)], &[("oil.air", 2e-3), ("oil.bulk_modulus", 5e9)]);
}

#[test]
fn the_largest_leakage() {
    let volumes = [("piston_dead_volume", 1.0), ("rod_dead_volume", 1.0)];
    let leaks = [("internal_leakage", 1e-9), ("external_leakage", 1e-9)];
    check("leaks", &[volumes.as_slice(), leaks.as_slice()].concat(), &[]);
}

/// Soft stops and a light mass under a load that changes rapidly with the position. Without a largest rate of the
/// bristles their deflection went to infinity.
#[test]
fn a_light_mass_under_a_load_that_changes_rapidly() {
    let mut axis: text::Edits = [
        ("stroke", 4.0),
        ("initial_position", 2.0729),
        ("piston_area", 0.0763),
        ("rod_area", 5.509e-3),
        ("piston_dead_volume", 4.187e-3),
        ("rod_dead_volume", 3.586e-4),
        ("mass", 31.48),
        ("bristle_stiffness", 6.376e6),
        ("relief_pressure", 52.7e6),
        ("rated_flow", 2.18e-6),
        ("end_stop_stiffness", 1.331e5),
        ("end_stop_damping", 0.0),
    ]
    .map(|(key, value)| (key, Value::Float(value)))
    .to_vec();
    axis.push(("load_force", Value::Array([-3.6, -1.412e6, -4603.0].map(Value::Float).to_vec())));
    let oil = [("supply.pressure", 1.834e6), ("supply.return_pressure", 1.651e6), ("oil.bulk_modulus", 2.43e8)];
    bounds::check(&text::machine(&[axis], &oil), "rapidly changing load");
}
