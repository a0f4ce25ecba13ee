//! The model as a linear regression, in one of three forms. All of them are read from one [row](crate::sample::row).
//!
//! ```text
//! y(k) = phi(k)' theta                                                                             (13)
//! full:         phi = (-y(k-1) .. -y(k-na),  every feature at every lag)                            (14)
//! linear:       phi = (-y(k-1) .. -y(k-na),  x(k-nk) .. x(k-nk-nb)),       x = N(u), f and g held
//! directional:  phi = (-y(k-1) .. -y(k-na),  x+(k-nk) .. x+(k-nk-nb),  x-(k-nk) .. x-(k-nk-nb))
//! ```
//!
//! y output in its unit, u command, N nonlinearity. x+ is x where u >= 0 and else zero, x- is x where u < 0 and else
//! zero. theta of the full form is (a, C_10 .. C_1nb, C_20 .., C_r0 .. C_rnb) with C_ij = f_i b_j, then the products
//! with g; that of the linear form is (a, b); that of the directional form is (a, b of extending, b of retracting). A
//! drift is one more coefficient, the last.
//!
//! With the integrator the outputs in phi and the target are increments, dy(k) = y(k) - y(k-1); the features are not.
//! Trap: increments need na + 1 outputs of the past.
//!
//! theta of every form can be written out as coefficients of the full form with outputs, [`Regression::expand`]. Models
//! of different forms are compared, added and predicted in that common layout.
//!
//! All of this runs in the loop. Nothing here allocates.

use pipeline::hammerstein::{Coefficients, MAX_ORDER, Nonlinearity, Structure};

use crate::least_squares::Triangle;

/// How the features of a command become the regressors of a lag.
#[derive(Debug, Clone, Copy)]
enum Form {
    Full,
    Linear,
    Directional,
}

/// One form of one structure.
#[derive(Debug, Clone, Copy)]
pub struct Regression {
    structure: Structure,
    form: Form,
    /// f, then g, of the held nonlinearity.
    held: [[f64; MAX_ORDER]; 2],
}

impl Regression {
    /// The over-parametrised form (14).
    pub fn full(structure: Structure) -> Self {
        Self { structure, form: Form::Full, held: [[0.0; MAX_ORDER]; 2] }
    }

    /// The linear form with held nonlinearity.
    pub fn linear(structure: Structure, nonlinearity: &Nonlinearity) -> Self {
        Self { structure, form: Form::Linear, held: [nonlinearity.f, nonlinearity.g] }
    }

    /// The directional form: as the linear form, with a B for each sign of the command.
    pub fn directional(structure: Structure, nonlinearity: &Nonlinearity) -> Self {
        Self { structure, form: Form::Directional, held: [nonlinearity.f, nonlinearity.g] }
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        let per_lag = match self.form {
            Form::Full => 2 * self.structure.order,
            Form::Linear => 1,
            Form::Directional => 2,
        };
        self.structure.na + per_lag * (self.structure.nb + 1) + self.structure.drift as usize
    }

    /// Always false: na is at least 1.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The target of phi(k)' theta, from y(k) and the row of sample k.
    pub fn target(&self, y: f64, row: &[f64]) -> f64 {
        if self.structure.integrator { y + row[0] } else { y }
    }

    /// Writes phi(k) from the row of sample k of the structure `of`, which has at least the orders of this form.
    pub fn regressor(&self, row: &[f64], of: &Structure, phi: &mut [f64]) {
        let Structure { na, nb, order, integrator, drift, .. } = self.structure;
        let (outputs, driven) = phi.split_at_mut(na);
        if integrator {
            outputs.iter_mut().zip(row.windows(2)).for_each(|(phi, pair)| *phi = pair[0] - pair[1]);
        } else {
            outputs.copy_from_slice(&row[..na]);
        }
        let row = &row[of.na..];
        let branches = row.chunks_exact(order * (of.nb + 1)).zip(&self.held);
        match self.form {
            Form::Full => {
                for (phi, lags) in driven.chunks_exact_mut(nb + 1).zip(row.chunks_exact(of.nb + 1)) {
                    phi.copy_from_slice(&lags[..=nb]);
                }
            }
            Form::Linear => {
                driven.fill(0.0);
                branches.for_each(|(features, held)| fold(features, of.nb + 1, held, &mut driven[..=nb]));
            }
            Form::Directional => {
                driven.fill(0.0);
                for ((features, held), phi) in branches.zip(driven.chunks_exact_mut(nb + 1)) {
                    fold(features, of.nb + 1, held, phi);
                }
            }
        }
        if drift {
            driven[self.len() - na - 1] = 1.0;
        }
    }

    /// Marks the coefficients that only commands of an `idle` sign, positive or negative, contribute to.
    pub fn mark_idle(&self, idle: [bool; 2], marks: &mut [bool]) {
        let Structure { na, nb, order, .. } = self.structure;
        let per_sign = match self.form {
            Form::Full => order * (nb + 1),
            Form::Linear => 0,
            Form::Directional => nb + 1,
        };
        marks.fill(false);
        marks[na..na + per_sign].fill(idle[0]);
        marks[na + per_sign..na + 2 * per_sign].fill(idle[1]);
    }

