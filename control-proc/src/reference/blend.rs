//! The way from standing still to a generator that starts elsewhere, without a jump.
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
//! Trap: the preview must be blended too. Otherwise the prediction sees a step at the end of its window.

/// Shortest time from standing still to following, s: a person near the machine sees the motion begin.
pub const BLEND_TIME: f64 = 2.0;
/// Fastest way to a generator that starts elsewhere, as share of `max_speed`.
pub const BLEND_SPEED: f64 = 0.25;
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
}

impl Blend {
    /// For an axis of this `max_speed`, m/s.
    pub fn new(max_speed: f64) -> Self {
        Self { speed: BLEND_SPEED * max_speed, start: 0.0, start_position: 0.0, time: BLEND_TIME }
    }

    /// Begins at tick `start` from `position` (m); `first` is g(0) in m, none without a generator.
    pub fn begin(&mut self, start: f64, position: f64, first: Option<f64>) {
        (self.start, self.start_position) = (start, position);
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

/// s: 10 r^3 - 15 r^4 + 6 r^5 between 0 and 1, and its end values outside.
pub fn smooth(r: f64) -> f64 {
    let r = r.clamp(0.0, 1.0);
    r * r * r * (10.0 - r * (15.0 - 6.0 * r))
}
