//! Predictive control of one axis: the best moves within the limits, anew at every tick.
//!
//! ```text
//! A dy(k) = B dx(k-nk) + T e(k)                                 the model in differences, with its noise e
//! T = (1 - tau z^-1)^2,  tau = exp(-T_s/D),  D = (nk - 1/2 + d) T_s           D: dead time and lag of the model
//! J = sum (w(k+i) - y(k+i))^2  +  lambda sum (dx(k+m) - dx_w(k+m))^2        i = nk .. nk+H-1,  m = 0 .. M-1
//! dx_w  the moves that the speed of the targets takes:  x_w(k) = (w(k+nk+d+1) - w(k+nk+d))/(V T_s)
//! y(k+nk+p) = free(k+nk+p) + sum h(p-m) X(m)                  X(m) = x(k+m) - x(k-1),  X(m) = X(M-1) for m >= M
//! N(u(k-1) - (m+1) r) <= x(k+m) <= N(u(k-1) + (m+1) r)        and both within N(u_low), N(u_high)
//! |x(k+m) - x(k+m-1)| <= rho                                  the most that r changes x on that way
//! -sqrt(2 a (y_f - y_low)) <= V x(k+m) <= sqrt(2 a (y_high - y_f))          no faster than it can stop
//! u(k) = N^-1(x(k))                                           lambda = move_weight * mean of s(p)^2
//! ```
//!
//! y position in m, w target in m, e innovation in m, x intermediate value, u valve command, r its largest change per
//! tick, h impulse and s step response, m per unit of x, which ends as V T_s (p + 1 - d); V speed per unit of x, m/s, d
//! lag in ticks; y_f = free(k+nk) where the axis will be when x(k) acts, y_low and y_high the soft limits, m, a
//! [`END_DECELERATION`]; T_s period in s; nk delay, H `horizon`, M `moves`, in samples. Source: Clarke, Mohtadi and
//! Tuffs, Generalized predictive control, Automatica 23 (1987), with its constraints as a quadratic programme
//! ([`quadratic`]); N and the model are eqs. (11) and (12) of the paper.
//!
//! Only what goes beyond the moves that the targets ask for anyway is weighed: so a large weight makes the axis follow by
//! what is known of it, and not late.
//!
//! T decides how fast the controller believes what its model did not foresee, and with that how wrong the model may be.
//! With a root at half of the dead time the loop of a model with 150 ms swings at 1.4 times its gain, or 50 ms more of
//! dead time; with two at all of it at 1.7 times, or 130 ms more.
//!
//! The last e of the past are found anew with every model: what it should have foreseen of what has happened. Those of the
//! model before would be compensated once more by the next one.
//!
//! The limits are part of the plan, so nothing winds up behind them; the rate of the first move is exact, that of the
//! later ones as wide as the widest on the way. Without an answer of the solver the first move of the plan without
//! limits is clipped.
//!
//! Traps: the model of the paper's Table 2 has a zero at -1.157, outside the unit circle, so whatever inverts B at
//! once (horizon 1 without a weight) is unstable; the horizon and the weight are what keeps this one from doing
//! so. N can be inverted only where it is monotone, so x is kept to what the commands can reach there. And x(k-1)
//! is N of the command that was *sent*: what the limits cut off is not remembered as done.

pub mod history;
pub mod quadratic;

use pipeline::{
    hammerstein::{Coefficients, Nonlinearity},
    machine::Control,
};

use history::{COMMANDS, History, TRIED};
use quadratic::{Problem, Solver, Status};

use crate::{
    model::{
        judge::Approved,
        response::{MAX_AHEAD, MAX_HORIZON, Ramp, free_response, residual, step_response},
    },
    protection::limits::Limits,
};

/// a, m/s2: on the last 60 mm before a soft limit an axis of 0.25 m/s becomes slower.
pub const END_DECELERATION: f64 = 0.5;

/// Longest lag of a model, ticks: slower ones, and those that come to a stand, count as this one.
const LONGEST_LAG: f64 = MAX_HORIZON as f64;

/// So many of the last e are found anew at every tick.
const AGAIN: usize = TRIED - 8;

/// Part of what x can reach that counts as nothing: N of a valve with a dead band is not quite zero on it.
const IDLE: f64 = 0.005;

