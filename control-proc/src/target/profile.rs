//! From where a target is to where it shall be: bounded in speed, acceleration and jerk, and to be changed at any time.
//!
//! ```text
//! w(d)   = min(v_max, -b T/2 + sqrt((b T/2)^2 + 2 b |d|), |d| / T) sgn d        b = 0.8 a_max
//! v(k+1) = w(g - x(k)), at most a_max T from v(k)         x(k+1) = x(k) + T v(k+1)
//! y_r(k) = (x(k) + x(k-1) + .. + x(k-N+1)) / N            N T = 0.2 s
//! ```
//!
//! g goal m, x a motion of bounded speed and acceleration m, v its speed m/s, w the speed from which it still stops at
//! the goal, y_r target m, T period s. A mean over N points of a motion is as bounded as the motion, so
//! `|v_r| <= v_max` and `|a_r| <= a_max`; and a_r changes from tick to tick by the difference of two accelerations over
//! N, so its jerk is at most `2 a_max / (N T)`, reached only where the acceleration turns round at once. At the end all
//! N points are g, and y_r is g exactly.
//!
//! v_max is a quarter of `max_speed`, a_max is v_max over 0.25 s. A motion that is taken over faster than v_max is braked
//! to it. Source: acceleration-limited planning behind a moving
//! average, as numerical controls do it. Unlike with a curve of seven segments, nothing is planned that a new goal could
//! contradict: it may come at any tick.
//!
//! Traps: braking along w exactly asks for 1.125 times its deceleration in the last ticks, hence b below a_max. The mean
//! lags by half its length, so a motion that is taken over at a speed begins that much ahead of it.

use pipeline::machine::Axis;

/// Fastest speed of a target that nobody but the controller plans, as part of `max_speed`.
pub const SPEED: f64 = 0.25;
/// From standstill to that speed and back, s.
pub const RISE_TIME: f64 = 0.25;
/// Length of the mean, s: long against the lag of a valve, so that it can follow.
pub const SMOOTHING: f64 = 0.2;
/// Part of the acceleration that the braking curve counts on.
const BRAKING: f64 = 0.8;

/// The profile of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    period: f64,
    limits: (f64, f64),
    speed: f64,
    max_speed: f64,
    acceleration: f64,
    goal: f64,
    v: f64,
    /// x of the last N ticks, the newest last, and room for the coming ones.
    points: Vec<f64>,
    mean: usize,
}

impl Profile {
    /// For goals inside the axis' soft limits, and so many ticks ahead; `period` in s. Nothing is allocated after this.
    pub fn new(axis: &Axis, period: f64, ahead: usize) -> Self {
        let mean = ((SMOOTHING / period).round() as usize).max(1);
        let speed = SPEED * axis.max_speed;
        Self {
            period,
            limits: axis.soft_limits,
            speed,
            max_speed: axis.max_speed,
            acceleration: speed / RISE_TIME,
            goal: 0.0,
            v: 0.0,
            points: vec![0.0; mean + ahead],
            mean,
        }
    }

    /// Begins at `position` (m) and `speed` (m/s), towards where it comes to a stand.
    pub fn begin(&mut self, position: f64, speed: f64) {
        self.v = speed.max(-self.max_speed).min(self.max_speed);
        let (mean, step) = (self.mean, self.v * self.period);
        for (i, point) in self.points[..mean].iter_mut().enumerate() {
            *point = position + step * (i as f64 - 0.5 * (mean - 1) as f64);
        }
        self.stop();
    }

    /// Makes the goal where it comes to a stand, inside the soft limits.
    pub fn stop(&mut self) {
        let braking = BRAKING * self.acceleration;
        let way = self.v.abs() * (self.v.abs() / (2.0 * braking) + 0.5 * self.period);
        self.aim(self.points[self.mean - 1] + way.copysign(self.v));
    }

    /// Another goal, m; outside the soft limits the limit.
    pub fn aim(&mut self, goal: f64) {
        self.goal = goal.max(self.limits.0).min(self.limits.1);
    }

    /// The goal, m.
    pub fn goal(&self) -> f64 {
        self.goal
    }

    /// Whether it has arrived.
    pub fn stands(&self) -> bool {
        self.v == 0.0 && self.points[..self.mean].iter().all(|point| *point == self.goal)
    }

    /// Goes on by `ticks`.
    pub fn advance(&mut self, ticks: u64) {
        // After a gap of any length it stands: the axis that it is for has been latched long before.
        for _ in 0..ticks.min(1_000_000) {
            if self.stands() {
                break;
            }
            self.v = self.next_speed(self.points[self.mean - 1], self.v);
            self.points.copy_within(1..self.mean, 0);
            let last = self.points[self.mean - 1];
            self.points[self.mean - 1] = self.landed(last + self.v * self.period);
        }
    }

    /// Fills `targets` (m) with the present one and the coming ones, as many as it was made for.
    pub fn fill(&mut self, targets: &mut [f64]) {
        let (mean, mut v) = (self.mean, self.v);
        let count = targets.len().min(self.points.len() - mean + 1);
        for i in mean..mean + count.saturating_sub(1) {
            v = self.next_speed(self.points[i - 1], v);
            self.points[i] = self.landed(self.points[i - 1] + v * self.period);
        }
        for (i, target) in targets.iter_mut().enumerate() {
            let points = &self.points[i.min(count - 1)..][..mean];
            // Relative to one of them: the mean of equal numbers is that number, to the last bit.
            let newest = points[mean - 1];
            *target = newest + points.iter().map(|point| point - newest).sum::<f64>() / mean as f64;
        }
    }

