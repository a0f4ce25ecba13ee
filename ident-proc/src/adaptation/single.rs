//! One recursive estimator for one form of the model: the paper's steps 5 and 6, and each of its alternatives.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Form, Identification},
};

use crate::{
    estimator::Estimator,
    offline::Projection,
    offline::{Batch, Offline},
    regression::Regression,
    sample::RegressorRow,
    separation::OnlineSeparation,
};

/// Half rounds of separation at the start, where it begins from the offline one.
const FIRST_ROUNDS: usize = 40;

/// What one sample did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Learned {
    /// The forgetting factor.
    pub factor: f64,
    /// Whether a covariance was cut at its bound.
    pub bounded: bool,
}

/// The estimator of one output; its memory is taken at construction.
#[derive(Debug, Clone)]
pub struct Single {
    structure: Structure,
    form: Form,
    regression: Regression,
    estimator: Estimator,
    phi: Vec<f64>,
    projection: Projection,
    /// theta as it is estimated, and written out for the row.
    linear: Vec<f64>,
    theta: Vec<f64>,
    model: Coefficients,
    separation: OnlineSeparation,
}

impl Single {
    /// Nothing is known yet.
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
            form: settings.form,
            regression,
            estimator: Estimator::new(settings.estimator, n, &settings.fuzzy),
            phi: vec![0.0; n],
            projection: Projection::new(n),
            linear: vec![0.0; n],
            theta: vec![0.0; published.full_len()],
            model: Coefficients::zero(published),
            separation: OnlineSeparation::new(published),
        }
    }

    /// Starts from offline identification.
    pub fn start(&mut self, batch: &Batch, offline: &Offline, of: &Structure) {
        let model = &offline.coefficients;
        match self.form {
            Form::Full => {
                self.estimator.start(batch.data(), batch.held(), offline.residual_sigma);
                self.separation.start(model, batch.collected());
                self.expand(of);
                for _ in 0..FIRST_ROUNDS {
                    let _ = self.separation.separate(&self.theta);
                }
            }
            Form::Linear => {
                self.regression = Regression::linear(self.structure, &model.nonlinearity());
                // The batch has taken the increments already.
                let outputs = Structure { integrator: false, ..self.structure };
                let fold = Regression::linear(outputs, &model.nonlinearity());
                let (data, held) = self.projection.project(&fold, batch.data(), &outputs);
                self.estimator.start(data, held, offline.residual_sigma);
                let (a, b) = self.linear.split_at_mut(self.structure.na);
                let (b, drift) = b.split_at_mut(self.structure.nb + 1);
                a.copy_from_slice(model.a());
                b.copy_from_slice(model.b());
                drift.fill(model.drift);
                self.estimator.set_theta(&self.linear);
                self.model = offline.published;
                self.expand(of);
            }
        }
    }

    fn expand(&mut self, of: &Structure) {
        self.regression.expand(self.estimator.theta(), of, &mut self.theta);
    }

    /// Steps 5 and 6 with y(k) and the row of sample k.
    pub fn learn(&mut self, y: f64, row: &RegressorRow) -> Learned {
        self.regression.regressor(row.values(), &row.structure(), &mut self.phi);
        let adapted = self.estimator.update(&self.phi, self.regression.target(y, row.values()));
        self.expand(&row.structure());
        Learned { factor: adapted.factor, bounded: adapted.bounded }
    }

    /// The model, written out for the row.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The model as a, b, f, g; in the full form after one more round of separation. Beside it the part of the driven
    /// half's weighted norm that the separation does not explain.
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
        self.estimator.factors().covariance_trace()
    }

    /// Prediction error and change of it that count as PB, in the unit of the output, where something is fuzzy.
    pub fn universes(&self) -> Option<(f64, f64)> {
        self.estimator.universes()
    }
}
