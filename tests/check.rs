//! `hydraxis check` as a user runs it: machine files that are good, and broken ones with every kind of mistake, whose
//! refusal names file and line, key, what was found and what is allowed, all mistakes at once; and `--set`.

mod cli;

use std::{fs, path::Path};

use cli::{expect_refusal, refusal, success};
use tempfile::TempDir;

const EXCAVATOR: &str = include_str!("../examples/excavator.toml");
/// The boom's own reference, from its kind to its last sine.
const BOOM_SINES: &str = "kind = \"sines\"
center = 0.65
sines = [
  { amplitude = 0.12, frequency = 0.11 },
  { amplitude = 0.05, frequency = 0.29, phase = 1.0 },
  { amplitude = 0.02, frequency = 0.71, phase = 2.0 },
]";
/// The arm's.
const ARM_SINES: &str = "kind = \"sines\"
center = 0.75
sines = [
  { amplitude = 0.13, frequency = 0.13, phase = 0.5 },
  { amplitude = 0.05, frequency = 0.31, phase = 1.5 },
  { amplitude = 0.02, frequency = 0.67, phase = 2.5 },
]";

/// The text with the first `from` replaced, which has to be there.
fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the machine file has no {from:?}");
    text.replacen(from, to, 1)
}

/// Line of the first `wanted` in the example, from 1.
fn line_of(wanted: &str) -> usize {
    1 + EXCAVATOR[..EXCAVATOR.find(wanted).expect(wanted)].matches('\n').count()
}

/// A folder with the text as `m.toml`.
fn folder_with(text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("m.toml"), text).unwrap();
    folder
}

/// Checks the example with `from` replaced; the refusal is to name the line of `from` and then `expected`.
fn expect_broken(from: &str, to: &str, expected: &str) {
    let folder = folder_with(&replaced(EXCAVATOR, from, to));
    expect_refusal(folder.path(), &["check", "m.toml"], &[&format!("m.toml:{}: {expected}", line_of(from))]);
}

fn expect_four_axes(text: &str) {
    for axis in ["boom", "arm", "telescope", "bucket"] {
        assert!(text.contains(axis), "{axis} in {text}");
    }
    assert!(text.contains("4 axes") && text.contains("no problem found"), "{text}");
}

#[test]
fn the_built_in_machine_has_four_axes_and_no_problem() {
    expect_four_axes(&success(tempfile::tempdir().unwrap().path(), &["check"]));
}

#[test]
fn the_example_has_four_axes_and_no_problem() {
    expect_four_axes(&success(Path::new(env!("CARGO_MANIFEST_DIR")), &["check", "examples/excavator.toml"]));
}

#[test]
fn an_unknown_key_is_refused_with_those_that_are_known() {
    let expected = "axis.boom.max_sped: found an unknown key; allowed: one of columns, commissioned, control, encoder, forgetting, \
                    identification, max_speed, plant, reference, soft_limits, stroke";
    expect_broken("max_speed = 1.0 ", "max_sped = 1.0 ", expected);
}

#[test]
fn an_unknown_table_is_refused() {
    expect_broken("[axis.arm.control]", "[axis.arm.contrl]", "axis.arm.contrl: found an unknown key; allowed: one of");
}

#[test]
fn a_missing_key_is_refused_with_what_it_takes() {
    let folder = folder_with(&replaced(EXCAVATOR, "max_speed = 1.0 ", "# "));
    let table = line_of("[axis.boom]");
    let expected = format!("m.toml:{table}: axis.boom.max_speed: found nothing; allowed: a number from 0.001 to 1000");
    expect_refusal(folder.path(), &["check", "m.toml"], &[&expected]);
}

#[test]
fn a_number_in_the_place_of_a_duration_is_refused() {
    let expected = "timing.period: found 10; allowed: a duration with its unit, \"100us\" to \"10s\"";
    expect_broken("period = \"10ms\"", "period = 10", expected);
}

#[test]
fn a_length_in_the_place_of_a_duration_is_refused() {
    let expected = "timing.period: found \"10 cm\"; allowed: a duration with its unit, \"100us\" to \"10s\"";
    expect_broken("period = \"10ms\"", "period = \"10 cm\"", expected);
}

#[test]
fn text_in_the_place_of_a_number_is_refused() {
    let expected = "axis.boom.plant.mass: found \"heavy\"; allowed: a number from 1 to 1000000 kg";
    expect_broken("mass = 40e3", "mass = \"heavy\"", expected);
}

