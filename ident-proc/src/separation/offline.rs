//! The separation at the end of training, eqs. (16) and (17).
//!
//! ```text
//! paper:  b_j = C_1j,   f_k = sum_j C_1j C_kj / sum_j C_1j^2,   g_k likewise with the products of u < 0    (17)
//! als:    minimise |R (theta(a, b, f, g, c) - theta_hat)|  over a, b and c, then over a, f, g and c, and again
//! ```
//!
//! C_ij = f_i b_j products (16), theta_hat coefficients of the over-parametrised form, R triangle of the data (15), c
//! drift if the structure has one. c is no product and needs no separation.
//!
//! Both ways are scaled so that f_1 = 1. With R, alternating least squares minimises the prediction error that the
//! separation costs, and not the error of the coefficients.
//!
//! Trap: (17) takes b from the linear row of the products alone. Where the valve has a dead band that row is small and
//! its quotients are noise: the model is ruined although the fit was good.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::Split,
};

use crate::least_squares::Triangle;

/// Largest number of rounds of alternating least squares. On a record whose products are nearly of rank one it
/// converges long before.
const MAX_ROUNDS: usize = 100;
/// Change in a round at which the alternation has converged: the sum over a, b, f and g of the largest change, in parts
/// of the largest coefficient of its kind.
const CONVERGED: f64 = 1e-10;
/// Smallest f_1 that the model is scaled by, in parts of the largest coefficient of N.
const SMALLEST_F1: f64 = 1e-6;

/// Separates theta of the full form. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct OfflineSeparation {
    structure: Structure,
    linear: Triangle,
    nonlinear: Triangle,
    linear_solution: Vec<f64>,
    nonlinear_solution: Vec<f64>,
    theta: Vec<f64>,
}

impl OfflineSeparation {
    /// For one structure.
    pub fn new(structure: Structure) -> Self {
        let (linear, nonlinear) =
            (structure.linear_len(), structure.na + 2 * structure.order + structure.drift as usize);
        Self {
            structure,
            linear: Triangle::new(linear),
            nonlinear: Triangle::new(nonlinear),
            linear_solution: vec![0.0; linear],
            nonlinear_solution: vec![0.0; nonlinear],
            theta: vec![0.0; structure.full_len()],
        }
    }

    /// Separates `theta` in the way that `split` sets. `data` is the triangle that theta solves.
    pub fn separate(&mut self, theta: &[f64], data: &Triangle, split: Split) -> Coefficients {
        match split {
            Split::Paper => self.by_formula(theta),
            Split::Als => {
                let start = self.by_largest_row(theta);
                self.alternate(start, data)
            }
        }
    }

    /// Eq. (17) as printed. With a linear row of zeros N is zero.
    fn by_formula(&self, theta: &[f64]) -> Coefficients {
        let Structure { na, order, .. } = self.structure;
        let mut model = Coefficients::zero(self.structure);
        model.a[..na].copy_from_slice(&theta[..na]);
        model.drift = self.drift(theta);
        let first = self.products(theta, 0);
        model.b[..first.len()].copy_from_slice(first);
        let square: f64 = first.iter().map(|c| c * c).sum();
        if square > 0.0 {
            let quotient =
                |power| first.iter().zip(self.products(theta, power)).map(|(a, b)| a * b).sum::<f64>() / square;
            (0..order).for_each(|i| model.f[i] = quotient(i));
            (0..order).for_each(|i| model.g[i] = quotient(order + i));
        }
        model
    }

    /// A start for the alternation: b is the largest row of products, f and g are projections on it.
    fn by_largest_row(&self, theta: &[f64]) -> Coefficients {
        let Structure { na, order, .. } = self.structure;
        let square = |power: usize| self.products(theta, power).iter().map(|c| c * c).sum::<f64>();
        let largest = (0..2 * order).fold(0, |best, power| if square(power) > square(best) { power } else { best });
        let row = self.products(theta, largest);
        let mut model = Coefficients::zero(self.structure);
        model.a[..na].copy_from_slice(&theta[..na]);
        model.drift = self.drift(theta);
        model.b[..row.len()].copy_from_slice(row);
        let total = square(largest);
        if total > 0.0 {
            let project = |power| row.iter().zip(self.products(theta, power)).map(|(a, b)| a * b).sum::<f64>() / total;
            (0..order).for_each(|i| model.f[i] = project(i));
            (0..order).for_each(|i| model.g[i] = project(order + i));
        }
        model
    }

    /// c, the last coefficient of every form; 0 for a structure without drift.
    fn drift(&self, coefficients: &[f64]) -> f64 {
        coefficients.last().copied().filter(|_| self.structure.drift).unwrap_or(0.0)
    }

