//! The recursive estimators. All use one recursion on one factorised covariance ([`RecursiveLeastSquares`]); they
//! differ in what they forget.
//!
//! | setting | what it forgets | file |
//! |---|---|---|
//! | `constant:L` | at every sample an equal part of everything | [`exponential`] |
//! | `paper` | the more, the larger the error and its change (Table 1, eq. (21)), as printed | [`fuzzy`] |
//! | `rules` | as `paper`, with the rules and universes that `[fuzzy]` sets, and a bounded covariance | [`fuzzy`] |
//! | `fuzzy:LOW` | as `rules`, with errors in units of their own scale, down to LOW | [`normalized`] |
//! | `fortescue:N0` | as much as keeps a weighted sum of squared errors constant | [`fortescue`] |
//! | `directional:L` | only along the row that has come | [`directional`] |
//! | `window:N` | only the row that came N samples ago | [`window`] |
//!
//! All estimators have these properties: held coefficients never change; a row or target that is not finite changes
//! nothing; the covariance is symmetric and positive definite by construction, and bounded. Only that of `paper` has no
//! bound, as (19) has none.
//!
//! All of this runs in the loop, but for `start`. Nothing here allocates after construction.
//!
//! To add an estimator: a variant of the machine file's `estimator`, a file here that implements `Method`, its lines
//! in [`RecursiveEstimator`], and a line of the cases in `tests/estimators.rs`.

pub mod directional;
pub mod exponential;
pub mod fortescue;
pub mod fuzzy;
pub mod normalized;
pub mod window;

use pipeline::machine::{Estimator, Fuzzy};

use crate::{least_squares::Triangle, recursive::RecursiveLeastSquares};
use directional::Directional;
use exponential::Exponential;
use fortescue::Fortescue;
use fuzzy::Rules;
use normalized::Normalized;
use window::Window;

/// What one update did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adapted {
    /// Target minus its prediction before the update.
    pub innovation: f64,
    /// The forgetting factor of this update: 1 minus the part that was forgotten.
    pub factor: f64,
    /// Whether the covariance was cut at its bound.
    pub bounded: bool,
}

/// What every estimator does; [`RecursiveEstimator`] describes each of these.
trait Method {
    fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64);

    fn set_theta(&mut self, theta: &[f64]);

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted;

    fn recursion(&self) -> &RecursiveLeastSquares;

    fn universes(&self) -> Option<(f64, f64)> {
        None
    }
}

/// One recursive estimator of any kind.
#[derive(Debug, Clone)]
pub enum RecursiveEstimator {
    /// `constant:L`
    Exponential(Exponential),
    /// `paper`, `rules`
    Rules(Rules),
    /// `fuzzy:LOW`
    Normalized(Normalized),
    /// `fortescue:N0`
    Fortescue(Fortescue),
    /// `directional:L`
    Directional(Directional),
    /// `window:N`
    Window(Window),
}

impl RecursiveEstimator {
    /// For `n` coefficients. Allocates all memory that it will ever use.
    ///
    /// # Panics
    /// With [`Estimator::Auto`], which is several estimators, and with [`Estimator::GreyBox`], which is none of these.
    pub fn new(kind: Estimator, n: usize, fuzzy: &Fuzzy) -> Self {
        match kind {
            Estimator::Constant(factor) => Self::Exponential(Exponential::new(n, factor)),
            Estimator::Paper => Self::Rules(Rules::paper(n)),
            Estimator::Rules => Self::Rules(Rules::new(n, fuzzy)),
            Estimator::Fuzzy(low) => Self::Normalized(Normalized::new(n, fuzzy, low)),
            Estimator::Fortescue(memory) => Self::Fortescue(Fortescue::new(n, memory)),
            Estimator::Directional(factor) => Self::Directional(Directional::new(n, factor)),
            Estimator::Window(rows) => Self::Window(Window::new(n, rows)),
            Estimator::Auto => panic!("auto is several estimators, not one"),
            Estimator::GreyBox => panic!("a grey box is an estimator of its own"),
        }
    }

    fn method(&self) -> &dyn Method {
        match self {
            Self::Exponential(method) => method,
            Self::Rules(method) => method,
            Self::Normalized(method) => method,
            Self::Fortescue(method) => method,
            Self::Directional(method) => method,
            Self::Window(method) => method,
        }
    }

    fn method_mut(&mut self) -> &mut dyn Method {
        match self {
            Self::Exponential(method) => method,
            Self::Rules(method) => method,
            Self::Normalized(method) => method,
            Self::Fortescue(method) => method,
            Self::Directional(method) => method,
            Self::Window(method) => method,
        }
    }

    /// Starts from the results of offline identification: its data, which coefficients are `held`, and the standard
    /// deviation of its residuals in the unit of the target.
    pub fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64) {
        self.method_mut().start(data, held, residual_sigma);
    }

    /// Replaces the coefficients, after [`Self::start`] and before the first update. The covariance stays.
    pub fn set_theta(&mut self, theta: &[f64]) {
        self.method_mut().set_theta(theta);
    }

    /// One update with the regressor `phi`, whose product with the coefficients predicts `target`.
    pub fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        self.method_mut().update(phi, target)
    }

    /// The coefficients.
    pub fn theta(&self) -> &[f64] {
        self.recursion().theta()
    }

    /// Coefficients and covariance.
    pub fn recursion(&self) -> &RecursiveLeastSquares {
        self.method().recursion()
    }

    /// Error and change of error that count as PB, in the unit of the target; `None` without fuzzy rules.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.method().universes()
    }
}
