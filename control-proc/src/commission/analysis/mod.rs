//! From the record of an experiment to the model of the axis.
//!
//! ```text
//! tau dX/dt + X = u(t)           x(t) = X(t - t_d)
//! y(k+m) - y(k) = sum_j w_j (C_j(k+m) - C_j(k)) + e        C_j(t) = integral of max(0, x - d_e - q_j) up to t
//!                 - the same of max(0, -x - d_r - q_j)
//! min over (t_d, tau, d_e, d_r) of the least squares over w
//! ```
//!
//! u command and x spool position in [-1, 1], y position m, t_d dead time s, tau time constant s, d_e and d_r dead bands,
//! q_j openings at which the curve bends, w_j changes of its slope m/s, m T = 0.2 s. For a given (t_d, tau, d_e, d_r) all is
//! linear; a dead time delays X exactly, so one response serves all of them. The search begins on a grid (t_d, tau) with
//! d = 0, then d on a grid, then [`simplex`] on all four.
//!
//! Fitted on the first two thirds of the record, judged on the rest: half a second ahead, with the command known.
//!
//! Traps: t_d and tau trade off against each other where the plant is not a lag of first order (a mass on oil, say); what
//! is certain is their sum. A hysteresis of width h is half in the dead bands, d + h/2. And where an S begins flat the band
//! found ends where motion begins to count, not where the first drop flows.

pub mod simplex;

use nalgebra::{DMatrix, DVector};
use pipeline::machine::{Commissioned, DeadBand};

use simplex::minimum;

use super::ExperimentRecord;

/// Where the curve bends, in parts of the largest opening.
const BENDS: [f64; KNOTS] = [0.0, 0.1, 0.22, 0.38, 0.58, 0.8];
/// Bends of either direction.
const KNOTS: usize = 6;
/// Parts of a period in which the lag and the hinges are integrated.
const PARTS: usize = 4;
/// Length of the differences that are fitted, s.
const FITTED_AHEAD: f64 = 0.2;
/// How far ahead the model is judged, s.
const JUDGED_AHEAD: f64 = 0.5;
/// Part of the record that is fitted.
const FITTED_PART: f64 = 2.0 / 3.0;
/// Rows that are not used between two that are, s.
const ROW_SPACING: f64 = 0.03;
/// Longest dead time that is looked for, s.
const LONGEST_DEAD_TIME: f64 = 0.8;
/// Time constants of the grid, s.
const TIME_CONSTANTS: [f64; 3] = [0.03, 0.1, 0.25];
/// Weight of bends, relative to the data: the curve is as straight as they allow. Without it a curve that begins flat
/// would do without a dead band.
const STRAIGHTNESS: f64 = 1e-4;
/// Part of the largest speed below which a curve is flat.
const FLAT: f64 = 0.03;
/// How often a flat begin is left.
const FLAT_STEPS: usize = 3;
/// Mean square error, relative to the least found, of a curve with a wider dead band that is taken in its place.
const AS_GOOD: f64 = 1.1;
/// Steps of the search.
const SEARCH_STEPS: usize = 250;
/// Least rise of a curve from point to point, m/s: it can be inverted.
const LEAST_RISE: f64 = 1e-6;

/// Why a record has no model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AnalysisError {
    /// Too little of it.
    #[error("record: found {found:.1} s; allowed: at least {needed:.1} s")]
    TooShort {
        /// s.
        found: f64,
        /// s.
        needed: f64,
    },
    /// Nothing in it moves.
    #[error("record: found no motion that follows the commands in both directions")]
    NoMotion,
}