    fn products<'a>(&self, theta: &'a [f64], power: usize) -> &'a [f64] {
        let lags = self.structure.nb + 1;
        &theta[self.structure.na + power * lags..self.structure.na + (power + 1) * lags]
    }

    /// Alternating least squares from `model` on. Allocates nothing.
    pub fn alternate(&mut self, mut model: Coefficients, data: &Triangle) -> Coefficients {
        let Structure { na, nb, order, .. } = self.structure;
        scale(&mut model, order);
        for _ in 0..MAX_ROUNDS {
            let before = model;
            // a and b, with f and g held: the features of each lag are summed up.
            self.linear.clear();
            self.linear.add_mapped(data, |row, target, out| {
                fold_features(self.structure, &model, row, out);
                target
            });
            self.linear.solve(&mut self.linear_solution);
            model.b[..=nb].copy_from_slice(&self.linear_solution[na..=na + nb]);
            // a, f and g, with b held: the lags of each feature are summed up.
            self.nonlinear.clear();
            self.nonlinear.add_mapped(data, |row, target, out| {
                out[..na].copy_from_slice(&row[..na]);
                for power in 0..2 * order {
                    let lags = &row[na + power * (nb + 1)..na + (power + 1) * (nb + 1)];
                    out[na + power] = lags.iter().zip(&model.b).map(|(r, b)| r * b).sum();
                }
                out[na + 2 * order..].copy_from_slice(&row[na + 2 * order * (nb + 1)..]);
                target
            });
            self.nonlinear.solve(&mut self.nonlinear_solution);
            model.a[..na].copy_from_slice(&self.nonlinear_solution[..na]);
            model.f[..order].copy_from_slice(&self.nonlinear_solution[na..na + order]);
            model.g[..order].copy_from_slice(&self.nonlinear_solution[na + order..na + 2 * order]);
            model.drift = self.drift(&self.nonlinear_solution);
            scale(&mut model, order);
            if moved(&before.a, &model.a)
                + moved(&before.b, &model.b)
                + moved(&before.f, &model.f)
                + moved(&before.g, &model.g)
                < CONVERGED
            {
                break;
            }
        }
        model
    }

    /// The part of the products' weighted norm that the separated model does not explain:
    /// |R (theta_hat - theta(a, b, f, g))| / |R (0, C_hat)|, 0 for an exact separation.
    pub fn residual(&mut self, theta: &[f64], model: &Coefficients, data: &Triangle) -> f64 {
        let Structure { na, nb, order, .. } = self.structure;
        self.theta[..na].copy_from_slice(model.a());
        for (power, c) in model.f[..order].iter().chain(&model.g[..order]).enumerate() {
            for (j, b) in model.b().iter().enumerate() {
                self.theta[na + power * (nb + 1) + j] = c * b;
            }
        }
        let n = self.theta.len();
        let products = na + 2 * order * (nb + 1);
        self.theta[products..].fill(model.drift);
        let (mut missing, mut driven) = (0.0, 0.0);
        for i in 0..n {
            let off: f64 = (i..n).map(|j| data.entry(i, j) * (theta[j] - self.theta[j])).sum();
            let all: f64 = (i.max(na)..products).map(|j| data.entry(i, j) * theta[j]).sum();
            missing += off * off;
            driven += all * all;
        }
        if driven > 0.0 { (missing / driven).sqrt() } else { 0.0 }
    }
}

/// Writes a row of the full form as a row of the linear form with the f and g of `model`: the features of each lag are
/// summed up.
fn fold_features(structure: Structure, model: &Coefficients, row: &[f64], out: &mut [f64]) {
    let Structure { na, nb, order, .. } = structure;
    out[..na].copy_from_slice(&row[..na]);
    for (power, c) in model.f[..order].iter().chain(&model.g[..order]).enumerate() {
        for j in 0..=nb {
            out[na + j] += c * row[na + power * (nb + 1) + j];
        }
    }
    out[na + nb + 1..].copy_from_slice(&row[na + 2 * order * (nb + 1)..]);
}

/// Scales b and N so that f_1 = 1. Where f_1 is nearly zero, the largest coefficient of N becomes 1 in magnitude.
pub(crate) fn scale(model: &mut Coefficients, order: usize) {
    let largest = model.f[..order].iter().chain(&model.g[..order]).fold(0.0f64, |m, c| m.max(c.abs()));
    let by = if model.f[0].abs() > SMALLEST_F1 * largest { model.f[0] } else { largest };
    if by != 0.0 && by.is_finite() {
        model.f.iter_mut().chain(&mut model.g).for_each(|c| *c /= by);
        model.b.iter_mut().for_each(|b| *b *= by);
    }
}

