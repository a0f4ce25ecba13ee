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
    machine::{Machine, ModelChoice, ReferenceSource, Scenario, Source, TipFree, TipPiece, TipShape, TipTask},
    message::{AxisCommand, control_flag},
    statistics::{ErrorStatistics, median},
};
use serde::Serialize;

use super::{
    super::simulate::closed_loop,
    parallel,
    tip_drawn::{DrawnTask, toml},
    tip_picture::picture,
};
use crate::{
    arguments::{
        BareMachine, load_bare, simulated_only,
        values::{in_range, positive_in},
    },
    command::check,
    failure::Failure,
    group::operator,
    report::{
        output::{Output, OutputError, create},
        table::{number, table},
        teeth::{Teeth, TracePoint},
    },
};

/// Time in which the axes settle, come to the begin of the way, and stand after its end, s.
const AROUND: f64 = 5.0;

/// Time of a drawn task in parts of the planned one: teeth that lag behind slow the motion.
const PATIENCE: f64 = 1.5;

/// Ticks between two places of the teeth that are kept for a picture.
const TRACED: u64 = 5;
/// Controllers of a task: the fallback, and that of the machine file.
const CONTROLLERS: [&str; 2] = ["fallback", "model"];

/// `bench tip`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis bench tip                                               six tasks, all scenarios, some minutes
  hydraxis bench tip --task level --scenario nominal --payload 0
  hydraxis bench tip --speed 0.2m/s --speed 0.5m/s --json tip.json
  hydraxis bench tip --drawn 100 --seed 7                          tasks drawn at random, in reach and out of it")]
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
    /// Drive so many tasks that are drawn at random, each with a load and under one of the scenarios
    #[arg(long, value_name = "N", value_parser = in_range(1_u64, 100_000), allow_hyphen_values = true,
          conflicts_with_all = ["tasks", "speeds", "payloads", "seeds", "picture"])]
    pub drawn: Option<u64>,
    /// Seed of the drawn tasks
    #[arg(long, default_value_t = 1, requires = "drawn")]
    pub seed: u64,
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
        let line = |x: f64, z: f64| TipPiece { shape: TipShape::Line([x, z]), pitch: None, free: None };
        let (start, pitch, pieces) = match self {
            Self::LevelStill | Self::Level => ([7.2, 0.0], -115.0, vec![line(3.7, 0.0)]),
            Self::SlopeIn => ([7.25, 0.2], -115.0, vec![line(4.22, -1.55)]),
            Self::SlopeOut => ([7.5, -0.5], -110.0, vec![line(4.47, 1.25)]),
            Self::Circle => {
                let shape = TipShape::Arc { center: [6.0, -0.5], angle: -360.0 };
                ([7.0, -0.5], -115.0, vec![TipPiece { shape, pitch: None, free: None }])
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
        let free = (self == Self::LevelStill).then_some(TipFree::Telescope(0.6));
        TipTask { start, pitch, speed, free, rounding: 0.0, file: None, pieces }
    }
}

/// One run.
struct Case<'m> {
    name: String,
    task: TipTask,
    payload: f64,
    /// The machine under a scenario.
    machine: &'m Machine,
    has_model: bool,
    seed: u64,
    /// Time that is given to the motion, in parts of the planned one.
    patience: f64,
}

/// The figures of one run; m, degrees, s.
#[derive(Debug, Clone, Serialize)]
struct Row {
    task: String,
    speed: f64,
    payload: f64,
    scenario: String,
    controller: &'static str,
    seed: u64,
    /// The task as a table of a machine file.
    way: String,
    /// Why the task was refused; then there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
    rms: Option<f64>,
    max: Option<f64>,
    max_at: Option<[f64; 2]>,
    pitch_rms: Option<f64>,
    duration: Option<f64>,
    /// Axis, causes, and time of every latch.
    latches: Vec<String>,
    /// The planned time has passed.
    is_done: bool,
    #[serde(skip)]
    error: ErrorStatistics,
    #[serde(skip)]
    trace: Vec<TracePoint>,
}

#[derive(Debug, Serialize)]
struct TipReport {
    /// Seed of tasks that were drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    drawn_with: Option<u64>,
    rows: Vec<Row>,
}

