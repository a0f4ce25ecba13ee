//! The limits of an axis' motion: soft stop, standstill, and jerk of the references that the controller makes itself.
//!
//! ```text
//! t_r = 3 (t_d + tau), but at least min(0.3 s, 4 (t_d + tau + T + 20 ms))   reaction time of the soft stop
//! a   = max(1, 0.3 s / t_r)^2 0.5 m/s2                                      deceleration of the soft stop
//! e   = max(0.25 mm, 2 counts)                                              rest band
//! j   = min(v_max / (0.1 s2), r k / tau)                                    jerk
//! ```
//!
//! t_d dead time and tau time constant of the [`Commissioned`] model, s; T period, s; k the smaller of the two slopes
//! from its dead bands to its largest measured speeds, m/s; v_max `max_speed`, m/s; r `command_rate`, 1/s. An axis
//! that is not commissioned has t_r = 0.3 s, a = 0.5 m/s2 and j = v_max / (0.1 s2).
//! A motion with the jerk j is smoothed over 0.2 s times the root of v_max / (0.1 s2 j), at most 10000 T.
//!
//! Near the limit the soft stop approaches with the rate 1 / t_r. With less than three times the delay of the axis the
//! approach would overshoot. The delay of a fast axis is also that of the period and half of the 40 ms over which the
//! speed is measured. With four times that delay the axis passes its limit by no more than with 0.3 s. A fast axis
//! decelerates so much more that a t_r^2 / 2, where t_r begins to limit the speed, stays at 22.5 mm. The command cannot
//! change faster than r, and behind the lag the acceleration of the axis cannot change faster than r k / tau.
//!
//! Trap: e has no part in the commissioned model. Dry friction and noise decide how close an axis comes.

use super::commissioned::Commissioned;
use crate::machine::document::{Section, Shown};

/// t_r in multiples of the delay: with less the approach to the limit would overshoot.
const REACTIONS: f64 = 3.0;
/// t_r of a fast axis in multiples of its delay with period and measurement.
const FAST_REACTIONS: f64 = 4.0;
/// Half of the time over which the speed of an axis is measured, s.
const SPEED_DELAY: f64 = 0.02;
/// Least rest band in counts of the encoder: less cannot be told from noise.
const REST_COUNTS: f64 = 2.0;
/// Least usual rest band, m, for encoders with finer counts.
const USUAL_REST: f64 = 0.25e-3;
/// Least usual rest band as multiple of the commissioned noise.
const REST_NOISE: f64 = 3.0;
/// Usual jerk per `max_speed`, 1/s2.
const USUAL_JERK: f64 = 10.0;

/// Length of the mean that bounds the usual jerk, s, and most periods of such a mean: every tick adds them up.
const SMOOTHING: (f64, f64) = (0.2, 10_000.0);

/// What the machine file says of the limits. The rest follows from the axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitSettings {
    /// a, m/s2.
    pub stop_deceleration: Option<f64>,
    /// t_r, s.
    pub stop_reaction: Option<f64>,
    /// e, m.
    pub rest_band: Option<f64>,
    /// j, m/s3.
    pub jerk: Option<f64>,
}

/// The limits of the motion of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Deceleration that the soft stop relies on, m/s2.
    pub stop_deceleration: f64,
    /// Time from the command of the soft stop to its effect, with its margin, s.
    pub stop_reaction: f64,
    /// Following error at which an axis rests, m.
    pub rest_band: f64,
    /// Largest jerk of a motion to a set point, m/s3.
    pub jerk: f64,
}

impl MotionLimits {
    /// t_r of an axis of which nothing is known, s.
    pub const UNKNOWN_REACTION: f64 = 0.3;
    /// a of an axis of which nothing is known, m/s2.
    pub const UNKNOWN_DECELERATION: f64 = 0.5;
}

/// What the limits of an axis follow from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nature<'a> {
    pub commissioned: Option<&'a Commissioned>,
    /// `max_speed`, m/s.
    pub max_speed: f64,
    /// `command_rate`, 1/s.
    pub command_rate: f64,
    /// Length of one count of the encoder, m; NaN where it is not known yet.
    pub resolution: f64,
    /// T, s.
    pub period: f64,
}

impl LimitSettings {
    pub(super) fn read(section: &mut Section, nature: &Nature) -> Self {
        let settings = Self {
            stop_deceleration: section
                .key("stop_deceleration", "Deceleration that the soft stop before a soft limit relies on")
                .rule(DECELERATION_RULE)
                .optional_number(1e-3..=100.0, "m/s2"),
            stop_reaction: section
                .key("stop_reaction", "Reaction time of the soft stop: near a soft limit the speed is the way over it")
                .rule(REACTION_RULE)
                .optional_number(1e-3..=60.0, "s"),
            rest_band: section
                .key("rest_band", "Following error at which an axis rests once its reference stands")
                .rule(REST_RULE)
                .optional_number(1e-6..=0.1, "m"),
            jerk: section
                .key("jerk", "Largest jerk of the motion to a set point; 4 times the jerk halves its times of rise")
                .rule(JERK_RULE)
                .optional_number(1e-3..=1e6, "m/s3"),
        };
        settings.expect_possible(section, nature);
        settings.expect_jerk(section, nature);
        // Nothing follows from a model that is refused.
        if section.is_sound() {
            settings.show(section, nature);
        }
        settings
    }

