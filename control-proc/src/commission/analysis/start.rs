//! The start of the oil: how late an axis moves that has stood, beside its dead time.
//!
//! ```text
//! tau_p dp/dt + p = 1 while the valve is open in a direction, else 0       v_c = c(x) max(0, (p - p_0)/(1 - p_0))
//! p_0 = 1 - exp(-t_s/tau_p)
//! ```
//!
//! p pressure in the direction, 0 after a long rest and 1 in a long motion; p_0 the pressure that holds the load; t_s
//! time in s for which the valve is open before an axis that stood moves; tau_p lag of the pressure, s; c static curve,
//! x spool position and v_c speed of the curve, m/s. The directions have each their p and t_s. A load-sensing pump
//! stands by at a low pressure and follows that of the load with a lag, so an axis lifts its load late and lowers it at
//! once. A chamber without pressure has to be filled before it moves its piston. Source: Merritt, Hydraulic Control
//! Systems (1967).
//!
//! Trap: without it a search explains a direction that starts late by speeds that are too low and a dead band that is
//! too wide. The start is no part of the model: on a machine it depends on what the other axes do with the pump.

/// Longest time before a motion that is searched, s.
const LONGEST: f64 = 1.0;
/// Lags that are searched, s.
const LAGS: std::ops::RangeInclusive<f64> = 0.01..=0.5;

/// How late the oil starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Start {
    /// t_s of extending and of retracting, s.
    pub times: [f64; 2],
    /// tau_p, s; 0 for oil that flows at once.
    pub lag: f64,
}

/// p of extending and of retracting in the course of a motion.
pub(super) struct Pressure {
    levels: [f64; 2],
    /// p_0.
    least: [f64; 2],
    /// Part of the difference to 0 or 1 that is left a step later; none for oil that flows at once.
    decay: Option<f64>,
}

impl Start {
    /// Oil that flows at once.
    pub const NONE: Self = Self { times: [0.0; 2], lag: 0.0 };

    /// Whether it is in the ranges that are searched.
    pub fn is_allowed(self) -> bool {
        if self.lag == 0.0 {
            return self.times == [0.0; 2];
        }
        LAGS.contains(&self.lag) && self.times.iter().all(|time| (0.0..=LONGEST).contains(time))
    }

    /// After a long rest, in steps of `step` s.
    pub fn pressure(self, step: f64) -> Pressure {
        let decay = (self.lag > 0.0).then(|| (-step / self.lag).exp());
        let least = self.times.map(|time| if self.lag > 0.0 { 1.0 - (-time / self.lag).exp() } else { 0.0 });
        Pressure { levels: [0.0; 2], least, decay }
    }
}

impl Pressure {
    /// What is left of the speeds of the curve after one more step with the spool at x, whose valve is open or shut.
    #[inline]
    pub fn advance(&mut self, x: f64, is_open: bool) -> f64 {
        let Some(decay) = self.decay else { return 1.0 };
        let side = usize::from(x < 0.0);
        for (i, level) in self.levels.iter_mut().enumerate() {
            let towards = if is_open && i == side { 1.0 } else { 0.0 };
            *level = towards + (*level - towards) * decay;
        }
        ((self.levels[side] - self.least[side]) / (1.0 - self.least[side])).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-3;

    #[test]
    fn the_speed_rises_after_the_time_of_its_direction_and_with_the_lag() {
        let start = Start { times: [0.2, 0.0], lag: 0.1 };
        for (x, time) in [(0.3, 0.2), (-0.3, 0.0)] {
            let mut pressure = start.pressure(STEP);
            for k in 1..1000 {
                let part = pressure.advance(x, true);
                let t = STEP * f64::from(k) - time;
                let expected = if t > 0.0 { 1.0 - (-t / 0.1).exp() } else { 0.0 };
                assert!((part - expected).abs() < 1e-9, "{x} {t} {part}");
            }
        }
    }

    #[test]
    fn a_short_rest_costs_less_than_a_long_one() {
        let late = |rest: usize| {
            let mut pressure = Start { times: [0.2, 0.2], lag: 0.1 }.pressure(STEP);
            (0..2000).for_each(|_| _ = pressure.advance(0.3, true));
            (0..rest).for_each(|_| _ = pressure.advance(0.0, false));
            (1..).find(|_| pressure.advance(0.3, true) != 0.0).unwrap()
        };
        assert_eq!(late(0), 1);
        assert!(late(50) < late(100) && late(100) < late(2000));
        assert!((late(2000) as f64 * STEP - 0.2).abs() < 2.0 * STEP);
    }

    #[test]
    fn oil_that_flows_at_once_leaves_the_curve_as_it_is() {
        let mut pressure = Start::NONE.pressure(STEP);
        assert_eq!(pressure.advance(0.3, true), 1.0);
    }
}
