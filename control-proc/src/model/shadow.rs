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
//!
//! Trap: while the axis rests, the shadow begins anew at every tick. The memory of such a shadow is not handed back,
//! else the integral of the fallback would go on through the rest.

use pipeline::machine::{Axis, Commissioned};

use super::expected::ExpectedMotion;
use crate::{
    fallback::{Fallback, Memory},
    load::Load,
    protection::limits::Limits,
};

/// The shadow of one axis.
#[derive(Debug, Clone)]
pub struct Shadow {
    fallback: Fallback,
    /// Of the commands on the valve.
    actual: ExpectedMotion,
    /// Of u_s.
    expected: ExpectedMotion,
    /// u_s, while the shadow runs.
    command: Option<f64>,
    /// The shadow has begun at this tick.
    begins: bool,
    /// Y_s - Y, m.
    ahead: f64,
}

impl Shadow {
    /// Of `axis` with the commissioned model `model`; `period` in s.
    pub fn new(axis: &Axis, model: &Commissioned, period: f64) -> Self {
        Self {
            fallback: Fallback::new(&axis.control, Some(model), period),
            actual: ExpectedMotion::new(model, period),
            expected: ExpectedMotion::new(model, period),
            command: None,
            begins: false,
            ahead: 0.0,
        }
    }

    /// The fallback uses this part of its gains.
    pub fn scale(&mut self, part: f64) {
        self.fallback.scale(part);
    }

    /// Whether the fallback learns what its feed-forward lacks from now on.
    pub fn learn(&mut self, learns: bool) {
        self.fallback.learn(learns);
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.fallback.bear(load);
        self.actual.bear(load);
        self.expected.bear(load);
    }

    /// Forgets the past: the axis stands, and the spool is in the middle.
    pub fn reset(&mut self) {
        self.actual.reset();
        self.command = None;
    }

    /// The shadow ends: the model does not command. What the fallback remembers, if the shadow has run for more than
    /// this tick.
    pub fn stop(&mut self) -> Option<Memory> {
        self.command.take().filter(|_| !self.begins).map(|_| self.fallback.memory())
    }

    /// Goes on by `elapsed` ticks, in which `last` was on the valve. To be called at every tick with a position,
    /// whoever commands.
    pub fn advance(&mut self, elapsed: u64, last: f64) {
        let moved = self.actual.advance(elapsed, last);
        if let Some(command) = self.command {
            self.ahead += self.expected.advance(elapsed, command) - moved;
        }
    }

    /// e_s, m, at a following error of `error` m under the model, with `references` in m from this tick on. `last` is
    /// on the valve, and `memory` is what the fallback remembers.
    pub fn update(&mut self, error: f64, references: &[f64], last: f64, memory: Memory, limits: &Limits) -> f64 {
        let forward = self.fallback.forward(references);
        self.begins = self.command.is_none();
        let command = self.command.unwrap_or_else(|| {
            self.expected.follow(&self.actual);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;

    const PERIOD: f64 = 0.01;

    /// What the fallback remembers after `ticks` with an error of 5 mm, in which the model commands as `commands` says.
    fn remembered(ticks: usize, commands: bool) -> Memory {
        let axis = Axis { commissioned: Some(commissioned()), ..crate::tests::machine(1).axes.remove(0) };
        let mut shadow = Shadow::new(&axis, &commissioned(), PERIOD);
        let mut fallback = Fallback::new(&axis.control, Some(&commissioned()), PERIOD);
        let limits = Limits::new(&axis.control, PERIOD);
        let references = vec![0.5; fallback.ahead() + 1];
        for _ in 0..ticks {
            shadow.update(5e-3, &references, 0.0, fallback.memory(), &limits);
            if !commands && let Some(memory) = shadow.stop() {
                fallback.restore(memory);
            }
        }
        shadow.stop().unwrap_or(fallback.memory())
    }

    #[test]
    fn the_integral_of_the_fallback_goes_on_under_the_model_and_not_while_the_axis_rests() {
        let fresh = remembered(0, true);
        assert_ne!(remembered(100, true), fresh);
        assert_eq!(remembered(100, false), fresh);
    }
}
