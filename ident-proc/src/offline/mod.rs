//! Offline identification, step 3 of the paper: what is done once, at the end of training.
//!
//! | question | where |
//! |---|---|
//! | what do the training rows say of the model? | [`batch`] |
//! | how does an estimator of another form start from them? | [`projection`] |
//!
//! It runs in the stage, at one sample or two, and allocates nothing after construction. That sample takes longer than
//! the others.

pub mod batch;
pub mod projection;

pub use batch::{Batch, Offline};
pub use projection::Projection;
