//! A small positive definite system, solved in place.
//!
//! ```text
//! H d = g        H = L L^T        L w = g        L^T d = w
//! ```
//!
//! H symmetric, at most [`MAX_MOVES`] square. Source: the textbook factorisation. Trap: a pivot that is only
//! rounding makes d enormous, not wrong-looking; so a pivot must be a real share of its diagonal entry.

/// Largest number of unknowns: the moves that the machine file allows.
pub const MAX_MOVES: usize = 8;

/// Least share of a diagonal entry that its pivot must keep: a thousand times the rounding of a double.
const LEAST_PIVOT: f64 = 1e3 * f64::EPSILON;

/// Solves the leading `n` equations of `h d = g`; only the lower triangle of `h` is read.
///
/// `None` when `h` is not safely positive definite or anything is not finite. `n` beyond [`MAX_MOVES`] counts as it.
pub fn solve(mut h: [[f64; MAX_MOVES]; MAX_MOVES], mut g: [f64; MAX_MOVES], n: usize) -> Option<[f64; MAX_MOVES]> {
    let n = n.min(MAX_MOVES);
    for row in 0..n {
        let diagonal = h[row][row];
        for column in 0..=row {
            let known: f64 = (0..column).map(|k| h[row][k] * h[column][k]).sum();
            let rest = h[row][column] - known;
            h[row][column] = if row > column {
                rest / h[column][column]
            } else if rest > LEAST_PIVOT * diagonal {
                rest.sqrt()
            } else {
                // Also where `rest` or `diagonal` is NaN.
                return None;
            };
        }
    }
    for row in 0..n {
        let known: f64 = (0..row).map(|k| h[row][k] * g[k]).sum();
        g[row] = (g[row] - known) / h[row][row];
    }
    for row in (0..n).rev() {
        let known: f64 = (row + 1..n).map(|k| h[k][row] * g[k]).sum();
        g[row] = (g[row] - known) / h[row][row];
    }
    g[..n].iter().all(|d| d.is_finite()).then_some(g)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solution_satisfies_the_equations(
            rows in prop::collection::vec(prop::collection::vec(-1.0f64..1.0, MAX_MOVES), 20),
            g in prop::collection::vec(-1.0f64..1.0, MAX_MOVES),
            n in 1usize..=MAX_MOVES,
        ) {
            let mut h = [[0.0; MAX_MOVES]; MAX_MOVES];
            for i in 0..n {
                for j in 0..n {
                    h[i][j] = rows.iter().map(|r| r[i] * r[j]).sum::<f64>() + if i == j { 0.1 } else { 0.0 };
                }
            }
            let mut right = [0.0; MAX_MOVES];
            right[..n].copy_from_slice(&g[..n]);
            let d = solve(h, right, n).unwrap();
            for i in 0..n {
                let left: f64 = (0..n).map(|j| h[i][j] * d[j]).sum();
                prop_assert!((left - right[i]).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let mut h = [[0.0; MAX_MOVES]; MAX_MOVES];
        assert_eq!(solve(h, [1.0; MAX_MOVES], 2), None);
        (h[0][0], h[1][0], h[1][1]) = (1.0, 1.0, 1.0);
        assert_eq!(solve(h, [1.0; MAX_MOVES], 2), None);
        h[1][1] = f64::NAN;
        assert_eq!(solve(h, [1.0; MAX_MOVES], 2), None);
        h[1][1] = 2.0;
        assert_eq!(solve(h, [f64::INFINITY; MAX_MOVES], 2), None);
        assert_eq!(solve(h, [2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2).unwrap()[..2], [1.0, 1.0]);
    }
}
