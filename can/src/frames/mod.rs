//! Frames of other protocols: signals in them, alive counters and checksums, and data bases that describe them.
//!
//! | file | what it holds |
//! |---|---|
//! | `signal` | one value within the bytes of a frame |
//! | `guard` | alive counter and checksum |
//! | `layout` | identifier, bytes and kind of the frames of a message |
//! | `database` | messages with their signals: of a DBC file, or written in the machine file |

mod database;
mod guard;
mod layout;
mod signal;

pub use database::{Database, DatabaseError, Message, NamedSignal, UnknownName};
pub use guard::{Checksum, Guard, Verdict};
pub use layout::Layout;
pub use signal::{Signal, SignalError};
