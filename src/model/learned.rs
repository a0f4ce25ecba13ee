//! What the grey boxes of a run have learned, kept for the next run of the machine: `hydraxis run --warm`.
//!
//! A file has three keys of `[axis.NAME.identification]` for each axis whose last model the controller did not refuse.
//! Its name has a hash of the machine's name, axes and commissioned models, so a machine that was commissioned anew
//! finds none. The keys reach the stages as other settings do, so a recording has them, too.

use std::{
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

use ident_proc::Identifier;
use pipeline::{
    machine::{Axis, Estimator, Machine, MachineError, Start, model_settings},
    message::{AxisSnapshot, CoefficientSnapshot, ValveCommand, control_flag},
};
use thiserror::Error;

use crate::report::output::{part_of, take_place};

/// Flags of a controller that does not use the model.
const REFUSED: u32 = control_flag::MODEL_REFUSED | control_flag::MODEL_WORSE | control_flag::CAUTION;
/// The keys of a file.
const KEYS: [&str; 3] = ["start_lag", "start_speeds_extend", "start_speeds_retract"];

/// Why a run cannot start from what was learned.
#[derive(Debug, Error)]
pub enum NothingLearned {
    /// No file, or nothing in it.
    #[error(
        "--warm: {file}: found no model there; allowed: a machine that has run in real time as it is commissioned now, \
         with an axis of estimator \"grey-box\" that has moved. Run it once without --warm"
    )]
    NoFile { file: String },
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] MachineError),
    /// A key that such a file does not have.
    #[error("--warm: {file}: found the key {key}; allowed: what `hydraxis run` has written. Remove the file")]
    Foreign { file: String, key: String },
}

/// The file of `machine` in the `folder` for state.
pub fn file(folder: &Path, machine: &Machine) -> PathBuf {
    folder.join(format!("learned-{:016x}.toml", machine.commissioning()))
}

/// The settings that make `machine` start from what a run of it has learned.
///
/// # Errors
/// There is no file, or it has been changed.
pub fn settings(folder: &Path, machine: &Machine) -> Result<Vec<(String, String)>, NothingLearned> {
    let path = file(folder, machine);
    let file = path.display().to_string();
    // A file of another kind would keep the run waiting.
    let settings = if path.is_file() { model_settings(&path)? } else { Vec::new() };
    if settings.is_empty() {
        return Err(NothingLearned::NoFile { file });
    }
    let is_known = |key: &str| match key.split('.').collect::<Vec<_>>()[..] {
        ["axis", name, "identification", key] => {
            machine.axes.iter().any(|axis| axis.name == name) && KEYS.contains(&key)
        }
        _ => false,
    };
    match settings.iter().find(|(key, _)| !is_known(key)) {
        Some((key, _)) => Err(NothingLearned::Foreign { file, key: key.clone() }),
        None => Ok(settings),
    }
}

/// Writes what the axes have learned by their last messages. Returns the number of axes; without any there is no file.
///
/// # Errors
/// The file cannot be written.
pub fn save(
    folder: &Path,
    machine: &Machine,
    snapshot: &CoefficientSnapshot,
    command: &ValveCommand,
) -> io::Result<usize> {
    let axes = machine.axes.iter().zip(&snapshot.axes).zip(&command.axes);
    let learned: Vec<(&Axis, Start)> = axes
        .filter(|(_, command)| command.flags & REFUSED == 0)
        .filter_map(|((axis, snapshot), _)| Some((axis, learned(axis, snapshot)?)))
        .collect();
    if learned.is_empty() {
        return Ok(0);
    }
    let mut text =
        "# What the axes had learned at the end of a run; `hydraxis run --warm` starts from it.\n".to_owned();
    for (axis, Start { lag, speeds_extend, speeds_retract }) in &learned {
        let [a, b, c] = KEYS;
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[axis.{}.identification]\n{a} = {lag:?}    # s\n{b} = {speeds_extend:?}    # m/s\n{c} = \
             {speeds_retract:?}    # m/s\n",
            axis.name
        );
    }
    fs::create_dir_all(folder)?;
    let path = file(folder, machine);
    let part = part_of(&path);
    take_place(&part, &path, fs::write(&part, text))?;
    Ok(learned.len())
}

/// What the grey box of an axis has learned, if it has, in this run or in the one that it went on from.
fn learned(axis: &Axis, snapshot: &AxisSnapshot) -> Option<Start> {
    let commissioned = axis.commissioned.as_ref().filter(|_| axis.identification.estimator == Estimator::GreyBox)?;
    let first = Identifier::commissioned(&axis.identification, Some(commissioned)).snapshot().adaptive;
    let has_learned = snapshot.adaptive != first || axis.identification.start.is_some();
    has_learned.then(|| Start::of(&snapshot.adaptive, commissioned, axis.identification.period)).flatten()
}
