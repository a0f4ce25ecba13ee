//! The machine file: what the machine is, how it is identified and controlled, and on what it runs.
//!
//! TOML, SI units, durations as texts with their unit (`"10ms"`). Nothing that can move the machine has a
//! default. An unknown key, a wrong type, NaN, or a value out of range is refused, all problems at once, each
//! with file, line, key, what was found and what is allowed.

mod axis;
mod commissioned;
mod document;
mod fuzzy;
mod hydraulics;
mod identification;
mod plant;
mod reference;
mod scenario;

use std::{
    fmt,
    path::{Path, PathBuf},
    time::Duration,
};

use document::{Document, Section};

pub use axis::{Axis, Control, DeadBand, Encoder, ModelChoice};
pub use commissioned::{Commissioned, MOST_POINTS};
pub use fuzzy::{Fuzzy, Level};
pub use hydraulics::{Hydraulics, Oil, Supply};
pub use identification::{Estimator, Form, Identification, IdentifiedOutput, Split, shortest_training};
pub use plant::{LoadForce, Plant, ValveCurve};
pub use reference::{ReferenceSource, Sine};
pub use scenario::{Change, CommandSine, Parameter, Scenario};

use crate::{MAX_AXES, stage::StageKind};

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

/// Rates and time-outs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Sample and control period.
    pub period: Duration,
    /// Without a sample for this long the valve goes neutral and stays so.
    pub feedback_timeout: Duration,
    /// A snapshot older than this is said to be stale.
    pub model_timeout: Duration,
    /// A snapshot older than this is not used, and the axis is slowed down.
    pub model_lifetime: Duration,
    /// Without a command for this long the drive itself goes neutral.
    pub drive_timeout: Duration,
}

/// Scheduling rights: what happens when one that is asked for is not to be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Realtime {
    /// A stage's `core`.
    pub affinity: Rights,
    /// A stage's `priority`.
    pub scheduling: Rights,
    /// Locked memory.
    pub memory: Rights,
    /// Whether the memory of the stages is to be locked.
    pub lock_memory: bool,
    /// The longest that a core may take to wake from an idle state; without it as the kernel likes.
    pub wakeup_latency: Option<Duration>,
}

/// What happens when a right is not to be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rights {
    /// Say so and go on.
    Warn,
    /// Do not start.
    Strict,
}

/// How one stage runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StageSettings {
    /// Core to stay on.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99; the ordinary scheduler without one.
    pub priority: Option<u8>,
    /// How it waits for its input in real time.
    pub wait: Wait,
    /// Another program in its place.
    pub command: Option<Vec<String>>,
    /// What `hydraxis run` does when it ends before its time, in real time.
    pub restart: Restart,
}

/// What becomes of a stage that has ended before its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Restart {
    /// It ends the run.
    #[default]
    Never,
    /// It is started again, within bounds.
    OnFailure,
}

/// How a stage waits for its input, or for its timer, in real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wait {
    /// Sleeps until the sender's event, or until its time: for cores that are shared.
    #[default]
    Event,
    /// Polls without a pause: for a core of its own.
    Spin,
    /// Polls for this long, and then sleeps until the event: for inputs that come close together. A timer is slept for
    /// first, and polled for the last bit.
    SpinThenEvent(Duration),
}

/// Where samples come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// plant-sim.
    Sim,
    /// A CSV record, columns by [`Axis::columns`].
    Replay(PathBuf),
}

/// One thing wrong with a machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line, where it has one.
    pub line: Option<usize>,
    /// Full dotted key, empty for the file as a whole.
    pub key: String,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub allowed: String,
}

/// Everything wrong with a machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MachineError {
    /// The file's name, as the user typed it.
    pub file: String,
    /// At least one problem.
    pub problems: Vec<Problem>,
}

impl fmt::Display for MachineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().take(MAX_SHOWN).enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}:", self.file)?;
            if let Some(line) = problem.line {
                write!(f, "{line}:")?;
            }
            if !problem.key.is_empty() {
                write!(f, " {}:", problem.key)?;
            }
            write!(f, " found {}; allowed: {}", problem.found, problem.allowed)?;
        }
        match self.problems.len().checked_sub(MAX_SHOWN) {
            None | Some(0) => Ok(()),
            Some(more) => write!(f, "\n{}: and {more} more", self.file),
        }
    }
}

