//! A detector of swings that no reference asks for.
//!
//! ```text
//! l(k) = l(k-1) + (1 - exp(-n T/tau_l)) (e(k) - l(k-1))          s(k) = e(k) - l(k)          tau_l = max(0.3 s, 2 L)
//! a flip      s passes +h after it has been below -h, or -h after it has been above +h
//! h           = max(e_h, 2 S_f max(V/V_f, 1/4))
//! h           = max(e_h, 2 S_0)                    while the reference stands
//! h           = max(e_h, 0.2 V L)                  before the fallback has controlled for max(2 s, 6 L)
//! c(k) = exp(-n T/W) c(k-1), 1 more at a flip, 2 less when the reference turns, 0 at least          W = max(3 s, 20 L)
//! swings      c > 3 while the model controls
//! ```
//!
//! e following error m, l its slow part, n ticks since the last look, T period s, L dead time and lag s; e_h 0.5 mm or
//! 2 counts, whichever is more; S_f and V_f root mean squares of s and of the reference's speed in the last 30 s of the
//! fallback, S_0 that of s while the reference has stood for max(1 s, 6 L), where there are max(2 s, 6 L) of it; V that
//! of the last W. A loop with dead time swings with a period of 4 L or more, and of 8 L in the hysteresis of a worn
//! valve, so that l follows slower errors alone; a swing of 1 Hz is seen after 2.1 s, one of 4 Hz after 0.4 s.
//!
//! Traps: a fallback that is measured in motion alone excuses every swing at rest. And the swing is in the shadow of
//! the fallback, too, which takes the measured motion for a disturbance. Comparing the two says nothing about it.

use super::squares::{MEASURED, MEMORY, Squares, Standing};
use crate::protection::following_error::Deviation;

/// tau_l and W in s and in reactions of the axis.
const SLOW: (f64, f64) = (0.3, 2.0);
const WINDOW: (f64, f64) = (3.0, 20.0);
/// e_h in m and in counts.
const FLOOR: (f64, f64) = (0.5e-3, 2.0);
/// h in parts of S_f.
const LARGE: f64 = 2.0;
/// h before S_f is known, in parts of the way at the reference's speed within the reaction.
const UNKNOWN: f64 = 0.2;
/// h of an axis whose reference stands, in parts of the one at the fallback's speed.
const AT_REST: f64 = 0.25;
/// c of a swing, and what a turn of the reference takes off.
const FLIPS: f64 = 3.0;
const TURN: f64 = 2.0;

/// The detector of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Swing {
    period: f64,
    /// L, s.
    reaction: f64,
    /// tau_l, s.
    slow_time: f64,
    /// W, s.
    window: f64,
    /// e_h, m.
    floor: f64,
    /// l, m; NaN before the first error.
    slow: f64,
    /// Sides that s and the reference's speed were last on; 0 for none yet.
    sides: (f64, f64),
    /// c.
    count: f64,
    standing: Standing,
    fallback: Squares,
    /// The fallback while the reference stands.
    rest: Squares,
    model: Squares,
}

impl Swing {
    /// Of an axis with this reaction, dead time and lag in s, and this length of a count in m; looked at every `period`
    /// s.
    pub fn new(reaction: f64, resolution: f64, period: f64) -> Self {
        Self {
            period,
            reaction,
            slow_time: SLOW.0.max(SLOW.1 * reaction),
            window: WINDOW.0.max(WINDOW.1 * reaction),
            floor: FLOOR.0.max(FLOOR.1 * resolution),
            slow: f64::NAN,
            sides: (0.0, 0.0),
            count: 0.0,
            standing: Standing::new(reaction),
            fallback: Squares::default(),
            rest: Squares::default(),
            model: Squares::default(),
        }
    }

