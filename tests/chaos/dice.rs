//! Random order, kind and time of the faults. The seed and every fault are printed.

use std::time::{Duration, Instant};

use pipeline::stage::StageKind;
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

use crate::harness::variable;

pub struct Dice {
    random: Pcg64,
    started: Instant,
    test: &'static str,
}

impl Dice {
    pub fn new(test: &'static str, kills: u64) -> Self {
        let seed = variable("HYDRAXIS_CHAOS_SEED", 1);
        println!("{test}: HYDRAXIS_CHAOS_SEED={seed} HYDRAXIS_CHAOS_KILLS={kills}");
        Self { random: Pcg64::seed_from_u64(seed), started: Instant::now(), test }
    }

    /// A random number from 0 to `end` - 1.
    pub fn below(&mut self, end: u64) -> u64 {
        self.random.next_u64() % end
    }

    /// True once in so many times.
    pub fn once_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }

    pub fn stage(&mut self) -> StageKind {
        StageKind::ALL[self.below(4) as usize]
    }

    /// A random time between two durations. Each order of magnitude is equally likely.
    pub fn duration(&mut self, shortest: Duration, longest: Duration) -> Duration {
        let part = self.below(1001) as f64 / 1000.0;
        shortest.mul_f64((longest.as_secs_f64() / shortest.as_secs_f64()).powf(part))
    }

    /// Prints the next fault with its time.
    pub fn note(&self, what: &str) {
        println!("{} {:8.3} s: {what}", self.test, self.started.elapsed().as_secs_f64());
    }

    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }
}
