//! Identification of one axis, sample by sample: first offline, then recursive, the classical model beside it.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Commissioned, Estimator, Form, Identification, IdentifiedOutput},
    message::{AxisSnapshot, model_fault},
};

use crate::{
    adaptation::Bank,
    adaptation::GreyBox,
    adaptation::Single,
    offline::{Batch, Offline},
    quality::ErrorTracker,
    quality::Health,
    regression::write_out,
    sample::RegressorRow,
    sample::RestDetection,
    sample::SlidingBuffer,
    sample::{OutlierGate, Verdict},
};

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
    command: f64,
    outputs: SlidingBuffer,
    /// Features of the commands.
    commands: SlidingBuffer,
    row: RegressorRow,
    gate: OutlierGate,
    /// One-step predictions of the sample by the adaptive and the classical model.
    one_step: [f64; 2],
    /// All predictions of the sample, in the order of their size.
    predictions: [f64; 3],
    /// Samples of the training until the row has measurements only.
    tainted: usize,
    rest: RestDetection,
    batch: Batch,
    adaptation: Adaptation,
    /// The classical model, written out for the row.
    classical: Vec<f64>,
    /// A model that is being written out for the row.
    written: Vec<f64>,
    adaptive_tracker: ErrorTracker,
    classical_tracker: ErrorTracker,
    separated_tracker: ErrorTracker,
    health: Health,
    state: AxisSnapshot,
    offline: Option<Offline>,
    innovations: Option<[f64; 2]>,
    lasting_faults: u32,
}

/// What learns online.
#[derive(Debug, Clone)]
enum Adaptation {
    Single(Box<Single>),
    Bank(Box<Bank>),
    GreyBox(Box<GreyBox>),
}

impl Identifier {
    /// Takes all memory that it will ever use.
    pub fn new(settings: &Identification) -> Self {
        Self::commissioned(settings, None)
    }

    /// The same with what commissioning has found of the axis.
    ///
    /// # Panics
    /// With [`Estimator::GreyBox`] and nothing found, which the machine file refuses.
    pub fn commissioned(settings: &Identification, commissioned: Option<&Commissioned>) -> Self {
        let structure = settings.structure;
        let h = settings.horizon;
        let (row, adaptation) = match settings.estimator {
            Estimator::Auto => (Bank::row_structure(structure), Adaptation::Bank(Box::new(Bank::new(structure, h)))),
            Estimator::GreyBox => {
                let commissioned = commissioned.expect("a grey box is of a commissioned axis");
                let grey_box = GreyBox::new(structure, commissioned, settings.period);
                (structure.published(), Adaptation::GreyBox(Box::new(grey_box)))
            }
            _ => (structure.published(), Adaptation::Single(Box::new(Single::new(settings)))),
        };
        let tracker = ErrorTracker::new(&RegressorRow::new(row), h);
        Self {
            settings: settings.clone(),
            seen: 0,
            trained: false,
            position: None,
            command: 0.0,
            outputs: SlidingBuffer::new(row.na.max(h).max(2), 1),
            commands: SlidingBuffer::new(row.nk + row.nb, 2 * row.order),
            row: RegressorRow::new(row),
            gate: OutlierGate::default(),
            one_step: [0.0; 2],
            predictions: [0.0; 3],
            tainted: 0,
            rest: RestDetection::new(h),
            batch: Batch::new(structure, settings.split),
            adaptation,
            classical: vec![0.0; row.full_len()],
            written: vec![0.0; row.full_len()],
            adaptive_tracker: tracker.clone(),
            classical_tracker: tracker.clone(),
            separated_tracker: tracker,
            health: Health::new(h),
            state: AxisSnapshot {
                adaptive: Coefficients::zero(structure),
                classical: Coefficients::zero(structure),
                forgetting_factor: 1.0,
                horizon: h as u32,
                faults: model_fault::TRAINING,
                ..AxisSnapshot::default()
            },
            offline: None,
            innovations: None,
            lasting_faults: model_fault::TRAINING,
        }
    }

