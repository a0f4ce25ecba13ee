//! The last approved model, and how old it is.
//!
//! ```text
//! fresh -> stale       after model_timeout       still used, and flagged as stale
//! stale -> expired     after model_lifetime      not used any more; the axis goes at half of its speed
//! ```
//!
//! Age is counted in ticks, from the sample that the model was made after. A model outlives its identifier: what was
//! identified is still true a minute later, as far as the machine has not changed. A snapshot that is refused, or that
//! holds no model yet, does not replace the last approved model, which goes on to age.
//!
//! Trap: a model that has lost the axis must not come back as the last approved one. So it is discarded; its age stays.

use pipeline::hammerstein::Coefficients;

use super::judge::Approved;

/// How old the last approved model is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Age {
    /// No model has been approved yet.
    None,
    /// Within `model_timeout`.
    Fresh,
    /// Within `model_lifetime`.
    Stale,
    /// Older than `model_lifetime`.
    Expired,
}

/// The last approved model of one axis.
#[derive(Debug, Clone)]
pub struct LastApproved {
    /// Oldest fresh model, ticks.
    timeout: u64,
    /// Oldest stale model, ticks.
    lifetime: u64,
    model: Coefficients,
    range: (f64, f64),
    /// Tick of the sample that the model was made after.
    made_after: Option<u64>,
    is_discarded: bool,
}

impl LastApproved {
    /// Without a model; `timeout` and `lifetime` in ticks.
    pub fn new(timeout: u64, lifetime: u64) -> Self {
        let model = Coefficients::default();
        Self { timeout, lifetime, model, range: (0.0, 0.0), made_after: None, is_discarded: false }
    }

    /// Forgets the model: the ticks may be counted anew.
    pub fn reset(&mut self) {
        *self = Self::new(self.timeout, self.lifetime);
    }

    /// Replaces the model by one that was made after tick `made_after`.
    pub fn keep(&mut self, approved: &Approved<'_>, made_after: u64) {
        (self.model, self.range) = (*approved.model, approved.range);
        (self.made_after, self.is_discarded) = (Some(made_after), false);
    }

    /// Does not use this model any more.
    pub fn discard(&mut self) {
        self.is_discarded = true;
    }

    /// How old the model is at tick `sequence`.
    pub fn age(&self, sequence: u64) -> Age {
        match self.made_after.map(|made_after| sequence.abs_diff(made_after)) {
            None => Age::None,
            Some(age) if age <= self.timeout => Age::Fresh,
            Some(age) if age <= self.lifetime => Age::Stale,
            Some(_) => Age::Expired,
        }
    }

    /// The model, if it may be used at tick `sequence`.
    pub fn model(&self, sequence: u64) -> Option<Approved<'_>> {
        let is_usable = !self.is_discarded && matches!(self.age(sequence), Age::Fresh | Age::Stale);
        is_usable.then_some(Approved { model: &self.model, range: self.range })
    }
}
