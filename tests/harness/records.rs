//! Records for identification: the simulated ones of the project, and measured ones that lie elsewhere.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::cli::success;

/// The folder of the measured records.
const VARIABLE: &str = "HYDRAXIS_RECORDS";

/// The simulated records, which are part of the project.
pub fn simulated() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// The folder of the measured records, from the environment. It panics where the folder is not known or has no such
/// file, so that a test without its record never passes.
pub fn measured(file: &str) -> PathBuf {
    let folder = std::env::var(VARIABLE).unwrap_or_else(|_| panic!("{VARIABLE} has to name the folder of {file}"));
    let folder = Path::new(&folder).canonicalize().unwrap_or_else(|error| panic!("{VARIABLE}={folder}: {error}"));
    assert!(folder.join(file).is_file(), "{VARIABLE}: {} is missing", folder.join(file).display());
    folder
}

/// The JSON report of `identify` in a folder with records.
pub fn identify(folder: &Path, arguments: &[&str]) -> Value {
    let text = success(folder, &[&["identify", "--json", "-"], arguments].concat());
    serde_json::from_str(&text).unwrap()
}

/// The number at this place of a report.
pub fn number(report: &Value, pointer: &str) -> f64 {
    let value = report.pointer(pointer).unwrap_or_else(|| panic!("no {pointer} in {report}"));
    value.as_f64().unwrap_or_else(|| panic!("{pointer} is {value}"))
}

/// The row of a comparison (`identify --compare`) for which this holds.
pub fn row(report: &Value, is_it: impl Fn(&Value) -> bool) -> &Value {
    let rows = report["comparison"].as_array().unwrap();
    rows.iter().find(|row| is_it(row)).unwrap_or_else(|| panic!("no such row in {rows:?}"))
}

/// Expects `auto` to be nearly as good as the best constant forgetting factor in hindsight, and not much worse than the
/// held model. Returns its h-step error over that of the best constant factor.
pub fn expect_good_auto(folder: &Path, typed: &[&str]) -> f64 {
    let report = identify(folder, &[typed, &["--train", "0.4", "--compare"]].concat());
    let auto = row(&report, |row| row["estimator"] == "auto");
    let (to_best, to_held) = (number(auto, "/to_best_constant"), number(auto, "/to_classical"));
    println!("{typed:?}: {to_best:.3} of the best constant factor, {to_held:.3} of the held model");
    assert!(to_best <= 1.05, "{typed:?}: {to_best}");
    assert!(to_held <= 1.03, "{typed:?}: {to_held}");
    to_best
}

/// Expects finite adaptive errors with the shortest memory that is allowed in practice, and with the paper's rule.
pub fn expect_finite_with_short_memory(folder: &Path, file: &str) {
    for estimator in ["constant:0.75", "paper"] {
        let report = identify(folder, &[file, "--train", "0.4", "--estimator", estimator]);
        for kind in ["one_step", "h_step", "free_run"] {
            let sigma = number(&report, &format!("/adaptive/{kind}/sigma"));
            assert!(sigma.is_finite(), "{file} {estimator} {kind}: {sigma}");
        }
    }
}

/// Expects finite errors of the held model in every figure of the report.
pub fn expect_identified(folder: &Path, file: &str) {
    let report = identify(folder, &[file, "--train", "0.4", "--horizon", "10"]);
    for kind in ["one_step", "h_step", "free_run"] {
        for figure in ["sigma", "rmse", "max", "fit_percent"] {
            let value = number(&report, &format!("/classical/{kind}/{figure}"));
            assert!(value.is_finite(), "{file} {kind} {figure}: {value}");
        }
    }
}
