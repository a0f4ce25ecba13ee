//! The recursive estimator compared with arithmetic of more than a hundred digits, over ten thousand updates.
//!
//! The reference is what (18)-(20) compute without rounding, the weighted normal equations
//!
//! ```text
//! theta(k) = P(k) z(k),   P(k)^-1 = sum of lambda^(k-i) phi(i) phi(i)',   z(k) = sum of lambda^(k-i) phi(i) y(i)
//! ```
//!
//! with weight 1 for the rows of the offline part. The sums are formed with weights lambda^-i instead, which scales
//! both of them equally, and solved at a few checkpoints.

use dashu_float::{FBig, round::mode::HalfEven};
use ident_proc::{least_squares::Triangle, recursive::RecursiveLeastSquares};
use nalgebra::DMatrix;

type Exact = FBig<HalfEven>;

/// 115 decimal digits.
const BITS: usize = 384;
const OFFLINE: usize = 300;
const UPDATES: usize = 10_000;

fn exact(value: f64) -> Exact {
    Exact::try_from(value).expect("a finite number").with_precision(BITS).value()
}

/// The nearest f64 of `value`.
fn rounded(value: &Exact) -> f64 {
    value.to_f64().value()
}

/// A fixed pseudo-random sequence between -1 and 1.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

/// Regressors and outputs of an axis at rest near 0.5 m that follows commands to both sides: 3 positions, which are
/// nearly equal, and `n - 3` features of the commands between -1 and 1. No coefficient is zero, where a relative error
/// would say nothing.
fn record(n: usize) -> Vec<(Vec<f64>, f64)> {
    let rows = OFFLINE + UPDATES;
    let command: Vec<f64> = (0..rows + 2).map(|k| 0.6 * (k as f64 * 0.05).sin() + 0.4 * noise(k / 5)).collect();
    let mut position = vec![0.5; 3];
    (0..rows)
        .map(|k| {
            let past: Vec<f64> = (1..=3).map(|lag| position[position.len() - lag]).collect();
            let (now, before) = (command[k + 1], command[k]);
            let mut phi: Vec<f64> = past.iter().map(|y| -y).collect();
            if n == 5 {
                phi.extend([now, before]);
            } else {
                let sides = [1.0, -1.0];
                phi.extend(sides.iter().flat_map(|side| {
                    (1..=3).flat_map(move |power| [now, before].map(|u| (u * side).max(0.0).powi(power)))
                }));
            }
            let flow: f64 = phi[3..].iter().zip(1..).map(|(feature, j)| feature / j as f64).sum();
            let y = past[0] + 0.7 * (past[0] - past[1]) - 0.1 * (past[1] - past[2]) - 0.02 * (past[0] - 0.5)
                + 1e-3 * flow
                + 1e-6 * noise(7 * k + 3);
            position.push(y);
            (phi, y)
        })
        .collect()
}

/// The weighted normal equations, the lower triangle by rows.
struct Normal {
    matrix: Vec<Vec<Exact>>,
    right: Vec<Exact>,
}

impl Normal {
    fn new(n: usize) -> Self {
        Self { matrix: (0..n).map(|i| vec![exact(0.0); i + 1]).collect(), right: vec![exact(0.0); n] }
    }

    fn add(&mut self, phi: &[f64], y: f64, weight: &Exact) {
        let phi: Vec<Exact> = phi.iter().map(|&value| exact(value)).collect();
        for (i, row) in self.matrix.iter_mut().enumerate() {
            let weighted = &phi[i] * weight;
            row.iter_mut().zip(&phi).for_each(|(sum, other)| *sum += &weighted * other);
            self.right[i] += weighted * exact(y);
        }
    }

