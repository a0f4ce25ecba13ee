//! The simulated electrohydraulic machine: valve commands in, encoder readings out.
//!
//! Every axis is a proportional valve that feeds both chambers of an asymmetric cylinder. Numbers in parentheses are
//! the paper's equations; index 1 is the piston side, 2 the rod side, y the piston position in m, v its speed in m/s:
//!
//! ```text
//! (1)  tau_v dx_v/dt + x_v = u(t - dead time)          spool x_v and command u in [-1, 1], so K_1 = 1
//!      X = dead band and saturation of x_v             opening X in [-1, 1]
//! (3)  extend,  X >= 0:  q1 = k X f(p_s - p1)          q2 =  k X f(p2 - p_0)
//!      retract, X < 0:   q1 = k X f(p1 - p_0)          q2 =  k X f(p_s - p2)
//! (6)  V1/beta_e dp1/dt = q1 - A1 v - C_ip (p1 - p2) - C_ep p1       V1 = V01 + A1 y
//!      V2/beta_e dp2/dt = A2 v - q2 + C_ip (p1 - p2) - C_ep p2       V2 = V02 + A2 (L - y)
//! (9)  m dv/dt = A1 p1 - A2 p2 - B_p v - F_f(v) - K (y - L/2) - F_L + F_stop
//! ```
//!
//! with flows q in m3/s (q1 into the piston side, q2 out of the rod side), pressures p in Pa, f the square root
//! that is smooth at zero ([`orifice`]), F_f dry friction ([`friction`]), F_stop the end stops ([`cylinder`]).
//! The paper writes (3) for extension only; retraction exchanges supply and return. Its V2 counts from another zero:
//! there V02 is the rod side's volume at y = 0, here at y = L, which is the oil that is left in the ports.
//!
//! # What is wrong in the printed equations
//!
//! * (7) lacks a plus sign before its V1/beta_e term.
//! * (4), with 1 + n^3, holds for extension only, and has p_0 = 0.
//! * (10): the valve term lacks the factor A1 that the term with C_es P_s has; the units of the two differ.
//!
//! (6) is consistent. Hence (1), (3), (6) and (9) are integrated, and the paper's load-flow forms (4), (5), (7), (8)
//! and (10) are not used.
//!
//! # What is not modelled
//!
//! Relief and load-check valves, a limit of the pump's flow, pipes, and a bulk modulus that falls with pressure. Axes
//! do not couple: each has its own constant supply, but for what its schedule says.
//!
//! # Contents
//!
//! | module | what it holds |
//! |---|---|
//! | [`orifice`] | flow through one control edge |
//! | [`valve`] | dead time, spool, dead band |
//! | [`friction`] | Stribeck friction |
//! | [`cylinder`] | chambers, leakage, force balance, end stops |
//! | [`integrate`] | the Runge-Kutta step |
//! | [`stiffness`] | which axes that step can integrate |
//! | [`schedule`] | parameters that change over time |
//! | [`axis`] | one axis: valve and cylinder through time |
//! | [`encoder`] | noise and counts |
//! | [`plant`] | the machine: [`PlantSim`] |
//! | [`process`] | the stage: channels in, channels out |
//!
//! The core is deterministic: it sees no clock, no file and no channel, and allocates at construction only.

pub mod conditions;
pub mod cylinder;
pub mod encoder;
pub mod end_stop;
pub mod friction;
pub mod group;
pub mod integrate;
pub mod lanes;
pub mod load;
pub mod oil;
pub mod orifice;
pub mod plant;
pub mod port;
pub mod process;
pub mod stiffness;
pub mod supply;
pub mod valve;

pub use group::AxisState;
pub use plant::{PlantError, PlantSim};