/// The most moves that are planned: what the machine file allows.
pub const MAX_MOVES: usize = 20;

/// The predictive controller of one axis.
#[derive(Debug, Clone)]
pub struct Predictive {
    noise: Noise,
    horizon: usize,
    moves: usize,
    move_weight: f64,
    soft_limits: (f64, f64),
    period: f64,
    problem: Problem<MAX_MOVES, MAX_MOVES>,
    solver: Solver<MAX_MOVES, MAX_MOVES>,
    unsolved: u64,
    unsolved_in_a_row: u64,
}

/// e of the past.
#[derive(Debug, Clone, Copy, Default)]
struct Noise {
    /// The last two before the [`AGAIN`] newest ones.
    older: [f64; 2],
    /// Outputs of the history that they are made of.
    taken: u64,
}

/// What the model says of the past.
struct Past {
    intermediate: [f64; COMMANDS],
    /// What is known of T e(k+1), T e(k+2).
    coming: [f64; 2],
}

impl Predictive {
    /// Horizon, moves and their weight from the machine file; `soft_limits` in m, `period` in s.
    pub fn new(control: &Control, soft_limits: (f64, f64), period: f64) -> Self {
        let horizon = control.horizon.clamp(1, MAX_HORIZON);
        let moves = control.moves.clamp(1, MAX_MOVES.min(horizon));
        let mut problem = Problem::new([[0.0; MAX_MOVES]; MAX_MOVES], [0.0; MAX_MOVES]);
        for m in 1..MAX_MOVES {
            (problem.rows[m][m - 1], problem.rows[m][m]) = (-1.0, 1.0);
        }
        // Moves that are not planned are 0, and of no account.
        for m in moves..MAX_MOVES {
            problem.hessian[m][m] = 1.0;
            (problem.lower[m], problem.upper[m]) = (0.0, 0.0);
            (problem.row_lower[m], problem.row_upper[m]) = (-f64::INFINITY, f64::INFINITY);
        }
        Self {
            noise: Noise::default(),
            horizon,
            moves,
            move_weight: control.move_weight,
            soft_limits,
            period,
            problem,
            solver: Solver::new(),
            unsolved: 0,
            unsolved_in_a_row: 0,
        }
    }

    /// Forgets the noise: there has been no model.
    pub fn reset(&mut self) {
        self.noise = Noise::default();
        self.unsolved_in_a_row = 0;
    }

    /// Plans that had to do without the solver, so far.
    pub fn unsolved(&self) -> u64 {
        self.unsolved
    }

    /// The same since the last that did not.
    pub fn unsolved_in_a_row(&self) -> u64 {
        self.unsolved_in_a_row
    }

    /// y(k), m, where no position has come: what the model expected, so that nothing is learned of this tick. A line
    /// drawn over the gap afterwards would hide how the axis accelerates, which a model in differences takes for a push.
    ///
    /// `history` is as it was made for tick k-1, with the command of that tick.
    pub fn bridge(&mut self, approved: &Approved<'_>, history: &History) -> Option<f64> {
        let model = approved.model;
        let mut step = [0.0; MAX_HORIZON];
        step_response(model, &mut step);
        let past = self.past(model, Ramp::new(&step), history.outputs(), &history.commands()[1..], history.count())?;
        let mut next = [0.0];
        free_response(model, history.outputs(), &past.intermediate, &past.coming, &mut next);
        next[0].is_finite().then_some(next[0])
    }

