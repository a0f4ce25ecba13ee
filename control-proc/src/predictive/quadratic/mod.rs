//! Quadratic programmes, solved exactly and without the heap.
//!
//! ```text
//! minimise 1/2 x'Hx + g'x    subject to    l <= x <= u,    lo <= Cx <= hi
//! Hx + g = v + C'w        v, w >= 0 at a lower limit, <= 0 at an upper one, 0 between them
//! ```
//!
//! x N variables, H (N x N) the Hessian, positive definite, g (N) the gradient at 0, l and u (N) bounds, C (M x N) rows
//! with the limits lo and hi (M); limits may be infinite, and equal. v (N) and w (M) are the multipliers: what the
//! minimum gains by one unit of the limit. Units are the caller's. Source: Goldfarb and Idnani, A numerically stable
//! dual method for solving strictly convex quadratic programs, Math. Programming 27 (1983).
//!
//! From the unconstrained minimum the method takes in the constraint that is violated most, again and again, each
//! time as far as the others' multipliers keep their sign, and lets go of those that would not. After every
//! constraint taken in, x is the exact minimum under the working set and its cost a lower bound of the cost sought;
//! so it ends after finitely many steps, without a starting point and without a tolerance of convergence.
//!
//! Before it ends, or trusts a small violation, the conditions of the minimum under the working set are solved once more
//! for what is left of them (iterative refinement), so that neither x nor multipliers carry the rounding of the way.
//!
//! Traps: until the end x violates something. What [`Status::IterationLimit`] leaves is the optimum of a problem with
//! fewer constraints: its multipliers have their signs, its x does **not** keep the limits, and clipping it into the
//! bounds keeps no row. The caller needs a command that is safe without a solution. Of an ill-conditioned H the cost
//! is far more exact than x. Squares of the data must neither overflow nor vanish: beyond 1e-140 .. 1e140 nothing
//! panics, but a problem may be called what it is not. Which constraint is violated most depends on the units of the
//! rows: the answer does not, the number of iterations does.

mod basis;
mod constraints;

use basis::{Basis, add, dot};
use constraints::{Constraint, Constraints, ROUNDING, Side, State, largest};

/// A violation below this part of the limit is looked at again after refinement: on the way from a minimum far away x
/// has lost digits, and among constraints that depend on each other their rounding would take turns for ever.
const DOUBTFUL: f64 = 1e-6;
/// The part of a normal that counts as independent of the working set, by its scale.
const INDEPENDENT: f64 = 1e-9;
/// A multiplier shrinks if it loses more than this, by the scales of both constraints.
const SHRINKING: f64 = 1e-12;
/// A multiplier has its sign within this part of what all of them carry.
const SIGN: f64 = 1e-12;
/// Limits contradict each other if they do by more than this part of them.
const CONTRADICTION: f64 = 1e-9;

/// What is to be minimised, and subject to what: the equation of the [module](self).
#[derive(Debug, Clone, PartialEq)]
pub struct Problem<const N: usize, const M: usize> {
    /// H, of which only the upper triangle is read: `hessian[i][j]` with i <= j.
    pub hessian: [[f64; N]; N],
    /// g.
    pub gradient: [f64; N],
    /// l, -inf where there is none.
    pub lower: [f64; N],
    /// u, inf where there is none.
    pub upper: [f64; N],
    /// C. A row with neighbouring elements, such as a difference, costs little; anything else a scalar product.
    pub rows: [[f64; N]; M],
    /// lo, -inf where there is none.
    pub row_lower: [f64; M],
    /// hi, inf where there is none.
    pub row_upper: [f64; M],
}

impl<const N: usize, const M: usize> Problem<N, M> {
    /// Without a limit, and with rows of zeros.
    pub const fn new(hessian: [[f64; N]; N], gradient: [f64; N]) -> Self {
        Self {
            hessian,
            gradient,
            lower: [f64::NEG_INFINITY; N],
            upper: [f64::INFINITY; N],
            rows: [[0.0; N]; M],
            row_lower: [f64::NEG_INFINITY; M],
            row_upper: [f64::INFINITY; M],
        }
    }
}

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// x is the minimum.
    Solved,
    /// No x keeps all limits.
    Infeasible,
    /// Too many iterations: x is the minimum under some of the constraints and violates others.
    IterationLimit,
    /// H is not positive definite, or not within rounding.
    NotConvex,
    /// A number of H, g or C is not finite, a limit is not a number, or the numbers overflow on the way.
    NotFinite,
}

