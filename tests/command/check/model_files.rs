//! `--model`: files that commissioning writes.

use std::fs;

use super::{
    EXCAVATOR,
    cli::{expect_refusal, run, success},
    expect_four_axes, folder_with,
};

/// A model file for the boom, as commissioning writes it.
pub const MODEL: &str = "[axis.boom.commissioned]\ndead_time = 0.02\ntime_constant = 0.05\ndead_band_extend = 0.1\n\
                     dead_band_retract = 0.08\nopenings = [0.1, 0.3]\nspeeds_extend = [0.05, 0.2]\n\
                     speeds_retract = [0.05, 0.2]\nfit_percent = 97.5\n";

#[test]
fn a_model_file_adds_to_the_machine_file_and_is_judged_like_it() {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    expect_four_axes(&success(folder.path(), &["check", "m.toml", "--model", "model.toml"]));
    fs::write(folder.path().join("model.toml"), MODEL.replace("[0.1, 0.3]", "[0.3, 0.1]")).unwrap();
    let line = 1 + MODEL[..MODEL.find("openings").unwrap()].matches('\n').count();
    let found = format!("axis.boom.commissioned.openings: found [0.3, 0.1] (from the model file, line {line})");
    let expected = [found.as_str(), "allowed: 1 to 16 rising numbers greater than 0"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"], &expected);
    fs::write(folder.path().join("model.toml"), MODEL.replace("dead_time", "deadtime")).unwrap();
    let expected = ["axis.boom.commissioned.deadtime", "found an unknown key"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"], &expected);
    let expected = ["no.toml: found a file that cannot be read", "allowed: a model file"];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "no.toml"], &expected);
}

#[test]
fn a_model_of_another_machine_is_warned_of_with_both_machines() {
    let folder = folder_with(EXCAVATOR);
    let check = ["check", "m.toml", "--model", "model.toml"];
    let measured_on = |text: &str| {
        let model = MODEL.replace("dead_time", &format!("measured_on = \"{text}\"\ndead_time"));
        fs::write(folder.path().join("model.toml"), model).unwrap();
    };
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    let text = success(folder.path(), &check);
    let note = "note: axis.boom.commissioned.measured_on: found nothing, so the machine is not compared\n";
    assert!(text.ends_with(note), "{text}");

    measured_on("another machine");
    let text = success(folder.path(), &check);
    let warning = "warning: axis.boom.commissioned.measured_on: found \"another machine\", and this machine is \"";
    let (_, rest) = text.split_once(warning).expect(&text);
    let here = rest.split('"').next().unwrap();
    assert!(here.starts_with("stroke 1.334 m, period 10ms, machine ") && !text.contains("note:"), "{text}");
    let output = run(folder.path(), &["simulate", "m.toml", "--model", "model.toml", "--duration", "1s"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.starts_with(warning) && said.lines().count() == 1, "{said}");

    measured_on(here);
    let text = success(folder.path(), &check);
    assert!(!text.contains("measured_on"), "{text}");
}
