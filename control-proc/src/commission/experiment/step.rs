//! One step of the experiment, and what the axis does in it.

/// A position and the tick at which it was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extreme {
    /// m.
    pub position: f64,
    /// Ticks since the step began.
    pub at: usize,
}

/// Where the axis has been in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reached {
    /// Lowest position.
    pub lowest: Extreme,
    /// Highest position.
    pub highest: Extreme,
    /// Largest fall from the highest position, m.
    pub fall: f64,
    /// The farthest that the axis has come back since it was farthest in the direction of the command.
    pub back: Extreme,
}

/// One pulse pair, stroke or random step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Ticks since the step began.
    pub ticks: usize,
    /// Position at the beginning, m.
    pub from: f64,
    /// Where the axis has been since.
    pub reached: Reached,
    /// Range of the positions before the step, m, of a load that still swings.
    pub swing: f64,
    /// Tick at which the motion in the direction of the command became clear.
    pub moved_at: Option<usize>,
    /// Tick at which the command went neutral.
    pub neutral_at: Option<usize>,
    /// The window has ended it before it could say anything.
    pub is_cut: bool,
    /// Last tick at which the axis still moved.
    pub last_motion: usize,
    /// Fastest speed in the direction of the command, m/s.
    pub peak: f64,
    /// The command of the step.
    pub wanted: f64,
    /// Largest change of the command from tick to tick.
    pub ramp: f64,
    /// Ticks for which it is commanded.
    pub length: usize,
}

impl Step {
    /// Begins at the position `from` (m).
    pub const fn begin(from: f64, wanted: f64, length: usize) -> Self {
        let start = Extreme { position: from, at: 0 };
        Self {
            ticks: 0,
            from,
            reached: Reached { lowest: start, highest: start, fall: 0.0, back: start },
            swing: 0.0,
            moved_at: None,
            neutral_at: None,
            is_cut: false,
            last_motion: 0,
            peak: 0.0,
            wanted,
            ramp: f64::INFINITY,
            length,
        }
    }

    /// The farthest position in the direction in place `side`.
    pub fn farthest(&self, side: usize) -> Extreme {
        if side == 0 { self.reached.highest } else { self.reached.lowest }
    }

    /// Takes in the position (m) and the speed (m/s) of a tick. Motion is clear from `clear` m on. The way that an axis
    /// creeps by itself, `drift` m per tick, is no motion.
    pub fn observe(&mut self, position: f64, speed: f64, drift: f64, clear: f64, is_quiet: bool) {
        self.ticks += 1;
        let position = position - drift * self.ticks as f64;
        let here = Extreme { position, at: self.ticks };
        let sign = self.wanted.signum();
        let reached = &mut self.reached;
        if position < reached.lowest.position {
            reached.lowest = here;
        }
        if position > reached.highest.position {
            reached.highest = here;
        }
        reached.fall = reached.fall.max(reached.highest.position - position);
        let farthest = if sign > 0.0 { reached.highest } else { reached.lowest };
        if farthest == here || (reached.back.position - position) * sign > 0.0 {
            reached.back = here;
        }
        self.peak = self.peak.max(speed * sign);
        if self.moved_at.is_none() && (position - self.from) * sign > clear + self.swing {
            self.moved_at = Some(self.ticks);
        }
        if !is_quiet {
            self.last_motion = self.ticks;
        }
    }
}
