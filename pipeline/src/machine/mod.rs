//! The machine file: what the machine is, how it is identified and controlled, and on what it runs.
//!
//! A machine file is TOML. Numbers are in SI units, or texts with their unit (`"50mm"`); durations are texts with their
//! unit (`"10ms"`). A key that decides how the
//! machine moves has no default. An unknown key, a wrong type, NaN, or a value out of range is refused. All problems
//! are reported at once, each with file, line, key, what was found and what is allowed.
//!
//! | file | what it holds |
//! |---|---|
//! | `timing`, `stages`, `source`, `can`, `fuzzy`, `hydraulics`, `mechanism`, `soil` | tables of the whole machine |
//! | `tip`, `walls` | a motion of the bucket's teeth; places that boom, arm and bucket do not pass |
//! | `axis/` | the tables of one axis |
//! | `count_length` | length of one count of a sensor at a joint |
//! | `scenario`, `scenarios.toml` | what changes while the simulated machine works |
//! | `document/` | the reader: keys with meaning, allowed values, default and origin |
//! | `quantity` | numbers as texts with their unit |
//! | `explain` | effective values with their origin, and the table of all keys |
//! | `model_file` | what may stand in a model file |
//! | `error` | what is wrong with a machine file |
//!
//! Nothing here runs in a stage's loop: files are read and memory is taken before the loop begins.

mod axis;
mod can;
mod count_length;
mod document;
mod error;
mod explain;
mod fuzzy;
mod hydraulics;
mod mechanism;
mod model_file;
mod quantity;
mod scenario;
mod soil;
mod source;
mod stages;
mod timing;
mod tip;
mod walls;

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
};

use ::mechanism::{AXES, Mechanism};
use axis::Shared;
use document::{Document, Section, Setting};

pub use axis::{
    AngleKind, AngleSensor, Axis, COMPENSATED, CanDevices, CanPosition, CanSignals, Commissioned, Control, DeadBand,
    Directions, Encoder, Estimator, FallbackWithout, Form, GREY_BOX_MEMORY, Hardware, Identification, IdentifiedOutput,
    LEAST_SET_POINT, Law, LimitSettings, LoadForce, LoadHolding, MAX_HORIZON, MAX_MOVES, MAX_RESPONSE, MOST_POINTS,
    ModelChoice, MotionLimits, MoveWeight, Overrun, Plan, PlanSettings, Plant, Ports, PressureTransducers,
    ReferenceSource, SMITH_MEMORY, SensorErrors, Sine, Slope, SmithSettings, Split, Start, ValveCurve,
    shortest_training,
};
pub use can::{CanBus, CanMessage, ChecksumKind};
pub use document::{DefaultValue, EffectiveValue, Origin, ValueForm, samples_of};
pub use error::{MachineError, Problem};
pub use explain::{Key, keys};
pub use fuzzy::{Fuzzy, Level};
pub use hydraulics::{Hydraulics, Oil, Supply, SupplyKind};
pub use quantity::{allowed_units, quantity, units};
use scenario::Described;
pub use scenario::{Change, CommandSine, Parameter, Scenario, Target};
pub use soil::Soil;
pub use source::{Drive, Source};
pub use stages::{Realtime, Restart, Rights, StageKind, StageSettings, Wait};
pub use timing::Timing;
pub use tip::{TipFree, TipPiece, TipShape, TipTask, TipWithout};
pub use walls::{MOST_CORNERS, Walls};

use crate::{MAX_AXES, bounded, layout, nearest::did_you_mean_file};

/// The built-in machine, a 20 t excavator; the same text is in `examples/`.
pub const BUILT_IN: &str = include_str!("../../../examples/excavator.toml");

/// The model of the built-in machine that commissioning has found; the same text is in `examples/`.
pub const BUILT_IN_MODEL: &str = include_str!("../../../examples/excavator-model.toml");

/// A machine of four independent axes with fast valves, on which estimators and controllers are tested.
pub const FOUR_AXES: &str = include_str!("../../../examples/four-axes.toml");