/// How a solve ended, and with what. Unless it is `Solved` or `IterationLimit`, x and multipliers are zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution<const N: usize, const M: usize> {
    /// How it ended.
    pub status: Status,
    /// x. If `Solved`, never outside its bounds, and within 1e-11 of the limits of the rows, relative to those limits.
    pub x: [f64; N],
    /// v.
    pub bound_multipliers: [f64; N],
    /// w.
    pub row_multipliers: [f64; M],
    /// Steps taken: each takes a constraint in or lets one go.
    pub iterations: usize,
    /// Constraints in the working set at the end, each of them met with equality.
    pub active: usize,
}

/// The working set, of as many members as the basis has; beyond them numbers mean nothing, but are finite.
#[derive(Debug, Clone)]
struct Members<const N: usize> {
    sides: [Side; N],
    multipliers: [f64; N],
    /// What a multiplier must not go below: 0, or -inf of an equality.
    floors: [f64; N],
    /// The scale of the constraint, or 0 of an equality: what its multiplier's sign is measured by.
    scales: [f64; N],
}

/// The solver with its memory, to be used again and again.
#[derive(Debug, Clone)]
pub struct Solver<const N: usize, const M: usize> {
    /// Iterations after which no further constraint is taken in; the one in hand may still take up to N. 10 N by default.
    pub iteration_limit: usize,
    basis: Basis<N>,
    constraints: Constraints<N, M>,
    x: [f64; N],
    /// The largest of |x_i| / s_i since x was refined: what its rounding is in proportion to.
    size: f64,
    /// The length of g in the norm of H^-1: how far away the unconstrained minimum is.
    force: f64,
    members: Members<N>,
    /// Members that the last solve has ended with, if it has found the minimum.
    kept: usize,
    iterations: usize,
}

impl<const N: usize, const M: usize> Default for Solver<N, M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize, const M: usize> Solver<N, M> {
    /// With the default limit of iterations.
    pub const fn new() -> Self {
        let side = Side { constraint: Constraint::Bound(0), sign: 1.0, limit: 0.0, equality: false };
        Self {
            iteration_limit: 10 * N,
            basis: Basis::new(),
            constraints: Constraints::new(),
            x: [0.0; N],
            size: 0.0,
            force: 0.0,
            members: Members { sides: [side; N], multipliers: [0.0; N], floors: [0.0; N], scales: [0.0; N] },
            kept: 0,
            iterations: 0,
        }
    }

    /// The minimum, or why there is none. The same problem always gives the same answer, bit for bit.
    pub fn solve(&mut self, problem: &Problem<N, M>) -> Solution<N, M> {
        self.kept = 0;
        self.resume(problem)
    }

    /// The minimum, or why there is none, beginning with the working set that the last solve has ended with: far sooner
    /// where that is nearly the right one, as from sample to sample. What it begins with counts as no iteration. The
    /// answer is as exact as that of [`Self::solve`], but not bit for bit the same: it depends on the problems before.
    pub fn resume(&mut self, problem: &Problem<N, M>) -> Solution<N, M> {
        self.iterations = 0;
        let status = self.run(problem).err().unwrap_or(Status::Solved);
        let mut solution = Solution {
            status,
            x: [0.0; N],
            bound_multipliers: [0.0; N],
            row_multipliers: [0.0; M],
            iterations: self.iterations,
            active: 0,
        };
        self.kept = if status == Status::Solved { self.basis.len() } else { 0 };
        if matches!(status, Status::Solved | Status::IterationLimit) {
            solution.x = self.x;
            solution.active = self.basis.len();
            for (k, side) in self.working_set().iter().enumerate() {
                let multiplier = self.members.multipliers[k].max(self.members.floors[k]);
                match side.constraint {
                    Constraint::Bound(i) => solution.bound_multipliers[i] = side.sign * multiplier,
                    Constraint::Row(k) => solution.row_multipliers[k] = side.sign * multiplier,
                }
            }
        }
        solution
    }

