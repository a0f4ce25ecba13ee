//! The curve that explains a part of a record best for a given shape, and how well a model predicts a part.

use nalgebra::{DMatrix, DVector};
use pipeline::machine::{Commissioned, Overrun};

use super::{
    shape::{BENDS, KNOTS, Shape},
    spring::Spring,
    start::Start,
    weights::Weights,
};
use crate::commission::record::ExperimentRecord;

/// Time in which the lag and the hinges are integrated, s: a part of a period, and the whole of a shorter one.
const STEP: f64 = 2.5e-3;
/// Length of the differences that are fitted, s.
const FITTED_AHEAD: f64 = 0.2;
/// Time from the begin of a motion on after which its pace counts, s, and length of the ways that are compared, s.
const SETTLED: f64 = 0.8;
const PACED_AHEAD: f64 = 0.5;
/// Least motions that tell a pace, and least difference to 1 that is taken into a curve.
const LEAST_MOTIONS: usize = 3;
const LEAST_PACE: f64 = 0.03;
/// Spacing of the rows that are fitted, s.
const ROW_SPACING: f64 = 0.03;
/// Length of the blocks of a judgement, in times that it looks ahead.
const BLOCK: usize = 4;
/// Place of the drift among the unknowns, after the changes of slope of both directions: its part that is the same
/// everywhere, and its part that rises with the position.
const DRIFT: usize = 2 * KNOTS;
/// Unknowns.
const COUNT: usize = DRIFT + 2;

/// What is found together with a model and is no part of it: how an axis moves by itself, as its oil leaks under the
/// load, and how late it starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Beside {
    /// Speed of the drift at the first position of the record, m/s.
    speed: f64,
    /// Rise of that speed with the position, 1/s: a load with a spring.
    rise: f64,
    start: Start,
}

impl Beside {
    /// As this shape and the unknowns of [`Data::fit`] say.
    pub fn of(shape: &Shape, unknowns: &DVector<f64>) -> Self {
        Self { speed: unknowns[DRIFT], rise: unknowns[DRIFT + 1], start: shape.start }
    }

    /// Way of the drift in so many samples, m, between these two of [`places`].
    fn drifted(&self, count: f64, period: f64, [from, to]: [f64; 2]) -> f64 {
        self.speed * count * period + self.rise * (to - from)
    }
}

/// A part of a record.
#[derive(Clone, Copy)]
pub(super) struct Data<'a> {
    pub record: &'a ExperimentRecord,
    /// Of [`weights`]; all rows count the same without them.
    pub weights: Option<&'a Weights>,
    /// First sample.
    pub begin: usize,
    /// Sample after the last one.
    pub end: usize,
    /// Whether the axis may drift.
    pub drifts: bool,
    /// Weight of bends, relative to the data: the curve is as straight as they allow. Without this weight a curve that
    /// begins flat would do without a dead band.
    pub straightness: f64,
}

/// How much every row of [`Data::fit`] counts for an axis with this dead time and time constant, s.
pub(super) fn weights(record: &ExperimentRecord, dead_time: f64, time_constant: f64) -> Weights {
    Weights::of(record, samples(FITTED_AHEAD, record.period), dead_time, time_constant)
}

/// Normal equations of the weighted differences, as sums over the rows.
struct Normal {
    /// Upper triangle of the products of the regressors.
    matrix: [[f64; COUNT]; COUNT],
    /// Products of the regressors with the differences.
    right: [f64; COUNT],
    /// Sum of the squared differences, m2.
    square: f64,
    rows: usize,
}

