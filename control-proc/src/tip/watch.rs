//! Where the bucket's teeth are, and how far they are from where they should be.
//!
//! ```text
//! e   = distance of the teeth from the nearest place of their way, its ends included
//! lag = |tip(y_r) - tip(y)|                           along the way as well
//! p   = 1 for lag <= L_0,  falling evenly to 0.1 at L_1
//! ```
//!
//! y positions and y_r references of the cylinders in m, tip the place of the teeth that they make in m; L_0 and L_1
//! `EASY` and `MOST`; p the pace at which time may go on along the way ([`crate::reference::path`]).
//!
//! Runs in the loop: nothing here allocates after construction.

use mechanism::{AXES, Mechanism, PreparedMechanism, Rotation};
use pipeline::{
    machine::Machine,
    message::{TeethState, TipState},
};

use crate::tip::TipPlan;

/// Lag of the teeth up to which time goes on at its full pace, m: more than an undisturbed controller has.
const EASY: f64 = 0.06;
/// Lag at which it goes on at the least pace, m.
const MOST: f64 = 0.25;
const LEAST_PACE: f64 = 0.1;
/// Length of the way, before and after the planned place, in which the nearest place is looked for, m.
pub const NEAR: f64 = 0.5;

/// The teeth of a machine.
#[derive(Debug, Clone, PartialEq)]
pub struct TipWatch {
    mechanism: PreparedMechanism,
    /// Payload of the machine file, kg.
    payload: f64,
    lag: f64,
    /// Whether the lag slows the time along the way.
    waits: bool,
}

impl TipWatch {
    /// Of a machine with this mechanism.
    pub fn new(mechanism: &Mechanism) -> Self {
        Self { mechanism: mechanism.prepared(), payload: mechanism.masses.payload.mass, lag: 0.0, waits: true }
    }

    /// Of a machine with its task; none for a machine without a mechanism that its axes move.
    pub fn of(machine: &Machine) -> Option<Self> {
        let mechanism = machine.mechanism.as_ref().filter(|_| machine.axes.len() >= AXES)?;
        let waits = machine.tip.as_ref().is_none_or(|task| !task.without.waiting);
        Some(Self { waits, ..Self::new(mechanism) })
    }

    /// The teeth with the cylinders at `positions` m, whose references are `references` m, at `t` s of a plan.
    pub fn update(
        &mut self,
        positions: Option<[f64; AXES]>,
        references: &[f64; AXES],
        plan: Option<(&TipPlan, f64)>,
    ) -> TeethState {
        self.lag = 0.0;
        let Some(pose) = positions.map(|positions| self.mechanism.pose(&positions)) else {
            return TeethState::default();
        };
        if !(pose.tip.x.is_finite() && pose.tip.z.is_finite()) {
            return TeethState::default();
        }
        let mut state = TeethState {
            x: pose.tip.x,
            z: pose.tip.z,
            pitch: pose.bucket.angle(),
            payload: self.payload,
            state: TipState::Known as u32,
            ..TeethState::default()
        };
        if let Some((plan, t)) = plan {
            let (way, s) = (plan.way(), plan.length(t));
            self.lag = (self.mechanism.pose(references).tip - pose.tip).norm();
            state.error = way.distance(pose.tip, ((s - NEAR).max(0.0), (s + NEAR).min(way.length())));
            state.pitch_error = (Rotation::by(way.place(s).pitch).inverse() * pose.bucket).angle();
            state.way = s;
            state.state = TipState::OnTheWay as u32;
        }
        state
    }

    /// p after the last tick; 1 in a comparison without waiting.
    pub fn pace(&self) -> f64 {
        if !self.waits {
            return 1.0;
        }
        let part = (self.lag - EASY) / (MOST - EASY);
        1.0 - (1.0 - LEAST_PACE) * part.clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::TipWithout;

    use super::*;

    #[test]
    fn teeth_that_lag_behind_slow_the_time_but_not_in_a_comparison_without_waiting() {
        let pace = |waiting: bool, behind: f64| {
            let mut machine = Machine::load(None, &[]).unwrap();
            machine.tip.as_mut().unwrap().without = TipWithout { waiting, ..TipWithout::default() };
            let plan = TipPlan::of_task(&machine).unwrap().unwrap();
            let references: [f64; AXES] = std::array::from_fn(|axis| plan.points(axis)[0].1);
            // The bucket's cylinder moves the teeth by more than its own way.
            let mut positions = references;
            positions[3] -= behind;
            let mut watch = TipWatch::of(&machine).unwrap();
            watch.update(Some(positions), &references, Some((&plan, 0.0)));
            watch.pace()
        };
        assert_eq!((pace(false, 0.0), pace(false, 0.01)), (1.0, 1.0));
        let slowed = [0.04, 0.1].map(|behind| pace(false, behind));
        assert!(slowed[0] < 0.9 && (slowed[1] - LEAST_PACE).abs() < 1e-12, "{slowed:?}");
        assert_eq!(pace(true, 0.1), 1.0);
    }
}
