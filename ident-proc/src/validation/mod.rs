//! Is an identified model good, and how well are its coefficients known? Offline, allocates.
//!
//! | question | where |
//! |---|---|
//! | do the residuals still hold something that the past of y explains? | [`whiteness`] |
//! | do they hold something that the command explains? was the record taken in closed loop? | [`cross_correlation`] |
//! | is a larger model worth its coefficients? | [`criteria`] |
//! | how far would the coefficients scatter over repeated records? | [`deviations`] |
//!
//! A residual is e(k) = y(k) - phi(k)' theta, the one-step error of a held theta. Trap: the tests of [`whiteness`]
//! and [`cross_correlation`] ask whether a deviation is there, not whether it matters; a long record of a real
//! machine fails them with a model that controls well. Look at the size of the correlations too.

pub mod chi_square;
pub mod criteria;
pub mod cross_correlation;
pub mod deviations;
#[cfg(test)]
mod noise;
pub mod whiteness;
