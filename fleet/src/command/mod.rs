//! Commands over the network: off always; armed only with consent that a person has given at the machine.
//!
//! ```text
//! station --query--> router --query--> machine: desk --targets--> relay --Request, every sample--> control-proc
//! ```
//!
//! | file | what |
//! |---|---|
//! | `protocol` | questions and answers, as JSON |
//! | `desk` | who may do what now: challenges, the one seat, its dead man |
//! | `relay` | the group: requests for every sample, and the end of a seat |
//! | `journal` | what was asked and answered, in a file of the machine |
//! | `shared` | what questions and relay share |
//! | `machine` | the machine's end: `listen`, `consent` |
//! | `station` | the other end: `disarm`, `operate` |
//!
//! Every command is a question that the machine answers, under a key of its own and with no wildcard in it. Nothing is
//! kept for a machine that is not there. The chain of dead men, all by clocks of the machine:
//!
//! | who is silent | then |
//! |---|---|
//! | the station, or the network, for [`DEAD_MAN`](desk::DEAD_MAN) | the relay stops the axes and leaves the group |
//! | the relay, for 0.1 s | control-proc disarms the axes: every request has `hold_to_run` |
//!
//! Trap: a message may wait in a queue for tens of seconds and arrive as new. So every beat carries the challenge that
//! the machine gave in its last answer, which is good for one beat.

mod desk;
mod journal;
mod machine;
pub mod protocol;
mod relay;
mod shared;
mod station;

pub use desk::DEAD_MAN;
pub use machine::{CommandError, consent, listen};
pub use station::{Station, StationError};
