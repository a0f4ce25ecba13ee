//! From the products C_ij = f_i b_j of the over-parametrised form to b, f and g, eqs. (16) and (17).
//!
//! | question | where |
//! |---|---|
//! | what is the separated model at the end of training? | [`offline`] |
//! | what is it after each later sample? | [`online`], in the loop |
//!
//! Nothing here allocates after construction.

pub mod offline;
pub mod online;

pub use offline::OfflineSeparation;
pub use online::OnlineSeparation;
