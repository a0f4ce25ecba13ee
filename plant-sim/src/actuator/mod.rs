//! The actuator of one axis: what moves its piston. Nothing in this folder allocates.
//!
//! | module | what it holds | equation |
//! |---|---|---|
//! | [`friction`] | friction between piston and cylinder | F in (9) |
//! | [`load`] | gravity, external force and elasticity | F_L in (9) |
//! | [`end_stop`] | the stops at both ends of the stroke | F_stop in (9) |
//! | [`edges`] | control edges of the valve, regeneration, counterbalance, leakage of the spool | (3) |
//! | [`cylinder`] | chambers, leakage and force balance | (6), (9) |

pub mod cylinder;
pub mod edges;
pub mod end_stop;
pub mod friction;
pub mod load;
