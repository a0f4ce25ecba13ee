//! Identification of one axis, sample by sample: offline first, then recursive, with the classical model beside it.

mod figures;

use pipeline::{
    hammerstein::{Coefficients, Play},
    machine::{Commissioned, Identification, IdentifiedOutput},
    message::{AxisSnapshot, model_fault},
    statistics::ErrorStatistics,
};

use self::figures::{Faults, Figures, Models};
use crate::{
    adaptation::{Adaptation, Bank},
    offline::{Batch, Offline, Progress, Training},
    quality::{Advanced, Comparison, Health, Predictions},
    sample::{OutlierGate, Past, RestDetection, Verdict},
};

/// Identifies one axis. It is deterministic and allocates nothing after construction.
///
/// The first `training` samples are for offline identification. From then on the adaptive model is updated at every
/// sample, and the classical model stays as it is. The errors of both are counted from the first sample after training.
/// The grey box has an adaptive model from the first sample on.
///
/// ```
/// use ident_proc::Identifier;
/// use pipeline::machine::Machine;
///
/// let machine = Machine::four_axes(&[]).expect("the built-in machine");
/// let settings = &machine.axes[0].identification;
/// let mut identifier = Identifier::new(settings);
/// let (mut y, mut u) = (0.5, 0.0);
/// for k in 0..settings.training + 100 {
///     y += 0.001 * u;
///     identifier.update(Some(y), Some(u));
///     u = (0.1 * k as f64).sin() * (0.013 * k as f64).cos();
/// }
/// let snapshot = identifier.snapshot();
/// assert_eq!(snapshot.updates, 100);
/// assert!(snapshot.adaptive.is_finite());
/// ```
#[derive(Debug, Clone)]
pub struct Identifier {
    settings: Identification,
    /// Commands go through the play of the valve.
    play: Play,
    past: Past,
    gate: OutlierGate,
    rest: RestDetection,
    training: Training,
    adaptation: Adaptation,
    comparison: Comparison,
    health: Health,
    models: Models,
    figures: Figures,
    faults: Faults,
}

impl Identifier {
    /// An identifier for an axis that was not commissioned. Allocates all memory that it will ever use.
    pub fn new(settings: &Identification) -> Self {
        Self::commissioned(settings, None)
    }

    /// An identifier that may start from the results of commissioning. Allocates all memory that it will ever use.
    ///
    /// # Panics
    /// With the estimator `grey-box` and without `commissioned`, which the machine file refuses.
    pub fn commissioned(settings: &Identification, commissioned: Option<&Commissioned>) -> Self {
        let structure = settings.structure;
        let adaptation = Adaptation::new(settings, commissioned);
        let row = adaptation.row_structure(structure);
        let past = Past::new(settings, row);
        let mut models = Models::new(structure);
        models.adaptive = adaptation.known_model().unwrap_or(models.adaptive);
        Self {
            settings: settings.clone(),
            play: Play::new(settings.hysteresis),
            gate: OutlierGate::default(),
            rest: RestDetection::new(settings.horizon),
            training: Training::new(settings, row),
            adaptation,
            comparison: Comparison::new(&past, settings.horizon),
            health: Health::new(settings.horizon),
            models,
            figures: Figures::default(),
            faults: Faults::new(model_fault::TRAINING),
            past,
        }
    }

    /// The training counts samples with motion only: while no command has opened the valve for longer than the horizon,
    /// it waits. A running machine may stand for hours before it is used, and its rest says nothing of its motion.
    pub fn waiting_for_motion(mut self) -> Self {
        self.training.wait_for_motion(self.settings.horizon);
        self
    }

    /// Takes in sample k. `output` is the measured position, `None` when it is not to be used. `applied` is u(k-1), the
    /// command that was applied since the sample before, `None` when it is not known: at the very first sample, and
    /// after a gap.
    pub fn update(&mut self, output: Option<f64>, applied: Option<f64>) {
        self.figures.begin_sample();
        self.faults.begin_sample();
        match applied.filter(|u| u.is_finite()) {
            Some(u) => {
                let acting = self.play.acting(u);
                self.take_command(acting);
            }
            None => {
                self.past.interrupt_commands();
                self.interrupt();
            }
        }
        let opens = applied.is_some_and(|u| u.is_finite() && self.settings.structure.input.opening(u) != 0.0);
        self.training.count_sample(opens);
        match self.past.identified(output.filter(|y| y.is_finite())) {
            Some(y) => self.take_output(y),
            None => {
                self.skip();
                self.interrupt();
            }
        }
        if !self.training.is_over() {
            self.train();
        }
    }

