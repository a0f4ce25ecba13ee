//! What the plant answers to which request: one run at a time, and each step once.
//!
//! | request | answer |
//! |---|---|
//! | reading 0 of a new run | the plant at rest |
//! | the reading after the last one | the plant takes the command and goes on by one period |
//! | the last reading once more | the same reading: its answer was lost |
//! | any other reading, or of another run | a refusal |
//!
//! A run ends when its stage says so. A stage that was killed says nothing, so a run without a request for [`SILENCE`]
//! makes room for a new one.
//!
//! Trap: a request that waited on its way may come when its run is over. So a run that has ended does not begin again.
//!
//! Everything here is without network and clock.

use std::time::{Duration, Instant};

use humantime::format_duration;
use pipeline::{
    machine::Machine,
    message::{EncoderReading, ValveCommand},
};
use plant_sim::{PlantError, PlantSim};
use thiserror::Error;

use super::{
    request::{END, Request},
    simulated,
};

/// Time without a request after which a new run may begin. A stage without an answer gives up before.
pub const SILENCE: Duration = Duration::from_secs(15);

/// Why a request is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// The stage means another plant.
    #[error(
        "found the simulated machine {found:016x}, where the plant simulates {own:016x}; allowed: equal machine files \
         and equal --set on both computers"
    )]
    Machine {
        /// What the stage means.
        found: u64,
        /// What is simulated.
        own: u64,
    },
    /// The stage means another noise.
    #[error("found seed {found}, where the plant has seed {own}; allowed: an equal --seed on both computers")]
    Seed {
        /// Seed of the group.
        found: u64,
        /// Seed of the plant.
        own: u64,
    },
    /// Another run uses the plant.
    #[error(
        "found another run in the plant, whose last request is {} old; allowed: one run at a time, and the next one \
         after its end or after {} without a request",
        format_duration(Duration::from_millis(.age.as_millis() as u64)), format_duration(SILENCE)
    )]
    Busy {
        /// Age of the last request of that run.
        age: Duration,
    },
    /// The plant knows nothing of the run.
    #[error(
        "found reading {reading} of a run that is not in the plant; allowed: a new run, from reading 0 on (the plant \
         was started again, or the run has ended)"
    )]
    NoRun {
        /// Number of the reading.
        reading: u64,
    },
    /// The reading is neither the last one nor the next one.
    #[error("found a request for reading {reading}; allowed: {last}, the last one, or the next one")]
    Order {
        /// Number of the reading.
        reading: u64,
        /// Number of the last reading.
        last: u64,
    },
}

/// A run of a stage.
struct Run {
    number: u64,
    plant: PlantSim,
    last: EncoderReading,
    asked: Instant,
}

/// The plant, and the run that uses it.
pub struct Host {
    machine: u64,
    seed: u64,
    period: Duration,
    /// The plant at rest.
    fresh: PlantSim,
    run: Option<Run>,
    /// The run that has ended last.
    ended: Option<u64>,
}

impl Host {
    /// The plant of this machine.
    ///
    /// # Errors
    /// The machine cannot be simulated.
    pub fn new(machine: &Machine, seed: u64) -> Result<Self, PlantError> {
        let fresh = PlantSim::new(machine, seed)?;
        Ok(Self { machine: simulated(machine), seed, period: machine.timing.period, fresh, run: None, ended: None })
    }

    /// Number of the present run, and of its last reading.
    pub fn run(&self) -> Option<(u64, u64)> {
        self.run.as_ref().map(|run| (run.number, run.last.header.sequence))
    }

    /// Answers a request that comes at `now`; none for one that ends its run. `command` answers the reading before.
    ///
    /// # Errors
    /// The request is refused, and nothing has changed.
    pub fn answer(
        &mut self,
        request: &Request,
        command: &ValveCommand,
        now: Instant,
    ) -> Result<Option<EncoderReading>, Refusal> {
        self.expect_plant(request)?;
        if let Some(run) = self.run.as_mut().filter(|run| run.number == request.run) {
            if request.reading == END {
                self.end();
                return Ok(None);
            }
            return run.reading(request.reading, command, self.period, now).map(Some);
        }
        if self.ended == Some(request.run) || request.reading != 0 {
            return Err(Refusal::NoRun { reading: request.reading });
        }
        if let Some(run) = &self.run
            && now.duration_since(run.asked) < SILENCE
        {
            return Err(Refusal::Busy { age: now.duration_since(run.asked) });
        }
        self.end();
        let mut plant = self.fresh.clone();
        let last = plant.read();
        self.run = Some(Run { number: request.run, plant, last, asked: now });
        Ok(Some(last))
    }

