//! Records of a known plant, and what `hydraxis identify` finds in them.

use std::{fs, path::Path};

use serde_json::Value;
use tempfile::TempDir;

use crate::harness::cli::success;

pub const A: [f64; 3] = [-1.5, 0.7, -0.1];
pub const B: [f64; 2] = [0.5, 0.3];
pub const F: [f64; 3] = [1.0, 0.4, -0.2];
pub const G: [f64; 3] = [0.8, -0.3, 0.15];
/// Sample period of the test's own records, s.
pub const PERIOD: f64 = 0.01;

/// Rows (t, u, y) of the plant A, B, F, G, driven by three sines. B is multiplied by `gain` of the row.
pub fn simulate(rows: usize, gain: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    let input = |k: usize| {
        let k = k as f64;
        0.5 * (0.085 * k).sin() + 0.35 * (0.61 * k + 1.0).sin() + 0.3 * (1.37 * k + 2.0).sin()
    };
    let valve = |u: f64| {
        let c = if u >= 0.0 { F } else { G };
        c[0] * u + c[1] * u.powi(2) + c[2] * u.powi(3)
    };
    let mut record: Vec<[f64; 3]> = Vec::with_capacity(rows);
    for k in 0..rows {
        let past = |lag: usize| k.checked_sub(lag).map_or([0.0; 3], |row| record[row]);
        let autoregressive: f64 = (1..=3).map(|i| A[i - 1] * past(i)[2]).sum();
        let driven: f64 = (1..=2).map(|j| B[j - 1] * valve(past(j)[1])).sum();
        record.push([k as f64 * PERIOD, input(k), gain(k) * driven - autoregressive]);
    }
    record
}

pub fn csv(header: &str, record: &[[f64; 3]]) -> String {
    let rows: String = record.iter().map(|[t, u, y]| format!("{t},{u},{y}\n")).collect();
    format!("{header}\n{rows}")
}

/// A folder with this text as `r.csv`.
pub fn folder_with(text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("r.csv"), text).unwrap();
    folder
}

/// A folder with `r.csv`: 600 rows of the constant plant.
pub fn constant_plant() -> TempDir {
    folder_with(&csv("t,u,y", &simulate(600, |_| 1.0)))
}

/// A folder with `r.csv`: 2000 rows of a plant whose gain rises by half in the middle.
pub fn changing_plant() -> TempDir {
    folder_with(&csv("t,u,y", &simulate(2000, |k| if k < 1000 { 1.0 } else { 1.5 })))
}

/// The JSON report on standard output, which contains nothing else.
pub fn figures(folder: &Path, arguments: &[&str]) -> Value {
    let text = success(folder, &[&["identify", "r.csv", "--json", "-"], arguments].concat());
    serde_json::from_str(&text).unwrap()
}

/// A report without the wall time, which differs from run to run.
pub fn timeless(mut figures: Value) -> Value {
    let adaptive = figures["adaptive"].as_object_mut().unwrap();
    adaptive.remove("ns_per_update").unwrap();
    figures
}

pub fn number(figures: &Value, pointer: &str) -> f64 {
    let value = figures.pointer(pointer).unwrap_or_else(|| panic!("no {pointer} in {figures}"));
    value.as_f64().unwrap_or_else(|| panic!("{pointer} is {value}"))
}

pub fn expect_coefficients(figures: &Value, model: &str) {
    for (name, expected) in [("a", &A[..]), ("b", &B[..]), ("f", &F[..]), ("g", &G[..])] {
        expect_list(figures, model, name, expected);
    }
}

/// A folder with `r.csv`: the record with its output changed by `change`, row by row.
pub fn with_output(record: &[[f64; 3]], mut change: impl FnMut(f64) -> f64) -> TempDir {
    let changed: Vec<[f64; 3]> = record.iter().map(|[t, u, y]| [*t, *u, change(*y)]).collect();
    folder_with(&csv("t,u,y", &changed))
}

/// A function that returns the sum of its values so far, with `each` added at every call.
pub fn summed(each: f64) -> impl FnMut(f64) -> f64 {
    let mut sum = 0.0;
    move |value| {
        sum += value + each;
        sum
    }
}

/// Expects these coefficients of a model. `auto` estimates one lag more, which has to be zero.
pub fn expect_list(figures: &Value, model: &str, name: &str, expected: &[f64]) {
    let found: Vec<f64> = serde_json::from_value(figures[model]["coefficients"][name].clone()).unwrap();
    let more = if (model, name) == ("adaptive", "b") && figures["estimator"] == "auto" { 1 } else { 0 };
    assert_eq!(found.len(), expected.len() + more, "{model} {name}: {found:?}");
    assert!(found[expected.len()..].iter().all(|rest| rest.abs() <= 1e-6), "{model} {name}: {found:?}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-6, "{model} {name}: {found} for {expected}");
    }
}

/// A(z) (1 - z^-1) of the plant.
pub const A_INTEGRATED: [f64; 4] = [A[0] - 1.0, A[1] - A[0], A[2] - A[1], -A[2]];
