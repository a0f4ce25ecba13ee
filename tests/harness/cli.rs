//! Runs the command to its end and judges exit code and output.

use std::{path::Path, process::Output};

use super::hydraxis;

/// Runs `hydraxis` in `folder`, from which relative paths are taken, as on a computer on which it has not run before.
pub fn run(folder: &Path, arguments: &[&str]) -> Output {
    hydraxis().env("XDG_STATE_HOME", folder.join("state")).current_dir(folder).args(arguments).output().unwrap()
}

/// Standard output of a command that has to succeed without a word on standard error.
pub fn success(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), errors.as_str()), (Some(0), ""), "{arguments:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// Standard error of a command that has to refuse: exit code 2, no output, no panic.
pub fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(!errors.contains("panicked"), "{arguments:?}\n{errors}");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}\n{errors}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{arguments:?}");
    errors
}

/// Expects a refusal whose message contains all of these texts.
pub fn expect_refusal(folder: &Path, arguments: &[&str], expected: &[&str]) {
    let errors = refusal(folder, arguments);
    for text in expected {
        assert!(errors.contains(text), "{arguments:?}: no {text:?} in\n{errors}");
    }
}
