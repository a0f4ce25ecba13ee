//! The faults that a group has to survive, one test for each, injected into real processes.
//!
//! Where time passes in ticks (lock-step, the other stages being the test's to play) the bounds are exact. Where it
//! passes by the clock, they are those of a machine with a real-time kernel, and what is asserted is
//! [`clock::scaled`] from them; both figures and what was measured are printed.

#[path = "../harness/mod.rs"]
mod harness;

mod clock;
mod script;

mod control;
mod feedback;
mod model;
mod motion;
mod system;
