//! Assembles the [`AxisCommand`] message from the decision of a tick and from the counters of their owners.

use pipeline::{
    message::{AxisCommand, AxisMode, ControlMode},
    statistics::ErrorStatistics,
};

use super::{AxisController, decision::Decision};

/// Statistics of the tracking error, m. They go on when the axis is armed again.
#[derive(Debug, Clone, Default)]
pub struct Tracking {
    /// Of all ticks that count.
    pub all: ErrorStatistics,
    /// Of those ticks whose command the model made.
    pub by_model: ErrorStatistics,
    /// Number of ticks with a slowed reference since the axis was armed.
    pub slowed: u32,
}

impl Tracking {
    /// Takes in the error of a tick, m.
    pub fn push(&mut self, error: f64, by: ControlMode) {
        self.all.push(error);
        if by == ControlMode::Model {
            self.by_model.push(error);
        }
    }
}

impl AxisController {
    /// The message of the present decision: the last tick's, or neutral if the axis was disarmed or latched since.
    pub fn message(&self) -> AxisCommand {
        self.assemble(&self.decision)
    }

    /// The message that makes the axis neutral without a new decision.
    pub fn neutral_message(&self) -> AxisCommand {
        self.assemble(&Decision { command: 0.0, error: 0.0, by: ControlMode::Neutral, ..self.decision })
    }

    fn assemble(&self, decision: &Decision) -> AxisCommand {
        let mode = if self.state.is_armed() { self.operation.mode } else { AxisMode::Off };
        let (taken_requests, refused_requests) = self.operation.requests.counts();
        let latches = self.state.latches();
        AxisCommand {
            command: decision.command,
            reference: decision.reference,
            error: decision.error,
            mode: decision.by as u32,
            flags: decision.flags,
            operation: mode as u32,
            refused_requests,
            taken_requests,
            rejected_snapshots: self.gate.refusals(),
            unsolved_plans: self.law.unsolved().0,
            tracking: self.tracking.all,
            model_tracking: self.tracking.by_model,
            latches: latches.count,
            latched_at: latches.tick,
            latched_by: latches.cause,
            slowed_ticks: self.tracking.slowed,
            gain: self.operation.gain,
        }
    }
}
