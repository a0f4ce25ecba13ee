//! The last model that was approved, and how old it is.
//!
//! ```text
//! fresh -> stale     after model_timeout       used on, and said to be stale
//! stale -> over      after model_lifetime      used no more, and the axis goes at half of its speed
//! ```
//!
//! Age is counted from the sample that the model was made after, in ticks. An identifier that has died stops nothing: what
//! it has found of the machine is still true a minute later, as far as the machine has not changed. Nor does one that
//! begins anew, or publishes nonsense: what is refused is not used once, and the one before goes on to age.
//!
//! Trap: a model that the axis itself has shown to be wrong must not come back by being the last good one, so it is
//! dropped; its age stays.

use pipeline::hammerstein::Coefficients;

use super::judge::Approved;

/// How old the last approved model is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Age {
    /// There never was one.
    None,
    /// Within `model_timeout`.
    Fresh,
    /// Within `model_lifetime`.
    Stale,
    /// Older.
    Over,
}

/// The last model of one axis that was approved.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    timeout: u64,
    lifetime: u64,
    model: Coefficients,
    range: (f64, f64),
    made_after: Option<u64>,
    is_dropped: bool,
}

impl Kept {
    /// None yet; `timeout` and `lifetime` in ticks.
    pub fn new(timeout: u64, lifetime: u64) -> Self {
        let model = Coefficients::default();
        Self { timeout, lifetime, model, range: (0.0, 0.0), made_after: None, is_dropped: false }
    }

    /// Forgets: ticks are counted anew.
    pub fn reset(&mut self) {
        *self = Self::new(self.timeout, self.lifetime);
    }

    /// Keeps a model that was made after tick `made_after`.
    pub fn keep(&mut self, approved: &Approved<'_>, made_after: u64) {
        (self.model, self.range) = (*approved.model, approved.range);
        (self.made_after, self.is_dropped) = (Some(made_after), false);
    }

    /// Uses the model no more.
    pub fn discard(&mut self) {
        self.is_dropped = true;
    }

    /// How old the model is at tick `sequence`.
    pub fn age(&self, sequence: u64) -> Age {
        match self.made_after.map(|made_after| sequence.abs_diff(made_after)) {
            None => Age::None,
            Some(age) if age <= self.timeout => Age::Fresh,
            Some(age) if age <= self.lifetime => Age::Stale,
            Some(_) => Age::Over,
        }
    }

    /// The model, if it may be used at tick `sequence`.
    pub fn approved(&self, sequence: u64) -> Option<Approved<'_>> {
        let is_usable = !self.is_dropped && matches!(self.age(sequence), Age::Fresh | Age::Stale);
        is_usable.then_some(Approved { model: &self.model, range: self.range })
    }
}
