//! The quadratic programme of one tick: the cost of the moves and the limits of the levels.
//!
//! ```text
//! J = sum (w(k_p) - y(k_p))^2  +  lambda sum (dX(m) - dX_w(m))^2            p = 0 .. H-1,  m = 0 .. M-1
//! k_p = k + nk + (p+1) q - 1                                                the ends of the steps, after the delay
//! dX_w  the moves that the speed of the references takes:  X_w(m) = (w(k_m+q) - w(k_m))/(V q T),  k_m = k+nk+d+m q
//! y(k_p) = free(k_p) + sum h(p-m) X(m)                      X(m) = x(k+m q+q-1) - x(k-1),  X(m) = X(M-1) for m >= M
//! N(u(k-1) - (m+1) q r) <= x <= N(u(k-1) + (m+1) q r)        and both within N(u_low), N(u_high)
//! |dX(m)| <= rho                                             the most that r changes x in a step on that way
//! -sqrt(2 a (y_f - y_low)) <= V x <= sqrt(2 a (y_high - y_f))               no faster than the axis can stop
//! lambda = V^2 D^4/(q T)^2          or move_weight times the mean of s(p)^2
//! ```
//!
//! y position in m, w reference in m, x intermediate value, X its levels at the ends of the steps relative to the last
//! one, dX moves, u valve command, r its largest change per tick; s response to a level that is reached within the
//! first step, h its increments, m per unit of x; V speed per unit of x, m/s; d lag in ticks; y_f = free(k+nk) where
//! the axis will be when x(k) acts, y_low and y_high the soft limits, m; a [`END_DECELERATION`]; T period in s; nk
//! delay, q step, in ticks; H horizon, M moves, in steps; D response time in s ([`pipeline::machine::Plan`]).
//!
//! Between the ends of a step x changes in a straight line. So V dX/(q T) is an acceleration, and J with D is the
//! integral of the squares of error and acceleration, e^2 + D^4 a^2, whatever the period is: the loop that it plans has
//! the time constant D.
//!
//! Only moves beyond those that the references ask for are weighed. Hence the axis follows its reference without a lag
//! even with a large weight, and relies on the model more than on the feedback.

use pipeline::{
    hammerstein::Nonlinearity,
    machine::{MAX_HORIZON, MAX_MOVES, MoveWeight, Plan},
};

use super::quadratic::{Problem, Solver, Status};
use crate::{model::response::Ramp, protection::limits::Limits};

/// a, m/s2: an axis of 0.25 m/s slows down on the last 60 mm before a soft limit.
pub const END_DECELERATION: f64 = 0.5;

/// Part of the reachable x that counts as nothing: N of a valve with a dead band is not exactly zero on it.
const IDLE: f64 = 0.005;

/// The quadratic programme of one axis.
#[derive(Debug, Clone)]
pub(super) struct Programme {
    plan: Plan,
    /// q T, s.
    length: f64,
    soft_limits: (f64, f64),
    problem: Problem<MAX_MOVES, MAX_MOVES>,
}

impl Programme {
    /// For this plan; `soft_limits` in m, `period` in s.
    pub fn new(plan: Plan, soft_limits: (f64, f64), period: f64) -> Self {
        let mut problem = Problem::new([[0.0; MAX_MOVES]; MAX_MOVES], [0.0; MAX_MOVES]);
        for m in 1..MAX_MOVES {
            (problem.rows[m][m - 1], problem.rows[m][m]) = (-1.0, 1.0);
        }
        // Moves that are not planned are 0 and do not change the cost.
        for m in plan.moves..MAX_MOVES {
            problem.hessian[m][m] = 1.0;
            (problem.lower[m], problem.upper[m]) = (0.0, 0.0);
            (problem.row_lower[m], problem.row_upper[m]) = (-f64::INFINITY, f64::INFINITY);
        }
        Self { plan, length: plan.step as f64 * period, soft_limits, problem }
    }

