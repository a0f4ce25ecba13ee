//! The errors of the adaptive and of the classical model over the same samples after training.
//!
//! | tracked | coefficients |
//! |---|---|
//! | adaptive | the adaptive model as it is published, separated into b, f and g |
//! | unseparated | of the adaptive model as they are estimated: they tell what the separation costs |
//! | classical | identified offline, never changed |
//! | persistence | none: the prediction of y(k) is y(k-h), or y(k-1) one step ahead |
//!
//! y output in its unit, h horizon in samples. The order of the calls at each sample is
//!
//! ```text
//! predict -> observe | pass | interrupt -> store
//! ```
//!
//! and the compiler enforces it: [`Comparison::predict`] gives the [`Predictions`] that [`Comparison::observe`] and
//! [`Comparison::pass`] consume, and each of these gives the [`Advanced`] that [`Comparison::store`] consumes. Neither
//! can be copied, so a sample cannot be counted twice, and coefficients cannot be stored before the errors of those
//! before them were counted.

use pipeline::{hammerstein::Coefficients, message::ModelErrors, statistics::ErrorStatistics};

use super::errors::ErrorTracker;
use crate::{regression::write_out, sample::Past};

/// The errors of all models of one axis. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Comparison {
    horizon: usize,
    adaptive: ErrorTracker,
    unseparated: ErrorTracker,
    classical: ErrorTracker,
    /// The output itself.
    output: ErrorStatistics,
    persistence: ErrorStatistics,
    persistence_one_step: ErrorStatistics,
    /// The classical model, written out for the row.
    classical_theta: Vec<f64>,
    /// The adaptive model as it is published, written out for the row.
    adaptive_theta: Vec<f64>,
}

/// The one-step predictions of one sample, before its output is counted.
#[derive(Debug)]
#[must_use = "the trackers have to observe or to pass the sample"]
pub struct Predictions {
    adaptive: f64,
    unseparated: f64,
    classical: f64,
}

impl Predictions {
    /// The prediction by the adaptive model.
    pub fn adaptive(&self) -> f64 {
        self.adaptive
    }

    /// The prediction by the classical model.
    pub fn classical(&self) -> f64 {
        self.classical
    }
}

/// The trackers have come to a sample whose coefficients are not stored yet.
#[derive(Debug)]
pub struct Advanced(());

impl Comparison {
    /// For models that are written out for the row of `past`, and a horizon in samples.
    pub fn new(past: &Past, horizon: usize) -> Self {
        let tracker = ErrorTracker::new(past.row(), horizon);
        let n = past.row().values().len();
        Self {
            horizon,
            adaptive: tracker.clone(),
            unseparated: tracker.clone(),
            classical: tracker,
            output: ErrorStatistics::default(),
            persistence: ErrorStatistics::default(),
            persistence_one_step: ErrorStatistics::default(),
            classical_theta: vec![0.0; n],
            adaptive_theta: vec![0.0; n],
        }
    }

    /// Begins at the end of training, with the classical model as it is published.
    pub fn start(&mut self, classical: &Coefficients, past: &Past) -> Advanced {
        write_out(classical, &past.row().structure(), &mut self.classical_theta);
        Advanced(())
    }

    /// Predicts y(k) from the row of sample k.
    pub fn predict(&self, past: &Past) -> Predictions {
        Predictions {
            adaptive: self.adaptive.predict(past.row()),
            unseparated: self.unseparated.predict(past.row()),
            classical: self.classical.predict(past.row()),
        }
    }

    /// Counts the errors of all predictions of y(k); `past` does not contain y(k) yet.
    pub fn observe(&mut self, predicted: Predictions, y: f64, past: &Past) -> Advanced {
        let (row, outputs) = (past.row(), past.outputs());
        self.adaptive.observe(y, predicted.adaptive, row, outputs);
        self.unseparated.observe(y, predicted.unseparated, row, outputs);
        if self.classical.observe(y, predicted.classical, row, outputs) {
            self.persistence.push(y - outputs.latest(self.horizon)[0]);
        }
        self.persistence_one_step.push(y - outputs.latest(1)[0]);
        self.output.push(y);
        Advanced(())
    }

    /// Carries the predictions past a sample whose output is not used; `past` does not contain y(k) yet.
    pub fn pass(&mut self, _not_compared: Predictions, past: &Past) -> Advanced {
        for tracker in [&mut self.adaptive, &mut self.classical, &mut self.unseparated] {
            tracker.pass(past.row(), past.outputs());
        }
        Advanced(())
    }

    /// Discards all predictions on their way, after a gap in the samples.
    pub fn interrupt(&mut self) -> Advanced {
        for tracker in [&mut self.adaptive, &mut self.classical, &mut self.unseparated] {
            tracker.interrupt();
        }
        Advanced(())
    }

    /// Takes in the `adaptive` model that is published after sample k, and `theta`, its coefficients before their
    /// separation, written out for the row; `past` contains y(k). The predictions of y(k+h) start here, those of the
    /// adaptive model from an `increment` y(k) - y(k-1) that is smoother than the measured one, if there is one.
    pub fn store(&mut self, _: Advanced, adaptive: &Coefficients, theta: &[f64], increment: Option<f64>, past: &Past) {
        write_out(adaptive, &past.row().structure(), &mut self.adaptive_theta);
        self.adaptive.store(&self.adaptive_theta, increment, past.outputs());
        self.unseparated.store(theta, increment, past.outputs());
        self.classical.store(&self.classical_theta, None, past.outputs());
    }

