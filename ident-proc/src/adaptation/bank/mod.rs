//! The automatic estimator: several recursive estimators side by side, and one model out of all of them.
//!
//! ```text
//! theta(k) = sum_i w_i(k) theta_i(k)         sum_i w_i = 1
//! ```
//!
//! theta_i coefficients of member i, written out for the row of the over-parametrised form ([`crate::row`]); w_i its
//! weight, from its own recent h-step errors. No forgetting factor, no form and no filter is the best on
//! every machine and at every time: a constant plant wants long memory, one that warms up short memory and few
//! coefficients, a load that comes on gains that change by direction, a valve that wears all coefficients of its
//! curve, a coarse encoder a smoothed row. The members differ in just these:
//!
//! | family | learns | forgetting factors |
//! |---|---|---|
//! | held | nothing: the classical model | |
//! | linear | a, b | 0.99 |
//! | increments | a, b of the increments of y, one lag more | 0.99, 0.995 |
//! | directional | the same with a b for each direction | 0.995 |
//! | full | a and all products | 0.995, 0.998, 0.9998 |
//! | smoothed | the same, one lag more, from smoothed rows | 0.997, 0.9998 |
//!
//! The held model is a member, so the bank cannot stay much worse than not adapting at all; a sum of models is a
//! model, so whoever uses it needs no knowledge of the members. Weighing predictors by their recent losses is
//! prediction with expert advice (Cesa-Bianchi and Lugosi, Prediction, Learning, and Games, 2006).
//!
//! Smoothing: row and target both through 1 - p over 1 - p z^-1, p = exp(-1 / (0.12 h)). The model is the same, but the
//! noise of the encoder counts less in the fit, and what matters over the horizon more (Shook, Mohtadi and Shah,
//! Identification for long-range predictive control, IEE Proceedings D 138, 1991).
//!
//! Traps: a member whose poles would make a prediction grow e-fold over the horizon gets no weight, however
//! well it did. At rest every model predicts perfectly while its coefficients learn the noise: an axis that rests
//! teaches nothing and scores nothing ([`crate::sample::rest`]). And an axis that is moved in one direction only would forget the
//! other: what is known of a sign that is long out of use is not forgotten.

mod family;
mod scores;

use pipeline::hammerstein::{Coefficients, MAX_LINEAR, Nonlinearity, Structure, poles_within};

use crate::{
    adaptation::Learned,
    adaptation::bank::{family::Family, scores::Scores},
    least_squares::Triangle,
    quality::Forecasts,
    regression::Regression,
    sample::RegressorRow,
    sample::SlidingBuffer,
    separation::OnlineSeparation,
};

/// h-step forecasts of each member that are on their way at any time: errors any closer together say the same.
const FORECASTS: usize = 4;
/// The family that learns from smoothed rows.
const SMOOTHED: &str = "smoothed";
/// Its time constant, in horizons.
const SMOOTHING: f64 = 0.12;
/// Horizons after which a sign of the command that is not used counts as idle.
const IDLE: u64 = 40;
/// Half rounds of separation at the start, where it begins from the classical model.
const FIRST_ROUNDS: usize = 40;

/// The bank of one output; its memory is taken at construction.
#[derive(Debug, Clone)]
pub struct Bank {
    structure: Structure,
    row_structure: Structure,
    families: Vec<Family>,
    /// Rows of the training as they are, and smoothed.
    rows: Triangle,
    smoothed_rows: Triangle,
    smoothing: f64,
    /// The smoothed row and, last, the smoothed target.
    smoothed: Vec<f64>,
    is_smoothed: bool,
    started: bool,
    /// Coefficients of all members, written out for the row; the held ones first.
    members: Vec<Vec<f64>>,
    weights: Vec<f64>,
    theta: Vec<f64>,
    pole_limit: f64,
    scores: Scores,
    forecasts: Forecasts,
    stride: usize,
    /// Samples until the next forecasts are launched.
    until_launch: usize,
    slots: usize,
    slot: usize,
    /// Forecasts of each member on their way.
    launched: usize,
    separation: OnlineSeparation,
    /// Samples since a positive, and since a negative command was in the row.
    unused: [u64; 2],
    idle_after: u64,
}

impl Bank {
    /// The structure of the rows that a bank for `structure` learns from, and of the model it gives: one lag more,
    /// and outputs enough for an increment.
    pub fn row_structure(structure: Structure) -> Structure {
        let published = structure.published();
        Structure { na: published.na.max(2), nb: (published.nb + 1).min(MAX_LINEAR - 1), ..published }
    }

