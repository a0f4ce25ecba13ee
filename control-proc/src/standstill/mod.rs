//! Standstill: what an axis does while its references stand still.
//!
//! | module | what it holds |
//! |---|---|
//! | [`pulse`] | the command of a creeping axis |
//!
//! ```text
//! follows -> rests      |e| <= e_rest, or the axis stands, |e| <= e_wake, and the controller does not integrate
//! follows -> creeps     the axis stands, |e| > e_wake, and the controller does not integrate
//! rests   -> follows    |e| > e_wake under a controller that integrates, or the axis is left to it
//! rests   -> creeps     |e| > e_wake under another one, 2 L + 0.3 s or more after the valve was shut
//! creeps  -> rests      the pulse is over
//! all     -> follows    a reference moves, or |e| has grown by e_far
//! ```
//!
//! e following error m, e_rest `rest_band` m, e_wake, e_far and e_drift m, L dead time and lag in s. All but a moving
//! reference need references that have stood still for 0.3 s. An axis stands when it has moved by less than a quarter
//! of e in 0.3 s + L. While the axis rests, the valve is shut and the oil holds the load. While it creeps, a pulse
//! brings it closer. When pulses do not help, the axis is left to its controller until a reference moves: the last
//! pulse has given up, or the axis drifts by more than e_drift in 2 L + 0.3 s.
//!
//! Traps: behind a dead band and dry friction a controller with integral action never arrives: it pushes, breaks loose,
//! overshoots and pushes back, without end; hence the rest. Without integral action it stands beside its set point and
//! pushes against the dead band; hence the pulses. And one bound in the place of two would chatter with the noise of
//! the encoder.

pub mod pulse;

use pipeline::machine::Axis;

use pulse::{Pulses, Step};

/// Ratio of e_wake to e_rest.
const WAKE_RATIO: f64 = 2.0;
/// Ratio of e_far to e_rest: by then the load has changed, or somebody pushes.
const FAR_RATIO: f64 = 20.0;
/// Ratio of e_drift to e_rest: more than an axis that slips moves at once.
const DRIFT_RATIO: f64 = 20.0;
/// Time for which the references have to stand still, s.
const STILL_TIME: f64 = 0.3;
/// Motion that is no noise, in parts of e_rest.
const MOTION: f64 = 0.5;
/// Motion that is no progress, in parts of the error: an axis whose load drifts does not arrive by itself.
const PROGRESS: f64 = 0.25;
/// Time constant of the measured speed as part of L.
const SPEED_PART: f64 = 0.25;
/// Ticks that the time constant of the measured speed has at least.
const SPEED_TICKS: f64 = 4.0;

/// What the axis is to do at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stand {
    /// A controller commands.
    Follow,
    /// Neutral.
    Rest,
    /// This command.
    Creep(f64),
}

/// What the axis does while its references stand still.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Follows,
    /// The valve was shut so many ticks ago.
    Rests(u32),
    Creeps,
}

/// Whether an axis rests or creeps.
#[derive(Debug, Clone, PartialEq)]
pub struct Standstill {
    /// e_rest, m.
    bound: f64,
    still_ticks: u32,
    /// Ticks for which an axis does not move that stands, and after which an axis that was shut has come to rest.
    settled_ticks: (u32, u32),
    period: f64,
    /// Part of a difference that the measured speed takes in.
    speed_gain: f64,
    pulses: Pulses,
    watched: Watched,
    phase: Phase,
    /// |e| at the begin of the phase, m.
    begin: f64,
    /// e after the valve was shut and the axis came to rest, m.
    shut: f64,
    /// The axis is left to its controller until a reference moves.
    is_left: bool,
}

/// What is watched of references and axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Watched {
    /// Last reference, m.
    reference: f64,
    /// Ticks for which the references have stood still.
    still: u32,
    /// Last following error, m.
    error: f64,
    /// Speed of the axis, m/s.
    speed: f64,
    /// Following error at the last motion that is no noise, m.
    from: f64,
    /// Ticks since then.
    stands: u32,
}