    /// v(k+1).
    fn next_speed(&self, x: f64, v: f64) -> f64 {
        let way = self.goal - x;
        let half = 0.5 * BRAKING * self.acceleration * self.period;
        let braking = (half * half + 2.0 * BRAKING * self.acceleration * way.abs()).sqrt() - half;
        let wanted = braking.min(self.speed).min(way.abs() / self.period).copysign(way);
        let step = self.acceleration * self.period;
        wanted.max(v - step).min(v + step)
    }

    /// The goal itself in the place of what differs from it by rounding.
    fn landed(&self, x: f64) -> f64 {
        if (x - self.goal).abs() <= 1e-12 { self.goal } else { x }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: f64 = 0.01;
    /// Of the test machine: max_speed 1 m/s.
    const MOST: (f64, f64, f64) = (0.25, 1.0, 10.0);

    fn profile() -> Profile {
        Profile::new(&crate::tests::machine(1).axes[0], PERIOD, 20)
    }

    fn next(profile: &mut Profile) -> f64 {
        let mut targets = [0.0; 21];
        profile.advance(1);
        profile.fill(&mut targets);
        targets[0]
    }

    /// Largest speed, acceleration and jerk of a motion.
    fn largest(y: &[f64]) -> (f64, f64, f64) {
        let rates = |y: &[f64]| y.windows(2).map(|pair| (pair[1] - pair[0]) / PERIOD).collect::<Vec<_>>();
        let most = |y: &[f64]| y.iter().fold(0.0f64, |most, value| most.max(value.abs()));
        let (v, a) = (rates(y), rates(&rates(y)));
        (most(&v), most(&a), most(&rates(&a)))
    }

    #[test]
    fn it_goes_to_its_goal_at_full_speed_and_stays_there_exactly() {
        let mut profile = profile();
        profile.begin(0.3, 0.0);
        assert!(profile.stands());
        profile.aim(0.8);
        let y: Vec<f64> = (0..400).map(|_| next(&mut profile)).collect();
        let ticks = y.iter().position(|y| *y == 0.8).unwrap();
        // 0.5 m at 0.25 m/s, 0.25 s to that speed, 0.3125 s from it, and the mean: 2 + 0.125 + 0.156 + 0.2 s.
        assert!((245..255).contains(&ticks), "{ticks}");
        assert!(y[ticks..].iter().all(|y| *y == 0.8) && profile.stands());
        assert!(y.windows(2).all(|pair| pair[1] >= pair[0]), "it does not overshoot");
        assert!((largest(&y).0 - 0.25).abs() < 1e-9);
    }

    #[test]
    fn a_motion_is_taken_over_where_it_is_and_as_fast_as_it_is() {
        let mut profile = profile();
        profile.begin(0.5, -0.2);
        let y: Vec<f64> = (0..200).map(|_| next(&mut profile)).collect();
        assert!((y[0] - 0.498).abs() < 1e-4, "{}", y[0]);
        let (_, a, j) = largest(&[&[0.504, 0.502, 0.5], &y[..]].concat());
        assert!(a <= MOST.1 * 1.001 && j <= MOST.2 * 1.001, "{a} {j}");
        assert_eq!(y[199], profile.goal());
        assert!(y.windows(2).all(|pair| pair[1] <= pair[0]), "it does not come back");
    }

    #[test]
    fn what_it_shows_ahead_is_what_comes() {
        let mut profile = profile();
        profile.begin(0.5, 0.1);
        profile.aim(0.52);
        let mut ahead = [0.0; 21];
        profile.advance(1);
        profile.fill(&mut ahead);
        for expected in &ahead[1..] {
            assert_eq!(next(&mut profile), *expected);
        }
    }

    #[test]
    fn a_gap_takes_it_as_far_as_its_ticks() {
        let (mut one, mut other) = (profile(), profile());
        one.begin(0.5, 0.0);
        other.begin(0.5, 0.0);
        one.aim(0.9);
        other.aim(0.9);
        (0..7).for_each(|_| one.advance(1));
        other.advance(7);
        assert_eq!(one, other);
        other.advance(u64::MAX);
        assert!(other.stands());
    }

    proptest! {
        /// Goals anywhere at any time, from a beginning inside the limits from which it can still stop.
        #[test]
        fn bounds_hold_whatever_the_goals(
            start in 0.2f64..1.1,
            speed in -0.25f64..0.25,
            goals in prop::collection::vec((-0.5f64..2.0, 1usize..300), 1..8),
        ) {
            let mut profile = profile();
            profile.begin(start, speed);
            let mut y: Vec<f64> = (0..4).map(|i| start - f64::from(3 - i) * speed * PERIOD).collect();
            for (goal, ticks) in goals {
                profile.aim(goal);
                y.extend((0..ticks).map(|_| next(&mut profile)));
            }
            let (v, a, j) = largest(&y);
            prop_assert!(v <= MOST.0 * 1.000_001 && a <= MOST.1 * 1.000_01 && j <= MOST.2 * 1.000_1, "{v} {a} {j}");
            prop_assert!(y.iter().all(|y| (0.05..=1.284).contains(y)), "inside the soft limits");
            y.extend((0..1000).map(|_| next(&mut profile)));
            prop_assert_eq!(y[y.len() - 1], profile.goal());
        }
    }
}
