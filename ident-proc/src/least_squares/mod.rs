//! Least squares on collected rows, eq. (15): what offline identification solves and recursive estimators start from.
//!
//! | question | where |
//! |---|---|
//! | how are the rows kept, and the problem solved? | [`triangle`] |
//! | which coefficients can the rows not tell apart? | [`rank`] |
//!
//! Everything here may run in the loop and allocates nothing after construction.

pub mod rank;
pub mod triangle;

pub use rank::RankGuard;
pub(crate) use triangle::RANK_TOLERANCE;
pub use triangle::Triangle;
