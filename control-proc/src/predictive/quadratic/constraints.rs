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
//! elements are zero; only what lies between the first and the last that is not is read again, and of a row of
//! neighbouring elements a copy of those.

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

/// A row that has no elements but two neighbours.
#[derive(Debug, Clone, Copy)]
struct Pair {
    start: usize,
    elements: [f64; 2],
}

#[derive(Debug, Clone)]
pub(super) struct Constraints<const N: usize, const M: usize> {
    /// Of each row, where its first element that is not zero is, and where the last one ends.
    spans: [(usize, usize); M],
    /// Of a row that is none, nothing that means anything.
    pairs: [Pair; M],
    bound_scales: [f64; N],
    row_scales: [f64; M],
    bound_states: [State; N],
    row_states: [State; M],
    /// 0 where the state is open, else -inf.
    bound_masks: [f64; N],
    row_masks: [f64; M],
    /// By how much x is beyond the limits, where the state is open; negative within them.
    bound_violations: [f64; N],
    row_violations: [f64; M],
}

impl<const N: usize, const M: usize> Constraints<N, M> {
    pub(super) const fn new() -> Self {
        Self {
            spans: [(0, 0); M],
            pairs: [Pair { start: 0, elements: [0.0; 2] }; M],
            bound_scales: [0.0; N],
            row_scales: [0.0; M],
            bound_states: [State::Open; N],
            row_states: [State::Open; M],
            bound_masks: [0.0; N],
            row_masks: [0.0; M],
            bound_violations: [0.0; N],
            row_violations: [0.0; M],
        }
    }

    /// Begins with nothing held; says what is wrong with the limits and rows by themselves.
    pub(super) fn read(&mut self, problem: &Problem<N, M>) -> Result<(), Status> {
        self.bound_states = [State::Open; N];
        self.row_states = [State::Open; M];
        (self.bound_masks, self.row_masks) = ([0.0; N], [0.0; M]);
        // 0 times what is not finite is not a number: the sum finds them all.
        let mut sum = 0.0;
        for ((span, pair), row) in self.spans.iter_mut().zip(&mut self.pairs).zip(&problem.rows) {
            *span = part(row);
            row[span.0..span.1].iter().for_each(|c| sum += 0.0 * c);
            pair.start = span.0.min(N.saturating_sub(2));
            pair.elements = from_fn(|k| row.get(pair.start + k).copied().unwrap_or(0.0));
        }
        if sum != 0.0 {
            return Err(Status::NotFinite);
        }
        // Without branches: comparing many limits at once takes no longer than finding the first that is wrong.
        let (mut is_nan, mut is_empty) = (false, false);
        let mut check = |lower: &[f64], upper: &[f64]| {
            for (lower, upper) in lower.iter().zip(upper) {
                is_nan |= lower.is_nan() | upper.is_nan();
                is_empty |= (lower > upper) | (*lower == f64::INFINITY) | (*upper == -f64::INFINITY);
            }
        };
        check(&problem.lower, &problem.upper);
        check(&problem.row_lower, &problem.row_upper);
        match (is_nan, is_empty) {
            (true, _) => Err(Status::NotFinite),
            (_, true) => Err(Status::Infeasible),
            _ => Ok(()),
        }
    }

    /// Takes the s_i, which measure everything.
    pub(super) fn scale(&mut self, problem: &Problem<N, M>, lengths: &[f64; N]) {
        self.bound_scales = *lengths;
        self.row_scales = from_fn(|k| {
            let (start, end) = self.spans[k];
            problem.rows[k][start..end].iter().zip(&lengths[start..end]).map(|(c, s)| c.abs() * s).sum()
        });
    }

    #[inline]
    pub(super) fn scale_of(&self, constraint: Constraint) -> f64 {
        match constraint {
            Constraint::Bound(i) => self.bound_scales[i],
            Constraint::Row(k) => self.row_scales[k],
        }
    }

    #[inline]
    pub(super) fn set(&mut self, constraint: Constraint, state: State) {
        let mask = if state == State::Open { 0.0 } else { -f64::INFINITY };
        match constraint {
            Constraint::Bound(i) => (self.bound_states[i], self.bound_masks[i]) = (state, mask),
            Constraint::Row(k) => (self.row_states[k], self.row_masks[k]) = (state, mask),
        }
    }

