//! The machine of a recording: its file, the values that replaced those of the file, and its trajectories.

use std::{
    fs,
    path::{Path, PathBuf},
};

use pipeline::machine::{Machine, ReferenceSource, Source, model_settings};
use tempfile::TempDir;

use crate::{
    failure::Failure,
    recording::{Facts, MACHINE, SETTINGS, is_lock_step, reading::Reading, trajectory_name},
};

/// A recording whose facts and attached files have been read.
pub struct Recorded {
    /// The file.
    pub path: PathBuf,
    /// Its facts; those of the end only where they had to be read for the attached files.
    pub facts: Facts,
    /// Its machine file.
    pub machine: String,
    /// Values that replaced those of the file.
    pub settings: Vec<(String, String)>,
    /// Holds the trajectories while the machine is in use.
    pub folder: TempDir,
    trajectories: Vec<String>,
}

impl Recorded {
    /// Reads what stands before the messages, or behind them in a recording that was written anew.
    ///
    /// # Errors
    /// The file cannot be read, or has no machine.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let about = |failure: Failure| failure.about(path.display().to_string());
        let mut reading = Reading::open(path)?;
        while !reading.attached().iter().any(|(name, _)| name == SETTINGS) && reading.next()?.is_some() {}
        let text = |name: &str| {
            let found = reading.attached().iter().find(|(attached, _)| attached == name);
            let missing = || Failure::usage(format!("found no attached {name}; allowed: a file of `hydraxis record`"));
            let (_, content) = found.ok_or_else(missing)?;
            String::from_utf8(content.clone()).map_err(|_| Failure::usage(format!("{name}: found no UTF-8")))
        };
        let machine = text(MACHINE).map_err(about)?;
        let settings = serde_json::from_str(&text(SETTINGS).map_err(about)?)
            .map_err(|error| about(Failure::usage(error).about(SETTINGS)))?;
        let folder = TempDir::new().map_err(Failure::run)?;
        let mut trajectories = Vec::new();
        for axis in reading.axes() {
            let name = trajectory_name(&axis);
            if let Some((_, content)) = reading.attached().iter().find(|(attached, _)| *attached == name) {
                // Names of axes have letters, digits, - and _ only, or the machine file is refused.
                if !axis.contains(['/', '.']) {
                    fs::write(folder.path().join(name), content).map_err(Failure::run)?;
                    trajectories.push(axis);
                }
            }
        }
        let facts = reading.facts().clone();
        Ok(Self { path: path.to_owned(), facts, machine, settings, folder, trajectories })
    }

    /// The machine, with values that replace those of the recording: first those of a model file, then `settings`.
    ///
    /// # Errors
    /// The model file cannot be read, or a value is refused.
    pub fn machine(&self, model: Option<&Path>, settings: &[(String, String)]) -> Result<Machine, Failure> {
        let mut all = self.settings.clone();
        if let Some(model) = model {
            all.extend(model_settings(model)?);
        }
        all.extend_from_slice(settings);
        let name = format!("{MACHINE} in {}", self.path.display());
        let mut machine = Machine::parse(&self.machine, &name, self.folder.path(), &all)?;
        for axis in &mut machine.axes {
            if let ReferenceSource::Trajectory { file, .. } = &mut axis.reference
                && self.trajectories.contains(&axis.name)
                && !settings.iter().any(|(key, _)| *key == format!("axis.{}.reference.file", axis.name))
            {
                *file = self.folder.path().join(trajectory_name(&axis.name));
            }
        }
        Ok(machine)
    }

    /// The axes with a trajectory, and its file.
    pub fn trajectory_files(&self) -> impl Iterator<Item = (&str, PathBuf)> {
        self.trajectories.iter().map(|axis| (axis.as_str(), self.folder.path().join(trajectory_name(axis))))
    }

    /// Whether the run was in lock-step.
    pub fn is_lock_step(&self) -> bool {
        is_lock_step(&self.facts)
    }

    /// Seed of the simulated noise, if the machine was simulated.
    pub fn seed(&self, machine: &Machine) -> Option<u64> {
        self.facts.get("seed").and_then(|seed| seed.parse().ok()).filter(|_| machine.source == Source::Sim)
    }
}
