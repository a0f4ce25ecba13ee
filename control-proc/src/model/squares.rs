//! Means of squares of errors and speeds, with a memory in seconds.
//!
//! ```text
//! E <- E + p (e^2 - E)        V <- V + p (v_r^2 - V)        p = max(1 - exp(-t/tau), t/(t + t_E))
//! ```
//!
//! e error m, v_r speed of the reference m/s, t time since the last look s, t_E time that the means are of s, tau
//! memory s: means so far, before the memory is full.

/// Memory of the errors of a fallback in control, s.
pub const MEMORY: f64 = 30.0;

/// Least time of the fallback in control that says something of it, in s and in reactions of the axis.
pub const MEASURED: (f64, f64) = (2.0, 6.0);

/// Time for which the errors of what was before still count, in s and in reactions of the axis.
pub const TRANSIENT: (f64, f64) = (1.0, 6.0);

/// Whether a reference stands, and what its last motion has left is over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Time for which it has stood, s.
    time: f64,
    /// Time after which it is over, s.
    settled: f64,
}

impl Standing {
    /// Of an axis with this reaction, dead time and lag, s.
    pub fn new(reaction: f64) -> Self {
        Self { time: 0.0, settled: TRANSIENT.0.max(TRANSIENT.1 * reaction) }
    }

    /// Takes in the speed of the reference, m/s, `time` s after the last look.
    pub fn update(&mut self, speed: f64, time: f64) -> bool {
        self.time = if speed == 0.0 { self.time + time } else { 0.0 };
        self.time > self.settled
    }
}

/// Means of squares.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Squares {
    /// E, m2.
    pub error: f64,
    /// V, m2/s2.
    pub speed: f64,
    /// t_E, s.
    pub time: f64,
}

impl Squares {
    /// Takes in an error in m at a speed of the reference in m/s, `time` s after the last one, with a memory in s.
    pub fn push(&mut self, error: f64, speed: f64, time: f64, memory: f64) {
        let part = (1.0 - (-time / memory).exp()).max(time / (self.time + time));
        self.error += part * (error * error - self.error);
        self.speed += part * (speed * speed - self.speed);
        self.time += time;
    }

    /// E where V is `speed`, m2: in proportion to V, but at least the part `least` of E. Infinite or NaN where V was 0.
    pub fn for_speed(&self, speed: f64, least: f64) -> f64 {
        self.error * (speed / self.speed).max(least)
    }
}
