//! Supervision: a model that follows worse than the fallback would loses control.
//!
//! ```text
//! E <- mean of e^2 with the memory tau         e = e_m under the model, e_s of the fallback in its shadow at that tick
//! suspect   E_m > 4 B + e_0^2          with tau = max(0.5 s, 1.5 L)
//! or        E_m > 1.2 B + (e_0/4)^2    with tau = max(5 s, 15 L), not for 20 s, 40 s .. 320 s after an acquittal
//!           after 2 tau of control, while the command is not at its limit;  B = min(E_s, 9 E_f max(V_m/V_f, 1))
//! or        it swings ([`super::swing`])
//! trial     of a suspect: the fallback controls for max(5 s, 15 L), at most four times that while V_f < V_m/4
//! acquitted E_f max(V_m/V_f, 1) >= 0.8 E_m of before, V_f >= V_m/4: the model controls as before
//! guilty    otherwise: cautious for 20 s, 40 s .. 320 s; one that has been cautious or that swings is out
//!           for 30 s, 60 s .. 480 s
//! ```
//!
//! e_m following error and e_s that of the shadow ([`super::shadow`]) m; L dead time and lag of the commissioned model
//! s; e_0 1 mm or 4 counts, whichever is more; V mean square of the reference's speed m2/s2; index f of the last 30 s
//! of the fallback in control, without the first max(1 s, 6 L) after the model, and since the last trial began; m
//! model. 4 is twice the error, 1.2 a tenth more. A cautious model controls without what was learned online.
//!
//! The shadow is as right as the commissioned model; what it says of a machine that has changed is confirmed by the
//! fallback itself. A model that is far from the axis makes its shadow swing, and would then excuse every error; hence
//! the bound on E_s by E_f.
//!
//! Traps: [`super::trust`] alone acts on errors of centimetres. A model can be five times worse than the fallback and
//! never reach them. And a fallback that is judged while it still mends what the model has left looks no better.

use super::{
    squares::{MEMORY, Squares},
    swing::Swing,
};
use crate::protection::following_error::Deviation;

/// E_s in parts of E_f.
const EXCUSED: f64 = 9.0;
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
/// Time for which the errors after the model are not the fallback's, in s and in reactions of the axis.
const TRANSIENT: (f64, f64) = (1.0, 6.0);
/// E_f in parts of E_m that acquits.
const NO_BETTER: f64 = 0.8;
/// First time of caution, of trust after an acquittal, and of distrust, s, and how often they are doubled at most.
const CAUTION: f64 = 20.0;
const GRACE: f64 = 20.0;
const DISTRUST: f64 = 30.0;
const DOUBLINGS: u32 = 4;

/// What the supervision says of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Confidence {
    /// The model may control.
    Full,
    /// The model may control with what was commissioned.
    Cautious,
    /// The fallback controls.
    None,
}

/// Where the model stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// It may control, with caution while [`Supervision::cautious`] lasts.
    Trusted,
    /// The fallback is measured. What the model had, whether it swung, and the time since the trial began, s.
    Trial(Squares, bool, f64),
    /// The fallback controls for so many seconds more.
    Out(f64),
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

    /// Whether the model is suspect, beside a fallback of `fallback`.
    fn is_worse(&self, fallback: &Squares) -> bool {
        // `min` leaves out what is not a number: a fallback that has never moved.
        let bound = self.shadow.error.min(EXCUSED * fallback.for_speed(self.model.speed));
        self.model.time > 2.0 * self.memory && self.model.error > self.worse * bound + self.floor
    }
}

