//! From the record of an experiment to the model of the axis. Never called in a loop: it allocates and takes seconds.
//!
//! | module | what it holds |
//! |---|---|
//! | `candidate` | what a search has found, and whether more of it is kept |
//! | `shape` | what the search changes: dead time, lag, dead bands, hysteresis, spring and start |
//! | `start` | how late the oil starts |
//! | `spring` | the load on its spring of oil |
//! | `weights` | how much the rows of a fit count |
//! | `fit` | the curve that explains a record best for a given shape, and how well a model predicts |
//! | [`simplex`] | the search |
//!
//! ```text
//! w(t) = min(max(w(t-), u(t) - h/2), u(t) + h/2)        tau dX/dt + X = w(t)        x(t) = X(t - t_d)
//! d2v/dt2 + 2 zeta w_0 dv/dt + w_0^2 v = w_0^2 v_c      where the load swings, v = v_c elsewhere
//! y(k+m) - y(k) = sum_j w_j (C_j(k+m) - C_j(k)) + e    C_j(t) = integral of v up to t, v_c = max(0, x - d_e - q_j)
//!                 - the mirrored terms with max(0, -x - d_r - q_j)
//!                 + integral of a + b (y - y_0) from k to k+m
//! min over (t_d, tau, d_e, d_r, h, w_0, zeta) of the least squares of the weighted e over w, a and b
//! ```
//!
//! u command, w command behind the play of the hysteresis h, and x spool position in [-1, 1], v_c speed of the curve
//! and v that of the axis, y position m, t_d dead time s, tau time constant s, d_e and d_r dead bands, w_0 natural
//! frequency rad/s and zeta damping of the load on its oil, q_j openings at which the curve bends, w_j changes of its
//! slope m/s, m T = 0.2 s; a m/s and b 1/s drift of the axis, y_0 first position of the record m. For given
//! (t_d, tau, ..) the model is linear in w, a and b. A dead time delays X exactly, so one
//! response serves all of them. The search begins on a grid of (t_d, tau) with d = 0, goes on with grids of d, and then
//! with [`simplex`] on all four. A hysteresis, and then a spring, is added where it explains clearly more
//! (`CLEARLY_BETTER`). All of this is done with a drift and without one, and the drift is kept where it explains
//! clearly more.
//!
//! The drift is that of an axis whose oil leaks under its load. The spring of a load makes it depend on the position.
//! The drift is found together with the curve and is no part of the model: the integral of a controller takes it off.
//!
//! The model is fitted on the first two thirds of the motion and judged on the rest: half a second ahead, with the
//! command, the drift and the start known. How straight the curve is, is decided by that rest: of the weights of its
//! bends (`STRAIGHTNESSES`) the largest one counts that explains as much of it as the best, within the standard error
//! of their difference (L. Breiman et al., Classification and Regression Trees, 1984). Few motions tell from which
//! pull on loads overrun the axis, how late its oil starts (`start`), and what hysteresis that start hides. So whether
//! they are kept is decided on the whole record: an overrun where it explains more, a start where it explains clearly
//! more. All but the overrun is then searched once more on the fitted part. So far all rows count the same. With t_d,
//! tau, spring, start and loads of that, dead bands, hysteresis and curve are then searched again on rows with
//! `weights`, which slow motions decide as well; a hysteresis that shows in them alone is added where it explains
//! clearly more. In the end all but the overrun is fitted once more on the whole, in the same order, and the speeds of
//! each direction are brought to the pace of long motions (`pace`). Where no load was found to overrun the axis, the
//! largest one of the record is taken to be the least that does (`Seen::overrun`).
//!
//! Traps: t_d and tau trade off against each other where the load swings and the model does not; only their sum is
//! certain. In the model that is written half of the hysteresis is in the dead bands and the spring's delay in the time
//! constant: who does not know about them is right on commands that rise from neutral. Where a curve begins flat, the
//! dead band that is found ends where motion begins to count, not where the first drop flows. And the experiment
//! extends most often where the axis is low and retracts where it is high. So a load that pulls it to the middle makes
//! it drift in the direction of most commands. A model without a drift explains that by a dead band that is too narrow
//! and a curve that begins flat.