/// How long `spin-then-event` polls where the machine file does not say: twice what one stage takes.
const DEFAULT_SPIN: Duration = Duration::from_micros(200);
/// Beyond this a spin is no short one any more.
const LONGEST_SPIN: Duration = Duration::from_millis(10);

/// Problems that are shown; a file of another kind has one in every line.
const MAX_SHOWN: usize = 30;

impl std::error::Error for MachineError {}

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

/// Number of samples that a duration spans, rounded to the nearest.
pub fn samples_of(duration: Duration, period: Duration) -> usize {
    (duration.as_secs_f64() / period.as_secs_f64()).round() as usize
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

impl Timing {
    fn read(mut section: Section) -> Self {
        let millis = Duration::from_millis;
        let period = section.duration("period", Duration::from_micros(100)..=Duration::from_secs(10));
        let model_timeout = section.duration_or("model_timeout", millis(2000), millis(1)..=millis(600_000));
        let lifetime = millis(30_000).max(model_timeout);
        let timing = Self {
            period,
            feedback_timeout: section.duration_or("feedback_timeout", period * 3, millis(1)..=millis(60_000)),
            model_timeout,
            model_lifetime: section.duration_or("model_lifetime", lifetime, millis(1)..=millis(3_600_000)),
            drive_timeout: section.duration_or("drive_timeout", millis(50), millis(1)..=millis(60_000)),
        };
        if timing.model_lifetime < timing.model_timeout {
            section.refuse(
                "model_lifetime",
                format!("{:?}", timing.model_lifetime),
                format!("model_timeout, {:?}, or longer", timing.model_timeout),
            );
        }
        section.finish();
        timing
    }
}

impl Realtime {
    fn read(mut section: Section) -> Self {
        let choices = [("warn", Rights::Warn), ("strict", Rights::Strict)];
        let all = section.choice_or("rights", Rights::Warn, &choices);
        let realtime = Self {
            affinity: section.choice_or("affinity", all, &choices),
            scheduling: section.choice_or("scheduling", all, &choices),
            memory: section.choice_or("memory", all, &choices),
            lock_memory: section.flag_or("lock_memory", false),
            wakeup_latency: section.optional_duration("wakeup_latency", Duration::ZERO..=Duration::from_millis(100)),
        };
        section.finish();
        realtime
    }
}

impl StageSettings {
    fn read(mut section: Section, kind: StageKind) -> Self {
        // A simulated machine that began anew would jump.
        let restart = if kind == StageKind::PlantSim { Restart::Never } else { Restart::OnFailure };
        let command =
            section.optional_texts("command", "a program and its arguments, such as [\"python3\", \"my_plant.py\"]");
        if command.as_ref().is_some_and(Vec::is_empty) {
            section.refuse("command", "an empty list", "a program and its arguments");
        }
        let spin = section.optional_duration("spin", Duration::from_micros(1)..=LONGEST_SPIN);
        let choices = [
            ("event", Wait::Event),
            ("spin", Wait::Spin),
            ("spin-then-event", Wait::SpinThenEvent(spin.unwrap_or(DEFAULT_SPIN))),
        ];
        let wait = section.choice_or("wait", Wait::Event, &choices);
        if spin.is_some() && !matches!(wait, Wait::SpinThenEvent(_)) {
            section.refuse("spin", "a time without its way of waiting", "with wait = \"spin-then-event\"");
        }
        let settings = Self {
            core: section.optional_integer("core", 0..=1023),
            priority: section.optional_integer("priority", 1..=99).map(|priority| priority as u8),
            wait,
            command,
            restart: section.choice_or(
                "restart",
                restart,
                &[("on-failure", Restart::OnFailure), ("never", Restart::Never)],
            ),
        };
        section.finish();
        settings
    }
}

impl Source {
    fn read(mut section: Section, folder: &Path) -> Self {
        let replay = section.choice("kind", &[("sim", false), ("replay", true)]) == Some(true);
        let source = if replay {
            Self::Replay(folder.join(section.text("file", "the path of a CSV record, relative to the machine file")))
        } else {
            Self::Sim
        };
        section.finish();
        source
    }
}

#[cfg(test)]
mod tests;
