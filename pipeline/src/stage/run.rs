//! Runs a stage from start to end.

use super::{Channels, Next, StageError, StageKind, StageOptions, Turn, monotonic_ns, rights};
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

    /// Hands every channel that it reads to [`Channels::visit`].
    fn channels(&mut self, channels: &mut Channels<'_>);

    /// Says more at a heartbeat than the loop knows; called between two ticks.
    ///
    /// # Errors
    /// The message cannot be sent.
    fn tell(&mut self) -> Result<(), StageError> {
        Ok(())
    }
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
    options: StageOptions,
    build: impl FnOnce(&Group) -> Result<S, StageError>,
) -> Result<(), StageError> {
    let rights = rights::apply(machine, kind, options.clock)?;
    for missing in rights.missing.iter().filter(|_| options.warn) {
        eprintln!("{}: warning: {missing}", kind.name());
    }
    let group = Group::join(&options.prefix, kind.name())?;
    let mut turn = Turn::new(&group, machine, kind, options)?;
    let mut stage = build(&group)?;
    let ended = turns(&mut stage, &mut turn);
    // Neutral first, whatever happened.
    let stopped = stage.stop();
    let reported = turn.farewell(|accounting| stage.channels(&mut Channels::Account(accounting)));
    drop(rights);
    ended.and(stopped).and(reported.map_err(StageError::from))
}

/// Time without any input after which a stage attaches to its channels anew, and again after as long: far more than any
/// sample is late, and soon enough for whoever waits for a group to begin.
const SILENCE_NS: u64 = 1_000_000_000;

fn turns(stage: &mut impl Stage, turn: &mut Turn) -> Result<(), StageError> {
    let mut heard_ns = monotonic_ns();
    loop {
        if turn.is_beat_due() {
            turn.beat(|accounting| stage.channels(&mut Channels::Account(accounting)))?;
            stage.tell()?;
        }
        if turn.stopping() {
            return Ok(());
        }
        match stage.turn(turn)? {
            Next::Worked => heard_ns = monotonic_ns(),
            Next::Waiting => {
                stage.greet();
                if monotonic_ns().saturating_sub(heard_ns) > SILENCE_NS {
                    stage.channels(&mut Channels::Reattach);
                    heard_ns = monotonic_ns();
                }
            }
            Next::Finished => return Ok(()),
        }
    }
}