    fn take_command(&mut self, u: f64) {
        self.past.push_command(u);
        if !self.training.is_over() || self.adaptation.learns_nonlinearity() {
            self.figures.take_command(u);
        }
    }

    fn take_output(&mut self, y: f64) {
        if !self.past.is_complete() {
            self.refill(y);
            return;
        }
        self.past.fill_row();
        let predicted = self.predict(y);
        let mut predictions = self.predictions(predicted.as_ref());
        let advanced = match self.gate.judge(y, &predictions, self.training.is_driven()) {
            Verdict::Sound => {
                let advanced = self.use_sample(y, predicted);
                self.past.push_output(y);
                advanced
            }
            Verdict::Outlier => {
                let advanced = self.pass(predicted);
                predictions.sort_by(f64::total_cmp);
                self.past.push_output(predictions[1]);
                advanced
            }
            Verdict::Step => {
                self.skip();
                let advanced = self.interrupt();
                self.past.push_output(y);
                advanced
            }
        };
        self.adaptation.settle(self.past.outputs());
        if let Some(advanced) = advanced {
            self.publish(advanced);
        }
    }

    /// A sample before there are enough outputs and commands for a regressor row.
    fn refill(&mut self, y: f64) {
        self.skip();
        let before = self.past.output_before(1);
        if before.is_some_and(|before| self.gate.judge_refill(y, before) == Verdict::Step) {
            self.past.interrupt_outputs();
        }
        self.past.push_output(y);
    }

    /// One-step predictions of y(k) by the models, after training.
    fn predict(&mut self, y: f64) -> Option<Predictions> {
        let predicted = self.training.is_over().then(|| self.comparison.predict(&self.past))?;
        self.figures.innovation_ratio = (y - predicted.adaptive()).abs() / self.gate.size();
        Some(predicted)
    }

    /// What the outlier gate compares y(k) with: the two models and persistence. Before there is a model, an axis that
    /// stands still and one that goes on as it moved.
    fn predictions(&self, predicted: Option<&Predictions>) -> [f64; 3] {
        let before = self.past.outputs().latest(1)[0];
        if let Some(predicted) = predicted {
            [predicted.adaptive(), predicted.classical(), before]
        } else {
            let earlier = self.past.output_before(2).unwrap_or(before);
            [before, 2.0 * before - earlier, 2.0 * before - earlier]
        }
    }

    /// A sound sample: it is learned from, or collected for the training.
    fn use_sample(&mut self, y: f64, predicted: Option<Predictions>) -> Option<Advanced> {
        let resting = self.rest.update(y, self.past.command());
        if resting {
            self.faults.raise(model_fault::RESTING);
        }
        if let Some(predicted) = predicted {
            return Some(self.learn(y, predicted, resting));
        }
        self.collect(y, resting);
        None
    }

    /// A training sample.
    fn collect(&mut self, y: f64, resting: bool) {
        if self.training.is_waiting() {
            self.adaptation.wait(y, self.past.row());
            return;
        }
        if !self.training.collect(y, self.past.row()) {
            self.adaptation.pass(self.past.row());
            return;
        }
        if self.gate.collect(y - self.past.outputs().latest(1)[0], self.training.is_driven()) {
            self.restart();
            return;
        }
        let travel = self.past.output_before(self.settings.horizon).map(|before| y - before);
        self.rest.collect(travel, self.past.command());
        self.adaptation.collect(y, self.past.row(), resting);
    }

    /// Begins the training anew after an outlier that was not recognised at its time. Which sample it was is not known,
    /// so no row so far is used; it counts as one outlier.
    fn restart(&mut self) {
        self.figures.outliers += 1;
        self.figures.skipped += self.training.restart();
        self.faults.raise(model_fault::OUTLIER | model_fault::SAMPLE_SKIPPED);
        self.rest.restart();
        self.adaptation.restart();
        self.interrupt();
    }

