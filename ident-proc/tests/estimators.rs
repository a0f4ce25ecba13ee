//! Properties that every estimator must have, and those of single estimators.
//!
//! A new estimator needs one line in [`CASES`].

use ident_proc::{
    estimator::{RecursiveEstimator, fuzzy::FuzzyForgetting},
    least_squares::Triangle,
    recursive::RecursiveLeastSquares,
};
use nalgebra::{DMatrix, DVector};
use pipeline::machine::{self, Fuzzy};

/// The setting of each estimator, and the samples within which it follows a step of all coefficients.
const CASES: [(&str, usize); 7] = [
    ("constant:0.98", 300),
    ("constant:0.75", 60),
    ("rules", 300),
    ("fuzzy:0.9", 150),
    ("fortescue:200", 150),
    // 5 / (1 - 0.95) samples of memory.
    ("directional:0.95", 400),
    // The last old row must have left.
    ("window:100", 100),
];

const N: usize = 5;
const TRUTH: [f64; N] = [0.5, 0.4, 0.3, -0.2, 0.1];
/// The noise of the targets is uniform between plus and minus this.
const NOISE: f64 = 0.05;
const TRAINING: usize = 200;

/// A fixed pseudo-random sequence between -1 and 1.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

/// A row that excites all coefficients.
fn row(k: usize) -> [f64; N] {
    std::array::from_fn(|j| noise(k * N + j))
}

fn target(row: &[f64], truth: &[f64], k: usize) -> f64 {
    dot(row, truth) + NOISE * noise(k * 7919 + 13)
}

fn dot(one: &[f64], two: &[f64]) -> f64 {
    one.iter().zip(two).map(|(one, two)| one * two).sum()
}

fn training() -> Triangle {
    let mut data = Triangle::new(N);
    (0..TRAINING).for_each(|k| data.add(&row(k), target(&row(k), &TRUTH, k)));
    data
}

fn started(setting: &str) -> RecursiveEstimator {
    let data = training();
    let sigma = (data.residual() / (TRAINING - N) as f64).sqrt();
    let mut estimator = RecursiveEstimator::new(setting.parse().unwrap(), N, &Fuzzy::RESIDUALS);
    estimator.start(&data, &[false; N], sigma);
    estimator
}

fn covariance(factors: &RecursiveLeastSquares, n: usize) -> DMatrix<f64> {
    DMatrix::from_fn(n, n, |i, j| factors.covariance(i, j))
}

fn worst(theta: &[f64], truth: &[f64]) -> f64 {
    theta.iter().zip(truth).map(|(one, two)| (one - two).abs()).fold(0.0, f64::max)
}

/// Row k of a sequence of phases of 1000 samples each: full excitation, rest, one side only, very small rows, outliers,
/// rows of zero.
fn life(rows: &[[f64; N]], k: usize) -> [f64; N] {
    let row = rows[k % rows.len()];
    match k / 1000 % 6 {
        0 => row,
        1 => [0.3, 0.3, 0.3, 0.0, 0.0],
        2 => [row[0].abs(), row[1].abs(), 0.0, 0.0, 0.0],
        3 => row.map(|value| 1e-9 * value),
        4 if k.is_multiple_of(100) => row.map(|value| 1e4 * value),
        4 => row,
        _ => [0.0; N],
    }
}

fn ten_million_updates(setting: &str, rows: &[[f64; N]]) {
    let mut estimator = started(setting);
    // The trace of the covariance that one average training row gives.
    let weakest = TRAINING as f64 * estimator.recursion().covariance_trace();
    let errors: Vec<f64> = (0..rows.len()).map(|k| NOISE * noise(k * 7919 + 13)).collect();
    for k in 0..10_000_000 {
        let row = life(rows, k);
        let adapted = estimator.update(&row, dot(&row, &TRUTH) + errors[k % errors.len()]);
        assert!(adapted.factor > 0.0 && adapted.factor <= 1.0, "{setting} {k}: {adapted:?}");
        // No multiple of the phases, so that all of them are checked.
        if k % 99_991 == 0 || k == 9_999_999 {
            let p = covariance(estimator.recursion(), N);
            assert!(estimator.recursion().is_finite(), "{setting} {k}");
            assert!(p == p.transpose() && p.clone().cholesky().is_some(), "{setting} {k}: {p}");
            assert!(p.trace() < 4.0 * weakest, "{setting} {k}: {} of {weakest}", p.trace());
        }
    }
    (0..600).for_each(|k| {
        estimator.update(&rows[k], dot(&rows[k], &TRUTH) + errors[k]);
    });
    let bound = if setting == "constant:0.75" { 0.2 } else { 0.03 };
    assert!(worst(estimator.theta(), &TRUTH) < bound, "{setting}: {:?}", estimator.theta());
}