    /// For models of `structure` whose predictions count over `horizon` samples. Nothing is known yet.
    pub fn new(structure: Structure, horizon: usize) -> Self {
        let row = Self::row_structure(structure);
        let nothing = Coefficients::zero(structure).nonlinearity();
        let families: Vec<Family> = families(structure, &nothing)
            .into_iter()
            .map(|(name, regression, factors)| Family::new(name, regression, factors))
            .collect();
        let members = 1 + families.iter().map(Family::len).sum::<usize>();
        let n = row.full_len();
        let stride = horizon.div_ceil(FORECASTS);
        let slots = horizon.div_ceil(stride);
        Self {
            structure,
            row_structure: row,
            families,
            rows: Triangle::new(n),
            smoothed_rows: Triangle::new(n),
            smoothing: (-1.0 / (SMOOTHING * horizon as f64)).exp(),
            smoothed: vec![0.0; n + 1],
            is_smoothed: false,
            started: false,
            members: vec![vec![0.0; n]; members],
            weights: vec![0.0; members],
            theta: vec![0.0; n],
            pole_limit: 1.0 + 1.0 / horizon as f64,
            scores: Scores::new(members, stride, horizon),
            forecasts: Forecasts::new(row.na, n - row.na, members * slots),
            stride,
            until_launch: 0,
            slots,
            slot: 0,
            launched: 0,
            separation: OnlineSeparation::new(row),
            unused: [0; 2],
            idle_after: IDLE * horizon as u64,
        }
    }

    /// Takes in y(k) and the row of a sample of the training; once the bank is started, after [`Self::learn`].
    pub fn collect(&mut self, y: f64, row: &RegressorRow) {
        self.rows.add(row.values(), y);
        if !self.started {
            self.smooth(y, row);
        }
        let (row, target) = self.smoothed.split_at(row.values().len());
        self.smoothed_rows.add(row, target[0]);
    }

    /// Starts all members from the rows collected so far; scores that are there already stay.
    ///
    /// `held` is the `classical` model, which has the structure that the bank was made for, written out for the row.
    pub fn start(&mut self, held: &[f64], classical: &Coefficients) {
        let families = families(self.structure, &classical.nonlinearity());
        for (family, (_, regression, _)) in self.families.iter_mut().zip(families) {
            let rows = if family.is_smoothed() { &self.smoothed_rows } else { &self.rows };
            family.start(regression, rows, &self.row_structure);
        }
        self.members[0].copy_from_slice(held);
        self.theta.copy_from_slice(held);
        self.separation.start(classical, &self.rows);
        for _ in 0..FIRST_ROUNDS {
            let _ = self.separation.separate(held);
        }
        self.started = true;
    }

    /// Whether it has been started.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Takes in y(k) and the row of sample k. An axis at rest teaches nothing; its forecasts go on.
    pub fn learn(&mut self, y: f64, row: &RegressorRow, resting: bool) -> Learned {
        self.forecasts.advance(row.driven());
        self.smooth(y, row);
        if resting {
            return Learned { factor: 1.0, bounded: false };
        }
        if self.until_launch == 0 && self.launched == self.slots {
            let (forecasts, slots, slot) = (&self.forecasts, self.slots, self.slot);
            self.scores.push(|member| y - forecasts.predicted(member * slots + slot));
        }
        let idle = self.idle_signs(row);
        let mut learned = Learned { factor: self.weights[0], bounded: false };
        let mut weights = self.weights[1..].iter();
        for family in &mut self.families {
            let (row, target) = match family.is_smoothed() {
                true => (&self.smoothed[..row.values().len()], self.smoothed[row.values().len()]),
                false => (row.values(), y),
            };
            learned.bounded |= family.learn(target, row, &self.row_structure, idle);
            for (factor, weight) in family.factors().iter().zip(&mut weights) {
                learned.factor += weight * factor;
            }
        }
        learned
    }

    /// Lets the forecasts go on past a sample whose output is not to be used.
    pub fn pass(&mut self, row: &RegressorRow) {
        self.forecasts.advance(row.driven());
    }

    /// After every sample: makes the model of this sample, and launches forecasts when it is time; `outputs` = y(..k).
    ///
    /// The weights change only then, or when the model is unstable.
    pub fn settle(&mut self, outputs: &SlidingBuffer) {
        let launching = self.until_launch == 0;
        self.write_out(launching);
        if launching {
            self.until_launch = self.stride;
            self.launch(outputs);
            self.weigh();
        }
        self.until_launch -= 1;
        self.mix();
        if !self.is_stable(&self.theta) {
            self.write_out(true);
            self.weigh();
            self.mix();
        }
    }

