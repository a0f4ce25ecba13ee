//! `--model`: files that commissioning writes.

use std::fs;

use super::{
    EXCAVATOR,
    cli::{expect_refusal, refusal, run, success},
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
    let found =
        format!("model.toml:{line}: axis.boom.commissioned.openings: found [0.3, 0.1]; allowed: 1 to 16 rising");
    let expected = [found.as_str()];
    expect_refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"], &expected);
    fs::write(folder.path().join("model.toml"), MODEL.replace("dead_time", "deadtime")).unwrap();
    let expected = [
        "model.toml: axis.boom.commissioned.dead_time: found nothing; allowed: a number from 0 to 5 s\n",
        "model.toml:2: axis.boom.commissioned.deadtime: found an unknown key",
    ];
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

#[test]
fn a_real_machine_takes_no_model_of_its_twin_or_of_another_stroke() {
    let folder = folder_with(&EXCAVATOR.replacen("kind = \"sim\"", "kind = \"external\"", 1));
    let measured_on = |text: &str| {
        let model = MODEL.replace("dead_time", &format!("measured_on = \"{text}\"\ndead_time"));
        fs::write(folder.path().join("model.toml"), model).unwrap();
    };
    for foreign in ["stroke 1.334 m, period 10ms, machine 00000000", "stroke 1 m, period 10ms, rig 00000000"] {
        measured_on(foreign);
        for command in ["check", "run"] {
            let expected = [
                &format!("axis.boom.commissioned.measured_on: found \"{foreign}\"")[..],
                "leave this model out of the run, and measure its own with `hydraxis commission`",
            ];
            expect_refusal(folder.path(), &[command, "m.toml", "--model", "model.toml"], &expected);
        }
    }
    let said = refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"]);
    let (_, rest) = said.split_once("and this machine is \"").unwrap();
    measured_on(rest.split('"').next().unwrap());
    success(folder.path(), &["check", "m.toml", "--model", "model.toml"]);
    // Its twin takes it, too.
    let said = run(folder.path(), &["simulate", "m.toml", "--model", "model.toml", "--duration", "1s"]);
    assert!(said.status.success() && !String::from_utf8(said.stderr).unwrap().contains("measured_on"));
}

/// Expects that this text is refused as the model of a machine, with exactly these lines.
fn expect_refused_model(text: &str, lines: &[&str]) {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), text).unwrap();
    let said = refusal(folder.path(), &["check", "m.toml", "--model", "model.toml"]);
    let found: Vec<&str> = said.lines().collect();
    assert_eq!(found.len(), lines.len(), "{said}");
    for (found, line) in found.iter().zip(lines) {
        assert!(found.starts_with(line), "no {line:?} in\n{said}");
    }
}

#[test]
fn a_model_file_changes_nothing_but_the_models_and_how_they_are_used() {
    // What commissioning writes, and settings of a controller that a user tries.
    let folder = folder_with(EXCAVATOR);
    let more = "[axis.boom.identification]\nestimator = \"grey-box\"\n\
                [axis.boom.control]\nkp = 3.0\nmodel = \"adaptive\"\nhorizon = 10\n";
    fs::write(folder.path().join("model.toml"), format!("{MODEL}{more}")).unwrap();
    expect_four_axes(&success(folder.path(), &["check", "m.toml", "--model", "model.toml"]));

    let text = format!(
        "name = \"other\"\n[timing]\nperiod = \"5ms\"\nfeedback_timeout = \"50ms\"\n{MODEL}\
         [axis.boom]\nstroke = 9.0\nsoft_limits = [0.1, 8.0]\n[axis.boom.plant]\nmass = 1.0\n\
         [axis.boom.control]\nkp = 3.0\ncommand_limit = 0.9\n"
    );
    let belongs = "found a key that a model file does not have; allowed: only the tables commissioned, control \
                   and identification of an axis, without the limits of its machine; this key belongs into the machine \
                   file";
    let keys = ["1: name", "3: timing", "15: axis.boom.stroke", "16: axis.boom.soft_limits", "18: axis.boom.plant"];
    let lines: Vec<String> = keys
        .iter()
        .chain(&["21: axis.boom.control.command_limit"])
        .map(|key| format!("model.toml:{key}: {belongs}"))
        .collect();
    expect_refused_model(&text, &lines.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
fn a_model_of_an_axis_that_the_machine_does_not_have_is_refused_in_one_line() {
    let name = pipeline::machine::Machine::four_axes(&[]).unwrap().name;
    let line = format!(
        "model.toml: found a model of axis rig; allowed: a model of the machine \"{name}\", which has boom, arm, \
         telescope, bucket"
    );
    expect_refused_model(&MODEL.replace("boom", "rig"), &[&line]);
}

#[test]
fn a_model_file_without_a_model_is_refused_with_what_writes_one() {
    let allowed = "found nothing; allowed: a table with the model of the axis; `hydraxis commission MACHINE.toml --out \
                   FILE` measures it";
    expect_refused_model("", &[&format!("model.toml: axis.NAME.commissioned: {allowed}")]);
    let control = "[axis.boom.control]\nkp = 3.0\n";
    expect_refused_model(control, &[&format!("model.toml: axis.boom.commissioned: {allowed}")]);
}

#[test]
fn a_model_file_in_the_place_of_a_machine_file_is_recognised() {
    let folder = folder_with(&fs::read_to_string("examples/excavator-model.toml").unwrap());
    for command in ["check", "simulate"] {
        assert_eq!(
            refusal(folder.path(), &[command, "m.toml"]),
            "m.toml: found a model file, such as `hydraxis commission` writes, in the place of a machine file; \
             allowed: a machine file, and this file with --model\n"
        );
    }
}