/// The model that explains a record.
///
/// # Errors
/// The record is too short, or no model with rising curves explains it.
pub fn analyse(record: &ExperimentRecord) -> Result<Commissioned, AnalysisError> {
    let seconds = record.positions.len() as f64 * record.period;
    let needed = 10.0 * JUDGED_AHEAD;
    if seconds < needed {
        return Err(AnalysisError::TooShort { found: seconds, needed });
    }
    let split = (record.positions.len() as f64 * FITTED_PART) as usize;
    let fitted = Data { record, begin: 0, end: split };
    let largest = record.commands.iter().fold(0.0f64, |largest, command| largest.max(command.abs()));
    let cost = |p: &[f64; 4]| {
        let shape = Shape::of(p, largest);
        shape.filter(Shape::is_allowed).map_or(f64::INFINITY, |shape| fitted.fit(&shape).0)
    };
    let mut best = ([0.0; 4], f64::INFINITY);
    let try_one = |p: [f64; 4], best: &mut ([f64; 4], f64)| {
        let value = cost(&p);
        if value < best.1 {
            *best = (p, value);
        }
    };
    for tau in TIME_CONSTANTS {
        for dead_time in (0..=20).map(|i| LONGEST_DEAD_TIME * f64::from(i) / 20.0) {
            try_one([dead_time, tau.ln(), 0.0, 0.0], &mut best);
        }
    }
    for side in [2, 3] {
        let from = best.0;
        for i in 1..20 {
            let mut p = from;
            p[side] = largest * f64::from(i) / 20.0;
            try_one(p, &mut best);
        }
    }
    // Once more from where the first search ends: a simplex can collapse early.
    for _ in 0..2 {
        best = minimum(cost, best.0, [0.02, 0.4, 0.02, 0.02], SEARCH_STEPS);
    }
    if !best.1.is_finite() {
        return Err(AnalysisError::NoMotion);
    }
    let model_at = |p: &[f64; 4]| {
        let shape = Shape::of(p, largest)?;
        shape.model(&fitted.fit(&shape).1)
    };
    let mut model = model_at(&best.0).ok_or(AnalysisError::NoMotion)?;
    // A curve that begins flat does without a dead band, and explains as much: the valley beside it is the one.
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
        let (p, value) = minimum(cost, start, [0.002, 0.05, 0.005, 0.005], SEARCH_STEPS);
        if value > AS_GOOD * best.1 {
            break;
        }
        model = model_at(&p).ok_or(AnalysisError::NoMotion)?;
    }
    model.fit_percent = Data { record, begin: split, end: record.positions.len() }.judge(&model);
    Ok(model)
}

/// What the search changes.
#[derive(Debug, Clone, Copy)]
struct Shape {
    dead_time: f64,
    time_constant: f64,
    dead_band: DeadBand,
    /// Largest opening.
    span: f64,
}

impl Shape {
    fn of(p: &[f64; 4], largest: f64) -> Option<Self> {
        let span = largest - p[2].min(p[3]);
        let dead_band = DeadBand { extend: p[2], retract: p[3] };
        (span > 0.0).then_some(Self { dead_time: p[0], time_constant: p[1].exp(), dead_band, span })
    }

    fn is_allowed(&self) -> bool {
        (0.0..=LONGEST_DEAD_TIME).contains(&self.dead_time)
            && (1e-3..=2.0).contains(&self.time_constant)
            && (0.0..=0.9).contains(&self.dead_band.extend)
            && (0.0..=0.9).contains(&self.dead_band.retract)
    }

    /// The curve from its changes of slope; none where a direction does not move its way.
    fn model(&self, slopes: &DVector<f64>) -> Option<Commissioned> {
        let openings: Vec<f64> = BENDS[1..].iter().chain(&[1.0]).map(|part| part * self.span).collect();
        let speeds = |side: usize| {
            let mut last = 0.0;
            let at = |opening: f64| -> f64 {
                let bends = BENDS.iter().enumerate();
                bends.map(|(j, part)| slopes[side * KNOTS + j] * (opening - part * self.span).max(0.0)).sum()
            };
            let speeds: Vec<f64> = (openings.iter())
                .map(|opening| {
                    last = at(*opening).max(last + LEAST_RISE);
                    last
                })
                .collect();
            (last > 1e-3).then_some(speeds)
        };
        Some(Commissioned {
            dead_time: self.dead_time,
            time_constant: self.time_constant,
            dead_band: self.dead_band,
            speeds_extend: speeds(0)?,
            speeds_retract: speeds(1)?,
            openings,
            fit_percent: f64::NAN,
        })
    }
}

/// A part of a record.
struct Data<'a> {
    record: &'a ExperimentRecord,
    begin: usize,
    end: usize,
}

