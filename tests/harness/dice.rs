//! Random order, kind and time of what is done to a group. The seed and every step are printed.

use std::time::{Duration, Instant};

use pipeline::stage::StageKind;
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

use super::variable;

pub struct Dice {
    random: Pcg64,
    started: Instant,
    test: &'static str,
}

impl Dice {
    /// With the seed of this environment variable, 1 without it. `told` is printed beside the seed.
    pub fn new(test: &'static str, variable_of_seed: &str, told: &str) -> Self {
        let seed = variable(variable_of_seed, 1);
        println!("{test}: {variable_of_seed}={seed} {told}");
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

    /// One of these.
    pub fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len() as u64) as usize]
    }

    pub fn stage(&mut self) -> StageKind {
        self.one_of(&StageKind::ALL)
    }

    /// A random time between two durations. Each order of magnitude is equally likely.
    pub fn duration(&mut self, shortest: Duration, longest: Duration) -> Duration {
        let part = self.below(1001) as f64 / 1000.0;
        shortest.mul_f64((longest.as_secs_f64() / shortest.as_secs_f64()).powf(part))
    }

    /// Prints the next step with its time.
    pub fn note(&self, what: &str) {
        println!("{} {:8.3} s: {what}", self.test, self.started.elapsed().as_secs_f64());
    }

    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }
}
