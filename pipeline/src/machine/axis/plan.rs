//! The plan of the predictive controller: its grid and the weight of its moves, in seconds.
//!
//! ```text
//! R   = min(0.2 s, 3 (t_d + tau))            how far a plan reaches past the dead time
//! q T = R/20 in whole periods, rounded up     length of a step of the plan, between two of its moves
//! H   = R/(q T), 3 steps at least            horizon in steps, and as many moves
//! D   = 1.2 (t_d + tau + T/2)                60 ms at most, and one period at least
//! S   = 31 q T, 5 tau at least               length of the model's step response that speed and lag are read from
//! ```
//!
//! t_d dead time and tau time constant of the [`Commissioned`] model in s, T control period in s, D time constant that
//! the plan gives the loop, s. All of it follows from the axis, so an axis is planned alike at every period. 20 moves,
//! 0.2 s, 3, 1.2 and 60 ms were found by simulation. The load on its spring of oil, 5 Hz on the machine that is built
//! in, rings with a D much below 60 ms.
//!
//! Trap: 20 moves of one period are 40 ms at a period of 2 ms. A plan that ends before the axis has answered swings,
//! and no weight of its moves prevents that.

use std::time::Duration;

use super::commissioned::Commissioned;
use crate::machine::document::{Section, Shown};

/// Most steps of a horizon.
pub const MAX_HORIZON: usize = 31;
/// Most moves of a plan.
pub const MAX_MOVES: usize = 20;
/// Most periods of a step: 20 steps of them are 0.2 s at a period of 0.5 ms.
pub const MAX_STEP: usize = 20;
/// Longest step response that is looked at, periods.
pub const MAX_RESPONSE: usize = MAX_HORIZON * MAX_STEP;

/// Longest R, s.
const LONGEST_REACH: f64 = 0.2;
/// R in multiples of dead time and time constant.
const REACH: f64 = 3.0;
/// Least steps of a horizon that is not given.
const LEAST_HORIZON: usize = 3;
/// D in multiples of dead time and time constant.
const RESPONSE: f64 = 1.2;
/// Greatest D, s.
const SLOWEST_RESPONSE: f64 = 0.06;
/// S in multiples of the time constant: a lag has settled to 1 % by then.
const SETTLED: f64 = 5.0;
/// Time in which a load on its spring of oil, some 5 Hz, has answered, s.
const SPRING_TIME: f64 = 0.1;
/// Weight of the moves of an axis that is not commissioned, relative to the mean square of the step response.
const RELATIVE_WEIGHT: f64 = 25.0;

/// What the machine file says of the plan. The rest follows from the commissioned model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlanSettings {
    /// q.
    pub step: Option<usize>,
    /// H.
    pub horizon: Option<usize>,
    /// Number of moves.
    pub moves: Option<usize>,
    /// Weight of the moves, relative to the mean square of the step response.
    pub move_weight: Option<f64>,
    /// D, s.
    pub response_time: Option<f64>,
}

/// The plan of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// q, periods in a step.
    pub step: usize,
    /// H, steps after the dead time.
    pub horizon: usize,
    /// Number of moves, one at each of the first steps.
    pub moves: usize,
    /// Weight of the moves.
    pub weight: MoveWeight,
    /// S in periods.
    pub response: usize,
    /// Time up to which the estimate of the noise waits for the spring of the load, s; 0 for an axis that is not
    /// commissioned.
    pub spring_time: f64,
}

/// The weight of the moves of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MoveWeight {
    /// In multiples of the mean square of the model's step response over the horizon.
    Relative(f64),
    /// By D, s: the square of an acceleration has the weight D^4.
    ResponseTime(f64),
}

