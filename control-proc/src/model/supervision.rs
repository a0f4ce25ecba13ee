//! Supervision: a model that follows worse than the fallback would loses control.
//!
//! ```text
//! E <- mean of e^2 with the memory tau         e = e_m under the model, e_s of the fallback in its shadow at that tick
//! suspect   E_m > 4 max(B, B') + e_0^2  with tau = max(0.5 s, 1.5 L);  B' is B of the other look
//! or        E_m > 1.2 B + (e_0/4)^2    with tau = max(5 s, 15 L), not for 20 s, 40 s .. 320 s after an acquittal
//!           after 2 tau of control, while the command is not at its limit;  B = min(E_s, 2.25 E_f max(V_m/V_f, 1))
//! or        it swings ([`super::swing`])
//! trial     of a suspect: the fallback controls for max(5 s, 15 L), at most four times that while V_f < V_m/4
//! acquitted E_f max(V_m/V_f, 1) >= 0.8 E_m of before, V_f >= V_m/4: the model controls as before; at once where
//!           E_f max(V_m/V_f, 1) > 4 E_m after max(2 s, 6 L)
//!           a model that was suspect by its last errors or its swing while the reference stood: the same, of the time
//!           in which the reference stands alone, with at least max(2 s, 6 L) of it in the place of V_f >= V_m/4
//! guilty    otherwise: out for 30 s, 60 s .. 480 s
//! ```
//!
//! e_m following error and e_s that of the shadow ([`super::shadow`]) m; L dead time and lag of the commissioned model
//! s; e_0 1 mm or 4 counts, whichever is more; V mean square of the reference's speed m2/s2; index f of the last 30 s
//! of the fallback in control, without the first max(1 s, 6 L) after the model, and since the last trial began; m
//! model. 4 is twice the error, 1.2 a tenth more, 2.25 half as much again.
//!
//! The shadow is as right as the commissioned model; what it says of a machine that has changed is confirmed by the
//! fallback itself. While many errors do not count after an acquittal, B is at least E_f max(V_m/V_f, 1): the fallback
//! has just shown what it does. A model that is far from the axis makes its shadow swing, and would then excuse every
//! error; hence the bound on E_s by E_f.
//!
//! The reference stands from max(1 s, 6 L) after its last motion on.
//!
//! Traps: [`super::trust`] alone acts on errors of centimetres. A model can be five times worse than the fallback and
//! never reach them. A model that swings at rest is excused by the errors of any fallback in motion. A fallback that is
//! judged while it still mends what the model has left looks no better. And a
//! guilty model that goes on with what was commissioned alone, without what it has learned, is no better either: it is
//! nearly always the commissioned model that is wrong.

use super::{
    squares::{MEASURED, MEMORY, Squares, Standing, TRANSIENT},
    swing::Swing,
};
use crate::protection::following_error::Deviation;

/// E_s in parts of E_f.
const EXCUSED: f64 = 2.25;
/// e_0 in m and in counts.
const FLOOR: (f64, f64) = (1e-3, 4.0);
/// A look at the last errors and one at many: tau in s and in reactions of the axis, mean square that is suspect in
/// parts of B, part of e_0.
const LOOKS: [(f64, f64, f64, f64); 2] = [(0.5, 1.5, 4.0, 1.0), (5.0, 15.0, 1.2, 0.25)];
/// Length of a trial in s and in reactions of the axis, and how many of them an axis that rests is waited for.
const TRIAL: (f64, f64) = (5.0, 15.0);
const TRIALS: f64 = 4.0;
/// Part of V_m that a trial needs.
const MOTION: f64 = 0.25;
/// E_f in parts of E_m that acquits.
const NO_BETTER: f64 = 0.8;
/// E_f in parts of E_m that acquits before the trial is over.
const CLEARLY: f64 = 4.0;
/// First time of trust after an acquittal, and of distrust, s, and how often they are doubled at most.
const GRACE: f64 = 20.0;
const DISTRUST: f64 = 30.0;
const DOUBLINGS: u32 = 4;

/// Where the model stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// It may control.
    Trusted,
    /// The fallback is measured.
    Trial(Trial),
    /// The fallback controls for so many seconds more.
    Out(f64),
}

