//! The loop that every stage runs, in real time and in lock-step.
//!
//! | clock | what releases a tick |
//! |---|---|
//! | real time | sensor-proc (and plant-sim) by absolute timers; the others follow the data |
//! | lock-step | plant-sim (or a replay) when command and snapshot of the tick before have arrived |
//!
//! After its start a stage's loop allocates nothing, locks nothing, writes no log and no file, and never waits for a
//! reader; it waits only for its input.
//!
//! Every tick has a deadline, one period after its sample was due. An overrun is counted with its cause, and so is a
//! tick that was not worked at all: skipping never hides an overrun ([`Accounting`]).
//!
//! | file | what it holds | runs in the loop |
//! |---|---|---|
//! | `run`, `turn`, `channels` | the loop, one turn of it, the channels that a stage reads | yes |
//! | `accounting` | counters and latencies | yes |
//! | `recorder` | waiting for a recorder, in lock-step | yes |
//! | `rights` | core, priority, locked memory | no: before the loop |
//! | `life` | whether a group goes on, for whoever watches it | no: in other programs |

mod accounting;
mod channels;
mod life;
mod recorder;
mod rights;
mod run;
mod turn;

use std::sync::{Arc, atomic::AtomicBool};

pub use accounting::Accounting;
pub use channels::Channels;
pub use life::{Life, SUPERVISOR};
pub use recorder::RecorderGate;
pub use rights::{Missing, RightError, lock_memory, missing, pin, schedule};
pub use run::{Stage, run};
pub use turn::{Next, Turn, Waiter};

pub use crate::{
    clock::{asleep_ns, monotonic_ns, sleep_until},
    machine::StageKind,
};

use crate::channel::{
    BoardError, ChannelError, JoinError, ListenerError, NotifierError, NotifyError, Prefix, PublisherError,
    ReaderError, ReceiveError, SendError, WaitError,
};

/// What releases a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// The clock of the computer.
    RealTime,
    /// The answer to the tick before, as fast as the computer allows; bit for bit repeatable.
    LockStep,
}

/// How a stage runs; all stages of a group have equal options.
#[derive(Debug, Clone)]
pub struct StageOptions {
    /// Name of the group.
    pub prefix: Prefix,
    /// What releases a tick.
    pub clock: Clock,
    /// The stage ends after so many ticks; without it, at a signal.
    pub ticks: Option<u64>,
    /// Seed of the simulated noise.
    pub seed: u64,
    /// Whether control-proc may move the machine from the start on.
    pub arm: bool,
    /// Number of the first tick of a source that releases ticks by time. A source that was started again continues the
    /// numbers, since its readers take a number that does not rise for a repetition.
    pub first_tick: u64,
    /// Lock-step only: the source of the ticks waits for a recorder, so that it misses no message.
    pub is_recorded: bool,
    /// Whether the stage warns of rights that it could not have; false when the supervisor has warned already.
    pub warn: bool,
    /// Set by a signal: the stage ends soon, with the valve neutral.
    pub stop: Arc<AtomicBool>,
    /// Set by a signal, cleared by the stage: all figures are counted from zero again.
    pub reset: Arc<AtomicBool>,
    /// Set by a signal, cleared by control-proc: all axes are disarmed.
    pub off: Arc<AtomicBool>,
}

/// Why a stage ended before its time.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StageError {
    /// A channel cannot be used.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// A right that the machine file is strict about cannot be had.
    #[error("{0} (the machine file is strict)")]
    Rights(#[source] RightError),
    /// The group runs another machine.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The stage cannot be set up from its machine file.
    #[error(transparent)]
    Setup(Box<dyn std::error::Error + Send + Sync>),
}

impl StageError {
    /// The stage cannot be set up, because of `error`.
    pub fn setup(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Setup(Box::new(error))
    }
}

/// An error of one operation on a channel is a [`StageError::Channel`].
macro_rules! from_operation {
    ($($error:ident),*) => { $(
        impl From<$error> for StageError {
            fn from(error: $error) -> Self {
                Self::Channel(error.into())
            }
        }
    )* };
}
from_operation!(JoinError, PublisherError, ReaderError, NotifierError, ListenerError);
from_operation!(SendError, ReceiveError, NotifyError, WaitError);
