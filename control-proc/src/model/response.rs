//! Free response, step response and residual of a model.
//!
//! The difference equation (12) of the paper, in differences (CARIMA form):
//!
//! ```text
//! dy(k+i) = -a_1 dy(k+i-1) - .. - a_na dy(k+i-na) + b_0 dx(k+i-nk) + .. + b_nb dx(k+i-nk-nb)
//! y(k+i)  = y(k+i-1) + dy(k+i)                       dy(k) = y(k) - y(k-1),  dx(k) = x(k) - x(k-1)
//! ```
//!
//! y output in m, x = N(u) intermediate value. Source: Clarke, Mohtadi and Tuffs, Generalized predictive control,
//! Automatica 23 (1987). In differences a constant offset of the output cancels, and so does the drift of the model.
//! Hence a load, or a model without an integrator, leaves no steady error. Trap: differencing amplifies measurement
//! noise.
//!
//! The health check of the identifier needs only the last value of a step response. It sums positions, not differences,
//! so its result differs from [`step_response`] in the last bits.

use pipeline::{
    hammerstein::{Coefficients, MAX_A, MAX_DELAY},
    machine::MAX_RESPONSE,
};

/// Ticks from now to the end of the longest prediction, now included.
pub const MAX_AHEAD: usize = MAX_DELAY + MAX_RESPONSE + 1;

/// y(k+1), y(k+2), .. in `response` (m) if x stays at x(k-1) from now on.
///
/// `outputs` holds y(k), y(k-1), .. (na + 1 of them), `intermediate` x(k-1), x(k-2), .. (nk + nb of them).
/// `noise` is what is known of the noise in dy(k+1), dy(k+2), .., m. Beyond its end the noise is 0.
pub fn free_response(model: &Coefficients, outputs: &[f64], intermediate: &[f64], noise: &[f64], response: &mut [f64]) {
    let nk = model.nk as usize;
    // The last differences of the outputs, the newest first.
    let mut differences = [0.0; MAX_A];
    for (difference, pair) in differences.iter_mut().zip(outputs.windows(2)) {
        *difference = pair[0] - pair[1];
    }
    let mut y = outputs[0];
    for (i, predicted) in response.iter_mut().enumerate() {
        let mut difference = noise.get(i).copied().unwrap_or(0.0);
        for (a, before) in model.a().iter().zip(&differences) {
            difference -= a * before;
        }
        for (j, b) in model.b().iter().enumerate() {
            // b_j meets dx(k + 1 + i - nk - j), which is past when this is at least 1 tick ago.
            let ago = (nk + j).saturating_sub(i + 1);
            if ago >= 1 {
                difference += b * (intermediate[ago - 1] - intermediate[ago]);
            }
        }
        differences.copy_within(..MAX_A - 1, 1);
        differences[0] = difference;
        y += difference;
        *predicted = y;
    }
}

/// The residual of dy(k), m: dy(k) minus its prediction from the differences before it.
///
/// `outputs` holds y(k), y(k-1), .. (na + 2 of them), `intermediate` x(k-1), x(k-2), .. (nk + nb + 1 of them).
pub fn residual(model: &Coefficients, outputs: &[f64], intermediate: &[f64]) -> f64 {
    let difference = |values: &[f64], ago: usize| values[ago] - values[ago + 1];
    let mut residual = difference(outputs, 0);
    for (j, a) in model.a().iter().enumerate() {
        residual += a * difference(outputs, j + 1);
    }
    for (j, b) in model.b().iter().enumerate() {
        // intermediate[i] is x(k-1-i).
        residual -= b * difference(intermediate, model.nk as usize + j - 1);
    }
    residual
}

/// The response to a unit step of x at k, from y(k+nk) on: `response[p]` = y(k+nk+p), m per unit of x.
pub fn step_response(model: &Coefficients, response: &mut [f64]) {
    let mut differences = [0.0; MAX_A];
    let mut y = 0.0;
    for (p, stepped) in response.iter_mut().enumerate() {
        let mut difference = model.b().get(p).copied().unwrap_or(0.0);
        for (a, before) in model.a().iter().zip(&differences) {
            difference -= a * before;
        }
        differences.copy_within(..MAX_A - 1, 1);
        differences[0] = difference;
        y += difference;
        *stepped = y;
    }
}

/// The end of a step response of an axis: slope (p + 1 - lag).
///
/// A model with an integrator, A(q) = (1 - q) A~(q), has it in closed form:
///
/// ```text
/// slope = B(1)/A~(1)    lag = B'(1)/B(1) - A~'(1)/A~(1)    A~(1) = -sum i a_i    A~'(1) = -sum i (i - 1) a_i/2
/// ```
///
/// q = z^-1. B without its delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Increase per tick, m per unit of x.
    pub slope: f64,
    /// Lag in ticks, without the delay. Not finite for a model that does not move.
    pub lag: f64,
    /// Ticks of the step response that it is the end of.
    pub ticks: usize,
}

/// Largest A(1) of a model with an integrator.
const INTEGRATOR: f64 = 1e-12;

