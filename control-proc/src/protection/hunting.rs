//! An axis that hunts: it swings though its reference does not ask for it, whoever controls it.
//!
//! ```text
//! d           = v - v_r
//! a flip      d passes +h after it has been below -h, or -h after it has been above +h          h = max(h_0, V/2)
//!             while d and v have one sign: the axis goes back, or faster than its reference; not after W on one side
//! a half wave ends with a flip whose time since the last one is 1/4 to 4 of that before, or the first flips of all
//! c(k)        = exp(-n T/W) c(k-1), 1 more at the end of a half wave, 2 more where its |d| was above 2 h,
//!               2 less when the reference turns, 0 at least                                      W = max(3 s, 20 L)
//! swings      c > 3
//!
//! free --swings--> fallback --swings--> half --swings--> quarter --swings--> latched, where |d| was above 2 h
//!      the model or the fallback       gain of the fallback                  at more than 3 flips
//! ```
//!
//! v speed of the axis and v_r of its reference m/s, n ticks since the last look, T period s, L dead time and lag s, V
//! root mean square of v_r in the last W; h_0 15 % of `max_speed`, or of three times the fastest commissioned
//! speed where that is less, and at least 4 counts in the time over which v is taken. Where the fallback has swung when
//! the axis was free, the step to the fallback is left out. After a step no flip counts for max(1 s, 6 L). A step is
//! taken back after 30 s without a swing, the next time after 60 s, up to 480 s.
//!
//! [`crate::model::swing`] compares the swing of a model with that of its fallback, from half a millimetre on. Here
//! nothing is compared: a loop that swings by this much is wrong whoever closes it. Where air in the oil or a larger
//! flow has made the gain too high, the next step has a lower one. A quarter of the gain keeps a loop stable whose
//! plant has become four times as fast, times its gain margin.
//!
//! Traps: the swing has to be found before it is faster than `max_speed`, where its positions are not believed any
//! more and the axis latches for another cause; hence speeds and not errors. A faster position has jumped, which is no
//! swing. And a load swings on for a while under any controller; hence the time after a step. Without it the gains of
//! an axis that others have shaken go down for nothing. And ground that gives way throws an axis forward, which comes
//! back, now and then; a loop that swings does it in a rhythm. Lower gains would let the ground throw it further.
//!
//! Runs in the loop: nothing here allocates after construction.

use pipeline::machine::{Axis, Commissioned};

/// W in s and in reactions of the axis.
const WINDOW: (f64, f64) = (3.0, 20.0);
/// h_0 in parts of the largest speed, and in counts.
const FLOOR: (f64, f64) = (0.15, 4.0);
/// Largest speed for h_0, in parts of the fastest commissioned one: a limit that is set far above what the axis does
/// hides its swings.
const LOOSE: f64 = 3.0;
/// h in parts of V.
const OF_REFERENCE: f64 = 0.5;
/// c of a swing, and what a turn of the reference takes off.
const FLIPS: f64 = 3.0;
const TURN: f64 = 2.0;
/// |d| that counts twice, and at the end latches, in parts of h.
const VIOLENT: f64 = 2.0;
/// Speed to and fro beyond which an axis latches at the end, in parts of the largest speed.
pub const LARGEST_SWING: f64 = VIOLENT * FLOOR.0;
/// Most by which one half wave is longer than the other.
const RHYTHM: f64 = 4.0;
/// Time in which a load swings on after a step, in s and in reactions of the axis.
const TRANSIENT: (f64, f64) = (1.0, 6.0);
/// Time without a swing after which a step is taken back, s, and how often it is doubled at most.
const QUIET: f64 = 30.0;
const DOUBLINGS: u32 = 4;

/// How much authority is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Caution {
    /// All: the model controls where it may.
    Free,
    /// The fallback controls.
    Fallback,
    /// The fallback controls with half of its gains.
    Half,
    /// The fallback controls with a quarter of its gains.
    Quarter,
}

impl Caution {
    /// Gains of the fallback in parts of those of the machine file.
    pub fn gain(self) -> f64 {
        match self {
            Self::Free | Self::Fallback => 1.0,
            Self::Half => 0.5,
            Self::Quarter => 0.25,
        }
    }

    /// The next step of a loop that swings; none after the last one.
    fn more(self, by_model: bool) -> Option<Self> {
        match self {
            Self::Free if by_model => Some(Self::Fallback),
            Self::Free | Self::Fallback => Some(Self::Half),
            Self::Half => Some(Self::Quarter),
            Self::Quarter => None,
        }
    }

