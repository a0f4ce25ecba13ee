//! The machine as a user types it: its file, and the values that replace those of the file.

use std::path::PathBuf;

use clap::Args;
use pipeline::{
    machine::{Machine, MachineError, Scenario, model_settings},
    nearest::did_you_mean,
};
use thiserror::Error;

use super::values::setting;

/// A machine file and the values that replace those of the file, without a choice of the scenario.
#[derive(Debug, Clone, Args)]
pub struct BareMachine {
    /// Machine file [default: the built-in excavator with its model]
    #[arg(value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Replace the value of a key of the machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
    /// Model file of `hydraxis commission`; its values replace those of the machine file
    #[arg(long, value_name = "MODEL.toml")]
    pub model: Option<PathBuf>,
}

/// A machine file and the values that replace those of the file.
#[derive(Debug, Clone, Args)]
pub struct MachineFile {
    /// Everything but the scenario
    #[command(flatten)]
    pub bare: BareMachine,
    /// Scenario: what changes while the simulated machine works. A built-in one (`hydraxis simulate --help` lists them)
    /// or one of the machine file
    #[arg(long, value_name = "NAME")]
    pub scenario: Option<String>,
}

impl BareMachine {
    /// Name of the file, for messages.
    pub fn name(&self) -> String {
        self.machine.as_ref().map_or("built-in machine".to_owned(), |file| file.display().to_string())
    }

    /// The values that replace those of the file. Later ones win: first the model file, then `--set`, then `scenario`.
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
    /// The values that replace those of the file, with the scenario.
    ///
    /// # Errors
    /// As [`BareMachine::settings`].
    pub fn settings(&self) -> Result<Vec<(String, String)>, MachineError> {
        self.bare.settings(self.scenario.as_deref())
    }
}

/// The examples of a subcommand, followed by the built-in scenarios with a line each.
pub fn with_scenarios(examples: &str) -> String {
    let scenarios = Scenario::built_in();
    let width = scenarios.iter().map(|scenario| scenario.name.len()).max().unwrap_or_default();
    let lines = scenarios.iter().map(|scenario| format!("\n  {:width$}  {}", scenario.name, scenario.summary));
    format!(
        "{examples}\n\nScenarios; a machine file may have its own in their place, as the built-in excavator has:{}",
        lines.collect::<String>()
    )
}

/// Reads a machine file and replaces values as the user asked.
///
/// # Errors
/// Everything that is wrong with the file, the model file or the values.
pub fn load(arguments: &MachineFile) -> Result<Machine, MachineError> {
    load_bare(&arguments.bare, arguments.scenario.as_deref())
}

/// Reads a machine file, replaces values as the user asked, and chooses `scenario`.
///
/// # Errors
/// As [`load`].
pub fn load_bare(arguments: &BareMachine, scenario: Option<&str>) -> Result<Machine, MachineError> {
    let mut settings = arguments.settings.clone();
    settings.extend(scenario.map(|name| ("scenario".to_owned(), name.to_owned())));
    let (machine, _) = Machine::explain(arguments.machine.as_deref(), arguments.model.as_deref(), &settings)?;
    Ok(machine)
}

/// What a machine without a mechanism lacks, for a refusal of it.
pub fn mechanism_only(arguments: &BareMachine) -> String {
    format!(
        "{}: mechanism: found nothing; allowed: the tables [mechanism.boom], .arm, .telescope and .bucket with pins \
         and masses, as examples/excavator.toml has them",
        arguments.name()
    )
}

/// What can be simulated, for a refusal of `machine`, whose source is another one.
pub fn simulated_only(machine: &Machine) -> String {
    let found = machine.source.kind();
    let twin = if machine.source.is_real() {
        ", or tables [axis.NAME.plant], [supply] and [oil] for a twin of the machine"
    } else {
        ""
    };
    format!("source.kind: found \"{found}\"; allowed: \"sim\"{twin}")
}

/// A name that no axis of the machine has.
#[derive(Debug, Error)]
#[error("--axis: found \"{found}\"; allowed: one of {}{}", .allowed.join(", "), hint(.found, .allowed))]
pub struct UnknownAxis {
    found: String,
    allowed: Vec<String>,
}

/// The nearest names of axes, as a question.
fn hint(found: &str, axes: &[String]) -> String {
    did_you_mean(found, axes.iter().map(String::as_str))
}

/// Indices of the axes with these names, in the order of the machine; all axes when `names` is empty.
///
/// # Errors
/// A name is not that of an axis.
pub fn axes(machine: &Machine, names: &[String]) -> Result<Vec<usize>, UnknownAxis> {
    axes_of(machine.axes.iter().map(|axis| axis.name.as_str()), names)
}

/// [`axes`] of a machine whose axes have the names `known`.
///
/// # Errors
/// A name is not that of an axis.
pub fn axes_of<'a>(known: impl Iterator<Item = &'a str>, names: &[String]) -> Result<Vec<usize>, UnknownAxis> {
    let known: Vec<&str> = known.collect();
    if let Some(name) = names.iter().find(|name| !known.contains(&name.as_str())) {
        let allowed = known.into_iter().map(str::to_owned).collect();
        return Err(UnknownAxis { found: name.clone(), allowed });
    }
    let is_wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
    Ok(known.iter().enumerate().filter(|(_, name)| is_wanted(name)).map(|(index, _)| index).collect())
}