    /// The least-squares problem of this form, from the one of rows of the structure `of`.
    pub fn project(&self, rows: &Triangle, of: &Structure, projected: &mut Triangle) {
        projected.clear();
        projected.add_mapped(rows, |row, target, phi| {
            self.regressor(row, of, phi);
            if self.structure.drift {
                // The 1 of the drift is any number in a row of the triangle.
                phi[self.len() - 1] = row[row.len() - 1];
            }
            self.target(target, row)
        });
    }

    /// Writes `theta` out as coefficients of the row of the structure `of`.
    pub fn expand(&self, theta: &[f64], of: &Structure, expanded: &mut [f64]) {
        let Structure { na, nb, order, integrator, drift, .. } = self.structure;
        expanded.fill(0.0);
        let (a, driven) = theta.split_at(na);
        expanded[..na].copy_from_slice(a);
        if integrator {
            // A(z) (1 - z^-1): subtract from every coefficient the one before it.
            for i in (1..=na).rev() {
                expanded[i] -= expanded[i - 1];
            }
            expanded[0] -= 1.0;
        }
        let (last, lags) = (expanded.len() - 1, of.nb + 1);
        for (power, products) in expanded[of.na..].chunks_exact_mut(lags).take(2 * order).enumerate() {
            let held = self.held[power / order][power % order];
            let (weight, b) = match self.form {
                Form::Full => (1.0, &driven[power * (nb + 1)..]),
                Form::Linear => (held, driven),
                Form::Directional => (held, &driven[power / order * (nb + 1)..]),
            };
            products.iter_mut().zip(&b[..=nb]).for_each(|(product, b)| *product = weight * b);
        }
        if drift {
            expanded[last] = theta[theta.len() - 1];
        }
    }
}

/// Writes a separated model out as coefficients of the row of the structure `of`, which has at least its orders.
pub fn write_out(model: &Coefficients, of: &Structure, expanded: &mut [f64]) {
    expanded.fill(0.0);
    expanded[..model.a().len()].copy_from_slice(model.a());
    let features = model.f[..of.order].iter().chain(&model.g[..of.order]);
    for (products, feature) in expanded[of.na..].chunks_exact_mut(of.nb + 1).zip(features) {
        products.iter_mut().zip(model.b()).for_each(|(product, b)| *product = feature * b);
    }
    if of.drift {
        expanded[of.full_len() - 1] = model.drift;
    }
}

