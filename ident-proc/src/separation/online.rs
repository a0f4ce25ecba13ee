//! The separation after each later sample: half a round of alternating least squares per sample.
//!
//! ```text
//! minimise over b and c   (C - c b')' W (C - c b')          c = (f, g),  C_ij and c_i b_j as vectors, W = Phi_c' Phi_c
//! G_b b = sum_i c_i (W C)_i.     G_b = sum_ik c_i c_k W_i.k.          with c held
//! G_c c = sum_j b_j (W C)_.j     G_c = sum_jl b_j b_l W_.j.l          with b held
//! ```
//!
//! C products (16), Phi_c columns of the rows that the commands contribute, W their normal equations. So a product
//! counts by its effect on the outputs, and directions that no row has excited count nothing. a stays as it was
//! estimated. b is solved for at one sample and c at the next, each from the last separation: that is enough to follow
//! coefficients that change slowly.
//!
//! W begins with the rows of the training, and [`OnlineSeparation::weigh`] adds later ones. Trap: with the training
//! alone, commands beyond those of the training count nothing, and the separated model is far from the products there.
//!
//! Trap: the squared condition of W would cost an offline fit its digits. Here b and c are already close. A weak pull
//! determines what W does not: b is pulled to its last value, c to the products as they are.

use pipeline::hammerstein::{Coefficients, MAX_LINEAR, MAX_ORDER, Structure};

use super::offline::scale;
use crate::{dot, least_squares::Triangle};

/// Largest number of features of a command.
const MAX_WIDTH: usize = 2 * MAX_ORDER;
/// Weight of the pull, in parts of the weight of the data.
const PULL: f64 = 1e-9;

/// The separation of one model. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct OnlineSeparation {
    structure: Structure,
    /// W, row after row. The products of one feature lie side by side.
    metric: Vec<f64>,
    /// W C.
    weighted: Vec<f64>,
    /// Sums of the rows of W, by lag or by feature.
    folded: Vec<f64>,
    b: [f64; MAX_LINEAR],
    c: [f64; MAX_WIDTH],
    /// Whether the next half round solves for b.
    solves_b: bool,
    residual: f64,
}

impl OnlineSeparation {
    /// For models of `structure`, without integrator.
    pub fn new(structure: Structure) -> Self {
        let m = 2 * structure.order * (structure.nb + 1);
        Self {
            structure,
            metric: vec![0.0; m * m],
            weighted: vec![0.0; m],
            folded: vec![0.0; MAX_WIDTH * m],
            b: [0.0; MAX_LINEAR],
            c: [0.0; MAX_WIDTH],
            solves_b: true,
            residual: 0.0,
        }
    }

    /// Starts from the separated `model` and the normal equations of `rows`, whose last columns are those of the
    /// products and, if there is one, of the drift.
    pub fn start(&mut self, model: &Coefficients, rows: &Triangle) {
        let Structure { order, drift, .. } = self.structure;
        let m = self.weighted.len();
        let na = rows.len() - m - drift as usize;
        for i in 0..m {
            for j in 0..=i {
                let product = (0..=na + j).map(|row| rows.entry(row, na + i) * rows.entry(row, na + j)).sum();
                self.metric[i * m + j] = product;
                self.metric[j * m + i] = product;
            }
        }
        self.b = [0.0; MAX_LINEAR];
        self.b[..model.b().len()].copy_from_slice(model.b());
        self.c = [0.0; MAX_WIDTH];
        self.c[..order].copy_from_slice(&model.f[..order]);
        self.c[order..2 * order].copy_from_slice(&model.g[..order]);
    }

    /// Takes the row of a sample into W.
    pub fn weigh(&mut self, row: &[f64]) {
        let m = self.weighted.len();
        let driven = &row[self.structure.na..self.structure.na + m];
        for (metric, one) in self.metric.chunks_exact_mut(m).zip(driven) {
            // The features of the sign that the command does not have are zero: half of them.
            if *one != 0.0 {
                metric.iter_mut().zip(driven).for_each(|(w, other)| *w += one * other);
            }
        }
    }

