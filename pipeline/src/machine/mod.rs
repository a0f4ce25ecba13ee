//! The machine file: what the machine is, how it is identified and controlled, and on what it runs.
//!
//! TOML, SI units, durations as texts with their unit (`"10ms"`). Nothing that can move the machine has a
//! default. An unknown key, a wrong type, NaN, or a value out of range is refused, all problems at once, each
//! with file, line, key, what was found and what is allowed.

mod axis;
mod document;
mod error;
mod fuzzy;
mod hydraulics;
mod scenario;
mod source;
mod stages;
mod timing;

use std::path::Path;

use document::{Document, Section};

pub use axis::{
    Axis, Commissioned, Control, DeadBand, Encoder, Estimator, Form, Identification, IdentifiedOutput, LoadForce,
    MOST_POINTS, ModelChoice, Plant, ReferenceSource, Sine, Split, ValveCurve, shortest_training,
};
pub use document::samples_of;
pub use error::{MachineError, Problem};
pub use fuzzy::{Fuzzy, Level};
pub use hydraulics::{Hydraulics, Oil, Supply};
pub use scenario::{Change, CommandSine, Parameter, Scenario};
pub use source::Source;
pub use stages::{Realtime, Restart, Rights, StageKind, StageSettings, Wait};
pub use timing::Timing;

use crate::MAX_AXES;

/// The built-in machine, the four-axis excavator; the same text is in `examples/`.
pub const BUILT_IN: &str = include_str!("../../../examples/excavator.toml");

/// Everything a machine file says.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Shown in reports.
    pub name: String,
    /// Rates and time-outs.
    pub timing: Timing,
    /// Scheduling rights.
    pub realtime: Realtime,
    /// How each stage runs, by [`StageKind`].
    pub stages: [StageSettings; 4],
    /// Where samples come from.
    pub source: Source,
    /// Pump and oil of the simulated axes, if there are any.
    pub hydraulics: Option<Hydraulics>,
    /// What changes while the simulated machine works.
    pub scenario: Scenario,
    /// The axes, in the order of the file.
    pub axes: Vec<Axis>,
}

fn read_file(path: &Path, allowed: &str) -> Result<String, MachineError> {
    std::fs::read_to_string(path).map_err(|error| MachineError {
        file: path.display().to_string(),
        problems: vec![Problem {
            line: None,
            key: String::new(),
            found: format!("a file that cannot be read ({error})"),
            allowed: allowed.to_owned(),
        }],
    })
}

/// The values of a model file, such as `commission` writes, as settings that take the place of what a machine file says.
///
/// # Errors
/// The file cannot be read, or is not TOML.
pub fn model_settings(file: &Path) -> Result<Vec<(String, String)>, MachineError> {
    let text = read_file(file, "a model file in TOML, as `hydraxis commission` writes it")?;
    Document::parse(&text, &[]).into_settings(&file.display().to_string())
}

impl Machine {
    /// Reads the file, or the built-in machine without one; `settings` are `(key, value)` pairs that take the
    /// place of what the file says.
    ///
    /// # Errors
    /// All problems of the file at once, or that it cannot be read.
    pub fn load(file: Option<&Path>, settings: &[(String, String)]) -> Result<Self, MachineError> {
        let Some(path) = file else {
            return Self::parse(BUILT_IN, "built-in machine", Path::new("."), settings);
        };
        let text = read_file(path, "a machine file in TOML; without one the built-in machine is used")?;
        let name = path.display().to_string();
        Self::parse(&text, &name, path.parent().unwrap_or(Path::new(".")), settings)
    }

    /// Reads a machine file's text; paths in it are relative to `folder`.
    ///
    /// # Errors
    /// All problems at once.
    pub fn parse(text: &str, file: &str, folder: &Path, settings: &[(String, String)]) -> Result<Self, MachineError> {
        let document = Document::parse(text, settings);
        let machine = Self::read(document.root(), folder);
        document.into_result(file, machine)
    }

    fn read(mut root: Section, folder: &Path) -> Self {
        let name = root.text("name", "a text that names the machine");
        let timing = Timing::read(root.section("timing"));
        let realtime = Realtime::read(root.section("realtime"));
        let mut stage = root.section("stage");
        let stages = StageKind::ALL.map(|kind| StageSettings::read(stage.section(kind.name()), kind));
        stage.finish();
        let source = Source::read(root.section("source"), folder);
        let fuzzy = Fuzzy::read(root.section("fuzzy"));

        let mut table = root.section("axis");
        let names = table.names();
        if names.is_empty() || names.len() > MAX_AXES {
            let allowed = format!("1 to {MAX_AXES} axes, each a table [axis.NAME]");
            root.refuse("axis", format!("{} axes", names.len()), allowed);
        }
        let axes = names.iter().map(|name| Axis::read(name, table.section(name), &timing, &source, fuzzy, folder));
        let axes: Vec<Axis> = axes.collect();
        table.finish();
        let is_simulated = axes.iter().any(|axis| axis.plant.is_some());
        let hydraulics = Hydraulics::read(root.section("supply"), root.section("oil"), is_simulated);
        let scenario = Scenario::read(&mut root, &names);
        root.finish();
        Self { name, timing, realtime, stages, source, hydraulics, scenario, axes }
    }

    /// Settings of one stage.
    pub fn stage(&self, kind: StageKind) -> &StageSettings {
        &self.stages[kind as usize]
    }
}

#[cfg(test)]
mod tests;
