//! The time of the references along their path, which all axes share.
//!
//! ```text
//! s(k+1) = s(k) + min(r(s(k)), p(k), q_2(k))
//! r(s)   = min over the axes of min(1, v_a / |v|), at least 0.001
//! p(k+1) = p(k) - T / 0.2 s while an axis waits for readings, else p(k) + T / 1 s; from 0 to 1
//! q_1(k+1) = q_1(k) + (q - q_1(k)) T / 0.25 s          q_2(k+1) = q_2(k) + (q_1(k) - q_2(k)) T / 0.25 s
//! v      = (y_r(s+1) - y_r(s)) / T      v_a = min(0.9 c, v_s(y_r) + 10 mm/s)
//! ```
//!
//! k tick; s time along the path in ticks; r rate; p pace; y_r reference of an axis that tracks its generator, blend
//! included, m; v its speed at full rate, m/s; v_a the speed that this axis can give, m/s; c largest measured speed of
//! the commissioned axis that way, at `command_limit`, m/s; v_s speed from which the soft stop stops before the soft
//! limit ([`crate::protection::end_stops`]), m/s; T period, s. In r only axes with `slow_references` count, but all
//! generators go on by s. So what several axes trace together is the same path, only later.
//!
//! A tenth of c is left for the controller, to make good what disturbances cost. Without the 10 mm/s a reference would
//! never arrive at a soft limit.
//!
//! q is the pace that the lag of the teeth leaves ([`crate::tip::watch`]), 1 without them. Behind its two lags the path
//! slows and goes on again with a bounded jerk: at most v / (0.25 s)^2 for teeth of the speed v.
//!
//! While an axis waits at neutral for readings, the path comes to a stand for all of them, and goes on slowly when the
//! readings are back: an axis never has to make good what it has not been able to follow.
//!
//! Trap: controllers look at the coming references. So s is planned for the whole preview at once, and what a preview
//! has shown is what comes, until an axis waits. An axis that begins to follow is slowed only after that preview; its
//! blend is slow until then.
//!
//! Runs in the loop: nothing here allocates after construction.

use pipeline::machine::{Axis, Commissioned};

use crate::{model::response::MAX_AHEAD, protection::end_stops::EndStops};

/// Part of the largest measured speed that a reference may ask for.
const GIVEN: f64 = 0.9;
/// Speed with which a reference arrives at a soft limit, m/s.
const ARRIVAL: f64 = 0.01;
/// Least r, so that a wrong model delays a reference but never stops it.
const LEAST_RATE: f64 = 1e-3;
/// Time in which the path comes to a stand, s: about what an axis takes to stand once its valve is neutral.
pub(super) const FALL_TIME: f64 = 0.2;
/// Time in which the path goes on at its full rate, s.
pub(super) const RISE_TIME: f64 = 1.0;
/// Lags behind which the pace follows q, s.
const EASE_TIME: f64 = 0.25;
/// s of this tick and of all coming ones that any axis can look at, and of one more.
const LENGTH: usize = MAX_AHEAD + 1;

/// s of this tick and of the coming ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    ticks: [f64; LENGTH],
    /// How many of them are worked out.
    length: usize,
    /// The present tick; none before the first one.
    sequence: Option<u64>,
    /// p of the last one that is worked out.
    pace: f64,
    /// T, s.
    period: f64,
    /// Ticks that may be missing.
    patience: u64,
    /// An axis waits.
    waits: bool,
    /// q_1 and q_2.
    ease: (f64, f64),
}

impl Path {
    /// For axes that look at most so many ticks ahead; `period` in s. The path comes to a stand where more than
    /// `patience` ticks are missing.
    pub fn new(ahead: usize, period: f64, patience: u64) -> Self {
        let length = (ahead + 2).min(LENGTH);
        Self {
            ticks: [0.0; LENGTH],
            length,
            sequence: None,
            pace: 1.0,
            period,
            patience,
            waits: false,
            ease: (1.0, 1.0),
        }
    }