/// Runs the command.
pub fn run(arguments: &BenchTipArguments) -> Result<(), Failure> {
    let machines = machines(arguments)?;
    let cases = match arguments.drawn {
        Some(count) => drawn(count, arguments.seed, &machines),
        None => named(arguments, &machines),
    };
    if arguments.picture.is_some() && cases.len() != CONTROLLERS.len() {
        return Err(Failure::usage(format!(
            "--picture: found {} runs; allowed: one task, speed, payload, scenario and seed",
            cases.len()
        )));
    }
    let output = Output::open(arguments.json.as_deref())?;
    let threads = arguments.threads.map_or_else(super::all_cores, usize::from);
    let drawn_with = arguments.drawn.map(|_| arguments.seed);
    let report = TipReport { drawn_with, rows: parallel::map(threads, "runs", &cases, drive)? };
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

/// The chosen ones of the six tasks, at each speed, with each load, under each scenario.
fn named<'m>(arguments: &BenchTipArguments, machines: &'m [Machine]) -> Vec<Case<'m>> {
    let or = |given: &[f64], all: &[f64]| if given.is_empty() { all.to_vec() } else { given.to_vec() };
    let kinds = if arguments.tasks.is_empty() { TipTaskKind::ALL.to_vec() } else { arguments.tasks.clone() };
    let (speeds, payloads) = (or(&arguments.speeds, &[0.2, 0.35, 0.5]), or(&arguments.payloads, &[0.0, 1e3, 1.5e3]));
    let mut cases = Vec::new();
    for kind in kinds {
        for (speed, payload) in speeds.iter().flat_map(|speed| payloads.iter().map(move |payload| (*speed, *payload))) {
            for (machine, has_model) in machines.iter().flat_map(|machine| [(machine, false), (machine, true)]) {
                let case = |seed| {
                    let (name, task) = (kind.name().to_owned(), kind.task(speed));
                    Case { name, task, payload, machine, has_model, seed, patience: 1.0 }
                };
                cases.extend((1..=arguments.seeds).map(case));
            }
        }
    }
    cases
}

/// Tasks that are drawn, each by both controllers.
fn drawn(count: u64, seed: u64, machines: &[Machine]) -> Vec<Case<'_>> {
    let of = |number: u64| {
        let DrawnTask { task, payload, scenario } = DrawnTask::new(seed, number);
        let machine = &machines[((scenario * machines.len() as f64) as usize).min(machines.len() - 1)];
        [false, true].map(|has_model| {
            let (name, task) = (number.to_string(), task.clone());
            Case { name, task, payload, machine, has_model, seed: 1 + number, patience: PATIENCE }
        })
    };
    (0..count).flat_map(of).collect()
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
    machine.tip = Some(case.task.clone());
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
        task: case.name.clone(),
        speed: case.task.speed,
        payload: case.payload,
        scenario: machine.scenario.name.clone(),
        controller: CONTROLLERS[usize::from(case.has_model)],
        seed: case.seed,
        way: toml(&case.task),
        refused: None,
        rms: None,
        max: None,
        max_at: None,
        pitch_rms: None,
        duration: None,
        latches: Vec::new(),
        is_done: false,
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
    let duration = Duration::from_secs_f64(case.patience * teeth.plan().duration() + AROUND);
    let ticks = pipeline::machine::samples_of(duration, machine.timing.period) as u64;
    let mut latched = vec![0; machine.axes.len()];
    closed_loop::run(&machine, case.seed, ticks, |tick| {
        if let Some(plant) = tick.plant {
            teeth.observe(tick.way, plant);
            row.trace.extend((tick.number % TRACED == 0).then(|| teeth.trace(tick.way, plant)).flatten());
        }
        row.tell_latches(&machine, tick.number, &tick.command.axes, &mut latched);
        Ok(())
    })?;
    let figures = teeth.figures();
    (row.rms, row.max, row.max_at, row.pitch_rms) = (figures.rms, figures.max, figures.max_at, figures.pitch_rms);
    (row.duration, row.is_done, row.error) = (Some(figures.duration), figures.is_done, figures.error);
    Ok(row)
}

