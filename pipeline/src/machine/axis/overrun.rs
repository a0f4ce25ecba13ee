//! Loads that overrun an axis: they pull it faster than its inlet fills it.
//!
//! ```text
//! v = g c(x)          g = max(1, sqrt(P / P_0))
//! ```
//!
//! c speed of the commissioned curve at the spool position x, m/s, v that of the axis; P force with which the load
//! pulls in the direction of the motion, N; P_0 the one from which on the outlet passes more than the inlet, N. Behind
//! a pressure compensator the flow through the inlet does not depend on the load. That through the outlet rises with
//! the root of the pressure that the load makes there. Source: orifice equation, Merritt, Hydraulic Control Systems
//! (1967).
//!
//! Trap: without compensators a load that pushes makes an axis slower as well. That is not in g.

use crate::machine::document::Section;

/// P_0 of both directions, N; infinite where no load overruns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overrun {
    /// While extending.
    pub extend: f64,
    /// While retracting.
    pub retract: f64,
}

impl Overrun {
    /// No load overruns.
    pub const NONE: Self = Self { extend: f64::INFINITY, retract: f64::INFINITY };

    pub(super) fn read(section: &mut Section) -> Self {
        let mut key = |name, meaning| {
            section.key(name, meaning).rule("none").optional_number(1.0..=1e9, "N").unwrap_or(f64::INFINITY)
        };
        Self {
            extend: key("overrun_extend", "Pull of a load from which on it extends the axis faster than its inlet"),
            retract: key("overrun_retract", "Pull of a load from which on it retracts the axis faster than its inlet"),
        }
    }

    /// g of extending and of retracting under a load that `force` N of the cylinder hold: positive where it pushes.
    #[inline]
    pub fn factors(&self, force: f64) -> [f64; 2] {
        let factor = |pull: f64, least: f64| (pull / least).max(1.0).sqrt();
        [factor(-force, self.extend), factor(force, self.retract)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pull_beyond_its_force_moves_by_the_root() {
        let overrun = Overrun { extend: 1e4, retract: f64::INFINITY };
        assert_eq!(overrun.factors(-4e4), [2.0, 1.0]);
        for force in [-1e4, -5e3, 0.0, 4e4] {
            assert_eq!(overrun.factors(force), [1.0; 2], "{force}");
        }
        assert_eq!(Overrun { extend: 1e4, retract: 1e5 }.factors(4e5), [1.0, 2.0]);
        assert_eq!(overrun.factors(f64::NAN), [1.0; 2]);
    }
}
