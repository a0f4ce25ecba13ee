//! Motion that nobody commanded.
//!
//! ```text
//! c(k)  = 2 v(s u + h + 0.1) where s u > 0, else 2 v(s u + h)                     with a commissioned model
//!       = 1.5 v_max where s u > d/2, else 0                                       without one
//! b(k)  = max(largest c of the last n ticks, min(b(k-1) exp(-T/tau_b), 1.5 largest s dy/T of the last n ticks))
//! o(k)  : -s u > d_w + 0.1 at each of the last n ticks, or o(k-1) and e(k-1) > 0
//! e(k)  = max(0, e(k-1) + s dy(k) - T (b(k) + v_d)), without v_d where o(k)
//! r(k)  = r(k-1) exp(-T/1.5 s) + s dy(k) while b(k) > 0 and s dy(k) > 0
//! w(k)  = max(e(k), w(k-1) exp(-T/1.5 s))
//! fault   e > e_0 + min(max(0.4 r', w'), 0.08 s v_m); where o(k), e > e_0/2 + the same;
//!         beyond the soft limit of this direction e > e_0/2 + min(w', 0.08 s v_m)
//! ```
//!
//! s direction, 1 extending and -1 retracting: all of this is computed once for each. u command, y position m, T period
//! s, v the commissioned curve as a magnitude m/s, h hysteresis, f natural frequency Hz where the load swings, d
//! calibrated dead band, v_max `max_speed` m/s, v_m the commissioned speed at the largest command, at most v_max, or
//! v_max without a model. c is the largest speed that a command explains, b the one that all commands so far explain, e
//! the way that they do not explain m, r the way of the last 1.5 s that was commanded m, w the largest e of about that
//! time m, r' and w' of the other direction.
//! Where o holds, the valve has long been open the other way, beyond d_w, the wider of the calibrated and the
//! commissioned dead band.
//!
//! | bound | is | reason |
//! |---|---|---|
//! | factor 2 of the speed | - | half of the load, warmer oil, more flow than at commissioning |
//! | 0.1 of the command | margin of a stall | a dead band that has shrunk by a quarter |
//! | n | 1.5 t_d + 3 T + 1/(2 f) | dead time, missing samples, and half a swing by which a load on oil lags its valve |
//! | tau_b | 2 tau; 0.3 s without a model | lag of a valve whose oil is as viscous as four times before |
//! | 1.5 of the measured speed | - | a load swings; an axis does not get faster after its valve has shut |
//! | v_d | `drift`, 2 % of v_max | drift is no fault, whatever the way: a worn telescope under load has 1.5 % |
//! | no v_d | where o | a leak moves no cylinder against an open valve |
//! | e_0 | 5 mm + 20 ms v_m, at most 20 mm | a load that pushes the piston against its oil; as in a commissioning |
//! | 0.4 r', 0.08 s v_m | as in a commissioning | a load on oil swings back when its valve shuts |
//! | w' | - | and then forth, no farther than it has come back |
//!
//! A position that jumps by more than 1.5 v_max T counts as that way: the rest is that of a faulty encoder. An axis
//! that is faster than it can be has no usable positions; `sensor-proc` says then that it runs away.
//!
//! The commands explain the motion of an armed axis as well as that of a disarmed one, which is always 0. What was on
//! the valve before the controller began is unknown: it begins as if that had been the largest command, both ways.
//!
//! Trap: the command alone says nothing of an axis that runs on. What is under way in the pilot lines comes out, and a
//! valve that shuts slowly lets the axis run. So every bound comes from the past commands, not from the last one.

use pipeline::machine::{Axis, Commissioned, MotionLimits};

use super::motion::{NOISE_COUNTS, STALL_MARGIN, widest_dead_band};

