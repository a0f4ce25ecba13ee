//! What happens to a sample before an estimator learns from it: step 4 of the paper.
//!
//! | question | where |
//! |---|---|
//! | which outputs and commands belong to the sample? | [`past`], stored in a [`buffer`] |
//! | which regressor row do they give? | [`row`] |
//! | is the sample an outlier? | [`outlier`], by the usual size of the errors, [`scale`] |
//! | does the axis rest? | [`rest`] |
//!
//! All of this runs in the loop. Nothing here allocates after construction.

pub mod buffer;
pub mod outlier;
pub mod past;
pub mod rest;
pub mod row;
pub mod scale;

pub use buffer::SlidingBuffer;
pub use outlier::{OutlierGate, Verdict};
pub use past::Past;
pub use rest::RestDetection;
pub use row::RegressorRow;
pub use scale::Scale;
