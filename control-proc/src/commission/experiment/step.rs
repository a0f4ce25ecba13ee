//! One step of the experiment, and what the axis does in it.

/// One pulse pair, stroke or random step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Ticks since the step began.
    pub ticks: usize,
    /// Position at the beginning, m.
    pub from: f64,
    /// Lowest position since, m.
    pub lowest: f64,
    /// Highest position since, m.
    pub highest: f64,
    /// Largest fall from the highest position, m.
    pub fall: f64,
    /// Tick of the lowest position.
    pub lowest_at: usize,
    /// Tick of the highest position.
    pub highest_at: usize,
    /// Range of the positions before the step, m, of a load that still swings.
    pub swing: f64,
    /// Tick at which the motion in the direction of the command became clear.
    pub moved_at: Option<usize>,
    /// Tick at which the command went neutral.
    pub neutral_at: Option<usize>,
    /// Last tick at which the axis still moved.
    pub last_motion: usize,
    /// Fastest speed in the direction of the command, m/s.
    pub peak: f64,
    /// The command of the step.
    pub wanted: f64,
    /// Ticks for which it is commanded.
    pub length: usize,
}

impl Step {
    /// Begins at the position `from` (m).
    pub const fn begin(from: f64, wanted: f64, length: usize) -> Self {
        Self {
            ticks: 0,
            from,
            lowest: from,
            highest: from,
            fall: 0.0,
            lowest_at: 0,
            highest_at: 0,
            swing: 0.0,
            moved_at: None,
            neutral_at: None,
            last_motion: 0,
            peak: 0.0,
            wanted,
            length,
        }
    }

    /// Takes in the position (m) and the speed (m/s) of a tick. Motion is clear from `clear` m on. The way that an axis
    /// creeps by itself, `drift` m per tick, is no motion.
    pub fn observe(&mut self, position: f64, speed: f64, drift: f64, clear: f64, is_quiet: bool) {
        self.ticks += 1;
        let position = position - drift * self.ticks as f64;
        if position < self.lowest {
            (self.lowest, self.lowest_at) = (position, self.ticks);
        }
        if position > self.highest {
            (self.highest, self.highest_at) = (position, self.ticks);
        }
        self.fall = self.fall.max(self.highest - position);
        self.peak = self.peak.max(speed * self.wanted.signum());
        if self.moved_at.is_none() && (position - self.from) * self.wanted.signum() > clear + self.swing {
            self.moved_at = Some(self.ticks);
        }
        if !is_quiet {
            self.last_motion = self.ticks;
        }
    }
}
