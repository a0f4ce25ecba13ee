//! Recognises outliers: samples that are far from everything that was predicted of them.
//!
//! ```text
//! e = min over the predictions of |y - y^|         s^2 <- s^2 + (min(e^2, 25 s^2) - s^2) / 100,  at least sigma^2
//! outlier  <=>  e > 30 s  and  e > 3 w
//! ```
//!
//! y output and y^ its predictions, e error, s its usual size, all in the unit of the output. sigma is the standard
//! deviation of the training's residuals, w the root mean square of y(k) - y(k-1) over the training. Without w, every
//! change of a plant without noise would be an outlier. The predictions are those of the adaptive model, of the
//! classical model and of persistence, y(k-1). A model that went wrong must not make the measurement an outlier, so the
//! measurement has to be far from all three.
//!
//! An outlier is not learned from and not counted in the errors. A prediction takes its place among the past outputs;
//! otherwise every model would predict from the outlier for the next na samples.
//!
//! Trap: after an encoder was set to another zero, every sample is an outlier. After [`LONGEST`] outliers in a row the
//! measurement is therefore believed.

use pipeline::statistics::ErrorStatistics;

/// An error above this many times its usual size may be an outlier. Motion, load steps and end stops stay far below.
const LIMIT: f64 = 30.0;
/// [`LIMIT`] during training, larger because an axis that starts to move after a rest must not be an outlier.
const LIMIT_OF_TRAINING: f64 = 100.0;
/// An error below this many times the usual increment of the output is never an outlier.
const LEAST_INCREMENTS: f64 = 3.0;
/// Largest square of an error that its usual size takes in, in squares of that size.
const LARGEST_SQUARE: f64 = 25.0;
/// Number of outliers in a row that are not believed.
pub const LONGEST: u32 = 5;
/// Samples of the training before the first one that can be an outlier; then also the memory of s, in samples.
const FIRST: u32 = 100;

/// The outlier gate of one output.
#[derive(Debug, Clone, Copy, Default)]
pub struct OutlierGate {
    /// sigma.
    floor: f64,
    /// y(k) - y(k-1) over the training.
    increments: ErrorStatistics,
    /// s^2.
    mean_square: f64,
    seen: u32,
    /// Outliers in a row.
    outliers: u32,
}

/// What to do with a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Use the sample.
    Sound,
    /// Do not use the sample.
    Outlier,
    /// The output has stepped: believe the samples from here on, and use none before.
    Step,
}

impl OutlierGate {
    /// Ends the training. From here on errors are compared with `sigma`, the standard deviation of its residuals.
    pub fn trained(&mut self, sigma: f64) {
        *self = Self { floor: sigma, mean_square: sigma * sigma, seen: FIRST, outliers: 0, ..*self };
    }

    /// s, the usual size of the error, in the unit of the output.
    pub fn size(&self) -> f64 {
        self.mean_square.sqrt().max(self.floor)
    }

    /// Takes in y(k) - y(k-1) of a training sample.
    pub fn collect(&mut self, increment: f64) {
        self.increments.push(increment);
    }

    /// Judges `y` by its predictions.
    pub fn judge(&mut self, y: f64, predictions: &[f64]) -> Verdict {
        let error = predictions.iter().map(|predicted| (y - predicted).abs()).fold(f64::INFINITY, f64::min);
        let size = self.size();
        let increment = if self.increments.count > 0 { self.increments.rmse() } else { 0.0 };
        let limit = if self.floor > 0.0 { LIMIT } else { LIMIT_OF_TRAINING };
        if self.seen >= FIRST && error > limit * size && error > LEAST_INCREMENTS * increment {
            self.outliers += 1;
            if self.outliers <= LONGEST {
                return Verdict::Outlier;
            }
            // After the step, errors of this size are expected.
            (self.outliers, self.mean_square) = (0, error * error);
            return Verdict::Step;
        }
        self.outliers = 0;
        // Over the first samples of the training s^2 is the mean of all squares so far.
        self.seen = (self.seen + 1).min(FIRST);
        let share = 1.0 / f64::from(self.seen);
        let square = error * error;
        let square = if self.seen < FIRST { square } else { square.min(LARGEST_SQUARE * size * size) };
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
    fn a_spike_is_an_outlier_and_the_sample_after_it_is_sound() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(100.0, &[1.1, 0.9, 1.0]), Verdict::Outlier);
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0]), Verdict::Sound);
        assert!((gate.size() - 0.1).abs() < 1e-3);
    }

    #[test]
    fn without_noise_an_error_no_larger_than_the_motion_is_sound() {
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| gate.collect(0.5));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.4, &[1.0, 1.0, 1.0]), Verdict::Sound);
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| gate.collect(0.5));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.6, &[1.0, 1.0, 1.0]), Verdict::Outlier);
    }

    #[test]
    fn a_model_gone_wrong_does_not_make_the_measurement_an_outlier() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, &[-50.0, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(1.0, &[f64::NAN, 70.0, 1.2]), Verdict::Sound);
    }

    #[test]
    fn a_lasting_step_is_believed_and_larger_errors_are_expected_after_it() {
        let mut gate = trained();
        let found: Vec<Verdict> = (0..8).map(|_| gate.judge(50.0, &[1.0, 1.0, 1.0])).collect();
        assert!(found[..5].iter().all(|verdict| *verdict == Verdict::Outlier));
        assert_eq!(found[5..], [Verdict::Step, Verdict::Sound, Verdict::Sound]);
    }

    #[test]
    fn errors_that_grow_slowly_are_sound() {
        let mut gate = trained();
        for k in 0..1000 {
            // The error grows to 100 times the training's residual within a thousand samples.
            let error = 0.1 + 0.01 * f64::from(k);
            assert_eq!(gate.judge(error, &[0.0, 0.0, 0.0]), Verdict::Sound, "{k}");
        }
    }

    #[test]
    fn the_first_samples_of_the_training_are_never_outliers() {
        let mut gate = OutlierGate::default();
        for k in 0..FIRST {
            assert_eq!(gate.judge(f64::from(k * k), &[0.0, 0.0]), Verdict::Sound);
        }
    }
}