    /// theta and the diagonal of P, by Gauss-Jordan elimination: the matrix is positive definite.
    fn solve(&self, weight: &Exact) -> (Vec<f64>, Vec<f64>) {
        let n = self.right.len();
        let mut rows: Vec<Vec<Exact>> = (0..n)
            .map(|i| {
                let matrix = (0..n).map(|j| self.matrix[i.max(j)][i.min(j)].clone());
                let identity = (0..n).map(|j| exact(if i == j { 1.0 } else { 0.0 }));
                matrix.chain([self.right[i].clone()]).chain(identity).collect()
            })
            .collect();
        for i in 0..n {
            let inverse = exact(1.0) / &rows[i][i];
            rows[i].iter_mut().for_each(|value| *value *= &inverse);
            let pivot = rows[i].clone();
            for (_, row) in rows.iter_mut().enumerate().filter(|(j, _)| *j != i) {
                let factor = row[i].clone();
                row[i..].iter_mut().zip(&pivot[i..]).for_each(|(value, pivot)| *value -= &factor * pivot);
            }
        }
        let theta = rows.iter().map(|row| rounded(&row[n])).collect();
        (theta, (0..n).map(|i| rounded(&(&rows[i][n + 1 + i] * weight))).collect())
    }
}

/// The largest relative errors over the checkpoints.
#[derive(Debug, Default)]
struct Errors {
    /// Of theta as a vector: its largest error by its largest coefficient.
    theta: f64,
    /// Of any single coefficient. Those of the commands are a ten-thousandth of those of the positions, so the rounding
    /// of y, times the condition, is larger relative to them.
    coefficient: f64,
    /// Of any entry of P's diagonal.
    covariance: f64,
}

fn largest_errors(n: usize, lambda: f64) -> Errors {
    let record = record(n);
    let mut normal = Normal::new(n);
    let mut data = Triangle::new(n);
    let mut weight = exact(1.0);
    for (phi, y) in &record[..OFFLINE] {
        normal.add(phi, *y, &weight);
        data.add(phi, *y);
    }
    let mut estimator = RecursiveLeastSquares::new(n);
    estimator.start(&data, &vec![false; n]);
    let growth = exact(1.0) / exact(lambda);
    let mut errors = Errors::default();
    for (k, (phi, y)) in (1..).zip(&record[OFFLINE..]) {
        weight *= &growth;
        normal.add(phi, *y, &weight);
        assert!(!estimator.update(phi, *y, lambda).bounded, "the bound on the covariance is no part of (18)-(20)");
        if [1, 10, 100, 1000, 3000, UPDATES].contains(&k) {
            let (theta, covariance) = normal.solve(&weight);
            let largest = theta.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            for i in 0..n {
                let error = (estimator.theta()[i] - theta[i]).abs();
                errors.theta = errors.theta.max(error / largest);
                errors.coefficient = errors.coefficient.max(error / theta[i].abs());
                errors.covariance = errors.covariance.max((estimator.covariance(i, i) / covariance[i] - 1.0).abs());
            }
        }
    }
    errors
}

/// The condition number of the regressors; 1 for orthogonal columns.
fn condition(n: usize) -> f64 {
    let record = record(n);
    let values = DMatrix::from_fn(1000, n, |k, j| record[k].0[j]).singular_values();
    values.max() / values.min()
}

fn agrees(lambda: f64) {
    for n in [5, 15] {
        let errors = largest_errors(n, lambda);
        println!("n = {n}, lambda = {lambda}: {errors:?}");
        assert!(errors.theta < 1e-9 && errors.covariance < 1e-9 && errors.coefficient < 1e-7, "{errors:?}");
    }
}

#[test]
fn the_record_is_badly_conditioned() {
    [5, 15].into_iter().for_each(|n| println!("n = {n}: condition {:.1e}", condition(n)));
    assert!(condition(5) > 1e3 && condition(15) > 1e3);
}

#[test]
fn agrees_with_short_memory() {
    agrees(0.98);
}

#[test]
fn agrees_with_long_memory() {
    agrees(0.995);
}

#[test]
fn agrees_without_forgetting() {
    agrees(1.0);
}
