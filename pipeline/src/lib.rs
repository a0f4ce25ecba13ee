//! What two Hydraxis processes share, and nothing else.
//!
//! | module | what it holds | runs in a loop |
//! |---|---|---|
//! | [`message`] | the plain structs that travel through shared memory | yes |
//! | [`cdr`] | a message as bytes for recordings and networks, and its schema | no |
//! | [`layout`] | the fingerprint of a message's memory layout, which two programs compare | no |
//! | `clock` | the monotonic clock; [`stage`] exports it | yes |
//! | [`columns`] | columns of numbers from a CSV file | no |
//! | [`channel`] | publishers and readers of the messages, one group of channels per run | its ends |
//! | [`hammerstein`] | the Hammerstein model: evaluate, predict, invert | yes |
//! | [`machine`] | the machine file | no |
//! | [`nearest`] | the names that a mistyped name may have meant | no |
//! | [`stage`] | the loop that every stage runs, in real time and in lock-step | yes |
//! | [`latency`] | latency histograms | yes |
//! | [`statistics`] | running error statistics | yes |
//!
//! Units are SI throughout. A valve command has no unit and lies in [-1, 1]; a positive one extends the cylinder. Times
//! are nanoseconds of `CLOCK_MONOTONIC`. No code that runs in a loop allocates memory, takes a lock or reads a file.

pub mod bounded;
pub mod cdr;
pub mod channel;
mod clock;
pub mod columns;
pub mod hammerstein;
pub mod latency;
pub mod layout;
pub mod machine;
pub mod message;
pub mod nearest;
pub mod stage;
pub mod statistics;

/// Largest number of axes of one machine; messages carry fixed arrays of this length.
pub const MAX_AXES: usize = 8;

/// Longest name of an axis, bytes.
pub const MAX_NAME: usize = 32;