impl Ramp {
    /// The end of a step response of `ticks` of `model`, at most [`MAX_RESPONSE`]: in closed form if the model has an
    /// integrator.
    pub fn of(model: &Coefficients, ticks: usize) -> Self {
        if (1.0 + model.a().iter().sum::<f64>()).abs() > INTEGRATOR {
            let mut step = [0.0; MAX_RESPONSE];
            step_response(model, &mut step[..ticks]);
            return Self::new(&step[..ticks]);
        }
        let (mut gain, mut curvature) = (0.0, 0.0);
        for (i, a) in (1..).map(f64::from).zip(model.a()) {
            gain -= i * a;
            curvature -= 0.5 * i * (i - 1.0) * a;
        }
        let (mut sum, mut moment) = (0.0, 0.0);
        for (j, b) in (0..).map(f64::from).zip(model.b()) {
            sum += b;
            moment += j * b;
        }
        Self { slope: sum / gain, lag: moment / sum - curvature / gain, ticks }
    }

    /// The last value of the step response, m per unit of x.
    pub fn last(&self) -> f64 {
        self.slope * (self.ticks as f64 - self.lag)
    }

    /// The end of the step response `step`, which has to be settled by then.
    pub fn new(step: &[f64]) -> Self {
        let (last, before) = match step {
            [.., before, last] => (*last, *before),
            [last] => (*last, 0.0),
            [] => (0.0, 0.0),
        };
        let slope = last - before;
        Self { slope, lag: step.len() as f64 - last / slope, ticks: step.len() }
    }

    /// Lag in ticks from 0 to the length of the step response, which counts for slower models and those that come to a
    /// stand.
    pub fn bounded_lag(&self) -> f64 {
        // `max` leaves out what is not a number.
        self.lag.max(0.0).min(self.ticks as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::linear;
    use proptest::prelude::*;

    #[test]
    fn the_step_of_table_2_ends_at_its_static_gain() {
        let mut response = [0.0; MAX_AHEAD];
        step_response(&Coefficients::TABLE_2, &mut response);
        assert_eq!(response[0], 0.7237);
        let gain = (0.7237 + 0.8375) / 0.0355;
        // The slow pole, 0.9633, has decayed to 3 % after 95 samples.
        assert!((response[MAX_AHEAD - 1] / gain - 1.0).abs() < 0.04);
    }

    #[test]
    fn the_ramp_of_a_lag_has_its_slope_and_its_lag() {
        let mut response = [0.0; 31];
        // (1 - z^-1)(1 - 0.6 z^-1): 0.01 m per tick in the end, 0.6/(1 - 0.6) ticks late.
        step_response(&linear(&[-1.6, 0.6], &[0.004], 3), &mut response);
        let ramp = Ramp::new(&response);
        assert!((ramp.slope - 0.01).abs() < 1e-8 && (ramp.lag - 1.5).abs() < 1e-4, "{ramp:?}");
        assert_eq!(Ramp::new(&[0.5]), Ramp { slope: 0.5, lag: 0.0, ticks: 1 });
        let closed = Ramp::of(&linear(&[-1.6, 0.6], &[0.004], 3), 31);
        assert!((closed.slope - 0.01).abs() < 1e-15 && (closed.lag - 1.5).abs() < 1e-12, "{closed:?}");
        assert!(Ramp::new(&[]).lag.is_nan() && Ramp::new(&[0.5, 0.5]).lag == f64::NEG_INFINITY);
    }

    proptest! {
        /// Two lags and zeros: the closed form is what the settled step response says.
        #[test]
        fn the_closed_form_is_the_end_of_the_step_response(
            poles in prop::array::uniform2(-0.5f64..0.9),
            b in prop::array::uniform3(0.001f64..0.02),
            nk in 1usize..12,
        ) {
            let [p, q] = poles;
            let model = linear(&[-(p + q), p * q], &b, nk).integrated();
            let mut step = [0.0; 400];
            step_response(&model, &mut step);
            let (closed, ends) = (Ramp::of(&model, 400), Ramp::new(&step));
            prop_assert!((closed.slope / ends.slope - 1.0).abs() < 1e-9, "{closed:?} {ends:?}");
            prop_assert!((closed.lag - ends.lag).abs() < 1e-6, "{closed:?} {ends:?}");
            prop_assert!((closed.last() / step[399] - 1.0).abs() < 1e-9, "{closed:?} {}", step[399]);
        }

        /// With an offset on the output and all moves known, the differences predict exactly what (12) does.
        #[test]
        fn free_response_is_the_model_itself_with_x_held(
            x in prop::collection::vec(-1.0f64..1.0, 60),
            nk in 1usize..12,
            offset in -1.0f64..1.0,
        ) {
            let model = linear(&[-1.6, 0.6], &[0.01, 0.02, 0.005], nk);
            let k = 59;
            let mut y = vec![0.0; 100];
            let held = |i: usize| x[i.min(k - 1)];
            for i in 2..100 {
                let past: f64 = model.b().iter().enumerate()
                    .map(|(j, b)| if i >= nk + j { b * held(i - nk - j) } else { 0.0 }).sum();
                y[i] = past - model.a[0] * y[i - 1] - model.a[1] * y[i - 2];
            }
            let outputs: Vec<f64> = (0..6).map(|i| y[k - i] + offset).collect();
            let intermediate: Vec<f64> = (0..20).map(|i| x[k - 1 - i]).collect();
            let mut response = [0.0; 40];
            free_response(&model, &outputs, &intermediate, &[], &mut response);
            for i in 0..40 {
                prop_assert!((response[i] - y[k + 1 + i] - offset).abs() < 1e-9, "{i}");
            }
        }
    }
}