#[test]
fn the_covariance_stays_positive_definite_and_bounded_for_ten_million_updates() {
    let rows: Vec<[f64; N]> = (0..8191).map(row).collect();
    std::thread::scope(|scope| {
        for (setting, _) in CASES {
            let rows = &rows;
            scope.spawn(move || ten_million_updates(setting, rows));
        }
    });
}

#[test]
fn a_step_of_all_coefficients_is_followed() {
    let after: [f64; N] = std::array::from_fn(|j| TRUTH[j] + if j % 2 == 0 { 0.8 } else { -0.6 });
    for (setting, within) in CASES {
        let mut estimator = started(setting);
        (0..2000).for_each(|k| {
            estimator.update(&row(k), target(&row(k), &TRUTH, k));
        });
        assert!(worst(estimator.theta(), &TRUTH) < 0.1, "{setting}: {:?}", estimator.theta());
        (2000..2000 + within).for_each(|k| {
            estimator.update(&row(k), target(&row(k), &after, k));
        });
        assert!(worst(estimator.theta(), &after) < 0.1, "{setting}: {:?}", estimator.theta());
    }
}

#[test]
fn a_rest_does_not_make_the_coefficients_worse() {
    let rest = [0.3, 0.3, 0.3, 0.0, 0.0];
    for (setting, _) in CASES {
        let (mut rested, mut busy) = (started(setting), started(setting));
        let both = |rested: &mut RecursiveEstimator, busy: &mut RecursiveEstimator, k: usize| {
            rested.update(&row(k), target(&row(k), &TRUTH, k));
            busy.update(&row(k), target(&row(k), &TRUTH, k));
            (worst(rested.theta(), &TRUTH), worst(busy.theta(), &TRUTH))
        };
        (0..500).for_each(|k| {
            both(&mut rested, &mut busy, k);
        });
        (500..20_500).for_each(|k| {
            rested.update(&rest, target(&rest, &TRUTH, k));
        });
        let mut largest = (0.0, 0.0);
        for k in 500..1000 {
            let errors = both(&mut rested, &mut busy, k);
            largest = (f64::max(largest.0, errors.0), f64::max(largest.1, errors.1));
        }
        let last = (worst(rested.theta(), &TRUTH), worst(busy.theta(), &TRUTH));
        println!("{setting}: largest {largest:?}, last {last:?}");
        assert!(last.0 < 1.2 * last.1 + 1e-3, "{setting}: {last:?}");
        // The first rows after the rest change the coefficients much, but throw none of them away.
        assert!(largest.0 < 1.5 * largest.1 + 0.15, "{setting}: {largest:?}");
    }
}

#[test]
fn values_that_are_not_finite_change_nothing() {
    for (setting, _) in CASES {
        let mut estimator = started(setting);
        let mut clean = started(setting);
        for k in 0..500 {
            let (row, y) = (row(k), target(&row(k), &TRUTH, k));
            assert_eq!(estimator.update(&row, y), clean.update(&row, y), "{setting} {k}");
            for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut poisoned = row;
                poisoned[k % N] = poison;
                for adapted in [estimator.update(&poisoned, y), estimator.update(&row, poison)] {
                    assert!(!adapted.innovation.is_finite() && adapted.factor == 1.0, "{setting}: {adapted:?}");
                }
            }
        }
        assert_eq!(estimator.theta(), clean.theta(), "{setting}");
        assert_eq!(estimator.recursion().covariance_trace(), clean.recursion().covariance_trace(), "{setting}");
    }
}

#[test]
fn held_coefficients_stay() {
    let held = [false, false, true, false, true];
    let mut data = Triangle::new(N);
    training().hold_into(&held, &mut data);
    for (setting, _) in CASES {
        let mut estimator = RecursiveEstimator::new(setting.parse().unwrap(), N, &Fuzzy::RESIDUALS);
        estimator.start(&data, &held, 0.03);
        let mut theta = estimator.theta().to_vec();
        (theta[2], theta[4]) = (0.7, -0.3);
        estimator.set_theta(&theta);
        assert_eq!(estimator.theta(), theta, "{setting}");
        let truth = [0.1, 0.9, 0.7, 0.5, -0.3];
        (0..1000).for_each(|k| {
            estimator.update(&row(k), target(&row(k), &truth, k));
        });
        assert_eq!((estimator.theta()[2], estimator.theta()[4]), (0.7, -0.3), "{setting}");
        assert!(worst(estimator.theta(), &truth) < 0.1, "{setting}: {:?}", estimator.theta());
    }
}

