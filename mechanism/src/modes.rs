//! Natural frequencies of the cylinders on springs, undamped.
//!
//! ```text
//! M_l v w^2 = K v          K = diag(k)          f = w / (2 pi)
//! C = K^-1/2 M_l K^-1/2,   C y = y / w^2,       y = K^1/2 v
//! ```
//!
//! M_l mass matrix of the cylinders in kg, k stiffness of the oil in each cylinder in N/m, w angular frequency in 1/s.
//! C is symmetric, and Jacobi's method finds its eigenvalues by rotations that make one entry after the other zero (G.
//! Golub, C. Van Loan, Matrix Computations, 4th ed., section 8.5).

use crate::AXES;

/// Sweeps over all entries. Four by four entries are zero to the last bit after five or six.
const SWEEPS: usize = 10;

/// Natural frequencies, Hz, rising, of cylinders with the mass matrix `mass`, kg, on springs of `stiffness`, N/m.
pub fn natural_frequencies(mass: &[[f64; AXES]; AXES], stiffness: &[f64; AXES]) -> [f64; AXES] {
    let root = stiffness.map(f64::sqrt);
    let mut matrix: [[f64; AXES]; AXES] =
        std::array::from_fn(|i| std::array::from_fn(|j| mass[i][j] / (root[i] * root[j])));
    for _ in 0..SWEEPS {
        for i in 0..AXES {
            for j in 0..i {
                rotate(&mut matrix, i, j);
            }
        }
    }
    let mut frequencies: [f64; AXES] =
        std::array::from_fn(|i| 1.0 / (matrix[i][i].sqrt() * 2.0 * std::f64::consts::PI));
    frequencies.sort_by(f64::total_cmp);
    frequencies
}

/// Turns the axes i and j so that the entry between them becomes zero.
fn rotate(matrix: &mut [[f64; AXES]; AXES], i: usize, j: usize) {
    if matrix[i][j] == 0.0 {
        return;
    }
    let ratio = (matrix[j][j] - matrix[i][i]) / (2.0 * matrix[i][j]);
    let tan = ratio.signum() / (ratio.abs() + (1.0 + ratio * ratio).sqrt());
    let cos = 1.0 / (1.0 + tan * tan).sqrt();
    let sin = tan * cos;
    for row in matrix.iter_mut() {
        (row[i], row[j]) = (cos * row[i] - sin * row[j], sin * row[i] + cos * row[j]);
    }
    let (a, b) = (matrix[i], matrix[j]);
    matrix[i] = std::array::from_fn(|k| cos * a[k] - sin * b[k]);
    matrix[j] = std::array::from_fn(|k| sin * a[k] + cos * b[k]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cylinders_without_coupling_swing_alone() {
        let mut mass = [[0.0; AXES]; AXES];
        (0..AXES).for_each(|i| mass[i][i] = [4.0, 1.0, 9.0, 16.0][i]);
        let found = natural_frequencies(&mass, &[4.0, 4.0, 4.0, 4.0]);
        let expected = [0.5, 2.0 / 3.0, 1.0, 2.0].map(|rate| rate / (2.0 * std::f64::consts::PI));
        found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-15, "{found:?}"));
    }

    #[test]
    fn equal_coupled_masses_swing_together_and_against_one_another() {
        // Two and two masses 2 with the coupling 1: the eigenvalues of M are 1 and 3.
        let mass = [[2.0, 1.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, -1.0], [0.0, 0.0, -1.0, 2.0]];
        let found = natural_frequencies(&mass, &[3.0; AXES]).map(|f| (f * 2.0 * std::f64::consts::PI).powi(2));
        found.iter().zip([1.0, 1.0, 3.0, 3.0]).for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{found:?}"));
    }

    #[test]
    fn a_full_matrix_has_the_product_and_the_sum_of_its_eigenvalues() {
        let mass = [[5.0, 1.0, -2.0, 0.3], [1.0, 4.0, 0.7, 1.1], [-2.0, 0.7, 6.0, -0.4], [0.3, 1.1, -0.4, 3.0]];
        let values = natural_frequencies(&mass, &[1.0; AXES]).map(|f| (f * 2.0 * std::f64::consts::PI).powi(-2));
        assert!((values.iter().sum::<f64>() - 18.0).abs() < 1e-13);
        let squares: f64 = mass.concat().iter().map(|entry| entry * entry).sum();
        assert!((values.iter().map(|value| value * value).sum::<f64>() - squares).abs() < 1e-12);
    }
}
