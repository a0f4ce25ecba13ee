//! The motion of a reference to a set point, bounded in speed, acceleration and jerk. The set point may change at any
//! tick.
//!
//! ```text
//! w(d)   = min(f v_max, -b T/2 + sqrt((b T/2)^2 + 2 b |d|), |d| / T) sgn d      b = 0.8 a_max
//! f      = 2 - 2 e / e_b, from 0.1 to 1
//! v(k+1) = w(g - x(k)), at most a_max T from v(k)         x(k+1) = x(k) + T v(k+1)
//! y_r(k) = (x(k) + x(k-1) + .. + x(k-N+1)) / N            N T = 0.2 s r, rounded up
//! ```
//!
//! g set point m, x a motion of bounded speed and acceleration m, v its speed m/s, w the speed from which it still
//! stops at the set point, y_r reference m, T period s; e way by which the axis lags behind y_r m, and e_b the floor of
//! the bound on that ([`crate::protection::following_error`]) m. The mean over N points of a motion is as bounded as
//! the motion, so `|v_r| <= v_max` and `|a_r| <= a_max`. From tick to tick a_r changes by the difference of two
//! accelerations over N, so the jerk is at most `2 a_max / (N T)`; it is reached only where the acceleration reverses
//! at once. At the end all N points are g, and y_r is exactly g.
//!
//! v_max is a quarter of `max_speed`, or nine tenths of what the commissioned axis was measured to reach either way
//! where that is less: nobody has asked for a speed, so none is planned that the axis cannot give. For an axis that
//! gives less today the motion waits, by f. It never stands: that an axis does not move at all is still found. a_max is
//! v_max over 0.25 s r. With r = sqrt(10 1/s2 `max_speed` / `jerk`) the bound of the jerk is `jerk`; r is 1 for the
//! usual jerk. A motion that is faster than v_max at its beginning is braked to v_max. Source: acceleration-limited
//! planning behind a moving average, as in numerical controls. Other than a curve of seven segments, this motion has no
//! plan that a new set point could contradict.
//!
//! Traps: braking exactly along w asks for 1.125 times its deceleration in the last ticks, hence b is below a_max. The
//! mean lags by half its length, so a motion that begins with a speed begins that much ahead.

use pipeline::machine::Axis;

use super::path::given;

/// Fastest speed of a reference that the controller plans itself, as part of `max_speed`.
pub const SPEED: f64 = 0.25;
/// Time from standstill to that speed, s.
const RISE_TIME: f64 = 0.25;
/// Length of the mean, s: long against the lag of a valve, so that the axis can follow.
const SMOOTHING: f64 = 0.2;
/// Part of the acceleration that the braking curve uses.
const BRAKING: f64 = 0.8;
/// Least part of its speed with which a motion waits.
const LEAST_PART: f64 = 0.1;

/// Ticks after which every motion has come to a stand.
const MOST_TICKS: u64 = 1_000_000;
/// Usual jerk per `max_speed`, 1/s2.
const USUAL_JERK: f64 = 2.0 * SPEED / (RISE_TIME * SMOOTHING);
/// Distance from the set point that is due to rounding, m.
const ROUNDING: f64 = 1e-12;

/// The profile of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    period: f64,
    /// Soft limits, m.
    limits: (f64, f64),
    /// v_max, m/s.
    most: f64,
    /// f v_max, m/s.
    speed: f64,
    /// e_b, m.
    bound: f64,
    /// The axis' `max_speed`, m/s.
    max_speed: f64,
    /// a_max, m/s2.
    acceleration: f64,
    /// g, m.
    set_point: f64,
    /// v, m/s.
    v: f64,
    /// x of the last N ticks, the newest last, and room for the coming ones.
    points: Vec<f64>,
    /// N.
    mean: usize,
}

impl Profile {
    /// For set points inside the axis' soft limits, and so many ticks ahead; `period` in s. Nothing is allocated after
    /// this.
    pub fn new(axis: &Axis, period: f64, ahead: usize) -> Self {
        let measured = axis.commissioned.as_ref().map(|model| given(axis, model));
        let given = measured.map_or(f64::INFINITY, |(retract, extend)| retract.min(extend));
        let speed = given.min(SPEED * axis.max_speed);
        let ratio = (USUAL_JERK * axis.max_speed / axis.motion_limits(period).jerk).sqrt();
        // The small part keeps whole periods from counting one more by rounding.
        let mean = ((ratio * SMOOTHING / period - 1e-6).ceil() as usize).max(1);
        Self {
            period,
            limits: axis.soft_limits,
            most: speed,
            speed,
            bound: axis.control.following_error,
            max_speed: axis.max_speed,
            acceleration: speed / (RISE_TIME * ratio),
            set_point: 0.0,
            v: 0.0,
            points: vec![0.0; mean + ahead],
            mean,
        }
    }