    /// Refuses a reaction time that the axis does not have, and a rest band that the encoder does not see.
    fn expect_possible(&self, section: &Section, nature: &Nature) {
        let least = nature.commissioned.map_or(0.0, Commissioned::reaction);
        if let Some(reaction) = self.stop_reaction.filter(|reaction| *reaction < least) {
            let allowed = format!("{least} s or more, commissioned.dead_time + time_constant");
            section.refuse("stop_reaction", reaction.to_string(), allowed);
        }
        let least = REST_COUNTS * nature.resolution;
        // In the place of a refused resolution stands the largest.
        if let Some(band) = self.rest_band.filter(|band| *band < least && section.is_sound()) {
            section.refuse("rest_band", band.to_string(), format!("{least} m or more, 2 counts of the encoder"));
        }
    }

    /// Refuses a jerk whose mean would be too long to be added up at every tick.
    fn expect_jerk(&self, section: &Section, nature: &Nature) {
        let least = nature.least_jerk();
        if let Some(jerk) = self.jerk.filter(|jerk| *jerk < least && section.is_sound()) {
            let allowed = format!("{least} m/s3 or more: the motion to a set point is smoothed over 10000 periods");
            section.refuse("jerk", jerk.to_string(), allowed);
        }
    }

    /// Notes the values that follow from the axis.
    fn show(&self, section: &Section, nature: &Nature) {
        let MotionLimits { stop_deceleration, stop_reaction, rest_band, jerk } = self.limits(nature);
        // The length of a count of a sensor at a joint is not known yet.
        let rests = !nature.resolution.is_nan();
        for (given, is_known, key, value, rule) in [
            (self.stop_deceleration, true, "stop_deceleration", stop_deceleration, DECELERATION_RULE),
            (self.stop_reaction, true, "stop_reaction", stop_reaction, REACTION_RULE),
            (self.rest_band, rests, "rest_band", rest_band, REST_RULE),
            (self.jerk, true, "jerk", jerk, JERK_RULE),
        ] {
            if given.is_none() && is_known {
                section.derive(key, value.shown(), rule);
            }
        }
    }

    /// The limits of an axis like this.
    pub(super) fn limits(&self, nature: &Nature) -> MotionLimits {
        let stop_reaction = self.stop_reaction.unwrap_or_else(|| nature.reaction());
        MotionLimits {
            stop_deceleration: self.stop_deceleration.unwrap_or_else(|| nature.deceleration()),
            stop_reaction,
            rest_band: self.rest_band.unwrap_or_else(|| nature.rest_band()).max(REST_COUNTS * nature.resolution),
            jerk: self.jerk.unwrap_or_else(|| nature.jerk()),
        }
    }
}

impl Nature<'_> {
    /// t_r.
    fn reaction(&self) -> f64 {
        self.commissioned.map_or(MotionLimits::UNKNOWN_REACTION, |model| {
            let fast = FAST_REACTIONS * (model.reaction() + self.period + SPEED_DELAY);
            (REACTIONS * model.reaction()).max(fast.min(MotionLimits::UNKNOWN_REACTION))
        })
    }

    /// e, of any encoder.
    fn rest_band(&self) -> f64 {
        self.commissioned.map_or(USUAL_REST, |model| USUAL_REST.max(REST_NOISE * model.noise))
    }

    /// a.
    fn deceleration(&self) -> f64 {
        MotionLimits::UNKNOWN_DECELERATION * (MotionLimits::UNKNOWN_REACTION / self.reaction()).max(1.0).powi(2)
    }

    /// Least j: the mean is longer by the root of the usual jerk over j.
    fn least_jerk(&self) -> f64 {
        USUAL_JERK * self.max_speed * (SMOOTHING.0 / (SMOOTHING.1 * self.period)).powi(2)
    }

    /// j.
    fn jerk(&self) -> f64 {
        let usual = USUAL_JERK * self.max_speed;
        self.commissioned.map_or(usual, |model| {
            let (retract, extend) = model.tested_speeds(1.0);
            let slope = retract.min(extend) / model.openings.last().copied().unwrap_or(1.0);
            usual.min(self.command_rate * slope / model.time_constant).max(self.least_jerk())
        })
    }
}