/// A machine: what a machine file says.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Name of the machine, shown in reports.
    pub name: String,
    /// Period and time-outs.
    pub timing: Timing,
    /// Rights of real time.
    pub realtime: Realtime,
    /// How each stage runs, by [`StageKind`].
    pub stages: [StageSettings; 4],
    /// Where samples come from.
    pub source: Source,
    /// Where commands go.
    pub drive: Drive,
    /// The CAN bus, if there is one.
    pub can: Option<CanBus>,
    /// Pump and oil of the simulated axes, if there are any.
    pub hydraulics: Option<Hydraulics>,
    /// Pins, lengths and masses of the excavator that the first four axes move, if there is one.
    pub mechanism: Option<Mechanism>,
    /// Heaviest payload, kg, up to which it is estimated by the chamber pressures; none where it is not.
    pub heaviest_payload: Option<f64>,
    /// Soil in front of the teeth of the mechanism, if there is one.
    pub soil: Option<Soil>,
    /// The motion of the teeth that axes with a reference of kind `tip` follow, if there is one.
    pub tip: Option<TipTask>,
    /// Walls that boom, arm and bucket do not cross, if there are any.
    pub walls: Option<Walls>,
    /// What changes while the simulated machine works.
    pub scenario: Scenario,
    /// The axes, in the order of the file.
    pub axes: Vec<Axis>,
}

fn read_file(path: &Path, allowed: &str) -> Result<String, MachineError> {
    bounded::read_text(path, bounded::SETTINGS).map_err(|error| {
        let found = format!("a file that cannot be read ({error})");
        MachineError::of_file(path.display().to_string(), found, format!("{allowed}{}", did_you_mean_file(path)))
    })
}

/// The values of a model file, such as `commission` writes, as settings that take the place of values in a machine
/// file.
///
/// # Errors
/// The file cannot be read, or is not TOML.
pub fn model_settings(file: &Path) -> Result<Vec<(String, String)>, MachineError> {
    let settings = model_file::read(file)?.into_iter();
    Ok(settings.map(|setting| (setting.path, setting.text)).collect())
}

/// [`model_settings`] of a model file with this text. `file` is its name for messages.
///
/// # Errors
/// The text is not TOML.
pub fn model_settings_in(text: &str, file: &str) -> Result<Vec<(String, String)>, MachineError> {
    let settings = model_file::parse(text, file)?.into_iter();
    Ok(settings.map(|setting| (setting.path, setting.text)).collect())
}

/// A machine file that is to be read.
struct MachineFile {
    text: Cow<'static, str>,
    /// Values of the model that comes with the machine; they replace those of the file.
    model: Vec<Setting>,
    /// Name of the file for messages.
    name: String,
    /// Folder that paths in the file are relative to.
    folder: PathBuf,
}

impl MachineFile {
    /// Opens the file; without one the built-in machine with its model.
    fn open(file: Option<&Path>) -> Result<Self, MachineError> {
        let Some(path) = file else {
            let (text, name) = (Cow::Borrowed(BUILT_IN), "built-in machine".to_owned());
            let model = model_file::parse(BUILT_IN_MODEL, "built-in model")?;
            return Ok(Self { text, model, name, folder: PathBuf::from(".") });
        };
        let text = read_file(
            path,
            "a machine file in TOML, such as `hydraxis init` writes; without one the built-in machine is used",
        )?;
        let folder = path.parent().unwrap_or(Path::new(".")).to_owned();
        Ok(Self { text: Cow::Owned(text), model: Vec::new(), name: path.display().to_string(), folder })
    }
}

impl Machine {
    /// Reads the file, or without one the built-in machine with its model. `settings` are pairs of key and value that
    /// take the place of values in the file.
    ///
    /// # Errors
    /// All problems of the file at once, or that the file cannot be read.
    ///
    /// ```
    /// use pipeline::machine::Machine;
    ///
    /// let machine = Machine::load(None, &[])?;
    /// assert_eq!(machine.axes[0].name, "boom");
    ///
    /// let slower = ("axis.boom.control.kp".to_owned(), "3".to_owned());
    /// assert_eq!(Machine::load(None, &[slower])?.axes[0].control.kp, 3.0);
    ///
    /// let unknown = ("axis.boom.gain".to_owned(), "3".to_owned());
    /// let error = Machine::load(None, &[unknown]).unwrap_err();
    /// assert!(error.to_string().contains("--set axis.boom.gain: found an unknown key"));
    /// # Ok::<(), pipeline::machine::MachineError>(())
    /// ```
    pub fn load(file: Option<&Path>, settings: &[(String, String)]) -> Result<Self, MachineError> {
        Self::explain(file, None, settings).map(|(machine, _)| machine)
    }

