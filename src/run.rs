//! `hydraxis run`: one process per stage, started, watched and reported.

use std::{
    io::IsTerminal,
    sync::{Arc, atomic::Ordering},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, Prefix, remove_leftovers},
    machine::{Machine, Source},
    stage::{Clock, Options, StageKind},
};

use crate::{
    check, cli, failure::Failure, live::Monitor, output::Output, report::Report, simulate::ticks, stage,
    supervisor::Supervisor,
};

/// How often the group is looked at.
const POLL: Duration = Duration::from_millis(10);
/// How long a stage may take to open its channels.
const START_PATIENCE: Duration = Duration::from_secs(10);
/// How long the others may take to end after the last tick.
const END_PATIENCE: Duration = Duration::from_secs(2);
/// How long nothing may happen before the run is given up, unless the machine's period is of that order itself.
const STALL_PATIENCE: Duration = Duration::from_secs(10);
/// Periods without a tick that are a stall.
const STALL_PERIODS: u32 = 3;

/// Runs the command.
pub fn run(arguments: &cli::Run) -> Result<(), Failure> {
    let machine = stage::load(&arguments.machine)?;
    let scenario = &machine.scenario;
    if !scenario.commands.is_empty() {
        return Err(Failure::Usage(format!(
            "scenario \"{0}\" is an open loop, without a controller; type: hydraxis simulate --scenario {0}",
            scenario.name
        )));
    }
    let rows = check::deep(&machine)?;
    let output = Output::open(arguments.json.as_deref())?;
    let is_simulated = machine.source == Source::Sim;
    let options = Options {
        prefix: arguments.prefix.clone().unwrap_or_else(Prefix::of_this_process),
        clock: if arguments.lockstep { Clock::LockStep } else { Clock::RealTime },
        ticks: Some(ticks(&machine, rows, arguments.duration)?),
        seed: arguments.seed,
        // Only a simulated machine moves without being asked to.
        arm: is_simulated && !arguments.off,
        stop: stage::stop_flag()?,
        reset: Arc::default(),
    };
    // What a killed run of this name has left; a living one is left alone.
    remove_leftovers(&options.prefix).map_err(Failure::run)?;
    let scenario = if is_simulated { format!(", scenario \"{}\"", scenario.name) } else { String::new() };
    eprintln!("{}{scenario}: group \"{}\", Ctrl-C ends it", machine.name, options.prefix);
    let result = group(&machine, arguments, &options);
    // A client that is still attached keeps the files; the next run of this name removes them.
    let _ = remove_leftovers(&options.prefix);
    let report = result?;
    output.write(|| report.tables(&machine), &report)
}

/// The stages of a run: those that wait for input, and the one that all wait for, which is started last.
fn stages(machine: &Machine, clock: Clock) -> (Vec<StageKind>, StageKind) {
    use StageKind::{ControlProc, IdentProc, PlantSim, SensorProc};
    match (&machine.source, clock) {
        (Source::Replay(_), _) => (vec![IdentProc], SensorProc),
        (Source::Sim, Clock::LockStep) => (vec![SensorProc, IdentProc, ControlProc], PlantSim),
        (Source::Sim, Clock::RealTime) => (vec![PlantSim, IdentProc, ControlProc], SensorProc),
    }
}

/// Everything from the first process to the last message.
fn group(machine: &Machine, arguments: &cli::Run, options: &Options) -> Result<Report, Failure> {
    let group = Group::join(&options.prefix, "supervisor").map_err(Failure::run)?;
    let mut monitor = Monitor::new(&group).map_err(Failure::run)?;
    let mut supervisor = Supervisor::default();
    let start = |supervisor: &mut Supervisor, kind| {
        supervisor.start(kind, stage::command(kind, machine, &arguments.machine, options)?)
    };
    let (followers, head) = stages(machine, options.clock);
    for kind in &followers {
        start(&mut supervisor, *kind)?;
    }
    for kind in &followers {
        await_ready(*kind, machine, &mut monitor, &mut supervisor, options)?;
    }
    let started = Instant::now();
    if !options.stop.load(Ordering::Relaxed) {
        start(&mut supervisor, head)?;
    }
    watch(machine, head, &mut monitor, &mut supervisor, options)?;
    let wall_s = started.elapsed().as_secs_f64();
    supervisor.stop();
    monitor.poll().map_err(Failure::run)?;
    // Asked to end, a stage that fails to is a failure of the run as well.
    supervisor.failed().map_or(Ok(()), Err)?;
    Ok(Report::new(machine, &monitor.into_last(), options.clock, wall_s))
}

/// Waits for the heartbeat of a stage. Another program in its place may have none: it gets no more than its time.
fn await_ready(
    kind: StageKind,
    machine: &Machine,
    monitor: &mut Monitor,
    supervisor: &mut Supervisor,
    options: &Options,
) -> Result<(), Failure> {
    let foreign = machine.stage(kind).command.is_some();
    let until = Instant::now() + if foreign { START_PATIENCE / 10 } else { START_PATIENCE };
    while !monitor.is_ready(kind) && !options.stop.load(Ordering::Relaxed) {
        monitor.poll().map_err(Failure::run)?;
        supervisor.failed().map_or(Ok(()), Err)?;
        if Instant::now() > until {
            if foreign {
                break;
            }
            return Err(Failure::Run(format!("{}: no heartbeat within {START_PATIENCE:?}", kind.name())));
        }
        sleep(POLL);
    }
    Ok(())
}

/// Reads along until the last tick, a signal, or a failure.
fn watch(
    machine: &Machine,
    head: StageKind,
    monitor: &mut Monitor,
    supervisor: &mut Supervisor,
    options: &Options,
) -> Result<(), Failure> {
    let show = std::io::stderr().is_terminal();
    let patience = stall_patience(machine.timing.period);
    let mut end = None;
    while supervisor.any_running() && !options.stop.load(Ordering::Relaxed) {
        sleep(POLL);
        monitor.poll().map_err(Failure::run)?;
        supervisor.failed().map_or(Ok(()), Err)?;
        if let Some(line) = monitor.line(machine).filter(|_| show) {
            eprintln!("{line}");
        }
        // The last tick is out when its source has ended; the others follow by themselves.
        if !supervisor.is_running(head) {
            let end = *end.get_or_insert_with(|| Instant::now() + END_PATIENCE);
            if Instant::now() > end {
                break;
            }
        }
        if monitor.stalled_for() > patience {
            return Err(Failure::Run(format!(
                "no stage has worked for {patience:?}; the last ticks are: {}",
                monitor.ticks()
            )));
        }
    }
    Ok(())
}

/// How long no stage may work a tick.
fn stall_patience(period: Duration) -> Duration {
    STALL_PATIENCE.max(period * STALL_PERIODS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_machine_is_not_a_stalled_one() {
        assert_eq!(stall_patience(Duration::from_millis(10)), Duration::from_secs(10));
        assert!(stall_patience(Duration::from_secs(10)) > 2 * Duration::from_secs(10));
    }
}
