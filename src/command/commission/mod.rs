//! `hydraxis commission`: a bounded experiment with every axis, and a model file with the results.
//!
//! Runs before the machine works, or beside the loop of a running group. The analysis never runs in a stage.

mod arguments;
mod file;
mod live;
mod report;
mod simulated;

use std::path::{Path, PathBuf};

use control_proc::{
    commission::{ExperimentOptions, ExperimentRecord, Phase},
    fallback::pressure,
    tuning::{Baseline, LEAST_FIT, is_poor, smith, softest, with_margin},
};
use pipeline::{
    channel::{Prefix, remove_leftovers},
    hammerstein::MAX_DELAY,
    machine::{Axis, Commissioned, Control, Law, Machine, Scenario, Source},
};
use serde::Serialize;

use super::check;
use crate::{
    arguments::{axes, load_bare, simulated_only},
    failure::Failure,
    group::{
        operator::board,
        running::{machine_of, meant},
        signals::stop_flag,
    },
    report::{
        margins::LoopMargins,
        output::{Output, create, is_stdout},
        table::{percent, progress, table},
    },
};
pub use arguments::CommissionArguments;
use file::{ModelFile, ModelFileError};
use live::commission_live;
pub use simulated::{SimulatedError, commission_axis, commission_simulated};

/// Parts of the tested openings at which the table shows the curve.
const SHOWN: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// Steps of the progress bar for each axis.
const STEPS_PER_AXIS: u64 = 1000;

/// Runs the command.
pub fn run(arguments: &CommissionArguments) -> Result<(), Failure> {
    let group = running(arguments)?;
    let (machine, typed) = machine(arguments, group.as_ref())?;
    let axes = axes(&machine, &arguments.axes)?;
    if group.is_none() && machine.source != Source::Sim {
        return Err(Failure::usage(format!(
            "{}, or --enable for the machine of a running group",
            simulated_only(&machine)
        )));
    }
    check::deep(&machine)?;
    expect_travel(arguments, &machine, &axes)?;
    let file = ModelFile::new(&arguments.out, arguments.force)?;
    let output = Output::open(arguments.json.as_deref())?;
    let mut report = arguments.report.as_deref().map(|path| create("--report", path)).transpose()?;
    let found = experiment(arguments, group.as_ref(), &machine, &axes)?;
    file.write(&model_text(&machine, found.iter().map(|found| (found.axis, &found.model, found.control))))?;
    found.iter().for_each(warn);
    if group.is_none() && !machine.scenario.changes.is_empty() {
        let Scenario { name, summary, .. } = &machine.scenario;
        eprintln!("measured under the scenario \"{name}\": {summary}. Without --scenario nothing changes");
    }
    if let Some(file) = &mut report {
        report::write(file, &machine, &found)?;
    }
    let figures: Vec<AxisCommissioning> = found.iter().map(AxisCommissioning::new).collect();
    output.write(|| tables(&found, &arguments.out), &figures)?;
    let is_good = !found.iter().any(|found| is_poor(&found.model));
    if is_good && !arguments.json.as_deref().is_some_and(is_stdout) {
        eprintln!("{}", next(typed.as_deref(), &arguments.out));
    }
    Ok(())
}

/// The scenario of the experiment. That of the machine file is for runs: a machine that changes has no single model.
fn scenario(arguments: &CommissionArguments) -> Option<&str> {
    let is_set = arguments.machine.bare.settings.iter().any(|(key, _)| key == "scenario");
    arguments.machine.scenario.as_deref().or((!is_set).then_some(Scenario::NOMINAL))
}

/// The running group whose machine is commissioned; none for a simulated machine.
fn running(arguments: &CommissionArguments) -> Result<Option<Prefix>, Failure> {
    if let Some(prefix) = arguments.prefix.as_ref().filter(|_| !arguments.enable) {
        return Err(Failure::usage(format!(
            "--prefix: found \"{prefix}\", a running group, without --enable; allowed: with --enable, which disarms \
             all axes and then moves one after the other"
        )));
    }
    Ok(arguments.enable.then(|| meant(arguments.prefix.as_ref())).transpose()?)
}