    fn expect_plant(&self, request: &Request) -> Result<(), Refusal> {
        if request.machine != self.machine {
            return Err(Refusal::Machine { found: request.machine, own: self.machine });
        }
        if request.seed != self.seed {
            return Err(Refusal::Seed { found: request.seed, own: self.seed });
        }
        Ok(())
    }

    fn end(&mut self) {
        self.ended = self.run.take().map(|run| run.number).or(self.ended);
    }
}

impl Run {
    fn reading(
        &mut self,
        reading: u64,
        command: &ValveCommand,
        period: Duration,
        now: Instant,
    ) -> Result<EncoderReading, Refusal> {
        let last = self.last.header.sequence;
        if reading == last + 1 {
            self.plant.command(command);
            self.plant.advance(period);
            self.last = self.plant.read();
        } else if reading != last {
            return Err(Refusal::Order { reading, last });
        }
        self.asked = now;
        Ok(self.last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Asker {
        host: Host,
        now: Instant,
    }

    impl Asker {
        fn new() -> Self {
            let host = Host::new(&Machine::four_axes(&[]).unwrap(), 7).unwrap();
            Self { host, now: Instant::now() }
        }

        fn ask(&mut self, run: u64, reading: u64) -> Result<Option<EncoderReading>, Refusal> {
            let mut command = ValveCommand::default();
            command.axes[0].command = 0.5;
            let request = Request { run, reading, seed: 7, machine: self.host.machine };
            self.host.answer(&request, &command, self.now)
        }
    }

    #[test]
    fn a_repeated_request_gets_the_same_answer_and_every_step_is_made_once() {
        let (mut once, mut twice) = (Asker::new(), Asker::new());
        for reading in 0..50 {
            let answer = once.ask(1, reading).unwrap().unwrap();
            assert_eq!(answer.header.sequence, reading);
            assert_eq!(twice.ask(1, reading), Ok(Some(answer)));
            assert_eq!(twice.ask(1, reading), Ok(Some(answer)));
        }
        assert_ne!(once.ask(1, 50).unwrap().unwrap().encoders, twice.ask(1, 49).unwrap().unwrap().encoders);
        for reading in [0, 48, 51, u64::MAX - 1] {
            assert_eq!(twice.ask(1, reading), Err(Refusal::Order { reading, last: 49 }));
        }
    }

    #[test]
    fn one_run_at_a_time_and_each_begins_with_the_plant_at_rest() {
        let mut asker = Asker::new();
        let first: Vec<_> = (0..5).map(|reading| asker.ask(1, reading).unwrap()).collect();
        asker.now += SILENCE - Duration::from_millis(10);
        let refusal = asker.ask(2, 0).unwrap_err();
        assert_eq!(refusal, Refusal::Busy { age: SILENCE - Duration::from_millis(10) });
        assert!(refusal.to_string().contains("whose last request is 14s 990ms old"), "{refusal}");
        // Another run ends nothing, and the refusal was no request of the first one.
        assert_eq!(asker.ask(2, END), Err(Refusal::NoRun { reading: END }));
        asker.now += Duration::from_millis(10);
        let second: Vec<_> = (0..5).map(|reading| asker.ask(2, reading).unwrap()).collect();
        assert_eq!(first, second);
        assert_eq!(asker.ask(1, 5), Err(Refusal::NoRun { reading: 5 }));
        assert_eq!(asker.ask(2, END), Ok(None));
        // A request that comes late does not begin a run that is over.
        assert_eq!(asker.ask(2, 0), Err(Refusal::NoRun { reading: 0 }));
        assert_eq!(asker.ask(3, 0), Ok(first[0]));
    }

    #[test]
    fn another_machine_or_seed_is_refused_with_both_named() {
        let mut asker = Asker::new();
        let own = asker.host.machine;
        let mut ask = |seed: u64, machine: u64| {
            let request = Request { run: 1, reading: 0, seed, machine };
            asker.host.answer(&request, &ValveCommand::default(), asker.now).unwrap_err().to_string()
        };
        assert!(ask(8, own).starts_with("found seed 8, where the plant has seed 7; "));
        let text = ask(7, 1);
        assert!(text.contains(&format!("machine {:016x}, where the plant simulates {own:016x}; ", 1)), "{text}");
        assert_eq!(asker.host.run(), None);
    }
}
