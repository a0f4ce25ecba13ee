//! What works on a group of processes: checks before it starts, starts and watches its stages, reads its messages, and
//! operates its axes.
//!
//! Supervisor, monitor and operator run in a process of their own beside the loop. They read channels that a stage
//! never waits for, and none of their code runs in a stage. Two files are exceptions: [`lifeline`] and [`signals`] also
//! run in the process of a stage, on threads and handlers of their own, outside its loop.

mod glance;
mod launch;
pub mod lifeline;
pub mod live;
pub mod monitor;
mod obstacles;
pub mod operator;
pub mod page;
pub mod preflight;
pub mod recorder;
pub mod running;
pub mod signals;
pub mod supervisor;