/// What a model may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Control.
    Trusted,
    /// Wait until the fallback has been measured.
    Tried,
    /// Wait, because the fallback was better.
    Worse,
}

/// A trial of the fallback.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Trial {
    /// What the model had.
    model: Squares,
    /// The model was suspect while the reference stood, and is compared with the fallback while it stands.
    stands: bool,
    /// Time since the trial began, s.
    since: f64,
}

/// A comparison of the model with the shadow.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Look {
    /// tau, s.
    memory: f64,
    /// Mean square that is suspect in parts of B.
    worse: f64,
    /// Least mean square that is suspect, m2.
    floor: f64,
    model: Squares,
    shadow: Squares,
}

impl Look {
    fn clear(&mut self) {
        (self.model, self.shadow) = Default::default();
    }

    /// B, m2, beside a fallback of `fallback`, which is a fresh measurement or not.
    fn bound(&self, fallback: Option<&Squares>, is_fresh: bool) -> f64 {
        let measured = fallback.map_or(f64::NAN, |fallback| fallback.for_speed(self.model.speed, 1.0));
        // `min` and `max` leave out what is not a number: a fallback that has never moved.
        let bound = self.shadow.error.min(EXCUSED * measured);
        if is_fresh { bound.max(measured) } else { bound }
    }

    /// Whether the model is suspect with a bound of `bound` m2.
    fn is_worse(&self, bound: f64) -> bool {
        self.model.time > 2.0 * self.memory && self.model.error > self.worse * bound + self.floor
    }
}

/// The supervision of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Supervision {
    period: f64,
    /// Length of a trial and of its first part, which does not count, s.
    trial: (f64, f64),
    /// Least time of the fallback in control that counts, s.
    measured: f64,
    looks: [Look; LOOKS.len()],
    swing: Swing,
    standing: Standing,
    fallback: Squares,
    /// Model, since the reference stands, and fallback while the reference stands.
    rest: [Squares; 2],
    /// Time since the fallback took over, s.
    taken: f64,
    phase: Phase,
    /// Time for which many errors do not count, s.
    grace: f64,
    /// Times that it was found guilty, and acquitted, since the axis began to follow.
    times: [u32; 2],
}

impl Supervision {
    /// Of an axis with this reaction, dead time and lag in s, and this length of a count in m; looked at every `period`
    /// s.
    pub fn new(reaction: f64, resolution: f64, period: f64) -> Self {
        let floor = FLOOR.0.max(FLOOR.1 * resolution);
        let looks = LOOKS.map(|(time, reactions, worse, part)| Look {
            memory: time.max(reactions * reaction),
            worse,
            floor: (part * floor).powi(2),
            model: Squares::default(),
            shadow: Squares::default(),
        });
        let longer = |(time, reactions): (f64, f64)| time.max(reactions * reaction);
        Self {
            period,
            trial: (longer(TRIAL), longer(TRANSIENT)),
            measured: longer(MEASURED),
            looks,
            swing: Swing::new(reaction, resolution, period),
            standing: Standing::new(reaction),
            fallback: Squares::default(),
            rest: Default::default(),
            taken: f64::INFINITY,
            phase: Phase::Trusted,
            grace: 0.0,
            times: [0; 2],
        }
    }

    /// Forgets all: the axis begins to follow.
    pub fn reset(&mut self) {
        self.looks.iter_mut().for_each(Look::clear);
        self.swing.reset();
        (self.fallback, self.rest, self.taken) = (Squares::default(), Default::default(), f64::INFINITY);
        (self.phase, self.grace, self.times) = (Phase::Trusted, 0.0, [0; 2]);
    }

    /// What the model may do.
    pub fn verdict(&self) -> Verdict {
        match self.phase {
            Phase::Trusted => Verdict::Trusted,
            Phase::Trial(_) => Verdict::Tried,
            Phase::Out(_) => Verdict::Worse,
        }
    }

