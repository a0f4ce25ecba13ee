//! Time of one update of recursive least squares, ours and others', on the same rows in the same run.
//!
//! `cargo bench --bench peers`; `--quick` for a short run, `--json FILE` for programs; `benches/peers.py` measures
//! peers in Python. All contestants take turns, so that a busy computer disturbs all of them equally; one sample is the
//! mean of 64 updates in a row. The floors are no estimators ([`floors`]). Ratios are to the faster floor, and to
//! [`RecursiveLeastSquares`], on which all of our estimators are built. At the end a whole axis is timed, sample by
//! sample ([`axis`]).

mod arguments;
mod axis;
mod contest;
mod data;
mod floors;
mod report;

use std::{array::from_fn, hint::black_box};

use flight_solver::{cls::VecN, rls::InverseQrRls};
use ident_proc::{estimator::RecursiveEstimator, least_squares::Triangle, recursive::RecursiveLeastSquares};
use nalgebra::{DMatrix, DVector, DVectorView, SMatrix, SVector};
use pipeline::machine::Fuzzy;
use serde_json::{Value, json};

use arguments::Arguments;
use contest::head;
use floors::{Packed, Tiles};

const LAMBDA: f64 = 0.995;
/// Updates per timed sample.
const BATCH: usize = 64;
/// Number of floors, which are the first contestants.
const FLOORS: usize = 2;
/// Settings of all estimators that consist of one recursion.
const ESTIMATORS: [&str; 7] =
    ["constant:0.995", "paper", "rules", "fuzzy:0.95", "fortescue:500", "directional:0.99", "window:500"];
/// Samples from which our estimators start, as after a training.
const START: usize = 200;
const OURS: &str = "RecursiveLeastSquares";
const FLIGHT_SOLVER: &str = "flight-solver QR, f32";
/// Initial covariance of the contestants that start without samples; forgotten long before the first timed sample.
const VAGUE: f64 = 100.0;

/// One row of the regression in the types of all contestants.
struct Row<const N: usize> {
    phi: SVector<f64, N>,
    y: f64,
    /// phi in blocks of four, padded with zeros.
    blocks: Vec<[f64; 4]>,
    phi_f32: VecN<N>,
    y_f32: VecN<1>,
}

/// Subject of a contestant.
trait Learner<const N: usize> {
    fn learn(&mut self, rows: &[Row<N>]);
    fn learned(&self) -> Vec<f64>;
}

/// A learner that consists of its state, a function that learns from a row, and one that returns the coefficients.
impl<const N: usize, S, R, U: FnMut(&mut S, &Row<N>) -> R, T: Fn(&S) -> Vec<f64>> Learner<N> for (S, U, T) {
    fn learn(&mut self, rows: &[Row<N>]) {
        for row in rows {
            black_box(self.1(&mut self.0, black_box(row)));
        }
    }

    fn learned(&self) -> Vec<f64> {
        self.2(&self.0)
    }
}

/// A learner, and how far its coefficients may differ from ours at the end.
struct Subject<const N: usize> {
    learner: Box<dyn Learner<N>>,
    tolerance: f64,
}

type Contestant<const N: usize> = contest::Contestant<Subject<N>>;

/// Tolerance of the contestants that have our memory, 1/(1 - lambda) samples.
const TOLERANCE: f64 = 1e-3;
/// Tolerance of estimators with another memory, which averages another part of the noise.
const ESTIMATOR_TOLERANCE: f64 = 0.02;

fn contestant<const N: usize, S: 'static, R: 'static>(
    name: &'static str,
    state: S,
    update: impl FnMut(&mut S, &Row<N>) -> R + 'static,
    learned: impl Fn(&S) -> Vec<f64> + 'static,
) -> Contestant<N> {
    contest::Contestant::new(name, Subject { learner: Box::new((state, update, learned)), tolerance: TOLERANCE })
}

