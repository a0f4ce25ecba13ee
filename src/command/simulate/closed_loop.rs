//! The loop of a lock-step run in one process: one core is called after the other.
//!
//! ```text
//! plant -> sensor -> identifier (command of the tick before) -> controller (snapshot of the tick before) -> plant
//! ```

use std::ops::ControlFlow;

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    latency::LatencyRecorder,
    machine::{Machine, Source},
    message::{CoefficientSnapshot, EncoderSample, StageHealth, ValveCommand},
    stage::{StageKind, monotonic_ns},
};
use plant_sim::PlantSim;
use sensor_proc::{Acquisition, Replay, is_implausible};

use crate::{
    arguments::simulated_only, failure::Failure, recording::rows::read_recordings, report::control_loop::LastMessages,
};

/// One tick, after the controller.
pub struct Tick<'a> {
    /// Its number, from 0.
    pub number: u64,
    /// The plant before the command acts on it; none when a recording is replayed.
    pub plant: Option<&'a PlantSim>,
    /// The command that was computed from the sample of this tick.
    pub command: &'a ValveCommand,
    /// Ticks along the path: that at which the motion of the teeth has begun, and the present one.
    pub way: Option<(f64, f64)>,
}

/// Runs `ticks` ticks, or fewer where `look` breaks off, and shows each of them to `look`. Returns the last messages of
/// the loop.
///
/// # Errors
/// The machine cannot be simulated or controlled, or `look` fails.
pub fn run(
    machine: &Machine,
    seed: u64,
    ticks: u64,
    mut look: impl FnMut(&Tick<'_>) -> Result<ControlFlow<()>, Failure>,
) -> Result<LastMessages, Failure> {
    let mut ends = Ends::new(machine, seed)?;
    let mut identifiers = Identifiers::new(machine);
    let mut controller = Controller::new(machine).map_err(Failure::usage)?;
    controller.arm();
    let mut times = StageTimes::new();
    let (mut command, mut snapshot): (Option<ValveCommand>, Option<CoefficientSnapshot>) = (None, None);

    for tick in 0..ticks {
        let started = monotonic_ns();
        let Some((sample, recorded)) = ends.sample(machine, tick, command.as_ref(), &mut times) else { break };
        times.count_implausible(&sample);
        let before = snapshot;
        let next = snapshot.get_or_insert_default();
        times.timed(StageKind::IdentProc, || identifiers.update(&sample, command.as_ref(), next));
        let applied = match recorded {
            Some(recorded) => recorded,
            None => {
                let made = times.timed(StageKind::ControlProc, || controller.update(&sample, before.as_ref(), None));
                times.end_to_end.record(monotonic_ns() - started);
                made
            }
        };
        let flow = look(&Tick { number: tick, plant: ends.plant(), command: &applied, way: controller.on_the_way() })?;
        command = Some(applied);
        if flow.is_break() {
            break;
        }
    }
    Ok(LastMessages { command, snapshot, health: times.into_health(), ..LastMessages::default() })
}

/// The source of samples and the sink of commands.
enum Ends {
    Live(Box<PlantSim>, Acquisition),
    Recorded(Replay),
}

impl Ends {
    fn new(machine: &Machine, seed: u64) -> Result<Self, Failure> {
        match &machine.source {
            Source::Sim => {
                let plant = PlantSim::new(machine, seed).map_err(Failure::usage)?;
                Ok(Self::Live(Box::new(plant), Acquisition::new(machine)))
            }
            Source::Replay(file) => {
                let recordings = read_recordings(machine, file).map_err(Failure::usage)?;
                Ok(Self::Recorded(Replay::new(machine, recordings)))
            }
            Source::External | Source::Can => Err(Failure::usage(simulated_only(machine))),
        }
    }

    /// The plant, if it is simulated.
    fn plant(&self) -> Option<&PlantSim> {
        match self {
            Self::Live(plant, _) => Some(&**plant),
            Self::Recorded(_) => None,
        }
    }

    /// The sample of a tick after one period under `command`; with the recorded command when a recording is replayed.
    /// None after the last row of the recording.
    fn sample(
        &mut self,
        machine: &Machine,
        tick: u64,
        command: Option<&ValveCommand>,
        times: &mut StageTimes,
    ) -> Option<(EncoderSample, Option<ValveCommand>)> {
        match self {
            Self::Live(plant, acquisition) => {
                let reading = times.timed(StageKind::PlantSim, || {
                    if let Some(command) = command {
                        plant.command(command);
                        plant.advance(machine.timing.period);
                    }
                    plant.read()
                });
                Some((times.timed(StageKind::SensorProc, || acquisition.update(tick, Some(&reading))), None))
            }
            Self::Recorded(replay) => {
                let (sample, command) = times.timed(StageKind::SensorProc, || replay.update(tick))?;
                Some((sample, Some(command)))
            }
        }
    }
}

/// The work of each stage, timed as the processes time theirs.
struct StageTimes {
    work: [LatencyRecorder; 4],
    end_to_end: LatencyRecorder,
    health: [Option<StageHealth>; 4],
}

impl StageTimes {
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

    fn count_implausible(&mut self, sample: &EncoderSample) {
        if is_implausible(sample)
            && let Some(health) = &mut self.health[StageKind::SensorProc as usize]
        {
            health.implausible += 1;
        }
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
