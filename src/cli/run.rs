//! The arguments of `hydraxis run`, `simulate`, `check`, and of the stages.

use std::{path::PathBuf, time::Duration};

use clap::Args;
use pipeline::{
    channel::Prefix,
    machine::{MachineError, Scenario, model_settings},
};

use super::values::{duration, setting};

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
fn with_scenarios(examples: &str) -> String {
    let scenarios = Scenario::built_in();
    let width = scenarios.iter().map(|scenario| scenario.name.len()).max().unwrap_or_default();
    let lines = scenarios.iter().map(|scenario| format!("\n  {:width$}  {}", scenario.name, scenario.summary));
    format!("{examples}\n\nScenarios:{}", lines.collect::<String>())
}

/// `run`.
#[derive(Debug, Args)]
#[command(after_help = with_scenarios("\
Examples:
  hydraxis run                                        the built-in excavator in real time, 20 s
  hydraxis run --lockstep --duration 60s --seed 7     as fast as the machine allows, bit for bit repeatable
  hydraxis run --scenario payload                     with a load that grows on the way
  hydraxis run my.toml --set axis.boom.identification.estimator=constant:0.995 --json out.json"))]
pub struct Run {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// How long; without it 20 s when the machine is simulated, the whole record when it is replayed
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Lock-step instead of real time: the next tick begins when the last is answered
    #[arg(long)]
    pub lockstep: bool,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Name of the group's channels; without it one that no other run has
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Let no axis move until `hydraxis operate` or `hydraxis commission` enables it
    #[arg(long)]
    pub off: bool,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write what supervisor and stages say, with times, to a new file in this folder as well
    #[arg(long, value_name = "DIR")]
    pub log_folder: Option<PathBuf>,
}

/// `simulate`.
#[derive(Debug, Args)]
#[command(after_help = with_scenarios("\
Examples:
  hydraxis simulate --scenario payload --plot motion.svg              the loop as of `run`, and a picture
  hydraxis simulate --scenario open-loop --axis boom --plot boom.svg  no controller, the scenario's commands
  hydraxis simulate --open-loop u.csv > y.csv                         no controller, your commands: columns t, boom, ..")
)]
pub struct Simulate {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// How long, in the machine's time; without it 20 s, or the whole record when it is replayed
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Simulate the plant alone, under the commands of a CSV file: column `t` (s) and one per axis, in [-1, 1], each
    /// held until the next row
    #[arg(long, value_name = "U.csv", conflicts_with = "duration")]
    pub open_loop: Option<PathBuf>,
    /// What is kept of the motion
    #[command(flatten)]
    pub recording: Recording,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What `simulate` keeps of the motion.
#[derive(Debug, Args)]
pub struct Recording {
    /// Write commands and true states as CSV, to a file or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub trajectory: Option<PathBuf>,
    /// Draw commands and positions over time, to a file or to standard output with -
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Only this axis in trajectory and picture; may be given several times
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
}

/// One stage by name.
#[derive(Debug, Args)]
#[command(after_help = "\
The stages of one group are started with the same machine file, prefix and clock, in any order. They end after
--ticks, or at Ctrl-C. Without --arm control-proc keeps every valve neutral.")]
pub struct Stage {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the group's channels
    #[arg(long)]
    pub prefix: Prefix,
    /// Lock-step instead of real time
    #[arg(long)]
    pub lockstep: bool,
    /// End after so many ticks
    #[arg(long)]
    pub ticks: Option<u64>,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Let control-proc move the machine
    #[arg(long)]
    pub arm: bool,
    /// Number of the first tick: where a source that was started again goes on
    #[arg(long, hide = true, default_value_t = 0)]
    pub first_tick: u64,
    /// End when this process does, or standard input
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}