/// All contestants: first the two floors, then ours, then the others.
fn contestants<const N: usize>(rows: &[Row<N>]) -> Vec<Contestant<N>> {
    let mut data = Triangle::new(N);
    rows.iter().take(START).for_each(|row| data.add(row.phi.as_slice(), row.y));
    let mut ours = RecursiveLeastSquares::new(N);
    ours.start(&data, &[false; N]);
    let mut all = vec![
        contestant::<N, _, _>("floor, packed", Packed::new(N), Packed::update, |s| s.p.clone()),
        contestant::<N, _, _>("floor, tiles of 4 x 4", Tiles::new(N), Tiles::update, Tiles::all),
        contestant::<N, _, _>(OURS, ours, |s, row| s.update(row.phi.as_slice(), row.y, LAMBDA), |s| s.theta().to_vec()),
    ];
    all.extend(ESTIMATORS.map(|setting| estimator(setting, &data)));
    let qr = InverseQrRls::<N, 1>::new(VAGUE as f32, LAMBDA as f32);
    all.extend([
        contestant::<N, _, _>("nalgebra DMatrix", Dynamic::new(N), Dynamic::update, |s| s.theta.as_slice().to_vec()),
        contestant::<N, _, _>("nalgebra SMatrix", Static::new(), Static::update, |s| s.theta.as_slice().to_vec()),
        contestant::<N, _, _>(
            FLIGHT_SOLVER,
            qr,
            |s, row| s.update(&row.phi_f32, &row.y_f32),
            |s| s.params().iter().map(|&value| value.into()).collect(),
        ),
    ]);
    all
}

/// The estimator with the setting `setting`.
fn estimator<const N: usize>(setting: &'static str, data: &Triangle) -> Contestant<N> {
    let sigma = (data.residual() / (START - N) as f64).sqrt();
    let mut estimator = RecursiveEstimator::new(setting.parse().expect("a setting"), N, &Fuzzy::RESIDUALS);
    estimator.start(data, &[false; N], sigma);
    let update = |s: &mut RecursiveEstimator, row: &Row<N>| s.update(row.phi.as_slice(), row.y);
    let mut contestant = contestant(setting, estimator, update, |s| s.theta().to_vec());
    contestant.subject.tolerance = ESTIMATOR_TOLERANCE;
    contestant
}

/// Equations (18)-(20) in nalgebra with sizes known at run time, without allocation. Mirroring keeps P symmetric.
struct Dynamic {
    theta: DVector<f64>,
    p: DMatrix<f64>,
    gain: DVector<f64>,
}

impl Dynamic {
    fn new(n: usize) -> Self {
        Self { theta: DVector::zeros(n), p: DMatrix::identity(n, n) * VAGUE, gain: DVector::zeros(n) }
    }

    fn update<const N: usize>(&mut self, row: &Row<N>) {
        let phi = DVectorView::from_slice(row.phi.as_slice(), self.theta.len());
        self.gain.gemv(1.0, &self.p, &phi, 0.0);
        let beta = LAMBDA + phi.dot(&self.gain);
        let innovation = row.y - phi.dot(&self.theta);
        self.theta.axpy(innovation / beta, &self.gain, 1.0);
        self.p.ger(-1.0 / (beta * LAMBDA), &self.gain, &self.gain, 1.0 / LAMBDA);
        self.p.fill_lower_triangle_with_upper_triangle();
    }
}

/// Equations (18)-(20) in nalgebra with sizes known at compile time.
struct Static<const N: usize> {
    theta: SVector<f64, N>,
    p: SMatrix<f64, N, N>,
}

impl<const N: usize> Static<N> {
    fn new() -> Self {
        Self { theta: SVector::zeros(), p: SMatrix::identity() * VAGUE }
    }

    fn update(&mut self, row: &Row<N>) {
        let gain = self.p * row.phi;
        let beta = LAMBDA + row.phi.dot(&gain);
        let innovation = row.y - row.phi.dot(&self.theta);
        self.theta.axpy(innovation / beta, &gain, 1.0);
        self.p.ger(-1.0 / (beta * LAMBDA), &gain, &gain, 1.0 / LAMBDA);
        self.p.fill_lower_triangle_with_upper_triangle();
    }
}