impl PlanSettings {
    pub(super) fn read(section: &mut Section, commissioned: Option<&Commissioned>, period: Duration) -> Self {
        let settings = Self {
            step: section
                .key("plan_step", "Length of a step of the predictive controller's plan, in samples")
                .rule(STEP_RULE)
                .optional_integer(1..=MAX_STEP),
            horizon: section
                .key("horizon", "Prediction horizon of the predictive controller after the dead time, in steps")
                .rule(HORIZON_RULE)
                .optional_integer(1..=MAX_HORIZON),
            moves: section
                .key("moves", "Number of moves that the predictive controller plans, one for each step")
                .rule(MOVES_RULE)
                .optional_integer(1..=MAX_MOVES),
            move_weight: section
                .key(
                    "move_weight",
                    "Weight of the moves, relative to the mean square of the model's step response over the horizon; \
                     in the place of response_time",
                )
                .rule(WEIGHT_RULE)
                .optional_number(1e-6..=1e3, ""),
            response_time: section
                .key("response_time", "Time constant of the loop that the predictive controller plans for")
                .rule(RESPONSE_RULE)
                .optional_number(1e-4..=10.0, "s"),
        };
        if settings.move_weight.is_some() && settings.response_time.is_some() {
            section.refuse("response_time", "response_time beside move_weight", "one of the two");
        }
        settings.show(section, commissioned, period);
        settings
    }

    /// Notes the values that follow from the commissioned model.
    fn show(&self, section: &Section, commissioned: Option<&Commissioned>, period: Duration) {
        let plan = self.plan(commissioned, period.as_secs_f64());
        let derive = |is_given: bool, key: &str, value: String, rule: &str| {
            if !is_given {
                section.derive(key, value, rule);
            }
        };
        derive(self.step.is_some(), "plan_step", plan.step.shown(), STEP_RULE);
        derive(self.horizon.is_some(), "horizon", plan.horizon.shown(), HORIZON_RULE);
        derive(self.moves.is_some(), "moves", plan.moves.shown(), MOVES_RULE);
        match plan.weight {
            MoveWeight::Relative(weight) => {
                derive(self.move_weight.is_some(), "move_weight", weight.shown(), WEIGHT_RULE);
            }
            MoveWeight::ResponseTime(time) => {
                derive(self.response_time.is_some(), "response_time", time.shown(), RESPONSE_RULE);
            }
        }
    }

    /// The plan of an axis with this commissioned model, or without one; `period` in s.
    pub fn plan(&self, commissioned: Option<&Commissioned>, period: f64) -> Plan {
        let delay = commissioned.map(Commissioned::reaction);
        let reach = delay.map_or(LONGEST_REACH, |delay| LONGEST_REACH.min(REACH * delay));
        let steps = |length: f64| (length / period).round() as usize;
        // Horizon and moves that are given without a step count samples.
        let counts_samples = self.horizon.is_some() || self.moves.is_some();
        // The small part keeps whole periods from counting one more by rounding.
        let whole = (reach / (MAX_MOVES as f64 * period) - 1e-6).ceil() as usize;
        let usual = if counts_samples { 1 } else { whole.clamp(1, MAX_STEP) };
        let step = self.step.unwrap_or(usual);
        let usual = steps(reach / step as f64).clamp(LEAST_HORIZON, MAX_MOVES);
        let horizon = self.horizon.unwrap_or(if counts_samples { MAX_MOVES } else { usual });
        let weight = match (self.move_weight, self.response_time, delay) {
            (Some(weight), _, _) => MoveWeight::Relative(weight),
            (None, Some(time), _) => MoveWeight::ResponseTime(time),
            (None, None, Some(delay)) => {
                let time = RESPONSE * (delay + 0.5 * period);
                MoveWeight::ResponseTime(time.min(SLOWEST_RESPONSE).max(period))
            }
            (None, None, None) => MoveWeight::Relative(RELATIVE_WEIGHT),
        };
        let settled = commissioned.map_or(0, |model| steps(SETTLED * model.time_constant));
        let response = settled.max(MAX_HORIZON * step).min(MAX_RESPONSE);
        let spring_time = if commissioned.is_some() { SPRING_TIME } else { 0.0 };
        Plan { step, horizon, moves: self.moves.unwrap_or(MAX_MOVES).min(horizon), weight, response, spring_time }
    }
}

const STEP_RULE: &str = "a twentieth of the reach, rounded up; 1 where horizon or moves is given; the reach is 0.2 s, \
                         or 3 times commissioned.dead_time + time_constant where that is less";
