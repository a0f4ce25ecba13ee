//! `hydraxis simulate`: the loop of lock-step in one process, one core called after the other.

use std::time::{Duration, Instant};

use control_proc::Controller;
use ident_proc::Identifiers;
use indicatif::ProgressBar;
use pipeline::{
    latency::LatencyRecorder,
    machine::{Machine, Source, samples_of},
    message::{CoefficientSnapshot, StageHealth, ValveCommand},
    stage::{StageKind, monotonic_ns},
};
use plant_sim::PlantSim;
use sensor_proc::source::{Acquisition, Replay, is_implausible};

use crate::{
    check, cli,
    failure::Failure,
    output::Output,
    report::{LastMessages, Report},
    stage,
    table::progress,
};

/// How long a simulated machine runs when nobody says.
pub const DEFAULT_DURATION: Duration = Duration::from_secs(20);

/// Runs the command.
pub fn run(arguments: &cli::Simulate) -> Result<(), Failure> {
    let machine = stage::load(&arguments.machine)?;
    if let Some(kind) = StageKind::ALL.into_iter().find(|kind| machine.stage(*kind).command.is_some()) {
        return Err(Failure::Usage(format!(
            "stage.{}.command: another program cannot run inside `simulate`; use `run --lockstep`",
            kind.name()
        )));
    }
    let rows = check::deep(&machine)?;
    let ticks = ticks(&machine, rows, arguments.duration)?;
    let output = Output::open(arguments.json.as_deref())?;
    let started = Instant::now();
    let last = simulate(&machine, arguments.seed, ticks)?;
    let report = Report::new(&machine, &last, started.elapsed().as_secs_f64());
    output.write(|| report.tables(&machine), &report)
}

/// Ticks of a run: as asked, no more than the rows of the recording if one is replayed.
pub fn ticks(machine: &Machine, rows: Option<u64>, duration: Option<Duration>) -> Result<u64, Failure> {
    let asked = duration.map(|duration| samples_of(duration, machine.timing.period) as u64);
    if asked == Some(0) {
        return Err(Failure::Usage("--duration: found less than one period of the machine file".to_owned()));
    }
    Ok(match rows {
        Some(rows) => asked.unwrap_or(rows).min(rows),
        None => asked.unwrap_or(samples_of(DEFAULT_DURATION, machine.timing.period) as u64),
    })
}

/// What makes samples and takes commands.
enum Ends {
    Live(Box<PlantSim>, Acquisition),
    Recorded(Replay),
}

/// The work of each stage, timed like the processes time theirs.
struct Timing {
    work: [LatencyRecorder; 4],
    end_to_end: LatencyRecorder,
    health: [Option<StageHealth>; 4],
}

impl Timing {
    fn new() -> Self {
        Self {
            work: std::array::from_fn(|_| LatencyRecorder::new()),
            end_to_end: LatencyRecorder::new(),
            health: [None; 4],
        }
    }

    fn timed<T>(&mut self, kind: StageKind, work: impl FnOnce() -> T) -> T {
        let started = monotonic_ns();
        let result = work();
        self.work[kind as usize].record(monotonic_ns() - started);
        self.health[kind as usize].get_or_insert_default().samples += 1;
        result
    }

    fn into_health(mut self) -> [Option<StageHealth>; 4] {
        for (health, work) in self.health.iter_mut().zip(&self.work) {
            if let Some(health) = health {
                health.work = work.percentiles();
            }
        }
        if let Some(control) = &mut self.health[StageKind::ControlProc as usize] {
            control.end_to_end = self.end_to_end.percentiles();
        }
        self.health
    }
}

/// The loop: `ticks` of all stages in the order of the data.
fn simulate(machine: &Machine, seed: u64, ticks: u64) -> Result<LastMessages, Failure> {
    let mut ends = match &machine.source {
        Source::Sim => {
            Ends::Live(Box::new(PlantSim::new(machine, seed).map_err(Failure::usage)?), Acquisition::new(machine))
        }
        Source::Replay(file) => Ends::Recorded(Replay::new(machine, file).map_err(Failure::usage)?),
    };
    let mut identifiers = Identifiers::new(machine);
    let mut controller = Controller::new(machine).map_err(Failure::usage)?;
    controller.arm();
    let mut timing = Timing::new();
    let (mut command, mut snapshot): (Option<ValveCommand>, Option<CoefficientSnapshot>) = (None, None);
    let progress: ProgressBar = progress(ticks, "ticks");

    for tick in 0..ticks {
        let started = monotonic_ns();
        let (sample, recorded) = match &mut ends {
            Ends::Live(plant, acquisition) => {
                let reading = timing.timed(StageKind::PlantSim, || {
                    if let Some(command) = &command {
                        plant.command(command);
                        plant.advance(machine.timing.period);
                    }
                    plant.read()
                });
                (timing.timed(StageKind::SensorProc, || acquisition.update(tick, Some(&reading))), None)
            }
            Ends::Recorded(replay) => {
                let row = timing.timed(StageKind::SensorProc, || replay.update(tick));
                let Some((sample, command)) = row else { break };
                (sample, Some(command))
            }
        };
        if is_implausible(&sample)
            && let Some(health) = &mut timing.health[StageKind::SensorProc as usize]
        {
            health.implausible += 1;
        }
        let before = snapshot;
        let next = snapshot.get_or_insert_default();
        timing.timed(StageKind::IdentProc, || identifiers.update(&sample, command.as_ref(), next));
        command = Some(match recorded {
            Some(recorded) => recorded,
            None => {
                let made = timing.timed(StageKind::ControlProc, || controller.update(&sample, before.as_ref(), None));
                timing.end_to_end.record(monotonic_ns() - started);
                made
            }
        });
        if tick % 1024 == 0 {
            progress.set_position(tick);
        }
    }
    progress.finish_and_clear();
    Ok(LastMessages { command, snapshot, health: timing.into_health() })
}
