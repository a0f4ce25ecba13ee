//! Symmetric matrices of the size of theta, without allocation: factorisation, solution, inverse.

use pipeline::hammerstein::MAX_ORDER;

use crate::dot;

/// Largest number of parameters, those of both directions.
pub const MOST: usize = 2 * MAX_ORDER;

/// One number per parameter; only the first n of them are used.
pub type Vector = [f64; MOST];

/// A square matrix, row after row; only the leading n by n of it is used.
pub type Matrix = [Vector; MOST];

/// The lower Cholesky factor of the leading n by n of a symmetric matrix, of which the lower half is read. `None` when
/// the matrix is not positive definite.
pub fn cholesky(matrix: &Matrix, n: usize) -> Option<Matrix> {
    let mut factor = [[0.0; MOST]; MOST];
    for i in 0..n {
        for j in 0..=i {
            let rest = matrix[i][j] - dot(&factor[i][..j], &factor[j][..j]);
            factor[i][j] = match i == j {
                true if rest > 0.0 => rest.sqrt(),
                true => return None,
                false => rest / factor[j][j],
            };
        }
    }
    Some(factor)
}

/// The solution x of L L' x = `right`, L the lower factor.
pub fn solve(factor: &Matrix, right: &Vector, n: usize) -> Vector {
    let mut x = *right;
    for i in 0..n {
        x[i] = (x[i] - dot(&factor[i][..i], &x[..i])) / factor[i][i];
    }
    for i in (0..n).rev() {
        let below: f64 = (i + 1..n).map(|j| factor[j][i] * x[j]).sum();
        x[i] = (x[i] - below) / factor[i][i];
    }
    x
}

/// The inverse of a symmetric matrix, of which the lower half is read. Zero when it is not positive definite.
pub fn inverse(matrix: &Matrix, n: usize) -> Matrix {
    let mut inverse = [[0.0; MOST]; MOST];
    if let Some(factor) = cholesky(matrix, n) {
        for i in 0..n {
            let mut unit = [0.0; MOST];
            unit[i] = 1.0;
            inverse[i] = solve(&factor, &unit, n);
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_one() {
        let mut matrix = [[0.0; MOST]; MOST];
        for (i, row) in [[4.0, 0.0, 0.0], [1.0, 3.0, 0.0], [-0.5, 0.7, 2.0]].iter().enumerate() {
            matrix[i][..3].copy_from_slice(row);
        }
        let inverse = inverse(&matrix, 3);
        for (i, row) in inverse.iter().take(3).enumerate() {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| row[k] * matrix[k.max(j)][k.min(j)]).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-14, "{i} {j}");
            }
        }
        matrix[2][2] = -1.0;
        assert_eq!(cholesky(&matrix, 3), None);
    }
}
