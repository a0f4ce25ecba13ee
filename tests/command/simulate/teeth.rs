//! The bucket's teeth along a way.

use std::fs;

use crate::harness::{hydraxis, report};

const FOLLOW: [&str; 8] = [
    "--set",
    "axis.boom.reference.kind=tip",
    "--set",
    "axis.arm.reference.kind=tip",
    "--set",
    "axis.telescope.reference.kind=tip",
    "--set",
    "axis.bucket.reference.kind=tip",
];

#[test]
fn the_teeth_of_the_built_in_machine_follow_a_level_cut() {
    let arguments = [&["simulate", "--duration", "40s"][..], &FOLLOW].concat();
    let teeth = &report(&arguments)["teeth"];
    let value = |key: &str| teeth[key].as_f64().unwrap();
    assert_eq!(teeth["is_done"], true);
    assert!((value("length") - 3.5).abs() < 1e-9 && value("duration") > 3.5 / 0.35, "{teeth}");
    // Errors that a person would see at once; the figures of the bench are far smaller.
    assert!(value("rms") < 0.05 && value("max") < 0.15 && value("pitch_rms") < 3.0, "{teeth}");
    let text = hydraxis().args(&arguments).output().unwrap();
    assert!(String::from_utf8_lossy(&text.stdout).contains("Teeth, 3.5000 m in "), "{text:?}");
}

#[test]
fn a_task_for_some_axes_or_out_of_reach_is_refused() {
    let refused = |arguments: &[&str]| {
        let output = hydraxis().arg("check").args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let said = refused(&FOLLOW[..4]);
    assert!(said.contains("tip: found 2 axes with reference.kind = \"tip\"; allowed: a table [tip] and"), "{said}");
    let far = [&FOLLOW[..], &["--set", "tip.start=[9.5, 0.0]"]].concat();
    let said = refused(&far);
    assert!(said.contains("tip.piece[0]: found [9.500, 0.000] m at a pitch of -115.0 degrees, where axis."), "{said}");
}

/// Regression: a wall ended the task, and the exit code was 0.
#[test]
fn a_task_that_a_wall_ends_ends_the_run_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    // Fast and close above the wall; the valves wear from 8 s on.
    let walls = "[walls]\ndepth = 2.15\nclearance = 0.3\npayload = 1500\n\
                 corner = [{ at = [1.15, 0.62] }, { at = [0.45, 0.80] }]\n";
    let way = "piece = [{to=[5.9,-2.0]},{to=[4.5,-2.0]},{to=[5.9,-2.0]},{to=[5.9,-1.5]}]";
    let machine = pipeline::machine::BUILT_IN.replace("piece = [{ to = [3.7, 0.0] }]", way);
    fs::write(folder.path().join("walled.toml"), format!("{machine}\n{walls}")).unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator-model.toml");
    let task = ["--set", "tip.start=[5.9,-1.5]", "--set", "tip.pitch=-105", "--set", "tip.speed=1.0"];
    let run = |scenario: &str| {
        let simulate = ["simulate", "walled.toml", "--model", model, "--duration", "45s", "--scenario", scenario];
        hydraxis().current_dir(&folder).args(simulate).args(FOLLOW).args(task).output().unwrap()
    };
    let ended = run("valve-wear");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("the teeth have not come to the end of their way: walls.depth stopped axis."), "{said}");
    let text = String::from_utf8_lossy(&ended.stdout).into_owned();
    assert!(text.contains("the run ended before the end of the way"), "{text}");
    assert_eq!(run("nominal").status.code(), Some(0));
}