    fn run(&mut self, problem: &Problem<N, M>) -> Result<(), Status> {
        self.basis.factor(&problem.hessian)?;
        self.constraints.read(problem)?;
        let lengths = self.basis.lengths();
        let inverse_lengths = lengths.map(|length| 1.0 / length);
        self.constraints.scale(problem, &lengths);
        let y = self.basis.project(0, &problem.gradient).map(|y| -y);
        self.x = self.basis.expand(&y);
        self.force = dot(&y, &y).sqrt();
        self.size = ROUNDING * self.force;
        if self.kept > 0 {
            self.take_up(problem);
        }
        let mut refined = false;
        loop {
            let mut sizes = self.x;
            sizes.iter_mut().zip(&inverse_lengths).for_each(|(size, inverse)| *size = size.abs() * inverse);
            // 0 times what is not finite is not a number.
            if sizes.iter().fold(0.0, |sum, size| sum + 0.0 * size) != 0.0 {
                return Err(Status::NotFinite);
            }
            self.size = self.size.max(largest(&sizes));
            let worst = self.constraints.most_violated(problem, &self.x, self.size);
            match worst {
                _ if !refined && worst.is_none_or(|side| self.is_doubtful(problem, &side)) => {
                    self.settle(problem);
                    refined = true;
                }
                None => break,
                Some(_) if self.iterations >= self.iteration_limit => return Err(Status::IterationLimit),
                Some(side) => {
                    self.take_in(problem, side)?;
                    refined = false;
                }
            }
        }
        for i in 0..N {
            self.x[i] = self.x[i].max(problem.lower[i]).min(problem.upper[i]);
        }
        Ok(())
    }

    #[inline]
    fn working_set(&self) -> &[Side] {
        &self.members.sides[..self.basis.len()]
    }

    /// sign (limit - c'x).
    #[inline]
    fn violation(&self, problem: &Problem<N, M>, side: &Side) -> f64 {
        side.sign * (side.limit - self.constraints.value(problem, side.constraint, &self.x))
    }

    /// Whether it may be rounding alone that violates this side.
    #[inline]
    fn is_doubtful(&self, problem: &Problem<N, M>, side: &Side) -> bool {
        self.violation(problem, side) < DOUBTFUL * side.limit.abs()
    }

    /// Steps to the minimum under the working set and this side, without the members that this makes superfluous.
    #[inline]
    fn take_in(&mut self, problem: &Problem<N, M>, side: Side) -> Result<(), Status> {
        let scale = self.constraints.scale_of(side.constraint);
        let (start, part) = self.constraints.normal(problem, side.constraint);
        let mut multiplier = 0.0;
        loop {
            self.iterations += 1;
            let q = self.basis.len();
            let d = self.basis.project(start, part).map(|d| side.sign * d);
            let square = dot(&d[q..], &d[q..]);
            let independent = q < N && square > (INDEPENDENT * scale).powi(2);
            let r = self.basis.solve(&d);
            // In the dual: to where c'x meets its limit, or to where a multiplier would change its sign.
            let full = if independent { (self.violation(problem, &side) / square).max(0.0) } else { f64::INFINITY };
            let first = self.first_to_vanish(&r, scale, full);
            let step = first.map_or(full, |(_, step)| step);
            if step == f64::INFINITY {
                if self.contradicts(&side, scale, &r) {
                    return Err(Status::Infeasible);
                }
                self.constraints.set(side.constraint, State::Implied);
                return Ok(());
            }
            multiplier += step;
            let Members { multipliers, floors, .. } = &mut self.members;
            for ((multiplier, r), floor) in multipliers.iter_mut().zip(&r).zip(&*floors) {
                let left = *multiplier - step * r;
                *multiplier = if left > *floor { left } else { *floor };
            }
            let z = if independent { self.basis.direction(&d) } else { [0.0; N] };
            add(&mut self.x, step, &z);
            match first {
                Some((k, _)) => self.let_go(k),
                None => {
                    self.constraints.set(side.constraint, State::Held);
                    self.members.push(q, side, scale, multiplier);
                    self.basis.append(&d, &z, &r, square.sqrt());
                    return Ok(());
                }
            }
        }
    }

    /// Takes up the kept members with their limits of today, and steps to the minimum under them, without those whose
    /// multipliers it gives the wrong sign.
    fn take_up(&mut self, problem: &Problem<N, M>) {
        let sides = self.members.sides;
        for side in &sides[..self.kept] {
            let (lower, upper) = match side.constraint {
                Constraint::Bound(i) => (problem.lower[i], problem.upper[i]),
                Constraint::Row(k) => (problem.row_lower[k], problem.row_upper[k]),
            };
            let limit = if side.sign > 0.0 { lower } else { upper };
            let (q, scale) = (self.basis.len(), self.constraints.scale_of(side.constraint));
            let (start, part) = self.constraints.normal(problem, side.constraint);
            let d = self.basis.project(start, part).map(|d| side.sign * d);
            let square = dot(&d[q..], &d[q..]);
            // Written so that NaN is refused too.
            if !(limit.is_finite() && square > (INDEPENDENT * scale).powi(2)) {
                continue;
            }
            let (r, z) = (self.basis.solve(&d), self.basis.direction(&d));
            self.constraints.set(side.constraint, State::Held);
            self.members.push(q, Side { limit, equality: lower == upper, ..*side }, scale, 0.0);
            self.basis.append(&d, &z, &r, square.sqrt());
        }
        self.x = [0.0; N];
        self.settle(problem);
    }