    /// Takes in a tick. `shadow`: the error that the fallback would have, m, if the model made the last command.
    /// `at_limit`: the last command was at its limit.
    pub fn update(&mut self, deviation: &Deviation, shadow: Option<f64>, at_limit: bool) {
        let time = deviation.elapsed as f64 * self.period;
        let swings = self.swing.update(deviation, shadow.is_some());
        let stands = self.standing.update(deviation.speed, time);
        if !stands {
            self.rest[0] = Squares::default();
        }
        match shadow {
            Some(_) if at_limit => self.taken = 0.0,
            Some(shadow) => self.compare(deviation, stands, shadow, time),
            None => self.measure(deviation, stands, time),
        }
        match self.phase {
            Phase::Trusted => self.suspect(swings, stands, time),
            Phase::Trial(trial) => self.judge(Trial { since: trial.since + time, ..trial }),
            Phase::Out(left) if left > time => self.phase = Phase::Out(left - time),
            Phase::Out(_) => self.phase = Phase::Trusted,
        }
    }

    /// A tick of the model.
    fn compare(&mut self, &Deviation { error, speed, .. }: &Deviation, stands: bool, shadow: f64, time: f64) {
        self.taken = 0.0;
        if stands {
            self.rest[0].push(error, speed, time, self.looks[1].memory);
        }
        for look in &mut self.looks {
            look.model.push(error, speed, time, look.memory);
            look.shadow.push(shadow, speed, time, look.memory);
        }
    }

    /// A tick of the fallback.
    fn measure(&mut self, &Deviation { error, speed, .. }: &Deviation, stands: bool, time: f64) {
        self.looks.iter_mut().for_each(Look::clear);
        self.taken += time;
        if self.taken > self.trial.1 {
            self.fallback.push(error, speed, time, MEMORY);
            if stands {
                self.rest[1].push(error, speed, time, MEMORY);
            }
        }
    }

    /// Begins a trial if there is a cause.
    fn suspect(&mut self, swings: bool, stands: bool, time: f64) {
        self.grace = (self.grace - time).max(0.0);
        let fallback = Some(&self.fallback).filter(|fallback| fallback.time >= self.measured);
        let [now, usual] = self.looks.map(|look| look.bound(fallback, self.grace > 0.0));
        // A moment in which the fallback would do far better than it does otherwise says nothing of the model.
        let (last, many) = (self.looks[0].is_worse(now.max(usual)), self.looks[1].is_worse(usual));
        if swings || last || (many && self.grace == 0.0) {
            let stands = stands && (swings || last);
            let model = if stands { self.rest[0] } else { self.looks[usize::from(many)].model };
            self.phase = Phase::Trial(Trial { model, stands, since: 0.0 });
            // The machine may have changed, and the fallback with it.
            (self.fallback, self.rest) = Default::default();
        }
    }

    /// Ends a trial that has seen enough.
    fn judge(&mut self, trial: Trial) {
        let Trial { model, stands, since } = trial;
        let fallback = if stands { self.rest[1] } else { self.fallback };
        let lacks = if stands { fallback.time < self.measured } else { fallback.speed < MOTION * model.speed };
        let error = if stands { fallback.error } else { fallback.for_speed(model.speed, 1.0) };
        let is_clear = !lacks && fallback.time >= self.measured && error > CLEARLY * model.error;
        if !is_clear && (since < self.trial.0 || (lacks && since < TRIALS * self.trial.0)) {
            self.phase = Phase::Trial(trial);
            return;
        }
        self.phase = Phase::Trusted;
        if !lacks && error >= NO_BETTER * model.error {
            self.grace = doubled(GRACE, &mut self.times[1]);
        } else {
            self.phase = Phase::Out(doubled(DISTRUST, &mut self.times[0]));
        }
    }
}

