//! Machines at the edge of what the machine file allows: what `PlantSim::new` accepts stays within physical bounds.

mod bounds;
mod extremes;
mod sweep;
mod text;
