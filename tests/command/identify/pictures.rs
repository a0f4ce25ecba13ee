//! `hydraxis identify --report`: one page with all pictures, for every kind of record.

use std::{fs, path::Path};

use super::plant::{changing_plant, constant_plant, csv, folder_with, simulate};
use crate::harness::cli::{expect_refusal, run, success};

/// The page for a record with these options.
fn page(folder: &Path, typed: &[&str]) -> String {
    let options = ["--horizon", "10", "--report", "r.html"];
    success(folder, &[&["identify", "r.csv"], &options[..], typed].concat());
    fs::read_to_string(folder.join("r.html")).unwrap()
}

/// Expects a page with so many pictures that loads nothing.
fn expect_pictures(page: &str, count: usize) {
    assert_eq!(page.matches("<svg ").count(), count);
    let own = page.replace("http://www.w3.org/2000/svg", "");
    for foreign in ["<script", "http:", "https:", "src=", "url(", "NaN", "inf\""] {
        assert!(!own.contains(foreign), "{foreign}");
    }
    assert!(page.contains("@media print") && page.len() < 2_000_000, "{}", page.len());
}

#[test]
fn the_page_has_the_verdict_first_and_all_pictures() {
    let page = page(changing_plant().path(), &["--unit", "y=mm"]);
    expect_pictures(&page, 14);
    let places: Vec<usize> = ["<strong>usable:</strong>", "<svg ", "a_1"].map(|part| page.find(part).unwrap()).to_vec();
    assert!(places.is_sorted(), "{places:?}");
    for title in [
        "Measured, and predicted 100ms ahead",
        "A piece of it, predicted 100ms ahead",
        "Error of the prediction 100ms ahead",
        "Residuals, one step ahead",
        "Autocorrelation of the residuals",
        "99 % bound",
        "Spectrum of the residuals",
        "N(u), as the travel within 100ms",
        "Answer to a command that is held",
        "Poles",
        "Weights of the estimators in auto",
        "a over time",
        "g over time",
        "output, m",
    ] {
        assert!(page.contains(title), "{title}");
    }
}

#[test]
fn an_estimator_alone_has_its_forgetting_factor() {
    let page = page(changing_plant().path(), &["--estimator", "rules", "--velocity"]);
    expect_pictures(&page, 14);
    assert!(page.contains("Forgetting factor") && !page.contains("Weights of the estimators"));
    assert!(page.contains("The velocity was identified"));
}

#[test]
fn records_that_say_little_have_a_page_as_well() {
    // Nothing moves; the model is unstable; outliers and gaps; a residual of zero.
    let still: Vec<[f64; 3]> = (0..600).map(|k| [f64::from(k) * 0.01, 0.0, 0.3]).collect();
    let growing: Vec<[f64; 3]> = (0..200).map(|k| [f64::from(k) * 0.01, 0.1, 1.2f64.powi(k)]).collect();
    let mut wild = simulate(2000, |_| 1.0);
    wild.iter_mut().skip(1010).step_by(150).for_each(|row| row[2] += 1000.0);
    wild.drain(1400..1450);
    for record in [still, growing, wild] {
        let folder = folder_with(&csv("t,u,y", &record));
        let page = page(folder.path(), &["--na", "1", "--nb", "0", "--order", "1"]);
        assert!(page.matches("<svg ").count() >= 8 && page.ends_with("</body></html>\n"));
    }
    expect_pictures(&page(constant_plant().path(), &[]), 14);
}

#[test]
fn several_recordings_are_one_page() {
    let folder = constant_plant();
    let path = folder.path();
    // The same recording three times, each with a row less than the one before: one is not counted twice.
    let mut lines: Vec<String> = fs::read_to_string(path.join("r.csv")).unwrap().lines().map(str::to_owned).collect();
    for shorter in ["s.csv", "t.csv"] {
        lines.pop();
        fs::write(path.join(shorter), lines.join("\n")).unwrap();
    }
    let page = page(path, &["s.csv", "--test", "t.csv"]);
    expect_pictures(&page, 14);
    assert!(page.contains("Identification of r.csv .. s.csv (2 recordings), tested on t.csv"));
    assert!(page.contains("A recording begins at each thin line."));
}

#[test]
fn a_page_that_cannot_be_written_is_refused_before_the_work() {
    let folder = constant_plant();
    let typed = ["identify", "r.csv", "--report", "none/r.html"];
    expect_refusal(folder.path(), &typed, &["--report: none/r.html cannot be written"]);
    assert!(run(folder.path(), &["identify", "r.csv", "--csv", "/dev/full"]).status.code() == Some(1));
}