const DECELERATION_RULE: &str = "0.5; with a commissioned model times the square of 0.3 over the default of \
                                 stop_reaction, where that is below 0.3";
const REACTION_RULE: &str = "0.3; with a commissioned model 3 times its dead_time + time_constant, at least 0.3 or 4 \
                             times these, a period and 20 ms together, whichever is less";
const REST_RULE: &str = "2 counts of the encoder, at least 0.00025; with a commissioned model at least 3 times its \
                         noise";
const JERK_RULE: &str = "10 1/s2 times max_speed; with a commissioned model at most command_rate times the mean slope \
                         of its curve over its time_constant";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{DeadBand, Overrun};

    fn model(dead_time: f64, time_constant: f64, speed: f64) -> Commissioned {
        Commissioned {
            dead_time,
            time_constant,
            dead_band: DeadBand { extend: 0.1, retract: 0.1 },
            hysteresis: 0.0,
            natural_frequency: 0.0,
            damping: 0.2,
            openings: vec![0.4],
            speeds_extend: vec![speed],
            speeds_retract: vec![1.1 * speed],
            largest_tested: [f64::INFINITY; 2],
            overrun: Overrun::NONE,
            mass: f64::INFINITY,
            noise: 0.0,
            fit_percent: 99.0,
        }
    }

    fn limits(settings: LimitSettings, commissioned: Option<&Commissioned>) -> MotionLimits {
        let nature = Nature { commissioned, max_speed: 1.2, command_rate: 5.0, resolution: 1e-4, period: 0.01 };
        settings.limits(&nature)
    }

    #[test]
    fn an_axis_that_is_not_commissioned_or_as_slow_as_an_excavators_has_the_limits_of_one() {
        let usual = MotionLimits { stop_deceleration: 0.5, stop_reaction: 0.3, rest_band: 0.25e-3, jerk: 12.0 };
        assert_eq!(limits(LimitSettings::default(), None), usual);
        let slow = limits(LimitSettings::default(), Some(&model(0.16, 0.13, 0.25)));
        assert_eq!(slow, MotionLimits { stop_reaction: 3.0 * (0.16 + 0.13), ..usual });
    }

    #[test]
    fn a_fast_axis_reacts_sooner_and_stops_harder() {
        let fast = limits(LimitSettings::default(), Some(&model(0.002, 0.005, 0.6)));
        assert!((fast.stop_reaction - 4.0 * 0.037).abs() < 1e-12, "{fast:?}");
        assert!((fast.stop_deceleration * fast.stop_reaction.powi(2) - 0.045).abs() < 1e-12, "{fast:?}");
        // In between the reaction time neither jumps nor falls.
        let reaction =
            |delay: f64| limits(LimitSettings::default(), Some(&model(0.5 * delay, 0.5 * delay, 0.6))).stop_reaction;
        let reactions: Vec<f64> = (0..300).map(|i| reaction(1e-3 * f64::from(i))).collect();
        assert!(reactions.windows(2).all(|pair| (0.0..4.1e-3).contains(&(pair[1] - pair[0]))));
    }

    #[test]
    fn an_axis_with_a_long_lag_or_a_slow_command_gets_a_gentle_jerk() {
        let slow = limits(LimitSettings::default(), Some(&model(0.1, 1.0, 0.2)));
        // 5 / s times 0.2 m/s over 0.4, over 1 s.
        assert!((slow.jerk - 2.5).abs() < 1e-12, "{slow:?}");
    }

    #[test]
    fn what_the_machine_file_says_counts() {
        let settings = LimitSettings {
            stop_deceleration: Some(2.0),
            stop_reaction: Some(0.1),
            rest_band: Some(2.5e-4),
            jerk: Some(50.0),
        };
        let said = MotionLimits { stop_deceleration: 2.0, stop_reaction: 0.1, rest_band: 2.5e-4, jerk: 50.0 };
        for model in [None, Some(model(0.02, 0.02, 0.25))] {
            assert_eq!(limits(settings, model.as_ref()), said);
        }
        // Two counts at the least.
        assert_eq!(limits(LimitSettings { rest_band: Some(1e-5), ..settings }, None).rest_band, 2e-4);
        // Noise says nothing then.
        let noisy = Commissioned { noise: 3e-4, ..model(0.02, 0.02, 0.25) };
        assert_eq!(limits(settings, Some(&noisy)).rest_band, 2.5e-4);
    }

    #[test]
    fn an_axis_with_noise_rests_at_three_times_of_it() {
        let rest = |noise: f64| {
            let noisy = Commissioned { noise, ..model(0.02, 0.02, 0.25) };
            limits(LimitSettings::default(), Some(&noisy)).rest_band
        };
        assert_eq!([0.0, 5e-5].map(rest), [0.25e-3; 2]);
        assert!((rest(3e-4) - 0.9e-3).abs() < 1e-12, "{}", rest(3e-4));
    }
}
