//! Recognises outliers: samples that are far from everything that was predicted of them.
//!
//! ```text
//! e = min over the predictions of |y - y^|         s^2 <- s^2 + (min(e^2, 25 s^2) - s^2) / 100,  at least sigma^2
//! outlier  <=>  e > 30 s  and  e > 3 w
//! ```
//!
//! y output and y^ its predictions, e error, s its usual size, all in the unit of the output. sigma is the standard
//! deviation of the training's residuals, w the usual size of y(k) - y(k-1) over the training. Without w, every change
//! of a plant without noise would be an outlier. The predictions are those of the adaptive model, of the classical
//! model and of persistence, y(k-1). A model that went wrong must not make the measurement an outlier, so the
//! measurement has to be far from all three.
//!
//! In the training s and w are sizes of a driven [`scale`](super::scale). Traps: a mean of squares would take in an
//! early spike, and believe all later ones. Errors of an axis at rest would make its first motion an outlier.
//!
//! Before s and w are known nothing tells an outlier from motion. If the largest error until then turns out to be that
//! of an outlier, the training begins anew.
//!
//! An outlier is not learned from and not counted in the errors. A prediction takes its place among the past outputs;
//! otherwise every model would predict from the outlier for the next na samples.
//!
//! Trap: after an encoder was set to another zero, every sample is an outlier. After [`LONGEST`] outliers in a row the
//! measurement is therefore believed, as a step of the output. A long dropout is a step too, and another one at its
//! end. s stays as it is after a step: with s as large as the step, every later dropout would be believed. s grows only
//! where one step follows upon another, because then the errors have become larger for good. It grows no further than
//! needed.

use super::scale::Scale;

/// An outlier has an error above this many times its usual size, and above this many times the usual increment of the
/// output. Motion, load steps and end stops stay far below.
const LIMIT: (f64, f64) = (30.0, 3.0);
/// [`LIMIT`] during training, larger because an axis that starts to move after a rest must not be an outlier.
const LIMIT_OF_TRAINING: (f64, f64) = (100.0, 3.0);
/// Another limit during training: no axis moves that many usual increments within a sample. At long periods, where the
/// errors of an unknown motion are large themselves, a spike stays below [`LIMIT_OF_TRAINING`].
const LEAP: (f64, f64) = (10.0, 8.0);
/// Number of outliers in a row that are not believed.
pub const LONGEST: u32 = 5;
/// Memory of s, in samples.
const MEMORY: u64 = 100;
/// Samples within which one step follows upon another: two runs of outliers with the refilled past between them.
const NEXT_STEP: u32 = 30;
/// Steps that follow upon one another before s grows. Two dropouts make four steps.
const STEPS: u32 = 4;
/// What an error that has made s grow is then to the smallest error of an outlier.
const GROWN: f64 = 0.5;

/// The outlier gate of one output. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct OutlierGate {
    /// sigma.
    floor: f64,
    /// y(k) - y(k-1) over the training.
    increments: Scale,
    /// Errors.
    errors: Scale,
    /// Largest error so far, until the sizes of errors and increments are known.
    first_errors: Option<f64>,
    /// Outliers in a row.
    outliers: u32,
    /// Steps that followed upon one another.
    steps: u32,
    /// Samples since the last step.
    since_step: u32,
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

impl Default for OutlierGate {
    fn default() -> Self {
        Self {
            floor: 0.0,
            increments: Scale::new(u64::MAX),
            errors: Scale::new(MEMORY),
            first_errors: Some(0.0),
            outliers: 0,
            steps: 0,
            since_step: NEXT_STEP,
        }
    }
}

impl OutlierGate {
    /// Ends the training. From here on errors are compared with `sigma`, the standard deviation of its residuals.
    pub fn trained(&mut self, sigma: f64) {
        (self.floor, self.outliers, self.first_errors) = (sigma, 0, None);
        self.errors.set(sigma);
    }

    /// s, the usual size of the error, in the unit of the output.
    pub fn size(&self) -> f64 {
        self.errors.size().unwrap_or(0.0).max(self.floor)
    }

    /// Takes in y(k) - y(k-1) of a training sample. `driven`: a command has opened the valve of late. Returns whether
    /// the sizes have just become known, and an error before was that of an outlier.
    pub fn collect(&mut self, increment: f64, driven: bool) -> bool {
        self.increments.push(increment, driven);
        let known = self.errors.size().and(self.increments.size()).is_some();
        known && self.first_errors.take().is_some_and(|largest| self.is_far(largest))
    }

    /// Judges `y` by its predictions. `driven`: a command has opened the valve of late.
    pub fn judge(&mut self, y: f64, predictions: &[f64], driven: bool) -> Verdict {
        let error = predictions.iter().map(|predicted| (y - predicted).abs()).fold(f64::INFINITY, f64::min);
        self.since_step = self.since_step.saturating_add(1);
        if self.is_far(error) {
            self.outliers += 1;
            if self.outliers <= LONGEST {
                return Verdict::Outlier;
            }
            self.step(error);
            return Verdict::Step;
        }
        self.outliers = 0;
        self.first_errors = self.first_errors.map(|largest| largest.max(error));
        self.errors.push(error, driven);
        Verdict::Sound
    }

    /// Judges `y` by the output before, while the past is too short for a prediction. Two levels in one regressor row
    /// would do more damage than any outlier.
    pub fn judge_refill(&mut self, y: f64, before: f64) -> Verdict {
        self.since_step = self.since_step.saturating_add(1);
        let error = (y - before).abs();
        if !self.is_far(error) {
            self.first_errors = self.first_errors.map(|largest| largest.max(error));
            return Verdict::Sound;
        }
        self.step(error);
        Verdict::Step
    }

