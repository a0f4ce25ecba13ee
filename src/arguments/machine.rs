//! The machine as a user types it: its file, and what is changed of it.

use std::path::PathBuf;

use clap::Args;
use pipeline::machine::{Machine, MachineError, Scenario, model_settings};

use super::values::setting;
use crate::failure::Failure;

/// A machine and what is changed of it, but for the scenario.
#[derive(Debug, Args)]
pub struct BareMachine {
    /// Machine file; without one the built-in four-axis excavator
    #[arg(value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Use another value for a key of the machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
    /// Model file of `hydraxis commission`: what it says takes the place of the machine file's
    #[arg(long, value_name = "MODEL.toml")]
    pub model: Option<PathBuf>,
}

/// A machine and what is changed of it.
#[derive(Debug, Args)]
pub struct MachineFile {
    /// All but the scenario
    #[command(flatten)]
    pub bare: BareMachine,
    /// What changes while the simulated machine works: a built-in scenario (`hydraxis simulate --help` lists them), or
    /// one of the machine file
    #[arg(long, value_name = "NAME")]
    pub scenario: Option<String>,
}

impl BareMachine {
    /// Everything that takes the place of what the file says; the last counts, so a model, then `--set`, then
    /// `scenario`.
    ///
    /// # Errors
    /// The model file cannot be read, or is not TOML.
    pub fn settings(&self, scenario: Option<&str>) -> Result<Vec<(String, String)>, MachineError> {
        let mut settings = self.model.as_deref().map_or(Ok(Vec::new()), model_settings)?;
        settings.extend(self.settings.iter().cloned());
        settings.extend(scenario.map(|name| ("scenario".to_owned(), name.to_owned())));
        Ok(settings)
    }
}

impl MachineFile {
    /// The same with the scenario.
    ///
    /// # Errors
    /// As [`BareMachine::settings`].
    pub fn settings(&self) -> Result<Vec<(String, String)>, MachineError> {
        self.bare.settings(self.scenario.as_deref())
    }
}

/// `examples`, and the built-in scenarios.
pub fn with_scenarios(examples: &str) -> String {
    let scenarios = Scenario::built_in();
    let width = scenarios.iter().map(|scenario| scenario.name.len()).max().unwrap_or_default();
    let lines = scenarios.iter().map(|scenario| format!("\n  {:width$}  {}", scenario.name, scenario.summary));
    format!("{examples}\n\nScenarios:{}", lines.collect::<String>())
}

/// Reads a machine file with what was typed in its place.
pub fn load(arguments: &MachineFile) -> Result<Machine, Failure> {
    load_bare(&arguments.bare, arguments.scenario.as_deref())
}

/// Reads a machine file with what was typed in its place, under `scenario`.
pub fn load_bare(arguments: &BareMachine, scenario: Option<&str>) -> Result<Machine, Failure> {
    let settings = arguments.settings(scenario).map_err(Failure::usage)?;
    Machine::load(arguments.machine.as_deref(), &settings).map_err(Failure::usage)
}

/// The axes that were named, or all.
pub fn axes(machine: &Machine, names: &[String]) -> Result<Vec<usize>, Failure> {
    if names.is_empty() {
        return Ok((0..machine.axes.len()).collect());
    }
    let known: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    if let Some(name) = names.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(Failure::Usage(format!("--axis: found \"{name}\"; allowed: one of {}", known.join(", "))));
    }
    let wanted = |name: &&str| names.iter().any(|other| other == *name);
    Ok((0..known.len()).filter(|index| wanted(&known[*index])).collect())
}
