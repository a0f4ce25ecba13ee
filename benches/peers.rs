//! What one update of recursive least squares costs, ours and others', on the same rows in the same run.
//!
//! `cargo bench --bench peers`; `--quick` for a short run, `--json FILE` for programs; `benches/peers.py` has the
//! Python peers. All contestants take turns, so that a busy machine disturbs all alike; one sample is the mean of
//! 64 updates in a row. The floors are no estimators: each is one pass P -= g g' s over a triangle, the least that any
//! update contains. Ratios are to the faster of the two.

mod data;

use std::{array::from_fn, fs, hint::black_box, path::PathBuf, time::Instant};

use clap::Parser;
use flight_solver::{cls::VecN, rls::InverseQrRls};
use ident_proc::{recursive::RecursiveLeastSquares, triangle::Triangle};
use nalgebra::{DMatrix, DVector, DVectorView, SMatrix, SVector};
use serde_json::{Value, json};

const LAMBDA: f64 = 0.995;
/// Updates per timed sample.
const BATCH: usize = 64;
/// Of the contestants, those at the front that are none.
const FLOORS: usize = 2;
/// Initial covariance of those that start from nothing; forgotten long before the first timed sample.
const VAGUE: f64 = 100.0;

#[derive(Parser)]
struct Arguments {
    /// Few samples: shows that everything works, not how fast.
    #[arg(long, visible_alias = "test")]
    quick: bool,
    /// Writes the figures here as well.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Sent by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// One row of the regression, in the types of all contestants.
struct Row<const N: usize> {
    phi: SVector<f64, N>,
    y: f64,
    /// phi, filled up with zeros.
    blocks: Vec<[f64; 4]>,
    phi_f32: VecN<N>,
    y_f32: VecN<1>,
}

/// What can be timed.
trait Learner<const N: usize> {
    fn learn(&mut self, rows: &[Row<N>]);
    fn learned(&self) -> Vec<f64>;
}

/// A learner made of its state, a function that takes a row in, and one that shows what has been learned.
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

struct Contestant<const N: usize> {
    name: &'static str,
    learner: Box<dyn Learner<N>>,
    times: Vec<f64>,
}

impl<const N: usize> Contestant<N> {
    fn new<S: 'static, R: 'static>(
        name: &'static str,
        state: S,
        update: impl FnMut(&mut S, &Row<N>) -> R + 'static,
        learned: impl Fn(&S) -> Vec<f64> + 'static,
    ) -> Self {
        Self { name, learner: Box::new((state, update, learned)), times: Vec::new() }
    }
}

/// All contestants; first two floors, then ours.
fn contestants<const N: usize>(rows: &[Row<N>]) -> Vec<Contestant<N>> {
    let mut data = Triangle::new(N);
    rows.iter().take(200).for_each(|row| data.add(row.phi.as_slice(), row.y));
    let mut ours = RecursiveLeastSquares::new(N);
    ours.start(&data, &[false; N]);
    let qr = InverseQrRls::<N, 1>::new(VAGUE as f32, LAMBDA as f32);
    vec![
        Contestant::<N>::new("floor, packed", Packed::new(N), Packed::update, |s| s.p.clone()),
        Contestant::<N>::new("floor, tiles of 4 x 4", Tiles::new(N), Tiles::update, Tiles::all),
        Contestant::<N>::new(
            "RecursiveLeastSquares",
            ours,
            |s, row| s.update(row.phi.as_slice(), row.y, LAMBDA),
            |s| s.theta().to_vec(),
        ),
        Contestant::<N>::new("nalgebra DMatrix", Dynamic::new(N), Dynamic::update, |s| s.theta.as_slice().to_vec()),
        Contestant::<N>::new("nalgebra SMatrix", Static::new(), Static::update, |s| s.theta.as_slice().to_vec()),
        Contestant::<N>::new(
            "flight-solver QR, f32",
            qr,
            |s, row| s.update(&row.phi_f32, &row.y_f32),
            |s| s.params().iter().map(|&value| value.into()).collect(),
        ),
    ]
}

/// The sign of the k-th pass: the same rows come again with the other one, so that P stays where it is.
fn sign(k: usize) -> f64 {
    if (k / 1024).is_multiple_of(2) { 1e-3 } else { -1e-3 }
}

/// n (n + 1) / 2 numbers, row after row.
struct Packed {
    p: Vec<f64>,
    passes: usize,
}

impl Packed {
    fn new(n: usize) -> Self {
        Self { p: vec![1.0; n * (n + 1) / 2], passes: 0 }
    }

    fn update<const N: usize>(&mut self, row: &Row<N>) {
        let g = row.phi.as_slice();
        let scale = sign(self.passes);
        self.passes += 1;
        let mut rest = self.p.as_mut_slice();
        for i in 0..g.len() {
            let (row, below) = rest.split_at_mut(g.len() - i);
            let factor = g[i] * scale;
            row.iter_mut().zip(&g[i..]).for_each(|(p, g)| *p -= g * factor);
            rest = below;
        }
    }
}

/// More numbers, but no remainders.
struct Tiles {
    p: Vec<[[f64; 4]; 4]>,
    passes: usize,
}

impl Tiles {
    fn new(n: usize) -> Self {
        let blocks = n.div_ceil(4);
        Self { p: vec![[[1.0; 4]; 4]; blocks * (blocks + 1) / 2], passes: 0 }
    }

