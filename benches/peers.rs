//! What one update of recursive least squares costs, ours and others', on the same rows in the same run.
//!
//! `cargo bench --bench peers`; `--quick` for a short run, `--json FILE` for programs; `benches/peers.py` has the
//! Python peers. All contestants take turns, so that a busy machine disturbs all alike; one sample is the mean of
//! 64 updates in a row. The floor is no estimator: one pass over a packed triangle, which every update contains.

mod data;

use std::{fs, hint::black_box, path::PathBuf, time::Instant};

use clap::Parser;
use flight_solver::{cls::VecN, rls::InverseQrRls};
use ident_proc::{recursive::RecursiveLeastSquares, triangle::Triangle};
use nalgebra::{DMatrix, DVector, DVectorView, SMatrix, SVector};
use serde_json::{Value, json};

const LAMBDA: f64 = 0.995;
/// Updates per timed sample.
const BATCH: usize = 64;
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
    phi_f32: VecN<N>,
    y_f32: VecN<1>,
}

/// Someone who can be timed.
struct Contestant<const N: usize> {
    name: &'static str,
    learn: Box<dyn FnMut(&[Row<N>]) -> Vec<f64>>,
    times: Vec<f64>,
}

impl<const N: usize> Contestant<N> {
    /// `update` takes a row in, `theta` shows what has been learned.
    fn new<S: 'static>(
        name: &'static str,
        mut state: S,
        mut update: impl FnMut(&mut S, &Row<N>) + 'static,
        theta: impl Fn(&S) -> Vec<f64> + 'static,
    ) -> Self {
        let learn = move |rows: &[Row<N>]| {
            rows.iter().for_each(|row| update(&mut state, black_box(row)));
            if rows.is_empty() { theta(&state) } else { Vec::new() }
        };
        Self { name, learn: Box::new(learn), times: Vec::new() }
    }
}

/// All contestants; the first is the floor, the second ours.
fn contestants<const N: usize>(rows: &[Row<N>]) -> Vec<Contestant<N>> {
    let mut data = Triangle::new(N);
    rows.iter().take(200).for_each(|row| data.add(row.phi.as_slice(), row.y));
    let mut ours = RecursiveLeastSquares::new(N);
    ours.start(&data, &[false; N]);
    let qr = InverseQrRls::<N, 1>::new(VAGUE as f32, LAMBDA as f32);
    vec![
        Contestant::<N>::new("floor", Floor::new(N), |s, row| s.update(row.phi.as_slice()), |s| s.packed.clone()),
        Contestant::<N>::new(
            "RecursiveLeastSquares",
            ours,
            |s, row| {
                s.update(row.phi.as_slice(), row.y, LAMBDA);
            },
            |s| s.theta().to_vec(),
        ),
        Contestant::<N>::new("nalgebra DMatrix", Dynamic::new(N), Dynamic::update, |s| s.theta.as_slice().to_vec()),
        Contestant::<N>::new("nalgebra SMatrix", Static::new(), Static::update, |s| s.theta.as_slice().to_vec()),
        Contestant::<N>::new(
            "flight-solver QR, f32",
            qr,
            |s, row| {
                s.update(&row.phi_f32, &row.y_f32);
            },
            |s| s.params().iter().map(|&value| value.into()).collect(),
        ),
    ]
}

/// P -= g g' s on a packed upper triangle.
struct Floor {
    packed: Vec<f64>,
    scale: f64,
    updates: usize,
}

impl Floor {
    fn new(n: usize) -> Self {
        Self { packed: vec![1.0; n * (n + 1) / 2], scale: 1e-3, updates: 0 }
    }

    fn update(&mut self, g: &[f64]) {
        // The next time round the same rows come with the other sign: P stays where it is.
        if self.updates % 1024 == 0 {
            self.scale = -self.scale;
        }
        self.updates += 1;
        let mut rest = self.packed.as_mut_slice();
        for i in 0..g.len() {
            let (row, below) = rest.split_at_mut(g.len() - i);
            let factor = g[i] * self.scale;
            row.iter_mut().zip(&g[i..]).for_each(|(p, g)| *p -= g * factor);
            rest = below;
        }
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
            phi_f32: VecN::from_iterator(phi.iter().map(|&p| p as f32)),
            y_f32: VecN::from_element(y as f32),
        })
        .collect();
    let mut contestants = contestants(&rows);
    let count = contestants.len();
    contestants.iter_mut().for_each(|contestant| (0..4).for_each(|_| drop((contestant.learn)(&rows))));
    for round in 0..samples {
        let batch = &rows[round * BATCH % rows.len()..][..BATCH];
        for turn in 0..count {
            let contestant = &mut contestants[(round + turn) % count];
            let start = Instant::now();
            (contestant.learn)(batch);
            contestant.times.push(start.elapsed().as_nanos() as f64 / BATCH as f64);
        }
    }
    let theta = (contestants[1].learn)(&[]);
    for contestant in &mut contestants[2..] {
        let other = (contestant.learn)(&[]);
        let difference = theta.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-3, "{} learned something else: by {difference}", contestant.name);
    }
    assert!((contestants[0].learn)(&[]).iter().all(|p| p.is_finite()));
    table(N, contestants)
}

fn table<const N: usize>(n: usize, mut contestants: Vec<Contestant<N>>) -> Vec<Value> {
    println!("\nn = {n:<20} p50, ns       p99     p99.9       max    samples    / floor     / ours");
    contestants.iter_mut().for_each(|contestant| contestant.times.sort_by(f64::total_cmp));
    let (floor, ours) = (percentile(&contestants[0].times, 0.5), percentile(&contestants[1].times, 0.5));
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
         at n = 15: {:.2} x the floor (aim: at most 3.5), {:.1} x faster than flight-solver's QR form (aim: at least 4)",
        figure(&figures, 15, "RecursiveLeastSquares", "to_floor"),
        figure(&figures, 15, "flight-solver QR, f32", "to_ours"),
    );
    if let Some(file) = arguments.json {
        let text = serde_json::to_string_pretty(&json!({"load": [before, after], "figures": figures}));
        fs::write(&file, text.expect("plain figures")).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    }
}
