//! `hydraxis commission`: a bounded experiment with every axis, and a model file of what it found.

mod arguments;
mod file;
mod live;
mod simulated;

use std::path::Path;

use control_proc::{
    commission::{ExperimentOptions, Phase},
    tuning::Baseline,
};
use pipeline::{
    channel::remove_leftovers,
    hammerstein::MAX_DELAY,
    machine::{Axis, Commissioned, Control, Machine, Source},
};
use serde::Serialize;

use super::check;
use crate::{
    arguments::{axes, load},
    failure::Failure,
    group::signals::stop_flag,
    report::{
        output::{Output, is_stdout},
        table::{percent, progress, table},
    },
};
pub use arguments::CommissionArguments;
use file::ModelFile;
use live::commission_live;
pub use simulated::commission_simulated;

/// Fit below which a model is not to be trusted, percent.
const POOR_FIT: f64 = 80.0;
/// Parts of the tested openings at which the table shows the curve.
const SHOWN: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// Runs the command.
pub fn run(arguments: &CommissionArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?;
    if arguments.prefix.is_none() && machine.source != Source::Sim {
        return Err(Failure::Usage(
            "source.kind: found \"replay\"; allowed: \"sim\": a record cannot be experimented with".to_owned(),
        ));
    }
    let axes = axes(&machine, &arguments.axes)?;
    if let Some(prefix) = arguments.prefix.as_ref().filter(|_| !arguments.enable) {
        return Err(Failure::Usage(format!(
            "--prefix: found \"{prefix}\", a running group, without --enable; allowed: with it: the axes are put off, and \
             one after another is moved"
        )));
    }
    check::deep(&machine)?;
    let file = ModelFile::new(&arguments.out, arguments.force)?;
    let output = Output::open(arguments.json.as_deref())?;
    let shows_tables = !arguments.json.as_deref().is_some_and(is_stdout);
    let options = ExperimentOptions {
        travel: arguments.travel,
        speed: arguments.speed,
        duration: arguments.duration,
        seed: arguments.seed,
    };
    let bar = progress(1000 * axes.len() as u64, "");
    let show = |axis: usize, phase: Phase, part: f64| {
        let done = axes.iter().take_while(|other| **other != axis).count();
        let position = 1000 * done as u64 + (1000.0 * part) as u64;
        if position != bar.position() {
            bar.set_position(position);
            bar.set_message(format!("{}: {}", machine.axes[axis].name, phase.name()));
        }
    };
    let models = match &arguments.prefix {
        None => commission_simulated(&machine, &axes, arguments.seed, &options, show),
        Some(prefix) => {
            let found = commission_live(&machine, &axes, prefix, stop_flag()?, &options, show);
            // The last to leave a group that has ended leaves nothing behind.
            let _ = remove_leftovers(prefix);
            found
        }
    };
    bar.finish_and_clear();
    let found: Vec<(String, Commissioned)> =
        axes.iter().map(|axis| machine.axes[*axis].name.clone()).zip(models?).collect();
    let settings: Vec<_> = axes.iter().zip(&found).map(|(axis, (_, model))| tuned(&machine, *axis, model)).collect();
    let all = found.iter().zip(settings).map(|((name, model), control)| (name.as_str(), model, control));
    file.write(&file::text(&machine.name, all))?;
    for (name, model) in found.iter().filter(|(_, model)| is_poor(model)) {
        eprintln!(
            "axis.{name}: found a fit of {}; allowed: {POOR_FIT} % and more: do not control by this model, and look at \
             what the axis does",
            percent(model.fit_percent)
        );
    }
    let figures: Vec<Found> = found.iter().map(|(axis, model)| Found::new(axis, model)).collect();
    output.write(|| tables(&found, &arguments.out), &figures)?;
    if shows_tables {
        eprintln!("{}", next(arguments));
    }
    Ok(())
}

/// The settings of an axis with this model; none with a poor one.
fn tuned(machine: &Machine, index: usize, model: &Commissioned) -> Option<Control> {
    if is_poor(model) {
        return None;
    }
    let period = machine.timing.period.as_secs_f64();
    let axis = Axis { commissioned: Some(model.clone()), ..machine.axes[index].clone() };
    // Feed-forward looks ahead no further than the longest preview.
    let is_near = model.dead_time + model.time_constant <= MAX_DELAY as f64 * period;
    let baseline = if is_near { Baseline::Feedforward } else { Baseline::DeadBand };
    baseline.tuned(index, &axis, period)
}

fn is_poor(model: &Commissioned) -> bool {
    model.fit_percent.is_nan() || model.fit_percent < POOR_FIT
}

/// What to type next.
fn next(arguments: &CommissionArguments) -> String {
    let machine = arguments.machine.bare.machine.iter().map(|machine| format!(" {}", machine.display()));
    format!("next: hydraxis run{} --model {}", machine.collect::<String>(), arguments.out.display())
}

/// What was found, for people.
fn tables(found: &[(String, Commissioned)], out: &Path) -> String {
    let row = |(name, model): &(String, Commissioned)| {
        let milli = |seconds: f64| format!("{:.0} ms", 1e3 * seconds);
        vec![
            name.clone(),
            milli(model.dead_time),
            milli(model.time_constant),
            format!("{:.4}", model.dead_band.extend),
            format!("{:.4}", model.dead_band.retract),
            percent(model.fit_percent),
        ]
    };
    let header = ["axis", "dead time", "time constant", "dead band extending", "retracting", "fit 0.5 s ahead"];
    let figures = table(&header, found.iter().map(row).collect());
    let curve = |name: &str, model: &Commissioned, sign: f64| {
        let span = model.openings.last().copied().unwrap_or_default();
        let mut cells = vec![name.to_owned()];
        cells.extend(SHOWN.iter().map(|part| {
            let beyond = if sign > 0.0 { model.dead_band.extend } else { model.dead_band.retract };
            let command = sign * (beyond + part * span);
            format!("{command:+.3}: {:+.4} m/s", model.speed(command))
        }));
        cells
    };
    let curves = found.iter().flat_map(|(name, model)| [1.0, -1.0].map(|sign| curve(name, model, sign)));
    let header = ["command: speed", "a quarter of what was tested", "half", "three quarters", "all"];
    let curves = table(&header, curves.collect());
    format!("{figures}\n\n{curves}\n\nwritten: {}\n", out.display())
}

/// What was found of one axis, for programs.
#[derive(Serialize)]
struct Found<'a> {
    axis: &'a str,
    dead_time_s: f64,
    time_constant_s: f64,
    dead_band_extend: f64,
    dead_band_retract: f64,
    openings: &'a [f64],
    speeds_extend: &'a [f64],
    speeds_retract: &'a [f64],
    fit_percent: f64,
}

impl<'a> Found<'a> {
    fn new(axis: &'a str, model: &'a Commissioned) -> Self {
        Self {
            axis,
            dead_time_s: model.dead_time,
            time_constant_s: model.time_constant,
            dead_band_extend: model.dead_band.extend,
            dead_band_retract: model.dead_band.retract,
            openings: &model.openings,
            speeds_extend: &model.speeds_extend,
            speeds_retract: &model.speeds_retract,
            fit_percent: model.fit_percent,
        }
    }
}
