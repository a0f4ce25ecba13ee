//! Recordings and trajectories.

use std::{
    fs::File,
    io::Write,
    os::fd::AsRawFd,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use control_proc::trajectory_file::read_trajectory;
use pipeline::{
    columns::Table,
    machine::{Axis, Machine},
};
use rustix::fs::{MemfdFlags, memfd_create};
use sensor_proc::{
    Recording,
    log::{Log, Wanted},
};

/// Reads columns of a table, and a recording.
pub fn csv(data: &[u8]) {
    let (_file, path) = file(data);
    match Table::read(&path) {
        Ok(table) => {
            let names: Vec<&str> = table.names().collect();
            for rising in names.iter().take(2) {
                match table.numbers(&names[..names.len().min(4)], rising) {
                    Ok(columns) => {
                        assert!(columns.values.iter().all(|values| values.len() == columns.lines.len()));
                        assert!(columns.values.iter().flatten().all(|value| value.is_finite()));
                        assert!(columns.lines.is_sorted(), "{:?}", columns.lines);
                    }
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    for period in [None, Some(0.01)] {
        match Recording::read(&path, "u", "y", period) {
            Ok(recording) => {
                assert!(recording.inputs.len() == recording.outputs.len() && recording.outputs.len() >= 2);
                assert!(recording.period > 0.0 && recording.period.is_finite());
                assert!(recording.irregular_steps < recording.outputs.len());
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        log(&path, period);
    }
}

/// Reads a recording as loggers write them, by names and by numbers.
fn log(path: &Path, period: Option<f64>) {
    for (input, output) in [("u", "y"), ("2", "3")] {
        let wanted = Wanted { input: input.to_owned(), output: output.to_owned(), period, ..Wanted::default() };
        match Log::read(path, &wanted) {
            Ok(log) => {
                assert!(log.inputs.len() == log.outputs.len() && log.begins.len() == log.outputs.len());
                assert!(log.inputs.iter().chain(&log.outputs).all(|value| value.is_finite()));
                assert!(log.period > 0.0 && log.period.is_finite() && log.begins[0]);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
}

/// Reads a reference trajectory from a file.
pub fn trajectory(data: &[u8]) {
    static AXIS: OnceLock<Axis> = OnceLock::new();
    let axis = AXIS.get_or_init(|| Machine::four_axes(&[]).expect("the built-in machine").axes[0].clone());
    let (low, high) = axis.soft_limits;
    let (_file, path) = file(data);
    match read_trajectory(&path, "x", axis) {
        Ok(trajectory) => {
            let end = trajectory.end();
            for t in [f64::MIN, -1.0, 0.0, 1e-9, 0.5, 1.0, end / 2.0, end, end + 1.0, f64::MAX] {
                let position = trajectory.position(t);
                assert!((low - 1e-9..=high + 1e-9).contains(&position), "{position} at {t}");
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A file in memory, and the path by which it can be opened while the file is held.
fn file(data: &[u8]) -> (File, PathBuf) {
    let mut file = File::from(memfd_create("fuzz", MemfdFlags::CLOEXEC).expect("memory for a file"));
    file.write_all(data).expect("memory takes what it gets");
    let path = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
    (file, path)
}