    /// Number that two programs compare before they work on one machine: a hash of all that identification and control
    /// depend on, that is of the times and of the axes in their order, without what is simulated. A trajectory counts
    /// by where its file is, from whatever folder it is named.
    pub fn fingerprint(&self) -> u64 {
        let axes = self.axes.iter().map(|axis| {
            let mut axis = Axis { plant: None, can: None, hardware: Hardware::default(), ..axis.clone() };
            if let ReferenceSource::Trajectory { file, .. } = &mut axis.reference
                && let Ok(absolute) = file.canonicalize()
            {
                *file = absolute;
            }
            axis
        });
        let text = format!("{:?} {:?} {:?} {:?}", self.timing, self.tip, self.walls, axes.collect::<Vec<_>>());
        // The lower half goes into every message, where 0 means none.
        layout::named(&text) | 1
    }

    /// Number that tells whether two programs mean the same axes: a hash of period, names, strokes, limits and sensors
    /// in their order. Models, gains and references are not in it.
    pub fn hardware(&self) -> u64 {
        let axes =
            self.axes.iter().map(|axis| (&axis.name, axis.stroke, axis.max_speed, axis.soft_limits, &axis.encoder));
        layout::named(&format!("{:?} {:?}", self.timing.period, axes.collect::<Vec<_>>()))
    }

    /// Number that tells whether two machine files mean the same axes as they were commissioned: a hash of the name of
    /// the machine, of what each axis depends on, and of its commissioned model.
    pub fn commissioning(&self) -> u64 {
        let axes = self.axes.iter().map(|axis| (&axis.name, &axis.hardware.text, &axis.commissioned));
        layout::named(&format!("{} {:?}", self.name, axes.collect::<Vec<_>>()))
    }

    /// The machine of [`FOUR_AXES`], with `settings` as in [`Self::load`].
    ///
    /// # Errors
    /// All problems of the settings at once.
    pub fn four_axes(settings: &[(String, String)]) -> Result<Self, MachineError> {
        Self::parse(FOUR_AXES, "examples/four-axes.toml", Path::new("."), settings)
    }

    /// Reads the text of a machine file. `file` is its name for messages; paths in the text are relative to `folder`.
    ///
    /// # Errors
    /// All problems of the text at once.
    pub fn parse(text: &str, file: &str, folder: &Path, settings: &[(String, String)]) -> Result<Self, MachineError> {
        let document = Document::parse(text, Setting::typed(settings));
        let machine = Self::read(document.root(), folder);
        document.into_result(file, machine)
    }

    fn read(mut root: Section, folder: &Path) -> Self {
        let name = root.key("name", "Name of the machine, shown in reports").text("a text that names the machine");
        let timing = Timing::read(root.section("timing"));
        let realtime = Realtime::read(root.section("realtime"));
        let (source, program) = Source::read(root.section("source"), folder);
        let drive = Drive::read(root.section("drive"), &source);
        let stages = read_stages(&mut root, &source, program);
        let section = root.section("can");
        let has_bus = section.is_given() || source == Source::Can;
        let can = has_bus.then(|| CanBus::read(section, &timing, folder));
        let fuzzy = Fuzzy::read(root.section("fuzzy"));

        let mut table = root.section("axis");
        let names = axis::names(&table);
        if names.is_empty() || names.len() > MAX_AXES {
            let allowed = format!("1 to {MAX_AXES} axes, each a table [axis.NAME]");
            root.refuse("axis", format!("{} axes", names.len()), allowed);
        }
        let mut section = root.section("mechanism");
        let mechanism = mechanism::read(&mut section);
        let carried = &names[..if mechanism.is_some() { AXES.min(names.len()) } else { 0 }];
        let shared = Shared { timing: &timing, source: &source, drive, fuzzy, folder, carried };
        let mut axes: Vec<Axis> = names.iter().map(|name| Axis::read(name, table.section(name), &shared)).collect();
        table.finish();
        mechanism.iter().for_each(|mechanism| expect_carried(&section, mechanism, &names, &mut axes));
        section.finish();
        let (mechanism, heaviest_payload) = mechanism.unzip();
        expect_one_node_each(&root, &axes);
        let is_simulated = axes.iter().any(|axis| axis.plant.is_some());
        let hydraulics = Hydraulics::read(root.section("supply"), root.section("oil"), is_simulated);
        let soil = Soil::read(root.section("soil"), mechanism.is_some());
        let tip = TipTask::read(root.section("tip"), mechanism.is_some(), folder);
        TipTask::expect_followers(tip.as_ref(), &root.section("tip"), &axes);
        let walls = Walls::read(root.section("walls"), mechanism.as_ref());
        let described = Described { axes: &names, has_mechanism: mechanism.is_some(), has_soil: soil.is_some() };
        let scenario = Scenario::read(&mut root, &described);
        let values = root.values();
        for axis in &mut axes {
            axis.control.pump_response = hydraulics.map_or(0.0, |of| of.supply.kind.response());
            axis.hardware = Hardware::of(&values, &names, &axis.name);
        }
        root.finish();
        Self {
            name,
            timing,
            realtime,
            stages,
            source,
            drive,
            can,
            hydraulics,
            mechanism,
            heaviest_payload: heaviest_payload.flatten(),
            soil,
            tip,
            walls,
            scenario,
            axes,
        }
    }

