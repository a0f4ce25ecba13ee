//! Faults that a group has to survive, one test or more for each row of the table in `docs/src/faults.md`. They are
//! injected into real processes.
//!
//! In lock-step time passes in ticks, the test plays one of the stages, and the bounds are exact. In real time the
//! bounds are those of a machine with a real-time kernel; [`clock::scaled`] tells what is asserted in their place.

#[path = "../harness/mod.rs"]
mod harness;

mod clock;
mod script;
mod table;

mod computer;
mod control;
mod feedback;
mod model;
mod motion;
mod pulses;
mod system;
