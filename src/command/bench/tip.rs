//! `hydraxis bench tip`: the simulated excavator's teeth follow lines, slopes and a circle.
//!
//! | task | what the teeth do |
//! |---|---|
//! | `level-still` | 3.5 m towards the machine on the ground, telescope still |
//! | `level` | the same line, the telescope moves |
//! | `slope-in`, `slope-out` | 3.5 m towards the machine, falling by 30 degrees, and rising |
//! | `circle` | a circle of 1 m about [6, -0.5] m |
//! | `dig` | down, along the ground, bucket curled in, up, away and open again |
//!
//! Each task is planned for the machine under its scenario, with the payload in the bucket, and driven by the
//! controller that the machine file says and by its fallback. The error is the distance of the true teeth from the way,
//! perpendicular to it.

use std::{io::Write, path::PathBuf, time::Duration};

use clap::{Args, ValueEnum};
use control_proc::ReferenceError;
use pipeline::{
    machine::{Machine, ModelChoice, ReferenceSource, Scenario, Source, TipPiece, TipShape, TipTask},
    message::control_flag,
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::{super::simulate::closed_loop, parallel, tip_picture::picture};
use crate::{
    arguments::{
        BareMachine, load_bare, simulated_only,
        values::{in_range, positive_in},
    },
    command::check,
    failure::Failure,
    report::{
        output::{Output, OutputError, create},
        table::{number, table},
        teeth::{Teeth, TracePoint},
    },
};

/// Time in which the axes settle, come to the begin of the way, and stand after its end, s.
const AROUND: f64 = 5.0;

/// Ticks between two places of the teeth that are kept for a picture.
const TRACED: u64 = 5;
/// Controllers of a task: that of the machine file and its fallback.
const CONTROLLERS: usize = 2;

/// `bench tip`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis bench tip                                               six tasks, all scenarios, some minutes
  hydraxis bench tip --task level --scenario nominal --payload 0
  hydraxis bench tip --speed 0.2m/s --speed 0.5m/s --json tip.json")]
pub struct BenchTipArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Only this task; may be given several times [default: all]
    #[arg(long = "task", value_name = "NAME", value_enum)]
    pub tasks: Vec<TipTaskKind>,
    /// Speed of the teeth; may be given several times [default: 0.2, 0.35 and 0.5 m/s]
    #[arg(long = "speed", value_name = "V", value_parser = positive_in("m/s"), allow_hyphen_values = true)]
    pub speeds: Vec<f64>,
    /// Mass in the bucket in kg; may be given several times [default: 0, 1000 and 1500]
    #[arg(long = "payload", value_name = "KG", value_parser = in_range(0.0_f64, 1e5), allow_hyphen_values = true)]
    pub payloads: Vec<f64>,
    /// Only this scenario; may be given several times [default: every built-in scenario with a controller]
    #[arg(long = "scenario", value_name = "NAME")]
    pub scenarios: Vec<String>,
    /// Number of seeds of the simulated noise; they count from 1
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = in_range(1_u64, 1000),
        allow_hyphen_values = true,
    )]
    pub seeds: u64,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw the machine, the way and the error of the teeth: an SVG of one task, speed, payload and scenario
    #[arg(long, value_name = "FILE.svg")]
    pub picture: Option<PathBuf>,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", value_parser = in_range(1_u16, u16::MAX), allow_hyphen_values = true)]
    pub threads: Option<u16>,
}

/// A task of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TipTaskKind {
    /// level cut, telescope still
    LevelStill,
    /// level cut
    Level,
    /// slope that falls towards the machine
    SlopeIn,
    /// slope that rises towards the machine
    SlopeOut,
    /// circle
    Circle,
    /// dig cycle
    Dig,
}

impl TipTaskKind {
    const ALL: [Self; 6] = [Self::LevelStill, Self::Level, Self::SlopeIn, Self::SlopeOut, Self::Circle, Self::Dig];

