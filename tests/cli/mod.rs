//! Runs the command to its end in a folder of the test's own.

use std::{
    path::Path,
    process::{Command, Output, Stdio},
};

/// Runs `hydraxis` with relative paths taken from `folder`.
pub fn hydraxis(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
    command.current_dir(folder).stdin(Stdio::null()).args(arguments).output().unwrap()
}

/// What the command prints on standard output; it is to succeed and to say nothing on standard error.
pub fn success(folder: &Path, arguments: &[&str]) -> String {
    let output = hydraxis(folder, arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), errors.as_str()), (Some(0), ""), "{arguments:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// What the command says on standard error; it is to refuse with exit code 2, without output and without a panic.
pub fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = hydraxis(folder, arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(!errors.contains("panicked"), "{arguments:?}\n{errors}");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}\n{errors}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{arguments:?}");
    errors
}

/// The refusal, which is to contain every one of the expected texts.
pub fn expect_refusal(folder: &Path, arguments: &[&str], expected: &[&str]) {
    let errors = refusal(folder, arguments);
    for text in expected {
        assert!(errors.contains(text), "{arguments:?}: no {text:?} in\n{errors}");
    }
}