    /// The programme's first level X(0), found by `solver`. The second value says whether the solver found the best
    /// plan; without it X(0) is clipped.
    pub fn first_level(&self, solver: &mut Solver<MAX_MOVES, MAX_MOVES>) -> (Option<f64>, bool) {
        // Most limits of a plan are those of the plan before.
        let solution = solver.resume(&self.problem);
        match solution.status {
            Status::Solved => (Some(solution.x[0]), true),
            Status::NotConvex | Status::NotFinite => (None, false),
            Status::Infeasible | Status::IterationLimit => {
                let free = Problem::new(self.problem.hessian, self.problem.gradient);
                let solution = solver.solve(&free);
                let clipped = solution.x[0].clamp(self.problem.lower[0], self.problem.upper[0]);
                ((solution.status == Status::Solved).then_some(clipped), false)
            }
        }
    }

    /// dX_w(0), dX_w(1), ..: the moves that the references ask of a model with this ramp. All are 0 for a model that
    /// does not integrate, or where the references ask for no finite speed.
    pub fn expected(&self, ramp: Ramp, references: &[f64], nk: usize) -> [f64; MAX_MOVES] {
        let Plan { step, moves: count, .. } = self.plan;
        let mut moves = [0.0; MAX_MOVES];
        let lag = ramp.lag.round();
        if !(0.0..=ramp.ticks as f64).contains(&lag) {
            return moves;
        }
        let at = |i: usize| references[i.min(references.len() - 1)];
        let level = |i: usize| (at(i + step) - at(i)) / (ramp.slope * step as f64);
        let first = nk + lag as usize;
        for (m, expected) in moves[..count].iter_mut().enumerate() {
            let i = first + m * step;
            *expected = level(i) - level(i.saturating_sub(step));
        }
        if moves.iter().all(|expected| expected.is_finite()) { moves } else { [0.0; MAX_MOVES] }
    }

    /// s(0), s(1), .. of the plan from the step response of the model, tick by tick.
    fn respond(&self, step: &[f64]) -> [f64; MAX_HORIZON] {
        let mut response = [0.0; MAX_HORIZON];
        // A level that is reached in equal parts answers as the mean of as many steps, one tick apart.
        for (mean, ticks) in response.iter_mut().zip(step.chunks_exact(self.plan.step)).take(self.plan.horizon) {
            *mean = ticks.iter().sum::<f64>() / self.plan.step as f64;
        }
        response
    }

    /// lambda for a plan with this response, of a model with this ramp.
    fn weight(&self, response: &[f64], ramp: Ramp) -> f64 {
        match self.plan.weight {
            MoveWeight::Relative(weight) => {
                weight * response.iter().map(|s| s * s).sum::<f64>() / response.len() as f64
            }
            MoveWeight::ResponseTime(time) => {
                // V q T. A model that does not integrate is fastest at the begin of its response.
                let way = ramp.slope.abs() * self.plan.step as f64;
                let fastest = response.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(way, f64::max);
                (fastest * (time / self.length).powi(2)).powi(2)
            }
        }
    }

