//! Tells a wild sample from a sound one.
//!
//! ```text
//! e = min over the predictors of |y - y^|          s^2 <- s^2 + (min(e^2, 25 s^2) - s^2) / 100,  at least sigma^2
//! wild  <=>  e > 30 s  and  e > 3 w
//! ```
//!
//! y in the unit of the output, sigma the standard deviation of the training's residuals, w the root mean square of
//! y(k) - y(k-1) over the training: without noise every change of the plant would be wild. The predictors are the
//! adaptive and the classical model and the sample before: a model that went wrong must not call the measurement wrong,
//! so all of them have to disagree with it. A wild sample is not learned from and not counted in the errors; its place
//! in the history is taken by a prediction, or every model would predict from it for the next na samples.
//!
//! Trap: an encoder that is set to another zero is wild at every sample from then on. After [`LONGEST`] in a row the
//! measurement is believed.

use pipeline::statistics::ErrorStatistics;

/// Errors beyond this many times their usual size are wild: motion, load steps and end stops stay far below.
const LIMIT: f64 = 30.0;
/// The same before there is a model: an axis that sets out after a rest is not to be called wild.
const LIMIT_OF_TRAINING: f64 = 100.0;
/// Errors below this many times the usual increment of the output are not.
const LEAST_INCREMENTS: f64 = 3.0;
/// Wild samples in a row that are not believed.
pub const LONGEST: u32 = 5;
/// Samples of the training before anything can be called wild.
const FIRST: u32 = 100;

/// Watches the samples of one output.
#[derive(Debug, Clone, Copy, Default)]
pub struct OutlierGate {
    floor: f64,
    /// y(k) - y(k-1) over the training.
    increments: ErrorStatistics,
    mean_square: f64,
    seen: u32,
    wild: u32,
}

/// What to make of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Use it.
    Sound,
    /// Do not use it.
    Wild,
    /// Believe it from here on, and nothing before it.
    Step,
}

impl OutlierGate {
    /// From here on, sizes are measured against `sigma`, the residuals of the training.
    pub fn trained(&mut self, sigma: f64) {
        *self = Self { floor: sigma, mean_square: sigma * sigma, seen: FIRST, wild: 0, ..*self };
    }

    /// The usual size of the error, in the unit of the output.
    pub fn size(&self) -> f64 {
        self.mean_square.sqrt().max(self.floor)
    }

    /// Takes in y(k) - y(k-1) of a sample of the training.
    pub fn collect(&mut self, increment: f64) {
        self.increments.push(increment);
    }

    /// Judges `y` by what was predicted of it.
    pub fn judge(&mut self, y: f64, predictions: &[f64]) -> Verdict {
        let error = predictions.iter().map(|predicted| (y - predicted).abs()).fold(f64::INFINITY, f64::min);
        let size = self.size();
        let increment = if self.increments.count > 0 { self.increments.rmse() } else { 0.0 };
        let limit = if self.floor > 0.0 { LIMIT } else { LIMIT_OF_TRAINING };
        if self.seen >= FIRST && error > limit * size && error > LEAST_INCREMENTS * increment {
            self.wild += 1;
            if self.wild <= LONGEST {
                return Verdict::Wild;
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
    fn a_spike_is_wild_and_what_follows_is_not() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(100.0, &[1.1, 0.9, 1.0]), Verdict::Wild);
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0]), Verdict::Sound);
        assert!((gate.size() - 0.1).abs() < 1e-3);
    }

    #[test]
    fn without_noise_what_is_no_larger_than_the_motion_is_sound() {
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| gate.collect(0.5));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.4, &[1.0, 1.0, 1.0]), Verdict::Sound);
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| gate.collect(0.5));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.6, &[1.0, 1.0, 1.0]), Verdict::Wild);
    }

    #[test]
    fn a_model_gone_wrong_does_not_make_the_measurement_wild() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, &[-50.0, 0.9, 1.0]), Verdict::Sound);
        assert_eq!(gate.judge(1.0, &[f64::NAN, 70.0, 1.2]), Verdict::Sound);
    }

    #[test]
    fn a_lasting_step_is_believed_and_larger_errors_are_expected_after_it() {
        let mut gate = trained();
        let found: Vec<Verdict> = (0..8).map(|_| gate.judge(50.0, &[1.0, 1.0, 1.0])).collect();
        assert!(found[..5].iter().all(|verdict| *verdict == Verdict::Wild));
        assert_eq!(found[5..], [Verdict::Step, Verdict::Sound, Verdict::Sound]);
    }

    #[test]
    fn larger_errors_that_last_are_sound() {
        let mut gate = trained();
        for k in 0..1000 {
            // Grows to 100 times the training's residual within a thousand samples.
            let error = 0.1 + 0.01 * f64::from(k);
            assert_eq!(gate.judge(error, &[0.0, 0.0, 0.0]), Verdict::Sound, "{k}");
        }
    }

    #[test]
    fn before_it_has_seen_enough_nothing_is_wild() {
        let mut gate = OutlierGate::default();
        for k in 0..FIRST {
            assert_eq!(gate.judge(f64::from(k * k), &[0.0, 0.0]), Verdict::Sound);
        }
    }
}
