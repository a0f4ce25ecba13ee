//! The grey box: the commissioned model with its speeds and its lag adapted. All of its few parameters have a meaning.
//!
//! ```text
//! p_j(k) = p_j(k-1) + (1 - alpha_j) (phi(k-nk) - p_j(k-1))       alpha_j = tau_j/(T + tau_j), one of eight lags
//! dy(k)  = T theta_j' p_j(k) + e(k)                              hence A = (1 - z^-1)(1 - alpha_j z^-1)
//! Y(k)   = rho Y(k-1) + dy(k)        P_j(k) = rho P_j(k-1) + T p_j(k)          rho = exp(-T/W)
//! S_j(k) = S_0 + L (S_j(k-1) - S_0) L + w P_j P_j'               w = (1 - rho) / (s_0^2 + (0.05 Y)^2)
//! theta_j += S_j^-1 (sum of w P_j (Y - theta_j' P_j))            L = diag sqrt(1 - (1 - exp(-T/M)) m)
//! J_j(k) = the recent mean of w (Y - theta_j' P_j)^2
//! theta, alpha/(1 - alpha)   means over the lags, weighted by 1/J_j^4
//! ```
//!
//! y position in m, dy its increment; phi features of the command, hinges beyond the dead band; theta speeds per unit
//! of them in m/s; T period, tau_j lag and W window in s; s_0 in m. m, from 0 to 1, says how much of a full measure
//! the sample is of either direction of motion; M is the memory in seconds of motion
//! ([`pipeline::machine::Identification`]). A direction without excitation is kept, however long that lasts. S_0 is the
//! inverse of the covariance of theta before any sample (module `prior`).
//!
//! Source: identification with a prior, Ljung, System Identification (1999), 7.4 and 16.4; forgetting down to a least
//! information, Kulhavy and Zarrop, Int. J. Control 58 (1993).
//!
//! Traps: a free difference equation fits closed-loop records half a second ahead with any lag from none to twice the
//! true one. Noise and feedback decide which, and a controller that inverts that model oscillates. Here the lag is one
//! of a few, and whole motions decide. In a loop that oscillates every estimate of the speeds is too low, which makes
//! the loop oscillate more. The speeds therefore have a floor: a speed that is estimated too high only makes the
//! controller slow.

mod increment;
mod lag;
mod matrix;
mod prior;
#[cfg(test)]
mod tests;

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Commissioned, Start},
};

use self::{
    increment::Increment,
    lag::{Lag, Motion},
    matrix::{MOST, Vector, inverse},
    prior::Prior,
};
use super::Learned;
use crate::{regression::write_out, sample::RegressorRow};

/// W, s.
const WINDOW: f64 = 0.2;
/// The lags, in parts of the commissioned one, which counts as [`LEAST_LAG`] at least. Cold oil makes a valve two to
/// three times as slow. Friction and the spring of the load look like other lags, too.
const LAGS: [f64; 8] = [0.5, 0.6, 0.75, 1.0, 1.4, 2.0, 2.5, 3.0];
/// Index of the commissioned lag. Only it counts until there has been enough motion to judge the lags.
const NOMINAL: usize = 3;
/// Least lag whose multiples are tried, in periods.
const LEAST_LAG: f64 = 0.5;
/// Part of a full measure of motion from which on the lags are judged.
const JUDGED_FROM: f64 = 0.05;
/// Error of a good model, in parts of the travel.
const EXPECTED_ERROR: f64 = 0.05;
/// s_0, in parts of the top speed times W.
const EXPECTED_NOISE: f64 = 0.005;
/// J below which lags count as equally good.
const EQUAL: f64 = 1e-3;
/// Least slope of the curve's first piece, in parts of the commissioned one. The dead band may have grown into it.
const LEAST_FIRST_SLOPE: f64 = 0.02;
/// Least slope of the other pieces, in parts of the commissioned ones.
const LEAST_SLOPE: f64 = 0.7;
/// Least slope of a piece, in parts of the steepest piece nearer to neutral. A valve opens ever wider; a flat piece is
/// one that was not driven, while commissioning or since.
const LEAST_RISE: f64 = 0.5;
/// Greatest slope of any piece, in parts of the commissioned one.
const GREATEST_SLOPE: f64 = 5.0;

/// The estimator of one axis.
#[derive(Debug, Clone)]
pub struct GreyBox {
    /// The structure of the row and of the model.
    structure: Structure,
    period: f64,
    prior: Prior,
    /// alpha/(1 - alpha) until the lags are judged.
    first_ratio: f64,
    /// s_0^2.
    noise: f64,
    rho: f64,
    /// exp(-T/M).
    forgetting: f64,
    lags: [Lag; LAGS.len()],
    /// Y.
    travel: f64,
    increment: Increment,
    model: Coefficients,
    /// The model written out for the row.
    theta: Vec<f64>,
}

