//! The control law that an approved model drives: predictive control or a Smith predictor, as the machine file says.

use pipeline::machine::{Axis, ModelChoice};

use crate::{
    fallback::Memory,
    model::{gate::ModelAnswer, judge::Approved, shadow::Shadow},
    predictive::{Predictive, history::History},
    protection::limits::Limits,
    smith::Smith,
};

/// The law of one axis.
#[derive(Debug, Clone)]
pub enum ModelLaw {
    /// [`crate::predictive`].
    Predictive(Box<Predictive>),
    /// [`crate::smith`].
    Smith {
        /// The controller.
        controller: Box<Smith>,
        /// The fallback beside it.
        shadow: Box<Shadow>,
    },
}

impl ModelLaw {
    /// Of `axis`; `period` in s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        if let (Some(smith), Some(model)) = (Smith::of(axis, period), &axis.commissioned) {
            let shadow = Box::new(Shadow::new(axis, model, period));
            return Self::Smith { controller: Box::new(smith), shadow };
        }
        let plan = axis.control.plan.plan(axis.commissioned.as_ref(), period);
        Self::Predictive(Box::new(Predictive::new(plan, axis.soft_limits, period)))
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(axis: &Axis, period: f64) -> usize {
        let plan = axis.control.plan.plan(axis.commissioned.as_ref(), period);
        let reach = plan.horizon * plan.step;
        match axis.control.model {
            ModelChoice::None => 0,
            // The moves that the references ask for lie later by the lag.
            _ => axis.identification.structure.nk + reach + reach.max(plan.response / 3),
        }
    }

    /// Whether an axis that has left its set point comes back under the law by itself, and soon.
    pub fn comes_back(&self) -> bool {
        matches!(self, Self::Predictive(_))
    }

    /// Forgets the past: the axis begins to follow, from rest.
    pub fn begin(&mut self) {
        if let Self::Smith { controller, shadow } = self {
            controller.reset();
            shadow.stop();
        }
    }

    /// Forgets what it knows from one approved model to the next: there has been no model, or no closed loop.
    pub fn interrupt(&mut self) {
        if let Self::Predictive(controller) = self {
            controller.reset();
        }
    }

    /// Takes in the position of a tick, m, `elapsed` ticks after the last one; `command` has been on the valve since.
    /// To be called at every tick with a position, whoever commands.
    pub fn observe(&mut self, elapsed: u64, position: f64, command: f64) {
        if let Self::Smith { controller, shadow } = self {
            shadow.advance(elapsed, controller.observe(elapsed, position, command));
        }
    }

    /// What it answers with `model`. To be called at every tick in closed loop, whoever commands. `goes_on`:
    /// this law made the last command, `last`.
    pub fn update(
        &mut self,
        model: &Approved<'_>,
        limits: &Limits,
        history: &History,
        references: &[f64],
        (last, goes_on): (f64, bool),
    ) -> ModelAnswer {
        let command = match self {
            Self::Predictive(controller) => controller.update(model, limits, history, references),
            Self::Smith { controller, .. } => {
                controller.limit(limits.magnitude);
                controller.update(Some(model), references, last, goes_on)
            }
        };
        command.map_or(ModelAnswer::NoCommand, ModelAnswer::Command)
    }

    /// The following error that the fallback would have in the place of this law, m, where that is known. To be called
    /// at every tick after this law has made the command `last`; `error` is the one under it, m, and `memory` what the
    /// fallback remembers.
    pub fn shadowed(
        &mut self,
        error: f64,
        references: &[f64],
        last: f64,
        memory: Memory,
        limits: &Limits,
    ) -> Option<f64> {
        match self {
            Self::Predictive(_) => None,
            Self::Smith { controller, shadow } => {
                Some(shadow.update(error, references, (last, controller.expected()), memory, limits))
            }
        }
    }

    /// The last command was not sent. What the fallback in the shadow remembers, if it ran.
    pub fn discard(&mut self) -> Option<Memory> {
        match self {
            Self::Predictive(_) => None,
            Self::Smith { controller, shadow } => {
                controller.discard();
                shadow.stop()
            }
        }
    }

    /// The position of a tick without one, m, where the law needs one.
    pub fn bridge(&mut self, model: &Approved<'_>, history: &History) -> Option<f64> {
        match self {
            Self::Predictive(controller) => controller.bridge(model, history),
            Self::Smith { .. } => None,
        }
    }

    /// Number of unsolved plans so far, and of those in a row.
    pub fn unsolved(&self) -> (u64, u64) {
        match self {
            Self::Predictive(controller) => (controller.unsolved(), controller.unsolved_in_a_row()),
            Self::Smith { .. } => (0, 0),
        }
    }
}