    /// What followed from the working set may be violated again, since the set has become smaller.
    pub(super) fn reopen(&mut self) {
        let bounds = self.bound_states.iter_mut().zip(&mut self.bound_masks);
        for (state, mask) in bounds.chain(self.row_states.iter_mut().zip(&mut self.row_masks)) {
            if *state == State::Implied {
                (*state, *mask) = (State::Open, 0.0);
            }
        }
    }

    /// c, as the elements from a place on that are not zero.
    #[inline]
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
        match constraint {
            Constraint::Bound(i) => x[i],
            Constraint::Row(k) => self.row_value(problem, k, x),
        }
    }

    #[inline(always)]
    fn row_value(&self, problem: &Problem<N, M>, k: usize, x: &[f64; N]) -> f64 {
        let (start, end) = self.spans[k];
        if end - start <= 2 {
            let Pair { start, elements: [one, two] } = self.pairs[k];
            one * x[start] + two * x[(start + 1).min(N - 1)]
        } else {
            dot(&problem.rows[k][start..end], &x[start..])
        }
    }

    /// The side that x violates most; none if all are met. `size` is that of x, by the scale of
    /// its elements.
    pub(super) fn most_violated(&mut self, problem: &Problem<N, M>, x: &[f64; N], size: f64) -> Option<Side> {
        let mut values = [0.0; M];
        (0..M).for_each(|k| values[k] = self.row_value(problem, k, x));
        violations(&mut self.bound_violations, x, &problem.lower, &problem.upper, &self.bound_masks);
        violations(&mut self.row_violations, &values, &problem.row_lower, &problem.row_upper, &self.row_masks);
        loop {
            let (bounds, rows) = (&self.bound_violations, &self.row_violations);
            let most = largest(bounds).max(largest(rows));
            if most <= 0.0 {
                return None;
            }
            let (constraint, value, lower, upper) =
                if let Some(i) = bounds.iter().position(|violation| *violation == most) {
                    (Constraint::Bound(i), x[i], problem.lower[i], problem.upper[i])
                } else {
                    let k = rows.iter().position(|violation| *violation == most)?;
                    (Constraint::Row(k), values[k], problem.row_lower[k], problem.row_upper[k])
                };
            let (sign, limit) = if lower - value > value - upper { (1.0, lower) } else { (-1.0, upper) };
            if most > FEASIBLE * limit.abs() + ROUNDING * self.scale_of(constraint) * size {
                return Some(Side { constraint, sign, limit, equality: lower == upper });
            }
            match constraint {
                Constraint::Bound(i) => self.bound_violations[i] = 0.0,
                Constraint::Row(k) => self.row_violations[k] = 0.0,
            }
        }
    }
}

/// By how much each value is beyond its limits, plus its mask.
#[inline(always)]
fn violations<const K: usize>(
    violations: &mut [f64; K],
    values: &[f64; K],
    lower: &[f64; K],
    upper: &[f64; K],
    masks: &[f64; K],
) {
    for k in 0..K {
        let (below, above) = (lower[k] - values[k], values[k] - upper[k]);
        violations[k] = (if below > above { below } else { above }) + masks[k];
    }
}

/// The largest of the values and of 0; four at a time, so that none waits for the other.
#[inline(always)]
pub(super) fn largest(values: &[f64]) -> f64 {
    let larger = |one: f64, two: f64| if one > two { one } else { two };
    let (fours, rest) = values.as_chunks::<4>();
    let mut most = [0.0; 4];
    for four in fours {
        (0..4).for_each(|k| most[k] = larger(four[k], most[k]));
    }
    rest.iter().chain(&most).fold(0.0, |most, value| larger(*value, most))
}

/// Where the first element that is not zero is, and where the last one ends; zeros are passed over by fours.
fn part(row: &[f64]) -> (usize, usize) {
    let is_zero = |four: &[f64; 4]| four.iter().fold(0, |bits, c| bits | c.to_bits()) << 1 == 0;
    let (fours, _) = row.as_chunks::<4>();
    let first = 4 * fours.iter().take_while(|four| is_zero(four)).count();
    let Some(start) = row[first..].iter().position(|c| *c != 0.0) else { return (0, 0) };
    let (_, fours) = row[first..].as_rchunks::<4>();
    let last = row.len() - 4 * fours.iter().rev().take_while(|four| is_zero(four)).count();
    let end = row[..last].iter().rposition(|c| *c != 0.0).map_or(0, |last| last + 1);
    (first + start, end)
}
