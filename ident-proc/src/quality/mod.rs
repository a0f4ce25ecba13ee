//! How good the models are, sample by sample.
//!
//! | question | where |
//! |---|---|
//! | how large are their prediction errors? | [`errors`] |
//! | how is a prediction over the horizon made without predicting twice? | [`forecast`] |
//! | what can be said of a model without another measurement? | [`health`] |
//!
//! Everything here runs in the loop and allocates nothing after construction.

pub mod errors;
pub mod forecast;
pub mod health;

pub use errors::ErrorTracker;
pub use forecast::Forecasts;
pub use health::Health;
