//! The inverse of the valve's hysteresis.
//!
//! ```text
//! p(k) = min(max(p(k-1), |w(k)|), |w(k)| + s)          u(k) = sign(w) max(|w| - b h (p(k) - |w|)/s, 0)
//! b    = b_r + a (1 - b_r)                             s = (s_r + a (s_m - s_r)) h
//! ```
//!
//! w command that the curve of rising commands asks for, u command that is sent, p the magnitude that w turned back
//! from, h hysteresis of [`pipeline::machine::Commissioned`], a part of the motion of the reference as in
//! [`crate::fallback`], 0 at rest; b part of the hysteresis that is compensated, and s way over which that comes and
//! goes, at rest (`AT_REST`) and in motion (`IN_MOTION`). Behind a play of width h the spool stays where it is
//! until a command has turned back by h; so u turns back by b h more than w does. Source: inverse of the play operator,
//! as usual for valves with friction.
//!
//! Traps: what is left of the play makes the loop swing about a moving reference, by as much as kp needs to pass it; so
//! in motion the hysteresis is compensated whole, and s is small. At rest that drives an axis to and fro whose
//! hysteresis was measured too wide, and what comes at once chatters with every count of noise.

/// What is compensated, as parts of the hysteresis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Compensation {
    /// b.
    part: f64,
    /// s.
    turn: f64,
}

const AT_REST: Compensation = Compensation { part: 0.8, turn: 0.5 };
const IN_MOTION: Compensation = Compensation { part: 1.0, turn: 0.15 };

/// The inverse of one valve's hysteresis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// h.
    width: f64,
    /// p, with the sign of w.
    peak: f64,
}

impl Hysteresis {
    /// The inverse of a hysteresis of this width, a part of the full command; 0 for none.
    pub fn new(width: f64) -> Self {
        Self { width, peak: 0.0 }
    }

    /// The next command is sent as it is: w has not turned back.
    pub fn reset(&mut self) {
        self.peak = 0.0;
    }

    /// u(k) for w(k) while the reference moves by the part a.
    pub fn update(&mut self, w: f64, moving: f64) -> f64 {
        let between = |rest: f64, motion: f64| (rest + moving * (motion - rest)) * self.width;
        let compensated = between(AT_REST.part, IN_MOTION.part);
        let turn = between(AT_REST.turn, IN_MOTION.turn);
        let magnitude = w.abs();
        let before = if self.peak * w > 0.0 { self.peak.abs() } else { 0.0 };
        let peak = before.max(magnitude).min(magnitude + turn);
        self.peak = peak.copysign(w);
        if peak > magnitude { (magnitude - compensated * (peak - magnitude) / turn).max(0.0).copysign(w) } else { w }
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
    fn a_spool_behind_the_play_follows_within_what_is_not_compensated_and_the_way_of_the_turn() {
        let h = 0.04;
        for (moving, Compensation { part, turn }) in [(0.0, AT_REST), (1.0, IN_MOTION)] {
            let (mut inverse, mut spool) = (Hysteresis::new(h), 0.0);
            for k in 0..400 {
                let w = 0.5 * (f64::from(k) / 40.0).sin();
                spool = play(spool, inverse.update(w, moving), h);
                if w.abs() > 0.3 {
                    let error = (w - spool).abs() - 0.5 * h;
                    assert!(error < (1.0 - part + turn) * h, "{k}: {w} {spool}");
                }
            }
        }
    }

    #[test]
    fn rising_commands_and_valves_without_hysteresis_are_left_alone() {
        let mut inverse = Hysteresis::new(0.04);
        assert!([0.1, 0.2, -0.1, -0.3, 0.0, 0.4].iter().all(|w| inverse.update(*w, 1.0) == *w));
        let mut none = Hysteresis::new(0.0);
        assert!([0.3, 0.2, 0.1, -0.3, -0.1].iter().all(|w| none.update(*w, 1.0) == *w));
    }

    #[test]
    fn a_command_that_turns_back_by_the_way_is_compensated() {
        let h = 0.04;
        for (moving, Compensation { part, turn }) in [(0.0, AT_REST), (1.0, IN_MOTION)] {
            let mut inverse = Hysteresis::new(h);
            inverse.update(0.5, moving);
            for turned in [1.0, 0.5, 0.0] {
                let w = 0.5 - turned * turn * h;
                assert!((inverse.update(w, moving) - (w - turned * part * h)).abs() < 1e-12, "{moving} {turned}");
            }
        }
    }

    #[test]
    fn the_compensation_changes_evenly_from_rest_to_motion() {
        let h = 0.04;
        let mut inverse = Hysteresis::new(h);
        inverse.update(0.5, 0.0);
        let mut before = inverse.update(0.45, 0.0);
        for part in 1..=100 {
            let command = inverse.update(0.45, f64::from(part) / 100.0);
            assert!(command <= before && before - command < 0.01 * h, "{part}: {before} {command}");
            before = command;
        }
        assert!((before - (0.45 - h)).abs() < 1e-12);
    }
}
