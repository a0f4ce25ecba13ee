//! Keys and values of a machine file that are required, allowed or refused.

use std::{fs, path::Path};

use super::{
    EXCAVATOR,
    cli::{expect_refusal, refusal, success},
    expect_broken, expect_four_axes, folder_with, line_of, replaced,
};

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
    let expected = "axis.boom.max_sped: found an unknown key; allowed: one of can, columns, commissioned, control, \
                    encoder, identification, max_speed, plant, pressure, reference, soft_limits, stroke";
    expect_broken("max_speed = 1.0 ", "max_sped = 1.0 ", expected);
}

#[test]
fn a_long_line_of_a_file_is_cut_where_it_is_quoted() {
    let folder = folder_with(&format!("a={}", "[".repeat(100_000)));
    let said = refusal(folder.path(), &["check", "m.toml"]);
    assert!(said.contains("\"a=[[[[") && said.len() < 2000, "{} bytes: {said:.300}", said.len());
}

#[test]
fn control_characters_of_a_file_reach_the_terminal_as_escapes() {
    let named = replaced(EXCAVATOR, "name = \"", "name = \"\\u001b[2J");
    let said = success(folder_with(&named).path(), &["check", "m.toml"]);
    assert!(said.contains("\\u{1b}[2J") && !said.contains('\u{1b}'), "{said}");
    let broken = replaced(&named, "mass = 40e3", "mass = \"\\u001b[2J\"");
    let said = refusal(folder_with(&broken).path(), &["check", "m.toml"]);
    assert!(said.contains("found \"\\u{1b}[2J\"") && !said.contains('\u{1b}'), "{said}");
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

/// The example with copies of the bucket, so that it has `count` axes.
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
    let expected = "m.toml: found a file without a key; allowed: a machine file with name, [timing], [source] and \
                    [axis.NAME], such as `hydraxis init` writes";
    for text in ["", "\n# nothing yet\n"] {
        expect_refusal(folder_with(text).path(), &["check", "m.toml"], &[expected]);
    }
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

#[test]
fn plants_too_fast_for_the_simulator_are_reported_at_once() {
    let arm = replaced(EXCAVATOR, "mass = 12e3", "mass = 1.0");
    let folder = folder_with(&replaced(&arm, "mass = 3e3", "mass = 1.0"));
    let expected = ["axis.arm.plant: found a motion", "axis.telescope.plant: found a motion", "allowed: up to"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}
