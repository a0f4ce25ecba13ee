//! Whether implausible positions are those of an axis that moves faster than it can: a load that falls, a hose that has
//! burst.
//!
//! ```text
//! d(j)  = (y(j) - y(j-1)) / n(j)          y every 10 ms, or every tick where that is longer
//! runs  <=>  the last 5 of d have one sign, |d| >= v_max T / 2, and max |d| <= 2.5 min |d|
//! ```
//!
//! y position as the sensor gives it, m; n(j) ticks since y(j-1); v_max `max_speed`, m/s; T period, s.
//!
//! A cable that slips gives one large d, an encoder that errs gives d of both signs or of very different sizes. Noise
//! whose values are independent gives six that rise or fall so evenly once in some ten thousand ticks.

use std::time::Duration;

use pipeline::machine::samples_of;

/// Time between two positions that are compared. Shorter steps would be lost in the counts of an encoder.
const EVERY: Duration = Duration::from_millis(10);
/// Steps that have to agree.
const STEPS: u32 = 5;
/// Part of the largest plausible step that is a fast one.
const FAST: f64 = 0.5;
/// Largest ratio of two of the steps.
const RATIO: f64 = 2.5;

/// Watches the positions of one axis.
#[derive(Debug, Clone)]
pub struct Runaway {
    /// Ticks between two positions.
    every: u32,
    /// Least step of a fast axis, m per tick.
    fast: f64,
    /// Ticks since `from`.
    ticks: u32,
    /// The position before, m; NaN where there is none.
    from: f64,
    /// The last step, m per tick.
    step: f64,
    /// Steps that agree.
    steps: u32,
    /// Smallest and largest of them as magnitudes, m per tick.
    sizes: (f64, f64),
}

impl Runaway {
    /// Of an axis that moves at most by `step`, m, in a tick.
    pub fn new(step: f64, period: Duration) -> Self {
        Self {
            every: samples_of(EVERY, period).max(1) as u32,
            fast: FAST * step,
            ticks: 0,
            from: f64::NAN,
            step: 0.0,
            steps: 0,
            sizes: (0.0, 0.0),
        }
    }

    /// Takes in the position `elapsed` ticks after the last one, m; none where the sensor gives none. Whether the axis
    /// runs away, if that position is not plausible.
    pub fn update(&mut self, elapsed: u32, position: Option<f64>) -> bool {
        let Some(position) = position else {
            (self.from, self.steps) = (f64::NAN, 0);
            return false;
        };
        self.ticks = self.ticks.saturating_add(elapsed);
        if self.ticks >= self.every || self.from.is_nan() {
            self.take((position - self.from) / f64::from(self.ticks));
            (self.from, self.ticks) = (position, 0);
        }
        self.steps >= STEPS
    }

    /// Takes in a step, m per tick; NaN where it is not known.
    fn take(&mut self, step: f64) {
        let size = step.abs();
        let (least, most) = (self.sizes.0.min(size), self.sizes.1.max(size));
        let goes_on = self.steps > 0 && step * self.step > 0.0 && most <= RATIO * least;
        // A step that is not finite is not fast.
        (self.steps, self.sizes) = if !(size >= self.fast && size.is_finite()) {
            (0, (0.0, 0.0))
        } else if goes_on {
            (self.steps.saturating_add(1), (least, most))
        } else {
            (1, (size, size))
        };
        self.step = step;
    }
}
