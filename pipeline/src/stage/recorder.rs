//! Waiting for a recorder in lock-step.
//!
//! Lock-step goes on as fast as the computer allows, and a channel keeps a limited number of messages. Without waiting,
//! a recorder that gets no core for a moment would miss some, and the run could not be repeated from its recording.

use super::{StageError, StageOptions, Turn, Waiter};
use crate::channel::Board;

/// Ticks that the loop may be ahead of the recorder: half of the messages that the shortest channel with a message for
/// each tick keeps, those of the snapshots.
const AHEAD: u64 = 32;

/// Holds the source of the ticks back while the recorder of the group is behind.
#[derive(Debug)]
pub struct RecorderGate {
    /// None without a recorder to wait for.
    board: Option<Board>,
}

impl RecorderGate {
    /// Of a group with this board. It never holds a stage back whose `options` name no recorder.
    pub fn new(board: Board, options: &StageOptions) -> Self {
        Self { board: options.is_recorded.then_some(board) }
    }

    /// Waits for a slice of time until tick `next` may begin; false while it may not.
    ///
    /// # Errors
    /// None by itself; those of [`Turn::wait_for`].
    pub fn admits(&self, turn: &mut Turn, next: u64) -> Result<bool, StageError> {
        let Some(board) = &self.board else { return Ok(true) };
        turn.wait_for(&Waiter::Yield, || Ok(board.recorded().saturating_add(AHEAD) > next))
    }
}