impl Data<'_> {
    /// Mean square error of the weighted differences (m2), and the unknowns that make it least: the changes of slope
    /// and the drift.
    pub fn fit(&self, shape: &Shape) -> (f64, DVector<f64>) {
        let Normal { matrix, right, square, rows } = self.normal(shape);
        let scale = self.straightness * matrix[0][0].max(matrix[KNOTS][KNOTS]);
        let normal = DMatrix::from_fn(COUNT, COUNT, |i, j| {
            let is_bend = i == j && i < DRIFT && !i.is_multiple_of(KNOTS);
            let weight = if is_bend { scale } else { 0.0 };
            matrix[i.min(j)][i.max(j)] + weight + if i == j { f64::MIN_POSITIVE } else { 0.0 }
        });
        let right = DVector::from_row_slice(&right);
        let Some(solver) = normal.cholesky() else { return (f64::INFINITY, right) };
        let unknowns = solver.solve(&right);
        ((square - unknowns.dot(&right)) / rows.max(1) as f64, unknowns)
    }

    fn normal(&self, shape: &Shape) -> Normal {
        let period = self.record.period;
        let integrals = integrate(self.record, self.end, &Dynamics::of(shape), hinges(shape));
        let places = places(self.record, self.end);
        let mut normal = Normal { matrix: [[0.0; COUNT]; COUNT], right: [0.0; COUNT], square: 0.0, rows: 0 };
        let ahead = samples(FITTED_AHEAD, period);
        for k in (self.begin..self.end.saturating_sub(ahead)).step_by(samples(ROW_SPACING, period)) {
            let way = self.record.positions[k + ahead] - self.record.positions[k];
            if way.is_nan() {
                continue;
            }
            let [from, to] = [k, k + ahead].map(|k| &integrals[k]);
            let row = |j| match j {
                0..DRIFT => to[j] - from[j],
                _ if !self.drifts => 0.0,
                DRIFT => ahead as f64 * period,
                _ => places[k + ahead] - places[k],
            };
            let weight = self.weights.map_or(1.0, |weights| weights.at(k));
            let (way, row): (f64, [f64; COUNT]) = (weight * way, std::array::from_fn(|j| weight * row(j)));
            for i in 0..COUNT {
                if row[i] != 0.0 {
                    normal.right[i] += row[i] * way;
                    for j in i..COUNT {
                        normal.matrix[i][j] += row[i] * row[j];
                    }
                }
            }
            normal.square += way * way;
            normal.rows += 1;
        }
        normal
    }

    /// How much of the motion the model and what is beside it explain `seconds` ahead, percent; and the squares of what
    /// they leave unexplained, m2, summed over blocks that are long enough to be independent.
    pub fn judge(&self, model: &Commissioned, beside: &Beside, seconds: f64) -> (f64, Vec<f64>) {
        let period = self.record.period;
        let dynamics = Dynamics::of_model(model, beside.start);
        let integrals = integrate(self.record, self.end, &dynamics, speed(model));
        let places = places(self.record, self.end);
        let ahead = samples(seconds, period);
        let (begin, end) = (self.begin, self.end.saturating_sub(ahead).max(self.begin));
        let mut squares = vec![0.0; (end - begin).div_ceil(BLOCK * ahead)];
        let mut motion = 0.0;
        for k in begin..end {
            let way = self.record.positions[k + ahead] - self.record.positions[k];
            if way.is_nan() {
                continue;
            }
            let [[from], [to]] = [k, k + ahead].map(|k| integrals[k]);
            let drifted = beside.drifted(ahead as f64, period, [places[k], places[k + ahead]]);
            squares[(k - begin) / (BLOCK * ahead)] += (way - drifted - (to - from)).powi(2);
            motion += way * way;
        }
        (100.0 * (1.0 - (squares.iter().sum::<f64>() / motion).sqrt()), squares)
    }
}

