//! Runs a stage from start to end.

use super::{Channels, Next, StageError, StageKind, StageOptions, Turn, monotonic_ns, rights};
use crate::{
    channel::{Board, Group},
    machine::Machine,
};

/// A stage: it connects a core with its channels.
pub trait Stage {
    /// Waits for input for a slice of time. When input comes, works one tick and sends its output.
    ///
    /// # Errors
    /// The stage cannot continue.
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError>;

    /// Delivers the newest output to readers that have attached since; called while the stage has no input.
    fn greet(&self);

    /// The last action of the stage: every command becomes neutral.
    ///
    /// # Errors
    /// The last message cannot be sent.
    fn stop(&mut self) -> Result<(), StageError>;

    /// Calls [`Channels::visit`] with every channel that the stage reads.
    fn channels(&mut self, channels: &mut Channels<'_>);

    /// Sends further messages at a heartbeat; called between two ticks.
    ///
    /// # Errors
    /// The message cannot be sent.
    fn tell(&mut self) -> Result<(), StageError> {
        Ok(())
    }
}

/// Sets up rights and channels, then runs the loop until the last tick, the stop flag, or an error.
///
/// `build` opens the channels and takes all memory. Missing rights are printed before the loop begins.
///
/// # Errors
/// The group runs another machine, or the stage cannot be set up or cannot continue.
pub fn run<S: Stage>(
    kind: StageKind,
    machine: &Machine,
    options: StageOptions,
    build: impl FnOnce(&Group, Board) -> Result<S, StageError>,
) -> Result<(), StageError> {
    let rights = rights::apply(machine, kind, options.clock)?;
    for missing in rights.missing.iter().filter(|_| options.warn) {
        eprintln!("{}: warning: {missing}", kind.name());
    }
    let group = Group::join(&options.prefix, kind.name())?;
    // A process that was killed in this place still holds its place on the channels.
    group.bury_the_dead();
    let board = Board::of(&options.prefix, machine)?;
    let mut turn = Turn::new(&group, machine, kind, options)?;
    let mut stage = build(&group, board)?;
    let ended = turns(&mut stage, &mut turn);
    // Every command becomes neutral first, whatever has happened.
    let stopped = stage.stop();
    let reported = turn.farewell(|accounting| stage.channels(&mut Channels::Account(accounting)));
    drop(rights);
    ended.and(stopped).and(reported.map_err(StageError::from))
}

/// Time without input after which a stage attaches to its channels anew, and after which it does so again, ns. It is
/// far longer than any delay of a sample, and short enough for a person who waits for a group to begin.
const SILENCE_NS: u64 = 1_000_000_000;

fn turns(stage: &mut impl Stage, turn: &mut Turn) -> Result<(), StageError> {
    let mut input_ns = monotonic_ns();
    loop {
        if turn.is_beat_due() {
            turn.beat(|accounting| stage.channels(&mut Channels::Account(accounting)))?;
            stage.tell()?;
        }
        if turn.stopping() {
            return Ok(());
        }
        match stage.turn(turn)? {
            Next::Worked => input_ns = monotonic_ns(),
            Next::Waiting => {
                stage.greet();
                if monotonic_ns().saturating_sub(input_ns) > SILENCE_NS {
                    stage.channels(&mut Channels::Reattach);
                    input_ns = monotonic_ns();
                }
            }
            Next::Finished => return Ok(()),
        }
    }
}