    /// The twin of a real machine: the same machine, simulated by its tables `plant`, `supply` and `oil`. A machine
    /// without them, or with another source, stays as it is.
    #[must_use]
    pub fn into_twin(mut self) -> Self {
        let has_plants = self.hydraulics.is_some() && self.axes.iter().all(|axis| axis.plant.is_some());
        if self.source.is_real() && has_plants {
            (self.source, self.drive) = (Source::Sim, Drive::Sim);
            self.stages[StageKind::PlantSim as usize].command = None;
            for axis in &mut self.axes {
                axis.hardware = std::mem::take(&mut axis.hardware).into_twin();
            }
        }
        self
    }

    /// The key with the program that runs in a stage's place: that of the stage, or of an external source.
    pub fn command_key(&self, kind: StageKind) -> String {
        match kind {
            StageKind::PlantSim if self.source == Source::External => "source.command".to_owned(),
            kind => format!("stage.{}.command", kind.name()),
        }
    }

    /// Settings of one stage.
    pub fn stage(&self, kind: StageKind) -> &StageSettings {
        &self.stages[kind as usize]
    }
}

/// How each stage runs; `program` takes the place of the simulated machine where the source is external.
fn read_stages(root: &mut Section, source: &Source, program: Option<Vec<String>>) -> [StageSettings; 4] {
    let has_program = *source == Source::External;
    let mut stage = root.section("stage");
    let mut stages =
        StageKind::ALL.map(|kind| StageSettings::read(stage.section(kind.name()), kind, source.is_real(), has_program));
    stage.finish();
    if has_program {
        stages[StageKind::PlantSim as usize].command = program;
    }
    stages
}

/// Refuses a mechanism, and a mass up to which its payload is estimated, that do not fit the axes, and completes the
/// sensors of its joints.
fn expect_carried(
    section: &Section,
    (mechanism, heaviest): &(Mechanism, Option<f64>),
    names: &[String],
    axes: &mut [Axis],
) {
    let strokes: Vec<f64> = axes.iter().map(|axis| axis.stroke).collect();
    if heaviest.is_some() {
        mechanism::expect_pressures(section, axes);
    }
    mechanism::expect_order(section, names);
    mechanism::expect_movable(section, mechanism, &strokes);
    if section.is_sound() {
        count_length::complete(mechanism, axes);
    }
}

/// Refuses two devices of one number on the bus.
fn expect_one_node_each(root: &Section, axes: &[Axis]) {
    let mut taken: Vec<u8> = Vec::new();
    for axis in axes {
        for node in axis.can.iter().flat_map(CanDevices::nodes) {
            if taken.contains(&node) {
                let key = format!("axis.{}.can", axis.name);
                root.refuse(&key, format!("node {node}"), "a number that no other device of the machine has");
            }
            taken.push(node);
        }
    }
}

#[cfg(test)]
mod tests;
