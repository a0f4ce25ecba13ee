//! Which constraints there are, what is wrong with them, and which one is violated most.
//!
//! ```text
//! sign c'x >= sign limit        sign +1 at the lower limit, -1 at the upper one
//! scale = sum |c_i| s_i >= sqrt(c' H^-1 c)        s_i = sqrt((H^-1)_ii)
//! ```
//!
//! A bound is c = e_i. What is rounding, and which normals are called dependent, goes by that scale: neither the units
//! of a variable nor those of a row matter, and it is known before the first step. Which violation is the greatest goes by
//! the violation itself: on axes with limits of magnitude and rate that takes a fifth fewer iterations than by scale,
//! and as many fewer than the first one violated. Trap: in a dense array of rows most
//! elements are zero; only what lies between the first and the last that is not is read again.

use std::array::from_fn;

use super::{Problem, Status, basis::dot};

/// A limit counts as met within this part of itself.
const FEASIBLE: f64 = 1e-11;
/// And within this part of the size of x, by the scale of the constraint: what rounding leaves of a limit of zero.
pub(super) const ROUNDING: f64 = 1e-14;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Constraint {
    Bound(usize),
    Row(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum State {
    /// May be violated.
    Open,
    /// In the working set.
    Held,
    /// Follows from the working set: violated by rounding alone.
    Implied,
}

/// One side of a constraint: sign c'x >= sign limit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    pub constraint: Constraint,
    pub sign: f64,
    pub limit: f64,
    /// Both limits are one: its multiplier has either sign.
    pub equality: bool,
}

#[derive(Debug, Clone)]
pub(super) struct Constraints<const N: usize, const M: usize> {
    /// Of each row, where its first element that is not zero is, and where the last one ends.
    spans: [(usize, usize); M],
    bound_scales: [f64; N],
    row_scales: [f64; M],
    bound_states: [State; N],
    row_states: [State; M],
}

impl<const N: usize, const M: usize> Constraints<N, M> {
    pub(super) const fn new() -> Self {
        Self {
            spans: [(0, 0); M],
            bound_scales: [0.0; N],
            row_scales: [0.0; M],
            bound_states: [State::Open; N],
            row_states: [State::Open; M],
        }
    }

    /// Begins with nothing held; says what is wrong with the limits and rows by themselves.
    pub(super) fn read(&mut self, problem: &Problem<N, M>) -> Result<(), Status> {
        self.bound_states = [State::Open; N];
        self.row_states = [State::Open; M];
        // 0 times what is not finite is not a number: a sum for each column finds them all.
        let mut sums = [0.0; N];
        for (span, row) in self.spans.iter_mut().zip(&problem.rows) {
            sums.iter_mut().zip(row).for_each(|(sum, c)| *sum += 0.0 * c);
            let start = row.iter().position(|c| *c != 0.0).unwrap_or(0);
            let end = row.iter().rposition(|c| *c != 0.0).map_or(0, |last| last + 1);
            *span = (start, end);
        }
        if sums != [0.0; N] {
            return Err(Status::NotFinite);
        }
        let pairs = || {
            let bounds = problem.lower.iter().zip(&problem.upper);
            bounds.chain(problem.row_lower.iter().zip(&problem.row_upper))
        };
        if pairs().any(|(lower, upper)| lower.is_nan() || upper.is_nan()) {
            return Err(Status::NotFinite);
        }
        let empty = |(lower, upper): (&f64, &f64)| lower > upper || *lower == f64::INFINITY || *upper == -f64::INFINITY;
        if pairs().any(empty) { Err(Status::Infeasible) } else { Ok(()) }
    }

    /// Takes the s_i, which measure everything.
    pub(super) fn scale(&mut self, problem: &Problem<N, M>, lengths: &[f64; N]) {
        self.bound_scales = *lengths;
        self.row_scales = from_fn(|k| {
            let (start, end) = self.spans[k];
            problem.rows[k][start..end].iter().zip(&lengths[start..end]).map(|(c, s)| c.abs() * s).sum()
        });
    }

    pub(super) fn scale_of(&self, constraint: Constraint) -> f64 {
        match constraint {
            Constraint::Bound(i) => self.bound_scales[i],
            Constraint::Row(k) => self.row_scales[k],
        }
    }

    pub(super) fn set(&mut self, constraint: Constraint, state: State) {
        match constraint {
            Constraint::Bound(i) => self.bound_states[i] = state,
            Constraint::Row(k) => self.row_states[k] = state,
        }
    }

    /// What followed from the working set may be violated again, since the set has become smaller.
    pub(super) fn reopen(&mut self) {
        let states = self.bound_states.iter_mut().chain(&mut self.row_states);
        states.filter(|state| **state == State::Implied).for_each(|state| *state = State::Open);
    }

    /// c, as the elements from a place on that are not zero.
    pub(super) fn normal<'a>(&self, problem: &'a Problem<N, M>, constraint: Constraint) -> (usize, &'a [f64]) {
        match constraint {
            Constraint::Bound(i) => (i, &[1.0]),
            Constraint::Row(k) => {
                let (start, end) = self.spans[k];
                (start, &problem.rows[k][start..end])
            }
        }
    }

    /// c'x.
    #[inline]
    pub(super) fn value(&self, problem: &Problem<N, M>, constraint: Constraint, x: &[f64; N]) -> f64 {
        let (start, part) = self.normal(problem, constraint);
        match (constraint, part) {
            (Constraint::Bound(i), _) => x[i],
            (_, [one, two]) => one * x[start] + two * x[start + 1],
            _ => dot(part, &x[start..]),
        }
    }

    /// The side that x violates most; none if all are met. `size` is that of x, by the scale of
    /// its elements.
    pub(super) fn most_violated(&self, problem: &Problem<N, M>, x: &[f64; N], size: f64) -> Option<Side> {
        let mut worst = None;
        let mut most = 0.0;
        let mut compare = |constraint, state, scale: f64, value: f64, lower: f64, upper: f64| {
            let (below, above) = (lower - value, value - upper);
            let violation = if below > above { below } else { above };
            if violation > most && state == State::Open {
                let (sign, limit) = if below > above { (1.0, lower) } else { (-1.0, upper) };
                if violation > FEASIBLE * limit.abs() + ROUNDING * scale * size {
                    most = violation;
                    worst = Some(Side { constraint, sign, limit, equality: lower == upper });
                }
            }
        };
        for (i, x) in x.iter().enumerate() {
            let (state, scale) = (self.bound_states[i], self.bound_scales[i]);
            compare(Constraint::Bound(i), state, scale, *x, problem.lower[i], problem.upper[i]);
        }
        for k in 0..M {
            let (state, scale) = (self.row_states[k], self.row_scales[k]);
            let value = self.value(problem, Constraint::Row(k), x);
            compare(Constraint::Row(k), state, scale, value, problem.row_lower[k], problem.row_upper[k]);
        }
        worst
    }
}
