//! The loop that every stage runs, in real time and in lock-step.
//!
//! | clock | who releases a tick |
//! |---|---|
//! | real time | sensor-proc (and plant-sim) by absolute timers; the others follow the data |
//! | lock-step | plant-sim (or a replay) when command and snapshot of the tick before have arrived |
//!
//! After start a stage's loop allocates nothing, locks nothing, writes no log and no file, and never waits for a
//! reader; it waits for its input only.
//!
//! Every tick has a deadline, one period after its sample was due. A miss is counted with its cause, and so is a tick
//! that was not worked at all: an overrun is never hidden by skipping ([`Accounting`]).

mod accounting;
mod channels;
mod clock;
mod rights;
mod run;
mod turn;

use std::sync::{Arc, atomic::AtomicBool};

pub use accounting::Accounting;
pub use channels::Channels;
pub use clock::{monotonic_ns, sleep_until};
pub use rights::{Missing, RightError, lock_memory, missing, pin, schedule};
pub use run::{Stage, run};
pub use turn::{Next, Turn, Waiter};

pub use crate::machine::StageKind;

use crate::channel::{
    ChannelError, JoinError, ListenerError, NotifierError, NotifyError, Prefix, PublisherError, ReaderError,
    ReceiveError, SendError, WaitError,
};

/// What releases a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Time.
    RealTime,
    /// The answer to the tick before, as fast as the machine allows; bit for bit repeatable.
    LockStep,
}

/// How a stage is to run; the same for all stages of a group.
#[derive(Debug, Clone)]
pub struct StageOptions {
    /// The group's channels.
    pub prefix: Prefix,
    /// What releases a tick.
    pub clock: Clock,
    /// End after so many ticks; without it at a signal.
    pub ticks: Option<u64>,
    /// Seed of the simulated noise.
    pub seed: u64,
    /// Whether control-proc may move the machine from the start on.
    pub arm: bool,
    /// Number of the first tick of a source that releases ticks by time: one that was started again goes on where the
    /// numbers are by now, since its readers take a number that does not rise for a repetition.
    pub first_tick: u64,
    /// Whether the stage says which rights it could not have: not where whoever started it has said so.
    pub warn: bool,
    /// Set by a signal: end soon, with the valve neutral.
    pub stop: Arc<AtomicBool>,
    /// Set by a signal, cleared by the stage: count and measure from zero again.
    pub reset: Arc<AtomicBool>,
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
