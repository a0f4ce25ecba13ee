//! What learns online: one recursive estimator, a bank of them, or the grey box.
//!
//! | setting `estimator` | what learns |
//! |---|---|
//! | `auto` | [`bank`]: several estimators side by side, one model from all of them |
//! | `grey-box` | [`grey_box`]: speeds and lag of the commissioned model |
//! | all others | [`single`]: one of the [estimators](crate::estimator), steps 5 and 6 of the paper |
//!
//! [`Adaptation`] is the one place that tells them apart. Its calls at each sample are, in this order,
//!
//! ```text
//! training:        collect | wait | pass | interrupt -> settle        at its end start, for a bank also before
//! after training:  learn   | pass | interrupt -> settle -> model
//! ```
//!
//! All of this runs in the loop, but for [`Adaptation::start`]. Nothing here allocates after construction.

pub mod bank;
pub mod grey_box;
pub mod single;

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Commissioned, Estimator, Identification},
};

pub use bank::Bank;
pub use grey_box::GreyBox;
pub use single::Single;

use crate::{
    offline::{Batch, Offline},
    sample::{RegressorRow, SlidingBuffer},
};

/// What learns online for one axis. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub enum Adaptation {
    /// One recursive estimator.
    Single(Box<Single>),
    /// Several recursive estimators side by side.
    Bank(Box<Bank>),
    /// The commissioned model with its speeds and its lag adapted.
    GreyBox(Box<GreyBox>),
}

/// What one sample did to the adaptive model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Learned {
    /// The forgetting factor.
    pub factor: f64,
    /// Whether a covariance was cut at its bound.
    pub bounded: bool,
}

impl Learned {
    /// Nothing was learned, and nothing forgotten.
    pub const NOTHING: Self = Self { factor: 1.0, bounded: false };
}

impl Adaptation {
    /// What `settings` asks for.
    ///
    /// # Panics
    /// With [`Estimator::GreyBox`] and without `commissioned`, which the machine file refuses.
    pub fn new(settings: &Identification, commissioned: Option<&Commissioned>) -> Self {
        let structure = settings.structure;
        match settings.estimator {
            Estimator::Auto => Self::Bank(Box::new(Bank::new(structure, settings.horizon))),
            Estimator::GreyBox => {
                let commissioned = commissioned.expect("the grey box starts from a commissioned axis");
                let (period, memory, start) = (settings.period, settings.memory, settings.start.as_ref());
                Self::GreyBox(Box::new(GreyBox::new(structure, commissioned, period, memory, start)))
            }
            _ => Self::Single(Box::new(Single::new(settings))),
        }
    }

    /// Structure of the regressor rows that it learns from, and of the coefficients that it writes out, for models of
    /// `structure`.
    pub fn row_structure(&self, structure: Structure) -> Structure {
        match self {
            Self::Bank(_) => Bank::row_structure(structure),
            Self::Single(_) | Self::GreyBox(_) => structure.published(),
        }
    }

    /// Takes in y(k) and the row of a training sample.
    pub fn collect(&mut self, y: f64, row: &RegressorRow, resting: bool) {
        match self {
            Self::Single(_) => {}
            Self::Bank(bank) => {
                if bank.is_started() {
                    bank.learn(y, row, resting);
                }
                bank.collect(y, row);
            }
            Self::GreyBox(grey_box) => {
                grey_box.learn(y, row);
            }
        }
    }

    /// Forgets the rows of the training so far. The grey box has learned from each of them at once and goes on.
    pub fn restart(&mut self) {
        match self {
            Self::Bank(bank) => bank.restart(),
            Self::Single(_) | Self::GreyBox(_) => {}
        }
    }

    /// Takes in y(k) and the row of a sample that the training leaves out because the axis is not driven.
    pub fn wait(&mut self, y: f64, row: &RegressorRow) {
        match self {
            Self::Single(_) => {}
            Self::Bank(bank) => bank.pass(row),
            Self::GreyBox(grey_box) => {
                grey_box.learn(y, row);
            }
        }
    }

    /// The model that is known before the training ends: that of the grey box, which was commissioned.
    pub fn known_model(&self) -> Option<Coefficients> {
        match self {
            Self::GreyBox(grey_box) => Some(grey_box.model()),
            Self::Single(_) | Self::Bank(_) => None,
        }
    }