    /// Begins at `position` (m) and `speed` (m/s), and comes to a stand.
    pub fn begin(&mut self, position: f64, speed: f64) {
        self.v = speed.max(-self.max_speed).min(self.max_speed);
        let (mean, step) = (self.mean, self.v * self.period);
        for (i, point) in self.points[..mean].iter_mut().enumerate() {
            *point = position + step * (i as f64 - 0.5 * (mean - 1) as f64);
        }
        self.stop();
    }

    /// Comes to a stand: the set point becomes the place where the motion can stop, inside the soft limits.
    pub fn stop(&mut self) {
        let braking = BRAKING * self.acceleration;
        let way = self.v.abs() * (self.v.abs() / (2.0 * braking) + 0.5 * self.period);
        self.aim(self.points[self.mean - 1] + way.copysign(self.v));
    }

    /// Changes the set point, m. Outside the soft limits the limit is taken.
    pub fn aim(&mut self, set_point: f64) {
        self.set_point = set_point.max(self.limits.0).min(self.limits.1);
    }

    /// The set point, m.
    pub fn set_point(&self) -> f64 {
        self.set_point
    }

    /// Whether the motion has arrived.
    pub fn stands(&self) -> bool {
        self.v == 0.0 && self.points[..self.mean].iter().all(|point| *point == self.set_point)
    }

    /// Moves on by `ticks`; the reference is `error` m beyond the axis.
    pub fn advance(&mut self, ticks: u64, error: f64) {
        let lag = error * (self.set_point - self.points[self.mean - 1]).signum();
        let waits = lag > 0.5 * self.bound;
        self.speed = self.most * if waits { (2.0 - 2.0 * lag / self.bound).max(LEAST_PART) } else { 1.0 };
        // An axis with a longer gap in its samples has been latched long before.
        for _ in 0..ticks.min(MOST_TICKS) {
            if self.stands() {
                break;
            }
            self.v = self.next_speed(self.points[self.mean - 1], self.v);
            self.points.copy_within(1..self.mean, 0);
            let last = self.points[self.mean - 1];
            self.points[self.mean - 1] = self.landed(last + self.v * self.period);
        }
    }

    /// Fills `positions` with the present reference and the coming ones (m), as many as the profile was made for.
    pub fn fill(&mut self, positions: &mut [f64]) {
        let (mean, mut v) = (self.mean, self.v);
        let count = positions.len().min(self.points.len() - mean + 1);
        for i in mean..mean + count.saturating_sub(1) {
            v = self.next_speed(self.points[i - 1], v);
            self.points[i] = self.landed(self.points[i - 1] + v * self.period);
        }
        let (goal, first) = (self.set_point, &self.points[..mean]);
        let mut sum: f64 = first.iter().map(|point| point - goal).sum();
        let mut arrived = first.iter().rev().take_while(|point| **point == goal).count();
        for (i, reference) in positions.iter_mut().enumerate() {
            if (1..count).contains(&i) {
                let newest = self.points[i + mean - 1];
                sum += newest - self.points[i - 1];
                arrived = if newest == goal { arrived + 1 } else { 0 };
            }
            // The sum is only nearly 0 at the end, and y_r is to be exactly g.
            *reference = if arrived >= mean { goal } else { goal + sum / mean as f64 };
        }
    }

    /// v(k+1).
    fn next_speed(&self, x: f64, v: f64) -> f64 {
        let way = self.set_point - x;
        let half = 0.5 * BRAKING * self.acceleration * self.period;
        let braking = (half * half + 2.0 * BRAKING * self.acceleration * way.abs()).sqrt() - half;
        let wanted = braking.min(self.speed).min(way.abs() / self.period).copysign(way);
        let step = self.acceleration * self.period;
        wanted.max(v - step).min(v + step)
    }

