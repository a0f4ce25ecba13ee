use super::*;
use nalgebra::{DMatrix, DVector};

fn noise(i: usize) -> f64 {
    // A fixed pseudo-random sequence between -1 and 1.
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

fn phi(k: usize, n: usize) -> Vec<f64> {
    (0..n).map(|j| noise(k * n + j)).collect()
}

fn truth(n: usize) -> Vec<f64> {
    (0..n).map(|j| 0.5 - 0.1 * j as f64).collect()
}

fn y(k: usize, n: usize) -> f64 {
    phi(k, n).iter().zip(truth(n)).map(|(p, t)| p * t).sum::<f64>() + 0.05 * noise(k * 7919 + 13)
}

fn started(n: usize, rows: usize) -> RecursiveLeastSquares {
    let mut data = Triangle::new(n);
    (0..rows).for_each(|k| data.add(&phi(k, n), y(k, n)));
    let mut estimator = RecursiveLeastSquares::new(n);
    estimator.start(&data, &vec![false; n]);
    estimator
}

#[test]
fn without_forgetting_it_is_batch_least_squares() {
    let n = 6;
    let mut estimator = started(n, 30);
    (30..400).for_each(|k| {
        estimator.update(&phi(k, n), y(k, n), 1.0);
    });
    let rows = DMatrix::from_fn(400, n, |k, j| phi(k, n)[j]);
    let targets = DVector::from_fn(400, |k, _| y(k, n));
    let inverse = (rows.transpose() * &rows).try_inverse().unwrap();
    let batch = &inverse * rows.transpose() * targets;
    for i in 0..n {
        assert!((estimator.theta()[i] - batch[i]).abs() < 1e-12);
        for j in 0..n {
            assert!((estimator.covariance(i, j) - inverse[(i, j)]).abs() < 1e-12);
        }
    }
}

#[test]
fn with_forgetting_it_is_the_printed_recursion() {
    let n = 5;
    let mut estimator = started(n, 40);
    let mut p = DMatrix::from_fn(n, n, |i, j| estimator.covariance(i, j));
    let mut theta = DVector::from_column_slice(estimator.theta());
    for k in 40..300 {
        let lambda = 0.97 + 0.03 * (k as f64 * 0.1).sin().abs();
        let f = DVector::from_vec(phi(k, n));
        let gain = &p * &f / (lambda + f.dot(&(&p * &f)));
        theta += &gain * (y(k, n) - f.dot(&theta));
        p = (&p - &gain * f.transpose() * &p) / lambda;
        p = (&p + p.transpose()) * 0.5;
        let update = estimator.update(f.as_slice(), y(k, n), lambda);
        assert!(!update.bounded);
    }
    for i in 0..n {
        assert!((estimator.theta()[i] - theta[i]).abs() < 1e-10);
    }
    assert!((estimator.covariance_trace() / p.trace() - 1.0).abs() < 1e-9);
}

#[test]
fn a_million_idle_samples_do_not_wind_the_covariance_up() {
    let n = 4;
    let mut estimator = started(n, 100);
    let bound: f64 = 2.0 * 100.0 * estimator.covariance_trace();
    let mut idle = vec![0.0; n];
    idle[0] = 0.5;
    for _ in 0..1_000_000 {
        estimator.update(&idle, 0.5 * truth(n)[0], 0.9);
    }
    assert!(estimator.is_finite());
    assert!(estimator.covariance_trace() < bound, "{} {bound}", estimator.covariance_trace());
    // With full excitation again it equals an estimator that never rested.
    let mut fresh = started(n, 100);
    for k in 0..500 {
        estimator.update(&phi(k, n), y(k, n), 0.98);
        fresh.update(&phi(k, n), y(k, n), 0.98);
    }
    for (a, b) in estimator.theta().iter().zip(fresh.theta()) {
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
}

#[test]
fn a_held_coefficient_stays_and_values_that_are_not_finite_change_nothing() {
    let n = 4;
    let held = [false, false, true, false];
    let mut data = Triangle::new(n);
    (0..60).for_each(|k| data.add(&phi(k, n), y(k, n)));
    let mut estimator = RecursiveLeastSquares::new(n);
    let mut restricted = Triangle::new(n);
    data.hold_into(&held, &mut restricted);
    estimator.start(&restricted, &held);
    (60..200).for_each(|k| {
        estimator.update(&phi(k, n), y(k, n), 0.95);
    });
    assert_eq!(estimator.theta()[2], 0.0);
    let before = estimator.theta().to_vec();
    for poison in [f64::NAN, f64::INFINITY] {
        assert!(!estimator.update(&phi(0, n), poison, 0.95).innovation.is_finite());
        let mut row = phi(0, n);
        row[1] = poison;
        estimator.update(&row, 1.0, 0.95);
    }
    assert_eq!(estimator.theta(), before);
    assert!(estimator.is_finite());
}

#[test]
fn forgetting_selectively_with_nothing_idle_is_the_printed_recursion() {
    for n in [3, 5, 15] {
        let (mut printed, mut selective) = (started(n, 60), started(n, 60));
        for k in 60..300 {
            printed.update(&phi(k, n), y(k, n), 0.97);
            assert!(!selective.forget_selectively(0.97, &vec![false; n]));
            selective.update(&phi(k, n), y(k, n), 1.0);
        }
        for i in 0..n {
            assert!((printed.theta()[i] - selective.theta()[i]).abs() < 1e-11);
            for j in 0..n {
                assert!((printed.covariance(i, j) - selective.covariance(i, j)).abs() < 1e-11);
            }
        }
    }
}

#[test]
fn forgetting_selectively_scales_only_the_excited_rows_and_columns() {
    let n = 5;
    let idle = [false, true, false, true, true];
    let before = started(n, 60);
    let mut after = before.clone();
    after.forget_selectively(0.81, &idle);
    let s = idle.map(|idle| if idle { 1.0 } else { 1.0 / 0.9 });
    for i in 0..n {
        for j in 0..n {
            let expected = s[i] * before.covariance(i, j) * s[j];
            assert!((after.covariance(i, j) - expected).abs() < 1e-14);
        }
    }
    // Coefficients marked as excited and never excited: each variance stays below its bound.
    assert!((0..100_000).any(|_| after.forget_selectively(0.9, &idle)));
    (0..100_000).for_each(|_| {
        after.forget_selectively(0.9, &idle);
    });
    assert!(after.is_finite());
    for (i, idle) in idle.iter().enumerate() {
        let ratio = after.covariance(i, i) / before.covariance(i, i);
        assert!(ratio <= 60.0 * (1.0 + 1e-9), "{ratio}");
        assert!(*idle || ratio > 50.0, "{ratio}");
        assert!(!idle || (ratio - 1.0).abs() < 1e-6, "{ratio}");
    }
}

#[test]
fn taking_a_row_out_undoes_taking_it_in() {
    for n in [4, 5, 16] {
        let mut before = started(n, 80);
        let mut after = before.clone();
        let rows: Vec<_> = (80..100).map(|k| (phi(k, n), y(k, n))).collect();
        for (phi, y) in &rows {
            after.update(phi, *y, 1.0);
        }
        for (phi, y) in &rows {
            assert!(after.leverage(phi) < before.leverage(phi));
            assert!(after.remove(phi, *y, 0.999));
        }
        for i in 0..n {
            assert!((before.theta()[i] - after.theta()[i]).abs() < 1e-12);
            assert!((before.covariance(i, i) / after.covariance(i, i) - 1.0).abs() < 1e-12);
        }
        let huge: Vec<f64> = phi(7, n).iter().map(|p| 1e4 * p).collect();
        after.update(&huge, 0.0, 1.0);
        assert!(!after.remove(&huge, 0.0, 0.999));
    }
}

#[test]
fn the_largest_rows_leave_an_estimator_that_still_learns() {
    let n = 5;
    let mut estimator = started(n, 100);
    for size in [1e100, 1e150, 1e200, 1e300, f64::MAX] {
        let row: Vec<f64> = phi(3, n).iter().map(|p| size * p).collect();
        estimator.update(&row, 1.0, 0.99);
        assert!(estimator.is_finite() && estimator.d().iter().all(|d| *d > 0.0), "{size}");
    }
    (0..20_000).for_each(|k| {
        estimator.update(&phi(k, n), y(k, n), 0.98);
    });
    for (a, b) in estimator.theta().iter().zip(truth(n)) {
        assert!((a - b).abs() < 0.02, "{a} {b}");
    }
}
