//! The table of faults in the documentation and the tests name each other.
//!
//! A row of the table begins with its number. Its last column names tests as `file::function`, or says that the fault
//! is not covered. A fault test is a function `row_N_..`, and its documentation begins with `Row N:`.

use std::{collections::BTreeMap, fs, path::Path};

/// A row without a test begins its last column with these words.
const UNCOVERED: &str = "not covered";

fn read(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The last column of every row, by the row's number.
fn rows() -> BTreeMap<u32, String> {
    let page = read("docs/src/faults.md");
    let rows = page.lines().filter_map(|line| {
        let cells: Vec<&str> = line.trim().strip_prefix('|')?.strip_suffix('|')?.split('|').map(str::trim).collect();
        Some((cells.first()?.parse().ok()?, (*cells.last()?).to_owned()))
    });
    let mut found = BTreeMap::new();
    for (number, tests) in rows {
        assert!(found.insert(number, tests).is_none(), "row {number} is there twice");
    }
    found
}

/// The tests that a row names, as file and function.
fn named(cell: &str) -> impl Iterator<Item = (&str, &str)> {
    cell.split('`').filter_map(|piece| piece.split_once("::"))
}

/// Fault tests in the files of this folder, with file, function, and the first line of the documentation.
fn fault_tests() -> Vec<(String, String, String)> {
    let mut found = Vec::new();
    let mut folders = vec!["tests/faults".to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(&folder)).unwrap().map(Result::unwrap) {
            let file = format!("{folder}/{}", entry.file_name().into_string().unwrap());
            if entry.path().is_dir() {
                folders.push(file);
                continue;
            }
            let text = read(&file);
            let mut documentation: Option<&str> = None;
            for line in text.lines() {
                if let Some(words) = line.strip_prefix("/// ") {
                    documentation.get_or_insert(words);
                } else if let Some(function) = line.strip_prefix("fn row_").and_then(|rest| rest.split_once('(')) {
                    let words = documentation.take().unwrap_or_default().to_owned();
                    found.push((file.clone(), format!("row_{}", function.0), words));
                } else if !line.starts_with("#[") {
                    documentation = None;
                }
            }
        }
    }
    found
}

#[test]
fn every_row_names_tests_that_exist_or_says_that_it_has_none() {
    let rows = rows();
    let numbers: Vec<u32> = rows.keys().copied().collect();
    assert_eq!(numbers, (1..=51).collect::<Vec<_>>());
    for (number, cell) in &rows {
        assert_eq!(named(cell).count() == 0, cell.starts_with(UNCOVERED), "row {number}: {cell}");
        for (file, function) in named(cell) {
            let text = read(file);
            let is_it = |rest: &&str| rest.trim_start().starts_with(&format!("fn {function}("));
            let test = text.split("#[test]\n").skip(1).find(is_it);
            assert!(test.is_some(), "row {number}: {file} has no test {function}");
        }
    }
}

#[test]
fn every_fault_test_says_its_row_and_is_named_there() {
    let (rows, tests) = (rows(), fault_tests());
    assert!(tests.len() > 30, "{} fault tests", tests.len());
    for (file, function, documentation) in tests {
        let number: u32 = function.split('_').nth(1).unwrap().parse().unwrap();
        assert!(documentation.starts_with(&format!("Row {number}: ")), "{file}::{function}: {documentation}");
        let is_named = rows.get(&number).is_some_and(|cell| named(cell).any(|test| test == (&*file, &*function)));
        assert!(is_named, "row {number} does not name {file}::{function}");
    }
}
