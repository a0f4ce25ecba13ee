//! Analysis of an identified model: is it good, and how accurate are its coefficients? Nothing here runs in the loop;
//! all of it allocates.
//!
//! | question | where |
//! |---|---|
//! | does the past of y explain part of the residuals? | [`whiteness`] |
//! | does the command explain part of them? was the record taken in closed loop? | [`cross_correlation`] |
//! | is a larger model worth its coefficients? | [`criteria`] |
//! | how far would the coefficients scatter over repeated records? | [`deviations`] |
//! | how probable is a statistic? | [`chi_square`] |
//!
//! A residual is e(k) = y(k) - phi(k)' theta, the one-step error of a fixed theta. Trap: [`whiteness`] and
//! [`cross_correlation`] test whether a deviation exists, not whether it matters. On a long measured record they fail a
//! model that controls well. Look at the size of the correlations too.

pub mod chi_square;
pub mod criteria;
pub mod cross_correlation;
pub mod deviations;
#[cfg(test)]
mod noise;
pub mod whiteness;
