//! Tells a wild sample from a sound one.
//!
//! ```text
//! e = min over the predictors of |y - y^|          s^2 <- s^2 + (min(e^2, 25 s^2) - s^2) / 100,  at least sigma^2
//! wild  <=>  e > 30 s
//! ```
//!
//! y in the unit of the output, sigma the standard deviation of the training's residuals. The predictors are the
//! adaptive and the classical model and the sample before: a model that went wrong must not call the measurement wrong,
//! so all of them have to disagree with it. A wild sample is not learned from and not counted in the errors; its place
//! in the history is taken by the middle one of the predictions, or every model would predict from it for the next na
//! samples.
//!
//! Trap: an encoder that is set to another zero is wild at every sample from then on. After [`LONGEST`] in a row the
//! measurement is believed.

/// Errors beyond this many times their usual size are wild: motion, load steps and end stops stay far below.
const LIMIT: f64 = 30.0;
/// Wild samples in a row that are not believed.
pub const LONGEST: u32 = 5;
/// Samples of the training before anything can be called wild.
const FIRST: u32 = 100;

/// Watches the samples of one output.
#[derive(Debug, Clone, Default)]
pub struct OutlierGate {
    floor: f64,
    mean_square: f64,
    seen: u32,
    wild: u32,
}

/// What to make of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Use it.
    Sound,
    /// Do not use it; this takes its place in the history.
    Wild(f64),
    /// Believe it from here on, and nothing before it.
    Step,
}

impl OutlierGate {
    /// From here on, sizes are measured against `sigma`, the residuals of the training.
    pub fn trained(&mut self, sigma: f64) {
        *self = Self { floor: sigma, mean_square: sigma * sigma, seen: FIRST, wild: 0 };
    }

    /// The usual size of the error, in the unit of the output.
    pub fn size(&self) -> f64 {
        self.mean_square.sqrt().max(self.floor)
    }

    /// Judges `y` by what was predicted of it.
    pub fn judge<const N: usize>(&mut self, y: f64, mut predictions: [f64; N]) -> Verdict {
        let error = predictions.iter().map(|predicted| (y - predicted).abs()).fold(f64::INFINITY, f64::min);
        let size = self.size();
        if self.seen >= FIRST && error > LIMIT * size {
            self.wild += 1;
            if self.wild <= LONGEST {
                predictions.sort_by(f64::total_cmp);
                return Verdict::Wild(predictions[N / 2]);
            }
            // Larger errors are what to expect now.
            (self.wild, self.mean_square) = (0, error * error);
            return Verdict::Step;
        }
        self.wild = 0;
        // While it is trained, the mean over all samples so far.
        self.seen = (self.seen + 1).min(FIRST);
        let share = 1.0 / f64::from(self.seen);
        let square = error * error;
        let square = if self.seen < FIRST { square } else { square.min(25.0 * size * size) };
        self.mean_square += share * (square - self.mean_square);
        Verdict::Sound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trained() -> OutlierGate {
        let mut gate = OutlierGate::default();
        gate.trained(0.1);
        gate
    }

    #[test]
    fn a_spike_is_replaced_by_the_middle_prediction() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, [1.1, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(100.0, [1.1, 0.9, 1.0]), Verdict::Wild(1.0));
        assert_eq!(gate.judge(1.0, [1.1, 0.9, 1.0]), Verdict::Sound);
        assert!((gate.size() - 0.1).abs() < 1e-3);
    }

    #[test]
    fn a_model_gone_wrong_does_not_make_the_measurement_wild() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, [-50.0, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(1.0, [f64::NAN, 70.0, 1.2]), Verdict::Sound);
    }

    #[test]
    fn a_lasting_step_is_believed_and_larger_errors_are_expected_after_it() {
        let mut gate = trained();
        let found: Vec<Verdict> = (0..8).map(|_| gate.judge(50.0, [1.0, 1.0, 1.0])).collect();
        assert!(found[..5].iter().all(|verdict| *verdict == Verdict::Wild(1.0)));
        assert_eq!(found[5..], [Verdict::Step, Verdict::Sound, Verdict::Sound]);
    }

    #[test]
    fn larger_errors_that_last_are_sound() {
        let mut gate = trained();
        for k in 0..1000 {
            // Grows to 100 times the training's residual within a thousand samples.
            let error = 0.1 + 0.01 * f64::from(k);
            assert_eq!(gate.judge(error, [0.0, 0.0, 0.0]), Verdict::Sound, "{k}");
        }
    }

    #[test]
    fn before_it_has_seen_enough_nothing_is_wild() {
        let mut gate = OutlierGate::default();
        for k in 0..FIRST {
            assert_eq!(gate.judge(f64::from(k * k), [0.0, 0.0]), Verdict::Sound);
        }
    }
}