mod candidate;
mod fit;
mod shape;
pub mod simplex;
mod spring;
mod start;
mod weights;

use pipeline::machine::{Commissioned, DeadBand};

use super::record::ExperimentRecord;
use candidate::Candidate;
pub use fit::modelled;
use fit::{Beside, Data, pace};
use shape::{KNOTS, Parameters, Seen, Shape};
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
/// Dead time in the grid at step number [`GRID_STEPS`], s, and the number of the longest one.
const LONG_DEAD_TIME: f64 = 0.8;
const LONGEST_STEPS: i32 = 30;
/// Part of the largest speed below which a curve is flat.
const FLAT: f64 = 0.03;
/// Most moves of the dead bands beyond a flat beginning of the curve.
const FLAT_STEPS: usize = 3;
/// Mean square error, relative to the least one found, up to which a wider dead band is preferred.
const AS_GOOD: f64 = 1.1;
/// Steps of the search.
const SEARCH_STEPS: usize = 250;
/// First steps of the search in dead time (s), logarithm of the time constant, and dead bands.
const FIRST_STEPS: Parameters = [0.02, 0.4, 0.02, 0.02, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
/// Mean square error, relative to that without a hysteresis, a spring or a drift, below which there is one.
const CLEARLY_BETTER: f64 = 0.9;
/// First steps of the search near a solution.
const FINE_STEPS: Parameters = [0.002, 0.05, 0.005, 0.005, 0.005, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
/// Mean square error, relative to that with a spring alone, below which there is a hysteresis beside it. Loads that
/// change leave much of what such an axis does unexplained, so a hysteresis shows less.
const BETTER: f64 = 0.99;
/// Widths of a hysteresis from which its search may start.
const FIRST_HYSTERESES: [f64; 4] = [0.015, 0.03, 0.06, 0.1];
/// Damping ratio from which the search of a spring starts.
const FIRST_DAMPING: f64 = 0.2;
/// Period from which it starts, s.
const FIRST_PERIOD: f64 = 0.2;
/// Times before a motion and lag of the oil from which the search of a start begins, s, and its first steps in them.
const FIRST_TIMES: [f64; 4] = [0.0, 0.1, 0.2, 0.35];
const FIRST_LAG: f64 = 0.1;
const TIME_STEP: f64 = 0.05;
const LAG_STEP: f64 = 0.03;
/// Weights of the bends of a curve, rising.
const STRAIGHTNESSES: [f64; 3] = [1e-3, 1e-2, 1e-1];
/// How much harder loads pull at most than is needed to overrun an axis, from where its search begins; 0: none does.
const FIRST_OVERRUNS: [f64; 4] = [0.0, 2.0, 5.0, 15.0];
/// Searches in a row, each from the end of the one before: a simplex can collapse early.
const SEARCHES: usize = 2;

/// Why a record has no model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AnalysisError {
    /// The record is too short.
    #[error("record: found {found:.1} s; allowed: at least {needed:.1} s: a longer --duration")]
    TooShort {
        /// s.
        found: f64,
        /// s.
        needed: f64,
    },
    /// Nothing in the record moves.
    #[error(
        "record: found no motion that follows the commands in both directions: a longer --duration, a wider --travel \
         or a greater --speed"
    )]
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
    let split = split(record);
    let seen = Seen::of(record);
    let data = |drifts| Data { record, weights: None, begin: 0, end: split, drifts, straightness: STRAIGHTNESSES[0] };
    let search = |drifts| Search { fitted: data(drifts), seen, steps: first_steps };
    let (stands, drifts) = (search(false).best()?, search(true).best()?);
    let (is_drifting, best) = if drifts.cost < CLEARLY_BETTER * stands.cost { (true, drifts) } else { (false, stands) };
    let rest = Data { begin: split, end: count, ..data(is_drifting) };
    let even = search(is_drifting)
        .judged(best, &rest)?
        .overrun(&rest)?
        .straightened(&rest)?
        .started(&rest)?
        .hysteretic(&rest)?;
    // What is between command and motion is found. The curve is that of slow motions as well, once they have begun.
    let weights = fit::weights(record, even.point.at[0], even.point.at[1].exp());
    let weighted = Data { weights: Some(&weights), ..data(is_drifting) };
    let curve = Search { fitted: weighted, seen, steps: curve_steps };
    let chosen = curve.judged(curve.curved(even.point), &rest)?.straightened(&rest)?;
    let mut found = even.search.to_end(count).searched(even.point);
    CURVE.iter().for_each(|number| found.at[*number] = chosen.point.at[*number]);
    let whole = chosen.search.to_end(count);
    let (mut model, beside) = whole.beyond_flat_begin(whole.searched(found))?;
    let [extend, retract] = pace(&whole.fitted, &model, &beside);
    model.speeds_extend.iter_mut().for_each(|speed| *speed *= extend);
    model.speeds_retract.iter_mut().for_each(|speed| *speed *= retract);
    model.overrun = seen.overrun(model.overrun);
    model.largest_tested = seen.commands;
    (model.fit_percent, model.mass, model.noise) = (chosen.explained, record.mass, record.noise());
    Ok(model)
}

