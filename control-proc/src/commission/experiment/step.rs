//! One step of the experiment, and what the axis does in it.

/// One pulse pair, stroke or random step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Ticks since it began.
    pub ticks: usize,
    /// Position at its begin, and the lowest and highest since, m.
    pub from: f64,
    pub lowest: f64,
    pub highest: f64,
    /// Largest fall from the highest position, m.
    pub fall: f64,
    /// Tick at which the motion became clear.
    pub moved_at: Option<usize>,
    /// Tick at which the command went neutral, and the last one at which the axis still moved.
    pub neutral_at: Option<usize>,
    pub last_motion: usize,
    /// Fastest speed in the direction of the command, m/s.
    pub peak: f64,
    /// What is commanded, and for how many ticks.
    pub wanted: f64,
    pub length: usize,
}

impl Step {
    pub const fn begin(from: f64, wanted: f64, length: usize) -> Self {
        Self {
            ticks: 0,
            from,
            lowest: from,
            highest: from,
            fall: 0.0,
            moved_at: None,
            neutral_at: None,
            last_motion: 0,
            peak: 0.0,
            wanted,
            length,
        }
    }
}
