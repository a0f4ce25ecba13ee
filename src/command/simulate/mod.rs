//! `hydraxis simulate`: the machine in one process, in closed loop or under given commands.
//!
//! The loop here calls the cores of the stages one after the other. It has no real time, no channel and no other
//! process.

mod arguments;
pub mod closed_loop;
mod commands;
mod open_loop;
mod recorder;

use std::{
    ops::ControlFlow,
    time::{Duration, Instant},
};

use humantime::format_duration;
use pipeline::{
    machine::{Machine, Source, samples_of},
    stage::{Clock, StageKind},
};

use super::check;
use crate::{
    arguments::{load, simulated_only},
    failure::Failure,
    report::teeth::Teeth,
    report::{
        control_loop::LoopReport,
        output::{Output, is_stdout},
        table::progress,
    },
};
pub use arguments::SimulateArguments;
use recorder::Recorder;

/// Length of a run of a simulated machine without `--duration`.
pub const DEFAULT_DURATION: Duration = Duration::from_secs(20);

/// Runs the command.
pub fn run(arguments: &SimulateArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?.into_twin();
    if let Some(kind) = StageKind::ALL.into_iter().find(|kind| machine.stage(*kind).command.is_some()) {
        return Err(Failure::usage(format!(
            "{}: another program cannot run inside `simulate`; use `run --lockstep`",
            machine.command_key(kind)
        )));
    }
    let is_open = arguments.open_loop.is_some() || !machine.scenario.commands.is_empty();
    expect_compatible(arguments, &machine, is_open)?;
    let rows = check::deep(&machine)?;
    let warnings = if is_open {
        check::warnings_of_plant(&machine)
    } else {
        check::expect_possible(&machine)?;
        // A study may want to see an unstable loop.
        [check::warnings(&machine), check::unstable(&machine)].concat()
    };
    for warning in warnings {
        eprintln!("warning: {warning}");
    }
    if is_open {
        return open_loop::run(&machine, arguments);
    }
    let ticks = ticks(&machine, rows, arguments.duration)?;
    let mut output = Output::open(arguments.json.as_deref())?;
    if standard_outputs(arguments) > 0 {
        output = output.without_tables();
    }
    let duration = machine.timing.period.as_secs_f64() * ticks as f64;
    let mut recorder = Recorder::for_closed_loop(&machine, &arguments.recording, duration)?;
    let mut teeth = Teeth::of(&machine).map_err(Failure::usage)?;
    let started = Instant::now();
    let progress = progress(ticks, "ticks");
    let last = closed_loop::run(&machine, arguments.seed, ticks, |tick| {
        if tick.number % 1024 == 0 {
            progress.set_position(tick.number);
        }
        if let (Some(teeth), Some(plant)) = (&mut teeth, tick.plant) {
            teeth.observe(tick.way, plant, &tick.command.axes);
        }
        match (&mut recorder, tick.plant) {
            (Some(recorder), Some(plant)) => {
                recorder.row(machine.timing.period.as_nanos() as f64 * tick.number as f64 / 1e9, plant, tick.command)
            }
            _ => Ok(()),
        }
        .map(ControlFlow::Continue)
    })?;
    progress.finish_and_clear();
    let mut report = LoopReport::new(&machine, &last, Clock::LockStep, started.elapsed().as_secs_f64());
    report.teeth = teeth.map(|teeth| teeth.figures());
    recorder.map_or(Ok(()), Recorder::finish)?;
    output.write(|| report.tables(&machine), &report)?;
    report.verdict().map_err(Failure::run)
}

/// Refuses options that do not go together, or not with this machine.
fn expect_compatible(arguments: &SimulateArguments, machine: &Machine, is_open: bool) -> Result<(), Failure> {
    let recording = &arguments.recording;
    let refuse = |text: &str| Err(Failure::usage(text));
    if machine.source.is_real() {
        return refuse(&simulated_only(machine));
    }
    if machine.source != Source::Sim && (is_open || recording.trajectory.is_some() || recording.plot.is_some()) {
        let allowed = simulated_only(machine);
        return refuse(&format!("{allowed} for an open loop, --trajectory and --plot, which show a simulated plant"));
    }
    if is_open && arguments.json.is_some() {
        return refuse("--json: found an open loop, which has no figures; allowed: --trajectory and --plot");
    }
    if !is_open && recording.trajectory.is_none() && recording.plot.is_none() && !recording.axes.is_empty() {
        return refuse("--axis: found nothing to restrict; allowed: with --trajectory or --plot");
    }
    if standard_outputs(arguments) > 1 {
        return refuse("-: found for several of --json, --trajectory and --plot; allowed: one on standard output");
    }
    Ok(())
}

/// Number of outputs that go to standard output.
fn standard_outputs(arguments: &SimulateArguments) -> usize {
    let outputs = [&arguments.json, &arguments.recording.trajectory, &arguments.recording.plot];
    outputs.into_iter().flatten().filter(|path| is_stdout(path)).count()
}

/// Ticks of a run of `duration`; at most the rows of the recording if one is replayed.
///
/// # Errors
/// The duration is less than one period.
pub fn ticks(machine: &Machine, rows: Option<u64>, duration: Option<Duration>) -> Result<u64, Failure> {
    let asked = duration.map(|duration| samples_of(duration, machine.timing.period) as u64);
    if asked == Some(0) {
        return Err(Failure::usage(format!(
            "--duration: found {}; allowed: {} or more, one period of the machine",
            format_duration(duration.unwrap_or_default()),
            format_duration(machine.timing.period)
        )));
    }
    Ok(match rows {
        Some(rows) => asked.unwrap_or(rows).min(rows),
        None => asked.unwrap_or(samples_of(DEFAULT_DURATION, machine.timing.period) as u64),
    })
}
