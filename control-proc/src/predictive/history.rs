//! Past outputs and commands of one axis, newest first.
//!
//! ```text
//! at tick k, before the command is made:   outputs  y(k), y(k-1), ..      commands  u(k-1), u(k-2), ..
//! ```
//!
//! y position in m, u valve command as it was sent. Both lists are ordered from the newest to the oldest. Commands are
//! kept instead of x = N(u), since N changes with every snapshot. What was sent after all limits is what moved the
//! axis, so saturation cannot wind up the model.
//!
//! Trap: a tick without a position leaves a gap. A held position that is followed by the leap to the next good one
//! looks like a sudden speed to a controller that works on differences. So a gap is filled by a straight line once the
//! position after it is known.

use pipeline::hammerstein::{MAX_A, MAX_DELAY, MAX_LINEAR};

/// Ticks of the past for which the noise of a model is computed.
pub const TRIED: usize = 104;
/// Outputs kept: a difference for each of these ticks, and for the ticks before them up to the highest order of A.
pub const OUTPUTS: usize = MAX_A + 1 + TRIED;
/// Commands kept: for these ticks, the longest delay and the order of B, with one more for the oldest difference.
pub const COMMANDS: usize = MAX_DELAY + MAX_LINEAR + TRIED;

/// Past outputs and commands.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    outputs: [f64; OUTPUTS],
    commands: [f64; COMMANDS],
    /// Outputs taken in so far.
    count: u64,
}

impl History {
    /// The history of an axis that has always stood at `position` (m), at neutral.
    pub fn resting(position: f64) -> Self {
        Self { outputs: [position; OUTPUTS], commands: [0.0; COMMANDS], count: 0 }
    }

    /// y(k), y(k-1), .., m.
    pub fn outputs(&self) -> &[f64; OUTPUTS] {
        &self.outputs
    }

    /// u(k-1), u(k-2), ..
    pub fn commands(&self) -> &[f64; COMMANDS] {
        &self.commands
    }

    /// Number of outputs taken in so far, including those of missing ticks.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Takes in a position (m) that follows `missing` ticks without one.
    pub fn push_output(&mut self, position: f64, missing: u64) {
        let before = self.outputs[0];
        let new = usize::try_from(missing).map_or(OUTPUTS, |missing| missing.saturating_add(1).min(OUTPUTS));
        self.outputs.copy_within(..OUTPUTS - new, new);
        self.count += new as u64;
        let slope = (position - before) / (missing as f64 + 1.0);
        for (i, output) in self.outputs[..new].iter_mut().enumerate() {
            *output = position - slope * i as f64;
        }
    }

    /// Takes in the command that was sent.
    pub fn push_command(&mut self, command: f64) {
        self.commands.copy_within(..COMMANDS - 1, 1);
        self.commands[0] = command;
    }

    /// Puts a command in the place of the last one.
    pub fn replace_command(&mut self, command: f64) {
        self.commands[0] = command;
    }

    /// Repeats the last command, which stayed on the valve for so many more ticks.
    pub fn hold_command(&mut self, ticks: u64) {
        for _ in 0..ticks.min(COMMANDS as u64) {
            self.push_command(self.commands[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_filled_by_a_straight_line() {
        let mut history = History::resting(1.0);
        history.push_output(2.0, 0);
        history.push_output(5.0, 2);
        assert_eq!(history.outputs()[..5], [5.0, 4.0, 3.0, 2.0, 1.0]);
        history.push_output(6.0, u64::MAX);
        assert!(history.outputs().iter().all(|y| (5.0..=6.0).contains(y)));
    }

    #[test]
    fn a_command_is_held_over_missing_ticks() {
        let mut history = History::resting(0.0);
        history.push_command(0.1);
        history.push_command(0.2);
        history.hold_command(2);
        assert_eq!(history.commands()[..5], [0.2, 0.2, 0.2, 0.1, 0.0]);
        history.hold_command(u64::MAX);
        assert!(history.commands().iter().all(|&u| u == 0.2));
    }
}
