//! Protection of the machine: what a command may be, and which faults stop an axis.
//!
//! | module | what it holds |
//! |---|---|
//! | [`limits`] | largest magnitude and rate of a command |
//! | [`end_stops`] | commands near the soft limits |
//! | [`following_error`] | the bound on the difference between reference and position |
//! | [`motion`] | whether an axis that is driven moves |
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod end_stops;
pub mod following_error;
pub mod limits;
pub mod motion;
