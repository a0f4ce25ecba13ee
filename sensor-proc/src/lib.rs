//! Encoder acquisition: where samples come from, and whether they are to be believed.

pub mod record;
