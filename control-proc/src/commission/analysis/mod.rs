//! From the record of an experiment to the model of the axis. Never called in a loop: it allocates and takes seconds.
//!
//! | module | what it holds |
//! |---|---|
//! | `shape` | what the search changes: dead time, lag and dead bands |
//! | `fit` | the curve that explains a record best for a given shape, and how well a model predicts |
//! | [`simplex`] | the search |
//!
//! ```text
//! tau dX/dt + X = u(t)           x(t) = X(t - t_d)
//! y(k+m) - y(k) = sum_j w_j (C_j(k+m) - C_j(k)) + e        C_j(t) = integral of max(0, x - d_e - q_j) up to t
//!                 - the mirrored terms with max(0, -x - d_r - q_j)
//! min over (t_d, tau, d_e, d_r) of the least squares over w
//! ```
//!
//! u command and x spool position in [-1, 1], y position m, t_d dead time s, tau time constant s, d_e and d_r dead
//! bands, q_j openings at which the curve bends, w_j changes of its slope m/s, m T = 0.2 s. For a given (t_d, tau, d_e,
//! d_r) the model is linear in w. A dead time delays X exactly, so one response serves all of them. The search begins
//! on a grid of (t_d, tau) with d = 0, goes on with a grid of d, and then with [`simplex`] on all four.
//!
//! The model is fitted on the first two thirds of the record and judged on the rest: half a second ahead, with the
//! command known.
//!
//! Traps: t_d and tau trade off against each other where the plant is not a lag of first order, such as a mass on oil;
//! only their sum is certain. A hysteresis of width h is half in the dead bands, d + h/2. Where a curve begins flat,
//! the dead band that is found ends where motion begins to count, not where the first drop flows.

mod fit;
mod shape;
pub mod simplex;

use pipeline::machine::{Commissioned, DeadBand};

use super::record::ExperimentRecord;
use fit::Data;
use shape::{KNOTS, LONGEST_DEAD_TIME, Parameters, Shape};
use simplex::minimum;

/// How far ahead the model is judged, s.
const JUDGED_AHEAD: f64 = 0.5;
/// Least length of a record, as multiple of [`JUDGED_AHEAD`].
const LEAST_LENGTH: f64 = 10.0;
/// Part of the record that is fitted.
const FITTED_PART: f64 = 2.0 / 3.0;
/// Time constants of the grid, s.
const TIME_CONSTANTS: [f64; 3] = [0.03, 0.1, 0.25];
/// Steps of the grids of dead time and of dead bands.
const GRID_STEPS: i32 = 20;
/// Part of the largest speed below which a curve is flat.
const FLAT: f64 = 0.03;
/// Most moves of the dead bands beyond a flat beginning of the curve.
const FLAT_STEPS: usize = 3;
/// Mean square error, relative to the least one found, up to which a wider dead band is preferred.
const AS_GOOD: f64 = 1.1;
/// Steps of the search.
const SEARCH_STEPS: usize = 250;
/// First steps of the search in dead time (s), logarithm of the time constant, and dead bands.
const FIRST_STEPS: Parameters = [0.02, 0.4, 0.02, 0.02];
/// First steps of the search near a solution.
const FINE_STEPS: Parameters = [0.002, 0.05, 0.005, 0.005];
/// Searches in a row, each from the end of the one before: a simplex can collapse early.
const SEARCHES: usize = 2;

/// Why a record has no model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AnalysisError {
    /// The record is too short.
    #[error("record: found {found:.1} s; allowed: at least {needed:.1} s")]
    TooShort {
        /// s.
        found: f64,
        /// s.
        needed: f64,
    },
    /// Nothing in the record moves.
    #[error("record: found no motion that follows the commands in both directions")]
    NoMotion,
}

