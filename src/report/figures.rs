//! Figures that several reports have: errors, their reduction, coefficients.

use pipeline::{hammerstein::Coefficients, message::ModelErrors, statistics::ErrorStatistics};
use serde::Serialize;

/// Statistics of one kind of error, in the unit of the output.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ErrorFigures {
    /// Standard deviation.
    pub sigma: f64,
    /// Root mean square.
    pub rmse: f64,
    /// Largest magnitude.
    pub max: f64,
    /// 100 (1 - |e| / |y - mean y|), percent.
    pub fit_percent: f64,
}

impl ErrorFigures {
    /// Figures from the running statistics of the error and of the output.
    pub fn new(error: &ErrorStatistics, output: &ErrorStatistics) -> Self {
        let rmse = error.rmse();
        Self { sigma: error.sigma(), rmse, max: error.max, fit_percent: 100.0 * (1.0 - rmse / output.sigma()) }
    }
}

/// Reduction of errors by the adaptive model: 100 (1 - sigma_adaptive / sigma_classical), percent.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Reduction {
    /// Reduction of the one-step error.
    pub one_step: f64,
    /// Reduction of the h-step error.
    pub h_step: f64,
    /// Reduction of the error of the free run.
    pub free_run: f64,
}

impl Reduction {
    /// The reduction from the errors of both models over the same samples.
    pub fn new(classical: &ModelErrors, adaptive: &ModelErrors) -> Self {
        let percent =
            |of: fn(&ModelErrors) -> &ErrorStatistics| 100.0 * (1.0 - of(adaptive).sigma() / of(classical).sigma());
        Self {
            one_step: percent(|errors| &errors.one_step),
            h_step: percent(|errors| &errors.h_step),
            free_run: percent(|errors| &errors.free_run),
        }
    }

    /// Only the figures for which the classical model's error is below a baseline without a model: rmse of the one-step
    /// error, h-step error and free run. The others are NaN, since a reduction of an error without meaning has none.
    pub fn where_better(self, classical: &ModelErrors, [one_step, h_step, free_run]: [f64; 3]) -> Self {
        let kept = |reduction, error: &ErrorStatistics, baseline| {
            if error.rmse() < baseline { reduction } else { f64::NAN }
        };
        Self {
            one_step: kept(self.one_step, &classical.one_step, one_step),
            h_step: kept(self.h_step, &classical.h_step, h_step),
            free_run: kept(self.free_run, &classical.free_run, free_run),
        }
    }
}

/// The coefficients of a model as lists: the used entries of each array.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoefficientLists {
    /// a_1 .. a_na.
    pub a: Vec<f64>,
    /// b_0 .. b_nb.
    pub b: Vec<f64>,
    /// f_1 .. f_r.
    pub f: Vec<f64>,
    /// g_1 .. g_r.
    pub g: Vec<f64>,
    /// c; 0 for a model without drift.
    pub drift: f64,
}

impl CoefficientLists {
    /// The lists of one model.
    pub fn new(model: &Coefficients) -> Self {
        let order = model.nonlinearity().order;
        Self {
            a: model.a().to_vec(),
            b: model.b().to_vec(),
            f: model.f[..order].to_vec(),
            g: model.g[..order].to_vec(),
            drift: model.drift,
        }
    }
}
