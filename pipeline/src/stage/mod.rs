//! The loop that every stage runs.

/// The four stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StageKind {
    /// The simulated machine.
    PlantSim = 0,
    /// Encoder acquisition.
    SensorProc = 1,
    /// Identification.
    IdentProc = 2,
    /// Control.
    ControlProc = 3,
}

impl StageKind {
    /// All of them, in the order of the data.
    pub const ALL: [Self; 4] = [Self::PlantSim, Self::SensorProc, Self::IdentProc, Self::ControlProc];

    /// Its name, which is also its subcommand.
    pub const fn name(self) -> &'static str {
        ["plant-sim", "sensor-proc", "ident-proc", "control-proc"][self as usize]
    }
}