/// Way without a command that is a fault, m: a load that is pushed moves the piston on its oil. Of a commissioning,
/// this and the next are the way against the command within 0.2 s.
pub const AGAINST_DISTANCE: f64 = 5e-3;
/// Addition to that way for each m/s of the fastest speed, s.
pub const AGAINST_TIME: f64 = 0.02;
/// Part of the way made just before by which an axis may swing back.
pub const SWING: f64 = 0.4;
/// Most that it may swing back for each m/s of the fastest speed, s: a load that swings with 2 Hz and has the speed v
/// when its valve shuts goes v / (2 pi 2 Hz) too far, and as much back.
pub const SWING_TIME: f64 = 0.08;
/// Factor of the commissioned speed that a command explains.
const SPEED_FACTOR: f64 = 2.0;
/// Factor of `max_speed` that a command explains on an axis without a commissioned model.
const UNKNOWN_FACTOR: f64 = 1.5;
/// Part of the calibrated dead band that no valve leaves.
const SHUT: f64 = 0.5;
/// Factor of the dead time for which a command explains motion.
const DEAD_TIME_FACTOR: f64 = 1.5;
/// Ticks for which a command explains motion beyond that.
const MORE_TICKS: usize = 3;
/// Factor of the time constant with which the motion of past commands may end.
const LAG_FACTOR: f64 = 2.0;
/// Most way without a command that is no fault, m.
const LONGEST_WAY: f64 = 0.02;
/// Time for which commanded motion makes the load swing back, s.
const SWING_MEMORY: f64 = 1.5;
/// Part of e_0 that is allowed beyond a soft limit, since only the end stop comes after it, and against an open valve.
const STRICT: f64 = 0.5;
/// Factor of the measured speed with which an axis may run out.
const RUN_OUT_FACTOR: f64 = 1.5;

/// The largest of the last values, for as many ticks as it was made for.
#[derive(Debug, Clone, PartialEq)]
struct Largest {
    ticks: u64,
    now: u64,
    /// Tick and value, a ring: from the oldest to the newest the values fall. A copy of it has the same room.
    values: Box<[(u64, f64)]>,
    /// Index of the oldest of them.
    oldest: usize,
    count: usize,
}

impl Largest {
    fn new(ticks: usize) -> Self {
        Self { ticks: ticks as u64, now: 0, values: vec![(0, 0.0); ticks + 2].into(), oldest: 0, count: 0 }
    }

    /// Begins with a value.
    fn from(ticks: usize, value: f64) -> Self {
        let mut largest = Self::new(ticks);
        largest.update(1, value);
        largest
    }

    /// Takes in the value of the last `elapsed` ticks, at least 1, and returns the largest.
    fn update(&mut self, elapsed: u64, value: f64) -> f64 {
        self.now = self.now.saturating_add(elapsed.max(1));
        while self.count > 0 && self.values[self.place(self.count - 1)].1 <= value {
            self.count -= 1;
        }
        while self.count > 0 && self.values[self.oldest].0.saturating_add(self.ticks) < self.now {
            (self.oldest, self.count) = (self.place(1), self.count - 1);
        }
        self.values[self.place(self.count)] = (self.now, value);
        self.count += 1;
        self.values[self.oldest].1
    }

    /// Index of the value that came so many after the oldest.
    fn place(&self, after: usize) -> usize {
        (self.oldest + after) % self.values.len()
    }
}

/// One direction.
#[derive(Debug, Clone, PartialEq)]
struct Direction {
    /// c, m/s.
    explained: Largest,
    /// s dy/T, m/s.
    measured: Largest,
    /// s u; a drive that holds its command against this direction has none but small values.
    commanded_along: Largest,
    /// d_w of the other direction.
    dead_band_against: f64,
    /// o.
    is_against: bool,
    /// b, m/s.
    bound: f64,
    /// e, m.
    way: f64,
    /// r, m.
    commanded: f64,
    /// w, m.
    swung: f64,
}

/// What the commands of an axis explain.
#[derive(Debug, Clone, PartialEq)]
enum Explained {
    /// By the commissioned model.
    Model(Box<Commissioned>),
    /// d of retracting and extending.
    Unknown(f64, f64),
}