    fn name(self) -> &'static str {
        match self {
            Self::LevelStill => "level-still",
            Self::Level => "level",
            Self::SlopeIn => "slope-in",
            Self::SlopeOut => "slope-out",
            Self::Circle => "circle",
            Self::Dig => "dig",
        }
    }

    fn task(self, speed: f64) -> TipTask {
        let line = |x: f64, z: f64| TipPiece { shape: TipShape::Line([x, z]), pitch: None };
        let (start, pitch, pieces) = match self {
            Self::LevelStill | Self::Level => ([7.2, 0.0], -115.0, vec![line(3.7, 0.0)]),
            Self::SlopeIn => ([7.25, 0.2], -115.0, vec![line(4.22, -1.55)]),
            Self::SlopeOut => ([7.5, -0.5], -110.0, vec![line(4.47, 1.25)]),
            Self::Circle => {
                let shape = TipShape::Arc { center: [6.0, -0.5], angle: -360.0 };
                ([7.0, -0.5], -115.0, vec![TipPiece { shape, pitch: None }])
            }
            Self::Dig => {
                let turned = |x: f64, z: f64, pitch: f64| TipPiece { pitch: Some(pitch), ..line(x, z) };
                let pieces = vec![
                    line(7.0, -0.2),
                    line(4.8, -0.2),
                    turned(4.8, 0.3, -150.0),
                    line(5.0, 1.5),
                    turned(7.0, 1.5, -100.0),
                    turned(7.0, 0.5, -110.0),
                ];
                ([7.0, 0.5], -110.0, pieces)
            }
        };
        let telescope = (self == Self::LevelStill).then_some(0.6);
        TipTask { start, pitch, speed, telescope, pieces }
    }
}

/// One run.
struct Case<'m> {
    task: TipTaskKind,
    speed: f64,
    payload: f64,
    /// The machine under a scenario.
    machine: &'m Machine,
    has_model: bool,
    seed: u64,
}

/// The figures of one run; m, degrees, s.
#[derive(Debug, Clone, Serialize)]
struct Row {
    task: &'static str,
    speed: f64,
    payload: f64,
    scenario: String,
    controller: &'static str,
    seed: u64,
    /// Why the task was refused; then there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
    rms: Option<f64>,
    max: Option<f64>,
    max_at: Option<[f64; 2]>,
    pitch_rms: Option<f64>,
    duration: Option<f64>,
    is_latched: bool,
    #[serde(skip)]
    error: ErrorStatistics,
    #[serde(skip)]
    trace: Vec<TracePoint>,
}

#[derive(Debug, Serialize)]
struct TipReport {
    rows: Vec<Row>,
}

/// Runs the command.
pub fn run(arguments: &BenchTipArguments) -> Result<(), Failure> {
    let or = |given: &[f64], all: &[f64]| if given.is_empty() { all.to_vec() } else { given.to_vec() };
    let tasks = if arguments.tasks.is_empty() { TipTaskKind::ALL.to_vec() } else { arguments.tasks.clone() };
    let (speeds, payloads) = (or(&arguments.speeds, &[0.2, 0.35, 0.5]), or(&arguments.payloads, &[0.0, 1e3, 1.5e3]));
    let machines = machines(arguments)?;
    let mut cases = Vec::new();
    for task in tasks {
        for (speed, payload) in speeds.iter().flat_map(|speed| payloads.iter().map(move |payload| (*speed, *payload))) {
            for (machine, has_model) in machines.iter().flat_map(|machine| [(machine, false), (machine, true)]) {
                cases.extend((1..=arguments.seeds).map(|seed| Case { task, speed, payload, machine, has_model, seed }));
            }
        }
    }
    if arguments.picture.is_some() && cases.len() != CONTROLLERS {
        return Err(Failure::usage(format!(
            "--picture: found {} runs; allowed: one task, speed, payload, scenario and seed",
            cases.len()
        )));
    }
    let output = Output::open(arguments.json.as_deref())?;
    let threads = arguments.threads.map_or_else(super::all_cores, usize::from);
    let report = TipReport { rows: parallel::map(threads, "runs", &cases, drive)? };
    if let (Some(file), Some(mechanism)) = (&arguments.picture, &machines[0].mechanism) {
        let runs: Vec<_> = report.rows.iter().map(|row| (row.controller, row.trace.clone())).collect();
        let row = &report.rows[0];
        let title = format!("{}, {} m/s, {} kg, {}", row.task, row.speed, row.payload, row.scenario);
        let text = picture(mechanism, &title, &runs);
        let failed = |source| OutputError::Write { option: "--picture", path: file.clone(), source };
        create("--picture", file)?.write_all(text.as_bytes()).map_err(failed)?;
    }
    Ok(output.write(|| report.tables(), &report)?)
}

/// The machine under each of the scenarios.
fn machines(arguments: &BenchTipArguments) -> Result<Vec<Machine>, Failure> {
    let closed = || Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty());
    let names = match &arguments.scenarios[..] {
        [] => closed().map(|scenario| scenario.name).collect(),
        given => given.to_vec(),
    };
    let one = |name: &String| {
        let machine = load_bare(&arguments.machine, Some(name))?.into_twin();
        if machine.source != Source::Sim {
            return Err(Failure::usage(format!("{}, to be controlled", simulated_only(&machine))));
        }
        if machine.mechanism.is_none() {
            return Err(Failure::usage(
                "found a machine without [mechanism]; allowed: one that says where its teeth are",
            ));
        }
        check::deep(&machine)?;
        Ok(machine)
    };
    names.iter().map(one).collect()
}

