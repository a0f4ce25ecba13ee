//! The way from standing still to a generator that starts elsewhere, or that has gone on while the axis stood.
//!
//! ```text
//! y_r(t) = y_0 + s(t / T_b) (g(t) - y_0)           s(r) = 10 r^3 - 15 r^4 + 6 r^5 for 0 <= r <= 1, then 1
//! T_b    = max(2 s, 15/8 |g(0) - y_0| / (v_max / 4))
//! ```
//!
//! y_r reference in m, y_0 position in m at which the axis began to follow, g generator in m, t time since then in s,
//! v_max `max_speed` in m/s. Speed and acceleration of s are 0 at both ends. The steepest slope of s is 15/8, so T_b
//! keeps the way to the generator below a quarter of the axis' largest speed. y_r lies between y_0 and g: outside the
//! soft limits it is only where the axis already stood.
//!
//! An axis that has waited at neutral for readings stands beside its reference when they are back. It returns by an
//! offset that fades:
//!
//! ```text
//! y_r(t) = y_b(t) + (1 - s(t / T_o)) o       o = y(0) - y_b(0)       T_o = max(0.5 s, 15/8 |o| / (v_max / 10))
//! ```
//!
//! y_b the reference without an offset, m; y position, m; t time since the return, s. The way back adds at most a tenth
//! of v_max to the speed of the reference. y_r stays in the soft limits, unless y_b or y(0) are outside of them.
//!
//! Trap: the preview must be blended too. Otherwise the prediction sees a step at the end of its window.

/// Shortest time from standing still to following, s: a person near the machine sees the motion begin.
pub const BLEND_TIME: f64 = 2.0;
/// Fastest way to a generator that starts elsewhere, as share of `max_speed`.
pub const BLEND_SPEED: f64 = 0.25;
/// Shortest time of a return, s.
const RETURN_TIME: f64 = 0.5;
/// Speed that a return adds to the one of the reference, as share of `max_speed`: slower than a way that somebody has
/// just asked for.
pub(super) const RETURN_SPEED: f64 = 0.1;
/// Steepest slope of s.
const STEEPEST: f64 = 15.0 / 8.0;

/// The blend of one axis, since it last began to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Blend {
    /// Fastest speed of the way, m/s.
    speed: f64,
    /// Tick along the path at which the axis began to follow ([`super::path`]).
    start: f64,
    /// y_0, m.
    start_position: f64,
    /// T_b, s.
    time: f64,
    /// What is added to y_r since readings were missing.
    pub back: Return,
}

impl Blend {
    /// For an axis of this `max_speed` (m/s) and these soft limits (m).
    pub fn new(max_speed: f64, limits: (f64, f64)) -> Self {
        Self {
            speed: BLEND_SPEED * max_speed,
            start: 0.0,
            start_position: 0.0,
            time: BLEND_TIME,
            back: Return::new(max_speed, limits),
        }
    }

    /// No faster than `speed` m/s.
    pub fn within(self, speed: f64) -> Self {
        Self { speed: self.speed.min(speed), ..self }
    }

    /// Begins at tick `start` from `position` (m); `first` is g(0) in m, none without a generator.
    pub fn begin(&mut self, start: f64, position: f64, first: Option<f64>) {
        (self.start, self.start_position) = (start, position);
        self.back.offset = 0.0;
        let distance = first.map_or(0.0, |first| (first - position).abs());
        self.time = BLEND_TIME.max(STEEPEST * distance / self.speed);
    }

    /// Ticks from the start to `tick`.
    pub fn ticks(&self, tick: f64) -> f64 {
        (tick - self.start).max(0.0)
    }

    /// y_r in m at `t` s after the start, towards g(t) of `generated` m; y_0 without a generator.
    pub fn position(&self, t: f64, generated: Option<f64>) -> f64 {
        let wanted = generated.unwrap_or(self.start_position);
        self.start_position + smooth(t / self.time) * (wanted - self.start_position)
    }

    /// Whether the way is over `t` s after the start.
    pub fn is_over(&self, t: f64) -> bool {
        t >= self.time
    }
}

/// The fading offset of one axis, after readings have been missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Return {
    /// Fastest speed of the way back, m/s.
    speed: f64,
    /// Soft limits, m.
    limits: (f64, f64),
    /// Tick along the path at which the axis was seen again.
    start: f64,
    /// y(0), m.
    position: f64,
    /// o, m.
    offset: f64,
    /// T_o in ticks.
    ticks: f64,
}

impl Return {
    /// Without an offset, for an axis of this `max_speed` (m/s) and these soft limits (m).
    pub fn new(max_speed: f64, limits: (f64, f64)) -> Self {
        Self { speed: RETURN_SPEED * max_speed, limits, start: 0.0, position: 0.0, offset: 0.0, ticks: RETURN_TIME }
    }

    /// Begins at tick `start` and `position` (m), where the reference without an offset is `blended` m; `period` in s.
    pub fn begin(&mut self, start: f64, position: f64, blended: f64, period: f64) {
        (self.start, self.position, self.offset) = (start, position, position - blended);
        self.ticks = RETURN_TIME.max(STEEPEST * self.offset.abs() / self.speed) / period;
    }

    /// y_r in m at `tick` along the path, where the reference without an offset is `blended` m.
    pub fn position(&self, tick: f64, blended: f64) -> f64 {
        if self.offset == 0.0 {
            return blended;
        }
        let (low, high) = self.limits;
        let left = 1.0 - smooth((tick - self.start) / self.ticks);
        (blended + left * self.offset)
            .max(low.min(blended).min(self.position))
            .min(high.max(blended).max(self.position))
    }
}

/// s: 10 r^3 - 15 r^4 + 6 r^5 between 0 and 1, and its end values outside.
pub fn smooth(r: f64) -> f64 {
    let r = r.clamp(0.0, 1.0);
    r * r * r * (10.0 - r * (15.0 - 6.0 * r))
}