    /// The command of this tick, within the model's range and within `limits` of the last one that was sent. To be
    /// called at every tick while there is a model, whether its command is used or not.
    ///
    /// `targets` holds y_r(k), y_r(k+1), .. in m; beyond its end the last one counts. `None` when the model gives
    /// no finite answer, or no targets are given: then another controller must make the command.
    pub fn update(
        &mut self,
        approved: &Approved<'_>,
        limits: &Limits,
        history: &History,
        targets: &[f64],
    ) -> Option<f64> {
        let model = approved.model;
        let nk = model.structure()?.nk;
        let nonlinearity = model.nonlinearity();
        let last_target = *targets.last()?;

        let mut step = [0.0; MAX_HORIZON];
        step_response(model, &mut step);
        let ramp = Ramp::new(&step);
        let step = &step[..self.horizon];
        let past = self.past(model, ramp, history.outputs(), history.commands(), history.count())?;
        let mut free = [0.0; MAX_AHEAD];
        let ahead = nk - 1 + self.horizon;
        free_response(model, history.outputs(), &past.intermediate, &past.coming, &mut free[..ahead]);

        // free[i] is y(k+1+i): the first one that x(k) can still change is free[nk-1].
        let mut deviation = [0.0; MAX_HORIZON];
        for (p, deviation) in deviation[..self.horizon].iter_mut().enumerate() {
            let target = targets.get(nk + p).copied().unwrap_or(last_target);
            *deviation = target - free[nk - 1 + p];
        }
        let expected = self.expected(ramp, targets, nk);
        self.weigh(step, &deviation[..self.horizon], &expected);
        let (last, x) = (history.commands()[0], past.intermediate[0]);
        self.bound(&nonlinearity, approved.range, limits, last, x);
        self.slow_down(ramp.slope / self.period, free[nk - 1], x);

        let x = x + self.first_level()?;
        // Beyond what the commands can reach the inverse stays at the command that reaches furthest.
        let u = nonlinearity.invert(x, approved.range);
        (x.is_finite() && u.is_finite()).then(|| limits.apply(u, last))
    }

    /// x and e of the past, with y(k), y(k-1), .. as `outputs`, `count` of them so far, and u(k-1), u(k-2), .. as
    /// `commands`. `None` for what is not finite.
    fn past(
        &mut self,
        model: &Coefficients,
        ramp: Ramp,
        outputs: &[f64],
        commands: &[f64],
        count: u64,
    ) -> Option<Past> {
        let structure = model.structure()?;
        let nonlinearity = model.nonlinearity();
        let mut intermediate = [0.0; COMMANDS];
        for (x, u) in intermediate.iter_mut().zip(commands).take(structure.nk + structure.nb + TRIED) {
            *x = nonlinearity.evaluate(*u);
        }
        let delay = structure.nk as f64 - 0.5 + if ramp.lag >= 0.0 { ramp.lag.min(LONGEST_LAG) } else { 0.0 };
        let tau = (-1.0 / delay).exp();
        let (t_1, t_2) = (-2.0 * tau, tau * tau);
        let further = |[one, two]: [f64; 2], ago: usize| {
            [residual(model, &outputs[ago..], &intermediate[ago..]) - t_1 * one - t_2 * two, one]
        };
        let new = count.checked_sub(self.noise.taken).and_then(|new| usize::try_from(new).ok());
        let new = new.filter(|new| *new <= TRIED - AGAIN);
        // What is older stays as the models of then explained it; after a long gap, and in another history, there is
        // nothing older.
        let (leaving, older) = new.map_or((TRIED, [0.0; 2]), |new| (AGAIN + new, self.noise.older));
        let older = (AGAIN..leaving).rev().fold(older, further);
        let [one, two] = (0..AGAIN).rev().fold(older, further);
        let coming = [t_1 * one + t_2 * two, t_2 * one];
        if !coming.iter().all(|noise| noise.is_finite()) {
            self.noise = Noise::default();
            return None;
        }
        self.noise = Noise { older, taken: count };
        Some(Past { intermediate, coming })
    }

    /// dx_w(k), dx_w(k+1), ..: the moves that `targets` take of a model with this ramp; none of a model that does
    /// not integrate, or where the targets ask for no finite speed.
    fn expected(&self, ramp: Ramp, targets: &[f64], nk: usize) -> [f64; MAX_MOVES] {
        let mut moves = [0.0; MAX_MOVES];
        let lag = ramp.lag.round();
        if !(0.0..=LONGEST_LAG).contains(&lag) {
            return moves;
        }
        let at = |i: usize| targets[i.min(targets.len() - 1)];
        let level = |i: usize| (at(i + 1) - at(i)) / ramp.slope;
        let first = nk + lag as usize;
        for (m, expected) in moves[..self.moves].iter_mut().enumerate() {
            *expected = level(first + m) - level(first + m - 1);
        }
        if moves.iter().all(|expected| expected.is_finite()) { moves } else { [0.0; MAX_MOVES] }
    }

