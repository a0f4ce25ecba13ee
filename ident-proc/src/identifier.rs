//! Identification of one axis, sample by sample: first offline, then recursive, the classical model beside it.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Forgetting, Form, Identification, IdentifiedOutput},
    message::{AxisSnapshot, model_fault},
};

use crate::{
    batch::Batch, errors::ErrorTracker, estimator::Estimator, history::History, rank::RankGuard,
    regression::Regression, split::Splitter, triangle::Triangle,
};

/// Rounds of alternating least squares per snapshot in the full form: each starts from the last separation.
const ROUNDS_PER_SNAPSHOT: usize = 1;

/// Identifies one axis. Deterministic, allocates nothing after construction.
///
/// The first `training` samples are for offline identification; from then on the adaptive model is updated at every
/// sample and the classical one is held. Both errors are counted from the first sample after training.
#[derive(Debug, Clone)]
pub struct Identifier {
    settings: Identification,
    seen: u64,
    trained: bool,
    /// y(k-1) as it was measured, if it was; of use where its difference is what is identified.
    position: Option<f64>,
    applied: History,
    outputs: History,
    batch_commands: History,
    commands: History,
    batch: Batch,
    regression: Regression,
    estimator: Estimator,
    phi: Vec<f64>,
    classical_theta: Vec<f64>,
    projected: Triangle,
    guard: RankGuard,
    information: Triangle,
    held: Vec<bool>,
    splitter: Splitter,
    adaptive_tracker: ErrorTracker,
    classical_tracker: ErrorTracker,
    state: AxisSnapshot,
    lasting_faults: u32,
}

impl Identifier {
    /// Takes all memory that it will ever use.
    pub fn new(settings: &Identification) -> Self {
        let structure = settings.structure;
        let Structure { nb, nk, .. } = structure;
        let h = settings.horizon;
        let commands = nk + nb + h;
        let width = Regression::width_of(settings.form, structure);
        let n = settings.coefficients();
        let forgetting = match settings.forgetting {
            // In the place of the bank, until it is here.
            Forgetting::Auto => Forgetting::Constant(0.995),
            one => one,
        };
        let zero = Coefficients::zero(structure);
        Self {
            settings: settings.clone(),
            seen: 0,
            trained: false,
            position: None,
            applied: History::new(commands, 1),
            outputs: History::new(structure.past_outputs() + h, 1),
            batch_commands: History::new(nk + nb, 2 * structure.order),
            commands: History::new(commands, width),
            batch: Batch::new(structure, settings.split),
            regression: Regression::full(structure),
            estimator: Estimator::new(forgetting, n, &settings.fuzzy),
            phi: vec![0.0; n],
            classical_theta: vec![0.0; n],
            projected: Triangle::new(n),
            guard: RankGuard::new(n),
            information: Triangle::new(n),
            held: vec![false; n],
            splitter: Splitter::new(structure),
            adaptive_tracker: ErrorTracker::new(structure, n, h),
            classical_tracker: ErrorTracker::new(structure, n, h),
            state: AxisSnapshot {
                adaptive: zero,
                classical: zero,
                forgetting_factor: 1.0,
                horizon: h as u32,
                faults: model_fault::TRAINING,
                ..AxisSnapshot::default()
            },
            lasting_faults: model_fault::TRAINING,
        }
    }

    /// Takes in sample k: y(k), or `None` when it is not to be used, and u(k-1), the command that was applied since
    /// the sample before, or `None` when it is not known (the very first sample, a gap).
    pub fn update(&mut self, output: Option<f64>, applied: Option<f64>) {
        self.seen += 1;
        let output = output.filter(|y| y.is_finite());
        match applied.filter(|u| u.is_finite()) {
            Some(u) => self.push_command(u),
            None => self.interrupt(),
        }
        let output = self.identified(output);
        let usable = self.outputs.len() >= self.settings.structure.past_outputs()
            && self.applied.len() >= self.settings.structure.nk + self.settings.structure.nb;
        self.state.faults = self.lasting_faults;
        match output {
            Some(y) if usable && self.trained => self.learn(y),
            Some(y) if usable => self.batch.add(y, &self.outputs, &self.batch_commands),
            _ => {
                self.state.faults |= model_fault::SAMPLE_SKIPPED;
                self.state.skipped += 1;
            }
        }
        match output {
            Some(y) => self.outputs.push(y),
            None => self.interrupt_outputs(),
        }
        let enough = self.batch.rows() >= self.settings.structure.full_len() as u64;
        if !self.trained && self.seen >= self.settings.training as u64 && enough {
            self.finish_training();
        }
    }

