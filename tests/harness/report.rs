//! Runs that have to succeed, and their JSON reports.

use std::process::Output;

use super::hydraxis;

/// Runs a command that has to succeed, whatever it says on standard error.
pub fn succeed(arguments: &[&str]) -> Output {
    let output = hydraxis().args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// The JSON report of a run, without wall times and latencies.
pub fn report(arguments: &[&str]) -> serde_json::Value {
    let output = succeed(&[arguments, &["--json", "-"]].concat());
    let mut value = serde_json::from_slice(&output.stdout).unwrap();
    strip_times(&mut value);
    value
}

/// Removes the figures that differ from run to run: wall times and latencies.
pub fn strip_times(value: &mut serde_json::Value) {
    if let serde_json::Value::Object(object) = value {
        object.retain(|key, _| !key.ends_with("_ns") && key != "wall_s");
        object.values_mut().for_each(strip_times);
    }
}
