//! Plausibility of the positions of one axis, and of its chamber pressures ([`pressure`]). Nothing in this folder
//! allocates.
//!
//! ```text
//! range:     -tolerance <= y <= stroke + tolerance
//! speed:     |y(k) - y_good|                <= n v_max T + margin
//!            |y(k) - y_good - n v_good T|   <=   v_max T + margin        for n <= 3
//! new base:  |y(k) - y(k-1)|                <=   v_max T + margin        for 0.5 s, after an implausible y, n > 3
//! stuck:     the raw value has not changed for stuck_after
//! ```
//!
//! y position, m; v_max `max_speed`, m/s; T period, s; y_good last good position, m; n number of ticks since y_good;
//! v_good median of the last three speeds between good positions, m/s; margin 5 counts.
//!
//! A count of a sensor at a joint is a length that varies over the stroke. The margin takes the greatest one
//! ([`Encoder::resolution`](pipeline::machine::Encoder)), so it is never too small, and up to about twice too large.
//!
//! **Range.** A position outside the range that an axis cannot have reached since the last tick is a wrong reading: it
//! gets the fault `SPEED`. If the next position is there, too, the axis is out of its stroke: that position gets the
//! fault `RANGE`.
//!
//! **Speed.** After an implausible position the distance that counts as plausible does not grow with time. A position
//! that has jumped by more than an axis moves in a tick therefore stays implausible until the controller has stopped
//! the axis and latched the fault. Only then the position becomes the new base. Without a new base, an axis with a new
//! cable could not be put back into service. Where no position has arrived at all, the plausible distance grows with
//! time. The median leaves out a single wrong speed, which comes from an error too small to be detected.
//!
//! **Runaway.** Positions that are too fast one after the other, evenly and in one direction, are those of an axis that
//! falls or is pushed, and not of an encoder that errs (`runaway`). They get the fault `RUNAWAY` as well.
//!
//! **Result.** An unusable position is replaced by the last good one and marked with its fault.
//!
//! Trap: the counts of an axis at rest do not change either. Stuck is therefore only a mark here. control-proc knows
//! whether the axis is commanded to move, and decides whether the mark is a fault. The raw value counts: an
//! inclinometer on the arm that is stuck shows a position that changes while the boom moves.

pub mod pressure;
mod runaway;

use std::{ops::RangeInclusive, time::Duration};

use pipeline::{
    machine::{Axis, samples_of},
    message::{AxisSample, sample_fault},
};
use runaway::Runaway;

/// Counts by which quantisation and noise can change the position of an axis at rest.
const SPEED_MARGIN: f64 = 5.0;
/// Ticks over which the last speed predicts a position. After this number of ticks without a good position the
/// controller has latched the fault.
const BRIDGE: u32 = 3;
/// Time for which positions after an implausible one have to follow each other plausibly until they are the new base.
/// It is many times what the controller needs to latch, and less than a person needs to reset the fault.
pub const NEW_BASE: Duration = Duration::from_millis(500);

/// What a sensor says at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// Position, m.
    pub position: f64,
    /// Raw value of the sensor, such as its counts; only whether it changes counts.
    pub raw: f64,
}

/// Checks the positions of one axis, tick by tick.
#[derive(Debug, Clone)]
pub struct Plausibility {
    /// Positions inside the range, m.
    range: RangeInclusive<f64>,
    /// v_max T, m.
    step: f64,
    /// m.
    margin: f64,
    /// T, s.
    period: f64,
    /// Ticks without a change after which the position is stuck.
    stuck_after: u32,
    new_base_ticks: u32,
    /// y_good; `None` before the first good position.
    good: Option<f64>,
    /// n.
    ticks_since_good: u32,
    /// Speeds between the last good positions, m per tick.
    speeds: [f64; 3],
    /// Whether a position since the last good one was implausible.
    suspect: bool,
    /// Part of a tick that the way to the present position may have taken in addition.
    more: f64,
    /// Number of ticks for which positions have followed each other plausibly.
    steady: u32,
    /// Position of the last reading, m.
    last: f64,
    /// Raw value of the last reading.
    raw: f64,
    /// Ticks for which the raw value has not changed.
    unchanged: u32,
    runaway: Runaway,
    sample: AxisSample,
}

