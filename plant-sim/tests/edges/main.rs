//! Machines at the limits of the machine file: every machine that `PlantSim::new` accepts stays within physical bounds.

mod bounds;
mod extremes;
mod sweep;
mod text;
