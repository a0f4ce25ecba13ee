//! Which identified model may control an axis, and what it predicts.
//!
//! | module | what it holds |
//! |---|---|
//! | [`judge`] | checks of a snapshot's models: a model is approved, or refused with a reason |
//! | [`comparison`] | whether the adaptive model predicts better than the classical one |
//! | [`age`] | the last approved model, and how old it is |
//! | [`trust`] | takes the model away after a following error under it |
//! | [`response`] | free response, step response and residual of a model |
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod age;
pub mod comparison;
pub mod judge;
pub mod response;
pub mod trust;
