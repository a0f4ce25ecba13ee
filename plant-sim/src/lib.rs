//! plant-sim
