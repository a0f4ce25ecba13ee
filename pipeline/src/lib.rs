//! All that two Hydraxis processes share, and nothing else.
//!
//! | module | what it holds |
//! |---|---|
//! | [`message`] | the plain structs that travel through shared memory |
//! | [`layout`] | the fingerprint by which two programs know that they mean the same bytes |
//! | [`columns`] | columns of numbers out of a CSV file |
//! | [`channel`] | publishers and readers of those messages, one group of channels per run |
//! | [`hammerstein`] | the Hammerstein model: evaluate, predict, invert |
//! | [`machine`] | the machine file |
//! | [`stage`] | the loop that every stage runs, in real time and in lock-step |
//! | [`latency`] | latency histograms |
//! | [`statistics`] | running error statistics |
//!
//! Units are SI throughout; a valve command is dimensionless in [-1, 1], positive extends the cylinder; times
//! are nanoseconds of `CLOCK_MONOTONIC`.

pub mod channel;
pub mod columns;
pub mod hammerstein;
pub mod latency;
pub mod layout;
pub mod machine;
pub mod message;
pub mod stage;
pub mod statistics;

/// The most axes that one machine can have; messages carry fixed arrays of this length.
pub const MAX_AXES: usize = 8;