    /// A sample after training: errors and health, then steps 5 and 6 of the paper.
    fn learn(&mut self, y: f64, predicted: Predictions, resting: bool) -> Advanced {
        self.figures.innovate(y - predicted.adaptive(), y - predicted.classical());
        let advanced = self.comparison.observe(predicted, y, &self.past);
        self.health.excite(self.past.command(), self.past.row().signs());
        let learned = self.adaptation.learn(y, self.past.row(), resting);
        self.figures.forget(learned.factor);
        if learned.bounded {
            self.faults.raise(model_fault::COVARIANCE_BOUND);
        }
        if !resting || self.adaptation.updates_at_rest() {
            self.figures.count_update();
        }
        advanced
    }

    /// An outlier: neither learned from nor counted. Everything goes on without its output.
    fn pass(&mut self, predicted: Option<Predictions>) -> Option<Advanced> {
        self.figures.outliers += 1;
        self.faults.raise(model_fault::OUTLIER);
        self.skip();
        self.training.contaminate(self.past.row().structure().na);
        self.adaptation.pass(self.past.row());
        predicted.map(|predicted| self.comparison.pass(predicted, &self.past))
    }

    /// Counts a sample that is not used.
    fn skip(&mut self) {
        self.faults.raise(model_fault::SAMPLE_SKIPPED);
        self.figures.skipped += 1;
    }

    /// A gap in the samples: outputs before it are not combined with those after it.
    fn interrupt(&mut self) -> Option<Advanced> {
        self.past.interrupt_outputs();
        self.adaptation.interrupt();
        let advanced = self.comparison.interrupt();
        self.training.is_over().then_some(advanced)
    }

    /// Ends the training when it is time. A bank gets a first model before, on which to compare its members.
    fn train(&mut self) {
        match self.training.progress() {
            Progress::Complete => self.finish_training(),
            Progress::LastQuarter if self.adaptation.awaits_first_model() => {
                let offline = self.training.solve();
                self.adaptation.start(self.training.batch(), &offline, self.rest.travel());
            }
            Progress::LastQuarter | Progress::Collecting => {
                self.models.adaptive = self.adaptation.known_model().unwrap_or(self.models.adaptive);
            }
        }
    }

    /// Step 3 of the paper: from here on the classical model is held, and the adaptive one starts from it.
    fn finish_training(&mut self) {
        let offline = self.training.finish();
        self.models.classical = offline.published;
        self.gate.trained(offline.residual_sigma);
        self.adaptation.start(self.training.batch(), &offline, self.rest.travel());
        let advanced = self.comparison.start(&offline.published, &self.past);
        self.faults.replace_lasting(if offline.rank_deficient { model_fault::RANK_DEFICIENT } else { 0 });
        self.publish(advanced);
    }

    /// Ends a sample after training: the model known after it, its health, and the predictions that start from it.
    fn publish(&mut self, advanced: Advanced) {
        (self.models.adaptive, self.models.separation_residual) = self.adaptation.model();
        if self.health.is_due() {
            self.health.examine(&self.models.adaptive, &self.models.classical);
            self.models.covariance_trace = self.adaptation.covariance_trace();
        }
        if !self.models.adaptive.is_finite() || !self.models.covariance_trace.is_finite() {
            self.faults.raise(model_fault::NOT_FINITE);
        }
        let (theta, increment) = (self.adaptation.theta(), self.adaptation.increment());
        self.comparison.store(advanced, &self.models.adaptive, theta, increment, &self.past);
        self.faults.raise(self.health.faults());
    }