    /// Half a round for `theta`, written out for the row. Returns the separated model.
    pub fn separate(&mut self, theta: &[f64]) -> Coefficients {
        let Structure { na, nb, order, drift, .. } = self.structure;
        let (lags, width, m) = (nb + 1, 2 * order, self.weighted.len());
        let products = &theta[na..na + m];
        for (weighted, row) in self.weighted.iter_mut().zip(self.metric.chunks_exact(m)) {
            *weighted = dot(row, products);
        }
        let explained = if self.solves_b { self.solve_b(lags, width) } else { self.solve_c(products, lags, width) };
        self.solves_b = !self.solves_b;
        let all = dot(products, &self.weighted);
        self.residual = if all > 0.0 { ((all - explained) / all).max(0.0).sqrt() } else { 0.0 };

        let mut model = Coefficients::zero(self.structure);
        model.a[..na].copy_from_slice(&theta[..na]);
        model.b[..lags].copy_from_slice(&self.b[..lags]);
        model.f[..order].copy_from_slice(&self.c[..order]);
        model.g[..order].copy_from_slice(&self.c[order..width]);
        model.drift = if drift { theta[na + m] } else { 0.0 };
        scale(&mut model, order);
        self.b[..lags].copy_from_slice(model.b());
        self.c[..order].copy_from_slice(&model.f[..order]);
        self.c[order..width].copy_from_slice(&model.g[..order]);
        model
    }

    /// Solves for b with c held, by sums of W over the features. Returns the part of C' W C that the separation
    /// explains.
    fn solve_b(&mut self, lags: usize, width: usize) -> f64 {
        let m = self.weighted.len();
        let (mut normal, mut right) = ([[0.0; MAX_WIDTH]; MAX_WIDTH], [0.0; MAX_WIDTH]);
        let folded = &mut self.folded[..lags * m];
        folded.fill(0.0);
        for (i, c) in self.c[..width].iter().enumerate() {
            for (j, folded) in folded.chunks_exact_mut(m).enumerate() {
                right[j] += c * self.weighted[i * lags + j];
                let row = &self.metric[(i * lags + j) * m..(i * lags + j + 1) * m];
                folded.iter_mut().zip(row).for_each(|(sum, w)| *sum += c * w);
            }
        }
        for (normal, folded) in normal.iter_mut().zip(folded.chunks_exact(m)) {
            for (c, group) in self.c[..width].iter().zip(folded.chunks_exact(lags)) {
                normal.iter_mut().zip(group).for_each(|(sum, w)| *sum += c * w);
            }
        }
        solve(&mut normal, right, &mut self.b[..lags])
    }

    /// Solves for c with b held, by sums of W over the lags. Returns the part of C' W C that the separation explains.
    fn solve_c(&mut self, products: &[f64], lags: usize, width: usize) -> f64 {
        let m = self.weighted.len();
        // c is pulled to the factor of the products as they are.
        let square = dot(&self.b[..lags], &self.b[..lags]);
        for (c, products) in self.c.iter_mut().zip(products.chunks_exact(lags)) {
            *c = if square > 0.0 { dot(products, &self.b[..lags]) / square } else { 0.0 };
        }
        let (mut normal, mut right) = ([[0.0; MAX_WIDTH]; MAX_WIDTH], [0.0; MAX_WIDTH]);
        let folded = &mut self.folded[..width * m];
        folded.fill(0.0);
        for (i, folded) in folded.chunks_exact_mut(m).enumerate() {
            for (j, b) in self.b[..lags].iter().enumerate() {
                right[i] += b * self.weighted[i * lags + j];
                let row = &self.metric[(i * lags + j) * m..(i * lags + j + 1) * m];
                folded.iter_mut().zip(row).for_each(|(sum, w)| *sum += b * w);
            }
        }
        for (normal, folded) in normal.iter_mut().zip(folded.chunks_exact(m)) {
            for (normal, group) in normal.iter_mut().zip(folded.chunks_exact(lags)) {
                *normal = dot(group, &self.b[..lags]);
            }
        }
        solve(&mut normal, right, &mut self.c[..width])
    }