/// The sample before which [`FITTED_PART`] of the motion is.
fn split(record: &ExperimentRecord) -> usize {
    let ahead = ((JUDGED_AHEAD / record.period).round() as usize).max(1);
    let ways = record.positions.windows(ahead + 1).map(|part| (part[ahead] - part[0]).abs());
    let add = |sum: &mut f64, way: f64| {
        *sum += if way.is_finite() { way } else { 0.0 };
        Some(*sum)
    };
    let sums: Vec<f64> = ways.scan(0.0, add).collect();
    let whole = sums.last().copied().unwrap_or_default();
    sums.partition_point(|part| *part < FITTED_PART * whole)
}

/// A point of the search and its mean square error, m2.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: Parameters,
    cost: f64,
}

/// First steps of a search that leaves the hysteresis as it is.
fn without_hysteresis(steps: Parameters) -> Parameters {
    let mut steps = steps;
    steps[4] = 0.0;
    steps
}

/// First steps of a search from this point, with its hysteresis and start where it has them. Loads stay.
fn first_steps(point: &Point) -> Parameters {
    let mut steps = if point.at[4] > 0.0 { FIRST_STEPS } else { without_hysteresis(FIRST_STEPS) };
    if point.at[5] > 0.0 {
        (steps[5], steps[6]) = (0.1 * point.at[5], 0.2 * point.at[6]);
    }
    if point.at[9] > 0.0 {
        (steps[7], steps[8], steps[9]) = (TIME_STEP, TIME_STEP, LAG_STEP);
    }
    steps
}

/// Numbers of the parameters that belong to the curve: dead bands and hysteresis.
const CURVE: [usize; 3] = [2, 3, 4];

/// First steps of a search of the curve alone.
fn curve_steps(point: &Point) -> Parameters {
    let (mut steps, all) = ([0.0; 12], first_steps(point));
    CURVE.iter().for_each(|number| steps[*number] = all[*number]);
    steps
}

/// The search for the shape that explains the fitted part of a record best.
#[derive(Clone, Copy)]
struct Search<'a> {
    fitted: Data<'a>,
    /// What the record holds at most.
    seen: Seen,
    /// First steps from a point.
    steps: fn(&Point) -> Parameters,
}

impl<'a> Search<'a> {
    /// This search, on the part of the record that ends before sample `end`.
    fn to_end(self, end: usize) -> Self {
        Self { fitted: Data { end, ..self.fitted }, ..self }
    }

