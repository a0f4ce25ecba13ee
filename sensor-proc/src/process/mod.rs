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

use pipeline::{
    machine::{Machine, Source},
    stage::{StageError, StageKind, StageOptions, run as run_stage},
};

use live::Live;
use recorded::Recorded;

/// Runs the stage until the last tick of `options`, the end of the recording, or a signal.
///
/// # Errors
/// The recording cannot be replayed, or a channel cannot be used.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let (clock, first_tick) = (options.clock, options.first_tick);
    match &machine.source {
        Source::Sim | Source::External | Source::Can => {
            run_stage(StageKind::SensorProc, machine, options, |group, board| Live::new(machine, clock, group, board))
        }
        Source::Replay(file) => run_stage(StageKind::SensorProc, machine, options, |group, _| {
            Recorded::new(machine, file, clock, first_tick, group)
        }),
    }
}