fn drive(case: &Case<'_>) -> Result<Row, Failure> {
    let mut machine = case.machine.clone();
    machine.tip = Some(case.task.task(case.speed));
    if let Some(mechanism) = &mut machine.mechanism {
        mechanism.masses.payload.mass = case.payload;
    }
    for axis in machine.axes.iter_mut().take(mechanism::AXES) {
        axis.reference = ReferenceSource::Tip;
        if !case.has_model {
            axis.control.model = ModelChoice::None;
        }
    }
    let mut row = Row {
        task: case.task.name(),
        speed: case.speed,
        payload: case.payload,
        scenario: machine.scenario.name.clone(),
        controller: if case.has_model { "model" } else { "fallback" },
        seed: case.seed,
        refused: None,
        rms: None,
        max: None,
        max_at: None,
        pitch_rms: None,
        duration: None,
        is_latched: false,
        error: ErrorStatistics::default(),
        trace: Vec::new(),
    };
    let mut teeth = match Teeth::of(&machine) {
        Ok(teeth) => teeth.ok_or_else(|| Failure::run("found no plan"))?,
        Err(ReferenceError::Tip(error)) => return Ok(Row { refused: Some(error.to_string()), ..row }),
        Err(error) => return Err(Failure::usage(error)),
    };
    // The machine stands at the begin of the way.
    for (i, axis) in machine.axes.iter_mut().take(mechanism::AXES).enumerate() {
        if let (Some(plant), Some(first)) = (&mut axis.plant, teeth.plan().points(i).first()) {
            plant.initial_position = first.1;
        }
    }
    let duration = Duration::from_secs_f64(teeth.plan().duration() + AROUND);
    let ticks = pipeline::machine::samples_of(duration, machine.timing.period) as u64;
    closed_loop::run(&machine, case.seed, ticks, |tick| {
        if let Some(plant) = tick.plant {
            teeth.observe(tick.way, plant);
            row.trace.extend((tick.number % TRACED == 0).then(|| teeth.trace(tick.way, plant)).flatten());
        }
        row.is_latched |= tick.command.axes.iter().any(|axis| axis.flags & control_flag::LATCHED != 0);
        Ok(())
    })?;
    let figures = teeth.figures();
    (row.rms, row.max, row.max_at, row.pitch_rms) = (figures.rms, figures.max, figures.max_at, figures.pitch_rms);
    (row.duration, row.error) = (Some(figures.duration), figures.error);
    Ok(row)
}

impl TipReport {
    /// A line for each task, speed and controller.
    fn tables(&self) -> String {
        let mut rows: Vec<&Row> = self.rows.iter().collect();
        let key = |row: &Row| (row.task, row.speed.to_bits(), row.controller);
        rows.sort_by_key(|row| {
            let task = TipTaskKind::ALL.iter().position(|task| task.name() == row.task);
            (task, row.speed.to_bits(), row.controller)
        });
        let lines = rows.chunk_by(|a, b| key(a) == key(b)).map(|group| {
            let driven = || group.iter().filter(|row| row.refused.is_none());
            let all = driven().fold(ErrorStatistics::default(), |mut all, row| {
                all.merge(&row.error);
                all
            });
            let worst = driven().max_by(|a, b| a.error.rmse().total_cmp(&b.error.rmse()));
            let nominal = driven().find(|row| row.scenario == "nominal" && row.payload == 0.0);
            let mm = |value: Option<f64>| number(value.map_or(f64::NAN, |value| 1e3 * value));
            vec![
                group[0].task.to_owned(),
                format!("{} m/s", group[0].speed),
                group[0].controller.to_owned(),
                mm(nominal.and_then(|row| row.rms)),
                mm((all.count > 0).then(|| all.rmse())),
                mm((all.count > 0).then_some(all.max)),
                worst.map_or(String::new(), |row| format!("{} {} kg: {}", row.scenario, row.payload, mm(row.rms))),
                number(driven().filter_map(|row| row.duration).fold(f64::NAN, f64::max)),
                format!("{}", group.iter().filter(|row| row.refused.is_some()).count()),
                format!("{}", group.iter().filter(|row| row.is_latched).count()),
            ]
        });
        let header = ["task", "speed", "controller", "nominal", "all", "max", "worst", "s", "refused", "latched"];
        format!(
            "Distance of the teeth from their way, mm (rms; max over all runs):\n{}\n",
            table(&header, lines.collect())
        )
    }
}
