//! Finds coefficients that the data do not determine.
//!
//! It is Gram-Schmidt on the columns of R, each scaled to length 1. The next column is always the one that the columns
//! taken so far explain least, the first of equals. When its remainder is below the tolerance, all columns that are
//! left depend on those taken. With an input of two levels most powers of u are such columns; with an input of one sign
//! those of the other branch are zero.

use crate::least_squares::{RANK_TOLERANCE, Triangle};

/// Finds dependent columns. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct RankGuard {
    n: usize,
    /// Column after column.
    columns: Vec<f64>,
    direction: Vec<f64>,
    dependent: Vec<bool>,
}

impl RankGuard {
    /// For `n` unknowns.
    pub fn new(n: usize) -> Self {
        Self { n, columns: vec![0.0; n * n], direction: vec![0.0; n], dependent: vec![false; n] }
    }

    /// The unknowns that the last search marked.
    pub fn last(&self) -> &[bool] {
        &self.dependent
    }

    /// Marks the unknowns that depend on the others.
    pub fn dependent(&mut self, data: &Triangle) -> &[bool] {
        let n = self.n;
        for (j, column) in self.columns.chunks_exact_mut(n).enumerate() {
            column.iter_mut().enumerate().for_each(|(i, value)| *value = if i <= j { data.entry(i, j) } else { 0.0 });
            let length = norm(column);
            if length > 0.0 {
                column.iter_mut().for_each(|value| *value /= length);
            }
        }
        self.dependent.fill(true);
        for _ in 0..n {
            let left = (0..n).filter(|&j| self.dependent[j]).map(|j| (j, norm(&self.columns[j * n..(j + 1) * n])));
            let Some((best, length)) = left.reduce(|a, b| if b.1 > a.1 { b } else { a }) else { break };
            if length <= RANK_TOLERANCE {
                break;
            }
            self.dependent[best] = false;
            for (direction, value) in self.direction.iter_mut().zip(&self.columns[best * n..(best + 1) * n]) {
                *direction = value / length;
            }
            for j in (0..n).filter(|&j| self.dependent[j]) {
                let column = &mut self.columns[j * n..(j + 1) * n];
                let along: f64 = column.iter().zip(&self.direction).map(|(a, b)| a * b).sum();
                column.iter_mut().zip(&self.direction).for_each(|(value, d)| *value -= along * d);
            }
        }
        &self.dependent
    }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_columns_are_found_and_held() {
        // Third column = first + second, fourth zero.
        let row = |i: usize| {
            let (a, b) = ((i as f64).sin(), (i as f64 * 0.7).cos());
            [a, b, a + b, 0.0]
        };
        let target = |i: usize| row(i)[0] - 2.0 * row(i)[1];
        let mut data = Triangle::new(4);
        (0..20).for_each(|i| data.add(&row(i), target(i)));
        let mut guard = RankGuard::new(4);
        let dependent = guard.dependent(&data).to_vec();
        assert_eq!(dependent.iter().filter(|d| **d).count(), 2, "{dependent:?}");
        assert!(dependent[3]);
        let mut restricted = Triangle::new(4);
        data.hold_into(&dependent, &mut restricted);
        let mut theta = vec![0.0; 4];
        restricted.solve(&mut theta);
        for i in 0..20 {
            let fitted: f64 = row(i).iter().zip(&theta).map(|(r, t)| r * t).sum();
            assert!((fitted - target(i)).abs() < 1e-12);
        }
        assert!((0..4).all(|j| !dependent[j] || theta[j] == 0.0));
    }

    #[test]
    fn a_problem_of_full_rank_has_no_dependent_column() {
        let mut data = Triangle::new(3);
        (0..9).for_each(|i| data.add(&[1.0, i as f64, (i * i) as f64], 0.0));
        assert_eq!(RankGuard::new(3).dependent(&data), [false; 3]);
    }
}
