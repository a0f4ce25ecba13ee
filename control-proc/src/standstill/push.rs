//! The push: what holds an axis that drifts at its set point, where its gains have no integral.
//!
//! ```text
//! p(k+1) = p(k) + T/T_p (e - min(max(e, -e_push), e_push))        |p| <= p_max = 0.1/kp        T_p = max(16 L, 5 s)
//! ```
//!
//! p what the following error e is greater by for the fallback, m, T period in s, L dead time and lag in s, kp gain of
//! the fallback in 1/m. Gains are tuned on a course, and what follows that best may be without an integral.
//!
//! Trap: behind a dead band that has grown, a load that sinks by its oil comes to rest where the error alone opens the
//! valve: 20 mm below for a boom. p acts on an axis that moves. One that stands while its command rises is stuck, for
//! all that is known.

use pipeline::machine::Control;

/// T_p in parts of L, and the least one, s: many times slower than the loop.
const DELAYS: f64 = 16.0;
const LEAST_TIME: f64 = 5.0;
/// Opening that p makes at most.
const MOST: f64 = 0.1;

/// p, of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// T/T_p.
    part: f64,
    /// e_push, m.
    band: f64,
    /// p_max, m; 0 for gains with an integral.
    most: f64,
    /// m.
    now: f64,
}

impl Push {
    /// For a fallback with these gains of an axis with this L (s), called every `period` s; `band` is e_push, m.
    pub fn new(control: &Control, band: f64, delay: f64, period: f64) -> Self {
        let most = if control.kp > 0.0 && control.ki == 0.0 { MOST / control.kp } else { 0.0 };
        Self { part: period / (DELAYS * delay).max(LEAST_TIME), band, most, now: 0.0 }
    }

    /// Whether the gains do not hold a drift by themselves.
    pub fn is_needed(&self) -> bool {
        self.most > 0.0
    }

    /// A reference moves.
    pub fn reset(&mut self) {
        self.now = 0.0;
    }

    /// Begins to hold an axis at an error of `error` m. A p that holds the other way is of no use.
    pub fn begin(&mut self, error: f64) {
        if self.is_over(error) {
            self.reset();
        }
    }

    /// p, m.
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Whether it has brought an axis with an error of `error` m back to its set point.
    pub fn is_over(&self, error: f64) -> bool {
        self.now != 0.0 && self.now * error <= 0.0
    }

    /// p at an error of `error` m, `elapsed` ticks after the last one.
    pub fn update(&mut self, elapsed: u64, error: f64) -> f64 {
        let beyond = error - error.clamp(-self.band, self.band);
        self.now = (self.now + elapsed as f64 * self.part * beyond).clamp(-self.most, self.most);
        self.now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn push(ki: f64) -> Push {
        let control = Control { kp: 4.0, ki, ..crate::tests::machine(1).axes[0].control };
        Push::new(&control, 0.5e-3, 0.1, 0.01)
    }

    #[test]
    fn it_grows_with_what_is_beyond_the_band_up_to_its_bound() {
        let mut push = push(0.0);
        assert!(push.is_needed() && !push.is_over(1e-3));
        assert_eq!(push.update(1, 0.5e-3), 0.0);
        // 2 mm beyond for 1 s, over T_p = 5 s.
        let last = (0..100).map(|_| push.update(1, 2.5e-3)).last();
        assert!(last.is_some_and(|last| (last - 0.4e-3).abs() < 1e-12), "{last:?}");
        assert!(!push.is_over(1e-4) && push.is_over(0.0) && push.is_over(-1e-4));
        assert_eq!((push.update(1_000_000, 0.1), push.update(1_000_000, -0.1)), (0.025, -0.025));
        push.reset();
        assert_eq!(push.now(), 0.0);
    }

    #[test]
    fn gains_with_an_integral_do_without() {
        let mut push = push(0.2);
        assert!(!push.is_needed());
        assert_eq!(push.update(1000, 0.1), 0.0);
    }
}
