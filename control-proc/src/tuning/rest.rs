//! Margins of the whole loop about a reference that stands: how much more gain or dead time it takes until the axis
//! swings, found by simulation of the commissioned model.
//!
//! ```text
//! gain    least f > 1 for which f c(x) swings         for a loop that swings as it is: largest f < 1 that does not
//! delay   least t for which t_d + t swings, s
//! swings  a_4 > max(0.5 mm, 3 c_e) and a_4 > 0.8 a_3
//! ```
//!
//! c static curve m/s, t_d dead time s, c_e one count of the encoder m; a_i way to and fro in the i-th quarter of the
//! time after a jump of the reference m, the smaller one of the largest rise and the largest fall. The linear margins
//! ([`crate::margins`]) are those of a small swing on one piece of the curve, beyond the dead band. This loop has all
//! that the controller meets about a set point: both dead bands and their compensation, hysteresis and its inverse,
//! encoder counts, the limits of magnitude and of rate. A command that crosses both dead bands takes their sum divided
//! by `command_rate`, and a loop that is fast otherwise swings for that alone.
//!
//! The standstill ([`crate::standstill`]), which shuts the valve when the axis passes its set point, is left out.
//!
//! Traps: the least factor is found by halving, which takes for granted that a loop that swings at one factor swings at
//! every larger one. And an integral that creeps to its end is no swing; hence the way to and fro.

use pipeline::machine::{Commissioned, Control};

use super::{LONG_REST, LONGEST_STEP, RESTING_MOTION, Tried, axis::SimulatedAxis};
use crate::margins::moved;

/// Jump of the reference, m.
const JUMP: f64 = 0.05;
/// Counts of the encoder that are no swing.
const COUNTS: f64 = 3.0;
/// Largest factor in the gain that is tried; its inverse is the least.
const MOST_GAIN: f64 = 16.0;
/// Longest additional dead time that is tried, in dead times and lags with a period.
const MOST_DELAY: f64 = 8.0;
/// Part of the swing in the quarter before that is left of a swing that stays.
const STAYS: f64 = 0.8;
/// Halvings. A factor is found to 2 %, a dead time to a thirtieth of dead time and lag.
const HALVINGS: usize = 8;

/// Margins about a reference that stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestMargins {
    /// Factor in the gain of the plant; infinite beyond `MOST_GAIN`, less than 1 for a loop that swings as it is.
    pub gain: f64,
    /// Additional dead time, s; infinite beyond `MOST_DELAY`, 0 for a loop that swings as it is.
    pub delay: f64,
}

/// The loop of one axis.
#[derive(Debug, Clone, Copy)]
pub struct RestLoop<'a> {
    /// Gains, law and limits.
    pub control: &'a Control,
    /// The model that the controller has.
    pub model: &'a Commissioned,
    /// Length of a count, m.
    pub resolution: f64,
    /// s.
    pub period: f64,
}

impl RestLoop<'_> {
    /// Its margins. Takes up to a second where the period is a millisecond.
    pub fn margins(&self) -> RestMargins {
        let log = MOST_GAIN.ln();
        if self.swings(1.0, 0.0) {
            let part = edge(-log, 0.0, |at| self.swings(at.exp(), 0.0));
            return RestMargins { gain: part.map_or(0.0, f64::exp), delay: 0.0 };
        }
        let most = MOST_DELAY * (self.model.reaction() + self.period);
        let gain = if self.swings(MOST_GAIN, 0.0) { edge(0.0, log, |at| self.swings(at.exp(), 0.0)) } else { None };
        let delay = if self.swings(1.0, most) { edge(0.0, most, |late| self.swings(1.0, late)) } else { None };
        RestMargins { gain: gain.map_or(f64::INFINITY, f64::exp), delay: delay.unwrap_or(f64::INFINITY) }
    }

    /// Whether the loop swings with `gain` times the gain of the plant and `late` s more of dead time.
    fn swings(&self, gain: f64, late: f64) -> bool {
        let Self { control, model, resolution, period } = *self;
        let plant = Commissioned { dead_time: model.dead_time + late, ..moved(control, model) };
        let substeps = (period / LONGEST_STEP).ceil().max(1.0);
        let mut axis = SimulatedAxis::of(&plant, period / substeps).with_gain(gain);
        let mut tried = Tried::new(control, model, period);
        let ticks = (LONG_REST.0.max(LONG_REST.1 * plant.reaction()) / period) as usize;
        let mut quarters = [Travel::NONE; 4];
        let mut command = 0.0;
        for tick in 0..ticks {
            let seen = (axis.position / resolution).round() * resolution;
            command = tried.update(&[JUMP], seen, command);
            (0..substeps as usize).for_each(|_| axis.advance(command));
            quarters[4 * tick / ticks].push(axis.position);
        }
        let [before, last] = [quarters[2], quarters[3]].map(|travel| travel.rise.min(travel.fall));
        last > RESTING_MOTION.max(COUNTS * resolution) && last > STAYS * before
    }
}