    /// Begins anew with the next tick, which may have any number.
    pub fn reset(&mut self) {
        self.sequence = None;
    }

    /// Goes on to tick `sequence`; `rate` is r(s), `waits` says whether an axis waits for readings, and `ease` is q.
    pub fn advance(&mut self, sequence: u64, (waits, ease): (bool, f64), rate: impl Fn(f64) -> f64) {
        let length = self.length;
        match self.sequence.replace(sequence).map(|last| sequence.saturating_sub(last)) {
            // Nobody has commanded anything meanwhile.
            Some(elapsed) if elapsed > self.patience => {
                let stand = self.ticks[0];
                self.ticks[..length].fill(stand);
                self.pace = 0.0;
            }
            Some(elapsed) => {
                for _ in 0..elapsed {
                    self.ticks.copy_within(1..length, 0);
                    let part = self.period / EASE_TIME;
                    self.ease.1 += part.min(1.0) * (self.ease.0 - self.ease.1);
                    self.ease.0 += part.min(1.0) * (ease - self.ease.0);
                    self.plan(length - 1, waits, &rate);
                }
                // What was planned does not count any more.
                if waits && !self.waits {
                    self.pace = (self.ticks[1] - self.ticks[0]).min(1.0);
                    (1..length).for_each(|i| self.plan(i, true, &rate));
                }
            }
            None => {
                self.ticks[..length].iter_mut().enumerate().for_each(|(i, tick)| *tick = (sequence + i as u64) as f64);
                self.pace = 1.0;
            }
        }
        self.waits = waits;
    }

    /// Works out the place `i` from the one before.
    fn plan(&mut self, i: usize, waits: bool, rate: impl Fn(f64) -> f64) {
        let change = if waits { -self.period / FALL_TIME } else { self.period / RISE_TIME };
        self.pace = (self.pace + change).clamp(0.0, 1.0);
        let last = self.ticks[i - 1];
        self.ticks[i] = last + rate(last).max(LEAST_RATE).min(self.pace).min(self.ease.1);
    }

    /// s(k), s(k+1), ..
    pub fn ticks(&self) -> &[f64] {
        &self.ticks[..self.length]
    }
}

/// What one axis can give.
#[derive(Debug, Clone, PartialEq)]
pub struct Capability {
    /// 0.9 c while retracting and extending, m/s.
    speeds: (f64, f64),
    end_stops: EndStops,
}

impl Capability {
    /// Of an axis with `slow_references`; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        let model = axis.commissioned.as_ref().filter(|_| axis.control.slow_references)?;
        Some(Self { speeds: given(axis, model), end_stops: EndStops::new(axis, period) })
    }

    /// r for a reference at `position` m whose speed at full rate is `speed` m/s.
    pub fn rate(&self, position: f64, speed: f64) -> f64 {
        let most = if speed > 0.0 { self.speeds.1 } else { self.speeds.0 };
        let given = most.min(self.end_stops.stopping_speed(speed.signum(), position) + ARRIVAL);
        if speed.abs() > given { given / speed.abs() } else { 1.0 }
    }
}

