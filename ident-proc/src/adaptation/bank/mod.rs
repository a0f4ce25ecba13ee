//! The automatic estimator: several recursive estimators side by side, and one model made from all of them.
//!
//! ```text
//! theta(k) = sum_i w_i(k) theta_i(k)         sum_i w_i = 1
//! ```
//!
//! theta_i coefficients of member i, written out for the [row](crate::sample::row) of the over-parametrised form (14);
//! w_i its weight, from its own recent h-step errors. No forgetting factor, form or filter is the best on every machine
//! and at every time. A constant plant wants long memory; one that warms up wants short memory and few coefficients; a
//! load that comes on wants gains that change by direction; a valve that wears wants all coefficients of its curve; a
//! coarse encoder wants a smoothed row. The members differ in these respects:
//!
//! | family | learns | memories in horizons |
//! |---|---|---|
//! | held | nothing: the classical model | |
//! | still | nothing: y(k) = y(k-1) | |
//! | linear | a, b | 4 |
//! | increments | a, b of the increments of y, with one lag more | 4, 8 |
//! | directional | as increments, with a b for each direction | 8 |
//! | full | a and all products | 8, 20, 200 |
//! | smoothed | a and all products, with one lag more, from smoothed rows | 13, 200 |
//!
//! A memory of m horizons is the forgetting factor 1 - 1 / (m h), h horizon in samples; each memory also has a least
//! number of samples. The classical model and holding still are members, so the bank cannot stay much worse than
//! either. A sum of models is a model, so a user of the bank needs no knowledge of its members. The weighing of
//! predictors by their recent losses is known as prediction with expert advice (Cesa-Bianchi and Lugosi, Prediction,
//! Learning, and Games, 2006).
//!
//! Traps: a member whose poles would make a prediction grow e-fold over the horizon gets no weight, however small its
//! errors were. At rest every model predicts perfectly while its coefficients learn the noise, so a sample
//! [at rest](crate::sample::rest) is neither learned nor scored. An axis that moves in one direction only would forget
//! the other direction, so idle signs of the command are not forgotten; one that its training did not have is the
//! mirror image of the other.

mod collected;
mod competition;
mod family;
mod idle;
mod mirror;
mod mixture;
mod scores;
mod smoothing;

use pipeline::hammerstein::{Coefficients, MAX_LINEAR, Structure};

use self::{
    collected::Collected,
    competition::Competition,
    family::Family,
    idle::IdleSigns,
    mirror::Mirror,
    mixture::{FIXED, Mixture},
    smoothing::{SMOOTHED, Smoother},
};
use super::Learned;
use crate::{
    offline::Offline,
    sample::{RegressorRow, SlidingBuffer},
    separation::OnlineSeparation,
};

/// Half rounds of separation at the start, from the separation of the training on.
const FIRST_ROUNDS: usize = 40;
/// Names in reports of the members that learn nothing: the classical model, and y(k) = y(k-1).
const FIXED_NAMES: [&str; FIXED] = ["held", "still"];

/// The bank of one output. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Bank {
    structure: Structure,
    row_structure: Structure,
    families: Vec<Family>,
    collected: Collected,
    mirror: Mirror,
    smoother: Smoother,
    started: bool,
    mixture: Mixture,
    competition: Competition,
    separation: OnlineSeparation,
    idle: IdleSigns,
}

impl Bank {
    /// The structure of the rows that a bank for `structure` learns from, and of the model that it gives. It has one
    /// lag more, and outputs enough for an increment.
    pub fn row_structure(structure: Structure) -> Structure {
        let published = structure.published();
        Structure { na: published.na.max(2), nb: (published.nb + 1).min(MAX_LINEAR - 1), ..published }
    }

    /// For models of `structure` whose predictions count over `horizon` samples. The bank knows nothing yet.
    pub fn new(structure: Structure, horizon: usize) -> Self {
        let row = Self::row_structure(structure);
        let families = Family::all(structure, &row, horizon);
        let members = FIXED + families.iter().map(Family::len).sum::<usize>();
        let n = row.full_len();
        Self {
            structure,
            row_structure: row,
            families,
            collected: Collected::new(n, horizon),
            mirror: Mirror::new(n, horizon),
            smoother: Smoother::new(n, SMOOTHED, horizon),
            started: false,
            mixture: Mixture::new(row, members, horizon),
            competition: Competition::new(row, members, horizon),
            separation: OnlineSeparation::new(row),
            idle: IdleSigns::new(horizon),
        }
    }

    /// Takes in y(k) and the row of a training sample. In a started bank, call it after [`Self::learn`].
    pub fn collect(&mut self, y: f64, row: &RegressorRow) {
        if !self.started {
            self.smoother.update(y, row.values());
        }
        self.collected.add(y, row.values(), self.smoother.values());
    }

    /// Forgets the rows collected so far.
    pub fn restart(&mut self) {
        self.collected.restart();
    }