    fn less(self) -> Self {
        match self {
            Self::Quarter => Self::Half,
            Self::Half => Self::Fallback,
            Self::Fallback | Self::Free => Self::Free,
        }
    }
}

/// How an axis moves at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Ticks since the last look, 1 when no sample is missing.
    pub elapsed: u64,
    /// Speed of the axis, m/s.
    pub axis: f64,
    /// Speed of the reference, m/s.
    pub reference: f64,
}

/// The side of its reference on which the axis was last, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
struct HalfWave {
    /// Largest d on that side, m/s; 0 for none yet.
    peak: f64,
    /// Time since the flip to this side, and since d was beyond h there, s.
    age: f64,
    quiet: f64,
    /// Length of the one before, s; 0 for none.
    before: f64,
}

impl HalfWave {
    /// No half wave yet.
    const NONE: Self = Self { peak: 0.0, age: 0.0, quiet: 0.0, before: 0.0 };

    /// Whether a flip now is one of a rhythm.
    fn is_regular(&self) -> bool {
        self.before == 0.0 || (self.before / RHYTHM..=self.before * RHYTHM).contains(&self.age)
    }
}

/// The steps that were taken.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Steps {
    caution: Caution,
    /// Time since the last step, s; infinite before the first one.
    since: f64,
    /// Time without a swing, s, and how often a step was taken.
    quiet: f64,
    count: u32,
}

impl Steps {
    /// None yet.
    const NONE: Self = Self { caution: Caution::Free, since: f64::INFINITY, quiet: 0.0, count: 0 };

    /// After this time in s without a swing: the last step is taken back where it has been quiet for long enough.
    fn rest(&mut self, time: f64) {
        self.quiet += time;
        let doublings = self.count.saturating_sub(1).min(DOUBLINGS);
        if self.caution != Caution::Free && self.quiet > QUIET * f64::from(1 << doublings) {
            (self.caution, self.quiet) = (self.caution.less(), 0.0);
        }
    }
}

/// The watch of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Hunting {
    period: f64,
    /// W, s.
    window: f64,
    /// Time after a step in which no flip counts, s.
    transient: f64,
    /// `max_speed`, m/s.
    fastest: f64,
    /// h_0, m/s; infinite where a swing costs no authority.
    floor: f64,
    half_wave: HalfWave,
    /// The last speed of the reference that was not 0, m/s; 0 for none yet.
    turned_from: f64,
    /// V2, m2/s2.
    speed: f64,
    /// c, and the number of flips from beyond 2 h, which fades alike.
    counts: [f64; 2],
    steps: Steps,
}

impl Hunting {
    /// Of `axis`, looked at every `period` s, whose speed is taken over `speed_time` s.
    pub fn new(axis: &Axis, period: f64, speed_time: f64) -> Self {
        let dead_time = axis.identification.structure.nk as f64 * period;
        let commissioned = axis.commissioned.as_ref();
        let reaction = commissioned.map_or(dead_time, Commissioned::reaction);
        let tested = commissioned.map_or(f64::INFINITY, |model| {
            let (retract, extend) = model.tested_speeds(axis.control.command_limit);
            retract.max(extend)
        });
        let fastest = axis.max_speed.min(LOOSE * tested);
        let floor = (FLOOR.0 * fastest).max(FLOOR.1 * axis.encoder.resolution / speed_time);
        Self {
            period,
            window: WINDOW.0.max(WINDOW.1 * reaction),
            transient: TRANSIENT.0.max(TRANSIENT.1 * reaction),
            fastest: axis.max_speed,
            floor: if axis.control.caution { floor } else { f64::INFINITY },
            half_wave: HalfWave::NONE,
            turned_from: 0.0,
            speed: 0.0,
            counts: [0.0; 2],
            steps: Steps::NONE,
        }
    }

