//! Predictive control of one axis: the best moves within the limits, planned anew at every tick.
//!
//! | module | what it holds |
//! |---|---|
//! | [`history`] | past outputs and commands |
//! | `noise` | what the model did not foresee of the past |
//! | `programme` | cost of the moves and limits of the levels |
//! | [`quadratic`] | quadratic programmes, solved exactly |
//!
//! ```text
//! A dy(k) = B dx(k-nk) + T e(k)        free response of the model, with what is known of its noise     `noise`
//! X(0)    = first level of the plan    that minimises J within the limits                              `programme`
//! u(k)    = N^-1(x(k-1) + X(0)/q)      within magnitude and rate of the command
//! ```
//!
//! y position in m, x = N(u) intermediate value, e innovation in m, u valve command, q ticks in a step of the
//! plan. Source: Clarke, Mohtadi and Tuffs, Generalized predictive control, Automatica 23 (1987), with its constraints
//! as a quadratic programme; N and the model are eqs. (11) and (12) of the paper.
//!
//! The limits are part of the plan, so nothing winds up behind them. The rate of the first move is exact, that of later
//! moves as wide as the widest on the way. Without an answer of the solver the first move of the plan without limits is
//! clipped.
//!
//! Traps:
//! - The model of the paper's Table 2 has a zero at -1.157, outside the unit circle. A controller that inverts B at
//!   once (horizon 1 without a weight) is unstable; horizon and weight prevent that here.
//! - N can be inverted only where it is monotone, so x is kept to what the commands can reach there.
//! - x(k-1) is N of the command that was *sent*. What the limits cut off was not done.
//! - Inside a dead band a polynomial N can turn the wrong way. A plan that starts from x of such a dip is pulled back
//!   by the weight of its moves, and the command jumps to and fro over the dead band. The plan starts from N without
//!   its dips.
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod history;
mod noise;
mod programme;
pub mod quadratic;

pub use programme::END_DECELERATION;

use pipeline::machine::{MAX_HORIZON, MAX_MOVES, MAX_RESPONSE, Plan};

use crate::{
    model::{
        judge::Approved,
        response::{MAX_AHEAD, Ramp, free_response, step_response},
    },
    protection::limits::Limits,
};
use history::History;
use noise::Noise;
use programme::Programme;
use quadratic::Solver;

/// The predictive controller of one axis.
#[derive(Debug, Clone)]
pub struct Predictive {
    noise: Noise,
    plan: Plan,
    programme: Programme,
    period: f64,
    solver: Solver<MAX_MOVES, MAX_MOVES>,
    unsolved: u64,
    unsolved_in_a_row: u64,
}

impl Predictive {
    /// For this plan; `soft_limits` in m, `period` in s.
    pub fn new(plan: Plan, soft_limits: (f64, f64), period: f64) -> Self {
        Self {
            noise: Noise::new(plan.spring_time / period),
            plan,
            programme: Programme::new(plan, soft_limits, period),
            period,
            solver: Solver::new(),
            unsolved: 0,
            unsolved_in_a_row: 0,
        }
    }

    /// Forgets the noise: there has been no model.
    pub fn reset(&mut self) {
        self.noise.reset();
        self.unsolved_in_a_row = 0;
    }

    /// Number of unsolved plans so far.
    pub fn unsolved(&self) -> u64 {
        self.unsolved
    }

    /// Number of unsolved plans in a row; 0 after a plan that was solved.
    pub fn unsolved_in_a_row(&self) -> u64 {
        self.unsolved_in_a_row
    }

    /// y(k), m, of a tick without a position: what the model expected, so that this tick adds nothing to the noise. A
    /// line drawn over the gap afterwards would hide how the axis accelerates, which a model in differences takes for a
    /// push.
    ///
    /// `history` is as it was made for tick k-1, with the command of that tick.
    pub fn bridge(&mut self, approved: &Approved<'_>, history: &History) -> Option<f64> {
        let model = approved.model;
        let mut step = [0.0; MAX_RESPONSE];
        let step = &mut step[..self.plan.response];
        step_response(model, step);
        let past = self.noise.past(model, Ramp::new(step), history, &history.commands()[1..])?;
        let mut next = [0.0];
        free_response(model, history.outputs(), &past.intermediate, &past.coming, &mut next);
        next[0].is_finite().then_some(next[0])
    }

    /// The command of this tick, within the model's range and within `limits` of the last one that was sent. To be
    /// called at every tick while there is a model, whether its command is used or not.
    ///
    /// `references` holds y_r(k), y_r(k+1), .. in m; beyond its end the last one counts. `None` when the model gives
    /// no finite answer or moves the other way over the horizon, or there are no references: then another controller
    /// must make the command.
    pub fn update(
        &mut self,
        approved: &Approved<'_>,
        limits: &Limits,
        history: &History,
        references: &[f64],
    ) -> Option<f64> {
        let model = approved.model;
        let nk = model.structure()?.nk;
        let nonlinearity = model.nonlinearity();
        let last_reference = *references.last()?;
        let Plan { step: ticks, horizon, response, .. } = self.plan;

        let mut step = [0.0; MAX_RESPONSE];
        let step = &mut step[..response];
        step_response(model, step);
        let ramp = Ramp::new(step);
        let step = &step[..horizon * ticks];
        // A model that first moves the other way, for most of the horizon, would be pushed the wrong way.
        if step.iter().sum::<f64>() * model.b().iter().sum::<f64>() <= 0.0 {
            return None;
        }
        let past = self.noise.past(model, ramp, history, history.commands())?;
        let mut free = [0.0; MAX_AHEAD];
        let ahead = nk - 1 + horizon * ticks;
        free_response(model, history.outputs(), &past.intermediate, &past.coming, &mut free[..ahead]);

        // free[i] is y(k+1+i): the first one that x(k) can still change is free[nk-1].
        let mut deviation = [0.0; MAX_HORIZON];
        for (p, deviation) in deviation[..horizon].iter_mut().enumerate() {
            let end = (p + 1) * ticks - 1;
            let reference = references.get(nk + end).copied().unwrap_or(last_reference);
            *deviation = reference - free[nk - 1 + end];
        }
        let expected = self.programme.expected(ramp, references, nk);
        self.programme.weigh(step, ramp, &deviation[..horizon], &expected);
        let last = history.commands()[0];
        let x = nonlinearity.monotone(last, approved.range);
        self.programme.bound(&nonlinearity, approved.range, limits, last, x);
        self.programme.slow_down(ramp.slope / self.period, free[nk - 1], x);

        // The level at the end of the first step is reached in equal parts.
        let x = x + self.first_level()? / ticks as f64;
        // Beyond what the commands can reach the inverse stays at the command that reaches furthest.
        let u = nonlinearity.invert(x, approved.range);
        (x.is_finite() && u.is_finite()).then(|| limits.apply(u, last))
    }

    /// X(0) of the plan, with a count of the plans that were not solved.
    fn first_level(&mut self) -> Option<f64> {
        let (level, is_solved) = self.programme.first_level(&mut self.solver);
        if is_solved {
            self.unsolved_in_a_row = 0;
        } else {
            self.unsolved += 1;
            self.unsolved_in_a_row += 1;
        }
        level
    }
}

#[cfg(test)]
mod tests;
