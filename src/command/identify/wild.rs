//! Commands that are far beyond all others of a recording: a logger's mistake, which a polynomial of the command makes
//! the largest number of the whole fit.
//!
//! ```text
//! wild  <=>  |u| > 3 q        q largest |u| of all rows but the largest 0.2 %, at least one
//! ```
//!
//! Outputs have a gate of their own in the identifier: what an axis can do within a sample bounds them. A command may
//! jump, so one is told by its size only, and the recording is not used as if it were sound.

use serde::Serialize;

/// How far beyond the others a wild command is.
const FACTOR: f64 = 3.0;
/// One row of so many may be left out of the usual size.
const ROWS: usize = 500;

/// A wild command.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WildCommand {
    /// Its row of all recordings, from 1.
    pub row: usize,
    /// The command.
    pub command: f64,
    /// The largest of the others, without its sign.
    pub others: f64,
}

/// The largest command, where it is wild.
pub fn wildest(inputs: &[f64]) -> Option<WildCommand> {
    let mut sizes: Vec<f64> = inputs.iter().map(|u| u.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let others = *sizes.iter().rev().nth((inputs.len() / ROWS).max(1))?;
    let (row, command) = inputs.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    (others > 0.0 && command.abs() > FACTOR * others).then_some(WildCommand { row: row + 1, command: *command, others })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_far_beyond_the_others_is_wild_and_a_large_one_is_not() {
        let mut inputs: Vec<f64> = (0..2000).map(|k| 0.3 * (f64::from(k) * 0.1).sin()).collect();
        assert_eq!(wildest(&inputs), None);
        (inputs[700], inputs[900]) = (0.85, -0.8);
        assert_eq!(wildest(&inputs), None);
        inputs[900] = -30.0;
        let found = wildest(&inputs).unwrap();
        assert!(found.row == 901 && found.command == -30.0 && found.others < 0.31, "{found:?}");
        // Pulses that are rare, but more than one row in five hundred.
        let pulses: Vec<f64> = (0..2000).map(|k| if k % 300 == 0 { 0.9 } else { 0.01 }).collect();
        assert_eq!((wildest(&pulses), wildest(&[0.0; 50]), wildest(&[])), (None, None, None));
    }
}
