//! Quantities with a unit, and the nearest names of what is mistyped.

use std::fs;

use super::{EXCAVATOR, cli::success, expect_broken, expect_refusal, folder_with, replaced};

/// Values of the example in other units.
const UNITS: [(&str, &str); 11] = [
    ("stroke = 1.334 ", "stroke = \"1334mm\" "),
    ("max_speed = 1.0 ", "max_speed = \"100 cm/s\" "),
    ("soft_limits = [0.05, 1.284]", "soft_limits = [\"5cm\", 1.284]"),
    ("resolution = 1e-4", "resolution = \"0.1 mm\""),
    ("pressure = 25e6", "pressure = \"250bar\""),
    ("flow = 10e-3", "flow = \"600l/min\""),
    ("valve_time_constant = 0.05", "valve_time_constant = \"50ms\""),
    ("mass = 40e3", "mass = \"40t\""),
    ("load_force = [96e3, 120e3, 138e3]", "load_force = [\"96kN\", 120e3, \"0.138 MN\"]"),
    ("dead_band_extend = 0.10", "dead_band_extend = \"10%\""),
    ("phase = 1.0 }", "phase = \"57.29577951308232deg\" }"),
];

#[test]
fn a_value_in_any_unit_is_the_value_in_si() {
    let (plain, united) = (folder_with(EXCAVATOR), folder_with(EXCAVATOR));
    let text = UNITS.iter().fold(EXCAVATOR.to_owned(), |text, (from, to)| replaced(&text, from, to));
    fs::write(united.path().join("m.toml"), text).unwrap();
    let explain = ["check", "m.toml", "--explain"];
    assert_eq!(success(plain.path(), &explain), success(united.path(), &explain));
    // A setting has its unit without quotation marks.
    let explained = success(plain.path(), &[&explain[..], &["--set", "axis.boom.stroke=1400mm"]].concat());
    assert!(explained.lines().any(|line| line.contains("axis.boom.stroke") && line.contains(" 1.4 m")), "{explained}");
}

#[test]
fn a_unit_of_another_dimension_is_refused_with_those_that_are_allowed() {
    expect_broken(
        "stroke = 1.334",
        "stroke = \"40ms\"",
        "axis.boom.stroke: found \"40ms\"; allowed: a number from 0.001 to 100 m, or a text with one of the units m,",
    );
    expect_broken(
        "pressure = 25e6",
        "pressure = \"25\"",
        "supply.pressure: found \"25\"; allowed: a number from 100000",
    );
    expect_broken(
        "pressure = 25e6",
        "pressure = \"9kbar\"",
        "supply.pressure: found \"9kbar\"; allowed: a number from",
    );
    let folder = folder_with(EXCAVATOR);
    expect_refusal(
        folder.path(),
        &["check", "m.toml", "--set", "axis.boom.plant.dead_time=4mm"],
        &["axis.boom.plant.dead_time: found 4mm (from the command line); allowed: a number from 0 to 1 s, or a \
           text with one of the units s, ms, us, min"],
    );
}

#[test]
fn the_nearest_names_of_what_is_mistyped_are_proposed() {
    let folder = folder_with(EXCAVATOR);
    for (setting, expected) in [
        ("axis.boom.max_sped=1", "axis.boom.max_sped: found an unknown key; allowed: one of"),
        ("axis.boom.max_sped=1", "; did you mean `max_speed`?"),
        (
            "axis.bom.control.kp=1",
            "--set axis.bom: found an unknown key; allowed: one of arm, boom, bucket, telescope; did you",
        ),
        ("axis.boom.contol.kp=1", "; did you mean `control`?"),
        ("axis.boom.folowing_error=1", "; did you mean `axis.boom.control.following_error`?"),
        ("tming.period=5ms", "; did you mean `timing`?"),
        ("scenario=paylod", "scenario: found paylod (from the command line); allowed: \"nominal\""),
        ("scenario=paylod", "; did you mean `payload`?"),
        ("axis.boom.identification.estimator=fortescu", "; did you mean `fortescue`?"),
        ("axis.boom.control.model=adaptiv", "; did you mean `adaptive`?"),
        ("realtime.rights=strickt", "; did you mean `strict`?"),
    ] {
        expect_refusal(folder.path(), &["check", "m.toml", "--set", setting], &[expected]);
    }
    expect_broken("max_speed = 1.0", "max-speed = 1.0", "axis.boom.max-speed: found an unknown key; allowed: one of ");
    let text = replaced(EXCAVATOR, "[axis.boom.encoder]", "[axis.boom.encodr]");
    expect_refusal(
        folder_with(&text).path(),
        &["check", "m.toml"],
        &["axis.boom.encodr: found", "did you mean `encoder`?"],
    );
    expect_refusal(folder.path(), &["commission", "m.toml", "--axis", "boon"], &["; did you mean `boom`?"]);
    expect_refusal(folder.path(), &["identify", "--estimator", "grey-bx", "x.csv"], &["did you mean `grey-box`?"]);
}