    /// Everything that is known after the last sample, with models of the position.
    pub fn snapshot(&self) -> AxisSnapshot {
        let mut snapshot = AxisSnapshot {
            adaptive: self.published(&self.models.adaptive),
            classical: self.published(&self.models.classical),
            adaptive_errors: *self.comparison.adaptive(),
            classical_errors: *self.comparison.classical(),
            unseparated_h_step: self.comparison.unseparated().h_step,
            output: *self.comparison.output(),
            persistence: *self.comparison.persistence(),
            covariance_trace: self.models.covariance_trace,
            split_residual: self.models.separation_residual,
            horizon: self.settings.horizon as u32,
            faults: self.faults.bits(),
            ..AxisSnapshot::default()
        };
        if self.training.is_over() {
            snapshot.pole_radius = self.health.pole_radius();
            snapshot.gain_ratio = self.health.gain_ratio();
            snapshot.excitation = self.health.excitation();
        }
        if let Some(bank) = self.bank() {
            snapshot.weights.iter_mut().zip(bank.weights()).for_each(|(weight, of)| *weight = *of);
        }
        self.figures.write_to(&mut snapshot);
        snapshot
    }

    /// A model of the output as a model of the position.
    ///
    /// From A(z) v(k) = B(z) x(k-nk) + c with v(k) = (y(k) - y(k-1)) / T: A(z) (1 - z^-1) y(k) = T B(z) x(k-nk) + T c.
    fn published(&self, model: &Coefficients) -> Coefficients {
        match self.settings.output {
            IdentifiedOutput::Position => *model,
            IdentifiedOutput::Velocity => {
                let period = self.settings.period;
                let model = model.integrated();
                Coefficients { b: model.b.map(|b| period * b), drift: period * model.drift, ..model }
            }
        }
    }

    /// y(k) - y(k-1), over the samples of the one-step errors: the errors of holding still for one sample.
    pub fn persistence_one_step(&self) -> &ErrorStatistics {
        self.comparison.persistence_one_step()
    }

    /// The bank, where the estimator is `auto`.
    pub fn bank(&self) -> Option<&Bank> {
        self.adaptation.bank()
    }

    /// The rows of the training, and the problem that offline identification has solved.
    pub fn batch(&self) -> &Batch {
        self.training.batch()
    }

    /// What offline identification found, after training.
    pub fn offline(&self) -> Option<&Offline> {
        self.training.offline()
    }

    /// y(k) minus its prediction by the adaptive and by the classical model; `None` for a sample of the training or one
    /// that was not used.
    pub fn innovations(&self) -> Option<[f64; 2]> {
        self.figures.innovations
    }

    /// Prediction error and change of it that count as PB, in the unit of the output; `None` without fuzzy rules.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.adaptation.universes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::{Estimator, Form, Machine};

    #[test]
    fn a_running_machine_is_not_trained_on_the_rest_before_its_motion() {
        let mut settings = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
        (settings.estimator, settings.form) = (Estimator::Rules, Form::Linear);
        (settings.training, settings.horizon) = (200, 10);
        let run = |mut identifier: Identifier, rest: u32| {
            let (mut y, mut u) = (0.5, 0.0);
            for k in 0..rest + 1000 {
                y += 0.001 * u;
                // The encoder trembles by a count.
                identifier.update(Some(y + 1e-5 * f64::from(k % 2)), Some(u));
                let k = f64::from(k) - f64::from(rest);
                u = if k < 0.0 { 0.0 } else { 0.3 * (0.1 * k).sin() + 0.3 * (0.031 * k).cos() };
            }
            identifier.snapshot()
        };
        let waited = run(Identifier::new(&settings).waiting_for_motion(), 5000);
        assert_eq!(waited.faults & model_fault::RANK_DEFICIENT, 0);
        // The rest counts for as long as the horizon; the first command acts a sample later.
        assert_eq!(waited.updates, 1000 - 1 - 200 + 10);
        let at_once = run(Identifier::new(&settings).waiting_for_motion(), 0);
        let sigma = waited.adaptive_errors.h_step.sigma();
        assert!(sigma < 1.1 * at_once.adaptive_errors.h_step.sigma(), "{sigma}");
        // A record is trained on as it is.
        assert_ne!(run(Identifier::new(&settings), 5000).faults & model_fault::RANK_DEFICIENT, 0);
    }

    #[test]
    fn an_input_that_never_moves_leaves_a_finite_model() {
        for (estimator, form) in
            [(Estimator::Rules, Form::Linear), (Estimator::Rules, Form::Full), (Estimator::Auto, Form::Linear)]
        {
            let mut settings = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
            (settings.estimator, settings.form) = (estimator, form);
            (settings.training, settings.horizon) = (200, 10);
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
