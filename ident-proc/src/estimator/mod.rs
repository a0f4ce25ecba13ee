//! The estimators: one recursion on one safe covariance ([`RecursiveLeastSquares`]), and several answers to what it
//! is to forget.
//!
//! | setting | what it forgets | file |
//! |---|---|---|
//! | `constant:L` | every sample the same part of everything | [`exponential`] |
//! | `paper` | the more, the larger the error and its change (Table 1, eq. (21)) | [`fuzzy`] |
//! | `fuzzy:LOW` | the same table on errors in units of their own scale, down to LOW | [`normalized`] |
//! | `fortescue:N0` | as much as a weighted sum of squared errors asks for | [`fortescue`] |
//! | `directional:L` | only along the row that has come | [`directional`] |
//! | `window:N` | the row that came N samples ago, and nothing else | [`window`] |
//!
//! Common to all: coefficients that are held stay, a row or target that is not finite teaches nothing, the covariance
//! is symmetric and positive definite by construction and bounded, and an update allocates nothing.

pub mod directional;
pub mod exponential;
pub mod fortescue;
pub mod fuzzy;
pub mod normalized;
pub mod window;

use pipeline::machine::{self, Fuzzy};

use crate::{least_squares::Triangle, recursive::RecursiveLeastSquares};
use directional::Directional;
use exponential::Exponential;
use fortescue::Fortescue;
use fuzzy::Paper;
use normalized::Normalized;
use window::Window;

/// What one update did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adapted {
    /// Target minus prediction, before the update.
    pub innovation: f64,
    /// The forgetting factor of this update: 1 less the part that was forgotten.
    pub factor: f64,
    /// Whether the covariance was held at its bound.
    pub bounded: bool,
}

/// What every estimator does.
trait Method {
    fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64);

    fn set_theta(&mut self, theta: &[f64]);

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted;

    fn factors(&self) -> &RecursiveLeastSquares;

    fn universes(&self) -> Option<(f64, f64)> {
        None
    }
}

/// One recursive estimator of any kind.
#[derive(Debug, Clone)]
pub enum Estimator {
    /// `constant:L`
    Exponential(Exponential),
    /// `paper`
    Paper(Paper),
    /// `fuzzy:LOW`
    Normalized(Normalized),
    /// `fortescue:N0`
    Fortescue(Fortescue),
    /// `directional:L`
    Directional(Directional),
    /// `window:N`
    Window(Window),
}

impl Estimator {
    /// For `n` coefficients; takes all memory that it will ever use.
    ///
    /// # Panics
    /// With [`machine::Estimator::Auto`], which is several estimators and not one, and with
    /// [`machine::Estimator::GreyBox`], which is none of these.
    pub fn new(kind: machine::Estimator, n: usize, fuzzy: &Fuzzy) -> Self {
        match kind {
            machine::Estimator::Constant(factor) => Self::Exponential(Exponential::new(n, factor)),
            machine::Estimator::Paper => Self::Paper(Paper::new(n, fuzzy)),
            machine::Estimator::Fuzzy(low) => Self::Normalized(Normalized::new(n, fuzzy, low)),
            machine::Estimator::Fortescue(memory) => Self::Fortescue(Fortescue::new(n, memory)),
            machine::Estimator::Directional(factor) => Self::Directional(Directional::new(n, factor)),
            machine::Estimator::Window(rows) => Self::Window(Window::new(n, rows)),
            machine::Estimator::Auto => panic!("auto is several estimators, not one"),
            machine::Estimator::GreyBox => panic!("a grey box is an estimator of its own"),
        }
    }

    fn method(&self) -> &dyn Method {
        match self {
            Self::Exponential(method) => method,
            Self::Paper(method) => method,
            Self::Normalized(method) => method,
            Self::Fortescue(method) => method,
            Self::Directional(method) => method,
            Self::Window(method) => method,
        }
    }

    fn method_mut(&mut self) -> &mut dyn Method {
        match self {
            Self::Exponential(method) => method,
            Self::Paper(method) => method,
            Self::Normalized(method) => method,
            Self::Fortescue(method) => method,
            Self::Directional(method) => method,
            Self::Window(method) => method,
        }
    }

    /// Starts from what offline identification found: its data, what is held, and the standard deviation of the error
    /// that it left, in the unit of the target.
    pub fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64) {
        self.method_mut().start(data, held, residual_sigma);
    }

    /// Puts other coefficients in the place of the solution of the data, after [`Self::start`] and before the first
    /// update; the covariance stays.
    pub fn set_theta(&mut self, theta: &[f64]) {
        self.method_mut().set_theta(theta);
    }

    /// One update: `phi` times the coefficients is to give `target`.
    pub fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        self.method_mut().update(phi, target)
    }

    /// The coefficients.
    pub fn theta(&self) -> &[f64] {
        self.factors().theta()
    }

    /// Coefficients with covariance and information.
    pub fn factors(&self) -> &RecursiveLeastSquares {
        self.method().factors()
    }

    /// Error and change of error that count as PB, in the unit of the target; only the fuzzy ones have them.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.method().universes()
    }
}
