//! Groups of real processes: how they start, are operated, are looked at, fail and end.

mod arming;
mod black_box;
mod bus_faults;
mod campaign;
mod clean;
mod control;
mod events;
mod gains;
#[path = "../harness/mod.rs"]
mod harness;
mod lock_step;
mod monitor;
mod operation;
mod processes;
mod record;
mod replay;
mod report;
mod screen;
mod scripted_stage;
mod source;
mod status;
mod stop;
mod strangers;
mod supervisor;
mod warm;
