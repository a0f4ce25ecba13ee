//! Which identified model may control an axis, and what it predicts.
//!
//! | module | what it holds |
//! |---|---|
//! | [`gate`] | a snapshot goes in, the approved model or none comes out |
//! | [`judge`] | checks of a snapshot's models: a model is approved, or refused with a reason |
//! | [`comparison`] | whether the adaptive model predicts better than the classical one |
//! | [`age`] | the last approved model, and how old it is |
//! | [`expected`] | the motion that the commissioned model expects of the commands |
//! | [`shadow`] | the error that the fallback would have now |
//! | [`supervision`] | takes control from a model that follows worse than the fallback would |
//! | [`swing`] | finds swings that no reference asks for |
//! | [`squares`] | means of squares of errors |
//! | [`trust`] | takes the model away after a following error under it |
//! | [`response`] | free response, step response and residual of a model |
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod age;
pub mod comparison;
pub mod expected;
pub mod gate;
pub mod judge;
pub mod response;
pub mod shadow;
pub mod squares;
pub mod supervision;
pub mod swing;
pub mod trust;
