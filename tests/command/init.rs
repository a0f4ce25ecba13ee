//! `hydraxis init` and `hydraxis example`: files that pass `check`, can be simulated and commissioned, and refusals.

use std::{fs, path::Path};

use crate::harness::{
    Dice,
    cli::{expect_refusal, success},
};

/// The flags of the rig of the help text.
const RIG: [&str; 12] = [
    "--axes",
    "cylinder",
    "--stroke",
    "0.5",
    "--bore",
    "50mm",
    "--rod",
    "30mm",
    "--valve-hz",
    "8",
    "--dead-time",
    "40ms",
];

/// Runs `init` with these flags into `machine.toml` of the folder.
fn init(folder: &Path, flags: &[&str]) -> String {
    success(folder, &[&["init", "--force"], flags].concat())
}

/// Expects a machine file of which `check` says nothing but what it describes and the margins.
fn expect_clean(folder: &Path, arguments: &[&str]) {
    let text = success(folder, &[&["check", "machine.toml"], arguments].concat());
    assert!(text.contains("no problem found") && !text.contains("warning") && !text.contains("note"), "{text}");
}

/// The tracking errors of `simulate`, rmse in mm, by axis.
fn tracking(folder: &Path, arguments: &[&str]) -> Vec<(String, f64)> {
    let text =
        success(folder, &[&["simulate", "machine.toml", "--duration", "40s", "--json", "-"], arguments].concat());
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let axes = figures["axes"].as_object().unwrap();
    axes.iter().map(|(name, axis)| (name.clone(), 1e3 * axis["tracking"]["rmse"].as_f64().unwrap())).collect()
}

/// A number of the range, each order of magnitude equally likely, with two digits.
fn between(dice: &mut Dice, low: f64, high: f64) -> f64 {
    let part = dice.below(1001) as f64 / 1000.0;
    format!("{:.1e}", low * (high / low).powf(part)).parse::<f64>().unwrap().clamp(low, high)
}

/// Flags of a random rig.
fn flags(dice: &mut Dice) -> Vec<String> {
    let axes = ["rig", "boom,arm", "a,b,c"][dice.below(3) as usize];
    let mut flags = vec!["--axes".to_owned(), axes.to_owned()];
    let mut add = |flag: &str, value: String| flags.extend([flag.to_owned(), value]);
    // Each axis has a value of its own, or all have the same.
    let each = |dice: &mut Dice, low: f64, high: f64, unit: &str| {
        if dice.once_in(2) {
            return format!("{}{unit}", between(dice, low, high));
        }
        let values = axes.split(',').map(|axis| format!("{axis}={}{unit}", between(dice, low, high)));
        values.collect::<Vec<_>>().join(",")
    };
    add("--stroke", each(dice, 0.05, 10.0, ""));
    let bore = between(dice, 25.0, 500.0);
    add("--bore", format!("{bore}mm"));
    add("--rod", format!("{:.2}cm", 0.1 * bore * dice.one_of(&[0.25, 0.5, 0.6, 0.7, 0.85])));
    add("--valve-hz", each(dice, 1.0, 100.0, "Hz"));
    add("--dead-time", each(dice, 0.1, 500.0, "ms"));
    if dice.once_in(2) {
        add("--pressure", format!("{}bar", between(dice, 50.0, 400.0)));
    }
    if dice.once_in(2) {
        add("--dead-band", each(dice, 0.1, 60.0, "%"));
    }
    if dice.once_in(3) {
        add("--period", format!("{}ms", dice.one_of(&[1, 2, 5, 10, 20, 50])));
    }
    flags
}

#[test]
fn every_rig_has_a_machine_file_without_problems_and_warnings() {
    let folder = tempfile::tempdir().unwrap();
    let mut dice = Dice::new("init", "HYDRAXIS_INIT_SEED", "");
    for _ in 0..40 {
        let flags = flags(&mut dice);
        dice.note(&flags.join(" "));
        init(folder.path(), &flags.iter().map(String::as_str).collect::<Vec<_>>());
        expect_clean(folder.path(), &[]);
    }
}

