//! Machine files with one mistyped line.

use std::fs;

use super::{fault, folder, judge};

/// The file, the text of a line, what is typed in its place, and parts of the answer.
type Edit = (&'static str, &'static str, &'static str, &'static [&'static str]);

const SOFT: &str = "soft_limits = [0.025, 0.475]";
const STROKE: &str = "axis.cylinder.stroke: found ";
const METRES: &str = "allowed: a number from 0.001 to 100 m";

const EDITS: &[Edit] = &[
    ("four.toml", "[timing]", "[timming]", &["timming: found an unknown key; allowed: one of axis", "`timing`?"]),
    ("four.toml", "[axis.boom]", "[axis.boom", &["found unclosed table, expected `]` in \"[axis.boom\"", "valid TOML"]),
    ("four.toml", "[axis.boom]", "[axes.boom]", &["axes: found an unknown key; allowed: one of axis", "`axis`?"]),
    ("four.toml", "[axis.arm]", "[axis.boom]", &["found duplicate key in \"[axis.boom]\"; allowed: valid TOML"]),
    ("four.toml", "period = \"10ms\"", "period = 10ms", &["found string values must be quoted", "period = 10ms"]),
    ("four.toml", "period = \"10ms\"", "period = \"10\"", &["timing.period: found \"10\"", "a duration with its unit"]),
    ("four.toml", "period = \"10ms\"", "period = \"10 mss\"", &["timing.period: found \"10 mss\"", "with its unit"]),
    (
        "four.toml",
        "period = \"10ms\"",
        "period = \"-10ms\"",
        &["timing.period: found \"-10ms\"", "\"100us\" to \"10s\""],
    ),
    ("four.toml", "period = \"10ms\"", "periode = \"10ms\"", &["timing.periode: found an unknown key", "`period`?"]),
    ("four.toml", "kind = \"sines\"", "kind = \"sine\"", &["boom.reference.kind: found \"sine\"", "`sines`?"]),
    ("four.toml", "kind = \"sines\"", "kind = sines", &["found string values must be quoted", "\"kind = sines\""]),
    ("external.toml", "kind = \"external\"", "kind = \"externl\"", &["source.kind: found \"externl\"", "`external`?"]),
    ("external.toml", "kind = \"external\"", "kind = \"extern\"", &["source.kind: found \"extern\"", "`external`?"]),
    ("rig.toml", "kind = \"sim\"", "kind = \"smi\"", &["source.kind: found \"smi\"", "did you mean `sim`?"]),
    ("rig.toml", "[source]", "[sorce]", &["sorce: found an unknown key; allowed: one of axis", "`source`?"]),
    (
        "rig.toml",
        "stroke = 0.5",
        "stroke = \"0.5\"",
        &[STROKE, "\"0.5\"", METRES, "one of the units m, mm, cm, um, in"],
    ),
    ("rig.toml", "stroke = 0.5", "stroke = \"0.5 kg\"", &[STROKE, "\"0.5 kg\"", METRES, "one of the units m, mm"]),
    ("rig.toml", "stroke = 0.5", "stroke = \"0.5 m", &["found invalid basic string, expected `\"`", "valid TOML"]),
    ("rig.toml", "stroke = 0.5", "stroke = -0.5", &[STROKE, "-0.5", METRES]),
    ("rig.toml", "stroke = 0.5", "stroke = 0,5", &["\"stroke = 0,5", "a number has a decimal point, such as 0.5"]),
    ("rig.toml", "stroke = 0.5", "stroke = nan", &[STROKE, "nan", METRES]),
    ("rig.toml", "stroke = 0.5", "stroke = inf", &[STROKE, "inf", METRES]),
    ("rig.toml", "stroke = 0.5", "stroke = \"\"", &[STROKE, "\"\"", METRES]),
    ("rig.toml", "stroke = 0.5", "stroke = 500", &[STROKE, "500", METRES]),
    ("rig.toml", "stroke = 0.5", "strok = 0.5", &[STROKE, "nothing", "strok: found an unknown key", "`stroke`?"]),
    ("rig.toml", "stroke = 0.5", "# stroke", &[STROKE, "nothing", METRES]),
    ("rig.toml", SOFT, "soft_limits = [0.025, 0.9]", &["soft_limits: found [0.025, 0.9]", "high <= stroke (0.5)"]),
    ("rig.toml", SOFT, "soft_limits = [0.475, 0.025]", &["soft_limits: found [0.475, 0.025]", "low < high"]),
    ("rig.toml", SOFT, "soft_limits = 0.025, 0.475", &["\"soft_limits = 0.025, 0.475", "allowed: valid TOML"]),
    (
        "rig.toml",
        "resolution = \"50um\"",
        "resolution = \"50 ums\"",
        &["resolution: found \"50 ums\"", "one of the units"],
    ),
    (
        "rig.toml",
        "resolution = \"50um\"",
        "resolution = 0",
        &["encoder.resolution: found 0; allowed: a number from 0.00"],
    ),
    ("rig.toml", "[axis.cylinder.encoder]", "[axis.cylinder.encodr]", &["cylinder.encodr: found an", "`encoder`?"]),
    ("rig.toml", "[axis.cylinder.encoder]", "[axis.cylindr.encoder]", &["axis.cylindr: found an", "`cylinder`?"]),
    ("rig.toml", "nk = 5", "nk = 5.5", &["identification.nk: found 5.5; allowed: a whole number from 1 to 1024"]),
    ("rig.toml", "nk = 5", "nk = \"five\"", &["identification.nk: found \"five\"; allowed: a whole number from 1"]),
    ("rig.toml", "nk = 5", "nk = 0", &["identification.nk: found 0; allowed: a whole number from 1 to 1024"]),
    (
        "rig.toml",
        "training = \"8s\"",
        "training = 8",
        &["training: found 8; allowed: 21 to", "a duration such as \"0.5s\""],
    ),
];

#[test]
fn a_mistyped_line_is_answered_with_its_number_and_what_is_allowed() {
    let folder = folder();
    let faults = EDITS.iter().filter_map(|(file, from, to, expected)| {
        let text = fs::read_to_string(folder.path().join(file)).unwrap();
        let at = text.find(from).unwrap_or_else(|| panic!("{file} has no {from:?}"));
        fs::write(folder.path().join("mine.toml"), text.replacen(from, to, 1)).unwrap();
        let place = format!("mine.toml:{}: ", 1 + text[..at].matches('\n').count());
        // A key that is missing is told at the line of its table, which stands before.
        let is_missing = expected.contains(&"nothing") || to.starts_with("periode");
        let place = if is_missing { "mine.toml:" } else { place.as_str() };
        fault(folder.path(), "check mine.toml", &[&[place][..], expected].concat())
            .map(|fault| format!("{from} -> {to}: {fault}"))
    });
    judge(EDITS.len(), faults.collect());
}