impl GreyBox {
    /// Starts from the `commissioned` axis, or from what a run has learned of it; `structure` is the one that
    /// [`Commissioned::structure`] gives, `period` in s, `memory` in s of motion.
    ///
    /// What was learned is where the estimate begins. Its bounds and what is known before any sample stay those of
    /// commissioning.
    pub fn new(
        structure: Structure,
        commissioned: &Commissioned,
        period: f64,
        memory: f64,
        start: Option<&Start>,
    ) -> Self {
        let prior = Prior::new(structure, commissioned);
        let theta = start.map_or(prior.theta, |start| Prior::new(structure, &start.speeds(commissioned)).theta);
        let top = commissioned.speed(commissioned.tested().1).max(-commissioned.speed(commissioned.tested().0));
        // Whole samples of the delay that the dead time does not fill.
        let early = (structure.nk as f64 - 1.0) * period - commissioned.dead_time;
        let lags = LAGS.map(|part| {
            let lag = (part * commissioned.time_constant.max(LEAST_LAG * period) - early).max(0.0);
            Lag::new(lag / (period + lag), &prior, theta)
        });
        let nominal = lags[NOMINAL].alpha();
        let published = structure.published();
        let mut grey_box = Self {
            structure: published,
            period,
            prior,
            first_ratio: start.map_or(nominal / (1.0 - nominal), |start| start.lag / period),
            noise: (EXPECTED_NOISE * top * WINDOW).powi(2),
            rho: (-period / WINDOW).exp(),
            forgetting: (-period / memory).exp(),
            lags,
            travel: 0.0,
            increment: Increment::new(period),
            model: Coefficients::zero(published),
            theta: vec![0.0; published.full_len()],
        };
        grey_box.make_model();
        grey_box
    }

    /// Begins anew after a gap in the samples. What was learned stays.
    pub fn interrupt(&mut self) {
        self.increment.interrupt();
        self.travel = 0.0;
    }

    /// Goes on past a sample whose output is not used.
    pub fn pass(&mut self, row: &RegressorRow) {
        self.filter(row);
        self.increment.pass();
        self.travel = 0.0;
    }

    /// Takes in y(k) and the row of sample k.
    pub fn learn(&mut self, y: f64, row: &RegressorRow) -> Learned {
        self.filter(row);
        let Some(increment) = self.increment.take(y, &self.model) else {
            // The travel since the sample before is not known, so a new window begins here.
            self.lags.iter_mut().for_each(Lag::clear_window);
            return Learned::NOTHING;
        };
        let n = 2 * self.structure.order;
        self.travel = self.rho * self.travel + increment;
        let expected = EXPECTED_ERROR * self.travel;
        let motion = Motion {
            travel: self.travel,
            weight: (1.0 - self.rho) / (self.noise + expected * expected),
            full: (1.0 - self.rho) / (EXPECTED_ERROR * EXPECTED_ERROR),
            forgetting: self.forgetting,
            order: self.structure.order,
        };
        let mut factor = 1.0f64;
        for lag in &mut self.lags {
            let keep = lag.gather(&motion, &self.prior);
            factor = factor.min(keep[0]).min(keep[1]);
        }
        for lag in &mut self.lags {
            lag.solve(n);
        }
        self.make_model();
        Learned { factor, bounded: false }
    }

    /// Takes the features of the newest command of the row in, for every lag.
    fn filter(&mut self, row: &RegressorRow) {
        let n = 2 * self.structure.order;
        for (i, feature) in row.driven().iter().step_by(self.structure.nb + 1).take(n).enumerate() {
            for lag in &mut self.lags {
                lag.filter(i, *feature, self.rho, self.period);
            }
            self.increment.filter(i, *feature, &self.model);
        }
    }

    /// Makes the model from the lags, each by its weight, with slopes within their bounds.
    fn make_model(&mut self) {
        let order = self.structure.order;
        let (theta, alpha) = self.mean();
        let model = &mut self.model;
        (model.a[0], model.a[1]) = (-1.0 - alpha, alpha);
        model.b[0] = self.period * (1.0 - alpha);
        for (first, branch) in [(0, &mut model.f), (order, &mut model.g)] {
            let (mut slope, mut before, mut usual, mut steepest) = (0.0, 0.0, 0.0, 0.0f64);
            for i in 0..order {
                slope += theta[first + i];
                usual += self.prior.theta[first + i];
                let floor = if i == 0 { LEAST_FIRST_SLOPE } else { LEAST_SLOPE };
                let bounded = slope.clamp(floor * usual, GREATEST_SLOPE * usual).max(LEAST_RISE * steepest);
                steepest = steepest.max(bounded);
                branch[i] = bounded - before;
                before = bounded;
            }
        }
        write_out(model, &self.structure, &mut self.theta);
    }

    /// theta and alpha, means over the lags.
    fn mean(&self) -> (Vector, f64) {
        let (mut theta, mut ratio, mut sum) = ([0.0; MOST], 0.0, 0.0);
        let least = self.lags.iter().map(Lag::mean_square).fold(f64::INFINITY, f64::min);
        for (j, lag) in self.lags.iter().enumerate() {
            let (weight, of_lag) = if lag.judged() < JUDGED_FROM {
                (f64::from(u8::from(j == NOMINAL)), self.first_ratio)
            } else {
                (((least + EQUAL) / (lag.mean_square() + EQUAL)).powi(4), lag.alpha() / (1.0 - lag.alpha()))
            };
            sum += weight;
            ratio += weight * of_lag;
            theta.iter_mut().zip(lag.theta()).for_each(|(mean, theta)| *mean += weight * theta);
        }
        let (ratio, theta) = (ratio / sum, theta.map(|theta| theta / sum));
        (theta, ratio / (1.0 + ratio))
    }

    /// The coefficients, written out for the row.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// Trace of the covariance of theta for the lag with the least error, in units of the noise of a good model.
    pub fn covariance_trace(&self) -> f64 {
        let best = self.lags.iter().min_by(|a, b| a.mean_square().total_cmp(&b.mean_square()));
        let n = 2 * self.structure.order;
        best.map_or(0.0, |lag| inverse(lag.information(), n).iter().enumerate().map(|(i, row)| row[i]).sum())
    }

    /// The last increment of the output, without the noise of the encoder.
    pub fn increment(&self) -> f64 {
        self.increment.known(&self.model)
    }

    /// The model as a, b, f, g.
    pub fn model(&self) -> Coefficients {
        self.model
    }
}
