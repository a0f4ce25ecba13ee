//! One recursive estimator for one form of the model: steps 5 and 6 of the paper, with the paper's estimator or
//! another.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Form, Identification},
};

use super::Learned;
use crate::{
    estimator::RecursiveEstimator,
    offline::{Batch, Offline, Projection},
    regression::Regression,
    sample::RegressorRow,
    separation::OnlineSeparation,
};

/// Half rounds of separation at the start, from the separation of the training on.
const FIRST_ROUNDS: usize = 40;

/// The estimator of one output. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Single {
    structure: Structure,
    /// Structure of the row, without integrator.
    row_structure: Structure,
    form: Form,
    regression: Regression,
    estimator: RecursiveEstimator,
    phi: Vec<f64>,
    projection: Projection,
    /// theta as it is estimated.
    linear: Vec<f64>,
    /// theta written out for the row.
    theta: Vec<f64>,
    model: Coefficients,
    separation: OnlineSeparation,
}

impl Single {
    /// An estimator that knows nothing yet.
    pub fn new(settings: &Identification) -> Self {
        let structure = settings.structure;
        let regression = match settings.form {
            Form::Full => Regression::full(structure),
            Form::Linear => Regression::linear(structure, &Coefficients::zero(structure).nonlinearity()),
        };
        let n = regression.len();
        let published = structure.published();
        Self {
            structure,
            row_structure: published,
            form: settings.form,
            regression,
            estimator: RecursiveEstimator::new(settings.estimator, n, &settings.fuzzy),
            phi: vec![0.0; n],
            projection: Projection::new(n),
            linear: vec![0.0; n],
            theta: vec![0.0; published.full_len()],
            model: Coefficients::zero(published),
            separation: OnlineSeparation::new(published),
        }
    }

    /// Starts from offline identification.
    pub fn start(&mut self, batch: &Batch, offline: &Offline) {
        let model = &offline.coefficients;
        match self.form {
            Form::Full => {
                self.estimator.start(batch.data(), batch.held(), offline.residual_sigma);
                self.separation.start(model, batch.collected());
                self.expand();
                for _ in 0..FIRST_ROUNDS {
                    let _ = self.separation.separate(&self.theta);
                }
            }
            Form::Linear => {
                self.regression = Regression::linear(self.structure, &model.nonlinearity());
                // The rows of the batch hold increments already, so the projection takes no differences.
                let outputs = Structure { integrator: false, ..self.structure };
                let fold = Regression::linear(outputs, &model.nonlinearity());
                let (data, held) = self.projection.project(&fold, batch.collected(), &outputs);
                self.estimator.start(data, held, offline.residual_sigma);
                let (a, b) = self.linear.split_at_mut(self.structure.na);
                let (b, drift) = b.split_at_mut(self.structure.nb + 1);
                a.copy_from_slice(model.a());
                b.copy_from_slice(model.b());
                drift.fill(model.drift);
                self.estimator.set_theta(&self.linear);
                self.model = offline.published;
                self.expand();
            }
        }
    }

    fn expand(&mut self) {
        self.regression.expand(self.estimator.theta(), &self.row_structure, &mut self.theta);
    }

    /// Steps 5 and 6 with y(k) and the row of sample k.
    pub fn learn(&mut self, y: f64, row: &RegressorRow) -> Learned {
        self.regression.regressor(row.values(), &self.row_structure, &mut self.phi);
        let adapted = self.estimator.update(&self.phi, self.regression.target(y, row.values()));
        self.expand();
        Learned { factor: adapted.factor, bounded: adapted.bounded }
    }

    /// Whether commands after training change f and g.
    pub fn learns_nonlinearity(&self) -> bool {
        self.form == Form::Full
    }

    /// The coefficients as they are estimated, written out for the row.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The model as a, b, f, g; in the full form after one more half round of separation. Also the part of the
    /// products' weighted norm that the separation does not explain.
    pub fn separate(&mut self) -> (Coefficients, f64) {
        match self.form {
            Form::Full => (self.separation.separate(&self.theta), self.separation.residual()),
            Form::Linear => {
                let Structure { na, nb, drift, .. } = self.structure;
                let theta = self.estimator.theta();
                let order = self.structure.past_outputs();
                self.model.a[..order].copy_from_slice(&self.theta[..order]);
                self.model.b[..=nb].copy_from_slice(&theta[na..=na + nb]);
                self.model.drift = if drift { theta[na + nb + 1] } else { 0.0 };
                (self.model, 0.0)
            }
        }
    }

    /// Trace of the covariance.
    pub fn covariance_trace(&self) -> f64 {
        self.estimator.recursion().covariance_trace()
    }

    /// Prediction error and change of it that count as PB, in the unit of the output; `None` without fuzzy rules.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.estimator.universes()
    }
}
