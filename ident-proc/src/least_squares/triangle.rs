//! Least squares on a triangle, eq. (15): the information of all rows so far, in n (n + 3) / 2 numbers.
//!
//! ```text
//! minimise |Phi theta - Y|^2     <=>     R theta = z     with  Q [Phi | Y] = [R | z]              (15)
//!                                                                           [0 | residual]
//! ```
//!
//! Phi rows and Y targets, theta n unknowns, Q orthogonal, R upper triangular with R'R = Phi'Phi. R and z store the
//! normal equations with the digits that forming Phi'Phi would lose: a position's y(k-1), y(k-2) and y(k-3) are nearly
//! equal columns. Rows are taken in one at a time by Givens rotations, so the memory does not grow with the record.

/// Diagonal entries smaller than this part of their column count as zero. It is far above rounding (1e-16 times the
/// root of the number of rows), and far below what a column of a measured record adds.
pub(crate) const RANK_TOLERANCE: f64 = 1e-10;

/// R and z of a least-squares problem with n unknowns.
///
/// ```
/// use ident_proc::least_squares::Triangle;
///
/// // y = 1 + 2 x
/// let mut rows = Triangle::new(2);
/// for (x, y) in [(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)] {
///     rows.add(&[1.0, x], y);
/// }
/// let mut theta = [0.0; 2];
/// rows.solve(&mut theta);
/// assert!((theta[0] - 1.0).abs() < 1e-12 && (theta[1] - 2.0).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct Triangle {
    n: usize,
    /// n rows of n + 1 numbers: a row of R, then its z.
    rows: Vec<f64>,
    /// The row that is being taken in.
    row: Vec<f64>,
    residual: f64,
    count: u64,
}

impl Triangle {
    /// No rows yet, `n` unknowns.
    pub fn new(n: usize) -> Self {
        Self { n, rows: vec![0.0; n * (n + 1)], row: vec![0.0; n + 1], residual: 0.0, count: 0 }
    }

    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there are no unknowns.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Number of rows taken in.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Smallest sum of squared residuals over all values of the unknowns.
    pub fn residual(&self) -> f64 {
        self.residual
    }

    /// R_ij for i <= j < n; z_i for j = n.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        self.rows[i * (self.n + 1) + j]
    }

    /// Removes all rows.
    pub fn clear(&mut self) {
        self.rows.fill(0.0);
        self.residual = 0.0;
        self.count = 0;
    }

    /// Takes in one row: `regressor`, n numbers, whose product with the unknowns predicts `target`.
    pub fn add(&mut self, regressor: &[f64], target: f64) {
        self.row[..self.n].copy_from_slice(regressor);
        self.row[self.n] = target;
        self.rotate_in();
        self.count += 1;
    }

    fn rotate_in(&mut self) {
        let width = self.n + 1;
        for i in 0..self.n {
            let below = self.row[i];
            if below == 0.0 {
                continue;
            }
            let pivot = &mut self.rows[i * width + i..(i + 1) * width];
            let length = pivot[0].hypot(below);
            let (c, s) = (pivot[0] / length, below / length);
            for (upper, lower) in pivot.iter_mut().zip(&mut self.row[i..]) {
                (*upper, *lower) = (c * *upper + s * *lower, c * *lower - s * *upper);
            }
        }
        self.residual += self.row[self.n] * self.row[self.n];
    }

    /// Takes in all rows of `other`. `map` gets a row of its unknowns and the target, writes a row of these unknowns,
    /// and returns their target. Both must be linear in row and target.
    pub fn add_mapped(&mut self, other: &Self, mut map: impl FnMut(&[f64], f64, &mut [f64]) -> f64) {
        for row in other.rows.chunks_exact(other.n + 1) {
            self.row.fill(0.0);
            self.row[self.n] = map(&row[..other.n], row[other.n], &mut self.row[..self.n]);
            self.rotate_in();
        }
        self.residual += other.residual;
        self.count += other.count;
    }

    /// Solves R theta = z by back substitution. An unknown whose diagonal counts as zero becomes 0.
    pub fn solve(&self, theta: &mut [f64]) {
        for i in (0..self.n).rev() {
            let known: f64 = (i + 1..self.n).map(|j| self.entry(i, j) * theta[j]).sum();
            theta[i] = if self.is_negligible(i) { 0.0 } else { (self.entry(i, self.n) - known) / self.entry(i, i) };
        }
    }

    fn is_negligible(&self, i: usize) -> bool {
        let column: f64 = (0..=i).map(|row| self.entry(row, i).powi(2)).sum::<f64>().sqrt();
        self.entry(i, i).abs() <= RANK_TOLERANCE * column
    }

    /// Makes `restricted` this problem with the marked unknowns held at zero, each by a row of its own.
    pub fn hold_into(&self, held: &[bool], restricted: &mut Self) {
        restricted.clear();
        restricted.add_mapped(self, |row, target, out| {
            for ((out, value), held) in out.iter_mut().zip(row).zip(held) {
                *out = if *held { 0.0 } else { *value };
            }
            target
        });
        for j in (0..self.n).filter(|&j| held[j]) {
            restricted.row.fill(0.0);
            restricted.row[j] = 1.0;
            restricted.rotate_in();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    fn triangle_of(rows: &DMatrix<f64>, targets: &DVector<f64>) -> Triangle {
        let mut triangle = Triangle::new(rows.ncols());
        for (row, target) in rows.row_iter().zip(targets.iter()) {
            triangle.add(&row.iter().copied().collect::<Vec<_>>(), *target);
        }
        triangle
    }

    proptest! {
        /// This defines least squares, whatever the condition of the columns.
        #[test]
        fn the_residual_is_orthogonal_to_every_column(
            values in prop::collection::vec(-1.0f64..1.0, 40 * 6),
            y in prop::collection::vec(-1.0f64..1.0, 40),
        ) {
            let (rows, targets) = (DMatrix::from_row_slice(40, 6, &values), DVector::from_vec(y));
            let triangle = triangle_of(&rows, &targets);
            let mut theta = vec![0.0; 6];
            triangle.solve(&mut theta);
            let theta = DVector::from_vec(theta);
            let residual = &targets - &rows * &theta;
            let bound = 1e-13 * rows.norm() * (rows.norm() * theta.norm() + targets.norm());
            prop_assert!((rows.transpose() * &residual).norm() < bound);
            prop_assert!((triangle.residual() - residual.norm_squared()).abs() < 1e-12 * targets.norm_squared());
        }
    }

    #[test]
    fn nearly_equal_columns_keep_their_digits() {
        // The condition is 1e7; that of the normal equations would be 1e14.
        let rows = DMatrix::from_fn(1000, 2, |i, j| {
            (i as f64 * 0.1).sin() + if j == 1 { 1e-7 * (i as f64 * 0.37).cos() } else { 0.0 }
        });
        let targets = DVector::from_fn(1000, |i, _| 3.0 * rows[(i, 0)] - 2.0 * rows[(i, 1)]);
        let mut theta = [0.0; 2];
        triangle_of(&rows, &targets).solve(&mut theta);
        assert!((theta[0] - 3.0).abs() < 1e-7 && (theta[1] + 2.0).abs() < 1e-7, "{theta:?}");
    }
}