/// Largest rise and largest fall of a position, m.
#[derive(Debug, Clone, Copy)]
struct Travel {
    low: f64,
    high: f64,
    rise: f64,
    fall: f64,
}

impl Travel {
    const NONE: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, rise: 0.0, fall: 0.0 };

    fn push(&mut self, position: f64) {
        (self.low, self.high) = (self.low.min(position), self.high.max(position));
        (self.rise, self.fall) = (self.rise.max(position - self.low), self.fall.max(self.high - position));
    }
}

/// The middle of what is left between `quiet` and `swinging` after [`HALVINGS`]; none where all that was tried swings.
fn edge(quiet: f64, swinging: f64, swings: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut low, mut high, mut found) = (quiet, swinging, quiet >= 0.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if swings(middle) {
            high = middle;
        } else {
            (low, found) = (middle, true);
        }
    }
    found.then_some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        margins::{Loop, mean_slope},
        tests::models::commissioned,
    };
    use pipeline::machine::{DeadBand, Law};

    const PERIOD: f64 = 0.01;

    /// A straight curve without dead bands, 0.6 m/s at full command.
    fn straight(dead_time: f64, time_constant: f64) -> Commissioned {
        Commissioned {
            dead_time,
            time_constant,
            dead_band: DeadBand { extend: 0.0, retract: 0.0 },
            openings: vec![1.0],
            speeds_extend: vec![0.6],
            speeds_retract: vec![0.6],
            ..commissioned()
        }
    }

    fn control(kp: f64, ki: f64, command_rate: f64) -> Control {
        let none = DeadBand { extend: 0.0, retract: 0.0 };
        let shipped = crate::tests::machine(1).axes[0].control;
        Control { kp, ki, command_rate, dead_band: none, feedforward: false, law: Law::Predictive, ..shipped }
    }

    #[test]
    fn a_straight_loop_that_no_limit_meets_has_its_linear_margins() {
        for (dead_time, lag, part) in [(0.2, 0.0, 0.3), (0.05, 0.1, 0.2), (0.1, 0.03, 0.5), (0.4, 0.05, 0.4)] {
            let model = straight(dead_time, lag);
            let kp = part * 1.5 / (0.6 * (dead_time + lag));
            let control = control(kp, 0.02 * kp, 1e3);
            let linear = Loop::new(&control, &model, mean_slope(&model), PERIOD).margins();
            let of = RestLoop { control: &control, model: &model, resolution: 1e-6, period: PERIOD };
            let found = of.margins();
            assert!((found.gain / linear.gain - 1.0).abs() < 0.15, "{found:?} {linear:?}");
            assert!((found.delay / linear.delay - 1.0).abs() < 0.15, "{found:?} {linear:?}");
        }
    }

    #[test]
    fn a_slow_command_takes_a_part_of_the_gain_margin_and_the_linear_one_does_not_see_it() {
        // On an integrator a command that cannot follow its loop leads by 1/(k kp), and swings where the dead time is
        // as long: at k kp t_d = 1, where the linear loop swings at pi/2.
        let model = straight(0.1, 0.0);
        let margins = |command_rate: f64| {
            let control = control(6.0, 0.0, command_rate);
            let linear = Loop::new(&control, &model, mean_slope(&model), PERIOD).margins();
            (
                RestLoop { control: &control, model: &model, resolution: 1e-6, period: PERIOD }.margins().gain,
                linear.gain,
            )
        };
        let (fast, slow) = (margins(1e3), margins(0.05));
        assert!((fast.0 / fast.1 - 1.0).abs() < 0.15 && slow.1 == fast.1, "{fast:?}");
        assert!(slow.0 < 0.8 * slow.1 && slow.0 > 0.5 * slow.1, "{slow:?}");
    }

    #[test]
    fn a_loop_that_swings_as_it_is_has_a_gain_margin_below_one_and_no_delay_margin() {
        let model = straight(0.2, 0.0);
        let edge = 0.5 * std::f64::consts::PI / (0.6 * 0.205);
        let control = control(2.0 * edge, 0.0, 1e3);
        let found = RestLoop { control: &control, model: &model, resolution: 1e-6, period: PERIOD }.margins();
        assert!((found.gain / 0.5 - 1.0).abs() < 0.15 && found.delay == 0.0, "{found:?}");
    }
}
