//! A sign of the command that the training did not have: until it comes, that direction mirrors the other one.
//!
//! ```text
//! N(-u) = -N(u)      row (-phi_a, features of -u),  target -y,  for every row (phi_a, features of u),  y
//! ```
//!
//! phi_a outputs and drift of a row, u command, y output, N nonlinearity. The mirrored rows count as [`ROWS`] of half a
//! horizon together, so that what the direction shows replaces them soon. Trap: coefficients that no row determines are
//! held at zero for good, so a member would never learn a direction that was missing in its training.

use pipeline::hammerstein::{Basis, Coefficients, Structure};

use crate::least_squares::Triangle;

/// What all mirrored rows count as, in rows of a horizon.
const ROWS: f64 = 0.5;

/// Completes the rows of a training. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Mirror {
    completed: Triangle,
    horizon: f64,
    /// The sign that is made from the other one, as an index; none where both are known, or none is.
    missing: Option<usize>,
}

impl Mirror {
    /// For rows of `n` entries and a horizon in samples.
    pub fn new(n: usize, horizon: usize) -> Self {
        Self { completed: Triangle::new(n), horizon: horizon as f64, missing: None }
    }

    /// Finds the sign of the command, positive or negative, that no row of the structure `of` has.
    pub fn look(&mut self, rows: &Triangle, of: &Structure) {
        let per_sign = of.order * (of.nb + 1);
        let is_missing = |sign: &usize| {
            let mut columns = of.na + sign * per_sign..of.na + (sign + 1) * per_sign;
            columns.all(|column| (0..=column).all(|row| rows.entry(row, column) == 0.0))
        };
        let mut missing = (0..2).filter(is_missing);
        self.missing = missing.next().filter(|_| missing.next().is_none());
    }

    /// The rows with the mirrored ones where a sign is missing.
    pub fn complete<'a>(&'a mut self, rows: &'a Triangle, of: &Structure) -> &'a Triangle {
        let Some(missing) = self.missing else { return rows };
        let (na, lags, order) = (of.na, of.nb + 1, of.order);
        let weight = (ROWS * self.horizon / rows.count().max(1) as f64).sqrt().min(1.0);
        self.completed.clear();
        self.completed.add_mapped(rows, |row, target, out| {
            out.copy_from_slice(row);
            target
        });
        self.completed.add_mapped(rows, |row, target, out| {
            out.iter_mut().zip(row).for_each(|(out, value)| *out = -weight * value);
            for power in 0..order {
                let known = na + ((1 - missing) * order + power) * lags;
                let made = na + (missing * order + power) * lags;
                for lag in 0..lags {
                    out[made + lag] = weight * sign(of, power) * -row[known + lag];
                    out[known + lag] = 0.0;
                }
            }
            -weight * target
        });
        &self.completed
    }

    /// The model with the missing branch of its nonlinearity made from the other one.
    pub fn complete_model(&self, model: &Coefficients, of: &Structure) -> Coefficients {
        let mut model = *model;
        for power in 0..of.order {
            match self.missing {
                Some(0) => model.f[power] = sign(of, power) * model.g[power],
                Some(_) => model.g[power] = sign(of, power) * model.f[power],
                None => {}
            }
        }
        model
    }
}

/// What the coefficient of a feature, from 0, is to that of the other branch where the nonlinearity is odd.
fn sign(of: &Structure, power: usize) -> f64 {
    match of.input.basis {
        Basis::Powers if power % 2 == 1 => -1.0,
        Basis::Powers | Basis::Hinges(_) => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::hammerstein::InputMap;

    const POWERS: Structure = Structure { na: 2, nb: 1, nk: 1, order: 3, ..Structure::PAPER };

    /// The rows of y = phi' theta over commands of these sizes, all of one sign.
    fn rows(of: &Structure, theta: &[f64], sign: f64) -> Triangle {
        let mut rows = Triangle::new(of.full_len());
        for k in 0..400 {
            let k = f64::from(k);
            let mut row = vec![(0.7 * k).sin(), (1.9 * k).cos()];
            row.resize(of.full_len(), 0.0);
            for lag in 0..2 {
                let mut features = [0.0; 6];
                of.input.features(sign * (0.5 + 0.5 * (k * (0.31 + 0.17 * f64::from(lag))).sin()), &mut features);
                features.iter().enumerate().for_each(|(i, feature)| row[2 + 2 * i + lag as usize] = *feature);
            }
            let y = row.iter().zip(theta).map(|(a, b)| a * b).sum();
            rows.add(&row, y);
        }
        rows
    }

    #[test]
    fn the_missing_direction_is_the_mirror_image_of_the_other_one() {
        let hinges = InputMap { basis: Basis::hinges(&[0.0, 0.3, 0.6]).unwrap(), ..InputMap::PAPER };
        for of in [POWERS, Structure { input: hinges, ..POWERS }] {
            for missing in [0, 1] {
                let mut model = Coefficients::zero(of);
                model.a[..2].copy_from_slice(&[-1.5, 0.6]);
                model.b[..2].copy_from_slice(&[0.3, 0.1]);
                let branch = if missing == 0 { &mut model.g } else { &mut model.f };
                branch[..3].copy_from_slice(&[0.9, 0.4, -0.2]);
                let mut theta = vec![0.0; of.full_len()];
                crate::regression::write_out(&model, &of, &mut theta);
                let rows = rows(&of, &theta, if missing == 0 { -1.0 } else { 1.0 });
                let mut mirror = Mirror::new(of.full_len(), 20);
                mirror.look(&rows, &of);
                let completed = mirror.complete_model(&model, &of);
                let (n, u) = (completed.nonlinearity(), 0.7);
                assert!((n.evaluate(u) + n.evaluate(-u)).abs() < 1e-15 && n.evaluate(u) != 0.0, "{missing}");
                let mut expected = vec![0.0; of.full_len()];
                crate::regression::write_out(&completed, &of, &mut expected);
                mirror.complete(&rows, &of).solve(&mut theta);
                for (found, expected) in theta.iter().zip(&expected) {
                    assert!((found - expected).abs() < 1e-9, "{missing}: {theta:?} {expected:?}");
                }
            }
        }
    }

    #[test]
    fn rows_of_both_signs_and_of_none_stay_as_they_are() {
        let mut both = rows(&POWERS, &[0.1; 14], 1.0);
        both.add_mapped(&rows(&POWERS, &[0.1; 14], -1.0), |row, target, out| {
            out.copy_from_slice(row);
            target
        });
        let mut mirror = Mirror::new(14, 20);
        for rows in [both, Triangle::new(14)] {
            mirror.look(&rows, &POWERS);
            let found = mirror.complete(&rows, &POWERS);
            assert!(std::ptr::eq(found, &raw const rows));
        }
    }
}