    /// The part of the products' weighted norm that the last separation does not explain.
    pub fn residual(&self) -> f64 {
        self.residual
    }
}

type Normal = [[f64; MAX_WIDTH]; MAX_WIDTH];

/// Solves `normal` x = `right` for `unknowns` by elimination in place, with a pull to their present values. Returns
/// x' right, which is x' normal x without the pull.
///
/// An unknown that the equations do not determine keeps its value.
fn solve(normal: &mut Normal, right: [f64; MAX_WIDTH], unknowns: &mut [f64]) -> f64 {
    let n = unknowns.len();
    let mut target = right;
    for i in 0..n {
        let pull = if normal[i][i] > 0.0 { PULL * normal[i][i] } else { 1.0 };
        normal[i][i] += pull;
        target[i] += pull * unknowns[i];
    }
    for i in 0..n {
        for j in 0..i {
            let (above, below) = normal.split_at_mut(i);
            let factor = below[0][j] / above[j][j];
            for (value, pivot) in below[0][j + 1..n].iter_mut().zip(&above[j][j + 1..n]) {
                *value -= factor * pivot;
            }
            target[i] -= factor * target[j];
        }
        // Rounding can reduce a pivot to zero that the pull made positive.
        normal[i][i] = normal[i][i].max(f64::MIN_POSITIVE);
    }
    for i in (0..n).rev() {
        unknowns[i] = (target[i] - dot(&normal[i][i + 1..n], &unknowns[i + 1..])) / normal[i][i];
    }
    dot(unknowns, &right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::write_out;

    const STRUCTURE: Structure = Structure { na: 2, nb: 2, nk: 1, order: 3, ..Structure::PAPER };

    fn model(b: [f64; 3], f: [f64; 3], g: [f64; 3]) -> Coefficients {
        let mut model = Coefficients::zero(STRUCTURE);
        model.a[..2].copy_from_slice(&[-1.5, 0.7]);
        model.b[..3].copy_from_slice(&b);
        model.f[..3].copy_from_slice(&f);
        model.g[..3].copy_from_slice(&g);
        model
    }

    fn theta(model: &Coefficients) -> Vec<f64> {
        let mut theta = vec![0.0; STRUCTURE.full_len()];
        write_out(model, &STRUCTURE, &mut theta);
        theta
    }

    /// Rows of commands of both signs, or of positive ones only.
    fn rows(one_sided: bool) -> Triangle {
        let mut rows = Triangle::new(STRUCTURE.full_len());
        let u = |k: usize| {
            let u = (k as f64 * 0.37).sin() * (0.5 + 0.5 * (k as f64 * 0.011).sin());
            if one_sided { u.abs() } else { u }
        };
        for k in 3..2000 {
            let mut row = vec![(k as f64 * 0.1).sin(), (k as f64 * 0.1).cos()];
            row.resize(STRUCTURE.full_len(), 0.0);
            for lag in 0..3 {
                let mut features = [0.0; 6];
                STRUCTURE.input.features(u(k - lag), &mut features);
                features.iter().enumerate().for_each(|(power, feature)| row[2 + power * 3 + lag] = *feature);
            }
            rows.add(&row, 0.0);
        }
        rows
    }

    fn distance(one: &Coefficients, two: &Coefficients) -> f64 {
        let all = |model: &Coefficients| [&model.a[..], &model.b, &model.f, &model.g].concat();
        all(one).iter().zip(all(two)).map(|(one, two)| (one - two).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn it_follows_a_model_to_another() {
        let before = model([0.3, 0.2, 0.0], [1.0, 0.4, -0.3], [0.8, -0.2, 0.1]);
        let after = model([0.25, 0.22, 0.05], [1.0, 0.1, 0.2], [1.2, 0.3, -0.1]);
        let mut separation = OnlineSeparation::new(STRUCTURE);
        separation.start(&before, &rows(false));
        assert!(distance(&separation.separate(&theta(&before)), &before) < 1e-12);
        let found = (0..200).map(|_| separation.separate(&theta(&after))).last().unwrap();
        assert!(distance(&found, &after) < 1e-7, "{found:?}");
        assert!(separation.residual() < 1e-7);
    }

    #[test]
    fn a_sign_without_commands_in_the_training_follows_the_products() {
        let before = model([0.3, 0.2, 0.0], [1.0, 0.4, -0.3], [0.8, -0.2, 0.1]);
        let after = model([0.4, 0.1, 0.0], [1.0, 0.1, 0.2], [0.6, 0.1, 0.0]);
        let mut separation = OnlineSeparation::new(STRUCTURE);
        separation.start(&before, &rows(true));
        let found = (0..200).map(|_| separation.separate(&theta(&after))).last().unwrap();
        assert!(distance(&found, &after) < 1e-6, "{found:?}");
    }

    #[test]
    fn commands_that_come_after_the_training_count_as_well() {
        let theta = theta(&model([0.3, 0.2, 0.0], [1.0, 0.4, -0.3], [0.8, -0.2, 0.1]));
        // The products of u < 0, which the training did not have, get another shape.
        let mut other = theta.clone();
        (0..3).for_each(|power| other[2 + 9 + 3 * power..].swap(0, 2));
        let mut separation = OnlineSeparation::new(STRUCTURE);
        separation.start(&model([0.3, 0.2, 0.0], [1.0, 0.4, -0.3], [0.8, -0.2, 0.1]), &rows(true));
        (0..50).for_each(|_| assert!(separation.separate(&other).is_finite()));
        assert!(separation.residual() < 1e-6, "{}", separation.residual());
        let mut row = vec![0.0; STRUCTURE.full_len()];
        for k in 0..2000 {
            row[2 + 9..]
                .iter_mut()
                .enumerate()
                .for_each(|(i, value)| *value = (k as f64 * (0.3 + 0.1 * i as f64)).sin());
            separation.weigh(&row);
        }
        (0..50).for_each(|_| assert!(separation.separate(&other).is_finite()));
        assert!(separation.residual() > 0.2, "{}", separation.residual());
        // Products of one shape are still separated exactly.
        (0..200).for_each(|_| assert!(separation.separate(&theta).is_finite()));
        assert!(separation.residual() < 1e-6, "{}", separation.residual());
    }

    #[test]
    fn products_of_no_common_shape_show_in_the_residual() {
        let one = model([0.3, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]);
        let two = model([0.0, 0.0, 0.3], [0.0; 3], [1.0, 0.0, 0.0]);
        let sum: Vec<f64> = theta(&one).iter().zip(theta(&two)).map(|(one, two)| one + two).collect();
        let mut separation = OnlineSeparation::new(STRUCTURE);
        separation.start(&model([0.2, 0.0, 0.2], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]), &rows(false));
        (0..50).for_each(|_| assert!(separation.separate(&sum).is_finite()));
        assert!(separation.residual() > 0.2, "{}", separation.residual());
    }

    #[test]
    fn products_of_zero_give_a_finite_model() {
        let mut separation = OnlineSeparation::new(STRUCTURE);
        separation.start(&Coefficients::zero(STRUCTURE), &Triangle::new(STRUCTURE.full_len()));
        (0..5).for_each(|_| assert!(separation.separate(&vec![0.0; STRUCTURE.full_len()]).is_finite()));
        assert_eq!(separation.residual(), 0.0);
    }
}
