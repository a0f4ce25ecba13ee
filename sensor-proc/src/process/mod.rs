//! The stage: readings or the rows of a recording in, samples out.
//!
//! | module | what it holds |
//! |---|---|
//! | `live` | the stage with the sources `sim`, `external` and `can` |
//! | `recorded` | the stage with the source `replay` |
//! | `timer` | release of ticks in real time |
//! | `output` | publisher of the samples |

mod live;
mod output;
mod recorded;
mod timer;

use std::{error::Error, path::Path};

use pipeline::{
    machine::{Machine, Source},
    stage::{StageError, StageKind, StageOptions, run as run_stage},
};

use crate::{recording::Recording, replay::Replay};
use live::Live;
use recorded::Recorded;

/// Reads the recordings of all axes of a machine from the file that its source `replay` names, before the loop begins.
/// [`Recording::read_all`] reads CSV.
pub type ReadRecordings = fn(&Machine, &Path) -> Result<Vec<Recording>, Box<dyn Error + Send + Sync>>;

/// Runs the stage until the last tick of `options`, the end of the recording, or a signal. A recording is CSV.
///
/// # Errors
/// The recording cannot be replayed, or a channel cannot be used.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    run_with(machine, options, |machine, file| Ok(Recording::read_all(machine, file)?))
}

/// As [`run`], with a recording that `read` reads.
///
/// # Errors
/// As [`run`].
pub fn run_with(machine: &Machine, options: StageOptions, read: ReadRecordings) -> Result<(), StageError> {
    let clock = options.clock;
    let setup = options.clone();
    match &machine.source {
        Source::Sim | Source::External | Source::Can => {
            run_stage(StageKind::SensorProc, machine, options, |group, board| Live::new(machine, clock, group, board))
        }
        Source::Replay(file) => run_stage(StageKind::SensorProc, machine, options, |group, board| {
            let recordings = read(machine, file).map_err(StageError::Setup)?;
            Recorded::new(Replay::new(machine, recordings), machine, &setup, group, board)
        }),
    }
}
