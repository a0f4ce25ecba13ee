//! Smith predictor: the loop of the fallback, closed where the axis will be when the command acts.
//!
//! | module | what it holds |
//! |---|---|
//! | `observer` | where the axis is, and where it will be |
//! | `curve` | the adapted curve, as a shift of the commissioned one |
//!
//! ```text
//! e_p(k) = y_r(t + L) - y_p(k)          L = t_d + tau
//! u(k)   = H(C(kp e_p + I + C^-1(u_r + s)))          I(k+1) = I(k) + ki T e_p(k)
//! ```
//!
//! y_r reference in m, y_p position in m that the commissioned model foresees for t + L (`observer`), t now, t_d dead
//! time and tau time constant in s of [`Commissioned`]; kp and ki gains in 1/m and 1/(m s), T
//! period in s, C dead-band compensation and H inverse of the
//! hysteresis of [`crate::fallback`], u_r feed-forward of [`crate::fallback::feedforward`], s shift of the command by
//! the adapted model (`curve`). Source: O. J. M. Smith, Closer control of loops with dead time, Chemical Engineering
//! Progress 53 (1957).
//!
//! With e_p in the place of the error the dead time leaves the loop as far as the model is right, so the gain may be
//! higher. What is wrong with the model counts as much as kp makes of it; hence the gain is one with which also plants
//! with other gains and dead times come to rest ([`crate::tuning`]).
//!
//! While the fallback controls, I follows what it would have to be for the commands of the fallback
//! ([`Fallback::track`]). An integral that is kept from the time before is wrong for a machine that has changed since,
//! and the axis would kick when this law takes over.
//!
//! Trap: the speed that the model does not explain is not taken off the command. On a valve with hysteresis and a
//! cylinder with friction that hunts around every set point. A speed that the model gets wrong is the business of the
//! adapted curve.
//!
//! Runs in the loop: nothing here allocates after construction.

mod curve;
mod observer;

use pipeline::machine::{Axis, Commissioned, Control, Law, SmithSettings};

use curve::AdaptedCurve;
use observer::Observer;

use crate::{
    fallback::{Fallback, Memory},
    load::Load,
    model::judge::Approved,
};

/// Who made the last command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LastBy {
    /// This law.
    Law,
    /// The fallback, while the axis follows.
    Fallback,
    /// A request or the standstill: the command says nothing about what this law would need.
    Other,
}

/// The Smith predictor of one axis.
#[derive(Debug, Clone)]
pub struct Smith {
    observer: Observer,
    curve: AdaptedCurve,
    /// kp, C, H and u_r, with the gain of this law.
    law: Fallback,
    /// What the law remembered before its last command.
    before: Memory,
}

impl Smith {
    /// Of an axis whose machine file asks for it; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        Self::new(&axis.control, axis.commissioned.as_ref()?, period)
    }

    /// By `model`, if `control` asks for it; `period` in s.
    pub fn new(control: &Control, model: &Commissioned, period: f64) -> Option<Self> {
        let Law::Smith(SmithSettings { kp, ki, observer_time }) = control.law else { return None };
        let own = Control { kp, ki, feedforward: true, pressure_damping: 0.0, ..*control };
        let law = Fallback::new(&own, Some(model), period);
        Some(Self {
            observer: Observer::new(model, observer_time, period),
            curve: AdaptedCurve::new(model, period),
            before: law.memory(),
            law,
        })
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.law.ahead()
    }

    /// Forgets the past: the axis begins to follow.
    pub fn reset(&mut self) {
        self.observer.reset();
        self.law.reset();
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.law.bear(load);
        self.observer.bear(load);
    }

    /// Changes the largest magnitude of a command.
    pub fn limit(&mut self, magnitude: f64) {
        self.law.limit(magnitude);
    }

    /// Takes in the position of a tick, m, `elapsed` ticks after the last one; `command` has been on the valve since.
    /// To be called at every tick with a position, whoever controls.
    pub fn observe(&mut self, elapsed: u64, position: f64, command: f64) {
        self.observer.update(elapsed, position, command);
    }

    /// The command for references in m, from this tick on, after the command `last`; with the curve of `adapted`, if
    /// there is one. None where there is no finite one.
    pub fn update(
        &mut self,
        adapted: Option<&Approved<'_>>,
        references: &[f64],
        (last, by): (f64, LastBy),
    ) -> Option<f64> {
        self.before = self.law.memory();
        let coming = self.law.coming(references)?;
        let error = coming.position - self.observer.predicted()?;
        let shift = adapted.map_or(0.0, |model| self.curve.shift(model, coming.speed));
        let forward = coming.command + shift;
        if by == LastBy::Fallback {
            self.law.track(last, error, forward);
            self.before = self.law.memory();
        }
        if by != LastBy::Law {
            self.law.resume(last, error, forward);
        }
        let command = self.law.update(error, forward, last);
        command.is_finite().then_some(command)
    }

    /// The last command was not sent. Trap: an integral that goes on while the axis rests sends a full command when the
    /// rest is over.
    pub fn discard(&mut self) {
        self.law.restore(self.before);
    }
}

#[cfg(test)]
mod tests;