#[test]
fn that_of_the_rules_and_the_constant_factor_are_the_plain_recursion_to_the_last_bit() {
    let data = training();
    let (mut rules, mut constant) = (started("rules"), started("constant:0.97"));
    let mut fuzzy = FuzzyForgetting::new(Fuzzy::RESIDUALS, (data.residual() / (TRAINING - N) as f64).sqrt());
    let mut plain = RecursiveLeastSquares::new(N);
    plain.start(&data, &[false; N]);
    let mut plain_constant = plain.clone();
    assert_eq!(rules.universes(), Some(fuzzy.universes()));
    assert_eq!(constant.universes(), None);
    for k in 0..2000 {
        let y = target(&row(k), &TRUTH, k) + if k > 1000 { 0.5 } else { 0.0 };
        let factor = fuzzy.factor(y - dot(&row(k), plain.theta()));
        let (update, adapted) = (plain.update(&row(k), y, factor), rules.update(&row(k), y));
        assert_eq!((adapted.innovation, adapted.factor, adapted.bounded), (update.innovation, factor, update.bounded));
        plain_constant.update(&row(k), y, 0.97);
        assert_eq!(constant.update(&row(k), y).factor, 0.97);
    }
    assert_eq!((plain.theta(), plain_constant.theta()), (rules.theta(), constant.theta()));
    assert_eq!(plain.covariance_trace(), rules.recursion().covariance_trace());
}

#[test]
fn the_covariance_of_the_paper_alone_has_no_bound_and_its_coefficients_stay_finite() {
    let one_sided = [0.3, 0.3, 0.3, 0.0, 0.0];
    for (setting, is_bounded) in [("paper", false), ("rules", true)] {
        let mut estimator = started(setting);
        let weakest = TRAINING as f64 * estimator.recursion().covariance_trace();
        let mut bounded = false;
        for k in 0..5000 {
            // Errors beyond the universe, so that the factor is 0.75.
            let adapted = estimator.update(&one_sided, if k % 2 == 0 { 1e3 } else { -1e3 });
            bounded |= adapted.bounded;
            if k == 100 {
                assert_eq!(estimator.recursion().covariance_trace() < 4.0 * weakest, is_bounded, "{setting}");
            }
        }
        assert_eq!(bounded, is_bounded, "{setting}");
        assert!(estimator.theta().iter().all(|value| value.is_finite()), "{setting}: {:?}", estimator.theta());
    }
}

/// The coefficients and the covariance of the rows in `rows` with the prior around `center`.
fn solved(prior: &DMatrix<f64>, center: &[f64], rows: &[(Vec<f64>, f64)]) -> (Vec<f64>, DMatrix<f64>) {
    let n = center.len();
    let stacked = DMatrix::from_fn(n + rows.len(), n, |i, j| if i < n { prior[(i, j)] } else { rows[i - n].0[j] });
    let targets =
        DVector::from_fn(n + rows.len(), |i, _| if i < n { 0.0 } else { rows[i - n].1 - dot(&rows[i - n].0, center) });
    let qr = stacked.qr();
    let deviation = qr.r().solve_upper_triangular(&(qr.q().transpose() * targets)).unwrap();
    let inverse = qr.r().try_inverse().unwrap();
    (center.iter().zip(deviation.iter()).map(|(center, d)| center + d).collect(), &inverse * inverse.transpose())
}

