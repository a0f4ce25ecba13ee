//! Whether the axis rests: then a sample says nothing that the ones before it have not said.
//!
//! ```text
//! rests  <=>  |y - y_0| <= 1 % of the travel  and  |u - u_0| <= 1 % of the commands,  for longer than the horizon
//! ```
//!
//! y_0 and u_0 output and command when the watch began; travel, the root mean square of y(k) - y(k-h) over the
//! training; commands, the largest magnitude of u there. The watch begins anew whenever either leaves its band.
//!
//! Trap: at rest the regressor repeats but for the noise of the encoder, so forgetting estimators forget the motion
//! and learn the noise, and every model predicts well. A slow creep is no rest: it leaves the band in time.

use pipeline::statistics::ErrorStatistics;

/// Part of the travel and of the commands that counts as none.
const SHARE: f64 = 0.01;

/// Watches one axis.
#[derive(Debug, Clone, Default)]
pub struct RestDetection {
    horizon: u64,
    travel: ErrorStatistics,
    largest_command: f64,
    output: f64,
    command: f64,
    since: u64,
}

impl RestDetection {
    /// For a horizon in samples.
    pub fn new(horizon: usize) -> Self {
        Self { horizon: horizon as u64, ..Self::default() }
    }

    /// Takes in the travel over the horizon, if it is known, and the command of a sample of the training.
    pub fn collect(&mut self, travel: Option<f64>, command: f64) {
        if let Some(travel) = travel {
            self.travel.push(travel);
        }
        self.largest_command = self.largest_command.max(command.abs());
    }

    /// Takes in a sample: its output and the command before it. Returns whether the axis rests.
    pub fn update(&mut self, output: f64, command: f64) -> bool {
        // Without travel in the training nothing is known of what a motion is.
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
    fn it_rests_when_neither_moves_for_longer_than_the_horizon() {
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
    fn what_never_moved_never_rests() {
        let mut rest = RestDetection::new(5);
        assert!((0..100).all(|k| !rest.update(0.1 * f64::from(k % 2), 0.0)));
    }
}
