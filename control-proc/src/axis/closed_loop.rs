//! One tick of an axis in closed loop: from its reference to its command.
//!
//! ```text
//! reference -> limits -> following error -> plan of the predictive controller -> model gate -> commander -> end stops
//! ```

use pipeline::message::{ControlMode, control_flag};

use super::{
    AxisController, AxisInput,
    decision::{Commander, Decision},
    feedback::UNUSABLE_LIMIT,
};
use crate::{
    model::{
        age::Age,
        gate::{Admission, ModelAnswer},
    },
    protection::{
        following_error::Deviation,
        hunting::{Caution, Pace},
        limits::Limits,
    },
    reference::ReferenceStatus,
    smith::LastBy,
};

/// Plans in a row without an answer of the solver that latch the axis.
pub const UNSOLVED_LIMIT: u64 = 5;

impl AxisController {
    /// The decision of an axis in closed loop, from its position in m.
    ///
    /// # Errors
    /// The cause that latches the axis, a [`control_flag`] bit.
    pub(super) fn follow(
        &mut self,
        input: &AxisInput<'_>,
        position: f64,
        snapshot_flags: u32,
    ) -> Result<Decision, u32> {
        let last = self.decision;
        let status = self.refer(input, position);
        let reference = self.references.positions()[0];
        let deviation =
            Deviation { elapsed: input.elapsed, error: reference - position, speed: self.references.speed() };

        let age = self.gate.age(input.sequence);
        let is_slow = age == Age::Expired;
        let limits = self.protection.limits_after(last.command, is_slow);
        let at_limit = limits.is_reached_by(last.command);
        // An axis that has been slowed down cannot always follow its reference, and is to go on.
        if self.protection.stops(&deviation, is_slow && at_limit) {
            return Err(control_flag::FOLLOWING);
        }

        let pace = Pace { elapsed: input.elapsed, axis: self.feedback.speed(), reference: deviation.speed };
        if self.protection.hunting().update(&pace, last.by == ControlMode::Model) {
            return Err(control_flag::SWING);
        }

        let answer = self.plan(input.sequence, &limits, &last)?;
        let admission = self.admit(answer, &deviation, &limits, &last);

        let comes_back = admission.command.is_some() && self.law.comes_back();
        let positions = self.references.positions();
        let stand = self.standstill.update(input.elapsed, deviation.error, positions, last.command, comes_back);
        let commander = Commander::choose(admission.command, stand);
        if !matches!(commander, Commander::Model(_)) {
            self.law.discard().into_iter().for_each(|memory| self.fallback.restore(memory));
        }
        let (wanted, by) = match commander {
            Commander::Rest(by) => (0.0, by),
            Commander::Creep(command, by) => (limits.apply(command, last.command), by),
            Commander::Model(command) => (command, ControlMode::Model),
            Commander::Fallback(p) => (self.fall_back(&last, deviation.error + p, &limits), ControlMode::Fallback),
        };
        let command = self.protection.end_stops().apply(wanted, position, self.feedback.speed(), true);

        if status.counts {
            self.tracking.push(deviation.error, by);
        }
        self.tracking.slowed = self.tracking.slowed.saturating_add(u32::from(status.is_slowed));
        let mut flags = snapshot_flags | age_flags(age) | admission.flags | reference_flags(&status);
        if command != wanted {
            flags |= control_flag::SOFT_LIMIT;
        }
        Ok(Decision { command, by, reference, error: deviation.error, flags })
    }

    /// Works out the references from this tick on.
    fn refer(&mut self, input: &AxisInput<'_>, position: f64) -> ReferenceStatus {
        let mut ticks = (input.sequence, input.elapsed);
        // The axis has waited at neutral; where its reference has gone on, it does so from here.
        if input.elapsed > UNUSABLE_LIMIT {
            self.references.go_on(input.path[0], position, input.generator);
            ticks.1 = 1;
        }
        let status = self.references.update(ticks, position, input.path, input.generator, input.reference);
        self.fallback.learn(!status.is_approach);
        self.law.learn(!status.is_approach);
        status
    }

    /// What the controller by a model answers with the usable model. It plans during probation too, so that it has an
    /// estimate of the noise when it takes over.
    fn plan(&mut self, sequence: u64, limits: &Limits, last: &Decision) -> Result<ModelAnswer, u32> {
        let by = match last.by {
            ControlMode::Model => LastBy::Law,
            ControlMode::Fallback if !self.standstill.is_held() => LastBy::Fallback,
            _ => LastBy::Other,
        };
        let references = self.references.positions();
        let (Some(model), Some(history)) = (self.gate.model(sequence), self.feedback.history()) else {
            self.law.wait(references, (last.command, by));
            return Ok(ModelAnswer::NoModel);
        };
        let answer = self.law.update(&model, limits, history, references, (last.command, by));
        if self.law.unsolved().1 >= UNSOLVED_LIMIT {
            return Err(control_flag::SOLVER);
        }
        Ok(answer)
    }

    /// Whether the answer of the controller by the model may go out.
    fn admit(&mut self, answer: ModelAnswer, deviation: &Deviation, limits: &Limits, last: &Decision) -> Admission {
        let shadow = self.shadowed(deviation.error, last, limits);
        let at_limit = limits.is_reached_by(last.command);
        let admission = self.gate.admit(answer, deviation, shadow, last.by == ControlMode::Model, at_limit);
        match self.protection.hunting().caution() {
            Caution::Free => admission,
            _ => Admission { command: None, flags: admission.flags | control_flag::CAUTION },
        }
    }

    /// The following error that the fallback would have now, m, while the model commands.
    fn shadowed(&mut self, error: f64, last: &Decision, limits: &Limits) -> Option<f64> {
        let (references, memory) = (self.references.positions(), self.fallback.memory());
        if last.by == ControlMode::Model {
            self.law.shadowed(error, references, last.command, memory, limits)
        } else {
            None
        }
    }

    /// The command of the fallback at an error of `error` m.
    fn fall_back(&mut self, last: &Decision, error: f64, limits: &Limits) -> f64 {
        self.fallback.scale(self.operation.gain * self.protection.hunting().caution().gain());
        let forward = self.fallback.forward(self.references.positions());
        if last.is_handed_over() {
            self.fallback.resume(last.command, error, forward);
        }
        self.fallback.limit(limits.magnitude);
        self.fallback.update(error, forward, last.command)
    }

    /// Puts the position that the model expects in the place of the missing one, so that the next plan has it.
    pub(super) fn bridge(&mut self, sequence: u64) {
        let (Some(model), Some(history)) = (self.gate.model(sequence), self.feedback.history()) else { return };
        if let Some(expected) = self.law.bridge(&model, history) {
            self.feedback.bridge(expected);
        }
    }
}

/// What became of the reference, as [`control_flag`] bits.
fn reference_flags(status: &ReferenceStatus) -> u32 {
    let refused = if status.is_refused { control_flag::REFERENCE } else { 0 };
    refused | if status.is_slowed { control_flag::SLOWED } else { 0 }
}

/// What the age of the last approved model means, as [`control_flag`] bits.
fn age_flags(age: Age) -> u32 {
    match age {
        Age::None | Age::Fresh => 0,
        Age::Stale => control_flag::MODEL_STALE,
        Age::Expired => control_flag::MODEL_STALE | control_flag::HALF_SPEED,
    }
}
