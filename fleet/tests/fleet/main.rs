//! Real groups, bridges and routers on this computer.

#[path = "../harness/mod.rs"]
mod harness;

mod disturbance;
mod lock_step;
mod page;
mod plant;
mod record;
mod telemetry;
