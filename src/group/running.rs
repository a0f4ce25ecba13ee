//! Groups that run now, for programs that come later: which one is meant, and which machine it runs.
//!
//! The supervisor leaves the machine file's path and the values that replace those of the file in the group's folder.
//! The file goes with the group.

use std::{fs, io, path::PathBuf};

use pipeline::{
    channel::{GroupState, Prefix, groups},
    machine::MachineError,
};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{
    arguments::{BareMachine, MachineFile},
    recording::Facts,
};

/// Name of the file about the machine in the group's folder.
const FILE: &str = "machine.json";
/// Name of the file that says where the run is recorded.
const RECORDING: &str = "recording";

/// Why it is not known which group is meant, or which machine it runs.
#[derive(Debug, Error)]
pub enum UnknownGroup {
    /// None runs.
    #[error("no group runs; start one with: hydraxis run MACHINE.toml")]
    None,
    /// Several run, and none was named.
    #[error("--prefix: found none, and several groups run; allowed: one of {}", .0.join(", "))]
    Several(Vec<String>),
    /// It has left nothing about its machine.
    #[error(
        "MACHINE.toml: found none, and nothing about the machine of group \"{prefix}\" ({source}); allowed: the \
         machine file that the group runs"
    )]
    Machine {
        /// The group.
        prefix: Prefix,
        /// What reading said.
        source: io::Error,
    },
}

/// What the group was started with.
#[derive(Debug, Serialize, Deserialize)]
struct Started {
    /// The machine file; none for the built-in machine.
    file: Option<PathBuf>,
    /// Values that replace those of the file.
    settings: Vec<(String, String)>,
    /// Further facts about the run.
    facts: Facts,
}

/// The file that says where a run is recorded. The recorder writes it when it has attached to all channels.
pub fn recording_mark(prefix: &Prefix) -> PathBuf {
    prefix.folder().join(RECORDING)
}

/// The group that is meant: the one that is named, else the only one that runs.
///
/// # Errors
/// None is named, and none or several run.
pub fn meant(named: Option<&Prefix>) -> Result<Prefix, UnknownGroup> {
    if let Some(prefix) = named {
        return Ok(prefix.clone());
    }
    let living = groups().into_iter().filter(|group| group.state == GroupState::Alive).map(|group| group.prefix);
    let living: Vec<Prefix> = living.collect();
    match living.as_slice() {
        [] => Err(UnknownGroup::None),
        [one] => Ok(one.clone()),
        several => Err(UnknownGroup::Several(several.iter().map(Prefix::to_string).collect())),
    }
}

/// Leaves in the group's folder what the group is started with, and further `facts` about the run.
///
/// # Errors
/// The model file cannot be read.
pub fn leave(prefix: &Prefix, machine: &MachineFile, facts: Facts) -> Result<(), MachineError> {
    let file = machine.bare.machine.as_ref().map(|file| file.canonicalize().unwrap_or_else(|_| file.clone()));
    let started = Started { file, settings: machine.settings()?, facts };
    // Without the file a later program asks for the machine file.
    if let Ok(text) = serde_json::to_vec(&started) {
        let _ = fs::write(prefix.folder().join(FILE), text);
    }
    Ok(())
}

/// The machine that a running group was started with, with `settings` of the user's own.
///
/// # Errors
/// The group has left nothing about its machine.
pub fn machine_of(prefix: &Prefix, settings: &[(String, String)]) -> Result<BareMachine, UnknownGroup> {
    let Started { file, settings: mut all, .. } = started(prefix)?;
    all.extend_from_slice(settings);
    Ok(BareMachine { machine: file, settings: all, model: None })
}

/// Further facts about the run of a group.
///
/// # Errors
/// The group has left nothing about its machine.
pub fn facts_of(prefix: &Prefix) -> Result<Facts, UnknownGroup> {
    Ok(started(prefix)?.facts)
}

fn started(prefix: &Prefix) -> Result<Started, UnknownGroup> {
    let path = prefix.folder().join(FILE);
    let read = || serde_json::from_slice(&fs::read(&path)?).map_err(io::Error::from);
    read().map_err(|source| UnknownGroup::Machine { prefix: prefix.clone(), source })
}
