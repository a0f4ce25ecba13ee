//! The gate between identifier and controller: a snapshot goes in, the approved model or none comes out.
//!
//! ```text
//! snapshot --judge--> approved adaptive or classical model --age--> usable model
//! usable model, predictive command --trust, probation--> command of the model that may go out
//! ```
//!
//! | check | question |
//! |---|---|
//! | [`judge`](super::judge) | may the model be used at all? |
//! | [`comparison`](super::comparison) | has the adaptive model predicted better than the classical one? |
//! | [`age`](super::age) | is the last approved model still young enough? |
//! | [`trust`](super::trust) | was there a following error under the model? |
//! | [`supervision`](super::supervision) | is the model worse than the fallback would be, or does the axis swing? |
//! | probation, here | has the model been usable for [`PROBATION`] without a break? |
//!
//! Each snapshot is judged once; its flags stay until the next one. The classical model is used until the adaptive
//! model has predicted better, and in the place of an adaptive model that is refused; but never in the place of a grey
//! box, which starts from a commissioned model. While the last approved model is fresh, a refusal changes nothing,
//! except for [`Refusal::Worse`]: a model that predicts worse has become so gradually, hence the one before it is no
//! better.

use std::time::Duration;

use pipeline::{
    machine::{Axis, Estimator, ModelChoice, Timing, samples_of},
    message::{AxisSnapshot, REFUSALS, control_flag},
};

use super::{
    age::{Age, LastApproved},
    comparison::Comparison,
    judge::{Approved, Judge, Refusal},
    supervision::{Supervision, Verdict},
    trust::Trust,
};
use crate::protection::following_error::Deviation;

/// Time for which a model must be usable before it controls: a borderline model does not switch to and fro.
pub const PROBATION: Duration = Duration::from_millis(100);

/// What the predictive controller answered at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModelAnswer {
    /// There is no usable model.
    NoModel,
    /// The usable model gave no finite command.
    NoCommand,
    /// The command that it asks for.
    Command(f64),
}

/// What leaves the gate at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Admission {
    /// The command of the model, if the model may control.
    pub command: Option<f64>,
    /// [`control_flag`] bits that say why it may not.
    pub flags: u32,
}

/// The newest snapshot that was judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seen {
    /// Tick of the sample that it was made after.
    made_after: u64,
    flags: u32,
}

/// The gate of one axis.
#[derive(Debug, Clone)]
pub struct Gate {
    choice: ModelChoice,
    /// The adaptive model is used although it has not predicted better than the classical one, which does not take its
    /// place.
    adaptive_at_once: bool,
    probation_ticks: u64,
    judge: Judge,
    comparison: Comparison,
    last: LastApproved,
    trust: Trust,
    /// Of a commissioned axis: there is no shadow without what the commands are expected to do.
    supervision: Option<Supervision>,
    /// Ticks in a row with a command of a usable model.
    usable_ticks: u64,
    seen: Option<Seen>,
    refusals: [u64; REFUSALS.len()],
}

impl Gate {
    /// As the machine file sets it for `axis`.
    pub fn new(axis: &Axis, timing: &Timing) -> Self {
        let ticks = |duration| samples_of(duration, timing.period).max(1) as u64;
        let period = timing.period.as_secs_f64();
        let (choice, commissioned) = (axis.control.model, axis.commissioned.as_ref());
        Self {
            choice,
            // A grey box knows what commissioning has found, which is more than the training has shown.
            adaptive_at_once: choice == ModelChoice::Classical || axis.identification.estimator == Estimator::GreyBox,
            probation_ticks: ticks(PROBATION),
            judge: Judge::new(axis, period),
            comparison: Comparison::new(period),
            last: LastApproved::new(ticks(timing.model_timeout), ticks(timing.model_lifetime)),
            trust: Trust::new(axis.control.following_error, period),
            supervision: commissioned.map(|model| Supervision::new(model.reaction(), axis.encoder.resolution, period)),
            usable_ticks: 0,
            seen: None,
            refusals: [0; REFUSALS.len()],
        }
    }

    /// Forgets the models: the axis is disarmed, and the ticks may be counted anew. The newest snapshot is judged
    /// again.
    pub fn reset(&mut self) {
        self.seen = None;
        self.last.reset();
    }

    /// Begins probation, trust and supervision anew: a controller takes over.
    pub fn begin(&mut self) {
        self.usable_ticks = 0;
        self.trust.reset();
        self.supervision.iter_mut().for_each(Supervision::reset);
    }