    /// A point, with what its model explains of the rest of the record.
    fn judged(&self, point: Point, rest: &Data<'_>) -> Result<Candidate<'a>, AnalysisError> {
        let (model, beside) = self.beyond_flat_begin(point)?;
        let (explained, squares) = rest.judge(&model, &beside, JUDGED_AHEAD);
        Ok(Candidate { search: *self, point, explained, squares })
    }

    /// The best point with a start of the oil.
    fn with_start(&self, without: Point) -> Point {
        let begin = |at: &mut Parameters, [extend, retract]: [f64; 2]| {
            (at[7], at[8], at[9]) = (extend, retract, FIRST_LAG);
        };
        self.with_directions(without, &FIRST_TIMES, begin, first_steps)
    }

    /// The best point with loads that overrun the axis.
    fn with_overrun(&self, without: Point) -> Point {
        let begin = |at: &mut Parameters, [extend, retract]: [f64; 2]| (at[10], at[11]) = (extend, retract);
        let steps = |point: &Point| {
            let mut steps = first_steps(point);
            (steps[10], steps[11]) = (0.3 * point.at[10], 0.3 * point.at[11]);
            steps
        };
        self.with_directions(without, &FIRST_OVERRUNS, begin, steps)
    }

    /// The best point with something that differs by direction: `begin` puts it in, with `first` as the values that its
    /// search begins from. The search without it may have found a dead band that is too wide.
    fn with_directions(
        &self,
        without: Point,
        first: &[f64],
        begin: impl Fn(&mut Parameters, [f64; 2]),
        steps: impl Fn(&Point) -> Parameters,
    ) -> Point {
        let mut best = Point { cost: f64::INFINITY, ..without };
        for values in first.iter().flat_map(|extend| first.iter().map(|retract| [*extend, *retract])) {
            for part in [0.0, 0.5, 1.0] {
                let mut at = without.at;
                let least = at[2].min(at[3]);
                (at[2], at[3]) = (at[2] - part * (at[2] - least), at[3] - part * (at[3] - least));
                begin(&mut at, values);
                let cost = self.cost(&at);
                best = if cost < best.cost { Point { at, cost } } else { best };
            }
        }
        (0..SEARCHES).fold(best, |point, _| self.refined(point, steps(&point)))
    }

    /// Mean square error of the differences with the best curve of this shape, m2.
    fn cost(&self, p: &Parameters) -> f64 {
        let shape = Shape::of(p, &self.seen);
        shape.filter(|shape| shape.is_allowed(&self.seen)).map_or(f64::INFINITY, |shape| self.fitted.fit(&shape).0)
    }

    /// The best point of the grids and of the searches from there: without hysteresis, or with one that explains
    /// clearly more.
    fn best(&self) -> Result<Point, AnalysisError> {
        let mut without = self.on_grids();
        for _ in 0..SEARCHES {
            without = self.refined(without, without_hysteresis(FIRST_STEPS));
        }
        if !without.cost.is_finite() {
            return Err(AnalysisError::NoMotion);
        }
        let starts = [without, self.with_some_hysteresis(without)].map(|start| self.refined(start, FIRST_STEPS));
        let with = if starts[1].cost < starts[0].cost { starts[1] } else { starts[0] };
        let stiff = if with.cost < CLEARLY_BETTER * without.cost { with } else { without };
        let mut start = stiff;
        // A swing that was seen is one that the model has.
        let seen = self.fitted.record.swing;
        let (period, better) = if seen > 0.0 { (seen, f64::INFINITY) } else { (FIRST_PERIOD, CLEARLY_BETTER) };
        (start.at[5], start.at[6]) = (period, FIRST_DAMPING);
        let mut steps = first_steps(&stiff);
        (steps[5], steps[6]) = (0.2 * period, 0.5 * FIRST_DAMPING);
        let sprung = self.refined(self.refined(start, steps), steps);
        if sprung.cost >= better * stiff.cost {
            return Ok(stiff);
        }
        Ok(if sprung.at[4] == 0.0 { self.with_hysteresis(sprung) } else { sprung })
    }

    /// The best point of a search of the curve alone, with a hysteresis where that explains clearly more.
    fn curved(&self, start: Point) -> Point {
        let found = self.searched(start);
        if found.at[4] > 0.0 {
            return found;
        }
        let with = self.searched(self.with_some_hysteresis(found));
        if with.cost < CLEARLY_BETTER * found.cost { with } else { found }
    }

    /// A point with a spring, and with a hysteresis where that explains better: what a swing covers shows beside its
    /// spring only.
    fn with_hysteresis(&self, sprung: Point) -> Point {
        let start = self.with_some_hysteresis(sprung);
        let with = (0..SEARCHES).fold(start, |point, _| self.refined(point, first_steps(&start)));
        // The same search without it, so that only the hysteresis makes a difference.
        let without = self.refined(sprung, first_steps(&sprung));
        if with.cost < BETTER * without.cost { with } else { without }
    }

    /// The best point of a grid of hystereses. A play shifts the commands that move the axis, so the dead bands are
    /// narrower by parts of it.
    fn with_some_hysteresis(&self, without: Point) -> Point {
        let mut best = Point { cost: f64::INFINITY, ..without };
        for width in FIRST_HYSTERESES {
            for part in [0.0, 0.5, 1.0] {
                let mut at = without.at;
                let narrower = |dead_band: f64| (dead_band - part * width).max(0.0);
                (at[2], at[3], at[4]) = (narrower(at[2]), narrower(at[3]), width);
                let cost = self.cost(&at);
                best = if cost < best.cost { Point { at, cost } } else { best };
            }
        }
        best
    }

    /// The best point from `start` with the first steps of this search.
    fn searched(&self, start: Point) -> Point {
        self.refined(start, (self.steps)(&start))
    }

    /// The best point of a search from `start` with these first steps.
    fn refined(&self, start: Point, steps: Parameters) -> Point {
        let (at, cost) = minimum(|p| self.cost(p), start.at, steps, SEARCH_STEPS);
        Point { at, cost }
    }

    /// The model of this point, and what is beside it.
    fn model_at(&self, p: &Parameters) -> Result<(Commissioned, Beside), AnalysisError> {
        let shape = Shape::of(p, &self.seen).ok_or(AnalysisError::NoMotion)?;
        let unknowns = self.fitted.fit(&shape).1;
        Ok((shape.model(&unknowns).ok_or(AnalysisError::NoMotion)?, Beside::of(&shape, &unknowns)))
    }

    /// The best point of a grid of dead time and time constant, and then of a grid of each dead band.
    fn on_grids(&self) -> Point {
        let mut best = Point { at: [0.0; 12], cost: f64::INFINITY };
        let try_one = |at: Parameters, best: &mut Point| {
            let cost = self.cost(&at);
            if cost < best.cost {
                *best = Point { at, cost };
            }
        };
        let on_grid = |largest: f64, i: i32| largest * f64::from(i) / f64::from(GRID_STEPS);
        for tau in TIME_CONSTANTS {
            for i in 0..=LONGEST_STEPS {
                let mut at = [0.0; 12];
                (at[0], at[1], at[6]) = (on_grid(LONG_DEAD_TIME, i), tau.ln(), FIRST_DAMPING);
                try_one(at, &mut best);
            }
        }
        for sides in [&[2, 3][..], &[2], &[3]] {
            let from = best.at;
            for i in 1..GRID_STEPS {
                let mut at = from;
                sides.iter().for_each(|side| at[*side] = on_grid(self.seen.largest(), i));
                try_one(at, &mut best);
            }
        }
        best
    }

    /// The model at the best point, or at one with wider dead bands. A curve that begins flat can do without a dead
    /// band and explain as much; the point with the dead band is preferred.
    fn beyond_flat_begin(&self, best: Point) -> Result<(Commissioned, Beside), AnalysisError> {
        let (mut model, mut beside) = self.model_at(&best.at)?;
        for _ in 0..FLAT_STEPS {
            let flat = |speeds: &[f64]| {
                let still = speeds.partition_point(|speed| *speed < FLAT * speeds[KNOTS - 1]);
                still.checked_sub(1).map_or(0.0, |last| model.openings[last])
            };
            let beyond = [flat(&model.speeds_extend), flat(&model.speeds_retract)];
            let DeadBand { extend, retract } = model.dead_band;
            let half = 0.5 * model.hysteresis;
            let mut start = best.at;
            (start[0], start[2], start[3]) = (model.dead_time, extend - half + beyond[0], retract - half + beyond[1]);
            if beyond == [0.0; 2] {
                break;
            }
            let steps = if best.at[4] > 0.0 { FINE_STEPS } else { without_hysteresis(FINE_STEPS) };
            let (p, cost) = minimum(|p| self.cost(p), start, steps, SEARCH_STEPS);
            if cost > AS_GOOD * best.cost {
                break;
            }
            (model, beside) = self.model_at(&p)?;
        }
        Ok((model, beside))
    }
}