const HORIZON_RULE: &str = "the reach in steps, 3 to 20; 20 where moves is given";
const MOVES_RULE: &str = "20, or the horizon where that is less";
const WEIGHT_RULE: &str = "none; 25 without a commissioned model and response_time";
const RESPONSE_RULE: &str = "1.2 times commissioned.dead_time + time_constant + half a period, at most 60 ms and at \
                             least a period; none without a commissioned model or with move_weight";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{DeadBand, Overrun};

    fn model(dead_time: f64, time_constant: f64) -> Commissioned {
        Commissioned {
            dead_time,
            time_constant,
            dead_band: DeadBand { extend: 0.1, retract: 0.1 },
            hysteresis: 0.0,
            natural_frequency: 0.0,
            damping: 0.2,
            openings: vec![0.5],
            speeds_extend: vec![0.5],
            speeds_retract: vec![0.5],
            largest_tested: [f64::INFINITY; 2],
            overrun: Overrun::NONE,
            mass: f64::INFINITY,
            noise: 0.0,
            fit_percent: 99.0,
        }
    }

    fn plan(dead_time: f64, time_constant: f64, period: f64) -> Plan {
        PlanSettings::default().plan(Some(&model(dead_time, time_constant)), period)
    }

    #[test]
    fn a_plan_reaches_equally_far_at_every_period() {
        for (dead_time, time_constant) in [(0.01f64, 0.037), (0.15, 0.037), (1.0, 0.05), (0.005, 0.003)] {
            let reach = (3.0 * (dead_time + time_constant)).min(0.2);
            for period in [1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 50e-3, 0.1] {
                let Plan { step, horizon, moves, .. } = plan(dead_time, time_constant, period);
                let planned = (step * horizon) as f64 * period;
                // 3 steps at least, and up to 20 of 20 periods.
                let reach = reach.max(3.0 * step as f64 * period);
                assert!((planned - reach).abs() <= 0.3 * reach, "{dead_time} {period}: {planned} s");
                assert_eq!(moves, horizon);
                assert!((1..=MAX_STEP).contains(&step) && (LEAST_HORIZON..=MAX_MOVES).contains(&horizon));
            }
        }
    }

    #[test]
    fn the_response_time_is_that_of_the_axis_up_to_its_bound() {
        let time = |plan: Plan| match plan.weight {
            MoveWeight::ResponseTime(time) => time,
            MoveWeight::Relative(_) => panic!("{plan:?}"),
        };
        assert!((time(plan(0.01, 0.01, 0.002)) - 1.2 * 0.021).abs() < 1e-12);
        assert_eq!(time(plan(0.4, 0.1, 0.01)), 0.06);
        assert_eq!(time(plan(0.4, 0.1, 0.1)), 0.1);
    }

    #[test]
    fn what_is_given_counts_samples_as_long_as_no_step_is_given() {
        let commissioned = model(0.01, 0.037);
        let given = PlanSettings { horizon: Some(31), move_weight: Some(4.0), ..PlanSettings::default() };
        let expected = Plan {
            step: 1,
            horizon: 31,
            moves: 20,
            weight: MoveWeight::Relative(4.0),
            response: 185,
            spring_time: 0.1,
        };
        assert_eq!(given.plan(Some(&commissioned), 1e-3), expected);
        let stepped = PlanSettings { step: Some(5), ..given };
        assert_eq!(stepped.plan(Some(&commissioned), 1e-3), Plan { step: 5, response: 185, ..expected });
        let moves = PlanSettings { moves: Some(4), ..PlanSettings::default() };
        let Plan { step, horizon, moves, .. } = moves.plan(Some(&commissioned), 1e-3);
        assert_eq!((step, horizon, moves), (1, 20, 4));
    }

    #[test]
    fn an_axis_that_is_not_commissioned_is_planned_for_a_fifth_of_a_second() {
        let plan = |period| PlanSettings::default().plan(None, period);
        let expected = Plan {
            step: 1,
            horizon: 20,
            moves: 20,
            weight: MoveWeight::Relative(25.0),
            response: 31,
            spring_time: 0.0,
        };
        assert_eq!(plan(0.01), expected);
        assert_eq!(plan(0.001), Plan { step: 10, response: 310, ..expected });
        assert_eq!(plan(0.05), Plan { horizon: 4, moves: 4, ..expected });
    }
}
