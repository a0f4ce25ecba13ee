//! What was commanded in an experiment, and what the axis did.

/// The record of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentRecord {
    /// Sampling period, s.
    pub period: f64,
    /// Period of a load that the valve was seen to shake, s; 0 of one that it was not.
    pub swing: f64,
    /// u(k), held from sample k to the next, in [-1, 1].
    pub commands: Vec<f64>,
    /// y(k), m; NaN where there was no usable sample.
    pub positions: Vec<f64>,
}
