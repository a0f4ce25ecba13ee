//! The bucket's teeth along a way.

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
