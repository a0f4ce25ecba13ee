//! The fallback in the shadow of a model that controls: what its error would be now.
//!
//! ```text
//! y_s(k) = y(k) + Y_s(k-n) - Y(k-n)          e_s(k) = y_r(k) - y_s(k)          u_s(k) command of the fallback for e_s
//! ```
//!
//! y measured position m, y_r reference m; Y(k-n) and Y_s(k-n) ways in m that the commissioned model expects of the
//! commands on the valve and of u_s ([`ExpectedMotion`]). So whatever the model does not explain - a load, a dead band
//! that has grown - moves the shadow as it moves the axis, and the model answers for the difference of the commands
//! alone. When the model takes over, and after every rest, the shadow begins where the axis is: Y_s = Y, and the
//! fallback goes on from the last command.

use pipeline::machine::{Axis, Commissioned};

use super::expected::ExpectedMotion;
use crate::{
    fallback::{Fallback, Memory},
    protection::limits::Limits,
};

/// The shadow of one axis.
#[derive(Debug, Clone)]
pub struct Shadow {
    fallback: Fallback,
    /// Of the commands on the valve.
    actual: ExpectedMotion,
    /// Of u_s.
    own: ExpectedMotion,
    /// u_s, while the shadow runs.
    command: Option<f64>,
    /// Y_s - Y, m.
    ahead: f64,
}

impl Shadow {
    /// Of `axis` with the commissioned model `model`; `period` in s.
    pub fn new(axis: &Axis, model: &Commissioned, period: f64) -> Self {
        let expected = ExpectedMotion::new(model, period);
        Self {
            fallback: Fallback::new(&axis.control, Some(model), period),
            actual: expected.clone(),
            own: expected,
            command: None,
            ahead: 0.0,
        }
    }

    /// Forgets the past: the axis stands, and the spool is in the middle.
    pub fn reset(&mut self) {
        self.actual.reset();
        self.stop();
    }

    /// The shadow ends: the model does not command. What the fallback remembers, if the shadow ran.
    pub fn stop(&mut self) -> Option<Memory> {
        self.command.take().map(|_| self.fallback.memory())
    }

    /// Takes in that `command` has been on the valve for the last `elapsed` ticks. To be called at every tick with a
    /// position, whoever commands.
    pub fn observe(&mut self, elapsed: u64, command: f64) {
        let moved = self.actual.advance(elapsed, command);
        if let Some(own) = self.command {
            self.ahead += self.own.advance(elapsed, own) - moved;
        }
    }

    /// e_s, m, at a following error of `error` m under the model, with `references` in m from this tick on. `last` is
    /// on the valve, and `memory` is what the fallback remembers.
    pub fn update(&mut self, error: f64, references: &[f64], memory: Memory, last: f64, limits: &Limits) -> f64 {
        let forward = self.fallback.forward(references);
        let command = self.command.unwrap_or_else(|| {
            self.own.follow(&self.actual);
            self.ahead = 0.0;
            self.fallback.restore(memory);
            self.fallback.resume(last, error, forward);
            last
        });
        self.fallback.limit(limits.magnitude);
        self.command = Some(self.fallback.update(error - self.ahead, forward, command));
        error - self.ahead
    }
}