    /// The smallest error of an outlier; `None` before enough samples were seen.
    fn limit(&self) -> Option<f64> {
        self.errors.size()?;
        let (size, increment) = (self.size(), self.increments.size());
        let limit = |limit: (f64, f64)| (limit.0 * size).max(limit.1 * increment.unwrap_or(0.0));
        if self.floor > 0.0 {
            return Some(limit(LIMIT));
        }
        let leap = increment.map_or(f64::INFINITY, |_| limit(LEAP));
        Some(limit(LIMIT_OF_TRAINING).min(leap))
    }

    fn is_far(&self, error: f64) -> bool {
        self.limit().is_some_and(|limit| error > limit)
    }

    fn step(&mut self, error: f64) {
        self.steps = if self.since_step <= NEXT_STEP { self.steps + 1 } else { 1 };
        (self.outliers, self.since_step) = (0, 0);
        if let (true, Some(limit)) = (self.steps >= STEPS, self.limit()) {
            self.errors.set(self.size() * (error / limit) / GROWN);
        }
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
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0], true), Verdict::Sound);
        assert_eq!(gate.judge(100.0, &[1.1, 0.9, 1.0], true), Verdict::Outlier);
        assert_eq!(gate.judge(1.0, &[1.1, 0.9, 1.0], true), Verdict::Sound);
        assert!((gate.size() - 0.1).abs() < 1e-3);
    }

    #[test]
    fn without_noise_an_error_no_larger_than_the_motion_is_sound() {
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| assert!(!gate.collect(0.5, true)));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.4, &[1.0, 1.0, 1.0], true), Verdict::Sound);
        let mut gate = OutlierGate::default();
        (0..200).for_each(|_| assert!(!gate.collect(0.5, true)));
        gate.trained(1e-15);
        assert_eq!(gate.judge(2.6, &[1.0, 1.0, 1.0], true), Verdict::Outlier);
    }

    #[test]
    fn a_model_gone_wrong_does_not_make_the_measurement_an_outlier() {
        let mut gate = trained();
        assert_eq!(gate.judge(1.0, &[-50.0, 0.9, 1.0], true), Verdict::Sound);
        assert_eq!(gate.judge(1.0, &[f64::NAN, 70.0, 1.2], true), Verdict::Sound);
    }

    #[test]
    fn a_lasting_step_is_believed_and_a_dropout_after_it_is_none() {
        let mut gate = trained();
        let judge = |gate: &mut OutlierGate, y: f64, before: f64| gate.judge(y, &[before; 3], true);
        let found: Vec<Verdict> = (0..6).map(|_| judge(&mut gate, 50.0, 1.0)).collect();
        assert!(found[..5].iter().all(|verdict| *verdict == Verdict::Outlier));
        assert_eq!(found[5], Verdict::Step);
        assert_eq!(gate.judge_refill(50.1, 50.0), Verdict::Sound);
        (0..40).for_each(|_| assert_eq!(judge(&mut gate, 50.0, 50.0), Verdict::Sound));
        assert_eq!(judge(&mut gate, 0.0, 50.0), Verdict::Outlier);
    }

    #[test]
    fn while_the_past_is_refilled_no_level_is_combined_with_another() {
        let mut gate = trained();
        (0..6).for_each(|_| {
            let _ = gate.judge(50.0, &[1.0; 3], true);
        });
        assert_eq!(gate.judge_refill(1.0, 50.0), Verdict::Step);
        assert_eq!(gate.judge_refill(1.1, 1.0), Verdict::Sound);
    }

    #[test]
    fn errors_that_stay_large_are_sound_in_the_end() {
        let mut gate = trained();
        let mut y = 0.0;
        let found: Vec<Verdict> = (0..40)
            .map(|_| {
                y += 50.0;
                gate.judge(y, &[y - 50.0; 3], true)
            })
            .collect();
        assert_eq!(found.iter().filter(|verdict| **verdict == Verdict::Step).count(), STEPS as usize);
        assert!(found[24..].iter().all(|verdict| *verdict == Verdict::Sound));
    }

    #[test]
    fn errors_that_grow_slowly_are_sound() {
        let mut gate = trained();
        for k in 0..1000 {
            // The error grows to 100 times the training's residual within a thousand samples.
            let error = 0.1 + 0.01 * f64::from(k);
            assert_eq!(gate.judge(error, &[0.0, 0.0, 0.0], true), Verdict::Sound, "{k}");
        }
    }

    #[test]
    fn the_first_samples_of_the_training_are_never_outliers() {
        let mut gate = OutlierGate::default();
        for k in 0..100 {
            assert_eq!(gate.judge((k * k) as f64, &[0.0, 0.0], true), Verdict::Sound);
        }
    }

    #[test]
    fn an_early_spike_does_not_hide_a_later_one() {
        let mut gate = OutlierGate::default();
        for k in 0..100 {
            gate.judge(if k == 20 { 1e3 } else { 0.1 }, &[0.0], true);
        }
        assert!((gate.size() - 0.1).abs() < 1e-12);
        assert_eq!(gate.judge(1e3, &[0.0], true), Verdict::Outlier);
    }

    #[test]
    fn the_first_motion_after_a_rest_is_sound() {
        let mut gate = OutlierGate::default();
        (0..10_000).for_each(|_| {
            let _ = gate.judge(1e-6, &[0.0], false);
        });
        (0..100).for_each(|_| assert_eq!(gate.judge(1.0, &[0.0], true), Verdict::Sound));
    }
}
