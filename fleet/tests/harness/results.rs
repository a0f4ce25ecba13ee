//! What a run has computed: its figures, and the rows of its recording.

use std::{fs, path::Path};

use serde_json::Value;

use super::hydraxis;

/// The figures of a run, without those of the time that it took.
pub fn figures(file: &Path) -> Value {
    fn without_times(value: &mut Value) {
        if let Some(object) = value.as_object_mut() {
            object.retain(|key, _| !key.ends_with("_ns") && key != "wall_s");
            object.values_mut().for_each(without_times);
        }
    }
    let mut figures = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
    without_times(&mut figures);
    figures
}

/// The rows of a recording.
fn rows(recording: &Path) -> Vec<String> {
    let csv = recording.with_extension("csv");
    let export = hydraxis().arg("export").arg(recording).arg("--csv").arg(&csv).output().unwrap();
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    fs::read_to_string(csv).unwrap().lines().map(str::to_owned).collect()
}

/// Expects two recordings to have the same rows, but for those with a hole in one of them. The number of whole rows.
pub fn equal_rows(one: &Path, other: &Path) -> usize {
    let (one, other) = (rows(one), rows(other));
    assert_eq!(one.len(), other.len());
    let both = one.iter().zip(&other).filter(|(one, other)| ![one, other].iter().any(|row| row.contains(",,")));
    both.map(|(one, other)| assert_eq!(one, other)).count() - 1
}
