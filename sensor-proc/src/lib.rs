//! Encoder acquisition: raw encoder readings, or the rows of a recording, become checked samples.
//!
//! | module | what it holds |
//! |---|---|
//! | [`plausibility`] | the checks of one axis: range, speed, stuck; its pressures |
//! | [`conversion`] | counts of all sensors become positions, those at joints through the mechanism |
//! | [`acquisition`] | readings become samples |
//! | [`replay`] | the rows of a recording become samples and commands |
//! | [`recording`] | reads recordings from CSV files for a replay; before the first tick only |
//! | [`log`] | reads recordings as loggers write them, for identification |
//! | [`process`] | the stage: readings or a recording in, samples out |
//!
//! [`plausibility`], [`conversion`], [`acquisition`] and [`replay`] are the core: they see no clock, no channel and no
//! file, and allocate in their constructors only.

pub mod acquisition;
pub mod conversion;
pub mod log;
pub mod plausibility;
pub mod process;
pub mod recording;
pub mod replay;

pub use acquisition::{Acquisition, is_implausible};
pub use recording::Recording;
pub use replay::Replay;
