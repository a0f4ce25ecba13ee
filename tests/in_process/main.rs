//! The cores without processes: the closed loop on the simulated machine, and the seeds of the fuzz targets.

mod closed_loop;
mod fuzz;
#[path = "../harness/mod.rs"]
mod harness;