    /// Forgets all: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.slow, self.sides, self.count) = (f64::NAN, (0.0, 0.0), 0.0);
        (self.fallback, self.rest, self.model) = Default::default();
    }

    /// Whether the axis swings under the model. `by_model`: it made the last command. To be called at every tick in
    /// closed loop.
    pub fn update(&mut self, deviation: &Deviation, by_model: bool) -> bool {
        let &Deviation { elapsed, error, speed } = deviation;
        let time = elapsed as f64 * self.period;
        if self.slow.is_nan() {
            self.slow = error;
        }
        self.slow += (1.0 - (-time / self.slow_time).exp()) * (error - self.slow);
        let fast = error - self.slow;
        self.count *= (-time / self.window).exp();
        if speed * self.sides.1 < 0.0 {
            self.count = (self.count - TURN).max(0.0);
        }
        if speed != 0.0 {
            self.sides.1 = speed;
        }
        let stands = self.standing.update(speed, time);
        if by_model {
            self.model.push(fast, speed, time, self.window);
        } else {
            self.fallback.push(fast, speed, time, MEMORY);
            if stands {
                self.rest.push(fast, speed, time, MEMORY);
            }
            (self.model, self.count) = (Squares::default(), 0.0);
        }
        if fast.abs() > self.bound(stands) {
            self.count += f64::from(u8::from(fast * self.sides.0 < 0.0));
            self.sides.0 = fast;
        }
        by_model && self.count > FLIPS
    }

    /// h, m; `stands`: so does the reference.
    fn bound(&self, stands: bool) -> f64 {
        let measured = MEASURED.0.max(MEASURED.1 * self.reaction);
        if stands && self.rest.time >= measured {
            return self.floor.max(LARGE * self.rest.error.sqrt());
        }
        let usual = LARGE * self.fallback.for_speed(self.model.speed, AT_REST * AT_REST).sqrt();
        // A fallback that has never moved says nothing, nor does one that has hardly begun.
        let is_known = usual.is_finite() && self.fallback.time >= measured;
        self.floor.max(if is_known { usual } else { UNKNOWN * self.model.speed.sqrt() * self.reaction })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const PERIOD: f64 = 0.01;

    /// After 8 s of the fallback with errors of 1 mm (rms) about the reference's reversals.
    fn swing() -> Swing {
        let mut swing = Swing::new(0.1, 1e-5, PERIOD);
        for tick in 0..800 {
            let t = f64::from(tick) * PERIOD;
            let deviation =
                Deviation { elapsed: 1, error: 1.4e-3 * (TAU * 0.4 * t).sin(), speed: 0.1 * (TAU * 0.4 * t).cos() };
            assert!(!swing.update(&deviation, false));
        }
        swing
    }

    /// Seconds until a swing of this frequency (Hz) and amplitude (m) is found within 20 s.
    fn found(frequency: f64, amplitude: f64, speed: impl Fn(f64) -> f64) -> Option<f64> {
        let mut swing = swing();
        let time = |tick: u32| f64::from(tick) * PERIOD;
        let error = |t: f64| 3e-3 + amplitude * (TAU * frequency * t).sin();
        let tick = (0..2000).find(|tick| {
            swing.update(&Deviation { elapsed: 1, error: error(time(*tick)), speed: speed(time(*tick)) }, true)
        });
        tick.map(time)
    }

    #[test]
    fn a_swing_is_found_within_a_bound() {
        for (frequency, bound) in [(0.8, 6.0), (1.0, 4.0), (2.0, 2.0), (4.0, 1.0)] {
            let time = found(frequency, 8e-3, |_| 0.1).unwrap();
            assert!(time < bound, "{frequency} Hz: {time} s");
        }
        assert!(found(1.0, 8e-3, |_| 0.0).is_some(), "at rest");
    }

    #[test]
    fn what_is_small_or_slow_or_asked_for_is_no_swing() {
        assert_eq!(found(2.0, 0.4e-3, |_| 0.0), None);
        assert_eq!(found(0.2, 8e-3, |_| 0.1), None);
        // The reference turns as often.
        assert_eq!(found(1.0, 8e-3, |t| (TAU * t).cos()), None);
    }
}
