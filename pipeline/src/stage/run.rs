//! Runs a stage from start to end.

use super::{Next, Options, StageError, StageKind, Turn, rights};
use crate::{channel::Group, machine::Machine};

/// A stage: a core between its channels.
pub trait Stage {
    /// Waits for input for a slice of time and, when it came, works one tick and sends its output.
    ///
    /// # Errors
    /// The stage cannot go on.
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError>;

    /// Hands the newest output to readers that have come since; called when there is nothing else to do.
    fn greet(&self);

    /// The last act: whatever moves the machine becomes neutral.
    ///
    /// # Errors
    /// The last message cannot be sent.
    fn stop(&mut self) -> Result<(), StageError>;

    /// Messages lost on the channels it reads.
    fn lost(&self) -> u64;
}

/// Sets up rights and channels, then turns until the last tick, the stop flag, or an error.
///
/// `build` opens the channels and takes all memory. What rights are missing is printed before the loop begins.
///
/// # Errors
/// The stage cannot be set up or cannot go on.
pub fn run<S: Stage>(
    kind: StageKind,
    machine: &Machine,
    options: Options,
    build: impl FnOnce(&Group) -> Result<S, StageError>,
) -> Result<(), StageError> {
    let missing = rights::apply(machine, kind)?;
    for missing in missing.iter().filter(|_| options.warn) {
        eprintln!("{}: warning: {missing}", kind.name());
    }
    let group = Group::join(&options.prefix, kind.name())?;
    let mut turn = Turn::new(&group, kind, machine.timing.period, options)?;
    let mut stage = build(&group)?;
    let ended = turns(&mut stage, &mut turn);
    // Neutral first, whatever happened.
    let stopped = stage.stop();
    let reported = turn.farewell(stage.lost());
    ended.and(stopped).and(reported.map_err(StageError::from))
}

fn turns(stage: &mut impl Stage, turn: &mut Turn) -> Result<(), StageError> {
    turn.beat(stage.lost())?;
    while !turn.stopping() {
        match stage.turn(turn)? {
            Next::Worked => {}
            Next::Waiting => stage.greet(),
            Next::Finished => break,
        }
        turn.beat(stage.lost())?;
    }
    Ok(())
}
