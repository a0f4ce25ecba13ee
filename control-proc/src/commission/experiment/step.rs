//! One step of the experiment, and what the axis does in it.

/// A position and the tick at which it was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extreme {
    /// m.
    pub position: f64,
    /// Ticks since the step began.
    pub at: usize,
}

/// One pulse pair, stroke or random step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Ticks since the step began.
    pub ticks: usize,
    /// Position at the beginning, m.
    pub from: f64,
    /// Lowest position since.
    pub lowest: Extreme,
    /// Highest position since.
    pub highest: Extreme,
    /// Largest fall from the highest position, m.
    pub fall: f64,
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
            lowest: Extreme { position: from, at: 0 },
            highest: Extreme { position: from, at: 0 },
            fall: 0.0,
            swing: 0.0,
            moved_at: None,
            neutral_at: None,
            last_motion: 0,
            peak: 0.0,
            wanted,
            length,
        }
    }

    /// The farthest position in the direction in place `side`.
    pub fn farthest(&self, side: usize) -> Extreme {
        if side == 0 { self.highest } else { self.lowest }
    }

    /// Takes in the position (m) and the speed (m/s) of a tick. Motion is clear from `clear` m on. The way that an axis
    /// creeps by itself, `drift` m per tick, is no motion.
    pub fn observe(&mut self, position: f64, speed: f64, drift: f64, clear: f64, is_quiet: bool) {
        self.ticks += 1;
        let position = position - drift * self.ticks as f64;
        let here = Extreme { position, at: self.ticks };
        if position < self.lowest.position {
            self.lowest = here;
        }
        if position > self.highest.position {
            self.highest = here;
        }
        self.fall = self.fall.max(self.highest.position - position);
        self.peak = self.peak.max(speed * self.wanted.signum());
        if self.moved_at.is_none() && (position - self.from) * self.wanted.signum() > clear + self.swing {
            self.moved_at = Some(self.ticks);
        }
        if !is_quiet {
            self.last_motion = self.ticks;
        }
    }
}