#[test]
fn not_a_number_is_refused() {
    let expected = "axis.boom.stroke: found nan; allowed: a number from 0.001 to 100 m";
    expect_broken("stroke = 1.334", "stroke = nan", expected);
}

#[test]
fn infinity_is_refused() {
    let expected = "axis.boom.control.kp: found inf; allowed: a number from 0 to 10000 1/m";
    expect_broken("kp = 10.0 ", "kp = inf ", expected);
}

#[test]
fn minus_infinity_is_refused() {
    let expected = "axis.boom.plant.load_force: found -inf; allowed: a number from -10000000 to 10000000 N";
    expect_broken("load_force = [96e3, 120e3, 138e3]", "load_force = -inf", expected);
}

#[test]
fn a_negative_stroke_is_refused() {
    let expected = "axis.boom.stroke: found -1.334; allowed: a number from 0.001 to 100 m";
    expect_broken("stroke = 1.334", "stroke = -1.334", expected);
}

#[test]
fn two_axes_of_one_name_are_refused() {
    let folder = folder_with(&replaced(EXCAVATOR, "[axis.arm]", "[axis.boom]"));
    let expected = format!("m.toml:{}: found duplicate key in \"[axis.boom]\"; allowed: ", line_of("[axis.arm]"));
    expect_refusal(folder.path(), &["check", "m.toml"], &[&expected]);
}