/// Watches one axis for motion that nobody commanded, in every state and mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncommanded {
    period: f64,
    explained: Explained,
    max_speed: f64,
    /// v_d, m/s.
    drift: f64,
    soft_limits: (f64, f64),
    /// v_m, m/s.
    fastest: f64,
    /// tau_b, s.
    lag: f64,
    /// e_0, m.
    allowed: f64,
    /// The last usable position, m, and the ticks since then; none before the first one.
    last: Option<f64>,
    blind: u64,
    /// Retracting and extending.
    directions: [Direction; 2],
}

impl Uncommanded {
    /// Of `axis`, before the first sample; `period` in s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        let model = axis.commissioned.as_ref();
        let dead_time = (axis.identification.structure.nk as f64 * period).max(model.map_or(0.0, |m| m.dead_time));
        let half_swing = model.filter(|m| m.natural_frequency > 0.0).map_or(0.0, |m| 0.5 / m.natural_frequency);
        let half_swing = half_swing.min(MotionLimits::UNKNOWN_REACTION);
        let ticks = ((DEAD_TIME_FACTOR * dead_time + half_swing) / period).ceil() as usize + MORE_TICKS;
        // Commissioning may have tested slow motion only, so the curve is continued to the largest command.
        let limit = axis.control.command_limit;
        let fastest = model.map_or(axis.max_speed, |model| model.speed(limit).max(-model.speed(-limit)));
        let fastest = fastest.min(axis.max_speed);
        let dead_band = axis.control.dead_band;
        let widest = widest_dead_band(axis);
        let direction = |dead_band_against| Direction {
            explained: Largest::new(ticks),
            measured: Largest::from(ticks, UNKNOWN_FACTOR * axis.max_speed),
            commanded_along: Largest::new(ticks),
            dead_band_against,
            is_against: false,
            bound: UNKNOWN_FACTOR * axis.max_speed,
            way: 0.0,
            commanded: axis.max_speed,
            swung: 0.0,
        };
        Self {
            period,
            explained: model.map_or(Explained::Unknown(dead_band.retract, dead_band.extend), |model| {
                Explained::Model(Box::new(model.clone()))
            }),
            max_speed: axis.max_speed,
            drift: axis.control.drift,
            soft_limits: axis.soft_limits,
            fastest,
            lag: model.map_or(MotionLimits::UNKNOWN_REACTION, |model| LAG_FACTOR * model.time_constant),
            allowed: (AGAINST_DISTANCE + AGAINST_TIME * fastest)
                .min(LONGEST_WAY)
                .max(2.0 * NOISE_COUNTS * axis.encoder.resolution),
            last: None,
            blind: 0,
            directions: [direction(widest.extend), direction(widest.retract)],
        }
    }

    /// Begins to measure the way anew: somebody has released the axis. The commands so far still explain motion.
    pub fn reset(&mut self) {
        self.last = None;
        for direction in &mut self.directions {
            (direction.way, direction.is_against) = (0.0, false);
        }
    }

    /// Whether the axis makes a motion that nobody commanded, `elapsed` ticks after the last call. `command` has been
    /// on the valve since then; `position` (m) is where the axis is now, if that is known. After more than
    /// `lost_after` ticks without a position the way is measured anew: an encoder that is believed again has no speed.
    pub fn update(&mut self, elapsed: u64, command: f64, position: Option<f64>, lost_after: u64) -> bool {
        let time = elapsed as f64 * self.period;
        self.blind = self.blind.saturating_add(elapsed);
        let way = match (position, self.last) {
            (Some(position), Some(last)) if self.blind <= lost_after => position - last,
            _ => 0.0,
        };
        let seen = if position.is_some() { self.blind as f64 * self.period } else { 0.0 };
        if position.is_some() {
            (self.last, self.blind) = (position, 0);
        }
        // No cylinder jumps: the rest is a fault of the encoder.
        let most = UNKNOWN_FACTOR * self.max_speed * seen;
        let way = way.clamp(-most, most);
        let (kept, forgotten) = ((-time / self.lag.max(self.period)).exp(), (-time / SWING_MEMORY).exp());
        let explained = [-1.0, 1.0].map(|sign| self.speed(sign, command));
        for ((direction, sign), speed) in self.directions.iter_mut().zip([-1.0, 1.0]).zip(explained) {
            // An axis that is not seen may have any speed.
            let speed_now = if seen > 0.0 { sign * way / seen } else { UNKNOWN_FACTOR * self.max_speed };
            let measured = direction.measured.update(elapsed, speed_now);
            let runs_out = (kept * direction.bound).min((RUN_OUT_FACTOR * measured).max(0.0));
            direction.bound = direction.explained.update(elapsed, speed).max(runs_out);
            let is_open =
                direction.commanded_along.update(elapsed, sign * command) < -direction.dead_band_against - STALL_MARGIN;
            direction.is_against = is_open || (direction.is_against && direction.way > 0.0);
            let drift = if direction.is_against { 0.0 } else { self.drift };
            direction.way = (direction.way + sign * way - seen * (direction.bound + drift)).max(0.0);
            let made = if direction.bound > self.drift { (sign * way).max(0.0) } else { 0.0 };
            direction.commanded = forgotten * direction.commanded + made;
            direction.swung = direction.way.max(forgotten * direction.swung);
        }
        let is_beyond = |sign: f64, at: f64| if sign > 0.0 { at > self.soft_limits.1 } else { at < self.soft_limits.0 };
        let is_fault = |direction: &Direction, other: &Direction, sign: f64| {
            let most = SWING_TIME * self.fastest;
            let swing = (SWING * other.commanded).max(other.swung).min(most);
            let allowed = if self.last.is_some_and(|at| is_beyond(sign, at)) {
                STRICT * self.allowed + other.swung.min(most)
            } else if direction.is_against {
                STRICT * self.allowed + swing
            } else {
                self.allowed + swing
            };
            direction.way > allowed
        };
        let [retract, extend] = &self.directions;
        is_fault(retract, extend, -1.0) || is_fault(extend, retract, 1.0)
    }

    /// c, m/s: the largest speed in the direction `sign` that a command explains.
    fn speed(&self, sign: f64, command: f64) -> f64 {
        let along = sign * command;
        match &self.explained {
            Explained::Model(model) => {
                let margin = if along > 0.0 { STALL_MARGIN } else { 0.0 };
                let open = (along + model.hysteresis + margin).max(0.0);
                let (low, high) = model.tested();
                let is_tested = open <= if sign > 0.0 { high } else { -low };
                let speed = SPEED_FACTOR * model.speed(sign * open).abs();
                if is_tested { speed } else { speed.max(UNKNOWN_FACTOR * self.max_speed) }
            }
            Explained::Unknown(retract, extend) => {
                let dead_band = if sign > 0.0 { extend } else { retract };
                if along > SHUT * dead_band { UNKNOWN_FACTOR * self.max_speed } else { 0.0 }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::commissioned};

    const PERIOD: f64 = 0.01;

    /// Seconds until an axis of 1 m/s latches, and its way, from 10 s on. It stands before that.
    fn latches(is_known: bool, command: impl Fn(f64) -> f64, position: impl Fn(f64) -> f64) -> Option<(f64, f64)> {
        let mut axis = machine(1).axes[0].clone();
        axis.commissioned = is_known.then(commissioned);
        let mut watch = Uncommanded::new(&axis, PERIOD);
        (0..2000).find_map(|k| {
            let time = f64::from(k) * PERIOD - 10.0;
            let (u, y) = if time < 0.0 { (0.0, position(0.0)) } else { (command(time), position(time)) };
            watch.update(1, u, Some(y), 3).then(|| (time, (y - position(0.0)).abs()))
        })
    }

    #[test]
    fn motion_at_neutral_and_against_the_command_latches_within_its_way_both_ways() {
        for is_known in [false, true] {
            for speed in [-0.8, -0.1, 0.1, 0.8] {
                for command in [0.0, -0.5f64.copysign(speed)] {
                    let (time, way) = latches(is_known, |_| command, |t| 0.6 + speed * t).unwrap();
                    let bound = LONGEST_WAY + 1e-3 + 0.02 * time + 2.0 * PERIOD * speed.abs();
                    assert!(way <= bound, "{is_known} {speed} {command}: {time} s, {way} m");
                }
            }
        }
    }

    #[test]
    fn the_largest_of_the_last_values_is_kept_for_its_ticks() {
        let mut largest = Largest::new(3);
        let values: Vec<f64> = (0..200u32).map(|k| f64::from(k * 7919 % 31)).collect();
        for k in 0..values.len() {
            let expected = values[k.saturating_sub(3)..=k].iter().copied().fold(f64::NEG_INFINITY, f64::max);
            assert_eq!(largest.update(1, values[k]), expected, "{k}");
        }
        assert_eq!(largest.update(10, 1.0), 1.0);
    }

    #[test]
    fn drift_noise_and_a_load_that_is_pushed_do_not_latch() {
        for is_known in [false, true] {
            assert_eq!(latches(is_known, |_| 0.0, |t| 0.6 - 0.019 * t), None);
            assert_eq!(latches(is_known, |_| 0.0, |t| 0.6 + 4e-3 * (25.0 * t).sin()), None);
        }
    }

    /// A leak moves no cylinder against an open valve, but one whose valve is shut.
    #[test]
    fn motion_as_slow_as_drift_latches_against_an_open_valve_alone() {
        for is_known in [false, true] {
            for speed in [-0.01, 0.01f64] {
                let (time, way) = latches(is_known, |_| -0.3f64.copysign(speed), |t| 0.6 + speed * t).unwrap();
                assert!(way <= STRICT * LONGEST_WAY + 0.01 * 0.5, "{is_known} {speed}: {time} s, {way} m");
                assert_eq!(latches(is_known, |_| -0.1f64.copysign(speed), |t| 0.6 + speed * t), None);
                // The command that has seen it may end before the way is made.
                let ends = |t: f64| if t < 0.7 { -0.3f64.copysign(speed) } else { 0.0 };
                assert!(latches(is_known, ends, |t| 0.6 + speed * t).is_some());
            }
        }
    }

    /// An axis that has moved with 0.1 m/s does not run out as one that has moved with 1.5 m/s.
    #[test]
    fn what_an_axis_may_run_out_comes_from_the_speed_that_it_had() {
        let command = |t: f64| if t < 2.0 { 0.5 } else { -0.3 };
        for is_known in [false, true] {
            let (time, _) = latches(is_known, command, |t| 0.3 + 0.1 * t).unwrap();
            assert!(time < 2.0 + 0.6, "{is_known}: {time} s");
        }
        // One that obeys after 0.2 s, with a lag of as much.
        let obeys = |t: f64| {
            let after = (t - 2.2).max(0.0);
            0.3 + 0.1 * t.min(2.2) + 0.1 * 0.2 * (1.0 - (-after / 0.2).exp())
        };
        assert_eq!(latches(false, command, obeys), None);
    }

    #[test]
    fn an_axis_whose_drift_is_known_latches_at_half_of_the_usual_drift() {
        let way = |drift: f64| {
            let mut axis = machine(1).axes[0].clone();
            axis.control.drift = drift;
            let mut watch = Uncommanded::new(&axis, PERIOD);
            // 10 mm/s, where 20 mm/s are usual.
            let way = |k: u32| 1e-4 * f64::from(k.saturating_sub(1000));
            (0..3000).find(|k| watch.update(1, 0.0, Some(0.6 - way(*k)), 3)).map(way)
        };
        assert_eq!((way(0.02), way(0.0101)), (None, None));
        assert!(way(2e-3).is_some_and(|way| way <= LONGEST_WAY / 0.8 + 1e-3), "{:?}", way(2e-3));
    }

    #[test]
    fn an_axis_runs_out_and_swings_back_after_its_command() {
        let command = |t: f64| if t < 1.0 { 0.5 } else { 0.0 };
        // It comes to a stand with a time constant of 0.1 s, and swings back by a tenth of its way.
        let position = |t: f64| {
            let run_out = 0.03 * (1.0 - (-(t - 1.0).max(0.0) / 0.1).exp());
            let back = 0.02 * ((t - 1.3) / 0.2).clamp(0.0, 1.0);
            0.4 + 0.3 * t.min(1.0) + run_out - back
        };
        for is_known in [false, true] {
            assert_eq!(latches(is_known, command, position), None);
        }
    }

    /// Of an axis of 0.3 m/s: 11 mm are a fault, and up to 24 mm more after a swing.
    #[test]
    fn a_load_that_has_swung_back_may_swing_forth_as_far_and_no_farther() {
        let latches = |position: &dyn Fn(f64) -> f64| {
            let mut axis = machine(1).axes[0].clone();
            axis.max_speed = 0.3;
            let mut watch = Uncommanded::new(&axis, PERIOD);
            (-1000..600).map(|k| f64::from(k) * PERIOD).find(|time| {
                let command = if (0.0..1.0).contains(time) { 0.5 } else { 0.0 };
                watch.update(1, command, Some(position(*time)), 3)
            })
        };
        // It stops within 0.1 s and swings with 1.4 Hz, by 20 mm to and fro.
        let stops = |t: f64| 0.4 + 0.2 * t.clamp(0.0, 1.0);
        let swing = |after: f64| if after > 0.0 { 0.011 * (-0.3 * after).exp() * (8.8 * after).sin() } else { 0.0 };
        assert_eq!(latches(&|t| stops(t) + swing(t - 1.0)), None);
        let goes_on = latches(&|t| stops(t) + swing(t - 1.0) + 0.1 * (t - 2.5).max(0.0));
        assert!(goes_on.is_some_and(|time| time < 2.5 + 0.4), "{goes_on:?}");
        // Without a swing back nothing more is allowed.
        let runs_on = latches(&|t| stops(t) + 0.1 * (t - 2.5).max(0.0));
        assert!(runs_on.is_some_and(|time| time < 2.5 + 0.15), "{runs_on:?}");
    }

    /// Of an axis that is off, 6 mm beyond its soft limit, while the stop of another one shakes it.
    #[test]
    fn a_load_that_swings_beyond_a_soft_limit_may_come_back_to_where_it_was() {
        let swings = |by: f64, goes_on: f64| {
            let swing = move |t: f64| if t > 0.0 { -by * (-0.3 * t).exp() * (8.8 * t).sin() } else { 0.0 };
            latches(true, |_| 0.0, move |t| 1.29 + swing(t) + goes_on * (t - 1.5).max(0.0))
        };
        assert_eq!(swings(0.01, 0.0), None);
        let (time, _) = swings(0.01, 0.1).unwrap();
        assert!(time < 1.5 + 0.3, "{time}");
        assert!(swings(-0.015, 0.0).is_some(), "outwards first");
    }

    #[test]
    fn beyond_a_soft_limit_half_of_the_way_is_allowed() {
        let way = |from: f64| latches(false, |_| 0.0, |t| from + 0.1 * t).unwrap().1;
        assert!(way(1.29) < 0.6 * way(0.6), "{} {}", way(1.29), way(0.6));
    }

    #[test]
    fn what_was_commanded_before_the_controller_began_is_allowed_and_a_jump_after_blindness_is_none() {
        let axis = machine(1).axes[0].clone();
        let mut watch = Uncommanded::new(&axis, PERIOD);
        let runs_out = |k: i32| 0.6 + 0.1 * (1.0 - (-0.05 * f64::from(k)).exp());
        assert!((0..300).all(|k| !watch.update(1, 0.0, Some(runs_out(k)), 3)));
        assert!((0..50).all(|_| !watch.update(1, 0.0, None, 3)));
        assert!(!watch.update(1, 0.0, Some(0.9), 3));
        assert!(!watch.update(1, 0.0, Some(0.95), 3), "a jump of the encoder");
        assert!((1..20).any(|k| watch.update(1, 0.0, Some(0.95 + 0.01 * f64::from(k)), 3)));
    }
}