#[test]
fn the_bounds_of_what_is_asked_for_have_files_without_problems_too() {
    let folder = tempfile::tempdir().unwrap();
    for optional in [
        &["--speed", "1m/s"][..],
        &["--speed", "0.00834"],
        &["--mass", "45kg"],
        &["--mass", "12t"],
        &["--load", "20kN"],
        &["--load", "-12kN"],
        &["--resolution", "1um"],
        &["--resolution", "0.5mm"],
        &["--dead-band", "0"],
        &["--dead-band", "60%"],
        &["--source", "external"],
        &["--source", "can"],
        &["--name", "a \"rig\" in hall 3"],
    ] {
        init(folder.path(), &[&RIG[..], optional].concat());
        expect_clean(folder.path(), &[]);
    }
}

/// Regression: two counts of the encoder, rounded for people, were less than two rounded counts.
#[test]
fn a_resolution_of_many_digits_has_a_rest_band_that_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    for resolution in ["0.00027027", "0.00060024", "0.00033335", "0.00049995", "0.00012345678", "0.00013333333"] {
        init(folder.path(), &[&RIG[..], &["--resolution", resolution]].concat());
        expect_clean(folder.path(), &[]);
    }
    let rig = "--axes c --stroke 1 --bore 120mm --rod 48mm --valve-hz 2 --dead-time 40ms --resolution 0.00027027";
    init(folder.path(), &rig.split(' ').collect::<Vec<_>>());
    expect_clean(folder.path(), &[]);
}

/// Regression: pistons of all sizes leaked the same, and small ones drifted until their axis was latched as stalled.
#[test]
fn a_small_cylinder_follows_its_own_reference_without_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let rig = "--axes c --stroke 0.05 --valve-hz 60 --dead-time 2ms --speed 0.0167 --dead-band 5% \
               --resolution 1.35135e-05 --period 10ms";
    for (bore, rod) in [("25mm", "17.5mm"), ("30mm", "21mm"), ("40mm", "28mm")] {
        let flags: Vec<&str> = rig.split_whitespace().chain(["--bore", bore, "--rod", rod]).collect();
        init(folder.path(), &flags);
        let text = success(folder.path(), &["simulate", "machine.toml", "--duration", "60s", "--json", "-"]);
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        let axis = &report["axes"]["c"];
        let (latch, max) = (&axis["latch"], axis["tracking"]["max"].as_f64().unwrap());
        assert!(latch.is_null() && max < 2e-3, "{bore}: {latch}, {max} m");
    }
}

#[test]
fn a_twin_follows_and_follows_better_when_it_is_commissioned() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for flags in [
        &RIG[..],
        &[
            "--axes",
            "fast",
            "--stroke",
            "0.3",
            "--bore",
            "40mm",
            "--rod",
            "22mm",
            "--valve-hz",
            "50",
            "--dead-time",
            "5ms",
        ],
        &[
            "--axes",
            "boom,arm",
            "--stroke",
            "boom=1.2,arm=0.8",
            "--bore",
            "120mm",
            "--rod",
            "85mm",
            "--valve-hz",
            "3",
            "--dead-time",
            "boom=120ms,arm=0.08",
            "--dead-band",
            "35%",
            "--load",
            "boom=60kN,arm=0",
        ],
    ] {
        init(folder, flags);
        let before = tracking(folder, &[]);
        let told = crate::harness::cli::run(folder, &["commission", "machine.toml", "--force"]);
        assert_eq!(told.status.code(), Some(0), "{told:?}");
        let told = success(folder, &["check", "machine.toml", "--model", "model.toml"]);
        assert!(told.contains("no problem found") && !told.contains("reference"), "{told}");
        let after = tracking(folder, &["--model", "model.toml"]);
        for ((axis, before), (_, after)) in before.into_iter().zip(after) {
            println!("{axis}: {before} mm, commissioned {after} mm");
            assert!(before < 40.0 && after < 1.0 && after < 0.1 * before, "{axis}: {before} mm, then {after} mm");
        }
    }
}

#[test]
fn flags_that_are_missing_are_named_where_nobody_can_be_asked() {
    let folder = tempfile::tempdir().unwrap();
    let all = "missing: --axes, --stroke, --bore, --rod, --valve-hz, --dead-time; allowed: all of them, or a terminal";
    expect_refusal(folder.path(), &["init"], &[all]);
    expect_refusal(folder.path(), &[&["init"], &RIG[..6]].concat(), &["missing: --rod, --valve-hz, --dead-time;"]);
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
}