#[test]
fn no_axis_is_refused() {
    let folder = folder_with(&EXCAVATOR[..EXCAVATOR.find("[axis.boom]").unwrap()]);
    let expected = ["m.toml: axis: found 0 axes; allowed: 1 to 8 axes"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}

/// The example with more buckets, up to so many axes in all.
fn axes(count: usize) -> String {
    let bucket = &EXCAVATOR[EXCAVATOR.find("[axis.bucket]").unwrap()..];
    let more = (4..count).map(|i| format!("\n{}", bucket.replace("axis.bucket", &format!("axis.extra{i}"))));
    EXCAVATOR.to_owned() + &more.collect::<String>()
}

#[test]
fn eight_axes_are_accepted() {
    let text = success(folder_with(&axes(8)).path(), &["check", "m.toml"]);
    assert!(text.contains("8 axes"), "{text}");
}

#[test]
fn nine_axes_are_refused() {
    let expected = format!("m.toml:{}: axis: found 9 axes; allowed: 1 to 8 axes", line_of("[axis.boom]"));
    expect_refusal(folder_with(&axes(9)).path(), &["check", "m.toml"], &[&expected]);
}

#[test]
fn an_unknown_kind_of_reference_is_refused_with_those_that_are_known() {
    let expected = "axis.boom.reference.kind: found \"spline\"; \
                    allowed: \"hold\" or \"sines\" or \"ramps\" or \"trajectory\" or \"channel\"";
    expect_broken("kind = \"sines\"", "kind = \"spline\"", expected);
}

#[test]
fn a_reference_that_leaves_the_soft_limits_is_refused() {
    let folder = folder_with(&replaced(EXCAVATOR, "amplitude = 0.12,", "amplitude = 1.2,"));
    let sines = format!("m.toml:{}: axis.boom.reference.sines: found a reach", line_of("sines = ["));
    let expected = [&sines, "allowed: what stays in the soft limits, 0.05 to 1.284 m"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_machine_file_that_is_not_there_is_refused() {
    let expected = ["m.toml: found a file that cannot be read (No such file or directory", "allowed: a machine file"];
    expect_refusal(tempfile::tempdir().unwrap().path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_folder_in_the_place_of_a_machine_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("m.toml")).unwrap();
    let expected = ["m.toml: found a file that cannot be read (Is a directory", "allowed: a machine file"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}

#[test]
fn what_is_not_toml_is_refused() {
    let folder = folder_with("# a comment\nthis is no TOML\n");
    let errors = refusal(folder.path(), &["check", "m.toml"]);
    assert!(errors.starts_with("m.toml:2: found ") && errors.contains("allowed: valid TOML"), "{errors}");
}

#[test]
fn an_empty_machine_file_is_refused_with_what_it_lacks() {
    let expected =
        ["m.toml: name: found nothing", "m.toml: timing.period: found nothing", "m.toml: axis: found 0 axes"];
    expect_refusal(folder_with("").path(), &["check", "m.toml"], &expected);
}

#[test]
fn problems_of_one_file_are_reported_at_once_in_the_order_of_lines() {
    let mut text = EXCAVATOR.to_owned();
    let broken = [
        ("period = \"10ms\"", "period = 10", "timing.period: found 10;"),
        ("max_speed = 1.0 ", "max_speed = nan ", "axis.boom.max_speed: found nan;"),
        ("mass = 12e3", "mass = \"heavy\"", "axis.arm.plant.mass: found \"heavy\";"),
        ("center = 0.55", "centre = 0.55", "axis.bucket.reference.centre: found an unknown key;"),
    ];
    for (from, to, _) in broken {
        text = replaced(&text, from, to);
    }
    let errors = refusal(folder_with(&text).path(), &["check", "m.toml"]);
    let found = broken.map(|(from, _, expected)| {
        let problem = format!("m.toml:{}: {expected}", line_of(from));
        errors.find(&problem).unwrap_or_else(|| panic!("no {problem:?} in\n{errors}"))
    });
    assert!(found.is_sorted(), "{errors}");
}

/// Checks the example with `line` in the boom's table of identification; the refusal is to name `expected`.
fn expect_broken_option(line: &str, expected: &str) {
    let folder = folder_with(&replaced(EXCAVATOR, "training = \"8s\" ", &format!("{line}\ntraining = \"8s\" ")));
    let place = format!("m.toml:{}: axis.boom.identification.{expected}", line_of("training = \"8s\" "));
    expect_refusal(folder.path(), &["check", "m.toml"], &[&place]);
}

#[test]
fn the_options_of_the_structure_are_accepted() {
    let options = "training = \"8s\"\nintegrator = true\ndrift = true\ndead_band = [0.07, 0.1]\n\
                   knots = [0, 0.2, 0.5]\norder = 3\noutput = \"velocity\" ";
    let folder = folder_with(&replaced(EXCAVATOR, "training = \"8s\" ", options));
    expect_four_axes(&success(folder.path(), &["check", "m.toml"]));
}

#[test]
fn a_number_in_the_place_of_a_flag_is_refused() {
    expect_broken_option("integrator = 1", "integrator: found 1; allowed: true or false");
    expect_broken_option("drift = \"yes\"", "drift: found \"yes\"; allowed: true or false");
}

#[test]
fn a_dead_band_that_is_none_is_refused() {
    for (typed, found) in [("-0.1", "-0.1"), ("0.95", "0.95"), ("nan", "nan"), ("[0.1]", "[0.1]"), ("true", "true")] {
        let expected = format!("dead_band: found {found}; allowed: a number from 0 to 0.9, or [low, high] of two");
        expect_broken_option(&format!("dead_band = {typed}"), &expected);
    }
}

#[test]
fn knots_that_do_not_rise_or_are_out_of_range_are_refused() {
    for (typed, found) in [
        ("[0.2, 0.1]", "[0.2, 0.1]"),
        ("[0.1, 0.1]", "[0.1, 0.1]"),
        ("[]", "[]"),
        ("[0, 0.1, 0.2, 0.3, 0.4, 0.5]", "[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]"),
        ("[-0.1, 0.2]", "[-0.1, 0.2]"),
        ("[0.5, 1.1]", "[0.5, 1.1]"),
        ("0.2", "0.2"),
    ] {
        let expected = format!("knots: found {found}; allowed: a list of 1 to 5 rising numbers from 0 to 1");
        expect_broken_option(&format!("knots = {typed}"), &expected);
    }
}

#[test]
fn an_order_that_is_not_the_number_of_knots_is_refused() {
    let expected = "order: found 3 with 2 knots; allowed: 2, the number of knots, or no order";
    expect_broken_option("order = 3\nknots = [0, 0.2]", expected);
}

#[test]
fn an_output_that_is_neither_position_nor_velocity_is_refused() {
    let expected = "output: found \"speed\"; allowed: \"position\" or \"velocity\"";
    expect_broken_option("output = \"speed\"", expected);
}

/// The example with the boom led by `path.csv`, which holds `rows` if there are any.
fn with_trajectory(rows: Option<&str>) -> TempDir {
    let folder = folder_with(&replaced(EXCAVATOR, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\""));
    if let Some(rows) = rows {
        fs::write(folder.path().join("path.csv"), format!("t,boom\n{rows}")).unwrap();
    }
    folder
}

#[test]
fn a_trajectory_is_accepted() {
    expect_four_axes(&success(with_trajectory(Some("0,0.65\n1,0.7\n")).path(), &["check", "m.toml"]));
}

#[test]
fn a_missing_trajectory_is_refused_with_its_key_and_file() {
    let expected = ["axis.boom.reference", "path.csv: ", "No such file or directory"];
    expect_refusal(with_trajectory(None).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_missing_trajectory_is_refused_with_what_is_allowed() {
    expect_refusal(with_trajectory(None).path(), &["check", "m.toml"], &["path.csv", "allowed: "]);
}

#[test]
fn a_bad_row_of_a_trajectory_is_refused_with_its_column() {
    let expected = ["axis.boom.reference", "path.csv", "column \"boom\": found \"nan\"; allowed: a finite number"];
    expect_refusal(with_trajectory(Some("0,0.65\n1,nan\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_bad_row_of_a_trajectory_is_refused_with_its_line() {
    expect_refusal(with_trajectory(Some("0,0.65\n1,nan\n")).path(), &["check", "m.toml"], &["path.csv:3: "]);
}

#[test]
fn a_trajectory_outside_the_soft_limits_is_refused() {
    let expected =
        ["axis.boom.reference", "path.csv", "found 9; allowed: positions in the soft limits, 0.05 to 1.284 m"];
    expect_refusal(with_trajectory(Some("0,0.65\n1,9\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn bad_rows_of_a_trajectory_are_reported_at_once() {
    let expected = ["found \"nan\"", "found \"inf\"", "found \"x\""];
    expect_refusal(with_trajectory(Some("0,nan\n1,inf\nx,0.65\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn missing_trajectories_of_two_axes_are_reported_at_once() {
    let boom = replaced(EXCAVATOR, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\"");
    let folder = folder_with(&replaced(&boom, ARM_SINES, "kind = \"trajectory\"\nfile = \"way.csv\""));
    let expected = ["axis.boom.reference", "path.csv", "axis.arm.reference", "way.csv"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}

#[test]
fn plants_too_fast_for_the_simulator_are_reported_at_once() {
    let arm = replaced(EXCAVATOR, "mass = 12e3", "mass = 1.0");
    let folder = folder_with(&replaced(&arm, "mass = 3e3", "mass = 1.0"));
    let expected = ["axis.arm.plant: found a motion", "axis.telescope.plant: found a motion", "allowed: up to"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}

/// The example fed from `r.csv`, which holds `rows` if there are any.
fn with_replay(rows: Option<&str>) -> TempDir {
    let folder = folder_with(&replaced(EXCAVATOR, "kind = \"sim\" ", "kind = \"replay\"\nfile = \"r.csv\" "));
    if let Some(rows) = rows {
        fs::write(folder.path().join("r.csv"), format!("t,u,y\n{rows}")).unwrap();
    }
    folder
}

#[test]
fn a_record_to_replay_is_accepted() {
    let text = success(with_replay(Some("0,0,0.5\n0.01,0,0.5\n")).path(), &["check", "m.toml"]);
    assert!(text.contains("replayed from r.csv"), "{text}");
}

#[test]
fn a_missing_record_to_replay_is_refused_with_its_file() {
    let expected = ["r.csv: ", "No such file or directory"];
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_missing_record_to_replay_is_refused_with_its_key() {
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &["source.file"]);
}

#[test]
fn a_missing_record_to_replay_is_refused_with_what_is_allowed() {
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &["r.csv", "allowed: "]);
}

#[test]
fn a_bad_row_of_a_record_to_replay_is_refused() {
    let expected = ["r.csv:3: row 2, column \"y\": found \"x\"; allowed: a finite number"];
    expect_refusal(with_replay(Some("0,0,0.5\n0.01,0,x\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_record_of_another_period_is_refused() {
    let expected = ["r.csv: found a period of 0.020000 s; allowed: ", "timing.period = 0.010000 s"];
    expect_refusal(with_replay(Some("0,0,0.5\n0.02,0,0.5\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_trajectory_and_a_record_that_are_both_missing_are_reported_at_once() {
    let folder = with_replay(None);
    let file = folder.path().join("m.toml");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, replaced(&text, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\"")).unwrap();
    expect_refusal(folder.path(), &["check", "m.toml"], &["path.csv: ", "r.csv: "]);
}

/// `check` of the built-in machine with one setting.
fn check_with(setting: &str) -> [&str; 3] {
    ["check", "--set", setting]
}

#[test]
fn settings_that_their_keys_take_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    for setting in [
        "axis.boom.control.kp=3",
        "axis.boom.forgetting=constant:0.995",
        "axis.boom.forgetting=\"paper\"",
        "axis.boom.forgetting=fuzzy:0.9",
        "axis.boom.forgetting=fortescue:500",
        "axis.boom.forgetting=directional:0.99",
        "axis.boom.forgetting=window:500",
        "axis.boom.forgetting=auto",
        "axis.arm.soft_limits=[0.1, 1.4]",
        "axis.boom.reference.sines[0].amplitude=0.01",
        "realtime.lock_memory=true",
        "stage.control-proc.core=3",
    ] {
        expect_four_axes(&success(folder.path(), &check_with(setting)));
    }
}

#[test]
fn a_setting_takes_the_place_of_the_value_in_the_file() {
    let folder = folder_with(&replaced(EXCAVATOR, "period = \"10ms\"", "period = 10"));
    let text = success(folder.path(), &["check", "m.toml", "--set", "timing.period=5ms"]);
    assert!(text.contains("every 5ms"), "{text}");
}

#[test]
fn the_last_of_several_settings_of_a_key_counts() {
    let folder = tempfile::tempdir().unwrap();
    let text = success(folder.path(), &["check", "--set", "timing.period=-1", "--set", "timing.period=20ms"]);
    assert!(text.contains("every 20ms"), "{text}");
}

#[test]
fn settings_that_their_keys_do_not_take_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, expected) in [
        (
            "axis.boom.control.kp=nan",
            "axis.boom.control.kp: found nan (from the command line); allowed: a number from 0 to 10000",
        ),
        (
            "axis.boom.stroke=-1",
            "axis.boom.stroke: found -1 (from the command line); allowed: a number from 0.001 to 100 m",
        ),
        ("timing.period=5", "timing.period: found 5 (from the command line); allowed: a duration with its unit"),
        ("realtime.lock_memory=yes", "realtime.lock_memory: found yes (from the command line); allowed: true or false"),
        (
            "axis.boom.forgetting=constant:2",
            "axis.boom.forgetting: found constant:2 (from the command line); allowed: \"auto\", \"paper\", \"constant:L\" with L",
        ),
        (
            "axis.boom.forgetting=fuzzy:1.0",
            "axis.boom.forgetting: found fuzzy:1.0 (from the command line); allowed: \"auto\", ",
        ),
        ("axis.boom.forgetting=window:1", "\"window:N\" with N from 2 to 100000 samples"),
        (
            "axis.boom.forgetting=window:3",
            "axis.boom.forgetting: found \"window:3\" for 5 coefficients; allowed: \"window:N\" with N from 5",
        ),
    ] {
        expect_refusal(folder.path(), &check_with(setting), &[expected]);
    }
}

#[test]
fn a_setting_of_an_unknown_key_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for key in ["axis.boom.kq", "axis.crane.stroke", "axis.boom.reference.sines[9].phase"] {
        let expected = format!("--set {key}: found an unknown key; allowed: a key of the machine file, not a table");
        expect_refusal(folder.path(), &check_with(&format!("{key}=3")), &[&expected]);
    }
}

#[test]
fn a_setting_without_key_or_value_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for setting in ["axis.boom.control.kp", "=3"] {
        expect_refusal(folder.path(), &check_with(setting), &["--set", setting, "allowed: KEY=VALUE"]);
    }
}

/// What commissioning writes, for the boom.
const MODEL: &str = "[axis.boom.commissioned]\ndead_time = 0.02\ntime_constant = 0.05\ndead_band_extend = 0.1\n\
                     dead_band_retract = 0.08\nopenings = [0.1, 0.3]\nspeeds_extend = [0.05, 0.2]\n\
                     speeds_retract = [0.05, 0.2]\nfit_percent = 97.5\n";

#[test]
fn a_model_file_adds_to_the_machine_file_and_is_judged_like_it() {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    expect_four_axes(&success(folder.path(), &["check", "m.toml", "--model", "model.toml"]));
    fs::write(folder.path().join("model.toml"), MODEL.replace("[0.1, 0.3]", "[0.3, 0.1]")).unwrap();
    let expected =
        ["axis.boom.commissioned.openings: found [0.3, 0.1]; allowed: 1 to 16 rising numbers greater than 0"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"], &expected);
    fs::write(folder.path().join("model.toml"), MODEL.replace("dead_time", "deadtime")).unwrap();
    let expected = ["axis.boom.commissioned.deadtime", "found an unknown key"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"], &expected);
    let expected = ["no.toml: found a file that cannot be read", "allowed: a model file"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "no.toml"], &expected);
}
