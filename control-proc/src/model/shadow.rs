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
    /// Of u_s.
    expected: ExpectedMotion,
    /// u_s, while the shadow runs.
    command: Option<f64>,
    /// Y_s - Y, m.
    ahead: f64,
}

impl Shadow {
    /// Of `axis` with the commissioned model `model`; `period` in s.
    pub fn new(axis: &Axis, model: &Commissioned, period: f64) -> Self {
        Self {
            fallback: Fallback::new(&axis.control, Some(model), period),
            expected: ExpectedMotion::new(model, period),
            command: None,
            ahead: 0.0,
        }
    }

    /// The shadow ends: the model does not command. What the fallback remembers, if the shadow ran.
    pub fn stop(&mut self) -> Option<Memory> {
        self.command.take().map(|_| self.fallback.memory())
    }

    /// Goes on by `elapsed` ticks, in which the model expected a way of `moved` m of the commands on the valve.
    pub fn advance(&mut self, elapsed: u64, moved: f64) {
        if let Some(command) = self.command {
            self.ahead += self.expected.advance(elapsed, command) - moved;
        }
    }

    /// e_s, m, at a following error of `error` m under the model, with `references` in m from this tick on. `last` is
    /// on the valve, `actual` what the model expects of the commands there, and `memory` what the fallback remembers.
    pub fn update(
        &mut self,
        error: f64,
        references: &[f64],
        (last, actual): (f64, &ExpectedMotion),
        memory: Memory,
        limits: &Limits,
    ) -> f64 {
        let forward = self.fallback.forward(references);
        let command = self.command.unwrap_or_else(|| {
            self.expected.follow(actual);
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
