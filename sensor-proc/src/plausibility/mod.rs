//! Whether a position is to be believed.
//!
//! ```text
//! range:  -tolerance <= y <= stroke + tolerance, or the jump there was none that an axis makes
//! speed:  |y(k) - y_good|                <= n v_max T + margin
//!         |y(k) - y_good - n v_good T|   <=   v_max T + margin        for n <= 3
//! base:   after an implausible position, n > 3: |y(k) - y(k-1)| <= v_max T + margin, for 0.5 s
//! stuck:  the raw value has not changed at all for stuck_after
//! ```
//!
//! y position in m, v_max `max_speed` in m/s, T period in s, y_good the last good position, n ticks since, v_good
//! median of the last three speeds between good positions, m/s, margin 5 counts.
//!
//! A single position far out of the stroke is a wrong one, not an axis out of its stroke; the next one there is.
//!
//! What an encoder has been seen to do wrongly is never reached by waiting: a position that has jumped by more than an
//! axis can move in a tick stays implausible, so whoever controls has stopped long before it is taken as a new base,
//! which it has to be some time or an axis with a new cable could not be put back into service. Where nothing was seen
//! at all the way that is possible grows with the time. The median leaves out a single wrong speed, that of an error
//! too small to be seen as one.
//!
//! An unusable position is replaced by the last good one and marked; nothing downstream has to guess. Trap: an axis
//! at rest does not change its counts either. Stuck is therefore a mark, and a fault only for whoever knows that the
//! axis is commanded to move: control-proc.

use pipeline::{
    machine::{Axis, samples_of},
    message::{AxisSample, sample_fault},
};
use std::time::Duration;

/// Counts by which quantisation and noise can make a still axis seem to move.
const SPEED_MARGIN: f64 = 5.0;
/// Ticks over which a position is foretold by a speed: after as many without one the controller has latched.
const BRIDGE: u32 = 3;
/// How long a position that cannot be has to go on as an axis does until it is believed: many times what the controller
/// takes to latch, and less than a person takes to reset it.
pub const NEW_BASE: Duration = Duration::from_millis(500);

/// Checks the positions of one axis, tick by tick.
#[derive(Debug, Clone)]
pub struct Plausibility {
    range: (f64, f64),
    step: f64,
    margin: f64,
    period: f64,
    stuck_after: u32,
    new_base_ticks: u32,
    good: Option<f64>,
    ticks_since_good: u32,
    /// Speeds between the last good positions, m per tick.
    speeds: [f64; 3],
    /// A position since the last good one was not believed.
    suspect: bool,
    /// Ticks in a row that positions have gone on as an axis does.
    steady: u32,
    last: f64,
    unchanged: u32,
    sample: AxisSample,
}

impl Plausibility {
    /// For one axis at a sample period.
    pub fn new(axis: &Axis, period: Duration) -> Self {
        let encoder = &axis.encoder;
        Self {
            range: (-encoder.tolerance, axis.stroke + encoder.tolerance),
            step: axis.max_speed * period.as_secs_f64(),
            margin: SPEED_MARGIN * encoder.resolution,
            period: period.as_secs_f64(),
            stuck_after: samples_of(encoder.stuck_after, period).max(1) as u32,
            new_base_ticks: samples_of(NEW_BASE, period).max(1) as u32,
            good: None,
            ticks_since_good: 0,
            speeds: [0.0; 3],
            suspect: false,
            steady: 0,
            last: f64::NAN,
            unchanged: 0,
            sample: AxisSample::default(),
        }
    }

    /// Judges the position of this tick, m, `elapsed` ticks after the last; `None` when nothing arrived.
    /// `encoder_error` is the encoder's own word.
    pub fn judge(&mut self, elapsed: u64, position: Option<f64>, encoder_error: bool) -> AxisSample {
        let elapsed = u32::try_from(elapsed.max(1)).unwrap_or(u32::MAX);
        self.ticks_since_good = self.ticks_since_good.saturating_add(elapsed);
        let mut faults = if encoder_error { sample_fault::ENCODER } else { 0 };
        match position {
            None => {
                faults |= sample_fault::STALE;
                self.steady = 0;
            }
            Some(position) => {
                let goes_on = !encoder_error && (position - self.last).abs() <= self.within(f64::from(elapsed));
                self.steady = if goes_on { self.steady.saturating_add(elapsed) } else { 0 };
                self.unchanged = if position == self.last { self.unchanged.saturating_add(elapsed) } else { 0 };
                self.last = position;
                // Written so that NaN is out of range.
                let is_out = !(self.range.0..=self.range.1).contains(&position);
                let is_near = self.is_near(position);
                if is_out && (is_near || goes_on || !position.is_finite()) {
                    faults |= sample_fault::RANGE;
                } else if is_out || !is_near {
                    faults |= sample_fault::SPEED;
                }
                self.suspect |= faults & (sample_fault::RANGE | sample_fault::SPEED) != 0;
            }
        }
        if self.unchanged >= self.stuck_after {
            faults |= sample_fault::STUCK;
        }
        self.sample.faults = faults;
        self.sample.unchanged = self.unchanged;
        if let Some(position) = position
            && faults & sample_fault::UNUSABLE == 0
        {
            self.take(position);
        }
        self.sample
    }

    /// The farthest that an axis moves in so many ticks, noise included, m.
    fn within(&self, ticks: f64) -> f64 {
        self.step * ticks + self.margin
    }

    /// Whether the axis can be at this position after the last good one.
    fn is_near(&self, position: f64) -> bool {
        let Some(good) = self.good else { return true };
        let ticks = f64::from(self.ticks_since_good);
        let way = position - good;
        if self.ticks_since_good <= BRIDGE {
            let [a, b, c] = self.speeds;
            let median = a.max(b).min(a.min(b).max(c));
            way.abs() <= self.within(ticks) && (way - ticks * median).abs() <= self.within(1.0)
        } else if self.suspect {
            self.steady >= self.new_base_ticks
        } else {
            way.abs() <= self.within(ticks)
        }
    }

    /// Takes a position (m) as good.
    fn take(&mut self, position: f64) {
        let way = position - self.good.unwrap_or(position);
        let per_tick = way / f64::from(self.ticks_since_good);
        // A new base says nothing of a speed.
        self.speeds = if self.suspect && self.ticks_since_good > BRIDGE {
            [0.0; 3]
        } else {
            [self.speeds[1], self.speeds[2], per_tick]
        };
        self.sample.velocity = self.speeds[2] / self.period;
        self.sample.position = position;
        self.good = Some(position);
        (self.ticks_since_good, self.suspect) = (0, false);
    }
}

#[cfg(test)]
mod tests;