/// The largest change, relative to the largest magnitude.
fn moved(before: &[f64], after: &[f64]) -> f64 {
    let change = before.iter().zip(after).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    let size = after.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    if size > 0.0 { change / size } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sample::RegressorRow, sample::SlidingBuffer};

    const STRUCTURE: Structure = Structure { na: 2, nb: 1, nk: 1, order: 3, ..Structure::PAPER };

    fn truth(f: [f64; 3], g: [f64; 3]) -> Coefficients {
        let mut model = Coefficients::zero(STRUCTURE);
        model.a[..2].copy_from_slice(&[-1.5, 0.7]);
        model.b[..2].copy_from_slice(&[0.3, 0.2]);
        model.f[..3].copy_from_slice(&f);
        model.g[..3].copy_from_slice(&g);
        model
    }

    /// Data of a known model with a little noise, and theta of the full form that they give.
    fn record(model: &Coefficients, noise: f64) -> (Triangle, Vec<f64>) {
        let mut row = RegressorRow::new(STRUCTURE);
        let mut data = Triangle::new(STRUCTURE.full_len());
        let (mut outputs, mut commands) = (SlidingBuffer::new(4, 1), SlidingBuffer::new(4, 6));
        let mut x = Vec::new();
        for k in 0..3000 {
            let u = (k as f64 * 0.37).sin() * (0.5 + 0.5 * (k as f64 * 0.011).sin());
            if k >= 2 {
                row.fill(&outputs, &commands);
                let newest: Vec<f64> = outputs.latest(2).iter().rev().copied().collect();
                let y = model.predict_one(&newest, &[x[k - 1], x[k - 2]]) + noise * (k as f64 * 91.7).sin();
                data.add(row.values(), y);
                outputs.push(y);
            } else {
                outputs.push(0.0);
            }
            x.push(model.nonlinearity().evaluate(u));
            commands.push_with(|slot| STRUCTURE.input.features(u, slot));
        }
        let mut theta = vec![0.0; STRUCTURE.full_len()];
        data.solve(&mut theta);
        (data, theta)
    }

    fn close(a: &Coefficients, b: &Coefficients, tolerance: f64) -> bool {
        let pairs = [(&a.a[..], &b.a[..]), (&a.b, &b.b), (&a.f, &b.f), (&a.g, &b.g)];
        pairs.iter().all(|(x, y)| x.iter().zip(*y).all(|(x, y)| (x - y).abs() < tolerance))
    }

    #[test]
    fn both_ways_recover_an_exact_model() {
        let model = truth([1.0, 0.4, -0.3], [0.8, -0.2, 0.1]);
        let (data, theta) = record(&model, 0.0);
        let mut separation = OfflineSeparation::new(STRUCTURE);
        for split in [Split::Paper, Split::Als] {
            let found = separation.separate(&theta, &data, split);
            assert!(close(&found, &model, 1e-8), "{split:?} {found:?}");
            assert!(separation.residual(&theta, &found, &data) < 1e-8);
        }
    }

    #[test]
    fn where_the_linear_row_is_small_only_the_alternation_is_right() {
        // A dead band: nearly no linear part, then a steep rise. Scaled so that f_1 = 1.
        let f = [0.02, 0.3, 1.0];
        let model = {
            let mut model = truth(f.map(|c| c / f[0]), [1.0, -15.0, 50.0]);
            model.b.iter_mut().for_each(|b| *b *= f[0]);
            model
        };
        let (data, theta) = record(&model, 0.02);
        let mut separation = OfflineSeparation::new(STRUCTURE);
        let paper = separation.separate(&theta, &data, Split::Paper);
        let als = separation.separate(&theta, &data, Split::Als);
        let paper = separation.residual(&theta, &paper, &data);
        let als = separation.residual(&theta, &als, &data);
        assert!(als < 0.02 && paper > 2.0 * als, "formula {paper} alternation {als}");
    }

    #[test]
    fn the_scale_is_f1_equal_to_one() {
        let model = truth([2.0, 0.8, -0.6], [1.6, -0.4, 0.2]);
        let (data, theta) = record(&model, 0.0);
        let found = OfflineSeparation::new(STRUCTURE).separate(&theta, &data, Split::Als);
        assert_eq!(found.f[0], 1.0);
        assert!((found.b[0] - 0.6).abs() < 1e-8 && (found.f[1] - 0.4).abs() < 1e-8);
    }
}
