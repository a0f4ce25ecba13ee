//! Dead band of a valve.

/// Commands below which a valve does not open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadBand {
    /// When extending.
    pub extend: f64,
    /// When retracting, as a magnitude.
    pub retract: f64,
}
