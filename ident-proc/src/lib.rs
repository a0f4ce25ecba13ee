//! Identification of electrohydraulic axes by an adaptive Hammerstein model: steps 1 to 6 of the paper that the README
//! names.
//!
//! | step | where |
//! |---|---|
//! | 1, 2 structure and initial values | [`pipeline::machine::Identification`], [`offline`] |
//! | 3 offline identification, eqs. (11)-(17) | [`offline`], [`least_squares`], [`separation`] |
//! | 4 collect a sample | [`sample`], [`regression`] |
//! | 5 forgetting factor by fuzzy rules, Table 1, eq. (21) | [`estimator::fuzzy`] |
//! | 6 recursive least squares, eqs. (18)-(20) | [`recursive`] |
//! | 7, 8 the controller computes the command; repeat from step 4 | `control-proc` |
//!
//! A sample passes through the folders in this order:
//!
//! | folder | task | in the loop |
//! |---|---|---|
//! | [`sample`] | past outputs and commands, regressor row, outliers, rest | yes |
//! | [`regression`] | the forms of the model as linear regressions | yes |
//! | [`least_squares`] | least squares on collected rows | yes |
//! | [`offline`] | collect the training; identify at its end | once, at its end |
//! | [`separation`] | from products to b, f and g | yes |
//! | [`adaptation`] | what learns online: one estimator, a bank, the grey box | yes |
//! | [`estimator`] | the recursive estimators and what they forget | yes |
//! | [`recursive`] | the recursion that all of them use | yes |
//! | [`quality`] | errors and health of the models | yes |
//! | [`validation`] | analysis of an identified model | never |
//!
//! Nothing allocates after construction, but for [`validation`].
//!
//! [`Identifier`] puts everything together for one axis, [`Identifiers`] for all axes of a machine. [`process`] is the
//! stage, with its channels.

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

/// The scalar product of two vectors.
fn dot(one: &[f64], two: &[f64]) -> f64 {
    one.iter().zip(two).map(|(one, two)| one * two).sum()
}
