//! Regressors and outputs that all benchmarks and `peers.py` share.

/// A bounded sequence without structure that matters here.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

/// 1024 rows of a regression with `n` coefficients.
pub fn rows(n: usize) -> Vec<(Vec<f64>, f64)> {
    (0..1024)
        .map(|k| {
            let phi: Vec<f64> = (0..n).map(|j| noise(k * n + j)).collect();
            let y = phi.iter().enumerate().map(|(j, p)| p / (j + 1) as f64).sum::<f64>() + 0.01 * noise(k + 7);
            (phi, y)
        })
        .collect()
}