impl Data<'_> {
    /// Mean square error of the differences, and the changes of slope that make it least.
    fn fit(&self, shape: &Shape) -> (f64, DVector<f64>) {
        const COUNT: usize = 2 * KNOTS;
        let period = self.record.period;
        let bends = BENDS.map(|part| part * shape.span);
        let integrals = integrate(self.record, self.end, shape.time_constant, |x| {
            let mut hinges = [0.0; COUNT];
            let (side, sign, beyond) =
                if x > 0.0 { (0, 1.0, x - shape.dead_band.extend) } else { (1, -1.0, -x - shape.dead_band.retract) };
            for (hinge, bend) in hinges[side * KNOTS..].iter_mut().zip(&bends) {
                if beyond <= *bend {
                    break;
                }
                *hinge = sign * (beyond - bend);
            }
            hinges
        });
        let mut matrix = [[0.0; COUNT]; COUNT];
        let (mut right, mut square, mut rows) = ([0.0; COUNT], 0.0, 0usize);
        let ahead = samples(FITTED_AHEAD, period);
        for k in (self.begin..self.end.saturating_sub(ahead)).step_by(samples(ROW_SPACING, period)) {
            let way = self.record.positions[k + ahead] - self.record.positions[k];
            if way.is_nan() {
                continue;
            }
            let [from, to] = [k, k + ahead].map(|k| delayed(&integrals, k, shape.dead_time, period));
            let row: [f64; COUNT] = std::array::from_fn(|j| to[j] - from[j]);
            for i in 0..COUNT {
                if row[i] != 0.0 {
                    right[i] += row[i] * way;
                    for j in i..COUNT {
                        matrix[i][j] += row[i] * row[j];
                    }
                }
            }
            square += way * way;
            rows += 1;
        }
        let scale = STRAIGHTNESS * matrix[0][0].max(matrix[KNOTS][KNOTS]);
        let normal = DMatrix::from_fn(COUNT, COUNT, |i, j| {
            let weight = if i != j || i.is_multiple_of(KNOTS) { 0.0 } else { scale };
            matrix[i.min(j)][i.max(j)] + weight + if i == j { f64::MIN_POSITIVE } else { 0.0 }
        });
        let right = DVector::from_row_slice(&right);
        let Some(solver) = normal.cholesky() else { return (f64::INFINITY, right) };
        let slopes = solver.solve(&right);
        ((square - slopes.dot(&right)) / rows.max(1) as f64, slopes)
    }

    /// How much of the motion the model explains ahead, percent.
    fn judge(&self, model: &Commissioned) -> f64 {
        let period = self.record.period;
        let integrals = integrate(self.record, self.end, model.time_constant, |x| [model.speed(x)]);
        let ahead = samples(JUDGED_AHEAD, period);
        let (mut error, mut motion) = (0.0, 0.0);
        for k in self.begin..self.end.saturating_sub(ahead) {
            let way = self.record.positions[k + ahead] - self.record.positions[k];
            if way.is_nan() {
                continue;
            }
            let [[from], [to]] = [k, k + ahead].map(|k| delayed(&integrals, k, model.dead_time, period));
            error += (way - (to - from)).powi(2);
            motion += way * way;
        }
        100.0 * (1.0 - (error / motion).sqrt())
    }
}

/// Samples of a time, at least one.
fn samples(seconds: f64, period: f64) -> usize {
    ((seconds / period).round() as usize).max(1)
}

/// The integral of `f(X(t))` at every part of a period up to sample `end`.
fn integrate<const N: usize>(
    record: &ExperimentRecord,
    end: usize,
    time_constant: f64,
    f: impl Fn(f64) -> [f64; N],
) -> Vec<[f64; N]> {
    let step = record.period / PARTS as f64;
    let decay = (-step / time_constant).exp();
    let mut integrals = Vec::with_capacity(end * PARTS + 1);
    let (mut x, mut integral) = (0.0, [0.0; N]);
    let mut before = f(x);
    integrals.push(integral);
    for command in &record.commands[..end] {
        for _ in 0..PARTS {
            x = command + (x - command) * decay;
            let now = f(x);
            for (integral, (before, now)) in integral.iter_mut().zip(before.iter().zip(&now)) {
                *integral += 0.5 * step * (before + now);
            }
            before = now;
            integrals.push(integral);
        }
    }
    integrals
}

/// An integral at sample `k`, one dead time (s) earlier.
fn delayed<const N: usize>(integrals: &[[f64; N]], k: usize, dead_time: f64, period: f64) -> [f64; N] {
    let at = (k as f64 - dead_time / period) * PARTS as f64;
    if at <= 0.0 {
        return [0.0; N];
    }
    let whole = at as usize;
    let part = at - whole as f64;
    let (low, high) = (&integrals[whole.min(integrals.len() - 1)], &integrals[(whole + 1).min(integrals.len() - 1)]);
    std::array::from_fn(|j| low[j] + part * (high[j] - low[j]))
}