    /// The set point itself where x differs from it by rounding only.
    fn landed(&self, x: f64) -> f64 {
        if (x - self.set_point).abs() <= ROUNDING { self.set_point } else { x }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: f64 = 0.01;
    /// Bounds of the test machine with a `max_speed` of 1 m/s: m/s, m/s2, m/s3.
    const MOST_SPEED: f64 = 0.25;
    const MOST_ACCELERATION: f64 = 1.0;
    const MOST_JERK: f64 = 10.0;

    fn profile() -> Profile {
        Profile::new(&crate::tests::machine(1).axes[0], PERIOD, 20)
    }

    fn next(profile: &mut Profile) -> f64 {
        let mut targets = [0.0; 21];
        profile.advance(1, 0.0);
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
    fn the_motion_goes_to_its_set_point_at_full_speed_and_stays_exactly_there() {
        let mut profile = profile();
        profile.begin(0.3, 0.0);
        assert!(profile.stands());
        profile.aim(0.8);
        let y: Vec<f64> = (0..400).map(|_| next(&mut profile)).collect();
        let ticks = y.iter().position(|y| *y == 0.8).unwrap();
        // 0.5 m at 0.25 m/s, 0.25 s to that speed, 0.3125 s from it, and the mean: 2 + 0.125 + 0.156 + 0.2 s.
        assert!((245..255).contains(&ticks), "{ticks}");
        assert!(y[ticks..].iter().all(|y| *y == 0.8) && profile.stands());
        assert!(y.windows(2).all(|pair| pair[1] >= pair[0]), "the motion overshoots");
        assert!((largest(&y).0 - 0.25).abs() < 1e-9);
    }

    #[test]
    fn the_jerk_is_that_of_the_machine_file() {
        let mut axis = crate::tests::machine(1).axes.remove(0);
        let mut arrivals = Vec::new();
        for jerk in [2.0, 10.0, 40.0, 1000.0] {
            axis.control.limits.jerk = Some(jerk);
            let mut profile = Profile::new(&axis, PERIOD, 20);
            profile.begin(0.3, 0.0);
            profile.aim(0.8);
            let y: Vec<f64> = (0..600).map(|_| next(&mut profile)).collect();
            let (v, _, j) = largest(&[&[0.3; 3], &y[..]].concat());
            assert!(v <= MOST_SPEED * 1.000_001 && j <= jerk * 1.000_1, "{v} m/s, {j} m/s3 for {jerk}");
            assert!(j > 0.4 * jerk, "{j} m/s3 for {jerk}");
            arrivals.push(y.iter().position(|y| *y == 0.8).unwrap());
        }
        assert!(arrivals.is_sorted_by(|a, b| a > b), "{arrivals:?}");
        // Without a key the motion is that of ten times max_speed.
        axis.control.limits.jerk = Some(10.0);
        assert_eq!(Profile::new(&axis, PERIOD, 20), profile());
    }

    #[test]
    fn an_axis_is_asked_for_no_more_than_it_was_measured_to_give() {
        let mut axis = crate::tests::machine(1).axes.remove(0);
        let model = crate::tests::models::commissioned();
        axis.commissioned = Some(pipeline::machine::Commissioned { speeds_retract: vec![0.05, 0.2], ..model });
        for (is_known, expected) in [(true, 0.9 * 0.2), (false, 0.25)] {
            axis.commissioned = axis.commissioned.filter(|_| is_known);
            let mut profile = Profile::new(&axis, PERIOD, 20);
            profile.begin(0.3, 0.0);
            profile.aim(1.0);
            let y: Vec<f64> = (0..400).map(|_| next(&mut profile)).collect();
            assert!((largest(&y).0 - expected).abs() < 1e-9, "{} m/s", largest(&y).0);
        }
    }

    #[test]
    fn a_motion_begins_at_the_given_position_and_speed() {
        let mut profile = profile();
        profile.begin(0.5, -0.2);
        let y: Vec<f64> = (0..200).map(|_| next(&mut profile)).collect();
        assert!((y[0] - 0.498).abs() < 1e-4, "{}", y[0]);
        let (_, a, j) = largest(&[&[0.504, 0.502, 0.5], &y[..]].concat());
        assert!(a <= MOST_ACCELERATION * 1.001 && j <= MOST_JERK * 1.001, "{a} {j}");
        assert_eq!(y[199], profile.set_point());
        assert!(y.windows(2).all(|pair| pair[1] <= pair[0]), "the motion comes back");
    }

    #[test]
    fn the_coming_references_are_those_that_come() {
        let mut profile = profile();
        profile.begin(0.5, 0.1);
        profile.aim(0.52);
        let mut ahead = [0.0; 21];
        profile.advance(1, 0.0);
        profile.fill(&mut ahead);
        for expected in &ahead[1..] {
            assert_eq!(next(&mut profile), *expected);
        }
    }

    #[test]
    fn a_gap_counts_as_its_ticks() {
        let (mut one, mut other) = (profile(), profile());
        one.begin(0.5, 0.0);
        other.begin(0.5, 0.0);
        one.aim(0.9);
        other.aim(0.9);
        (0..7).for_each(|_| one.advance(1, 0.0));
        other.advance(7, 0.0);
        assert_eq!(one, other);
        other.advance(u64::MAX, 0.0);
        assert!(other.stands());
    }

    proptest! {
        /// Set points anywhere at any time, from a beginning inside the limits from which the motion can still stop.
        #[test]
        fn bounds_hold_for_all_set_points(
            start in 0.2f64..1.1,
            speed in -0.25f64..0.25,
            set_points in prop::collection::vec((-0.5f64..2.0, 1usize..300), 1..8),
        ) {
            let mut profile = profile();
            profile.begin(start, speed);
            let mut y: Vec<f64> = (0..4).map(|i| start - f64::from(3 - i) * speed * PERIOD).collect();
            for (set_point, ticks) in set_points {
                profile.aim(set_point);
                y.extend((0..ticks).map(|_| next(&mut profile)));
            }
            let (v, a, j) = largest(&y);
            let holds = v <= MOST_SPEED * 1.000_001 && a <= MOST_ACCELERATION * 1.000_01 && j <= MOST_JERK * 1.000_1;
            prop_assert!(holds, "{v} {a} {j}");
            prop_assert!(y.iter().all(|y| (0.05..=1.284).contains(y)), "outside the soft limits");
            y.extend((0..1000).map(|_| next(&mut profile)));
            prop_assert_eq!(y[y.len() - 1], profile.set_point());
        }
    }
}