    fn is_stable(&self, theta: &[f64]) -> bool {
        poles_within(&theta[..self.row_structure.na], self.pole_limit)
    }

    fn weigh(&mut self) {
        let mut weights = std::mem::take(&mut self.weights);
        self.scores.weigh(|member| member == 0 || self.is_stable(&self.members[member]), &mut weights);
        self.weights = weights;
    }

    fn mix(&mut self) {
        self.theta.fill(0.0);
        for (theta, weight) in self.members.iter().zip(&self.weights).filter(|(_, weight)| **weight > 0.0) {
            self.theta.iter_mut().zip(theta).for_each(|(sum, coefficient)| *sum += weight * coefficient);
        }
    }

    /// Writes out all members, or those that have a weight.
    fn write_out(&mut self, all: bool) {
        let mut members = self.members[1..].iter_mut().zip(&self.weights[1..]);
        for family in &self.families {
            for (member, (theta, weight)) in (0..family.len()).zip(&mut members) {
                if all || *weight > 0.0 {
                    family.expand(member, &self.row_structure, theta);
                }
            }
        }
    }

    fn launch(&mut self, outputs: &SlidingBuffer) {
        let na = self.row_structure.na;
        if outputs.len() >= na {
            for (member, theta) in self.members.iter().enumerate() {
                self.forecasts.launch(member * self.slots + self.slot, theta, outputs.latest(na));
            }
            self.slot = (self.slot + 1) % self.slots;
            self.launched = (self.launched + 1).min(self.slots);
        }
    }

    /// After a gap in the samples: forecasts on their way are worth nothing, and the filter starts again.
    pub fn interrupt(&mut self) {
        self.launched = 0;
        self.is_smoothed = false;
    }

    /// Family, forgetting factor and weight of every member, the held one first.
    pub fn members(&self) -> impl Iterator<Item = (&'static str, f64, f64)> {
        let learning =
            self.families.iter().flat_map(|family| family.factors().iter().map(|factor| (family.name(), *factor)));
        let members = std::iter::once(("held", 1.0)).chain(learning);
        members.zip(&self.weights).map(|((name, factor), weight)| (name, factor, *weight))
    }

    /// The model, written out for the row.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The model as a, b, f, g, after one more round of separation, and the part of the driven half's weighted norm
    /// that the separation does not explain.
    pub fn separate(&mut self) -> (Coefficients, f64) {
        let model = self.separation.separate(&self.theta);
        (model, self.separation.residual())
    }

    /// Trace of the covariance of the member that counts most; 0 for the held one.
    pub fn covariance_trace(&self) -> f64 {
        let most =
            (1..self.weights.len()).fold(0, |most, i| if self.weights[i] > self.weights[most] { i } else { most });
        let mut before = 1;
        for family in &self.families {
            if (before..before + family.len()).contains(&most) {
                return family.member(most - before).covariance_trace();
            }
            before += family.len();
        }
        0.0
    }

    /// Whether positive, and negative commands have been out of use for long.
    fn idle_signs(&mut self, row: &RegressorRow) -> [bool; 2] {
        for (unused, used) in self.unused.iter_mut().zip(row.signs()) {
            *unused = if used { 0 } else { *unused + 1 };
        }
        self.unused.map(|samples| samples > self.idle_after)
    }

    fn smooth(&mut self, y: f64, row: &RegressorRow) {
        let keep = if self.is_smoothed { self.smoothing } else { 0.0 };
        for (smoothed, value) in self.smoothed.iter_mut().zip(row.values().iter().chain([&y])) {
            *smoothed = keep * *smoothed + (1.0 - keep) * value;
        }
        self.is_smoothed = true;
    }
}

/// Name, regression and forgetting factors of every family.
fn families(structure: Structure, held: &Nonlinearity) -> [(&'static str, Regression, &'static [f64]); 5] {
    let row = Bank::row_structure(structure);
    let increments = Structure {
        na: if structure.integrator { structure.na } else { (structure.na - 1).max(1) },
        nb: row.nb,
        integrator: true,
        ..structure
    };
    let wide = Structure { nb: row.nb, ..structure };
    [
        ("linear", Regression::linear(structure, held), &[0.99]),
        ("increments", Regression::linear(increments, held), &[0.99, 0.995]),
        ("directional", Regression::directional(increments, held), &[0.995]),
        ("full", Regression::full(structure), &[0.995, 0.998, 0.9998]),
        (SMOOTHED, Regression::full(wide), &[0.997, 0.9998]),
    ]
}
