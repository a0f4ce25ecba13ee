//! Offline identification, step 3 of the paper: what is done once, at the end of training.
//!
//! | question | where |
//! |---|---|
//! | when does the training end? | [`training`] |
//! | which model do the training rows give? | [`batch`] |
//! | how does an estimator of another form start from them? | [`projection`] |
//!
//! Rows are collected in the loop, one per sample. They are solved at one or two samples of the whole run, which take
//! longer than the others. Nothing here allocates after construction.

pub mod batch;
pub mod projection;
pub mod training;

pub use batch::{Batch, Offline};
pub use projection::Projection;
pub use training::{Progress, Training};