    /// Sets the cost, J as 1/2 X'HX + g'X. `step` is the step response of the model, tick by tick, `ramp` its end, and
    /// `deviation` holds reference minus free response at the ends of the steps.
    pub fn weigh(&mut self, step: &[f64], ramp: Ramp, deviation: &[f64], expected: &[f64; MAX_MOVES]) {
        let Plan { horizon, moves, .. } = self.plan;
        let response = self.respond(step);
        let step = &response[..horizon];
        let mut impulse = [0.0; MAX_HORIZON];
        for p in 0..horizon {
            impulse[p] = step[p] - if p > 0 { step[p - 1] } else { 0.0 };
        }
        // Column m of the response is the impulse, shifted by m. The last level stays, so its column is the step.
        let column = |m: usize| if m + 1 == moves { step } else { &impulse[..horizon] };
        let weight = self.weight(step, ramp);
        let Problem { hessian, gradient, .. } = &mut self.problem;
        for m in (0..moves).rev() {
            let of_m = column(m);
            gradient[m] = -of_m.iter().zip(&deviation[m..]).map(|(h, d)| h * d).sum::<f64>();
            for n in m..moves {
                // Both columns from row n on; along a diagonal only the last product is new.
                hessian[m][n] = if n + 1 < moves && n + 2 < moves {
                    hessian[m + 1][n + 1] + impulse[horizon - 1 - m] * impulse[horizon - 1 - n]
                } else {
                    of_m[n - m..].iter().zip(column(n)).take(horizon - n).map(|(a, b)| a * b).sum()
                };
            }
        }
        for m in 0..moves {
            // |X(0)|^2 + |X(1) - X(0)|^2 + ..: every level is part of two moves, except the last one.
            hessian[m][m] += if m + 1 < moves { 2.0 * weight } else { weight };
            gradient[m] -= weight * expected[m];
            if m + 1 < moves {
                hessian[m][m + 1] -= weight;
                gradient[m] += weight * expected[m + 1];
            }
        }
    }

    /// Limits the levels by magnitude and rate of the command; `last` was sent, and x is N of it.
    pub fn bound(&mut self, nonlinearity: &Nonlinearity, range: (f64, f64), limits: &Limits, last: f64, x: f64) {
        let (lowest, highest) = nonlinearity.reachable(range);
        let rising = nonlinearity.orientation(range) >= 0.0;
        // The way over a dead band, or over a dip of N, takes no time in the plan: nothing moves on it, and a plan that
        // had to wait for it would never begin.
        let edge = |reachable: f64| nonlinearity.invert(IDLE * reachable, range);
        let (one, other) = (edge(lowest), edge(highest));
        let (low_edge, high_edge) = (one.min(other), one.max(other));
        let opening = (last - high_edge).max(0.0) + (last - low_edge).min(0.0);
        let at = |opening: f64| {
            let edge = if opening > 0.0 { high_edge } else { low_edge };
            if opening == 0.0 { -x } else { nonlinearity.evaluate((edge + opening).clamp(range.0, range.1)) - x }
        };
        let (lowest, highest) = (lowest - x, highest - x);
        let (mut before, mut widest) = ((0.0, 0.0), 0.0f64);
        for m in 0..self.plan.moves {
            let reach = ((m + 1) * self.plan.step) as f64 * limits.step;
            let (down, up) = (at(opening - reach), at(opening + reach));
            let (down, up) = if rising { (down, up) } else { (up, down) };
            // 0, the present level, stays allowed: N may turn back on the way.
            let (lower, upper) = (down.min(0.0).max(lowest.min(0.0)), up.max(0.0).min(highest.max(0.0)));
            widest = widest.max(before.0 - lower).max(upper - before.1);
            before = (lower, upper);
            (self.problem.lower[m], self.problem.upper[m]) = (lower, upper);
        }
        self.problem.row_lower[1..self.plan.moves].fill(-widest);
        self.problem.row_upper[1..self.plan.moves].fill(widest);
    }

    /// Limits the levels to speeds from which the axis can stop before its soft limits, for an axis at `position` m;
    /// `speed` is V.
    pub fn slow_down(&mut self, speed: f64, position: f64, x: f64) {
        let (low, high) = self.soft_limits;
        let allowed = |distance: f64| (2.0 * END_DECELERATION * distance.max(0.0)).sqrt() / speed.abs();
        let (down, up) = (allowed(position - low), allowed(high - position));
        let (down, up) = if speed >= 0.0 { (-down, up) } else { (-up, down) };
        // The rate limit goes first: an axis that is too fast brakes as fast as the rate allows.
        for m in 0..self.plan.moves {
            let (lower, upper) = (self.problem.lower[m], self.problem.upper[m]);
            self.problem.upper[m] = upper.min((up - x).max(lower));
            self.problem.lower[m] = lower.max((down - x).min(upper));
        }
    }
}
