//! How good the models of one axis are, sample by sample.
//!
//! | question | where |
//! |---|---|
//! | how large are the prediction errors of one model? | [`errors`] |
//! | how do the adaptive and the classical model compare? | [`comparison`] |
//! | how is a prediction over the horizon carried along? | [`forecast`] |
//! | what can be said of a model without another measurement? | [`health`] |
//!
//! All of this runs in the loop. Nothing here allocates after construction.

pub mod comparison;
pub mod errors;
pub mod forecast;
pub mod health;

pub use comparison::{Advanced, Comparison, Predictions};
pub use errors::ErrorTracker;
pub use forecast::Forecasts;
pub use health::Health;
