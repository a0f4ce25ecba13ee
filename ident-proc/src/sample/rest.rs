//! Detects that an axis rests. A sample at rest adds no information.
//!
//! ```text
//! rests  <=>  |y - y_0| <= 1 % of the travel  and  |u - u_0| <= 1 % of the commands,  for longer than the horizon
//! ```
//!
//! y output in its unit, u command. y_0 and u_0 are output and command when the watch began. The travel is the root
//! mean square of y(k) - y(k-h) over the training, h horizon in samples; the commands are the largest magnitude of u
//! there. The watch begins anew whenever y or u leaves its band.
//!
//! Trap: at rest only the noise of the encoder changes the regressor. Estimators with forgetting then forget the
//! motion and learn the noise, although every model predicts well. A slow creep is not rest: it leaves the band in
//! time.

use pipeline::statistics::ErrorStatistics;

/// Part of the travel, and of the commands, that counts as no motion.
const SHARE: f64 = 0.01;

/// The rest detection of one axis.
#[derive(Debug, Clone, Default)]
pub struct RestDetection {
    horizon: u64,
    travel: ErrorStatistics,
    largest_command: f64,
    /// y_0.
    output: f64,
    /// u_0.
    command: f64,
    /// Samples since the watch began.
    since: u64,
}

impl RestDetection {
    /// For a horizon in samples.
    pub fn new(horizon: usize) -> Self {
        Self { horizon: horizon as u64, ..Self::default() }
    }

    /// Takes in a training sample: its travel over the horizon, if that is known, and the command before it.
    pub fn collect(&mut self, travel: Option<f64>, command: f64) {
        if let Some(travel) = travel {
            self.travel.push(travel);
        }
        self.largest_command = self.largest_command.max(command.abs());
    }

    /// Forgets the training samples so far.
    pub fn restart(&mut self) {
        (self.travel, self.largest_command) = (ErrorStatistics::default(), 0.0);
    }

    /// The travel: root mean square of y(k) - y(k-h) over the training so far, 0 without one.
    pub fn travel(&self) -> f64 {
        if self.travel.count > 0 { self.travel.rmse() } else { 0.0 }
    }

    /// Takes in a sample: its output and the command before it. Returns whether the axis rests.
    pub fn update(&mut self, output: f64, command: f64) -> bool {
        // Without travel in the training the band has no width: such an axis counts as moving at any change.
        let still = (output - self.output).abs() <= SHARE * self.travel.rmse()
            && (command - self.command).abs() <= SHARE * self.largest_command;
        if still {
            self.since += 1;
        } else {
            (self.output, self.command, self.since) = (output, command, 0);
        }
        self.since > self.horizon
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trained() -> RestDetection {
        let mut rest = RestDetection::new(20);
        (0..100).for_each(|k| rest.collect(Some(0.1), f64::from(k) * 0.01 - 0.5));
        rest
    }

    #[test]
    fn an_axis_rests_when_output_and_command_stand_still_for_longer_than_the_horizon() {
        let mut rest = trained();
        let found: Vec<bool> = (0..40).map(|k| rest.update(0.5 + 1e-4 * f64::from(k % 2), 0.001)).collect();
        assert!(found[..21].iter().all(|rests| !rests) && found[21..].iter().all(|rests| *rests), "{found:?}");
    }

    #[test]
    fn a_command_a_motion_or_a_creep_ends_it() {
        for (output, command) in [(0.5, 0.02), (0.502, 0.0), (0.498, 0.0)] {
            let mut rest = trained();
            (0..40).for_each(|_| assert!(!rest.update(0.5, 0.0) || rest.since > 20));
            assert!(!rest.update(output, command), "{output} {command}");
        }
        let mut rest = trained();
        let resting = (0..1000).filter(|k| rest.update(0.5 + 5e-5 * f64::from(*k), 0.0)).count();
        assert_eq!(resting, 0);
    }

    #[test]
    fn without_travel_in_the_training_an_axis_that_moves_never_rests() {
        let mut rest = RestDetection::new(5);
        assert!((0..100).all(|k| !rest.update(0.1 * f64::from(k % 2), 0.0)));
    }
}
