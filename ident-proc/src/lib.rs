//! Identification of electrohydraulic axes by an adaptive Hammerstein model, steps 1-8 of the paper that the
//! README names.
//!
//! | step | where |
//! |---|---|
//! | 1, 2 structure and initial values | [`pipeline::machine::Identification`], [`batch`] |
//! | 3 offline identification, eqs. (11)-(17) | [`batch`], [`triangle`], [`split`] |
//! | 4 collect a sample | [`history`], [`regression`] |
//! | 5 forgetting factor by fuzzy rules, Table 1, eq. (21) | [`estimator::fuzzy`] |
//! | 6 recursive least squares, eqs. (18)-(20) | [`recursive`] |
//! | 7, 8 the controller's turn, and again | `control-proc` |
//!
//! The paper's forgetting is one of several ([`estimator`]); by default a [`bank`] of them runs side by side.
//! [`Identifier`] puts everything together for one axis, tells wild samples ([`outlier`]) and rest ([`rest`]), and
//! knows the errors of the adaptive and of the classical, held model at any time ([`errors`]). [`process`] is the
//! stage: channels in, channels out.

pub mod adaptation;
pub mod estimator;
mod identifier;
mod identifiers;
pub mod least_squares;
pub mod offline;
pub mod process;
pub mod quality;
pub mod recursive;
pub mod regression;
pub mod sample;
pub mod separation;
pub mod validation;

pub use identifier::Identifier;
pub use identifiers::Identifiers;

/// The scalar product.
fn dot(one: &[f64], two: &[f64]) -> f64 {
    one.iter().zip(two).map(|(one, two)| one * two).sum()
}
