//! The reference's integrator: Dormand and Prince's embedded pair of order 5(4), with error control.
//!
//! ```text
//! x(t+h) = x + h sum b_i k_i                          error = h sum (b_i - b^_i) k_i
//! h <- 0.9 h max_j(|error_j|/tolerance_j)^(-1/5)
//! ```
//!
//! Source: Dormand and Prince, 1980. A step whose error exceeds a tolerance is repeated with a shorter length. A kink
//! of the right-hand side or a jump at an end stop is therefore crossed in steps so short that its effect is
//! negligible. The method is explicit: beyond its limit of stability the error grows and the step is repeated, so that
//! a stiff right-hand side makes the steps short.

const NODES: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];

const STAGES: [&[f64]; 7] = [
    &[],
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
    &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// Weights of the fifth order less those of the fourth.
const ERROR: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

/// Shortest step, s. A step this short is taken whatever its error is.
const SHORTEST: f64 = 1e-15;

/// The integrator and its memory.
pub struct DormandPrince {
    /// Error of each component that is allowed in one step.
    tolerance: Vec<f64>,
    step: f64,
    rates: Vec<Vec<f64>>,
    stage: Vec<f64>,
    /// Number of steps that were taken, and number of steps that were repeated.
    pub steps: (u64, u64),
}

impl DormandPrince {
    pub fn new(tolerance: Vec<f64>, first_step: f64) -> Self {
        let zero = vec![0.0; tolerance.len()];
        Self { step: first_step, rates: vec![zero.clone(); 7], stage: zero, tolerance, steps: (0, 0) }
    }

    /// Takes `state` from time 0 to `end`; `rates(t, x, dx/dt)` writes the right-hand side.
    pub fn advance(&mut self, end: f64, state: &mut [f64], mut rates: impl FnMut(f64, &[f64], &mut [f64])) {
        let mut time = 0.0;
        rates(0.0, state, &mut self.rates[0]);
        while time < end {
            // The last step meets the end exactly and does not shorten the next one.
            let left = end - time;
            let is_last = self.step >= left;
            let step = if is_last { left } else { self.step };
            let error = self.attempt(time, step, state, &mut rates);
            let factor = (0.9 * error.powf(-0.2)).clamp(0.2, 5.0);
            if error <= 1.0 || step <= SHORTEST {
                self.steps.0 += 1;
                state.copy_from_slice(&self.stage);
                self.rates.swap(0, 6);
                time = if is_last { end } else { time + step };
                self.step = if is_last { self.step.max(step * factor) } else { step * factor };
            } else {
                self.steps.1 += 1;
                self.step = step * factor.min(0.9);
            }
        }
    }

    /// Tries one step and returns its error in units of the tolerance; the new state is in `stage`.
    fn attempt(&mut self, time: f64, step: f64, state: &[f64], rates: &mut impl FnMut(f64, &[f64], &mut [f64])) -> f64 {
        for (stage, weights) in STAGES.iter().enumerate().skip(1) {
            for (i, value) in self.stage.iter_mut().enumerate() {
                let sum: f64 = weights.iter().zip(&self.rates).map(|(weight, rate)| weight * rate[i]).sum();
                *value = state[i] + step * sum;
            }
            rates(time + NODES[stage] * step, &self.stage, &mut self.rates[stage]);
        }
        let error = self.tolerance.iter().enumerate().map(|(i, tolerance)| {
            let sum: f64 = ERROR.iter().zip(&self.rates).map(|(weight, rate)| weight * rate[i]).sum();
            (step * sum / tolerance).abs()
        });
        // An error that is not a number counts as a large one.
        error.fold(0.0, |worst, error| if error <= worst { worst } else { error })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error after 6 s of an oscillator with steps of `step` s, none of which is repeated.
    fn error_of(step: f64) -> f64 {
        let (mut state, mut time) = (vec![1.0, 0.0], 0.0);
        while time < 6.0 - 0.5 * step {
            let mut one = DormandPrince::new(vec![f64::INFINITY; 2], step);
            one.advance(step, &mut state, oscillator);
            assert_eq!(one.steps, (1, 0));
            time += step;
        }
        (state[0] - 6f64.cos()).hypot(state[1] + 6f64.sin())
    }

    fn oscillator(_: f64, x: &[f64], rates: &mut [f64]) {
        (rates[0], rates[1]) = (x[1], -x[0]);
    }

    #[test]
    fn the_order_is_five() {
        let errors = [0.2, 0.1, 0.05, 0.025].map(error_of);
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((4.9..5.3).contains(&order), "{order} from {errors:?}");
        }
    }

    #[test]
    fn the_error_follows_the_tolerance_over_time_dependence_and_stiffness() {
        // x' = -r (x - cos t) - sin t from x = 1 is cos t, for any r.
        for rate in [1.0, 100.0, 3e4] {
            for tolerance in [1e-6, 1e-9, 1e-12] {
                let (mut state, mut pair) = ([1.0], DormandPrince::new(vec![tolerance], 1e-3));
                pair.advance(2.0, &mut state, |t, x, rates| rates[0] = -rate * (x[0] - t.cos()) - t.sin());
                assert!((state[0] - 2f64.cos()).abs() < 30.0 * tolerance, "{rate} {tolerance}: {state:?}");
            }
        }
    }

    #[test]
    fn the_integrator_crosses_a_kink_and_a_jump_accurately() {
        // x' = 1 until 0.3, then -1: 0.3 - 0.7 at 1; and its integral.
        let (mut state, mut pair) = ([0.0, 0.0], DormandPrince::new(vec![1e-10; 2], 1e-2));
        pair.advance(1.0, &mut state, |t, x, rates| (rates[0], rates[1]) = (if t < 0.3 { 1.0 } else { -1.0 }, x[0]));
        // The error weights of the stages behind a jump may sum up to as little as 1/90 of the jump's effect.
        assert!((state[0] + 0.4).abs() < 1e-8 && (state[1] - (0.045 + 0.7 * -0.05)).abs() < 1e-8, "{state:?}");
    }
}