    /// Starts all members from the rows collected so far. `travel`: root mean square of y(k) - y(k-h) over these rows.
    /// A second start keeps the scores of the members, unless its first model was of no use.
    pub fn start(&mut self, offline: &Offline, travel: f64) {
        self.mirror.look(&self.collected.measured, &self.row_structure);
        let classical = self.mirror.complete_model(&offline.coefficients, &self.row_structure);
        Family::hold_nonlinearity(&mut self.families, self.structure, &self.row_structure, &classical.nonlinearity());
        for (rows, is_smoothed) in [(&self.collected.measured, false), (&self.collected.smoothed, true)] {
            let rows = self.mirror.complete(rows, &self.row_structure);
            let families = self.families.iter_mut().filter(|family| family.is_smoothed() == is_smoothed);
            families.for_each(|family| family.start(rows, &self.row_structure));
        }
        self.mixture.start(&offline.published);
        self.competition.start(travel);
        if self.competition.scores().is_proven() {
            // The members were compared on the last part of the training.
            self.reweigh();
        }
        self.separation.start(&classical, self.mirror.complete(&self.collected.integrated, &self.row_structure));
        for _ in 0..FIRST_ROUNDS {
            let _ = self.separation.separate(self.mixture.theta());
        }
        self.started = true;
    }

    /// Whether the bank has been started.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Takes in y(k) and the row of sample k. At rest only the forecasts advance.
    pub fn learn(&mut self, y: f64, row: &RegressorRow, resting: bool) -> Learned {
        self.competition.advance(row.driven());
        self.smoother.update(y, row.values());
        if resting {
            return Learned::NOTHING;
        }
        self.competition.score(y);
        let idle = self.idle.update(row.signs());
        let weights = self.mixture.weights();
        let mut learned = Learned { factor: weights[..FIXED].iter().sum(), bounded: false };
        let mut weights = weights[FIXED..].iter();
        for family in &mut self.families {
            let (row, target) = if family.is_smoothed() { self.smoother.values() } else { (row.values(), y) };
            learned.bounded |= family.learn(target, row, &self.row_structure, idle);
            for (factor, weight) in family.factors().iter().zip(&mut weights) {
                learned.factor += weight * factor;
            }
        }
        learned
    }

    /// Takes the row of a sample after the training into the metric of the separation. Call it before [`Self::learn`].
    pub fn weigh(&mut self, y: f64, row: &RegressorRow, resting: bool) {
        if !resting {
            self.separation.weigh(self.collected.integrate(y, row.values()));
        }
    }

    /// Advances the forecasts past a sample whose output is not used.
    pub fn pass(&mut self, row: &RegressorRow) {
        self.competition.advance(row.driven());
    }

    /// Ends every sample: makes the model of this sample, and launches forecasts when they are due. `outputs` = y(..k).
    ///
    /// The weights change only when forecasts are due, or when the model is unstable.
    pub fn settle(&mut self, outputs: &SlidingBuffer) {
        let due = self.competition.is_due();
        self.mixture.write_out(&self.families, due);
        if due {
            self.competition.launch(self.mixture.members(), outputs);
            self.mixture.weigh(self.competition.scores());
        }
        self.competition.finish_sample();
        self.mixture.mix();
        if !self.mixture.is_stable() {
            self.reweigh();
        }
    }

    /// Weighs all members by the scores so far, and sums them up.
    fn reweigh(&mut self) {
        self.mixture.write_out(&self.families, true);
        self.mixture.weigh(self.competition.scores());
        self.mixture.mix();
    }

    /// Discards the forecasts on their way and the memory of the smoother, after a gap in the samples.
    pub fn interrupt(&mut self) {
        self.competition.interrupt();
        self.smoother.interrupt();
        self.collected.interrupt();
    }

    /// Family, forgetting factor and weight of every member, the classical model first.
    pub fn members(&self) -> impl Iterator<Item = (&'static str, f64, f64)> {
        let learning =
            self.families.iter().flat_map(|family| family.factors().iter().map(|factor| (family.name(), *factor)));
        let members = FIXED_NAMES.into_iter().map(|name| (name, 1.0)).chain(learning);
        members.zip(self.mixture.weights()).map(|((name, factor), weight)| (name, factor, *weight))
    }

    /// The weight of every member, in the order of [`pipeline::message::MEMBERS`].
    pub fn weights(&self) -> &[f64] {
        self.mixture.weights()
    }

    /// The coefficients of the mixture, written out for the row.
    pub fn theta(&self) -> &[f64] {
        self.mixture.theta()
    }

    /// The model as a, b, f, g, after one more half round of separation, and the part of the products' weighted norm
    /// that the separation does not explain.
    pub fn separate(&mut self) -> (Coefficients, f64) {
        let model = self.separation.separate(self.mixture.theta());
        (model, self.separation.residual())
    }

    /// Trace of the covariance of the member with the largest weight; 0 for one that learns nothing.
    pub fn covariance_trace(&self) -> f64 {
        let most = self.mixture.heaviest();
        let mut before = FIXED;
        for family in &self.families {
            if (before..before + family.len()).contains(&most) {
                return family.member(most - before).covariance_trace();
            }
            before += family.len();
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::{machine::Machine, message::MEMBERS};

    #[test]
    fn members_have_the_names_and_memories_of_their_weights() {
        let machine = Machine::four_axes(&[]).unwrap();
        let structure = machine.axes[0].identification.structure;
        // With a long horizon each memory is a whole number of horizons, beyond its least number of samples.
        let horizon = 10_000;
        let bank = Bank::new(structure, horizon);
        assert_eq!(bank.weights().len(), MEMBERS.len());
        let found: Vec<String> = bank
            .members()
            .map(|(name, factor, _)| match factor {
                1.0 => name.to_owned(),
                _ => format!("{name} {:.0}", 1.0 / (1.0 - factor) / horizon as f64),
            })
            .collect();
        assert_eq!(found, MEMBERS);
    }
}