#[test]
fn refusals_name_flag_value_and_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    for (flag, value, expected) in [
        ("--stroke", "5kg", "allowed: 50 mm to 10000 mm, as a number in m or with one of the units m, mm, cm, um, in"),
        ("--stroke", "500", "allowed: 50 mm to 10000 mm"),
        ("--stroke", "cylnder=1", "one value, or NAME=VALUE for each of the axes cylinder; did you mean `cylinder`?"),
        ("--bore", "", "allowed: 25 mm to 500 mm"),
        ("--rod", "50mm", "allowed: 10 mm to 45 mm"),
        ("--valve-hz", "nan", "allowed: 1 Hz to 100 Hz, as a number in Hz or with one of the units Hz, kHz"),
        ("--dead-time", "40", "allowed: 0 ms to 1000 ms"),
        ("--speed", "2", "mm/s to 1000 mm/s"),
        ("--mass", "1g", "kg, as a number in kg or with one of the units kg, t, g, lb"),
        ("--load", "1MN", "kN, as a number in N or"),
        ("--dead-band", "70%", "allowed: 0 % to 60 %, as a plain number or with one of the units %"),
        ("--resolution", "1in", "um, as a number in m"),
        ("--pressure", "cylinder=1", "allowed: one value, which is for all axes"),
        ("--period", "1s", "allowed: 1 ms to 50 ms"),
        ("--axes", "a,a", "allowed: 1 to 8 different names"),
        ("--axes", "", "allowed: 1 to 8 different names"),
    ] {
        // The last of two flags would be refused by the parser: the value takes the place of the good one.
        let mut flags: Vec<&str> = RIG.to_vec();
        match flags.iter().position(|known| *known == flag) {
            Some(place) => flags[place + 1] = value,
            None => flags.extend([flag, value]),
        }
        let found = format!("{flag}: found \"{value}\"; ");
        expect_refusal(folder.path(), &[&["init"], &flags[..]].concat(), &[&found, expected]);
    }
    expect_refusal(folder.path(), &[&["init", "--output", "no/file.toml"], &RIG[..]].concat(), &["and no does not"]);
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
}

#[test]
fn a_file_that_is_there_is_overwritten_with_force_only() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("machine.toml");
    fs::write(&file, "mine").unwrap();
    let there = "--output: found machine.toml, which is there already; allowed: a new file, or --force";
    expect_refusal(folder.path(), &[&["init"], &RIG[..]].concat(), &[there]);
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    let told = init(folder.path(), &RIG);
    assert!(told.contains("written: machine.toml") && told.contains("hydraxis check machine.toml"), "{told}");
    assert!(fs::read_to_string(&file).unwrap().contains("# Where encoder readings come from"));
}

#[test]
fn a_name_with_a_space_is_one_word_of_the_next_command() {
    let folder = tempfile::tempdir().unwrap();
    let told = success(folder.path(), &[&["init", "--output", "it's a rig.toml"], &RIG[..]].concat());
    assert!(told.contains(r"hydraxis check 'it'\''s a rig.toml' "), "{told}");
}

#[test]
fn every_example_is_written_as_it_is_shipped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let shipped = |name: &str| fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(name)).unwrap();
    for line in success(folder, &["example"]).lines() {
        let name = line.split_whitespace().next().unwrap();
        let told = success(folder, &["example", name, "--force"]);
        assert!(told.starts_with(&format!("written: {name}\n")), "{told}");
        assert_eq!(fs::read(folder.join(name)).unwrap(), shipped(name), "{name}");
    }
    success(folder, &["example", "watch.py", "--output", "mine.py"]);
    assert_eq!(fs::read(folder.join("mine.py")).unwrap(), shipped("watch.py"));
    let there = "--output: found watch.py, which is there already; allowed: a new file, or --force";
    expect_refusal(folder, &["example", "watch.py"], &[there]);
    expect_refusal(folder, &["example", "wach.py"], &["example: found \"wach.py\"", "did you mean `watch.py`?"]);
    expect_refusal(folder, &["example", "plant"], &["did you mean `plant.py`?"]);
}