/// The machine that is commissioned, and the path of its file: that of the command line, or that of the group.
fn machine(arguments: &CommissionArguments, group: Option<&Prefix>) -> Result<(Machine, Option<PathBuf>), Failure> {
    let bare = &arguments.machine.bare;
    let Some(prefix) = group else {
        let machine = load_bare(bare, scenario(arguments))?.into_twin();
        return Ok((machine, bare.machine.clone()));
    };
    if bare.machine.is_some() || bare.model.is_some() {
        return Ok((load_bare(bare, scenario(arguments))?, bare.machine.clone()));
    }
    board(prefix)?;
    let bare = machine_of(prefix, &bare.settings)?;
    Ok((load_bare(&bare, None)?, bare.machine))
}

/// Refuses a `--travel` that one of the axes does not have.
fn expect_travel(arguments: &CommissionArguments, machine: &Machine, axes: &[usize]) -> Result<(), Failure> {
    let Some(found) = arguments.travel else { return Ok(()) };
    let travels = axes.iter().map(|index| &machine.axes[*index]).map(|axis| {
        let (low, high) = axis.soft_limits;
        (&axis.name, high - low)
    });
    // A difference of two limits may be a bit less than the number that a person would write for it.
    match travels.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, travel)| found > *travel * (1.0 + 1e-9)) {
        None => Ok(()),
        Some((name, travel)) => Err(Failure::usage(format!(
            "--travel: found {found} m; allowed: up to {} m, the travel between the soft limits of axis {name}",
            (1e4 * travel * (1.0 + 1e-9)).floor() / 1e4
        ))),
    }
}

/// What was found of one axis.
struct Found<'a> {
    /// Its index.
    axis: usize,
    name: &'a str,
    model: Commissioned,
    record: ExperimentRecord,
    /// The tuned settings; none for a poor model.
    control: Option<Control>,
    /// The loops of these settings.
    loops: Vec<LoopMargins>,
}

impl<'a> Found<'a> {
    fn new(machine: &'a Machine, axis: usize, (model, record): (Commissioned, ExperimentRecord)) -> Self {
        let name = machine.axes[axis].name.as_str();
        let control = tuned(machine, axis, &model);
        let of = |control| LoopMargins::of(&machine.axes[axis], &control, &model, machine.timing.period);
        Self { axis, name, loops: control.map_or_else(Vec::new, of), model, record, control }
    }
}

/// Says on standard error what is wrong with a model.
fn warn(found: &Found) {
    if is_poor(&found.model) {
        eprintln!(
            "axis.{}: found a fit of {}; allowed: {LEAST_FIT} % and more. Do not control with this model. Look at the \
             motion in a --report, and commission again with a longer --duration or a wider --travel",
            found.name,
            percent(found.model.fit_percent)
        );
    }
}

/// Does the experiments, with a progress bar. Returns what was found in the order of `axes`.
fn experiment<'a>(
    arguments: &CommissionArguments,
    group: Option<&Prefix>,
    machine: &'a Machine,
    axes: &[usize],
) -> Result<Vec<Found<'a>>, Failure> {
    let options = ExperimentOptions {
        travel: arguments.travel,
        speed: arguments.speed,
        duration: arguments.duration,
        seed: arguments.seed,
    };
    let bar = progress(STEPS_PER_AXIS * axes.len() as u64, "");
    let show = |axis: usize, phase: Phase, part: f64| {
        let done = axes.iter().take_while(|other| **other != axis).count();
        let position = STEPS_PER_AXIS * done as u64 + (STEPS_PER_AXIS as f64 * part) as u64;
        if position != bar.position() {
            bar.set_position(position);
            bar.set_message(format!("{}: {}", machine.axes[axis].name, phase.name()));
        }
    };
    let models = match group {
        None => commission_simulated(machine, axes, arguments.seed, &options, show),
        Some(prefix) => {
            let found = commission_live(machine, axes, prefix, stop_flag()?, &options, show);
            // The last process that leaves a group that has ended removes its files.
            let _ = remove_leftovers(prefix);
            found
        }
    };
    bar.finish_and_clear();
    Ok(axes.iter().zip(models?).map(|(axis, found)| Found::new(machine, *axis, found)).collect())
}

/// The text of the model file with these models and tuned settings of the axes with these indices.
pub fn model_text<'a>(
    machine: &Machine,
    found: impl Iterator<Item = (usize, &'a Commissioned, Option<Control>)>,
) -> String {
    let settings = found.map(|(axis, model, control)| (&machine.axes[axis], model, control));
    file::text(&machine.name, settings)
}

