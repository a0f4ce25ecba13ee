//! Past residuals as regressors: extended least squares.
//!
//! ```text
//! y(k) = phi(k)' theta + c_1 e(k-1) + c_2 e(k-2) + e(k)
//! e(k) = y(k) - [phi(k); e(k-1); e(k-2)]' [theta(k); c(k)]          at most 10 s
//! ```
//!
//! phi regressor and theta coefficients of a form of the regression, y target in its unit, e residual after the update,
//! s standard deviation of the residuals of the training. Where the noise of the output is not white in this form,
//! plain least squares is biased, most of all when the command depends on the output by feedback. With a model of the
//! noise it is not (Ljung and Soderstrom, Theory and Practice of Recursive Identification, 1983). The c belong to the
//! recursion alone; the model that is handed on is theta.
//!
//! Trap: the recursion of e has the poles of C = 1 + c_1 q^-1 + c_2 q^-2, which may be unstable for some time. Hence
//! the bound on e.
//!
//! All of this runs in the loop. Nothing here allocates after construction.

use crate::least_squares::Triangle;

/// Number of past residuals.
pub const PAST: usize = 2;
/// Standard deviation of a c before the first residual. A stable C has |c_1| below 2 and |c_2| below 1.
const PRIOR: f64 = 0.3;
/// Largest residual, in standard deviations of those of the training.
const LARGEST: f64 = 10.0;

/// Past residuals of the members of a family.
#[derive(Debug, Clone)]
pub struct Residuals {
    /// e(k-1), e(k-2) of each member.
    values: Vec<[f64; PAST]>,
    /// s, in the unit of the target.
    sigma: f64,
    /// The problem from which the members start.
    problem: Triangle,
    held: Vec<bool>,
    row: Vec<f64>,
}

impl Residuals {
    /// Of `members` members with `n` coefficients of the form each.
    pub fn new(members: usize, n: usize) -> Self {
        Self {
            values: vec![[0.0; PAST]; members],
            sigma: 0.0,
            problem: Triangle::new(n + PAST),
            held: vec![false; n + PAST],
            row: vec![0.0; n + PAST],
        }
    }

    /// The offline problem of the form, with the c, of which it knows nothing, and which coefficients are held.
    pub fn start(&mut self, data: &Triangle, held: &[bool]) -> (&Triangle, &[bool]) {
        let n = data.len();
        self.interrupt();
        self.sigma = (data.residual() / data.count().max(1) as f64).sqrt().max(f64::MIN_POSITIVE.sqrt());
        self.problem.clear();
        self.problem.add_mapped(data, |row, target, extended| {
            extended[..n].copy_from_slice(row);
            target
        });
        for c in n..n + PAST {
            self.row.fill(0.0);
            self.row[c] = self.sigma / PRIOR;
            self.problem.add(&self.row, 0.0);
        }
        self.held[..n].copy_from_slice(held);
        (&self.problem, &self.held)
    }

    /// e(k-1), e(k-2) of a member.
    pub fn past(&self, member: usize) -> &[f64; PAST] {
        &self.values[member]
    }

    /// Takes in e(k) of a member.
    pub fn push(&mut self, member: usize, residual: f64) {
        let most = LARGEST * self.sigma;
        let residual = if residual.is_finite() { residual.clamp(-most, most) } else { 0.0 };
        let past = &mut self.values[member];
        past.rotate_right(1);
        past[0] = residual;
    }

    /// Forgets the residuals, after a gap in the samples.
    pub fn interrupt(&mut self) {
        self.values.fill([0.0; PAST]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recursive::RecursiveLeastSquares;

    /// Estimates a of y(k) = a y(k-1) + b u(k-1) + e(k) + c e(k-1) under the feedback u = -y / 2, with e of standard
    /// deviation 1, by plain and by extended least squares.
    fn estimated(a: f64, b: f64, c: f64) -> [f64; 2] {
        let mut random = 1u64;
        let mut noise = || {
            let uniform = |random: &mut u64| {
                *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (*random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            };
            (0..12).map(|_| uniform(&mut random)).sum::<f64>()
        };
        let mut residuals = Residuals::new(1, 2);
        let mut rows = Triangle::new(2);
        let (mut plain, mut extended) = (RecursiveLeastSquares::new(2), RecursiveLeastSquares::new(2 + PAST));
        let (mut y, mut e, mut square) = (0.0, 0.0, 1.0);
        for k in 0..40_000 {
            square = if k % 40 == 0 { -square } else { square };
            let u = square - 0.5 * y;
            let fresh = noise();
            let next = a * y + b * u + fresh + c * e;
            if k < 200 {
                rows.add(&[y, u], next);
            } else if k == 200 {
                plain.start(&rows, &[false; 2]);
                let (problem, held) = residuals.start(&rows, &[false; 2]);
                extended.start(problem, held);
            } else {
                plain.update(&[y, u], next, 1.0);
                let [one, two] = *residuals.past(0);
                let row = [y, u, one, two];
                extended.update(&row, next, 1.0);
                residuals.push(0, next - row.iter().zip(extended.theta()).map(|(x, t)| x * t).sum::<f64>());
            }
            (y, e) = (next, fresh);
        }
        [plain.theta()[0], extended.theta()[0]]
    }

    #[test]
    fn coloured_noise_under_feedback_biases_least_squares_and_not_its_extension() {
        let [plain, extended] = estimated(0.9, 0.2, -0.7);
        println!("plain {plain}, extended {extended}");
        assert!((plain - 0.9).abs() > 0.1 && (extended - 0.9).abs() < 0.02, "{plain} {extended}");
    }

    #[test]
    fn a_residual_is_bounded_and_a_gap_forgets_it() {
        let mut rows = Triangle::new(1);
        (0..100).for_each(|k| rows.add(&[1.0], if k % 2 == 0 { 1.0 } else { -1.0 }));
        let mut residuals = Residuals::new(2, 1);
        let (problem, held) = residuals.start(&rows, &[true]);
        assert_eq!((problem.len(), held), (3, &[true, false, false][..]));
        for (found, expected) in [(0.5, [0.5, 0.0]), (1e9, [10.0, 0.5]), (f64::NAN, [0.0, 10.0])] {
            residuals.push(1, found);
            assert_eq!(residuals.past(1), &expected);
        }
        assert_eq!(residuals.past(0), &[0.0; 2]);
        residuals.push(1, 1.0);
        residuals.interrupt();
        assert_eq!(residuals.past(1), &[0.0; 2]);
    }
}
