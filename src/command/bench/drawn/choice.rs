//! Which machines of a drawn set are driven.
//!
//! The machines with even numbers are for design: whoever changes a controller may look at them. Those with odd numbers
//! are for judging it. Trap: a machine that was looked at judges nothing any more.

use clap::ValueEnum;

use super::rig::Rig;

/// A half of the drawn machines or of the generated records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Half {
    /// even numbers, which may be looked at during design
    Design,
    /// odd numbers, which judge
    Judge,
}

impl Half {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        if self == Self::Design { "design" } else { "judge" }
    }

    /// Whether this number belongs to it.
    pub fn has(self, number: u64) -> bool {
        number.is_multiple_of(2) == (self == Self::Design)
    }
}

/// Which machines.
pub struct Choice {
    /// Machines 0 to this number less one.
    pub count: u64,
    /// Seed of the set.
    pub seed: u64,
    /// Only one half.
    pub half: Option<Half>,
    /// Only the machines with these numbers; all when there are none.
    pub only: Vec<u64>,
}

impl Choice {
    /// The machines.
    pub fn rigs(&self) -> Vec<Rig> {
        let is_chosen = |number: &u64| {
            self.half.is_none_or(|half| half.has(*number)) && (self.only.is_empty() || self.only.contains(number))
        };
        (0..self.count).filter(is_chosen).map(|number| Rig::draw(self.seed, number)).collect()
    }
}