/// The tuned settings of an axis with this model; none for a poor model.
pub fn tuned(machine: &Machine, index: usize, model: &Commissioned) -> Option<Control> {
    if is_poor(model) {
        return None;
    }
    let period = machine.timing.period.as_secs_f64();
    let mut axis = Axis { commissioned: Some(model.clone()), ..machine.axes[index].clone() };
    axis.control.pressure_damping = if axis.measures_force() { pressure::ratio(model, period) } else { 0.0 };
    // Feed-forward must not look further ahead than the longest preview.
    let is_near = model.reaction() <= MAX_DELAY as f64 * period;
    let baseline = if is_near { Baseline::Feedforward } else { Baseline::DeadBand };
    let control = baseline.tuned(index, &axis, period)?;
    let law = if is_near && control.pressure_damping == 0.0 { smith(index, &axis, &control, period) } else { None };
    let control = Control { law: law.map_or(Law::Predictive, Law::Smith), ..control };
    let softest = machine.mechanism.map(|_| softest(model));
    Some(with_margin(&control, softest.as_ref().unwrap_or(model), period))
}

/// The command to type next.
fn next(machine: Option<&Path>, out: &Path) -> String {
    let machine = machine.map(|machine| format!(" {}", machine.display())).unwrap_or_default();
    format!("next: hydraxis run{machine} --model {}", out.display())
}

/// The models as tables.
fn tables(found: &[Found], out: &Path) -> String {
    let row = |Found { name, model, .. }: &Found| {
        let milli = |seconds: f64| format!("{:.0} ms", 1e3 * seconds);
        vec![
            (*name).to_owned(),
            milli(model.dead_time),
            milli(model.time_constant),
            format!("{:.4}", model.dead_band.extend),
            format!("{:.4}", model.dead_band.retract),
            format!("{:.4}", model.hysteresis),
            percent(model.fit_percent),
        ]
    };
    let header =
        ["axis", "dead time", "time constant", "dead band extending", "retracting", "hysteresis", "fit 0.5 s ahead"];
    let figures = table(&header, found.iter().map(row).collect());
    let curve = |name: &str, model: &Commissioned, sign: f64| {
        let (low, high) = model.tested();
        let mut cells = vec![name.to_owned()];
        cells.extend(SHOWN.iter().map(|part| {
            let (edge, last) =
                if sign > 0.0 { (model.dead_band.extend, high) } else { (-model.dead_band.retract, low) };
            let command = edge + part * (last - edge);
            format!("{command:+.3}: {:+.4} m/s", model.speed(command))
        }));
        cells
    };
    let curves = found.iter().flat_map(|of| [1.0, -1.0].map(|sign| curve(of.name, &of.model, sign)));
    let header = ["command: speed", "a quarter of what was tested", "half", "three quarters", "all"];
    let curves = table(&header, curves.collect());
    let loops: Vec<LoopMargins> = found.iter().flat_map(|found| found.loops.clone()).collect();
    let loops = if loops.is_empty() { String::new() } else { format!("{}\n\n", LoopMargins::table(&loops)) };
    format!("{figures}\n\n{curves}\n\n{loops}written: {}\n", out.display())
}

/// The model of one axis, as JSON has it.
#[derive(Serialize)]
struct AxisCommissioning<'a> {
    axis: &'a str,
    dead_time_s: f64,
    time_constant_s: f64,
    dead_band_extend: f64,
    dead_band_retract: f64,
    hysteresis: f64,
    openings: &'a [f64],
    speeds_extend: &'a [f64],
    speeds_retract: &'a [f64],
    fit_percent: f64,
    /// None for a poor model, which has no tuned settings.
    loops: &'a [LoopMargins],
}

impl<'a> AxisCommissioning<'a> {
    fn new(Found { name, model, loops, .. }: &'a Found) -> Self {
        Self {
            axis: name,
            dead_time_s: model.dead_time,
            time_constant_s: model.time_constant,
            dead_band_extend: model.dead_band.extend,
            dead_band_retract: model.dead_band.retract,
            hysteresis: model.hysteresis,
            openings: &model.openings,
            speeds_extend: &model.speeds_extend,
            speeds_retract: &model.speeds_retract,
            fit_percent: model.fit_percent,
            loops,
        }
    }
}

impl From<ModelFileError> for Failure {
    fn from(error: ModelFileError) -> Self {
        match error {
            ModelFileError::Write { .. } => Self::run(error),
            _ => Self::usage(error),
        }
    }
}