    /// Refines, and lets go of members as long as one has a multiplier of the wrong sign.
    fn settle(&mut self, problem: &Problem<N, M>) {
        self.refine(problem);
        while let Some(k) = self.worst_sign() {
            self.let_go(k);
            self.iterations += 1;
            self.refine(problem);
        }
    }

    /// Takes the member in place `k` out of the working set.
    fn let_go(&mut self, k: usize) {
        self.constraints.set(self.members.sides[k].constraint, State::Open);
        self.constraints.reopen();
        self.members.remove(k);
        self.basis.remove(k);
    }

    /// The member whose multiplier has the wrong sign by most and by more than rounding.
    #[inline]
    fn worst_sign(&self) -> Option<usize> {
        let mut worst = None;
        let mut most = -SIGN * self.force;
        for k in 0..self.basis.len() {
            let pull = self.members.multipliers[k] * self.members.scales[k];
            if pull < most {
                most = pull;
                worst = Some(k);
            }
        }
        worst
    }

    /// The member whose multiplier vanishes first, before this step, if the multipliers lose r per unit of step; and when.
    #[inline]
    fn first_to_vanish(&self, r: &[f64; N], scale: f64, full: f64) -> Option<(usize, f64)> {
        let Members { multipliers, scales, .. } = &self.members;
        let vanishes = |k: usize, step: f64| (r[k] * scales[k] > SHRINKING * scale) & (multipliers[k] < step * r[k]);
        // Mostly there is none, which all of them at once, without a branch, say soonest.
        if !(0..N).fold(false, |any, k| any | vanishes(k, full)) {
            return None;
        }
        let mut first = None;
        let mut shortest = full;
        for k in 0..self.basis.len() {
            if vanishes(k, shortest) {
                shortest = multipliers[k] / r[k];
                first = Some((k, shortest));
            }
        }
        first
    }

    /// Whether the working set allows no x on this side of a constraint whose normal is r times those of the set.
    fn contradicts(&self, side: &Side, scale: f64, r: &[f64; N]) -> bool {
        // With no r > 0 but of equalities, n'x = sum r_j n_j'x <= sum r_j b_j for all x that keep the working set.
        let (mut gap, mut size) = (side.sign * side.limit, side.limit.abs());
        for (member, r) in self.working_set().iter().zip(r) {
            gap -= r * member.sign * member.limit;
            // Where r should be 0, rounding leaves some of the ratio of the scales.
            size += (r.abs() + scale / self.constraints.scale_of(member.constraint)) * member.limit.abs();
        }
        gap > CONTRADICTION * size
    }

    /// One step of iterative refinement: solves the conditions of the minimum under the working set for what is left
    /// of them.
    fn refine(&mut self, problem: &Problem<N, M>) {
        let q = self.basis.len();
        let mut left = problem.gradient;
        for (i, row) in problem.hessian.iter().enumerate() {
            left[i] += dot(&row[i..], &self.x[i..]);
            add(&mut left[i + 1..], self.x[i], &row[i + 1..]);
        }
        let mut y = [0.0; N];
        for (k, side) in self.working_set().iter().enumerate() {
            let (start, part) = self.constraints.normal(problem, side.constraint);
            add(&mut left[start..], -side.sign * self.members.multipliers[k], part);
            y[k] = self.violation(problem, side);
        }
        let left = self.basis.project(0, &left);
        self.basis.solve_transposed(&mut y);
        y[q..].iter_mut().zip(&left[q..]).for_each(|(y, left)| *y = -left);
        add(&mut self.x, 1.0, &self.basis.expand(&y));
        self.size = ROUNDING * self.force;
        let mut gained = y;
        add(&mut gained[..q], 1.0, &left);
        let gained = self.basis.solve(&gained);
        add(&mut self.members.multipliers[..q], 1.0, &gained);
    }
}

impl<const N: usize> Members<N> {
    /// The member in place `q`, the first that is free.
    fn push(&mut self, q: usize, side: Side, scale: f64, multiplier: f64) {
        (self.sides[q], self.multipliers[q]) = (side, multiplier);
        (self.floors[q], self.scales[q]) = if side.equality { (f64::NEG_INFINITY, 0.0) } else { (0.0, scale) };
    }

    fn remove(&mut self, k: usize) {
        self.sides.copy_within(k + 1.., k);
        self.multipliers.copy_within(k + 1.., k);
        self.floors.copy_within(k + 1.., k);
        self.scales.copy_within(k + 1.., k);
    }
}

#[cfg(test)]
mod tests;