    /// Begins the probation anew: the axis does not follow.
    pub fn interrupt(&mut self) {
        self.usable_ticks = 0;
    }

    /// Takes in the newest snapshot and the tick it was made after, at tick `sequence`. Returns the [`control_flag`]
    /// bits that say what is wrong with it.
    pub fn take(&mut self, sequence: u64, snapshot: Option<(u64, &AxisSnapshot)>) -> u32 {
        if self.choice == ModelChoice::None {
            return 0;
        }
        let Some((made_after, snapshot)) = snapshot else {
            return control_flag::NO_MODEL;
        };
        if let Some(seen) = self.seen
            && seen.made_after == made_after
        {
            return seen.flags;
        }
        self.comparison.update(&snapshot.adaptive_errors.h_step, &snapshot.classical_errors.h_step);
        let (model, flags) = self.approve(sequence, snapshot);
        if let Some(model) = model {
            self.last.keep(&model, made_after);
        }
        self.seen = Some(Seen { made_after, flags });
        flags
    }

    /// The model that replaces the last approved one, if any, and the flags of the snapshot.
    fn approve<'a>(&mut self, sequence: u64, snapshot: &'a AxisSnapshot) -> (Option<Approved<'a>>, u32) {
        let classical = || self.judge.judge_classical(snapshot).ok().filter(|_| !self.adaptive_at_once);
        match self.judge.judge(snapshot) {
            Ok(model) if self.adaptive_at_once || self.comparison.is_better() => (Some(model), 0),
            Ok(model) => (classical().or(Some(model)), 0),
            Err(None) => (None, control_flag::NO_MODEL),
            Err(Some(refusal)) => {
                self.refusals[refusal as usize] += 1;
                let last_stays = refusal != Refusal::Worse && self.last.age(sequence) == Age::Fresh;
                (if last_stays { None } else { classical() }, control_flag::MODEL_REFUSED)
            }
        }
    }

    /// The model that may be used at tick `sequence`.
    pub fn model(&self, sequence: u64) -> Option<Approved<'_>> {
        self.last.model(sequence)
    }

    /// How old the last approved model is at tick `sequence`.
    pub fn age(&self, sequence: u64) -> Age {
        self.last.age(sequence)
    }

    /// Whether the answer of the controller by the model may go out. `shadow`: the error that the fallback would have
    /// now, m, if that is known; `by_model`: the model made the last command; `at_limit`: the last command was at its
    /// limit. To be called at every tick in closed loop.
    pub fn admit(
        &mut self,
        answer: ModelAnswer,
        deviation: &Deviation,
        shadow: Option<f64>,
        by_model: bool,
        at_limit: bool,
    ) -> Admission {
        let mut flags = 0;
        self.usable_ticks = match answer {
            ModelAnswer::Command(_) => self.usable_ticks.saturating_add(1),
            ModelAnswer::NoModel | ModelAnswer::NoCommand => 0,
        };
        if answer == ModelAnswer::NoCommand {
            flags |= control_flag::MODEL_REFUSED;
        }
        if !self.trust.update(deviation, by_model, at_limit) {
            flags |= control_flag::MODEL_REFUSED;
            self.usable_ticks = 0;
            self.last.discard();
        }
        if let Some(supervision) = &mut self.supervision {
            supervision.update(deviation, shadow, at_limit);
            flags |= match supervision.verdict() {
                Verdict::Trusted => 0,
                Verdict::Tried => control_flag::MODEL_TRIAL,
                Verdict::Worse => control_flag::MODEL_WORSE,
            };
            if supervision.verdict() != Verdict::Trusted {
                self.usable_ticks = 0;
            }
        }
        let command = match answer {
            ModelAnswer::Command(command) if self.usable_ticks > self.probation_ticks => Some(command),
            _ => None,
        };
        Admission { command, flags }
    }

    /// Snapshots that were refused so far, by the places of [`REFUSALS`].
    pub fn refusals(&self) -> [u64; REFUSALS.len()] {
        self.refusals
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::actuator};
    use pipeline::message::model_fault;

    const FINE: Deviation = Deviation { elapsed: 1, error: 0.0, speed: 0.0 };

    fn gate() -> Gate {
        let machine = machine(1);
        Gate::new(&machine.axes[0], &machine.timing)
    }

    fn snapshot() -> AxisSnapshot {
        let (adaptive, classical) = (actuator(), actuator());
        AxisSnapshot { adaptive, classical, command_low: -1.0, command_high: 1.0, ..AxisSnapshot::default() }
    }

    fn spoilt() -> AxisSnapshot {
        let mut snapshot = snapshot();
        snapshot.adaptive.a[0] = f64::NAN;
        snapshot
    }

    #[test]
    fn without_a_snapshot_there_is_no_model() {
        let mut gate = gate();
        assert_eq!(gate.take(0, None), control_flag::NO_MODEL);
        let training = AxisSnapshot { faults: model_fault::TRAINING, ..snapshot() };
        assert_eq!(gate.take(1, Some((0, &training))), control_flag::NO_MODEL);
        assert!(gate.model(1).is_none() && gate.age(1) == Age::None);
        assert_eq!(gate.refusals(), [0; REFUSALS.len()]);
    }

    #[test]
    fn a_snapshot_is_judged_once_and_a_refusal_leaves_a_fresh_model_in_use() {
        let mut gate = gate();
        assert_eq!(gate.take(1, Some((0, &snapshot()))), 0);
        for _ in 0..3 {
            assert_eq!(gate.take(2, Some((1, &spoilt()))), control_flag::MODEL_REFUSED);
        }
        assert_eq!(gate.refusals()[Refusal::NotFinite as usize], 1);
        assert_eq!(gate.model(2).map(|approved| approved.model.a[0]), Some(actuator().a[0]));
        // Age counts from the snapshot that was approved: 2 s are 200 ticks, 30 s are 3000.
        assert_eq!([200, 201, 3000, 3001].map(|k| gate.age(k)), [Age::Fresh, Age::Stale, Age::Stale, Age::Expired]);
        assert!(gate.model(3000).is_some() && gate.model(3001).is_none());
        // A reset forgets the model and judges the newest snapshot again.
        gate.reset();
        assert_eq!(gate.take(2, Some((1, &spoilt()))), control_flag::MODEL_REFUSED);
        assert_eq!(gate.refusals()[Refusal::NotFinite as usize], 2);
    }

    #[test]
    fn the_classical_model_takes_the_place_of_a_refused_one_when_no_fresh_model_is_left() {
        let mut gate = gate();
        let mut spoilt = spoilt();
        spoilt.classical.b[0] *= 0.9;
        assert_eq!(gate.take(0, Some((0, &spoilt))), control_flag::MODEL_REFUSED);
        assert_eq!(gate.model(0).map(|approved| approved.model.b[0]), Some(0.9 * actuator().b[0]));
    }

    #[test]
    fn a_model_controls_after_its_probation_and_not_before() {
        let mut gate = gate();
        let admitted = |gate: &mut Gate, answer| gate.admit(answer, &FINE, None, false, false);
        let count = |gate: &mut Gate| {
            (0..50).take_while(|_| admitted(gate, ModelAnswer::Command(0.3)).command.is_none()).count()
        };
        assert_eq!(count(&mut gate), 10);
        // Every break begins it anew.
        for (answer, flags) in [(ModelAnswer::NoModel, 0), (ModelAnswer::NoCommand, control_flag::MODEL_REFUSED)] {
            assert_eq!(admitted(&mut gate, answer), Admission { command: None, flags });
            assert_eq!(count(&mut gate), 10);
        }
        gate.interrupt();
        assert_eq!(count(&mut gate), 10);
    }

    #[test]
    fn a_distrusted_model_is_discarded_until_another_one_is_approved() {
        let mut gate = gate();
        gate.take(1, Some((0, &snapshot())));
        // 30 mm is the highest floor of the bound; 20 ticks are 200 ms.
        let lost = Deviation { error: 0.04, ..FINE };
        let flags: Vec<u32> =
            (0..20).map(|_| gate.admit(ModelAnswer::Command(0.3), &lost, None, true, false).flags).collect();
        assert_eq!((flags[18], flags[19]), (0, control_flag::MODEL_REFUSED));
        assert!(gate.model(1).is_none() && gate.age(1) == Age::Fresh);
        gate.take(2, Some((1, &snapshot())));
        assert!(gate.model(2).is_some());
        // It is still distrusted for 5 s.
        assert_eq!(gate.admit(ModelAnswer::Command(0.3), &FINE, None, false, false).command, None);
    }
}