impl Plausibility {
    /// Checks of `axis` with the sample period `period`.
    pub fn new(axis: &Axis, period: Duration) -> Self {
        let encoder = &axis.encoder;
        Self {
            range: -encoder.tolerance..=axis.stroke + encoder.tolerance,
            step: axis.max_speed * period.as_secs_f64(),
            margin: SPEED_MARGIN * encoder.resolution,
            period: period.as_secs_f64(),
            stuck_after: samples_of(encoder.stuck_after, period).max(1) as u32,
            new_base_ticks: samples_of(NEW_BASE, period).max(1) as u32,
            good: None,
            ticks_since_good: 0,
            speeds: [0.0; 3],
            suspect: false,
            more: 0.0,
            steady: 0,
            last: f64::NAN,
            raw: f64::NAN,
            unchanged: 0,
            runaway: Runaway::new(axis.max_speed * period.as_secs_f64(), period),
            sample: AxisSample::default(),
        }
    }

    /// Checks the position of this tick, m, or `None` when no reading arrived. This tick is `elapsed` ticks after the
    /// last one. `encoder_error` tells whether the encoder itself reports an error.
    pub fn judge(&mut self, elapsed: u64, position: Option<f64>, encoder_error: bool) -> AxisSample {
        self.judge_value(elapsed, 0.0, position.map(|position| Value { position, raw: position }), encoder_error)
    }

    /// As [`Self::judge`], of a position that may change while the raw value of its own sensor does not. The axis may
    /// have had `more` ticks, less than 1, for its way.
    pub fn judge_value(&mut self, elapsed: u64, more: f64, value: Option<Value>, encoder_error: bool) -> AxisSample {
        self.more = more;
        let elapsed = u32::try_from(elapsed.max(1)).unwrap_or(u32::MAX);
        self.ticks_since_good = self.ticks_since_good.saturating_add(elapsed);
        let mut faults = 0;
        let known = value.filter(|_| !encoder_error).map(|value| value.position);
        let runs = self.runaway.update(elapsed, known);
        // What an encoder says that reports an error says nothing of the axis.
        match value.filter(|_| !encoder_error) {
            None => {
                faults = if encoder_error { sample_fault::ENCODER } else { sample_fault::STALE };
                self.steady = 0;
            }
            Some(Value { position, raw }) => {
                let goes_on = (position - self.last).abs() <= self.within(f64::from(elapsed));
                self.steady = if goes_on { self.steady.saturating_add(elapsed) } else { 0 };
                self.unchanged = if raw == self.raw { self.unchanged.saturating_add(elapsed) } else { 0 };
                (self.last, self.raw) = (position, raw);
                // NaN is outside every range.
                let is_out = !self.range.contains(&position);
                let is_near = self.is_near(position);
                if is_out && (is_near || goes_on || !position.is_finite()) {
                    faults |= sample_fault::RANGE;
                } else if is_out || !is_near {
                    faults |= sample_fault::SPEED;
                }
                if faults & sample_fault::SPEED != 0 && runs {
                    faults |= sample_fault::RUNAWAY;
                }
                self.suspect |= faults & (sample_fault::RANGE | sample_fault::SPEED) != 0;
            }
        }
        if self.unchanged >= self.stuck_after {
            faults |= sample_fault::STUCK;
        }
        self.sample.faults = faults;
        self.sample.unchanged = self.unchanged;
        if let Some(Value { position, .. }) = value
            && faults & sample_fault::UNUSABLE == 0
        {
            self.take(position);
        }
        self.sample
    }

    /// Largest distance that an axis moves in `ticks` ticks, including noise, m.
    fn within(&self, ticks: f64) -> f64 {
        self.step * (ticks + self.more) + self.margin
    }

    /// Whether the axis can have reached this position since the last good one, or whether it is the new base.
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

    /// Takes `position`, m, as good.
    fn take(&mut self, position: f64) {
        let way = position - self.good.unwrap_or(position);
        let per_tick = way / f64::from(self.ticks_since_good);
        // The jump to a new base is no speed.
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