    /// Takes in sample k: y(k), or `None` when it is not to be used, and u(k-1), the command that was applied since
    /// the sample before, or `None` when it is not known (the very first sample, a gap).
    pub fn update(&mut self, output: Option<f64>, applied: Option<f64>) {
        self.seen += 1;
        self.state.since_update += 1;
        self.innovations = None;
        self.state.faults = self.lasting_faults;
        match applied.filter(|u| u.is_finite()) {
            Some(u) => self.push_command(u),
            None => {
                self.commands.clear();
                self.position = None;
                self.interrupt();
            }
        }
        match self.identified(output.filter(|y| y.is_finite())) {
            Some(y) => self.take_in(y),
            None => {
                self.skip();
                self.interrupt();
            }
        }
        if !self.trained {
            self.train_further();
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
        self.command = u;
        let input = self.settings.structure.input;
        self.commands.push_with(|slot| input.features(u, slot));
        // Held f and g have learned nothing from commands after training.
        let is_linear = matches!(self.adaptation, Adaptation::Single(_)) && self.settings.form == Form::Linear;
        if !self.trained || !is_linear {
            self.state.command_low = self.state.command_low.min(u);
            self.state.command_high = self.state.command_high.max(u);
        }
    }

    fn take_in(&mut self, y: f64) {
        let Structure { na, nb, nk, .. } = self.row.structure();
        if self.outputs.len() < na || self.commands.len() < nk + nb {
            self.skip();
            self.outputs.push(y);
            return;
        }
        self.row.fill(&self.outputs, &self.commands);
        let verdict = self.judge(y);
        match verdict {
            Verdict::Sound => {
                let resting = self.rest.update(y, self.command);
                if resting {
                    self.state.faults |= model_fault::RESTING;
                }
                if self.trained {
                    self.learn(y, resting);
                } else {
                    self.collect(y, resting);
                }
                self.outputs.push(y);
            }
            Verdict::Wild => {
                self.state.outliers += 1;
                self.state.faults |= model_fault::OUTLIER;
                self.skip();
                self.pass();
                let instead = self.predictions[1];
                self.outputs.push(instead);
                self.tainted = self.row.structure().na;
            }
            Verdict::Step => {
                self.skip();
                self.interrupt();
                self.outputs.push(y);
            }
        }
        if self.is_adapting() {
            self.settle();
        }
    }

    /// Judges y(k) by what is predicted of it, and puts the middle one of the predictions in the middle.
    fn judge(&mut self, y: f64) -> Verdict {
        let before = self.outputs.latest(1)[0];
        self.predictions = if self.trained {
            let adaptive = self.adaptive_tracker.predict(&self.row);
            let classical = self.classical_tracker.predict(&self.row);
            self.one_step = [adaptive, classical];
            self.state.innovation_ratio = (y - adaptive).abs() / self.gate.size();
            [adaptive, classical, before]
        } else {
            // Before there is a model: what stands still, and what goes on as it did.
            let earlier = self.outputs.latest(self.outputs.len().min(2))[0];
            [before, 2.0 * before - earlier, 2.0 * before - earlier]
        };
        let verdict = self.gate.judge(y, &self.predictions);
        self.predictions.sort_by(f64::total_cmp);
        verdict
    }

    fn skip(&mut self) {
        self.state.faults |= model_fault::SAMPLE_SKIPPED;
        self.state.skipped += 1;
    }

    /// After a gap in the samples.
    fn interrupt(&mut self) {
        self.outputs.clear();
        for tracker in [&mut self.adaptive_tracker, &mut self.classical_tracker, &mut self.separated_tracker] {
            tracker.interrupt();
        }
        match &mut self.adaptation {
            Adaptation::Bank(bank) => bank.interrupt(),
            Adaptation::GreyBox(grey_box) => grey_box.interrupt(),
            Adaptation::Single(_) => {}
        }
    }

    /// Goes on past a sample that is not to be used.
    fn pass(&mut self) {
        if self.trained {
            for tracker in [&mut self.adaptive_tracker, &mut self.classical_tracker, &mut self.separated_tracker] {
                tracker.pass(&self.row, &self.outputs);
            }
        }
        match &mut self.adaptation {
            Adaptation::Bank(bank) => bank.pass(&self.row),
            Adaptation::GreyBox(grey_box) => grey_box.interrupt(),
            Adaptation::Single(_) => {}
        }
    }

    /// A sample of the training.
    fn collect(&mut self, y: f64, resting: bool) {
        if self.tainted > 0 {
            // The row has a prediction in the place of a measurement.
            self.tainted -= 1;
            self.pass();
            return;
        }
        self.batch.add(y, &self.row);
        self.gate.collect(y - self.outputs.latest(1)[0]);
        let h = self.settings.horizon;
        let travel = (self.outputs.len() >= h).then(|| y - self.outputs.latest(h)[0]);
        self.rest.collect(travel, self.command);
        if let Adaptation::Bank(bank) = &mut self.adaptation {
            if bank.is_started() {
                bank.learn(y, &self.row, resting);
            }
            bank.collect(y, &self.row);
        }
        if let Adaptation::GreyBox(grey_box) = &mut self.adaptation {
            grey_box.learn(y, &self.row);
        }
    }

    /// Ends the training when it is time. The bank begins to compare its members on the last quarter of it, with what
    /// the first three quarters say.
    fn train_further(&mut self) {
        let training = self.settings.training as u64;
        let needed = self.row.structure().full_len() as u64;
        if self.seen >= training && self.batch.rows() >= needed {
            self.finish_training();
        } else if let Adaptation::Bank(bank) = &mut self.adaptation
            && !bank.is_started()
            && self.seen >= training - training / 4
            && self.batch.rows() >= 2 * needed
        {
            let offline = self.batch.solve();
            write_out(&offline.published, &self.row.structure(), &mut self.written);
            bank.start(&self.written, &offline.coefficients);
        }
    }

    /// Step 3: from here on the classical model is held and the adaptive one starts from it.
    fn finish_training(&mut self) {
        let offline = self.batch.solve();
        let row = self.row.structure();
        self.state.classical = offline.published;
        self.state.adaptive = self.state.classical;
        self.state.split_residual = offline.split_residual;
        self.offline = Some(offline);
        self.gate.trained(offline.residual_sigma);
        write_out(&self.state.classical, &row, &mut self.classical);
        match &mut self.adaptation {
            Adaptation::Single(single) => {
                single.start(&self.batch, &offline, &row);
                if self.settings.form == Form::Full {
                    self.classical.copy_from_slice(single.theta());
                }
            }
            Adaptation::Bank(bank) => bank.start(&self.classical, &offline.coefficients),
            Adaptation::GreyBox(_) => {}
        }
        self.trained = true;
        self.lasting_faults = if offline.rank_deficient { model_fault::RANK_DEFICIENT } else { 0 };
        self.state.faults = self.state.faults & !model_fault::TRAINING | self.lasting_faults;
        self.publish();
    }

    fn is_adapting(&self) -> bool {
        self.trained || matches!(&self.adaptation, Adaptation::Bank(bank) if bank.is_started())
    }

    /// Steps 5 and 6.
    fn learn(&mut self, y: f64, resting: bool) {
        let [adaptive, classical] = self.one_step;
        let separated = self.separated_tracker.predict(&self.row);
        self.adaptive_tracker.observe(y, adaptive, &self.row, &self.outputs);
        self.separated_tracker.observe(y, separated, &self.row, &self.outputs);
        if self.classical_tracker.observe(y, classical, &self.row, &self.outputs) {
            self.state.persistence.push(y - self.outputs.latest(self.settings.horizon)[0]);
        }
        self.state.output.push(y);
        self.health.excite(self.command, self.row.signs());

        self.state.innovation = y - adaptive;
        self.innovations = Some([y - adaptive, y - classical]);
        let learned = match &mut self.adaptation {
            Adaptation::Single(single) => single.learn(y, &self.row),
            Adaptation::Bank(bank) => bank.learn(y, &self.row, resting),
            Adaptation::GreyBox(grey_box) => grey_box.learn(y, &self.row),
        };
        self.state.forgetting_factor = learned.factor;
        self.state.forgetting.push(1.0 - learned.factor);
        if learned.bounded {
            self.state.faults |= model_fault::COVARIANCE_BOUND;
        }
        if !resting || matches!(self.adaptation, Adaptation::Single(_)) {
            self.state.updates += 1;
            self.state.since_update = 0;
        }
    }

    /// What is known after sample k: the model, and the predictions that start from here.
    fn settle(&mut self) {
        if let Adaptation::Bank(bank) = &mut self.adaptation {
            bank.settle(&self.outputs);
        }
        if self.trained {
            self.publish();
        }
    }

    fn publish(&mut self) {
        let row = self.row.structure();
        (self.state.adaptive, self.state.split_residual) = match &mut self.adaptation {
            Adaptation::Single(single) => single.separate(),
            Adaptation::Bank(bank) => bank.separate(),
            Adaptation::GreyBox(grey_box) => (grey_box.model(), 0.0),
        };
        if self.health.is_due() {
            self.health.examine(&self.state.adaptive, &self.state.classical);
            self.state.covariance_trace = match &self.adaptation {
                Adaptation::Single(single) => single.covariance_trace(),
                Adaptation::Bank(bank) => bank.covariance_trace(),
                Adaptation::GreyBox(grey_box) => grey_box.covariance_trace(),
            };
        }
        if !self.state.adaptive.is_finite() || !self.state.covariance_trace.is_finite() {
            self.state.faults |= model_fault::NOT_FINITE;
        }
        let theta = match &self.adaptation {
            Adaptation::Single(single) => single.theta(),
            Adaptation::Bank(bank) => bank.theta(),
            Adaptation::GreyBox(grey_box) => grey_box.theta(),
        };
        self.adaptive_tracker.store(theta, &self.outputs);
        self.classical_tracker.store(&self.classical, &self.outputs);
        write_out(&self.state.adaptive, &row, &mut self.written);
        self.separated_tracker.store(&self.written, &self.outputs);
        self.health.report(&mut self.state);
    }

    /// All there is to know after the last sample, with models of the position.
    pub fn snapshot(&self) -> AxisSnapshot {
        AxisSnapshot {
            adaptive: self.published(&self.state.adaptive),
            classical: self.published(&self.state.classical),
            adaptive_errors: *self.adaptive_tracker.errors(),
            classical_errors: *self.classical_tracker.errors(),
            separated_h_step: self.separated_tracker.errors().h_step,
            ..self.state
        }
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

    /// The bank, where there is one.
    pub fn bank(&self) -> Option<&Bank> {
        match &self.adaptation {
            Adaptation::Bank(bank) => Some(bank),
            _ => None,
        }
    }

    /// What offline identification has collected and solved.
    pub fn batch(&self) -> &Batch {
        &self.batch
    }

    /// What offline identification found, after training.
    pub fn offline(&self) -> Option<&Offline> {
        self.offline.as_ref()
    }

    /// y(k) minus its prediction by the adaptive and by the classical model; nothing for a sample of the training or
    /// one that was not used.
    pub fn innovations(&self) -> Option<[f64; 2]> {
        self.innovations
    }

    /// Prediction error and change of it that count as PB, in the unit of the output; `None` where nothing is fuzzy.
    pub fn universes(&self) -> Option<(f64, f64)> {
        match &self.adaptation {
            Adaptation::Single(single) => single.universes(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    #[test]
    fn an_input_that_never_moves_leaves_a_finite_model() {
        for (estimator, form) in
            [(Estimator::Paper, Form::Linear), (Estimator::Paper, Form::Full), (Estimator::Auto, Form::Linear)]
        {
            let mut settings = Machine::load(None, &[]).unwrap().axes[0].identification.clone();
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
