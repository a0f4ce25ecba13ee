//! What works on a group of processes: starts and watches it, reads along, operates its axes.

mod launch;
pub mod lifeline;
pub mod monitor;
pub mod operator;
pub mod preflight;
pub mod signals;
pub mod supervisor;