#[test]
fn a_window_holds_the_last_rows_and_no_others() {
    for (n, rows) in [(5, 5), (5, 7), (5, 50), (15, 333), (16, 64)] {
        let wide = |k: usize| -> Vec<f64> { (0..n).map(|j| noise(k * n + j)).collect() };
        let truth = |k: usize, j: usize| 0.5 - 0.1 * j as f64 + if k > 1500 { 0.3 } else { 0.0 };
        let y = |row: &[f64], k: usize| {
            row.iter().enumerate().map(|(j, value)| value * truth(k, j)).sum::<f64>() + NOISE * noise(k * 7919 + 13)
        };
        let mut data = Triangle::new(n);
        (0..TRAINING).for_each(|k| data.add(&wide(k), y(&wide(k), k)));
        let mut estimator = RecursiveEstimator::new(machine::Estimator::Window(rows), n, &Fuzzy::RESIDUALS);
        estimator.start(&data, &vec![false; n], 0.03);
        let mut center = vec![0.0; n];
        data.solve(&mut center);
        assert!(worst(estimator.theta(), &center) < 1e-12);
        center.iter_mut().for_each(|value| *value += 0.01);
        estimator.set_theta(&center);
        let upper = |i: usize, j: usize| if j >= i { data.entry(i, j) / (TRAINING as f64).sqrt() } else { 0.0 };
        let prior = DMatrix::from_fn(n, n, upper);
        let mut seen = Vec::new();
        for k in 0..3000 {
            let mut phi = wide(k);
            match k / 100 % 7 {
                2 => phi.fill(0.3),
                3 => phi[n / 2..].fill(0.0),
                4 => phi.iter_mut().for_each(|value| *value *= 1e-6),
                5 if k % 30 == 0 => phi.iter_mut().for_each(|value| *value *= 100.0),
                6 => phi.fill(0.0),
                _ => {}
            }
            let y = y(&phi, k);
            let adapted = estimator.update(&phi, y);
            assert!(!adapted.bounded && adapted.factor == 1.0 - 1.0 / rows as f64);
            seen.push((phi, y));
            if k + 1 < rows || k % 3 != 0 {
                continue;
            }
            let (theta, p) = solved(&prior, &center, &seen[k + 1 - rows..]);
            let distance = worst(estimator.theta(), &theta);
            assert!(distance < 1e-8, "n {n}, {rows} rows, sample {k}: {distance}");
            let relative = (covariance(estimator.recursion(), n) - &p).norm() / p.norm();
            assert!(relative < 1e-8, "n {n}, {rows} rows, sample {k}: {relative}");
        }
    }
}

#[test]
fn a_window_takes_rows_of_any_size_and_recovers_when_they_have_left() {
    let mut estimator = started("window:100");
    for (at, size) in [1e3, 1e5, 1e12, 1e100, 1e150, 1e300].into_iter().enumerate() {
        let huge = row(at).map(|value| size * value);
        estimator.update(&huge, 1.0);
        assert!(estimator.recursion().is_finite(), "{size}");
        for k in 0..200 {
            estimator.update(&row(k), target(&row(k), &TRUTH, k));
            assert!(covariance(estimator.recursion(), N).cholesky().is_some(), "{size} {k}");
        }
        assert!(worst(estimator.theta(), &TRUTH) < 0.05, "{size}: {:?}", estimator.theta());
    }
}

#[test]
fn a_window_starts_with_the_covariance_of_its_training() {
    for (rows, weight) in [(100, 100.0), (1000, 200.0)] {
        let estimator = started(&format!("window:{rows}"));
        let mut plain = RecursiveLeastSquares::new(N);
        plain.start(&training(), &[false; N]);
        let ratio = plain.covariance_trace() / estimator.recursion().covariance_trace();
        // The rows of the window, and one for the prior.
        assert!((ratio - (weight + 1.0) / 200.0).abs() < 1e-9, "{rows}: {ratio}");
    }
}

#[test]
fn directional_forgetting_keeps_directions_without_excitation() {
    let mut estimator = started("directional:0.95");
    let before = covariance(estimator.recursion(), N).try_inverse().unwrap();
    let theta = estimator.theta().to_vec();
    for k in 0..100_000 {
        let phi = [noise(2 * k), noise(2 * k + 1), 0.0, 0.0, 0.0];
        estimator.update(&phi, target(&phi, &TRUTH, k));
    }
    let after = covariance(estimator.recursion(), N).try_inverse().unwrap();
    for i in 0..N {
        for j in 2..N {
            assert!((after[(i, j)] - before[(i, j)]).abs() < 1e-6 * before.norm(), "{i} {j}: {before} {after}");
        }
    }
    assert!((after[(0, 0)] / before[(0, 0)] - 1.0).abs() > 0.05, "{before} {after}");
    assert!(worst(estimator.theta(), &theta) < 0.1);

    // Rows without excitation change nothing.
    let before = (estimator.theta().to_vec(), covariance(estimator.recursion(), N));
    for _ in 0..1000 {
        assert_eq!(estimator.update(&[0.0; N], 0.3).factor, 1.0);
    }
    assert_eq!((estimator.theta().to_vec(), covariance(estimator.recursion(), N)), before);
}

#[test]
fn directional_forgetting_gives_one_covariance_for_rows_of_any_size() {
    let settled = |size: f64| {
        let mut estimator = started("directional:0.95");
        (0..(2000.0 / (size * size)) as usize).for_each(|k| {
            let phi = row(k).map(|value| size * value);
            estimator.update(&phi, target(&phi, &TRUTH, k));
        });
        estimator.recursion().covariance_trace()
    };
    let average = settled(1.0);
    for size in [0.3, 0.1, 0.03] {
        let ratio = settled(size) / average;
        assert!((0.7..1.4).contains(&ratio), "{size}: {ratio}");
    }
}
