//! What happens to a sample before an estimator learns from it: step 4 of the paper.
//!
//! | question | where |
//! |---|---|
//! | what are the last outputs and commands? | [`buffer`] |
//! | what does the sample say to a regression? | [`row`] |
//! | is it an outlier? | [`outlier`] |
//! | does the axis rest? | [`rest`] |
//!
//! Everything here runs in the loop and allocates nothing after construction.

pub mod buffer;
pub mod outlier;
pub mod rest;
pub mod row;

pub use buffer::SlidingBuffer;
pub use outlier::{OutlierGate, Verdict};
pub use rest::RestDetection;
pub use row::RegressorRow;
