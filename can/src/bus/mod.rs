//! Buses: what sends and receives frames.
//!
//! | file | bus |
//! |---|---|
//! | `socket` | SocketCAN: an interface of the kernel, such as `can0` |
//! | `claim` | which program may send on an interface |
//! | `slcan`, `serial` | adapters that speak the text protocol slcan over a serial port or a pseudo terminal |
//! | `candump` | a log of `candump -l`, played; writing one |
//! | `memory` | two ends in one process, for tests |
//!
//! Nothing waits but [`Bus::wait`]. A bus that cannot take a frame counts it and does not wait.

mod address;
mod candump;
mod claim;
mod memory;
mod serial;
mod slcan;
mod socket;

use std::{io, time::Duration};

pub use address::{Address, NoAddress, expect_format, listen, open};
pub use candump::{LogError, LogLine, Playback, write_line};
pub use claim::Claim;
pub use memory::{MemoryBus, pair};
pub use serial::pseudo_terminal;
pub use slcan::{BIT_RATES, Decoded, Decoder, MAX_TEXT, SlcanBus, encode};
pub use socket::SocketBus;

use crate::{Counters, Frame, Received};

/// Sends and receives frames.
pub trait Bus {
    /// The next frame that has been received; `None` while there is none. Does not wait.
    ///
    /// # Errors
    /// The adapter is gone or the interface is down.
    fn receive(&mut self) -> Result<Option<Received>, BusError>;

    /// Takes a frame to be sent by the next [`Bus::flush`]. Does not wait: a frame for which there is no room is
    /// counted as unsent, and false is returned.
    ///
    /// # Errors
    /// The adapter is gone or the interface is down.
    fn send(&mut self, frame: &Frame) -> Result<bool, BusError>;

    /// Hands the frames that were taken to the adapter. Does not wait.
    ///
    /// # Errors
    /// The adapter is gone or the interface is down.
    fn flush(&mut self) -> Result<(), BusError>;

    /// Whether it can send frames of CAN FD.
    fn is_flexible(&self) -> bool;

    /// Waits until there is something to receive, for `longest` at most.
    ///
    /// # Errors
    /// The adapter is gone. A signal is no error; it ends the wait.
    fn wait(&mut self, longest: Duration) -> Result<(), BusError>;

    /// What has happened so far.
    fn counters(&self) -> &Counters;
}

/// Why a bus cannot be opened, or cannot be used any more.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The kernel has no CAN, the interface does not exist, or the right is missing.
    #[error("{address}: {what}")]
    Open {
        /// What was opened.
        address: String,
        /// What was wrong, and what would be right.
        what: String,
        /// What the kernel said.
        #[source]
        source: io::Error,
    },
    /// Messages are of CAN FD, and the bus has none.
    #[error(
        "{address}: has no CAN FD, of which messages of the machine file are; allowed: an interface with it, set up at \
         its bit rates as by: ip link set can0 up type can bitrate 500000 dbitrate 2000000 fd on"
    )]
    Classical {
        /// What was opened.
        address: String,
    },
    /// The adapter is unplugged, or the interface is down.
    #[error("the adapter is gone or the interface is down")]
    Gone(#[source] io::Error),
    /// The adapter takes no frames.
    #[error("no frame was taken for 100ms: the bus is full, or the adapter hangs")]
    Full,
    /// The controller of the interface has gone bus-off.
    #[error("bus-off: too many errors on the wire; check wiring, bit rate and terminating resistors")]
    Off,
    /// The adapter or the log has come to its end.
    #[error("the bus has ended")]
    Ended,
}

impl BusError {
    fn open(address: &str, what: &str, source: io::Error) -> Self {
        Self::Open { address: address.to_owned(), what: what.to_owned(), source }
    }
}
