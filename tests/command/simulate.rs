//! `hydraxis simulate`: scenarios, the plant under given commands, trajectories, pictures and refusals.

mod excavator;
mod figures;
mod open_loop;
mod recording;
mod refusals;
mod scenarios;
mod teeth;

use std::{fs, path::Path};

use tempfile::TempDir;

use crate::harness::{self, cli};

/// The trajectory that a run writes to standard output.
fn trajectory(folder: &Path, arguments: &[&str]) -> Trajectory {
    let output = cli::run(folder, &[&["simulate"], arguments].concat());
    assert!(output.status.success(), "{arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
    Trajectory::read(&String::from_utf8(output.stdout).unwrap())
}

/// A table with named columns.
#[derive(Debug, PartialEq)]
struct Trajectory {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Trajectory {
    fn read(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    fn column(&self, name: &str) -> Vec<f64> {
        let place = self.names.iter().position(|other| other == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|row| row[place]).collect()
    }
}

/// A folder with one file.
fn folder_with(name: &str, text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(name), text).unwrap();
    folder
}
