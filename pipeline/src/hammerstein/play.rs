//! The play of a valve: which command acts behind a hysteresis.
//!
//! ```text
//! w(k) = min(max(w(k-1), u(k) - h/2), u(k) + h/2)          u_a(k) = w(k) + sign(w(k)) h/2,  0 where u(k) = 0
//! ```
//!
//! u command, w position that the spool approaches, h width of the hysteresis, u_a acting command: the one that would
//! bring a spool that comes from neutral to w. A model of commands that rise from neutral, such as
//! [`crate::machine::Commissioned`], holds for every command when it is given u_a in the place of u.
//!
//! Trap: at neutral the spool may rest at up to h/2. A dead band that is wider holds the axis there, so u_a is 0.

/// The play of one valve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Play {
    /// h/2.
    half: f64,
    /// w.
    position: f64,
}

impl Play {
    /// Of this width, a part of the full command; 0 for none. The spool is in the middle.
    pub const fn new(width: f64) -> Self {
        Self { half: 0.5 * width, position: 0.0 }
    }

    /// u_a(k) for u(k).
    pub fn acting(&mut self, u: f64) -> f64 {
        self.position = self.position.max(u - self.half).min(u + self.half);
        if u == 0.0 { u } else { self.position + self.half.copysign(self.position) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_from_neutral_act_as_they_are_and_others_behind_the_play() {
        let mut play = Play::new(0.04);
        for (u, acting) in [(0.3, 0.3), (0.5, 0.5), (0.48, 0.5), (0.4, 0.44), (0.42, 0.44), (0.45, 0.45), (0.0, 0.0)] {
            assert!((play.acting(u) - acting).abs() < 1e-12, "{u}");
        }
        assert!((play.acting(-0.5) + 0.5).abs() < 1e-12 && (play.acting(-0.4) + 0.44).abs() < 1e-12);
    }

    #[test]
    fn without_hysteresis_nothing_changes() {
        let mut play = Play::new(0.0);
        assert!([0.3, -0.1, 0.0, -0.0, 1.0].iter().all(|u| play.acting(*u).to_bits() == u.to_bits()));
    }
}
