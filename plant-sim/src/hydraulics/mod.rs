//! The hydraulics that all axes share, and the flow laws. Nothing in this folder allocates.
//!
//! | module | what it holds | equation |
//! |---|---|---|
//! | [`oil`] | bulk modulus of oil with air, viscosity | beta_e in (6) |
//! | [`orifice`] | flow through one control edge | (3) |
//! | [`port`] | relief valve and make-up valve of a chamber | q_o in (6) |
//! | [`supply`] | the pump, and the part of its demand that each axis gets | |

pub mod oil;
pub mod orifice;
pub mod port;
pub mod supply;