/// 1024 rows with N coefficients.
fn rows<const N: usize>() -> Vec<Row<N>> {
    let rows = data::rows(N).into_iter().map(|(phi, y)| Row {
        phi: SVector::from_column_slice(&phi),
        y,
        blocks: phi.chunks(4).map(|chunk| from_fn(|i| chunk.get(i).copied().unwrap_or(0.0))).collect(),
        phi_f32: VecN::from_iterator(phi.iter().map(|&p| p as f32)),
        y_f32: VecN::from_element(y as f32),
    });
    rows.collect()
}

/// Times all contestants with N coefficients; prints their table and returns it.
fn compare<const N: usize>(samples: usize) -> Vec<Value> {
    let rows = rows::<N>();
    let mut contestants = contestants(&rows);
    let count = contestants.len();
    contestants.iter_mut().for_each(|contestant| (0..4).for_each(|_| contestant.subject.learner.learn(&rows)));
    for round in 0..samples {
        let batch = &rows[round * BATCH % rows.len()..][..BATCH];
        for turn in 0..count {
            contestants[(round + turn) % count].time(BATCH, |subject| subject.learner.learn(batch));
        }
    }
    let (floors, estimators) = contestants.split_at(FLOORS);
    assert!(floors.iter().all(|floor| floor.subject.learner.learned().iter().all(|p| p.is_finite())));
    let theta = estimators[0].subject.learner.learned();
    for contest::Contestant { name, subject, .. } in &estimators[1..] {
        let other = subject.learner.learned();
        let difference = theta.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(difference < subject.tolerance, "coefficients of {name} differ by {difference}");
    }
    table(contestants)
}

fn table<const N: usize>(contestants: Vec<Contestant<N>>) -> Vec<Value> {
    head(&format!("n = {N}"), "    / floor     / ours");
    let all: Vec<_> = contestants.into_iter().map(contest::Contestant::figures).collect();
    let floor = all[..FLOORS].iter().map(|(_, figures)| figures.p50).fold(f64::INFINITY, f64::min);
    let ours = all[FLOORS].1.p50;
    let figures = all.iter().map(|(name, figures)| {
        let (to_floor, to_ours) = (figures.p50 / floor, figures.p50 / ours);
        figures.print(name);
        println!(" {to_floor:>10.2} {to_ours:>10.2}");
        let mut json = figures.json(name);
        json["n"] = json!(N);
        json["updates_per_sample"] = json!(BATCH);
        json["to_floor"] = json!(to_floor);
        json["to_ours"] = json!(to_ours);
        json
    });
    figures.collect()
}

/// The figure `key` of `name` at `n`.
fn figure(figures: &[Value], n: usize, name: &str, key: &str) -> f64 {
    let found = figures.iter().find(|figure| figure["n"] == n && figure["name"] == name);
    found.and_then(|figure| figure[key].as_f64()).unwrap_or(f64::NAN)
}

fn main() {
    let arguments = Arguments::read(&[]);
    let (samples, axis_samples) = if arguments.quick { (50, 500) } else { (10_000, 10_000) };
    let before = report::load();
    let figures = [compare::<5>(samples), compare::<15>(samples), compare::<40>(samples)].concat();
    let between = report::load();
    println!(
        "\nper update; one sample is the mean of {BATCH}; ratios of p50; load {before} before, {between} after\n\
         at n = 15: {:.2} x the packed floor (aim: at most 3.5), {:.2} x the faster one; {:.1} x as fast as \
         flight-solver's QR form (aim: at least 4)",
        1.0 / figure(&figures, 15, "floor, packed", "to_ours"),
        figure(&figures, 15, OURS, "to_floor"),
        figure(&figures, 15, FLIGHT_SOLVER, "to_ours"),
    );
    let axis = axis::compare(axis_samples);
    let after = report::load();
    let auto = axis.iter().find(|figure| figure["name"] == axis::AUTO).and_then(|figure| figure["p50_ns"].as_f64());
    println!(
        "\nper sample, each timed alone; load {between} before, {after} after\n\
         auto: {:.2} us p50 (aim: auto under 3 us p50)",
        auto.unwrap_or(f64::NAN) * 1e-3,
    );
    let all = json!({"load": [before, between, after], "figures": figures, "axis": axis});
    report::write(arguments.json.as_deref(), &all);
}