/// Adds to `x` at each lag the weighted sum of the features of that lag.
fn fold(features: &[f64], lags: usize, weights: &[f64], x: &mut [f64]) {
    for (features, weight) in features.chunks_exact(lags).zip(weights) {
        x.iter_mut().zip(features).for_each(|(x, feature)| *x += weight * feature);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dot, quality::Forecasts, sample::RegressorRow, sample::SlidingBuffer};
    use pipeline::hammerstein::{Basis, InputMap};

    const STRUCTURE: Structure = Structure { na: 3, nb: 1, nk: 2, order: 3, ..Structure::PAPER };

    /// The structure with each of its options, and with all of them.
    fn structures() -> [Structure; 6] {
        let dead_band = InputMap { dead_band: (0.1, 0.2), ..InputMap::PAPER };
        let hinges = InputMap { basis: Basis::hinges(&[0.0, 0.3, 0.6]).unwrap(), ..InputMap::PAPER };
        [
            STRUCTURE,
            Structure { integrator: true, ..STRUCTURE },
            Structure { drift: true, ..STRUCTURE },
            Structure { input: dead_band, ..STRUCTURE },
            Structure { input: hinges, ..STRUCTURE },
            Structure {
                integrator: true,
                drift: true,
                input: InputMap { basis: hinges.basis, ..dead_band },
                ..STRUCTURE
            },
        ]
    }

    fn model(structure: Structure) -> Coefficients {
        let mut model = Coefficients::zero(structure);
        if structure.drift {
            model.drift = 0.07;
        }
        model.a[..3].copy_from_slice(&[-1.4, 0.6, -0.15]);
        model.b[..2].copy_from_slice(&[0.3, 0.2]);
        model.f[..3].copy_from_slice(&[1.0, 0.5, -0.2]);
        model.g[..3].copy_from_slice(&[0.8, -0.3, 0.1]);
        model
    }

    fn inputs() -> Vec<f64> {
        (0..60).map(|k| (k as f64 * 0.9).sin()).collect()
    }

    fn outputs() -> Vec<f64> {
        // Two sines alone would satisfy a difference equation without a command.
        (0..60).map(|k| (k as f64 * 0.31).cos() + 0.3 * (k as f64 * k as f64).sin()).collect()
    }

    /// The row of sample `k`, of orders one larger than those of `structure`.
    fn row(structure: Structure, k: usize) -> RegressorRow {
        let published = structure.published();
        let mut row = RegressorRow::new(Structure { na: published.na + 1, nb: published.nb + 1, ..published });
        let (mut y, mut u) = (SlidingBuffer::new(60, 1), SlidingBuffer::new(60, 6));
        outputs()[..k].iter().for_each(|v| y.push(*v));
        inputs()[..k].iter().for_each(|v| u.push_with(|slot| structure.input.features(*v, slot)));
        row.fill(&y, &u);
        row
    }

    /// Every form that can represent the separated model, with the theta that does.
    fn forms(structure: Structure) -> Vec<(Regression, Vec<f64>)> {
        let model = model(structure);
        let drift = &[model.drift][..structure.drift as usize];
        let mut full = model.a().to_vec();
        for c in model.f[..3].iter().chain(&model.g[..3]) {
            full.extend(model.b().iter().map(|b| c * b));
        }
        let n = model.nonlinearity();
        vec![
            (Regression::full(structure), [&full[..], drift].concat()),
            (Regression::linear(structure, &n), [model.a(), model.b(), drift].concat()),
            (Regression::directional(structure, &n), [model.a(), model.b(), model.b(), drift].concat()),
        ]
    }

    #[test]
    fn every_form_predicts_what_the_model_predicts() {
        for structure in structures() {
            let model = model(structure);
            // The published model has the integrator multiplied in.
            let published = if structure.integrator { model.integrated() } else { model };
            let row = row(structure, 60);
            let x: Vec<f64> = (0..2).map(|j| model.nonlinearity().evaluate(inputs()[60 - 2 - j])).collect();
            let newest: Vec<f64> = outputs().into_iter().rev().take(4).collect();
            let expected = published.predict_one(&newest, &x);
            let mut written = vec![0.0; row.values().len()];
            write_out(&published, &row.structure(), &mut written);
            assert!((dot(&written, row.values()) - expected).abs() < 1e-14);
            for (regression, theta) in forms(structure) {
                assert_eq!(theta.len(), regression.len());
                let mut phi = vec![0.0; regression.len()];
                regression.regressor(row.values(), &row.structure(), &mut phi);
                let target = regression.target(expected, row.values());
                assert!((dot(&phi, &theta) - target).abs() < 1e-14, "{regression:?}");
                let mut expanded = vec![0.0; row.values().len()];
                regression.expand(&theta, &row.structure(), &mut expanded);
                for (found, written) in expanded.iter().zip(&written) {
                    assert!((found - written).abs() < 1e-15, "{regression:?}");
                }
            }
        }
    }

    #[test]
    fn a_forecast_is_the_models_own_prediction_whenever_it_was_launched() {
        for structure in structures() {
            let model = model(structure);
            let published = if structure.integrator { model.integrated() } else { model };
            let of = row(structure, 40).structure();
            let mut theta = vec![0.0; of.full_len()];
            write_out(&published, &of, &mut theta);
            let mut forecasts = Forecasts::new(of.na, of.full_len() - of.na, 3);
            for (lane, start) in [38, 40, 43].into_iter().enumerate() {
                (if lane == 0 { 39 } else { [38, 40, 43][lane - 1] + 1 }..=start)
                    .for_each(|k| forecasts.advance(row(structure, k).driven()));
                forecasts.launch(lane, &theta, &outputs()[..=start]);
            }
            (44..=50).for_each(|k| forecasts.advance(row(structure, k).driven()));
            for (lane, start) in [38usize, 40, 43].into_iter().enumerate() {
                let newest: Vec<f64> = outputs()[..=start].iter().rev().take(5).copied().collect();
                let mut predicted = vec![0.0; 50 - start];
                published.predict(&newest, &inputs()[start + 1 - 2 - 1..], &mut predicted);
                let (found, expected) = (forecasts.predicted(lane), predicted[49 - start]);
                assert!((found - expected).abs() < 1e-13, "{structure:?} {lane}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_projected_problem_is_the_problem_of_the_projected_rows() {
        for structure in structures() {
            let rows: Vec<(RegressorRow, f64)> =
                (10..60).map(|k| (row(structure, k), (k as f64 * 0.77).sin())).collect();
            let of = rows[0].0.structure();
            let mut all = Triangle::new(of.full_len());
            rows.iter().for_each(|(row, y)| all.add(row.values(), *y));
            for (regression, _) in forms(structure) {
                let (mut direct, mut projected) = (Triangle::new(regression.len()), Triangle::new(regression.len()));
                let mut phi = vec![0.0; regression.len()];
                for (row, y) in &rows {
                    regression.regressor(row.values(), &of, &mut phi);
                    direct.add(&phi, regression.target(*y, row.values()));
                }
                regression.project(&all, &of, &mut projected);
                assert_eq!(projected.count(), direct.count());
                assert!(
                    (projected.residual() / direct.residual() - 1.0).abs() < 1e-9,
                    "{structure:?} {regression:?} {} {}",
                    projected.residual(),
                    direct.residual()
                );
                let n = regression.len();
                for (i, j) in (0..n).flat_map(|i| (i..=n).map(move |j| (i, j))) {
                    // Rows are determined up to their sign.
                    let (a, b) = (projected.entry(i, j), direct.entry(i, j));
                    assert!(
                        (a.abs() - b.abs()).abs() < 1e-9 * all.residual().sqrt().max(1.0),
                        "{regression:?} {i} {j}"
                    );
                }
            }
        }
    }
}
