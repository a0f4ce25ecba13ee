//! What the search changes: dead time, lag and dead bands; and the curve that belongs to them.

use nalgebra::DVector;
use pipeline::machine::{Commissioned, DeadBand, Overrun};

use super::{spring::Spring, start::Start};
use crate::commission::record::ExperimentRecord;

/// Dead time s, logarithm of the time constant, dead bands of extending and retracting, width of the hysteresis, and
/// what the load on its spring of oil adds: its period s (0 for a stiff one) and damping ratio; and what the start of
/// the oil needs: times of extending and retracting and lag, s; and how much harder the load pulls at most than is
/// needed to overrun the axis while it extends and retracts.
pub(super) type Parameters = [f64; 12];

/// What a record holds at most.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Magnitudes of a command while extending and while retracting.
    pub commands: [f64; 2],
    /// Pull of the load while extending and while retracting, N; 0 where it is not known.
    pub pulls: [f64; 2],
    /// Least pulls that may overrun an axis while it extends and retracts, N.
    least: [f64; 2],
}

impl Seen {
    pub fn of(record: &ExperimentRecord) -> Self {
        let most = |values: &[f64], sign: f64| values.iter().fold(0.0f64, |most, value| most.max(sign * value));
        Self {
            commands: [most(&record.commands, 1.0), most(&record.commands, -1.0)],
            pulls: [most(&record.loads, -1.0), most(&record.loads, 1.0)],
            least: record.least_overruns,
        }
    }

    /// Magnitude of a command of either direction.
    pub fn largest(&self) -> f64 {
        self.commands[0].max(self.commands[1])
    }

    /// How much harder the load may pull at most than is needed to overrun the axis.
    pub fn most_overruns(&self) -> [f64; 2] {
        [self.pulls[0] / self.least[0], self.pulls[1] / self.least[1]]
    }

    /// The pulls from which on loads overrun the axis: those that were found, else the largest ones of the record. What
    /// harder pulls do is not known, and an axis that is faster than its controllers expect is worse than a slower one.
    pub fn overrun(&self, found: Overrun) -> Overrun {
        let of = |found: f64, side: usize| found.min(self.pulls[side].max(self.least[side]));
        Overrun { extend: of(found.extend, 0), retract: of(found.retract, 1) }
    }
}

/// Bends of either direction.
pub(super) const KNOTS: usize = 6;
/// Where the curve bends, in parts of the largest opening.
pub(super) const BENDS: [f64; KNOTS] = [0.0, 0.1, 0.22, 0.38, 0.58, 0.8];
/// Longest dead time that is searched, s.
const LONGEST_DEAD_TIME: f64 = 1.2;
/// Shortest time constant that is searched, s.
const SHORTEST_TIME_CONSTANT: f64 = 1e-3;
/// Longest time constant that is searched, s.
const LONGEST_TIME_CONSTANT: f64 = 2.0;
/// Widest dead band that is searched.
const WIDEST_DEAD_BAND: f64 = 0.9;
/// Widest hysteresis that is searched: pilot-operated valves have 0.03 to 0.05, worn ones three times that.
const WIDEST_HYSTERESIS: f64 = 0.15;
/// Least rise of a curve from point to point, m/s, so that the curve can be inverted.
const LEAST_RISE: f64 = 1e-6;
/// Least speed at the end of a curve that moves its way, m/s.
const LEAST_SPEED: f64 = 1e-3;

/// A point of the search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    /// s.
    pub dead_time: f64,
    /// s.
    pub time_constant: f64,
    pub dead_band: DeadBand,
    pub hysteresis: f64,
    pub spring: Spring,
    pub start: Start,
    pub overrun: Overrun,
    /// Pulls of the record by P_0.
    overruns: [f64; 2],
    /// Largest opening.
    pub span: f64,
}

impl Shape {
    /// From the parameters and what is in the record; none if the commands never leave the dead bands.
    pub fn of(p: &Parameters, seen: &Seen) -> Option<Self> {
        let span = seen.largest() - 0.5 * p[4] - p[2].min(p[3]);
        let dead_band = DeadBand { extend: p[2], retract: p[3] };
        // A pull that no load of the record has is none.
        let least = |pull: f64, part: f64| if part > 1.0 { pull / part } else { f64::INFINITY };
        (span > 0.0).then_some(Self {
            dead_time: p[0],
            time_constant: p[1].exp(),
            dead_band,
            hysteresis: p[4],
            spring: Spring { period: p[5], damping: p[6] },
            start: Start { times: [p[7], p[8]], lag: p[9] },
            overrun: Overrun { extend: least(seen.pulls[0], p[10]), retract: least(seen.pulls[1], p[11]) },
            overruns: [p[10], p[11]],
            span,
        })
    }

    /// Whether all parameters are in the ranges that are searched.
    pub fn is_allowed(&self, seen: &Seen) -> bool {
        (0.0..=LONGEST_DEAD_TIME).contains(&self.dead_time)
            && (SHORTEST_TIME_CONSTANT..=LONGEST_TIME_CONSTANT).contains(&self.time_constant)
            && (0.0..=WIDEST_DEAD_BAND).contains(&self.dead_band.extend)
            && (0.0..=WIDEST_DEAD_BAND).contains(&self.dead_band.retract)
            && (0.0..=WIDEST_HYSTERESIS).contains(&self.hysteresis)
            && self.spring.is_allowed()
            && self.start.is_allowed()
            && self.overruns.iter().zip(seen.most_overruns()).all(|(part, most)| (0.0..=most.max(1.0)).contains(part))
    }

    /// The model of this shape whose changes of slope come first among `slopes`; none where a direction does not move
    /// its way.
    pub fn model(&self, slopes: &DVector<f64>) -> Option<Commissioned> {
        let openings: Vec<f64> = BENDS[1..].iter().chain(&[1.0]).map(|part| part * self.span).collect();
        let speeds = |side: usize| {
            let mut last = 0.0;
            let at = |opening: f64| -> f64 {
                let bends = BENDS.iter().enumerate();
                bends.map(|(j, part)| slopes[side * KNOTS + j] * (opening - part * self.span).max(0.0)).sum()
            };
            let speeds: Vec<f64> = (openings.iter())
                .map(|opening| {
                    last = at(*opening).max(last + LEAST_RISE);
                    last
                })
                .collect();
            (last > LEAST_SPEED).then_some(speeds)
        };
        let DeadBand { extend, retract } = self.dead_band;
        let half = 0.5 * self.hysteresis;
        Some(Commissioned {
            dead_time: self.dead_time,
            time_constant: self.time_constant + self.spring.delay(),
            dead_band: DeadBand { extend: extend + half, retract: retract + half },
            hysteresis: self.hysteresis,
            natural_frequency: self.spring.frequency(),
            damping: self.spring.damping,
            speeds_extend: speeds(0)?,
            speeds_retract: speeds(1)?,
            openings,
            largest_tested: [f64::INFINITY; 2],
            overrun: self.overrun,
            mass: f64::INFINITY,
            noise: 0.0,
            fit_percent: f64::NAN,
        })
    }
}
