//! The time of the references along their path, which all axes share.
//!
//! ```text
//! s(k+1) = s(k) + r(s(k))      r(s) = min over the axes of min(1, v_a / |v|), at least 0.001
//! v      = (y_r(s+1) - y_r(s)) / T      v_a = min(0.9 c, v_s(y_r) + 10 mm/s)
//! ```
//!
//! k tick; s time along the path in ticks; r rate; y_r reference of an axis that tracks its generator, blend included,
//! m; v its speed at full rate, m/s; v_a the speed that this axis can give, m/s; c largest measured speed of the
//! commissioned axis that way, at `command_limit`, m/s; v_s speed from which the soft stop stops before the soft limit
//! ([`crate::protection::end_stops`]), m/s; T period, s. Only axes with `slow_references` count, but all generators go
//! on by s. So what several axes trace together is the same path, only later.
//!
//! A tenth of c is left for the controller, to make good what disturbances cost. Without the 10 mm/s a reference would
//! never arrive at a soft limit.
//!
//! Trap: controllers look at the coming references. So s is planned for the whole preview at once, and what a preview
//! has shown is what comes. An axis that begins to follow is slowed only after that preview; its blend is slow until
//! then.
//!
//! Runs in the loop: nothing here allocates after construction.

use pipeline::machine::Axis;

use crate::{model::response::MAX_AHEAD, protection::end_stops::EndStops};

/// Part of the largest measured speed that a reference may ask for.
const GIVEN: f64 = 0.9;
/// Speed with which a reference arrives at a soft limit, m/s.
const ARRIVAL: f64 = 0.01;
/// Least r, so that a wrong model delays a reference but never stops it.
const LEAST_RATE: f64 = 1e-3;
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
}

impl Path {
    /// For axes that look at most so many ticks ahead.
    pub fn new(ahead: usize) -> Self {
        Self { ticks: [0.0; LENGTH], length: (ahead + 2).min(LENGTH), sequence: None }
    }

    /// Begins anew with the next tick, which may have any number.
    pub fn reset(&mut self) {
        self.sequence = None;
    }

    /// Goes on to tick `sequence`; `rate` is r(s).
    pub fn advance(&mut self, sequence: u64, rate: impl Fn(f64) -> f64) {
        let length = self.length;
        match self.sequence.map(|last| (last, sequence.saturating_sub(last))) {
            Some((_, elapsed)) if elapsed <= length as u64 => {
                for _ in 0..elapsed {
                    let last = self.ticks[length - 1];
                    self.ticks.copy_within(1..length, 0);
                    self.ticks[length - 1] = last + rate(last).max(LEAST_RATE);
                }
            }
            // After a gap in which every axis has been latched, time goes on at full rate.
            Some((last, _)) => self.fill(sequence as f64 - (last as f64 - self.ticks[0])),
            None => self.fill(sequence as f64),
        }
        self.sequence = Some(sequence);
    }

    fn fill(&mut self, first: f64) {
        self.ticks[..self.length].iter_mut().enumerate().for_each(|(i, tick)| *tick = first + i as f64);
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
        let (retract, extend) = model.tested_speeds(axis.control.command_limit);
        Some(Self { speeds: (GIVEN * retract, GIVEN * extend), end_stops: EndStops::new(axis, period) })
    }

    /// The lesser of both speeds, m/s.
    pub fn speed(&self) -> f64 {
        self.speeds.0.min(self.speeds.1)
    }

    /// r for a reference at `position` m whose speed at full rate is `speed` m/s.
    pub fn rate(&self, position: f64, speed: f64) -> f64 {
        let most = if speed > 0.0 { self.speeds.1 } else { self.speeds.0 };
        let given = most.min(self.end_stops.stopping_speed(speed.signum(), position) + ARRIVAL);
        if speed.abs() > given { given / speed.abs() } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_full_rate_the_ticks_are_those_of_the_samples_whatever_is_missing() {
        let mut path = Path::new(3);
        for sequence in [7, 8, 11, 10_000, 10_001] {
            path.advance(sequence, |_| 1.0);
            let expected: Vec<f64> = (0..5).map(|i| (sequence + i) as f64).collect();
            assert_eq!(path.ticks(), expected);
        }
        // A source that has begun again.
        path.reset();
        path.advance(2, |_| 1.0);
        assert_eq!(path.ticks()[0], 2.0);
    }

    #[test]
    fn the_ticks_of_a_preview_come_in_their_order_and_time_never_stops() {
        let mut path = Path::new(3);
        path.advance(0, |_| 1.0);
        let rate = |tick: f64| if (6.0..8.0).contains(&tick) { 0.25 } else { 1.0 };
        for sequence in 1..30 {
            let before = path.ticks().to_vec();
            path.advance(sequence, rate);
            assert_eq!(path.ticks()[..4], before[1..]);
        }
        // Two ticks of the path have taken eight.
        assert_eq!(path.ticks()[0], 29.0 - 6.0);
        let before = path.ticks()[4];
        path.advance(30, |_| 0.0);
        assert!(path.ticks()[4] > before);
        // After a long gap time goes on from there.
        let late = 30.0 - path.ticks()[0];
        path.advance(1000, |_| 1.0);
        assert_eq!(path.ticks()[0], 1000.0 - late);
    }
}