/// The supervision of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Supervision {
    period: f64,
    /// Length of a trial and of its first part, which does not count, s.
    trial: (f64, f64),
    looks: [Look; LOOKS.len()],
    swing: Swing,
    fallback: Squares,
    /// Time since the fallback took over, s.
    taken: f64,
    phase: Phase,
    /// Time for which the model is still cautious, and for which many errors do not count, s.
    cautious: f64,
    grace: f64,
    /// Times that it was found guilty and cautious, guilty and out, and acquitted, since the axis began to follow.
    times: [u32; 3],
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
            looks,
            swing: Swing::new(reaction, resolution, period),
            fallback: Squares::default(),
            taken: f64::INFINITY,
            phase: Phase::Trusted,
            cautious: 0.0,
            grace: 0.0,
            times: [0; 3],
        }
    }

    /// Forgets all: the axis begins to follow.
    pub fn reset(&mut self) {
        self.looks.iter_mut().for_each(Look::clear);
        self.swing.reset();
        (self.fallback, self.taken) = (Squares::default(), f64::INFINITY);
        (self.phase, self.cautious, self.grace, self.times) = (Phase::Trusted, 0.0, 0.0, [0; 3]);
    }

    /// How far the model is trusted.
    pub fn confidence(&self) -> Confidence {
        match self.phase {
            Phase::Trusted if self.cautious == 0.0 => Confidence::Full,
            Phase::Trusted => Confidence::Cautious,
            Phase::Trial(..) | Phase::Out(_) => Confidence::None,
        }
    }

    /// Takes in a tick. `shadow`: the error that the fallback would have, m, if the model made the last command.
    /// `at_limit`: the last command was at its limit.
    pub fn update(&mut self, deviation: &Deviation, shadow: Option<f64>, at_limit: bool) {
        let time = deviation.elapsed as f64 * self.period;
        let swings = self.swing.update(deviation, shadow.is_some());
        match shadow {
            Some(_) if at_limit => self.taken = 0.0,
            Some(shadow) => self.compare(deviation, shadow, time),
            None => self.measure(deviation, time),
        }
        match self.phase {
            Phase::Trusted => self.suspect(swings, time),
            Phase::Trial(model, swung, since) => self.judge(model, swung, since + time),
            Phase::Out(left) if left > time => self.phase = Phase::Out(left - time),
            Phase::Out(_) => self.phase = Phase::Trusted,
        }
    }

    /// A tick of the model.
    fn compare(&mut self, &Deviation { error, speed, .. }: &Deviation, shadow: f64, time: f64) {
        self.taken = 0.0;
        for look in &mut self.looks {
            look.model.push(error, speed, time, look.memory);
            look.shadow.push(shadow, speed, time, look.memory);
        }
    }

    /// A tick of the fallback.
    fn measure(&mut self, &Deviation { error, speed, .. }: &Deviation, time: f64) {
        self.looks.iter_mut().for_each(Look::clear);
        self.taken += time;
        if self.taken > self.trial.1 {
            self.fallback.push(error, speed, time, MEMORY);
        }
    }

    /// Begins a trial if there is a cause.
    fn suspect(&mut self, swings: bool, time: f64) {
        (self.cautious, self.grace) = ((self.cautious - time).max(0.0), (self.grace - time).max(0.0));
        let [last, many] = self.looks.map(|look| look.is_worse(&self.fallback));
        let model = if many { self.looks[1].model } else { self.looks[0].model };
        if swings || last || (many && self.grace == 0.0) {
            self.phase = Phase::Trial(model, swings, 0.0);
            // The machine may have changed, and the fallback with it.
            self.fallback = Squares::default();
        }
    }

    /// Ends a trial that has seen enough.
    fn judge(&mut self, model: Squares, swung: bool, since: f64) {
        let is_still = self.fallback.speed < MOTION * model.speed;
        if since < self.trial.0 || (is_still && since < TRIALS * self.trial.0) {
            self.phase = Phase::Trial(model, swung, since);
            return;
        }
        self.phase = Phase::Trusted;
        if !is_still && self.fallback.for_speed(model.speed) >= NO_BETTER * model.error {
            self.grace = doubled(GRACE, &mut self.times[2]);
        } else if self.cautious == 0.0 && !swung {
            self.cautious = doubled(CAUTION, &mut self.times[0]);
        } else {
            self.phase = Phase::Out(doubled(DISTRUST, &mut self.times[1]));
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

    fn at(error: f64) -> Deviation {
        Deviation { elapsed: 1, error, speed: 0.1 }
    }

    /// After 8 s of the fallback, with 2 mm of error at 0.1 m/s.
    fn supervision() -> Supervision {
        let mut supervision = Supervision::new(0.05, 1e-5, PERIOD);
        (0..800).for_each(|_| supervision.update(&at(2e-3), None, false));
        assert_eq!(supervision.confidence(), Confidence::Full);
        supervision
    }

    /// Confidence in a model with this error in m at every tick of so many, where the shadow has the other one, and the
    /// fallback in control the last one; as (seconds, confidence) of the changes.
    fn changes(
        supervision: &mut Supervision,
        ticks: u32,
        error: f64,
        shadow: f64,
        fallback: f64,
    ) -> Vec<(f64, Confidence)> {
        let mut changes = vec![(0.0, supervision.confidence())];
        for tick in 0..ticks {
            match supervision.confidence() {
                Confidence::None => supervision.update(&at(fallback), None, false),
                _ => supervision.update(&at(error), Some(shadow), false),
            }
            if supervision.confidence() != changes[changes.len() - 1].1 {
                changes.push((f64::from(tick) * PERIOD, supervision.confidence()));
            }
        }
        changes
    }

    fn expect(changes: &[(f64, Confidence)], expected: &[(f64, Confidence)]) {
        assert_eq!(changes.len(), expected.len() + 1, "{changes:?}");
        for (found, expected) in changes[1..].iter().zip(expected) {
            assert!(found.1 == expected.1 && (found.0 - expected.0).abs() < 0.06, "{changes:?}");
        }
    }

    #[test]
    fn a_model_that_is_twice_as_bad_is_tried_then_cautious_then_out_for_longer_each_time() {
        let changes = changes(&mut supervision(), 5200, 5e-3, 2e-3, 2e-3);
        let (cautious, out) = (2.0 * CAUGHT + 2.0 * TRIED, 2.0 * CAUGHT + 2.0 * TRIED + DISTRUST);
        let expected = [
            (CAUGHT, Confidence::None),
            (CAUGHT + TRIED, Confidence::Cautious),
            (cautious - TRIED, Confidence::None),
            // Its caution is not over when it is back.
            (out, Confidence::Cautious),
            (out + CAUGHT, Confidence::None),
        ];
        expect(&changes, &expected);
    }

    #[test]
    fn a_model_that_is_a_fifth_worse_for_long_is_tried_and_one_that_is_no_worse_is_not() {
        let slow = changes(&mut supervision(), 1100, 2.4e-3, 2e-3, 2e-3);
        expect(&slow, &[(10.0, Confidence::None)]);
        assert_eq!(changes(&mut supervision(), 3000, 2.1e-3, 2e-3, 2e-3).len(), 1);
        // Below a quarter of the floor nothing counts.
        assert_eq!(changes(&mut supervision(), 3000, 0.24e-3, 1e-5, 1e-5).len(), 1);
    }

    #[test]
    fn caution_ends_after_a_time_without_cause() {
        let mut supervision = supervision();
        changes(&mut supervision, 620, 5e-3, 2e-3, 2e-3);
        assert_eq!(supervision.confidence(), Confidence::Cautious);
        let changes = changes(&mut supervision, 4000, 2e-3, 2e-3, 2e-3);
        assert!(changes[1].1 == Confidence::Full && (19.0..20.5).contains(&changes[1].0), "{changes:?}");
    }

    #[test]
    fn the_shadow_of_now_counts_and_not_the_fallback_of_before_up_to_a_bound() {
        assert_eq!(changes(&mut supervision(), 3000, 4.2e-3, 4e-3, 4e-3).len(), 1);
        // Three times the error of before is 6 mm, a tenth more 6.6 mm.
        assert_eq!(changes(&mut supervision(), 3000, 6.5e-3, 1.0, 1.0).len(), 1);
        assert!(changes(&mut supervision(), 3000, 6.7e-3, 1.0, 1.0).len() > 1);
    }

    #[test]
    fn a_fallback_that_is_no_better_acquits_the_model_and_is_the_new_measure() {
        let changes = changes(&mut supervision(), 1500, 13e-3, 13e-3, 13e-3);
        expect(&changes, &[(CAUGHT, Confidence::None), (CAUGHT + TRIED, Confidence::Full)]);
    }

    #[test]
    fn what_the_model_has_left_behind_does_not_acquit_it() {
        let mut supervision = supervision();
        changes(&mut supervision, 110, 5e-3, 2e-3, 2e-3);
        assert_eq!(supervision.confidence(), Confidence::None);
        // 90 ticks of 50 mm, then the fallback as it is.
        changes(&mut supervision, 85, 5e-3, 2e-3, 50e-3);
        let changes = changes(&mut supervision, 500, 5e-3, 2e-3, 2e-3);
        assert_eq!(changes[1].1, Confidence::Cautious);
    }

    #[test]
    fn a_trial_waits_for_a_reference_that_rests() {
        let mut supervision = supervision();
        changes(&mut supervision, 110, 5e-3, 2e-3, 2e-3);
        let still = Deviation { speed: 0.0, ..at(0.1e-3) };
        let ticks = (0..4000).take_while(|_| {
            supervision.update(&still, None, false);
            supervision.confidence() == Confidence::None
        });
        assert!((1980..2000).contains(&ticks.count()));
        assert_eq!(supervision.confidence(), Confidence::Cautious, "guilty: the fallback had no chance to be worse");
    }

    #[test]
    fn a_swing_is_out_although_the_shadow_has_it_too() {
        let mut supervision = supervision();
        let mut out = None;
        for tick in 0..1200 {
            let error = 8e-3 * (0.2 * f64::from(tick)).sin();
            match supervision.confidence() {
                Confidence::None => supervision.update(&at(2e-3), None, false),
                _ => supervision.update(&at(error), Some(error), false),
            }
            if supervision.confidence() == Confidence::None {
                out.get_or_insert(tick);
            }
        }
        assert!(out.is_some_and(|tick| tick < 200), "{out:?}");
        assert!(matches!(supervision.phase, Phase::Out(_)), "{:?}", supervision.phase);
    }

    #[test]
    fn a_command_at_its_limit_says_nothing() {
        let mut supervision = supervision();
        (0..3000).for_each(|_| supervision.update(&at(0.02), Some(2e-3), true));
        assert_eq!(supervision.confidence(), Confidence::Full);
    }

    #[test]
    fn time_counts_not_looks() {
        let mut supervision = supervision();
        let gap = Deviation { elapsed: 20, ..at(5e-3) };
        let looks = (0..100).take_while(|_| {
            supervision.update(&gap, Some(2e-3), false);
            supervision.confidence() == Confidence::Full
        });
        assert!((4..=9).contains(&looks.count()));
    }
}