    /// J as 1/2 X'HX + g'X.
    fn weigh(&mut self, step: &[f64], deviation: &[f64], expected: &[f64; MAX_MOVES]) {
        let (horizon, moves) = (self.horizon, self.moves);
        let mut impulse = [0.0; MAX_HORIZON];
        for p in 0..horizon {
            impulse[p] = step[p] - if p > 0 { step[p - 1] } else { 0.0 };
        }
        // Column m of the response: the impulse, shifted by m; the last move stays, so its column is the step.
        let column = |m: usize| if m + 1 == moves { step } else { &impulse[..horizon] };
        let weight = self.move_weight * step.iter().map(|s| s * s).sum::<f64>() / horizon as f64;
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
            // |X(0)|^2 + |X(1) - X(0)|^2 + ..: every level is in two moves, but the last.
            hessian[m][m] += if m + 1 < moves { 2.0 * weight } else { weight };
            gradient[m] -= weight * expected[m];
            if m + 1 < moves {
                hessian[m][m + 1] -= weight;
                gradient[m] += weight * expected[m + 1];
            }
        }
    }

    /// Where the levels may be, by magnitude and rate of the command that was last sent.
    fn bound(&mut self, nonlinearity: &Nonlinearity, range: (f64, f64), limits: &Limits, last: f64, x: f64) {
        let (lowest, highest) = nonlinearity.reachable(range);
        let rising = nonlinearity.orientation(range) >= 0.0;
        // The way over a dead band, or over a dip of N, counts for nothing: nothing moves on it, and a plan that had to
        // wait for it would never begin.
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
        for m in 0..self.moves {
            let reach = (m + 1) as f64 * limits.step;
            let (down, up) = (at(opening - reach), at(opening + reach));
            let (down, up) = if rising { (down, up) } else { (up, down) };
            // 0, the level of now, stays allowed: N may turn back on the way.
            let (lower, upper) = (down.min(0.0).max(lowest.min(0.0)), up.max(0.0).min(highest.max(0.0)));
            widest = widest.max(before.0 - lower).max(upper - before.1);
            before = (lower, upper);
            (self.problem.lower[m], self.problem.upper[m]) = (lower, upper);
        }
        self.problem.row_lower[1..self.moves].fill(-widest);
        self.problem.row_upper[1..self.moves].fill(widest);
    }

    /// Keeps the levels to speeds from which the axis can stop before its soft limits, when it is at `position` m; `speed`
    /// is V.
    fn slow_down(&mut self, speed: f64, position: f64, x: f64) {
        let (low, high) = self.soft_limits;
        let allowed = |distance: f64| (2.0 * END_DECELERATION * distance.max(0.0)).sqrt() / speed.abs();
        let (down, up) = (allowed(position - low), allowed(high - position));
        let (down, up) = if speed >= 0.0 { (-down, up) } else { (-up, down) };
        // What the rate does not allow is not asked for: an axis that is too fast brakes as fast as it may.
        for m in 0..self.moves {
            let (lower, upper) = (self.problem.lower[m], self.problem.upper[m]);
            self.problem.upper[m] = upper.min((up - x).max(lower));
            self.problem.lower[m] = lower.max((down - x).min(upper));
        }
    }

    /// X(0) of the best plan.
    fn first_level(&mut self) -> Option<f64> {
        // Most limits of a plan are those of the plan before.
        let solution = self.solver.resume(&self.problem);
        if solution.status == Status::Solved {
            self.unsolved_in_a_row = 0;
            return Some(solution.x[0]);
        }
        self.unsolved += 1;
        self.unsolved_in_a_row += 1;
        match solution.status {
            Status::Solved | Status::NotConvex | Status::NotFinite => None,
            Status::Infeasible | Status::IterationLimit => {
                let free = Problem::new(self.problem.hessian, self.problem.gradient);
                let solution = self.solver.solve(&free);
                let clipped = solution.x[0].clamp(self.problem.lower[0], self.problem.upper[0]);
                (solution.status == Status::Solved).then_some(clipped)
            }
        }
    }
}

#[cfg(test)]
mod tests;
