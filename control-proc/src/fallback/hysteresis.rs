//! The inverse of the valve's hysteresis.
//!
//! ```text
//! p(k) = min(max(p(k-1), |w(k)|), |w(k)| + s)          u(k) = sign(w) max(|w| - b h (p(k) - |w|)/s, 0)
//! ```
//!
//! w command that the curve of rising commands asks for, u command that is sent, p the magnitude that w turned back
//! from, h hysteresis of [`pipeline::machine::Commissioned`], s way (`TURN` h) over which the compensation comes and
//! goes, b part of the hysteresis that is compensated (`COMPENSATED`). Behind a play of width h the spool stays where
//! it is until a command has turned back by h; so u turns back by b h more than w does. Source: inverse of the play
//! operator, as usual for valves with friction.
//!
//! Traps: full compensation of a hysteresis that is measured too wide drives the loop to and fro. And a compensation
//! that comes at once chatters with every count of noise: so it comes over the way s.

/// Way over which the compensation comes and goes, as part of the hysteresis.
const TURN: f64 = 0.5;
/// Part of the hysteresis that is compensated.
const COMPENSATED: f64 = 0.8;

/// The inverse of one valve's hysteresis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// b h.
    compensated: f64,
    /// s.
    turn: f64,
    /// p, with the sign of w.
    peak: f64,
}

impl Hysteresis {
    /// The inverse of a hysteresis of this width, a part of the full command; 0 for none.
    pub fn new(width: f64) -> Self {
        Self { compensated: COMPENSATED * width, turn: TURN * width, peak: 0.0 }
    }

    /// The next command is sent as it is: w has not turned back.
    pub fn reset(&mut self) {
        self.peak = 0.0;
    }

    /// u(k) for w(k).
    pub fn update(&mut self, w: f64) -> f64 {
        let magnitude = w.abs();
        let before = if self.peak * w > 0.0 { self.peak.abs() } else { 0.0 };
        let peak = before.max(magnitude).min(magnitude + self.turn);
        self.peak = peak.copysign(w);
        if peak > magnitude {
            (magnitude - self.compensated * (peak - magnitude) / self.turn).max(0.0).copysign(w)
        } else {
            w
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The play of the valve: the position that its spool approaches.
    fn play(before: f64, u: f64, h: f64) -> f64 {
        before.clamp(u - 0.5 * h, u + 0.5 * h)
    }

    #[test]
    fn a_spool_behind_the_play_follows_within_what_is_not_compensated() {
        let h = 0.04;
        let (mut inverse, mut spool) = (Hysteresis::new(h), 0.0);
        for k in 0..400 {
            let w = 0.5 * (f64::from(k) / 40.0).sin();
            spool = play(spool, inverse.update(w), h);
            if w.abs() > 0.3 {
                let error = (w - spool).abs() - 0.5 * h;
                assert!(error < (1.0 - COMPENSATED) * h + TURN * h, "{k}: {w} {spool}");
            }
        }
    }

    #[test]
    fn rising_commands_and_valves_without_hysteresis_are_left_alone() {
        let mut inverse = Hysteresis::new(0.04);
        assert!([0.1, 0.2, -0.1, -0.3, 0.0, 0.4].iter().all(|w| inverse.update(*w) == *w));
        let mut none = Hysteresis::new(0.0);
        assert!([0.3, 0.2, 0.1, -0.3, -0.1].iter().all(|w| none.update(*w) == *w));
    }

    #[test]
    fn a_command_that_turns_back_by_the_way_is_compensated() {
        let mut inverse = Hysteresis::new(0.04);
        inverse.update(0.5);
        assert!((inverse.update(0.48) - (0.48 - 0.032)).abs() < 1e-12);
        assert!((inverse.update(0.49) - (0.49 - 0.016)).abs() < 1e-12);
        assert!((inverse.update(0.5) - 0.5).abs() < 1e-12);
    }
}