/// How much faster than by `model` the axis is in the end of long motions, extending and retracting; 1 where the record
/// does not tell.
///
/// ```text
/// s = sum_j a_j / sum_j b_j        e^2 = n/(n-1) sum_j (a_j - s b_j)^2 / (sum_j b_j)^2        |s - 1| > max(2 e, 3 %)
/// ```
///
/// a_j and b_j are the sums of the products of the modelled way in half a second with the measured one and with itself,
/// over all such ways of motion j that begin [`SETTLED`] after the spool has left its dead band; n motions, e standard
/// error. A pump that has to raise its pressure first, and chambers that have to be filled, take way from the begin of
/// every motion. The steps of an experiment are short, so its curve lies too low by that.
pub(super) fn pace(data: &Data<'_>, model: &Commissioned, beside: &Beside) -> [f64; 2] {
    let (period, record) = (data.record.period, data.record);
    let integrals = integrate(record, data.end, &Dynamics::of_model(model, beside.start), speed(model));
    let places = places(record, data.end);
    let (ahead, settled) = (samples(PACED_AHEAD, period), samples(SETTLED, period));
    let late = (model.dead_time / period).round() as usize;
    let mut motions: [Vec<[f64; 2]>; 2] = [Vec::new(), Vec::new()];
    let (mut side, mut begin) = (None, 0);
    for end in 0..data.end {
        let command = end.checked_sub(late).map_or(0.0, |k| record.commands[k]);
        let now = match command {
            command if command > model.dead_band.extend => Some(0),
            command if command < -model.dead_band.retract => Some(1),
            _ => None,
        };
        if now != side {
            (side, begin) = (now, end);
        }
        let Some((side, from)) = side.zip(end.checked_sub(ahead)).filter(|(_, from)| *from >= begin + settled) else {
            continue;
        };
        if from == begin + settled {
            motions[side].push([0.0; 2]);
        }
        let way = record.positions[end] - record.positions[from];
        if way.is_nan() {
            continue;
        }
        let [[before], [after]] = [from, end].map(|k| integrals[k]);
        let drifted = beside.drifted(ahead as f64, period, [places[from], places[end]]);
        let modelled = after - before;
        if let Some([a, b]) = motions[side].last_mut() {
            *a += (way - drifted) * modelled;
            *b += modelled * modelled;
        }
    }
    motions.map(|motions| {
        let (ratio, error) = ratio(&motions);
        let shows = motions.len() >= LEAST_MOTIONS && (ratio - 1.0).abs() > f64::max(2.0 * error, LEAST_PACE);
        if shows { ratio } else { 1.0 }
    })
}

/// s and e.
fn ratio(motions: &[[f64; 2]]) -> (f64, f64) {
    let [a, b] = [0, 1].map(|k| motions.iter().map(|motion| motion[k]).sum::<f64>());
    let (count, ratio) = (motions.len() as f64, a / b);
    let squares: f64 = motions.iter().map(|[a, b]| (a - ratio * b).powi(2)).sum();
    (ratio, (count / (count - 1.0) * squares).sqrt() / b)
}

/// How far the axis has moved since the first sample, m, at every sample of a record, by a model of it.
pub fn modelled(record: &ExperimentRecord, model: &Commissioned) -> Vec<f64> {
    let end = record.positions.len();
    let integrals = integrate(record, end, &Dynamics::of_model(model, Start::NONE), speed(model));
    integrals[..end].iter().map(|[way]| *way).collect()
}

/// What is between a command and its motion, apart from the curve.
struct Dynamics {
    hysteresis: f64,
    /// s.
    time_constant: f64,
    spring: Spring,
    start: Start,
    overrun: Overrun,
    /// s.
    dead_time: f64,
}

impl Dynamics {
    fn of(shape: &Shape) -> Self {
        let Shape { hysteresis, time_constant, spring, start, overrun, dead_time, .. } = *shape;
        Self { hysteresis, time_constant, spring, start, overrun, dead_time }
    }

    fn of_model(model: &Commissioned, start: Start) -> Self {
        let spring = Spring::of_model(model);
        let Commissioned { hysteresis, dead_time, overrun, .. } = *model;
        Self { hysteresis, time_constant: model.time_constant - spring.delay(), spring, start, overrun, dead_time }
    }
}

