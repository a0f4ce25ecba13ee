//! Validation of the models: tests of the residuals after training, and standard deviations of the coefficients.

use ident_proc::{
    Identifier,
    validation::{
        criteria,
        cross_correlation::{CrossCorrelation, Half},
        deviations::{SeparatedDeviations, separated},
        whiteness::Whiteness,
    },
};
use pipeline::hammerstein::Coefficients;
use serde::Serialize;

use crate::report::table::{number, percent, table};

/// Lags of the correlations: two time constants of a servo that is sampled ten times in each.
const LAGS: usize = 25;
/// Fewest samples for each lag.
const SAMPLES_PER_LAG: usize = 4;

/// Residuals of both models over the used samples after training, and the inputs of these samples.
#[derive(Debug, Default)]
pub struct Residuals {
    adaptive: Vec<f64>,
    classical: Vec<f64>,
    inputs: Vec<f64>,
}

impl Residuals {
    /// Removes all samples and reserves memory for `samples`.
    pub fn clear(&mut self, samples: usize) {
        for values in [&mut self.adaptive, &mut self.classical, &mut self.inputs] {
            values.clear();
            values.reserve(samples);
        }
    }

    /// Adds one sample.
    pub fn push(&mut self, [adaptive, classical]: [f64; 2], input: f64) {
        self.adaptive.push(adaptive);
        self.classical.push(classical);
        self.inputs.push(input);
    }
}

/// The results, as JSON has them.
#[derive(Debug, Serialize)]
pub struct Validation {
    lags: usize,
    classical: Correlations,
    adaptive: Correlations,
    /// Criteria of the classical model over the training rows.
    criteria: Option<Criteria>,
    /// Standard deviations of the coefficients of the classical model.
    pub deviations: Option<Deviations>,
}

/// Tests of the residuals of one model; none where there are too few samples.
#[derive(Debug, Serialize)]
struct Correlations {
    whiteness: Option<Whiteness>,
    cross_correlation: Option<CrossCorrelation>,
}

#[derive(Debug, Serialize)]
struct Criteria {
    aic: f64,
    aicc: f64,
    bic: f64,
    fpe: f64,
}

/// Standard deviations, one for each coefficient: none for a coefficient that the data do not determine, 0 for the one
/// that fixes the scale.
#[derive(Debug, Serialize)]
pub struct Deviations {
    /// Deviations of a_1 .. a_na; of the polynomial for increments where the structure has an integrator.
    pub a: Vec<Option<f64>>,
    /// Deviations of b_0 .. b_nb.
    pub b: Vec<Option<f64>>,
    /// Deviations of f_1 .. f_r.
    pub f: Vec<Option<f64>>,
    /// Deviations of g_1 .. g_r.
    pub g: Vec<Option<f64>>,
    /// Deviation of the drift.
    pub drift: Option<f64>,
    noise_sigma: f64,
}

impl Validation {
    /// The validation after the last sample.
    pub fn new(identifier: &Identifier, residuals: &Residuals) -> Self {
        let lags = LAGS.min(residuals.inputs.len() / SAMPLES_PER_LAG);
        let correlations = |values: &[f64]| Correlations {
            whiteness: Whiteness::new(values, lags, 0),
            cross_correlation: CrossCorrelation::new(values, &residuals.inputs, lags),
        };
        let batch = identifier.batch();
        let spread = identifier.offline().and_then(|offline| {
            let model: &Coefficients = &offline.coefficients;
            separated(batch.collected(), model)
        });
        Self {
            lags,
            classical: correlations(&residuals.classical),
            adaptive: correlations(&residuals.adaptive),
            criteria: spread.as_ref().map(|spread| Criteria::new(spread, batch.rows())),
            deviations: spread.map(Deviations::from),
        }
    }

    /// The results as tables.
    pub fn table(&self) -> String {
        let row = |name: &str, of: &Correlations| {
            let white = of.whiteness.as_ref().map_or_else(
                || vec![String::new(); 3],
                |w| {
                    let verdict = if w.white { "yes" } else { "no" };
                    vec![verdict.to_owned(), percent(100.0 * w.outside_99), number(w.bound_99)]
                },
            );
            let cross = of.cross_correlation.as_ref().map_or_else(
                || vec![String::new(); 4],
                |c| {
                    let half = |half: &Half| {
                        [percent(100.0 * half.outside), format!("{:.3} at {}", half.worst, half.worst_lag)]
                    };
                    [half(&c.model), half(&c.feedback)].concat()
                },
            );
            [vec![name.to_owned()], white, cross].concat()
        };
        let header = [
            "residuals",
            "white",
            "outside 99 %",
            "bound",
            "with input: outside",
            "worst, at lag",
            "feedback: outside",
            "worst, at lag",
        ];
        let rows = vec![row("classical", &self.classical), row("adaptive", &self.adaptive)];
        let mut text = format!("{}\n", table(&header, rows));
        if let Some(criteria) = &self.criteria {
            text += &format!(
                "classical model over its training rows: AIC {}, BIC {}, final prediction error {}\n",
                number(criteria.aic),
                number(criteria.bic),
                number(criteria.fpe)
            );
        }
        text
    }
}

impl Criteria {
    fn new(spread: &SeparatedDeviations, rows: u64) -> Self {
        let d = spread.determined;
        let residual = spread.noise * spread.noise * (rows - d as u64) as f64;
        Self {
            aic: criteria::aic(residual, rows, d),
            aicc: criteria::aicc(residual, rows, d),
            bic: criteria::bic(residual, rows, d),
            fpe: criteria::fpe(residual, rows, d),
        }
    }
}

impl From<SeparatedDeviations> for Deviations {
    fn from(of: SeparatedDeviations) -> Self {
        Self { a: of.a, b: of.b, f: of.f, g: of.g, drift: of.rest.first().copied().flatten(), noise_sigma: of.noise }
    }
}