/// 0.9 c of an axis while it retracts and extends, m/s.
pub(super) fn given(axis: &Axis, model: &Commissioned) -> (f64, f64) {
    let (retract, extend) = model.tested_speeds(axis.control.command_limit);
    (GIVEN * retract, GIVEN * extend)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_full_rate_the_ticks_are_those_of_the_samples() {
        let mut path = Path::new(3, 0.01, 5);
        for sequence in [7, 8, 11, 16, 17] {
            path.advance(sequence, (false, 1.0), |_| 1.0);
            let expected: Vec<f64> = (0..5).map(|i| (sequence + i) as f64).collect();
            assert_eq!(path.ticks(), expected);
        }
        // A source that has begun again.
        path.reset();
        path.advance(2, (false, 1.0), |_| 1.0);
        assert_eq!(path.ticks()[0], 2.0);
    }

    #[test]
    fn the_ticks_of_a_preview_come_in_their_order_and_time_never_stops() {
        let mut path = Path::new(3, 0.01, 5);
        path.advance(0, (false, 1.0), |_| 1.0);
        let rate = |tick: f64| if (6.0..8.0).contains(&tick) { 0.25 } else { 1.0 };
        for sequence in 1..30 {
            let before = path.ticks().to_vec();
            path.advance(sequence, (false, 1.0), rate);
            assert_eq!(path.ticks()[..4], before[1..]);
        }
        // Two ticks of the path have taken eight.
        assert_eq!(path.ticks()[0], 29.0 - 6.0);
        let before = path.ticks()[4];
        path.advance(30, (false, 1.0), |_| 0.0);
        assert!(path.ticks()[4] > before);
    }

    #[test]
    fn the_path_slows_by_the_lag_of_the_teeth_with_bounded_acceleration_and_jerk_and_goes_on_again() {
        let mut path = Path::new(5, 0.01, 5);
        let mut ticks = vec![];
        for sequence in 0..900 {
            let ease = if (200..500).contains(&sequence) { 0.1 } else { 1.0 };
            path.advance(sequence, (false, ease), |_| 1.0);
            ticks.push(path.ticks()[0]);
        }
        let differences = |of: &[f64]| of.windows(2).map(|pair| (pair[1] - pair[0]) / 0.01).collect::<Vec<_>>();
        // Seconds of the path per second.
        let pace: Vec<f64> = differences(&ticks).iter().map(|pace| 0.01 * pace).collect();
        let acceleration = differences(&pace);
        let jerk = differences(&acceleration);
        let most = |of: &[f64]| of.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        assert!((pace[495] - 0.1).abs() < 1e-3 && (pace[890] - 1.0).abs() < 1e-3 && pace[100] == 1.0);
        assert!(most(&acceleration) < 0.9 / 0.25 && most(&jerk) < 1.001 * 0.9 / 0.0625, "{}", most(&jerk));
    }

    #[test]
    fn the_path_comes_to_a_stand_while_an_axis_waits_and_goes_on_slowly_from_there() {
        let mut path = Path::new(10, 0.01, 5);
        let pace = |path: &mut Path, sequence: u64, waits: bool| {
            let before = path.ticks()[0];
            path.advance(sequence, (waits, 1.0), |_| 1.0);
            assert!(path.ticks().windows(2).all(|pair| pair[0] <= pair[1]), "{:?}", path.ticks());
            path.ticks()[0] - before
        };
        (0..100).for_each(|sequence| path.advance(sequence, (false, 1.0), |_| 1.0));
        let falling: Vec<f64> = (100..140).map(|sequence| pace(&mut path, sequence, true)).collect();
        assert!(falling.windows(2).all(|pair| pair[1] <= pair[0] && pair[0] - pair[1] < 0.051), "{falling:?}");
        assert!(falling[21..].iter().all(|pace| *pace == 0.0) && falling.iter().sum::<f64>() < 11.5, "{falling:?}");
        let rising: Vec<f64> = (140..260).map(|sequence| pace(&mut path, sequence, false)).collect();
        assert!(rising.windows(2).all(|pair| pair[0] <= pair[1] && pair[1] - pair[0] < 0.011), "{rising:?}");
        assert!(rising[115] == 1.0 && rising[60] > 0.4, "{rising:?}");
        // A gap in the samples is a silence, too.
        assert_eq!(pace(&mut path, 300, false), 0.0);
        let rising: Vec<f64> = (301..440).map(|sequence| pace(&mut path, sequence, false)).collect();
        assert!(rising[0] == 0.0 && rising[130] == 1.0, "{rising:?}");
    }
}
