//! The loop of lock-step in one process, one core called after the other.

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    latency::LatencyRecorder,
    machine::{Machine, Source},
    message::{CoefficientSnapshot, StageHealth, ValveCommand},
    stage::{StageKind, monotonic_ns},
};
use plant_sim::PlantSim;
use sensor_proc::source::{Acquisition, Replay, is_implausible};

use crate::{failure::Failure, report::control_loop::LastMessages};

/// What has come of one tick.
pub struct Tick<'a> {
    /// Its number, from 0.
    pub number: u64,
    /// As the command finds it; none when a recording plays.
    pub plant: Option<&'a PlantSim>,
    /// Made from the tick's sample.
    pub command: &'a ValveCommand,
}

/// The loop's last messages after `ticks`, every one of them shown to `look`.
pub fn run(
    machine: &Machine,
    seed: u64,
    ticks: u64,
    mut look: impl FnMut(&Tick<'_>) -> Result<(), Failure>,
) -> Result<LastMessages, Failure> {
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
        let applied = match recorded {
            Some(recorded) => recorded,
            None => {
                let made = timing.timed(StageKind::ControlProc, || controller.update(&sample, before.as_ref(), None));
                timing.end_to_end.record(monotonic_ns() - started);
                made
            }
        };
        let plant = match &ends {
            Ends::Live(plant, _) => Some(&**plant),
            Ends::Recorded(_) => None,
        };
        look(&Tick { number: tick, plant, command: &applied })?;
        command = Some(applied);
    }
    Ok(LastMessages { command, snapshot, health: timing.into_health(), ..LastMessages::default() })
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