    /// Errors of the adaptive model as it is published.
    pub fn adaptive(&self) -> &ModelErrors {
        self.adaptive.errors()
    }

    /// Errors of the adaptive model before its separation.
    pub fn unseparated(&self) -> &ModelErrors {
        self.unseparated.errors()
    }

    /// Errors of the classical model.
    pub fn classical(&self) -> &ModelErrors {
        self.classical.errors()
    }

    /// The output itself, over the samples of the one-step errors.
    pub fn output(&self) -> &ErrorStatistics {
        &self.output
    }

    /// y(k) - y(k-1), over the samples of the one-step errors.
    pub fn persistence_one_step(&self) -> &ErrorStatistics {
        &self.persistence_one_step
    }

    /// y(k) - y(k-h), over the samples of the h-step errors.
    pub fn persistence(&self) -> &ErrorStatistics {
        &self.persistence
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::{hammerstein::Structure, machine::Machine};

    const HORIZON: usize = 3;
    const STRUCTURE: Structure = Structure { na: 1, nb: 0, nk: 1, order: 1, ..Structure::PAPER };

    /// y(k) = 0.5 y(k-1) + u(k-1).
    fn exact() -> Coefficients {
        let mut model = Coefficients::zero(STRUCTURE);
        (model.a[0], model.b[0], model.f[0], model.g[0]) = (-0.5, 1.0, 1.0, 1.0);
        model
    }

    struct Run {
        past: Past,
        comparison: Comparison,
        y: f64,
    }

    impl Run {
        /// The exact model is the classical one, and `adaptive` the adaptive one.
        fn new(adaptive: &Coefficients) -> Self {
            let mut settings = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
            (settings.structure, settings.horizon) = (STRUCTURE, HORIZON);
            let mut past = Past::new(&settings, STRUCTURE);
            past.push_output(1.0);
            let mut comparison = Comparison::new(&past, HORIZON);
            let start = comparison.start(&exact(), &past);
            let mut run = Self { past, comparison, y: 1.0 };
            run.store(start, adaptive);
            run
        }

        fn store(&mut self, stand: Advanced, adaptive: &Coefficients) {
            let mut theta = vec![0.0; STRUCTURE.full_len()];
            write_out(adaptive, &STRUCTURE, &mut theta);
            self.comparison.store(stand, adaptive, &theta, None, &self.past);
        }

        /// One sample, observed or passed.
        fn step(&mut self, u: f64, adaptive: &Coefficients, observed: bool) {
            self.past.push_command(u);
            self.y = 0.5 * self.y + u;
            self.past.fill_row();
            let predicted = self.comparison.predict(&self.past);
            let stand = if observed {
                self.comparison.observe(predicted, self.y, &self.past)
            } else {
                self.comparison.pass(predicted, &self.past)
            };
            self.past.push_output(self.y);
            self.store(stand, adaptive);
        }
    }

    #[test]
    fn an_exact_model_has_no_error_and_a_wrong_one_the_error_of_its_coefficients() {
        let wrong = Coefficients { b: exact().b.map(|b| 1.5 * b), ..exact() };
        let mut run = Run::new(&wrong);
        (0..20).for_each(|_| run.step(0.2, &wrong, true));
        let compared = &run.comparison;
        assert_eq!((compared.classical().one_step.count, compared.output().count), (20, 20));
        assert!(compared.classical().free_run.max < 1e-15 && compared.classical().h_step.max < 1e-15);
        // 0.5 u at every sample, and 0.5 u (1 + 0.5 + 0.25) over three.
        assert!((compared.adaptive().one_step.mean + 0.1).abs() < 1e-12);
        assert!((compared.unseparated().h_step.mean + 0.175).abs() < 1e-12);
        // The first prediction over the horizon ends HORIZON samples after it was launched.
        assert_eq!((compared.classical().h_step.count, compared.persistence().count), (18, 18));
        // y(k) - y(k-1) = -0.6 0.5^k from y(0) = 1 towards 0.4.
        let still = compared.persistence_one_step();
        assert!(still.count == 20 && (still.max - 0.3).abs() < 1e-12 && (still.mean + 0.03).abs() < 1e-6);
    }

    #[test]
    fn a_sample_that_is_passed_is_not_counted_and_the_predictions_go_on() {
        let mut run = Run::new(&exact());
        (0..10).for_each(|k| run.step(0.2 - 0.01 * f64::from(k), &exact(), k != 5));
        let compared = &run.comparison;
        assert_eq!((compared.classical().one_step.count, compared.classical().h_step.count), (9, 7));
        assert!(compared.classical().h_step.max < 1e-15 && compared.classical().free_run.max < 1e-15);
    }

    #[test]
    fn after_an_interruption_the_horizon_has_to_pass_once_more() {
        let mut run = Run::new(&exact());
        (0..10).for_each(|_| run.step(0.2, &exact(), true));
        let before = run.comparison.classical().h_step.count;
        let stand = run.comparison.interrupt();
        run.store(stand, &exact());
        (0..HORIZON - 1).for_each(|_| run.step(0.2, &exact(), true));
        assert_eq!(run.comparison.classical().h_step.count, before);
        run.step(0.2, &exact(), true);
        assert_eq!(run.comparison.classical().h_step.count, before + 1);
    }
}
