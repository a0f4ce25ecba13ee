//! How well the past outputs alone predict: what a model with commands has to be better than.
//!
//! ```text
//! y(k+h) - y(k) ~ c + e y(k) + sum d_i (y(k-i) - y(k-i-1))          i = 0 .. na-1
//! ```
//!
//! y output in its unit, h horizon in samples; c, e and d_i by least squares over the same rows, so this is the best
//! linear prediction of its kind in hindsight. Trap: a smooth output is predicted well by any model that has its past.
//! Commands of another axis, or noise in their place, leave such a model far better than holding still.

use nalgebra::{DMatrix, DVector};

/// Part of the largest singular value below which a direction counts as not determined.
const DETERMINED: f64 = 1e-9;
/// Most rows that are used; of a longer record, every second, third .. row.
const MOST_ROWS: usize = 100_000;

/// Error (rmse) of the prediction h steps ahead, in the unit of the outputs; none where there are too few rows.
/// `outputs` are NaN where there is none, and `begins` says before which rows a gap is.
pub fn rmse(outputs: &[f64], begins: &[bool], horizon: usize, na: usize) -> Option<f64> {
    let (rows, targets) = regression(outputs, begins, horizon, na);
    let columns = na + 2;
    if targets.len() <= 2 * columns {
        return None;
    }
    let mut phi = DMatrix::from_row_slice(targets.len(), columns, &rows);
    let y = DVector::from_vec(targets);
    // Columns of one size, or those of a small output would count as not determined.
    for mut column in phi.column_iter_mut() {
        let largest = column.amax();
        if largest > 0.0 {
            column /= largest;
        }
    }
    let normal = (phi.transpose() * &phi).svd(true, true);
    let limit = DETERMINED * normal.singular_values.amax();
    let theta = normal.solve(&(phi.transpose() * &y), limit).ok()?;
    let errors = &y - &phi * theta;
    Some((errors.norm_squared() / errors.len() as f64).sqrt())
}

/// The rows of the regression, one after the other, and their targets.
fn regression(outputs: &[f64], begins: &[bool], horizon: usize, na: usize) -> (Vec<f64>, Vec<f64>) {
    let apart = outputs.len().div_ceil(MOST_ROWS);
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    let mut start = 0;
    for end in 0..outputs.len() {
        if begins[end] || outputs[end].is_nan() {
            start = if outputs[end].is_nan() { end + 1 } else { end };
        }
        let Some(k) = end.checked_sub(horizon).filter(|k| *k >= start + na && end % apart == 0) else { continue };
        rows.extend([1.0, outputs[k]]);
        rows.extend((0..na).map(|i| outputs[k - i] - outputs[k - i - 1]));
        targets.push(outputs[end] - outputs[k]);
    }
    (rows, targets)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y(k+1) = 0.9 y(k) + e: the best prediction h steps ahead is 0.9^h y(k), with var sum_{i<h} 0.81^i s2.
    #[test]
    fn the_prediction_of_an_autoregression_has_its_known_error() {
        let mut state = 1_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let mut y = vec![0.0];
        for k in 0..40_000 {
            y.push(0.9 * y[k] + noise());
        }
        let mut begins = vec![false; y.len()];
        begins[0] = true;
        let expected = (1.0 / 12.0 * (0..5).map(|i| 0.81_f64.powi(i)).sum::<f64>()).sqrt();
        let found = rmse(&y, &begins, 5, 3).unwrap();
        assert!((found / expected - 1.0).abs() < 0.02, "{found} for {expected}");
    }

    #[test]
    fn a_sine_is_predicted_exactly_and_no_row_crosses_a_gap() {
        let mut y: Vec<f64> = (0..2000).map(|k| (0.01 * f64::from(k)).sin()).collect();
        let mut begins = vec![false; y.len()];
        (begins[0], begins[1000]) = (true, true);
        y[1000..].iter_mut().for_each(|y| *y += 100.0);
        assert!(rmse(&y[..1000], &begins[..1000], 25, 3).unwrap() < 1e-6);
        let across = regression(&y, &begins, 25, 3).1;
        assert!(across.iter().all(|step| step.abs() < 1.0), "a row crosses the gap");
        assert_eq!(rmse(&y[..30], &begins[..30], 25, 3), None);
    }

    #[test]
    fn rows_without_an_output_are_left_out() {
        let mut y: Vec<f64> = (0..500).map(|k| (0.05 * f64::from(k)).sin()).collect();
        y[250] = f64::NAN;
        let begins = vec![false; y.len()];
        assert!(rmse(&y, &begins, 10, 2).unwrap() < 1e-6);
    }
}