/// The model that explains a record.
///
/// # Errors
/// The record is too short, or no model with rising curves explains it.
pub fn analyse(record: &ExperimentRecord) -> Result<Commissioned, AnalysisError> {
    let count = record.positions.len();
    let seconds = count as f64 * record.period;
    let needed = LEAST_LENGTH * JUDGED_AHEAD;
    if seconds < needed {
        return Err(AnalysisError::TooShort { found: seconds, needed });
    }
    let split = (count as f64 * FITTED_PART) as usize;
    let largest = record.commands.iter().fold(0.0f64, |largest, command| largest.max(command.abs()));
    let search = Search { fitted: Data { record, begin: 0, end: split }, largest };

    let mut best = search.on_grids();
    for _ in 0..SEARCHES {
        let (at, cost) = minimum(|p| search.cost(p), best.at, FIRST_STEPS, SEARCH_STEPS);
        best = Point { at, cost };
    }
    if !best.cost.is_finite() {
        return Err(AnalysisError::NoMotion);
    }
    let mut model = search.beyond_flat_begin(best)?;
    model.fit_percent = Data { record, begin: split, end: count }.judge(&model, JUDGED_AHEAD);
    Ok(model)
}

/// A point of the search and its mean square error, m2.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: Parameters,
    cost: f64,
}

/// The search for the shape that explains the fitted part of a record best.
struct Search<'a> {
    fitted: Data<'a>,
    /// Largest magnitude of a command in the record.
    largest: f64,
}

impl Search<'_> {
    /// Mean square error of the differences with the best curve of this shape, m2.
    fn cost(&self, p: &Parameters) -> f64 {
        let shape = Shape::of(p, self.largest);
        shape.filter(Shape::is_allowed).map_or(f64::INFINITY, |shape| self.fitted.fit(&shape).0)
    }

    fn model_at(&self, p: &Parameters) -> Result<Commissioned, AnalysisError> {
        let model = Shape::of(p, self.largest).and_then(|shape| shape.model(&self.fitted.fit(&shape).1));
        model.ok_or(AnalysisError::NoMotion)
    }

    /// The best point of a grid of dead time and time constant, and then of a grid of each dead band.
    fn on_grids(&self) -> Point {
        let mut best = Point { at: [0.0; 4], cost: f64::INFINITY };
        let try_one = |at: Parameters, best: &mut Point| {
            let cost = self.cost(&at);
            if cost < best.cost {
                *best = Point { at, cost };
            }
        };
        let on_grid = |largest: f64, i: i32| largest * f64::from(i) / f64::from(GRID_STEPS);
        for tau in TIME_CONSTANTS {
            for i in 0..=GRID_STEPS {
                try_one([on_grid(LONGEST_DEAD_TIME, i), tau.ln(), 0.0, 0.0], &mut best);
            }
        }
        for side in [2, 3] {
            let from = best.at;
            for i in 1..GRID_STEPS {
                let mut at = from;
                at[side] = on_grid(self.largest, i);
                try_one(at, &mut best);
            }
        }
        best
    }

    /// The model at the best point, or at one with wider dead bands. A curve that begins flat can do without a dead
    /// band and explain as much; the point with the dead band is preferred.
    fn beyond_flat_begin(&self, best: Point) -> Result<Commissioned, AnalysisError> {
        let mut model = self.model_at(&best.at)?;
        for _ in 0..FLAT_STEPS {
            let flat = |speeds: &[f64]| {
                let still = speeds.partition_point(|speed| *speed < FLAT * speeds[KNOTS - 1]);
                still.checked_sub(1).map_or(0.0, |last| model.openings[last])
            };
            let beyond = [flat(&model.speeds_extend), flat(&model.speeds_retract)];
            let DeadBand { extend, retract } = model.dead_band;
            let start = [model.dead_time, model.time_constant.ln(), extend + beyond[0], retract + beyond[1]];
            if beyond == [0.0; 2] {
                break;
            }
            let (p, cost) = minimum(|p| self.cost(p), start, FINE_STEPS, SEARCH_STEPS);
            if cost > AS_GOOD * best.cost {
                break;
            }
            model = self.model_at(&p)?;
        }
        Ok(model)
    }
}
