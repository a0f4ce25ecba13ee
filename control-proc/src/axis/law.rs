//! The control law that an approved model drives: predictive control or a Smith predictor, as the machine file says;
//! and beside it the fallback in its shadow.

use pipeline::machine::{Axis, ModelChoice};

use crate::{
    fallback::Memory,
    load::Load,
    model::{gate::ModelAnswer, judge::Approved, shadow::Shadow},
    predictive::{Predictive, history::History},
    protection::limits::Limits,
    smith::{LastBy, Smith},
};

/// What commands.
#[derive(Debug, Clone)]
enum Law {
    /// [`crate::predictive`].
    Predictive(Box<Predictive>),
    /// [`crate::smith`].
    Smith(Box<Smith>),
}

/// The law of one axis.
#[derive(Debug, Clone)]
pub struct ModelLaw {
    law: Law,
    /// The fallback beside it, on a commissioned axis.
    shadow: Option<Box<Shadow>>,
}

impl ModelLaw {
    /// Of `axis`; `period` in s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        let commissioned = axis.commissioned.as_ref();
        let law = Smith::of(axis, period).map(|smith| Law::Smith(Box::new(smith))).unwrap_or_else(|| {
            let plan = axis.control.plan.plan(commissioned, period);
            Law::Predictive(Box::new(Predictive::new(plan, axis.soft_limits, period)))
        });
        Self { law, shadow: commissioned.map(|model| Box::new(Shadow::new(axis, model, period))) }
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
        matches!(self.law, Law::Predictive(_))
    }

    /// Forgets the past: the axis begins to follow, from rest.
    pub fn begin(&mut self) {
        if let Law::Smith(smith) = &mut self.law {
            smith.reset();
        }
        if let Some(shadow) = &mut self.shadow {
            shadow.reset();
        }
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        if let Law::Smith(smith) = &mut self.law {
            smith.bear(load);
        }
        if let Some(shadow) = &mut self.shadow {
            shadow.bear(load);
        }
    }

    /// The fallback in the shadow uses this part of its gains.
    pub fn scale(&mut self, part: f64) {
        if let Some(shadow) = &mut self.shadow {
            shadow.scale(part);
        }
    }

    /// Whether the fallback in the shadow learns what its feed-forward lacks from now on.
    pub fn learn(&mut self, learns: bool) {
        if let Some(shadow) = &mut self.shadow {
            shadow.learn(learns);
        }
    }

    /// Forgets what it knows from one approved model to the next: there has been no model, or no closed loop.
    pub fn interrupt(&mut self) {
        if let Law::Predictive(predictive) = &mut self.law {
            predictive.reset();
        }
    }

    /// There is no model at this tick: it follows what the fallback does with these references, in m. To be called at
    /// every tick in closed loop without a model; `last` is the last command, and who made it.
    pub fn wait(&mut self, references: &[f64], last: (f64, LastBy)) {
        self.interrupt();
        if let Law::Smith(smith) = &mut self.law {
            smith.update(None, references, last);
        }
    }

    /// Takes in the position of a tick, m, `elapsed` ticks after the last one; `command` has been on the valve since.
    /// To be called at every tick with a position, whoever commands.
    pub fn observe(&mut self, elapsed: u64, position: f64, command: f64) {
        if let Law::Smith(smith) = &mut self.law {
            smith.observe(elapsed, position, command);
        }
        if let Some(shadow) = &mut self.shadow {
            shadow.advance(elapsed, command);
        }
    }

    /// What it answers with `model`. To be called at every tick in closed loop, whoever commands. `last` is
    /// the last command, and who made it.
    pub fn update(
        &mut self,
        model: &Approved<'_>,
        limits: &Limits,
        history: &History,
        references: &[f64],
        last: (f64, LastBy),
    ) -> ModelAnswer {
        let command = match &mut self.law {
            Law::Predictive(predictive) => predictive.update(model, limits, history, references),
            Law::Smith(smith) => {
                smith.limit(limits.magnitude);
                smith.update(Some(model), references, last)
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
        self.shadow.as_mut().map(|shadow| shadow.update(error, references, last, memory, limits))
    }

    /// The last command was not sent. What the fallback in the shadow remembers, if it ran.
    pub fn discard(&mut self) -> Option<Memory> {
        if let Law::Smith(smith) = &mut self.law {
            smith.discard();
        }
        self.shadow.as_mut().and_then(|shadow| shadow.stop())
    }

    /// The position of a tick without one, m, where the law needs one.
    pub fn bridge(&mut self, model: &Approved<'_>, history: &History) -> Option<f64> {
        match &mut self.law {
            Law::Predictive(predictive) => predictive.bridge(model, history),
            Law::Smith(_) => None,
        }
    }

    /// Number of unsolved plans so far, and of those in a row.
    pub fn unsolved(&self) -> (u64, u64) {
        match &self.law {
            Law::Predictive(predictive) => (predictive.unsolved(), predictive.unsolved_in_a_row()),
            Law::Smith(_) => (0, 0),
        }
    }
}
