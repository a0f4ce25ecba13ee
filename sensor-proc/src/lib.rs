//! Encoder acquisition: where samples come from, and whether they are to be believed.
//!
//! | module | what it holds |
//! |---|---|
//! | [`plausibility`] | the core: range, speed and stuck checks of one axis |
//! | [`source`] | the core of each source: encoder readings, a recording |
//! | [`record`] | recordings as CSV files |
//! | [`process`] | the stage: readings in, samples out |

pub mod plausibility;
pub mod process;
pub mod record;
pub mod source;