    /// Forgets all: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.half_wave, self.turned_from, self.speed, self.counts) = (HalfWave::NONE, 0.0, 0.0, [0.0; 2]);
        self.steps = Steps::NONE;
    }

    /// How much authority is left.
    pub fn caution(&self) -> Caution {
        self.steps.caution
    }

    /// Takes in a tick in closed loop; `by_model`: the model made the last command. Whether the axis has to be stopped.
    pub fn update(&mut self, pace: &Pace, by_model: bool) -> bool {
        let time = pace.elapsed as f64 * self.period;
        self.count(pace, time);
        self.steps.since += time;
        if self.steps.since < self.transient {
            self.counts = [0.0; 2];
        }
        if self.counts[0] <= FLIPS {
            self.steps.rest(time);
            return false;
        }
        self.steps.quiet = 0.0;
        let Some(caution) = self.steps.caution.more(by_model) else { return self.counts[1] > FLIPS };
        self.steps = Steps { caution, since: 0.0, quiet: 0.0, count: self.steps.count.saturating_add(1) };
        self.counts = [0.0; 2];
        false
    }

    /// Counts the flips up to this tick, `time` s after the last one.
    fn count(&mut self, &Pace { axis, reference, .. }: &Pace, time: f64) {
        let part = 1.0 - (-time / self.window).exp();
        self.speed += part * (reference * reference - self.speed);
        let turn = if reference * self.turned_from < 0.0 { TURN } else { 0.0 };
        self.counts = self.counts.map(|count| ((1.0 - part) * count - turn).max(0.0));
        if reference != 0.0 {
            self.turned_from = reference;
        }
        let half_wave = &mut self.half_wave;
        (half_wave.age, half_wave.quiet) = (half_wave.age + time, half_wave.quiet + time);
        if half_wave.quiet > self.window {
            *half_wave = HalfWave::NONE;
        }
        let difference = axis - reference;
        let bound = self.floor.max(OF_REFERENCE * self.speed.sqrt());
        let is_behind = difference * axis <= 0.0;
        if difference.abs() <= bound || is_behind || axis.abs() > self.fastest {
            return;
        }
        half_wave.quiet = 0.0;
        if half_wave.peak == 0.0 {
            *half_wave = HalfWave { peak: difference, ..HalfWave::NONE };
        } else if difference * half_wave.peak < 0.0 {
            if half_wave.is_regular() {
                let is_violent = half_wave.peak.abs() > VIOLENT * bound;
                self.counts[0] += if is_violent { 2.0 } else { 1.0 };
                self.counts[1] += f64::from(u8::from(is_violent));
            }
            *half_wave = HalfWave { peak: difference, age: 0.0, quiet: 0.0, before: half_wave.age };
        } else if difference.abs() > half_wave.peak.abs() {
            half_wave.peak = difference;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    use pipeline::machine::Machine;

    const PERIOD: f64 = 0.01;

    /// Of an axis with a `max_speed` of 1 m/s.
    fn hunting() -> Hunting {
        let axis = Axis { max_speed: 1.0, ..crate::tests::machine(1).axes.remove(0) };
        Hunting::new(&axis, PERIOD, 0.04)
    }

    /// Seconds at which a step was taken, and at which the axis was stopped, within 20 s; the axis has the speed
    /// `axis(t, gain)` where its fallback has this part of its gains.
    fn steps(
        by_model: bool,
        axis: impl Fn(f64, Caution) -> f64,
        reference: impl Fn(f64) -> f64,
    ) -> (Vec<f64>, Option<f64>) {
        let (mut hunting, mut steps) = (hunting(), Vec::new());
        for tick in 0..2000 {
            let (t, before) = (f64::from(tick) * PERIOD, hunting.caution());
            let pace = Pace { elapsed: 1, axis: axis(t, before), reference: reference(t) };
            if hunting.update(&pace, by_model && before == Caution::Free) {
                return (steps, Some(t));
            }
            if hunting.caution() != before {
                steps.push(t);
            }
        }
        (steps, None)
    }

    fn swing(frequency: f64, amplitude: f64) -> impl Fn(f64, Caution) -> f64 {
        move |t, _| amplitude * (TAU * frequency * t).sin()
    }

    #[test]
    fn a_swing_loses_its_authority_within_two_seconds_and_is_stopped_at_last() {
        for (frequency, by_model) in [(1.0, true), (2.5, true), (2.5, false), (6.0, false)] {
            let (steps, stopped) = steps(by_model, swing(frequency, 0.5), |_| 0.0);
            assert_eq!(steps.len(), if by_model { 3 } else { 2 });
            assert!(steps[0] < 2.0 && stopped.is_some_and(|t| t < 9.0), "{frequency}: {steps:?} {stopped:?}");
        }
    }

    #[test]
    fn a_swing_that_lower_gains_end_goes_on_with_them() {
        let quiet = |t: f64, caution: Caution| 0.5 * (TAU * 2.5 * t).sin() * f64::from(u8::from(caution.gain() == 1.0));
        let (steps, stopped) = steps(false, quiet, |_| 0.0);
        assert!(steps.len() == 1 && stopped.is_none(), "{steps:?} {stopped:?}");
    }

    #[test]
    fn what_is_slow_or_one_way_or_asked_for_is_no_swing() {
        let none = (Vec::new(), None);
        assert_eq!(steps(true, swing(2.5, 0.14), |_| 0.0), none);
        // The reference turns as often, and the axis is late by a quarter of its period.
        let turns = |t: f64| 0.5 * (TAU * t).cos();
        assert_eq!(steps(true, swing(1.0, 0.5), turns), none);
        // A load that sags and is brought back is one way and back.
        assert_eq!(steps(true, |t, _| if t < 0.5 { -0.4 } else { 0.1 }, |_| 0.0), none);
    }

    /// The ground gives way again and again: the axis is thrown forward and comes back each time.
    #[test]
    fn a_load_that_lets_go_now_and_then_is_no_swing() {
        let thrown = |t: f64| match t {
            0.0..0.08 => 0.6,
            0.08..0.2 => -0.4,
            _ => 0.0,
        };
        for times in [[1.0, 2.1, 3.4, 4.2, 5.6, 7.0], [1.0, 1.6, 2.2, 2.8, 3.4, 4.0], [1.0, 6.0, 6.8, 12.0, 12.7, 18.0]]
        {
            for by_model in [false, true] {
                let axis = |t: f64, _| times.iter().map(|begin| thrown(t - begin)).sum();
                assert_eq!(steps(by_model, axis, |_| 0.0), (Vec::new(), None), "{times:?}");
            }
        }
    }

    /// A worn valve sticks the one way and not the other, so that its half waves are not alike.
    #[test]
    fn a_swing_whose_half_waves_differ_is_found() {
        let swing = |t: f64, _| if t.fract() < 0.25 { 0.5 } else { -0.5 / 3.0 };
        let (steps, _) = steps(true, swing, |_| 0.0);
        assert!(steps.first().is_some_and(|t| *t < 3.0), "{steps:?}");
    }

    #[test]
    fn a_swing_between_the_bounds_is_controlled_with_the_lowest_gains_and_not_stopped() {
        // An axis that stands and then catches up is late, and goes one way.
        let sticks = |t: f64, _| if (2.0 * t).fract() < 0.5 { 0.0 } else { 0.8 };
        assert_eq!(steps(false, sticks, |_| 0.4), (Vec::new(), None));
        let (steps, stopped) = steps(false, swing(2.0, 0.2), |_| 0.0);
        assert!(steps.len() == 2 && stopped.is_none(), "{steps:?} {stopped:?}");
    }

    #[test]
    fn a_step_is_taken_back_after_a_time_that_is_doubled() {
        let mut hunting = hunting();
        let seconds = |hunting: &mut Hunting, violent: bool, most: u32| {
            let before = hunting.caution();
            let tick = (0..100 * most).find(|tick| {
                let axis = if violent { 0.5 * (TAU * 0.02 * f64::from(*tick)).sin() } else { 0.0 };
                hunting.update(&Pace { elapsed: 1, axis, reference: 0.0 }, false);
                hunting.caution() != before
            });
            tick.map(|tick| f64::from(tick) * PERIOD)
        };
        seconds(&mut hunting, true, 5);
        assert_eq!(hunting.caution(), Caution::Half);
        let first = seconds(&mut hunting, false, 100).unwrap();
        assert!((first - 30.0).abs() < 3.0 && hunting.caution() == Caution::Fallback, "{first}");
        seconds(&mut hunting, true, 5);
        let second = seconds(&mut hunting, false, 100).unwrap();
        assert!((second - 60.0).abs() < 3.0, "{second}");
        hunting.reset();
        assert_eq!(hunting.caution(), Caution::Free);
    }

    #[test]
    fn a_limit_far_above_what_the_axis_does_hides_no_swing() {
        let axis = Axis { max_speed: 3.0, ..Machine::load(None, &[]).unwrap().axes.remove(1) };
        let tested = axis.commissioned.as_ref().unwrap().tested_speeds(axis.control.command_limit);
        let speed = 1.5 * FLOOR.0 * LOOSE * tested.0.max(tested.1);
        assert!(speed < FLOOR.0 * axis.max_speed, "the limit is loose");
        let mut hunting = Hunting::new(&axis, PERIOD, 0.04);
        let swing = swing(2.0, speed);
        for tick in 0..300 {
            hunting.update(
                &Pace { elapsed: 1, axis: swing(f64::from(tick) * PERIOD, Caution::Free), reference: 0.0 },
                false,
            );
        }
        assert_ne!(hunting.caution(), Caution::Free);
    }

    #[test]
    fn missing_samples_count_as_time() {
        let mut hunting = hunting();
        let swings = (0..8).any(|look| {
            let axis = if look % 2 == 0 { 0.5 } else { -0.5 };
            hunting.update(&Pace { elapsed: 20, axis, reference: 0.0 }, true);
            hunting.caution() != Caution::Free
        });
        assert!(swings);
    }
}