/// max(0, x - d_e - q_j) and the mirrored terms, of x, and whether one of them is not 0.
fn hinges(shape: &Shape) -> impl Fn(f64, &mut [f64; DRIFT]) -> bool {
    let bends = BENDS.map(|part| part * shape.span);
    let dead_band = shape.dead_band;
    move |x, hinges| {
        let (side, sign, beyond) =
            if x > 0.0 { (0, 1.0, x - dead_band.extend) } else { (1, -1.0, -x - dead_band.retract) };
        hinges.fill(0.0);
        for (hinge, bend) in hinges[side * KNOTS..].iter_mut().zip(&bends) {
            *hinge = sign * (beyond - bend).max(0.0);
        }
        beyond > 0.0
    }
}

/// The speed of a model at x, and whether it is not 0.
fn speed(model: &Commissioned) -> impl Fn(f64, &mut [f64; 1]) -> bool {
    |x, [speed]| {
        *speed = model.spool_speed(x);
        *speed != 0.0
    }
}

/// The integral of the way from the first position (m s) at every sample before `end`. A position that is missing is
/// taken to be the one before.
fn places(record: &ExperimentRecord, end: usize) -> Vec<f64> {
    let mut usable = record.positions[..end].iter().copied().filter(|position| position.is_finite());
    let first = usable.next().unwrap_or_default();
    let (mut place, mut before) = (0.0, 0.0);
    let add = |position: &f64| {
        let way = if position.is_finite() { position - first } else { before };
        place += 0.5 * record.period * (before + way);
        before = way;
        place
    };
    record.positions[..end].iter().map(add).collect()
}

/// Samples of a time, at least one.
fn samples(seconds: f64, period: f64) -> usize {
    ((seconds / period).round() as usize).max(1)
}

/// The integral of `f` of X(t), up to every sample before `end` and up to it, one dead time earlier. `f` writes it, and
/// says whether it is not 0. A search spends most of its time here. Trap: arrays that are returned, or mapped, are
/// copied; with them this took three times as long.
fn integrate<const N: usize>(
    record: &ExperimentRecord,
    end: usize,
    dynamics: &Dynamics,
    f: impl Fn(f64, &mut [f64; N]) -> bool,
) -> Vec<[f64; N]> {
    let steps = ((record.period / STEP).round() as usize).max(1);
    let step = record.period / steps as f64;
    let decay = (-step / dynamics.time_constant).exp();
    let mut motion = dynamics.spring.motion(step);
    let mut pressure = dynamics.start.pressure(step);
    let (mut w, mut x, mut curve) = (0.0f64, 0.0, [0.0; N]);
    let play = 0.5 * dynamics.hysteresis;
    // The dead time ends `part` of a part of a period after one of them begins, which is the same for all samples.
    let parts = dynamics.dead_time / step;
    let (late, part) = (parts.ceil() as usize, parts.ceil() - parts);
    let mut integrals = Vec::with_capacity(end + 1);
    integrals.resize(late.div_ceil(steps).min(end + 1), [0.0; N]);
    let mut count = late;
    // A command moves the load of one dead time later.
    let ahead = (dynamics.dead_time / record.period).round() as usize;
    let loads = (0..).map(|k| record.loads.get(k + ahead).or(record.loads.last()).copied().unwrap_or_default());
    for (command, load) in record.commands[..end].iter().zip(loads) {
        let faster = dynamics.overrun.factors(load);
        w = w.clamp(command - play, command + play);
        for _ in 0..steps {
            x = w + (x - w) * decay;
            let is_open = f(x, &mut curve);
            let risen = pressure.advance(x, is_open);
            let faster = faster[usize::from(x < 0.0)];
            curve.iter_mut().for_each(|speed| *speed = risen * (faster * *speed));
            let curve = is_open.then_some(&curve);
            if count.is_multiple_of(steps) && integrals.len() <= end {
                let mut ways = *motion.ways();
                motion.advance(curve);
                for (way, now) in ways.iter_mut().zip(motion.ways()) {
                    *way += part * (now - *way);
                }
                integrals.push(ways);
            } else {
                motion.advance(curve);
            }
            count += 1;
        }
    }
    // Without a dead time the last sample is where the integral ends.
    integrals.resize(end + 1, *motion.ways());
    integrals
}