impl Watched {
    const NOTHING: Self =
        Self { reference: f64::NAN, still: 0, error: f64::NAN, speed: 0.0, from: f64::NAN, stands: 0 };
}

impl Standstill {
    /// As the machine file and the commissioned model set it for `axis`, called every `period` s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        let bound = axis.motion_limits(period).rest_band;
        let pulses = Pulses::new(axis, bound, MOTION * bound, period);
        let ticks = |time: f64| (time / period).ceil() as u32;
        let delay = pulses.delay();
        Self {
            bound,
            still_ticks: ticks(STILL_TIME),
            settled_ticks: (ticks(STILL_TIME + delay), ticks(STILL_TIME + 2.0 * delay)),
            period,
            speed_gain: 1.0 - (-1.0 / (SPEED_PART * delay / period).max(SPEED_TICKS)).exp(),
            pulses,
            watched: Watched::NOTHING,
            phase: Phase::Follows,
            begin: 0.0,
            shut: 0.0,
            is_left: false,
        }
    }

    /// Neither rests nor creeps any more: the axis begins to follow.
    pub fn reset(&mut self) {
        self.watched = Watched::NOTHING;
        self.is_left = false;
        self.follow();
    }

    /// What the axis is to do at this tick, `elapsed` ticks after the last one, with a following error of `error` m and
    /// these references (m), the present one first. `last` is the command on the valve; `integrates`: the controller
    /// that would command has integral action.
    pub fn update(&mut self, elapsed: u64, error: f64, references: &[f64], last: f64, integrates: bool) -> Stand {
        self.watch(elapsed, error, references);
        let distance = error.abs();
        let is_still = self.watched.still >= self.still_ticks && error.is_finite();
        let is_far = self.phase != Phase::Follows && distance > self.begin + FAR_RATIO * self.bound;
        self.is_left &= is_still;
        if !is_still || is_far {
            self.follow();
        }
        let wakes = distance > WAKE_RATIO * self.bound;
        let stands = self.watched.stands >= self.settled_ticks.0 && !integrates && !self.is_left;
        match self.phase {
            Phase::Follows if is_still && (distance <= self.bound || (stands && !wakes)) => self.rest(),
            Phase::Follows if is_still && stands => self.creep(error, last),
            Phase::Follows => Stand::Follow,
            Phase::Rests(_) if wakes && (integrates || self.is_left) => self.follow(),
            Phase::Rests(since) if wakes && since >= self.settled_ticks.1 => {
                if self.drift(since, error) > DRIFT_RATIO * self.bound { self.leave() } else { self.creep(error, last) }
            }
            Phase::Rests(since) => {
                if since == self.settled_ticks.1 / 2 {
                    self.shut = error;
                }
                self.phase = Phase::Rests(since.saturating_add(1));
                Stand::Rest
            }
            Phase::Creeps => self.step(error),
        }
    }

    /// Leaves the axis to its controller.
    fn follow(&mut self) -> Stand {
        self.phase = Phase::Follows;
        self.pulses.forget();
        Stand::Follow
    }

    /// Leaves the axis to its controller until a reference moves.
    fn leave(&mut self) -> Stand {
        self.is_left = true;
        self.follow()
    }

    /// How far the axis drifts in 2 L + 0.3 s, m, by its motion since half of that time after the valve was shut, which
    /// was `since` ticks ago.
    fn drift(&self, since: u32, error: f64) -> f64 {
        let settled = self.settled_ticks.1;
        f64::from(settled) / f64::from(since.saturating_sub(settled / 2).max(1)) * (error - self.shut).abs()
    }

    fn rest(&mut self) -> Stand {
        (self.phase, self.begin) = (Phase::Rests(0), self.watched.error.abs());
        Stand::Rest
    }

    fn creep(&mut self, error: f64, last: f64) -> Stand {
        (self.phase, self.begin) = (Phase::Creeps, error.abs());
        self.pulses.begin(error, last);
        self.step(error)
    }

    fn step(&mut self, error: f64) -> Stand {
        match self.pulses.step(error, self.watched.speed) {
            Step::Command(command) => Stand::Creep(command),
            Step::Arrives => self.rest(),
            Step::GivesUp => self.leave(),
        }
    }

    /// Takes in references and following error of a tick.
    fn watch(&mut self, elapsed: u64, error: f64, references: &[f64]) {
        let watched = &mut self.watched;
        let same = references.iter().all(|reference| *reference == watched.reference);
        watched.still = if same { watched.still.saturating_add(1) } else { 0 };
        watched.reference = references.first().copied().unwrap_or(f64::NAN);
        if watched.still == 0 || !watched.error.is_finite() {
            (watched.error, watched.from, watched.speed, watched.stands) = (error, error, 0.0, 0);
            return;
        }
        // The references stand, so that the axis moves by what the error has lost.
        let speed = (watched.error - error) / (elapsed.max(1) as f64 * self.period);
        watched.speed += self.speed_gain * (speed - watched.speed);
        watched.error = error;
        watched.stands = watched.stands.saturating_add(1);
        let motion = (MOTION * self.bound).max(PROGRESS * watched.from.abs());
        let has_moved = (error - watched.from).abs() >= motion;
        if has_moved || !error.is_finite() {
            (watched.from, watched.stands) = (error, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{models::commissioned, plant::Actuator};
    use proptest::prelude::*;

    const PERIOD: f64 = 0.01;

    /// Dead bands 0.08 and 0.07 as calibrated, 0.1 and 0.08 as commissioned; counts of 0.1 mm; L = 0.095 s.
    fn axis() -> Axis {
        Axis { commissioned: Some(commissioned()), ..crate::tests::machine(1).axes.remove(0) }
    }

    /// What an axis with these errors and references does at its ticks.
    fn stands(errors: impl Fn(usize) -> f64, references: impl Fn(usize) -> [f64; 2], integrates: bool) -> Vec<Stand> {
        let mut standstill = Standstill::new(&axis(), PERIOD);
        (0..200).map(|k| standstill.update(1, errors(k), &references(k), 0.0, integrates)).collect()
    }

    /// The ticks at which it rests.
    fn rests(errors: impl Fn(usize) -> f64, references: impl Fn(usize) -> [f64; 2]) -> Vec<usize> {
        let stands = stands(errors, references, false);
        (0..200).filter(|k| stands[*k] == Stand::Rest).collect()
    }

    #[test]
    fn rest_begins_when_the_references_have_stood_still_and_the_error_is_small() {
        assert_eq!(rests(|_| 2e-4, |_| [0.5; 2]), (30..200).collect::<Vec<_>>());
        // An axis that stands at twice that error rests 0.3 s + L later.
        assert_eq!(rests(|_| 4e-4, |_| [0.5; 2]), (40..200).collect::<Vec<_>>());
        assert!(rests(|_| 2e-4, |k| [0.5 + 1e-5 * k as f64; 2]).is_empty());
        assert!(stands(|_| f64::NAN, |_| [0.5; 2], false).iter().all(|stand| *stand == Stand::Follow));
    }

    #[test]
    fn the_rest_band_is_that_of_the_machine_file_and_at_least_two_counts() {
        let rests_at = |error: f64, band: Option<f64>, resolution: f64| {
            let mut axis = axis();
            (axis.control.limits.rest_band, axis.encoder.resolution) = (band, resolution);
            let mut standstill = Standstill::new(&axis, PERIOD);
            (0..32).any(|_| standstill.update(1, error, &[0.5; 2], 0.0, true) == Stand::Rest)
        };
        assert!(rests_at(240e-6, None, 1e-6) && !rests_at(260e-6, None, 1e-6));
        // A servo that is to stand within 10 um.
        assert!(rests_at(9e-6, Some(1e-5), 1e-6) && !rests_at(11e-6, Some(1e-5), 1e-6));
        assert!(rests_at(19e-6, Some(1e-5), 1e-5) && !rests_at(21e-6, Some(1e-5), 1e-5));
    }

    #[test]
    fn rest_ends_when_a_coming_reference_moves() {
        let references = |k: usize| [0.5, if k < 100 { 0.5 } else { 0.6 }];
        assert_eq!(rests(|_| 0.0, references), (30..100).collect::<Vec<_>>());
        // Noise between the bounds does not end the rest.
        assert_eq!(rests(|k| if k < 100 { 0.0 } else { 4e-4 }, |_| [0.5; 2]).len(), 170);
    }

    #[test]
    fn an_error_that_has_doubled_is_crept_against_and_a_large_one_is_followed() {
        let woken = |integrates| stands(|k| if k < 100 { 0.0 } else { 6e-4 }, |_| [0.5; 2], integrates);
        let stood = woken(false);
        assert!(stood[30..100].iter().all(|stand| *stand == Stand::Rest));
        assert!(matches!(stood[100], Stand::Creep(command) if command > 0.0 && command < 0.1), "{:?}", stood[100]);
        let pushed = stands(|k| if k < 100 { 0.0 } else { 6e-3 }, |_| [0.5; 2], false);
        assert_eq!(pushed[100], Stand::Follow);
        // A controller that integrates comes back by itself.
        assert!(woken(true)[100..].iter().all(|stand| *stand == Stand::Follow));
    }

    #[test]
    fn an_axis_that_stands_beside_its_set_point_is_crept_up_to_the_highest_command_and_then_left_alone() {
        let stands = stands(|_| 5e-3, |_| [0.5; 2], false);
        let levels: Vec<f64> =
            stands.iter().filter_map(|stand| if let Stand::Creep(u) = stand { Some(*u) } else { None }).collect();
        assert_eq!(stands[39], Stand::Follow);
        assert!(levels.is_sorted() && levels[0] >= 0.05 && levels[levels.len() - 1] < 0.1751, "{levels:?}");
        assert!(levels[levels.len() - 1] > 0.17, "{levels:?}");
        // It waits there for the axis, for 1.5 L.
        let highest = levels.iter().filter(|level| **level == levels[levels.len() - 1]).count();
        assert!((15..=17).contains(&highest), "{highest}");
        assert!(stands[40 + levels.len()..].iter().all(|stand| *stand == Stand::Follow));
    }

    proptest! {
        #[test]
        fn an_axis_comes_to_its_set_point_with_few_reversals_whatever_its_dead_band_is(
            dead_band in 0.04f64..0.12,
            start in prop_oneof![-0.02f64..-0.001, 0.001f64..0.02],
            load in -2e-5f64..2e-5,
        ) {
            let mut standstill = Standstill::new(&axis(), PERIOD);
            let mut plant = Actuator::new(0.5 - start, dead_band);
            let (mut command, mut reversals, mut direction) = (0.0f64, 0, 0.0f64);
            for k in 0..6000 {
                let error = 0.5 - (plant.position * 1e4).round() * 1e-4;
                // Nobody follows: the axis stands until it is crept.
                command = match standstill.update(1, error, &[0.5; 40], command, false) {
                    Stand::Creep(command) => command,
                    Stand::Follow | Stand::Rest => 0.0,
                };
                prop_assert!(command * error >= 0.0 || command.abs() < 0.15, "tick {k}");
                if command != 0.0 {
                    reversals += usize::from(direction * command < 0.0);
                    direction = command.signum();
                }
                plant.step(command);
                // The oil leaks.
                plant.position += load * PERIOD;
            }
            let error = f64::abs(0.5 - plant.position);
            prop_assert!(error <= 0.7e-3, "{error}");
            prop_assert!(reversals <= 6, "{reversals}");
        }
    }
}