    fn update<const N: usize>(&mut self, row: &Row<N>) {
        let scale = sign(self.passes);
        self.passes += 1;
        let mut rest = self.p.as_mut_slice();
        for (t, right) in row.blocks.iter().enumerate() {
            let (column, others) = rest.split_at_mut(t + 1);
            let factor = right.map(|g| g * scale);
            for (p, left) in column.iter_mut().zip(&row.blocks) {
                (0..4).for_each(|j| p[j] = from_fn(|i| p[j][i] - left[i] * factor[j]));
            }
            rest = others;
        }
    }

    fn all(&self) -> Vec<f64> {
        self.p.as_flattened().as_flattened().to_vec()
    }
}

/// Equations (18)-(20) as one writes them with nalgebra, without allocation; P is kept symmetric by mirroring.
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

/// The same with sizes known to the compiler.
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

/// Times all contestants with N coefficients; prints their table and returns it.
fn compare<const N: usize>(samples: usize) -> Vec<Value> {
    let rows: Vec<Row<N>> = data::rows(N)
        .into_iter()
        .map(|(phi, y)| Row {
            phi: SVector::from_column_slice(&phi),
            y,
            blocks: phi.chunks(4).map(|chunk| from_fn(|i| chunk.get(i).copied().unwrap_or(0.0))).collect(),
            phi_f32: VecN::from_iterator(phi.iter().map(|&p| p as f32)),
            y_f32: VecN::from_element(y as f32),
        })
        .collect();
    let mut contestants = contestants(&rows);
    let count = contestants.len();
    contestants.iter_mut().for_each(|contestant| (0..4).for_each(|_| contestant.learner.learn(&rows)));
    for round in 0..samples {
        let batch = &rows[round * BATCH % rows.len()..][..BATCH];
        for turn in 0..count {
            let contestant = &mut contestants[(round + turn) % count];
            let start = Instant::now();
            contestant.learner.learn(batch);
            contestant.times.push(start.elapsed().as_nanos() as f64 / BATCH as f64);
        }
    }
    let (floors, estimators) = contestants.split_at(FLOORS);
    assert!(floors.iter().all(|floor| floor.learner.learned().iter().all(|p| p.is_finite())));
    let theta = estimators[0].learner.learned();
    for contestant in &estimators[1..] {
        let other = contestant.learner.learned();
        let difference = theta.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-3, "{} learned something else: by {difference}", contestant.name);
    }
    table(N, contestants)
}

fn table<const N: usize>(n: usize, mut contestants: Vec<Contestant<N>>) -> Vec<Value> {
    println!("\nn = {n:<20} p50, ns       p99     p99.9       max    samples    / floor     / ours");
    contestants.iter_mut().for_each(|contestant| contestant.times.sort_by(f64::total_cmp));
    let median = |contestant: &Contestant<N>| percentile(&contestant.times, 0.5);
    let floor = contestants[..FLOORS].iter().map(median).fold(f64::INFINITY, f64::min);
    let ours = median(&contestants[FLOORS]);
    let figures = contestants.iter().map(|Contestant { name, times, .. }| {
        let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|part| percentile(times, part));
        let (max, samples) = (times[times.len() - 1], times.len());
        let (to_floor, to_ours) = (p50 / floor, p50 / ours);
        println!(
            "{name:<23} {p50:>9.1} {p99:>9.1} {p999:>9.1} {max:>9.1} {samples:>10} {to_floor:>10.2} {to_ours:>10.2}"
        );
        json!({
            "n": n, "name": name, "samples": samples, "updates_per_sample": BATCH, "p50_ns": p50, "p99_ns": p99,
            "p99_9_ns": p999, "max_ns": max, "to_floor": to_floor, "to_ours": to_ours,
        })
    });
    figures.collect()
}

/// Of times in order.
fn percentile(times: &[f64], part: f64) -> f64 {
    times[((times.len() as f64 * part).ceil() as usize).clamp(1, times.len()) - 1]
}

fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or_default().to_owned()
}

/// The figure `key` of `name` at `n`.
fn figure(figures: &[Value], n: usize, name: &str, key: &str) -> f64 {
    let found = figures.iter().find(|figure| figure["n"] == n && figure["name"] == name);
    found.and_then(|figure| figure[key].as_f64()).unwrap_or(f64::NAN)
}

fn main() {
    let arguments = Arguments::parse();
    let samples = if arguments.quick { 50 } else { 10_000 };
    let before = load();
    let figures = [compare::<5>(samples), compare::<15>(samples), compare::<40>(samples)].concat();
    let after = load();
    println!(
        "\nper update; one sample is the mean of {BATCH}; ratios of p50; load {before} before, {after} after\n\
         at n = 15: {:.2} x the packed floor (aim: at most 3.5), {:.2} x the faster one; {:.1} x as fast as \
         flight-solver's QR form (aim: at least 4)",
        1.0 / figure(&figures, 15, "floor, packed", "to_ours"),
        figure(&figures, 15, "RecursiveLeastSquares", "to_floor"),
        figure(&figures, 15, "flight-solver QR, f32", "to_ours"),
    );
    if let Some(file) = arguments.json {
        let text = serde_json::to_string_pretty(&json!({"load": [before, after], "figures": figures}));
        fs::write(&file, text.expect("plain figures")).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    }
}