/// `time`, doubled as often as counted; counts.
fn doubled(time: f64, times: &mut u32) -> f64 {
    let doublings = (*times).min(DOUBLINGS);
    *times = times.saturating_add(1);
    time * f64::from(1 << doublings)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 0.01;
    /// 1 s of the model, and 5 s of a trial.
    const CAUGHT: f64 = 1.02;
    const TRIED: f64 = 5.0;

    fn trusts(supervision: &Supervision) -> bool {
        supervision.verdict() == Verdict::Trusted
    }

    fn at(error: f64) -> Deviation {
        Deviation { elapsed: 1, error, speed: 0.1 }
    }

    /// After 8 s of the fallback, with 2 mm of error at 0.1 m/s.
    fn supervision() -> Supervision {
        let mut supervision = Supervision::new(0.05, 1e-5, PERIOD);
        (0..800).for_each(|_| supervision.update(&at(2e-3), None, false));
        assert!(trusts(&supervision));
        supervision
    }

    /// Whether a model is trusted that has this error in m at every tick of so many, where the shadow has the other
    /// one, and the fallback in control the last one; as (seconds, trusted) of the changes.
    fn changes(supervision: &mut Supervision, ticks: u32, error: f64, shadow: f64, fallback: f64) -> Vec<(f64, bool)> {
        let mut changes = vec![(0.0, trusts(supervision))];
        for tick in 0..ticks {
            if trusts(supervision) {
                supervision.update(&at(error), Some(shadow), false);
            } else {
                supervision.update(&at(fallback), None, false);
            }
            if trusts(supervision) != changes[changes.len() - 1].1 {
                changes.push((f64::from(tick) * PERIOD, trusts(supervision)));
            }
        }
        changes
    }

    fn expect(changes: &[(f64, bool)], expected: &[(f64, bool)]) {
        assert_eq!(changes.len(), expected.len() + 1, "{changes:?}");
        for (found, expected) in changes[1..].iter().zip(expected) {
            assert!(found.1 == expected.1 && (found.0 - expected.0).abs() < 0.06, "{changes:?}");
        }
    }

    #[test]
    fn a_model_that_is_twice_as_bad_is_tried_and_then_out_for_longer_each_time() {
        let changes = changes(&mut supervision(), 11_500, 5e-3, 2e-3, 2e-3);
        let back = CAUGHT + TRIED + DISTRUST;
        let again = back + CAUGHT + TRIED + 2.0 * DISTRUST;
        expect(
            &changes,
            &[(CAUGHT, false), (back, true), (back + CAUGHT, false), (again, true), (again + CAUGHT, false)],
        );
    }

    #[test]
    fn a_model_that_is_a_fifth_worse_for_long_is_tried_and_one_that_is_no_worse_is_not() {
        let slow = changes(&mut supervision(), 1100, 2.4e-3, 2e-3, 2e-3);
        expect(&slow, &[(10.0, false)]);
        assert_eq!(changes(&mut supervision(), 3000, 2.1e-3, 2e-3, 2e-3).len(), 1);
        // Below a quarter of the floor nothing counts.
        assert_eq!(changes(&mut supervision(), 3000, 0.24e-3, 1e-5, 1e-5).len(), 1);
    }

    #[test]
    fn the_shadow_of_now_counts_and_not_the_fallback_of_before_up_to_a_bound() {
        assert_eq!(changes(&mut supervision(), 3000, 3.1e-3, 2.9e-3, 2.9e-3).len(), 1);
        // One and a half times the error of before is 3 mm, a tenth more 3.3 mm.
        assert_eq!(changes(&mut supervision(), 3000, 3.25e-3, 1.0, 1.0).len(), 1);
        assert!(changes(&mut supervision(), 3000, 3.35e-3, 1.0, 1.0).len() > 1);
    }

    #[test]
    fn a_fallback_that_is_no_better_acquits_the_model_and_is_the_new_measure() {
        let changes = changes(&mut supervision(), 1500, 13e-3, 13e-3, 13e-3);
        expect(&changes, &[(CAUGHT, false), (CAUGHT + TRIED, true)]);
    }

    #[test]
    fn a_fallback_that_is_far_worse_acquits_the_model_before_the_trial_is_over_and_its_shadow_is_not_believed() {
        let mut supervision = supervision();
        let found = changes(&mut supervision, 1500, 13e-3, 2e-3, 40e-3);
        // 1 s does not count, and 2 s are enough.
        expect(&found, &[(CAUGHT, false), (CAUGHT + 3.0, true)]);
        // A model with more than twice the error that the fallback has had is tried again.
        assert_eq!(supervision.verdict(), Verdict::Trusted);
        changes(&mut supervision, 400, 90e-3, 2e-3, 40e-3);
        assert_eq!(supervision.verdict(), Verdict::Tried);
    }

    #[test]
    fn what_the_model_has_left_behind_does_not_acquit_it() {
        let mut supervision = supervision();
        changes(&mut supervision, 110, 5e-3, 2e-3, 2e-3);
        assert!(!trusts(&supervision));
        // 90 ticks of 50 mm, then the fallback as it is.
        changes(&mut supervision, 85, 5e-3, 2e-3, 50e-3);
        assert_eq!(changes(&mut supervision, 1000, 5e-3, 2e-3, 2e-3).len(), 1, "it is out");
    }

    #[test]
    fn a_trial_waits_for_a_reference_that_rests() {
        let mut supervision = supervision();
        changes(&mut supervision, 110, 5e-3, 2e-3, 2e-3);
        let still = Deviation { speed: 0.0, ..at(0.1e-3) };
        let ticks = (0..4000).take_while(|_| {
            supervision.update(&still, None, false);
            matches!(supervision.phase, Phase::Trial(_))
        });
        assert!((1980..2000).contains(&ticks.count()));
        assert!(matches!(supervision.phase, Phase::Out(_)), "guilty: the fallback had no chance to be worse");
    }

    #[test]
    fn a_swing_is_out_although_the_shadow_has_it_too() {
        let mut supervision = supervision();
        let mut out = None;
        for tick in 0..1200 {
            let error = 8e-3 * (0.2 * f64::from(tick)).sin();
            if trusts(&supervision) {
                supervision.update(&at(error), Some(error), false);
            } else {
                supervision.update(&at(2e-3), None, false);
                out.get_or_insert(tick);
            }
        }
        assert!(out.is_some_and(|tick| tick < 200), "{out:?}");
        assert!(matches!(supervision.phase, Phase::Out(_)), "{:?}", supervision.phase);
    }

    /// 4 s of rest, and 1 s of motion with ten times the error of the swing: whether a model is out that swings at rest
    /// beside a fallback with this error at rest, m.
    fn swings_at_rest(fallback: f64) -> bool {
        let mut supervision = supervision();
        for tick in 0..3000 {
            let moves = tick % 500 >= 400;
            let swing = 8e-3 * (0.1 * f64::from(tick)).sin();
            let by_model = trusts(&supervision);
            let at_rest = if by_model { swing } else { fallback * swing.signum() };
            let error = if moves { 80e-3 } else { at_rest };
            let deviation = Deviation { elapsed: 1, error, speed: if moves { 0.3 } else { 0.0 } };
            supervision.update(&deviation, by_model.then_some(error), false);
        }
        matches!(supervision.phase, Phase::Out(_))
    }

    #[test]
    fn a_swing_at_rest_is_not_excused_by_the_errors_of_motion() {
        assert!(swings_at_rest(1e-3));
        assert!(!swings_at_rest(8e-3), "the fallback is no better");
    }

    #[test]
    fn a_command_at_its_limit_says_nothing() {
        let mut supervision = supervision();
        (0..3000).for_each(|_| supervision.update(&at(0.02), Some(2e-3), true));
        assert!(trusts(&supervision));
    }

    #[test]
    fn a_moment_in_which_the_fallback_would_do_better_than_usual_says_nothing() {
        let mut supervision = supervision();
        // For one second in ten the fallback would have a third of its error.
        for tick in 0..4500 {
            let shadow = if tick % 1000 < 900 { 3.2e-3 } else { 1e-3 };
            supervision.update(&at(3e-3), Some(shadow), false);
            assert!(trusts(&supervision), "{tick}");
        }
        // A model that becomes worse is found as soon as before.
        expect(&changes(&mut supervision, 150, 12e-3, 3.2e-3, 3e-3), &[(0.06, false)]);
    }

    #[test]
    fn time_counts_not_looks() {
        let mut supervision = supervision();
        let gap = Deviation { elapsed: 20, ..at(5e-3) };
        let looks = (0..100).take_while(|_| {
            supervision.update(&gap, Some(2e-3), false);
            trusts(&supervision)
        });
        assert!((4..=9).contains(&looks.count()));
    }
}
