//! The commands of `hydraxis` that run to their end, as a user types them.

mod bench;
mod can;
mod check;
mod commission;
mod doctor;
#[path = "../harness/mod.rs"]
mod harness;
mod identify;
mod init;
mod mechanism;
mod mistyped;
mod outputs;
mod predict;
mod service;
mod simulate;
mod tip;