    /// The output that is identified, from the position; its velocity needs the position of the sample before.
    fn identified(&mut self, position: Option<f64>) -> Option<f64> {
        let before = std::mem::replace(&mut self.position, position);
        match self.settings.output {
            IdentifiedOutput::Position => position,
            IdentifiedOutput::Velocity => Some((position? - before?) / self.settings.period),
        }
    }

    fn push_command(&mut self, u: f64) {
        self.applied.push(u);
        // Held f and g have learned nothing from commands after training.
        if !self.trained || self.settings.form == Form::Full {
            self.state.command_low = self.state.command_low.min(u);
            self.state.command_high = self.state.command_high.max(u);
        }
        if self.trained {
            self.commands.push_with(|slot| self.regression.features(u, slot));
        } else {
            self.batch_commands.push_with(|slot| self.regression.features(u, slot));
        }
    }

    fn interrupt(&mut self) {
        [&mut self.applied, &mut self.batch_commands, &mut self.commands].into_iter().for_each(History::clear);
        self.position = None;
        self.interrupt_outputs();
    }

    fn interrupt_outputs(&mut self) {
        self.outputs.clear();
        self.adaptive_tracker.interrupt();
        self.classical_tracker.interrupt();
    }

    /// Step 3: from here on the classical model is held and the adaptive one starts from it.
    fn finish_training(&mut self) {
        let offline = self.batch.solve();
        let structure = self.settings.structure;
        self.state.classical = offline.coefficients;
        self.state.adaptive = offline.coefficients;
        self.state.split_residual = offline.split_residual;
        match self.settings.form {
            Form::Full => {
                self.held.copy_from_slice(self.batch.held());
                self.estimator.start(self.batch.data(), &self.held, offline.residual_sigma);
                self.classical_theta.copy_from_slice(self.batch.theta());
            }
            Form::Linear => {
                self.regression = Regression::linear(structure, offline.coefficients.nonlinearity());
                self.batch.project(&offline.coefficients, &mut self.projected);
                self.held.copy_from_slice(self.guard.dependent(&self.projected));
                self.projected.hold_into(&self.held, &mut self.information);
                self.estimator.start(&self.information, &self.held, offline.residual_sigma);
                let (a, b) = self.classical_theta.split_at_mut(structure.na);
                let (b, drift) = b.split_at_mut(structure.nb + 1);
                a.copy_from_slice(offline.coefficients.a());
                b.copy_from_slice(offline.coefficients.b());
                drift.fill(offline.coefficients.drift);
                self.estimator.set_theta(&self.classical_theta);
            }
        }
        for u in self.applied.latest(self.applied.len()) {
            self.commands.push_with(|slot| self.regression.features(*u, slot));
        }
        self.trained = true;
        self.lasting_faults = if offline.rank_deficient { model_fault::RANK_DEFICIENT } else { 0 };
        self.state.faults = self.lasting_faults;
        self.adaptive_tracker.store(self.estimator.theta());
        self.classical_tracker.store(&self.classical_theta);
    }

    /// Steps 5 and 6.
    fn learn(&mut self, y: f64) {
        let Structure { nb, nk, .. } = self.settings.structure;
        let (regression, outputs, commands) = (&self.regression, &self.outputs, &self.commands);
        self.adaptive_tracker.observe(y, self.estimator.theta(), regression, outputs, commands);
        let ahead = self.classical_tracker.observe(y, &self.classical_theta, regression, outputs, commands);
        if ahead {
            self.state.persistence.push(y - outputs.latest(self.settings.horizon)[0]);
        }
        self.state.output.push(y);

        let past = outputs.latest(self.settings.structure.past_outputs());
        let target = regression.target(y, past);
        regression.regressor(past, commands.latest(nk + nb), &mut self.phi);
        let update = self.estimator.update(&self.phi, target);
        self.state.innovation = update.innovation;
        self.state.forgetting_factor = update.factor;
        self.state.forgetting.push(1.0 - update.factor);
        self.state.updates += 1;
        if update.bounded {
            self.state.faults |= model_fault::COVARIANCE_BOUND;
        }
        self.adaptive_tracker.store(self.estimator.theta());
        self.classical_tracker.store(&self.classical_theta);
    }

