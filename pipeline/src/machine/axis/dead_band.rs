//! Dead band of a valve.

/// Commands, or spool positions, below which a valve does not open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadBand {
    /// While extending.
    pub extend: f64,
    /// While retracting, as a magnitude.
    pub retract: f64,
}