impl Row {
    /// Tells the axes that this tick latches; `before` are the flags of the tick before, and become those of this one.
    fn tell_latches(&mut self, machine: &Machine, tick: u64, axes: &[AxisCommand], before: &mut [u32]) {
        for ((before, axis), now) in before.iter_mut().zip(&machine.axes).zip(axes) {
            if now.flags & control_flag::LATCHED & !*before != 0 {
                let seconds = tick as f64 * machine.timing.period.as_secs_f64();
                self.latches.push(format!("{}, {seconds:.2} s", operator::state(&axis.name, now.flags, now.operation)));
            }
            *before = now.flags;
        }
    }
}

/// A length in m as millimetres.
fn millimetres(length: Option<f64>) -> String {
    number(length.map_or(f64::NAN, |length| 1e3 * length))
}

impl TipReport {
    fn tables(&self) -> String {
        self.drawn_with.map_or_else(|| self.table_of_tasks(), |seed| self.table_of_drawn(seed))
    }

    /// A line for each controller.
    fn table_of_drawn(&self, seed: u64) -> String {
        let lines = CONTROLLERS.map(|controller| {
            let all = || self.rows.iter().filter(|row| row.controller == controller);
            let driven = || all().filter(|row| row.refused.is_none());
            let worst = driven().max_by(|a, b| a.rms.unwrap_or(0.0).total_cmp(&b.rms.unwrap_or(0.0)));
            vec![
                controller.to_owned(),
                driven().count().to_string(),
                all().filter(|row| row.refused.is_some()).count().to_string(),
                driven().filter(|row| !row.latches.is_empty()).count().to_string(),
                driven().filter(|row| !row.is_done).count().to_string(),
                millimetres(median(driven().filter_map(|row| row.rms))),
                millimetres(driven().filter_map(|row| row.max).reduce(f64::max)),
                worst.map_or(String::new(), |row| {
                    format!("task {}, {}: {}", row.task, row.scenario, millimetres(row.rms))
                }),
            ]
        });
        let header = ["controller", "driven", "refused", "latched", "not done", "median", "max", "worst"];
        format!(
            "Distance of the teeth from their way in tasks of seed {seed}, mm (rms; max over all):\n{}\n",
            table(&header, lines.to_vec())
        )
    }

    /// A line for each task, speed and controller.
    fn table_of_tasks(&self) -> String {
        let mut rows: Vec<&Row> = self.rows.iter().collect();
        let key = |row: &Row| {
            let task = TipTaskKind::ALL.iter().position(|task| task.name() == row.task);
            (task, row.speed.to_bits(), row.controller)
        };
        rows.sort_by_key(|row| key(row));
        let lines = rows.chunk_by(|a, b| key(a) == key(b)).map(|group| {
            let driven = || group.iter().filter(|row| row.refused.is_none());
            let all = driven().fold(ErrorStatistics::default(), |mut all, row| {
                all.merge(&row.error);
                all
            });
            let worst = driven().max_by(|a, b| a.error.rmse().total_cmp(&b.error.rmse()));
            let nominal = driven().find(|row| row.scenario == "nominal" && row.payload == 0.0);
            vec![
                group[0].task.clone(),
                format!("{} m/s", group[0].speed),
                group[0].controller.to_owned(),
                millimetres(nominal.and_then(|row| row.rms)),
                millimetres((all.count > 0).then(|| all.rmse())),
                millimetres((all.count > 0).then_some(all.max)),
                worst.map_or(String::new(), |row| {
                    format!("{} {} kg: {}", row.scenario, row.payload, millimetres(row.rms))
                }),
                number(driven().filter_map(|row| row.duration).fold(f64::NAN, f64::max)),
                format!("{}", group.iter().filter(|row| row.refused.is_some()).count()),
                format!("{}", group.iter().filter(|row| !row.latches.is_empty()).count()),
            ]
        });
        let header = ["task", "speed", "controller", "nominal", "all", "max", "worst", "s", "refused", "latched"];
        format!(
            "Distance of the teeth from their way, mm (rms; max over all runs):\n{}\n",
            table(&header, lines.collect())
        )
    }
}