    /// All there is to know after the last sample, with models of the position. In the full form this separates b,
    /// f and g again.
    pub fn snapshot(&mut self) -> AxisSnapshot {
        if self.trained {
            let Structure { na, nb, .. } = self.settings.structure;
            match self.settings.form {
                Form::Linear => {
                    let (a, b) = self.estimator.theta().split_at(na);
                    let (b, drift) = b.split_at(nb + 1);
                    self.state.adaptive.a[..na].copy_from_slice(a);
                    self.state.adaptive.b[..=nb].copy_from_slice(b);
                    self.state.adaptive.drift = drift.first().copied().unwrap_or(0.0);
                }
                Form::Full => {
                    self.estimator.factors().information(&mut self.information, &mut self.phi);
                    self.state.adaptive =
                        self.splitter.alternate(self.state.adaptive, &self.information, ROUNDS_PER_SNAPSHOT);
                    self.state.split_residual =
                        self.splitter.residual(self.estimator.theta(), &self.state.adaptive, &self.information);
                }
            }
            self.state.covariance_trace = self.estimator.factors().covariance_trace();
            if !self.state.adaptive.is_finite() || !self.estimator.factors().is_finite() {
                self.state.faults |= model_fault::NOT_FINITE;
            }
        }
        self.state.adaptive_errors = *self.adaptive_tracker.errors();
        self.state.classical_errors = *self.classical_tracker.errors();
        AxisSnapshot {
            adaptive: self.published(&self.state.adaptive),
            classical: self.published(&self.state.classical),
            ..self.state
        }
    }

    /// A model as it is published: of the position, with the integrator multiplied in.
    ///
    /// From A(z) v(k) = B(z) x(k-nk) + c with v(k) = (y(k) - y(k-1)) / T: A(z) (1 - z^-1) y(k) = T B(z) x(k-nk) + T c.
    fn published(&self, model: &Coefficients) -> Coefficients {
        let model = if self.settings.structure.integrator { model.integrated() } else { *model };
        match self.settings.output {
            IdentifiedOutput::Position => model,
            IdentifiedOutput::Velocity => {
                let period = self.settings.period;
                let model = model.integrated();
                Coefficients { b: model.b.map(|b| period * b), drift: period * model.drift, ..model }
            }
        }
    }

    /// Prediction error and change of it that count as PB, in the unit of the output; only fuzzy forgetting has them.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.estimator.universes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    #[test]
    fn an_input_that_never_moves_leaves_a_finite_model() {
        for form in [Form::Linear, Form::Full] {
            let mut settings = Machine::load(None, &[]).unwrap().axes[0].identification.clone();
            (settings.form, settings.training, settings.horizon) = (form, 200, 10);
            let mut identifier = Identifier::new(&settings);
            for k in 0..400 {
                let y = 0.5 + 0.1 * (f64::from(k) * 0.1).sin() + 0.03 * (f64::from(k) * 0.37).cos();
                identifier.update(Some(y), Some(0.0));
            }
            let snapshot = identifier.snapshot();
            assert_eq!(snapshot.updates, 200);
            assert!(snapshot.adaptive.is_finite(), "{form:?}: {:?}", snapshot.adaptive);
            assert_eq!(snapshot.faults & model_fault::NOT_FINITE, 0, "{form:?}");
            assert_ne!(snapshot.faults & model_fault::RANK_DEFICIENT, 0, "{form:?}");
            assert!(snapshot.adaptive_errors.one_step.rmse() < 0.01, "{form:?}");
        }
    }
}
