//! Planar kinematics and dynamics of an excavator: boom, arm, telescope and bucket, each moved by its cylinder.
//!
//! | module | what it holds |
//! |---|---|
//! | [`vector`] | vectors, and rotations as cosine and sine |
//! | [`triangle`] | a cylinder that turns a joint: angle, moment arm and their derivatives |
//! | [`four_bar`] | the linkage between bucket cylinder and bucket |
//! | [`geometry`] | pins and lengths; which of them can close |
//! | [`joint`] | one joint: from the length of its cylinder to its rotation, and back |
//! | [`pose`] | forward kinematics: joints, points and Jacobians from the cylinder lengths |
//! | [`inverse`] | cylinder lengths from tip, bucket pitch and telescope |
//! | [`dynamics`] | mass matrix, gravity, Coriolis terms and accelerations |
//! | [`machine`] | pins, bodies and cylinders of one machine, and its motion by cylinder positions |
//! | [`workspace`] | where the teeth reach, and postures spread over the workspace |
//! | [`modes`] | natural frequencies of the cylinders on springs |
//! | [`soundness`] | whether the pins let every cylinder move over its whole stroke |
//!
//! SI units; x forward, z up, angles counter-clockwise. The four axes always come in the order boom, arm, telescope,
//! bucket ([`AXES`]). The state of the mechanism is the four cylinder lengths and their rates. Nothing here allocates,
//! and everything but reports of angles uses + - * / and the square root only, so that the same input gives the same
//! bits on every computer.
//!
//! Source of the equations: planar multibody dynamics in minimal coordinates by the projection method (for example W.
//! Schiehlen, P. Eberhard, Applied Dynamics, Springer 2014, chapters 3 and 5).

pub mod dynamics;
pub mod four_bar;
pub mod geometry;
pub mod inverse;
pub mod joint;
pub mod machine;
pub mod modes;
pub mod pose;
pub mod soundness;
pub mod triangle;
pub mod vector;
pub mod workspace;

pub use dynamics::{Body, CylinderDynamics, Dynamics, Masses, Moments, Payload};
pub use four_bar::FourBar;
pub use geometry::Geometry;
pub use joint::Joint;
pub use machine::{Mechanism, PreparedMechanism};
pub use modes::natural_frequencies;
pub use pose::{Linkage, Pose};
pub use soundness::{END_STOP_WAY, Flaw};
pub use vector::{Rotation, Vector};
pub use workspace::{Extent, postures};

/// Number of axes: boom, arm, telescope, bucket.
pub const AXES: usize = 4;