    /// Whether it can use a first model before the training ends: a bank compares its members on the last part of the
    /// training.
    pub fn awaits_first_model(&self) -> bool {
        matches!(self, Self::Bank(bank) if !bank.is_started())
    }

    /// Starts from offline identification. `travel`: root mean square of y(k) - y(k-h) over the training, h horizon.
    pub fn start(&mut self, batch: &Batch, offline: &Offline, travel: f64) {
        match self {
            Self::Single(single) => single.start(batch, offline),
            Self::Bank(bank) => bank.start(offline, travel),
            // The grey box has started from what was commissioned.
            Self::GreyBox(_) => {}
        }
    }

    /// Takes in y(k) and the row of sample k: steps 5 and 6 of the paper.
    pub fn learn(&mut self, y: f64, row: &RegressorRow, resting: bool) -> Learned {
        match self {
            Self::Single(single) => single.learn(y, row),
            Self::Bank(bank) => {
                bank.weigh(y, row, resting);
                bank.learn(y, row, resting)
            }
            Self::GreyBox(grey_box) => grey_box.learn(y, row),
        }
    }

    /// Whether a sample at rest counts as an update.
    pub fn updates_at_rest(&self) -> bool {
        matches!(self, Self::Single(_))
    }

    /// Whether commands after training change f and g.
    pub fn learns_nonlinearity(&self) -> bool {
        match self {
            Self::Single(single) => single.learns_nonlinearity(),
            Self::Bank(_) | Self::GreyBox(_) => true,
        }
    }

    /// Goes on past a sample whose output is not used.
    pub fn pass(&mut self, row: &RegressorRow) {
        match self {
            Self::Single(_) => {}
            Self::Bank(bank) => bank.pass(row),
            Self::GreyBox(grey_box) => grey_box.pass(row),
        }
    }

    /// Begins anew after a gap in the samples. What was learned stays.
    pub fn interrupt(&mut self) {
        match self {
            Self::Single(_) => {}
            Self::Bank(bank) => bank.interrupt(),
            Self::GreyBox(grey_box) => grey_box.interrupt(),
        }
    }

    /// Ends the sample: `outputs` = y(..k).
    pub fn settle(&mut self, outputs: &SlidingBuffer) {
        match self {
            Self::Bank(bank) if bank.is_started() => bank.settle(outputs),
            Self::Single(_) | Self::Bank(_) | Self::GreyBox(_) => {}
        }
    }

    /// The model as a, b, f, g; where products were estimated, after one more half round of separation. Also the part
    /// of the products' weighted norm that the separation does not explain.
    pub fn model(&mut self) -> (Coefficients, f64) {
        match self {
            Self::Single(single) => single.separate(),
            Self::Bank(bank) => bank.separate(),
            Self::GreyBox(grey_box) => (grey_box.model(), 0.0),
        }
    }

    /// The last increment of the output without the noise of the encoder; `None` where predictions start from the
    /// measured ones.
    pub fn increment(&self) -> Option<f64> {
        match self {
            Self::Single(_) | Self::Bank(_) => None,
            Self::GreyBox(grey_box) => Some(grey_box.increment()),
        }
    }

    /// The coefficients as they are estimated, written out for the row.
    pub fn theta(&self) -> &[f64] {
        match self {
            Self::Single(single) => single.theta(),
            Self::Bank(bank) => bank.theta(),
            Self::GreyBox(grey_box) => grey_box.theta(),
        }
    }

    /// Trace of the covariance; of several estimators, that of the one that counts most.
    pub fn covariance_trace(&self) -> f64 {
        match self {
            Self::Single(single) => single.covariance_trace(),
            Self::Bank(bank) => bank.covariance_trace(),
            Self::GreyBox(grey_box) => grey_box.covariance_trace(),
        }
    }

    /// The bank, where there is one.
    pub fn bank(&self) -> Option<&Bank> {
        match self {
            Self::Bank(bank) => Some(bank),
            Self::Single(_) | Self::GreyBox(_) => None,
        }
    }

    /// Prediction error and change of it that count as PB, in the unit of the output; `None` without fuzzy rules.
    pub fn universes(&self) -> Option<(f64, f64)> {
        match self {
            Self::Single(single) => single.universes(),
            Self::Bank(_) | Self::GreyBox(_) => None,
        }
    }
}
