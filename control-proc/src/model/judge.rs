//! Which models may be used at all.
//!
//! ```text
//! |poles of 1/A| < 1.02                          the step response stays near what was identified
//! (sum b) N(u) > 0 for u > 0, < 0 for u < 0      a positive command extends
//! |s(end)| |N| >= 1 % of max_speed * time        over the judged time, on both branches
//! u_low <= u <= u_high                           commands that N was learned from, within command_limit; of a grey box
//!                                                also those of commissioning
//! 1/5 <= s'(end) N(u)/(T c(u)) <= 5              at half and all of the commands tested while commissioning
//! sigma_adaptive <= 1.5 sigma_classical          h-step errors, in m; not for a grey box
//! ```
//!
//! s(p) step response of the linear part as its end continues it ([`Ramp`]), m per unit of x, s' its slope, T period in
//! s; c the commissioned curve, m/s, if there is one. A model of hinges that agrees with c may be asked for all
//! commands, also for those it was not trained on: between and beyond its knots it is straight, and a machine that has
//! become slow needs larger commands than were tested when it was healthy.
//!
//! A prediction begins with the last increments of the encoder's counts, and a lag carries them on. At a period of 1 ms
//! that is most of the h-step error of a model with the lag of the axis, and little of that of a classical model, which
//! fits the noise. So the comparison says nothing of a grey box, which stays near the commissioned model anyway.
//!
//! An online estimator is fed by whatever happens. So what it publishes is judged anew at every tick before it may move
//! anything. Trap: the sign of b alone says nothing, because b and N share a free factor; only their product has a
//! direction.

use pipeline::{
    hammerstein::{Basis, Coefficients, Structure},
    machine::{Axis, Commissioned, Estimator, Identification, ModelChoice},
    message::{AxisSnapshot, model_fault},
};

use super::response::Ramp;

/// Largest pole radius. An identified integrator may be a little beyond 1. At 1.02 a deviation grows by half in 20
/// samples, which feedback can still correct.
pub const POLE_LIMIT: f64 = 1.02;
/// Least travel of a full command over the plan's step response, as share of `max_speed` times its length. With a model
/// that moves less, the controller would use full commands for millimetres.
pub const LEAST_TRAVEL: f64 = 0.01;
/// Largest ratio of the h-step errors of the adaptive and the classical model.
pub const WORST_RATIO: f64 = 1.5;
/// Errors needed before two models are compared.
pub const LEAST_COUNT: u64 = 100;
/// Largest ratio of a model's speed to the commissioned one, and of the commissioned one to it: oil, load and pump
/// change the speed, a wrong model changes it more.
pub const SPEED_RATIO: f64 = 5.0;

/// Why a model is refused. The numbers are the places in [`pipeline::message::REFUSALS`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Refusal {
    /// A coefficient is not finite, or the identifier reports that.
    NotFinite,
    /// Orders that no model can have, or that are not the configured ones.
    Structure,
    /// A pole outside [`POLE_LIMIT`].
    Unstable,
    /// A positive command retracts.
    Direction,
    /// A full command of one direction moves the axis less than [`LEAST_TRAVEL`], or in the other direction.
    Unreachable,
    /// The speed is beyond [`SPEED_RATIO`] of the commissioned one.
    Speed,
    /// The adaptive model predicts clearly worse than the classical one.
    Worse,
}

/// A model that may be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approved<'a> {
    /// The model.
    pub model: &'a Coefficients,
    /// Lowest and highest command that the model may be asked for: a polynomial is arbitrary outside.
    pub range: (f64, f64),
}

/// The judge of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Judge {
    /// Structure of the published model without an integrator, which A may have or not.
    structure: Structure,
    choice: ModelChoice,
    /// The adaptive model has to predict as well as the classical one.
    is_compared: bool,
    command_limit: f64,
    least_travel: f64,
    /// Ticks of the step response that is judged.
    response: usize,
    period: f64,
    commissioned: Option<Commissioned>,
}

impl Judge {
    /// A judge by what the machine file expects of the models of `axis`; `period` in s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        let response = axis.control.plan.plan(axis.commissioned.as_ref(), period).response;
        Self {
            structure: without_integrator(&axis.identification),
            choice: axis.control.model,
            is_compared: axis.identification.estimator != Estimator::GreyBox,
            command_limit: axis.control.command_limit,
            least_travel: LEAST_TRAVEL * axis.max_speed * response as f64 * period,
            response,
            period,
            commissioned: axis.commissioned.clone(),
        }
    }

    /// The model of the snapshot that the machine file chooses.
    ///
    /// # Errors
    /// The first reason why it may not be used, or `None` while there is no model.
    pub fn judge<'a>(&self, snapshot: &'a AxisSnapshot) -> Result<Approved<'a>, Option<Refusal>> {
        self.judge_one(snapshot, self.choice == ModelChoice::Adaptive)
    }

    /// The classical model, to be used where the adaptive one is refused.
    ///
    /// # Errors
    /// The first reason why it may not be used either, or `None` while there is no model.
    pub fn judge_classical<'a>(&self, snapshot: &'a AxisSnapshot) -> Result<Approved<'a>, Option<Refusal>> {
        self.judge_one(snapshot, false)
    }

    fn judge_one<'a>(&self, snapshot: &'a AxisSnapshot, adaptive: bool) -> Result<Approved<'a>, Option<Refusal>> {
        // A grey box has its adaptive model before the training ends.
        let is_known = snapshot.faults & model_fault::TRAINING == 0 || (adaptive && !self.is_compared);
        if !is_known || self.choice == ModelChoice::None {
            return Err(None);
        }
        let model = if adaptive { &snapshot.adaptive } else { &snapshot.classical };
        if snapshot.faults & model_fault::NOT_FINITE != 0 || !model.is_finite() {
            return Err(Some(Refusal::NotFinite));
        }
        if !model.structure().is_some_and(|structure| self.expects(&structure)) {
            return Err(Some(Refusal::Structure));
        }
        if !model.poles_within(POLE_LIMIT) {
            return Err(Some(Refusal::Unstable));
        }
        let known = |bound: f64| if bound.is_finite() { bound } else { 0.0 };
        // A grey box has learned from the commands of commissioning, too.
        let tested = self.commissioned.as_ref().filter(|_| !self.is_compared).map_or((0.0, 0.0), Commissioned::tested);
        let range = (
            known(snapshot.command_low).min(tested.0).clamp(-self.command_limit, 0.0),
            known(snapshot.command_high).max(tested.1).clamp(0.0, self.command_limit),
        );
        let ramp = Ramp::of(model, self.response);
        self.judge_reach(model, &ramp, range).map_err(Some)?;
        let range = self.judge_speed(model, &ramp, range).map_err(Some)?;
        if adaptive && self.is_compared && is_worse(snapshot) {
            return Err(Some(Refusal::Worse));
        }
        Ok(Approved { model, range })
    }

    /// Whether it is the configured structure, or has one order more of A or of B: the identifier may choose which
    /// orders predict best. The drift does not matter, since nothing here uses it.
    fn expects(&self, structure: &Structure) -> bool {
        let (na, nb) = (self.structure.na, self.structure.nb);
        let expected = Structure { na: structure.na, nb: structure.nb, drift: structure.drift, ..self.structure };
        *structure == expected && (na..=na + 1).contains(&structure.na) && (nb..=nb + 1).contains(&structure.nb)
    }

    fn judge_reach(&self, model: &Coefficients, ramp: &Ramp, range: (f64, f64)) -> Result<(), Refusal> {
        let nonlinearity = model.nonlinearity();
        let orientation = nonlinearity.orientation(range);
        let gain = model.b().iter().sum::<f64>() * orientation;
        if gain < 0.0 {
            return Err(Refusal::Direction);
        }
        let (low, high) = nonlinearity.reachable(range);
        let travel = ramp.last() * orientation * high.min(-low);
        // Written so that NaN is refused too.
        if gain > 0.0 && travel >= self.least_travel && travel.is_finite() { Ok(()) } else { Err(Refusal::Unreachable) }
    }

    /// Compares the model's speeds with the commissioned ones. Returns the range of commands that the model may be
    /// asked for.
    fn judge_speed(&self, model: &Coefficients, ramp: &Ramp, learned: (f64, f64)) -> Result<(f64, f64), Refusal> {
        let Some(commissioned) = &self.commissioned else { return Ok(learned) };
        let gain = ramp.slope / self.period;
        let nonlinearity = model.nonlinearity();
        let ratio = |command: f64| gain * nonlinearity.evaluate(command) / commissioned.speed(command);
        let agrees = |command: f64| (1.0 / SPEED_RATIO..=SPEED_RATIO).contains(&ratio(command));
        let (low, high) = commissioned.tested();
        let tested = (low.max(-self.command_limit), high.min(self.command_limit));
        let halfway = |dead_band: f64, end: f64| 0.5 * (dead_band + end);
        let learned_end = (learned.0.max(tested.0), learned.1.min(tested.1));
        let middles = (
            halfway(-commissioned.dead_band.retract, learned_end.0),
            halfway(commissioned.dead_band.extend, learned_end.1),
        );
        if ![middles.0, learned_end.0, middles.1, learned_end.1].into_iter().all(agrees) {
            return Err(Refusal::Speed);
        }
        // Polynomials are arbitrary beyond the commands that they were trained on.
        let straight = matches!(nonlinearity.input.basis, Basis::Hinges(_));
        Ok((
            if straight && agrees(tested.0) { -self.command_limit } else { learned.0 },
            if straight && agrees(tested.1) { self.command_limit } else { learned.1 },
        ))
    }
}

fn without_integrator(identification: &Identification) -> Structure {
    let published = identification.published();
    Structure { na: published.na - identification.structure.integrator as usize, ..published }
}

/// Whether the adaptive model predicts clearly worse than the classical one, as far as both are known.
fn is_worse(snapshot: &AxisSnapshot) -> bool {
    let (adaptive, classical) = (&snapshot.adaptive_errors.h_step, &snapshot.classical_errors.h_step);
    if adaptive.count < LEAST_COUNT || classical.count < LEAST_COUNT {
        return false;
    }
    let (adaptive, classical) = (adaptive.sigma(), classical.sigma());
    // A classical model that diverged is no measure. An adaptive model that diverged is worse than any other.
    !adaptive.is_finite() || (classical.is_finite() && adaptive > WORST_RATIO * classical)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::actuator};
    use pipeline::{
        hammerstein::InputMap,
        machine::{DeadBand, IdentifiedOutput},
        statistics::ErrorStatistics,
    };

    fn judge() -> Judge {
        Judge::new(&machine(1).axes[0], 0.01)
    }

    fn snapshot(model: Coefficients) -> AxisSnapshot {
        AxisSnapshot {
            adaptive: model,
            classical: model,
            command_low: -1.0,
            command_high: 1.0,
            ..AxisSnapshot::default()
        }
    }

    fn refusal(change: impl Fn(&mut AxisSnapshot)) -> Option<Option<Refusal>> {
        let mut snapshot = snapshot(actuator());
        change(&mut snapshot);
        judge().judge(&snapshot).err()
    }

    fn errors(count: u64, sigma: f64) -> ErrorStatistics {
        ErrorStatistics { count, mean: 0.0, m2: sigma * sigma * count as f64, max: 3.0 * sigma }
    }

    #[test]
    fn a_model_of_the_axis_is_used_also_when_b_and_n_are_both_negative() {
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(
            refusal(|s| [&mut s.adaptive.b, &mut s.adaptive.f, &mut s.adaptive.g]
                .into_iter()
                .flatten()
                .for_each(|c| *c = -*c)),
            None
        );
        assert_eq!(refusal(|s| s.faults = model_fault::RANK_DEFICIENT | model_fault::COVARIANCE_BOUND), None);
    }

    #[test]
    fn each_defect_has_its_reason() {
        assert_eq!(refusal(|s| s.faults = model_fault::TRAINING), Some(None));
        assert_eq!(refusal(|s| s.faults = model_fault::NOT_FINITE), Some(Some(Refusal::NotFinite)));
        assert_eq!(refusal(|s| s.adaptive.a[0] = f64::NAN), Some(Some(Refusal::NotFinite)));
        assert_eq!(refusal(|s| s.adaptive.g[1] = f64::INFINITY), Some(Some(Refusal::NotFinite)));
        assert_eq!(refusal(|s| s.adaptive.nk += 1), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(|s| s.adaptive.na = 9), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(|s| s.adaptive.a[0] -= 0.1), Some(Some(Refusal::Unstable)));
        assert_eq!(refusal(|s| s.adaptive.b = s.adaptive.b.map(|b| -b)), Some(Some(Refusal::Direction)));
        assert_eq!(refusal(|s| s.adaptive.b = s.adaptive.b.map(|b| 1e-3 * b)), Some(Some(Refusal::Unreachable)));
        assert_eq!(refusal(|s| s.adaptive.b = [0.0; 5]), Some(Some(Refusal::Unreachable)));
        assert_eq!(refusal(|s| s.adaptive.b = [f64::MAX; 5]), Some(Some(Refusal::Unreachable)));
        assert_eq!(refusal(|s| s.adaptive.g = [-0.5, 0.0, 0.0, 0.0, 0.0]), Some(Some(Refusal::Unreachable)));
        assert_eq!(refusal(|s| s.adaptive.f = [0.0; 5]), Some(Some(Refusal::Unreachable)));
    }

    #[test]
    fn a_model_may_have_an_integrator_or_not_whatever_is_configured() {
        let mut machine = machine(1);
        let integrated = actuator().integrated();
        let judge = |machine: &pipeline::machine::Machine, model| {
            Judge::new(&machine.axes[0], 0.01).judge(&snapshot(model)).map(|_| ())
        };
        // The axis of the tests has na = 2 with the pole of the position in it; with one more A has order 3.
        let one_more = {
            let mut model = Coefficients { na: 3, has_drift: 1, drift: 1e-5, ..actuator() };
            (model.a[0], model.a[1], model.a[2]) = (-1.8, 0.8, 0.0);
            model
        };
        for model in [actuator(), one_more] {
            assert_eq!(judge(&machine, model), Ok(()));
        }
        assert_eq!(judge(&machine, Coefficients { na: 4, ..one_more }), Err(Some(Refusal::Structure)));
        machine.axes[0].identification.structure.integrator = true;
        for model in [actuator(), one_more] {
            assert_eq!(judge(&machine, model), Ok(()));
        }
        // If it is identified as a velocity, the pole of the position is added.
        machine.axes[0].identification.output = IdentifiedOutput::Velocity;
        assert_eq!(judge(&machine, actuator()), Err(Some(Refusal::Structure)));
        assert_eq!(judge(&machine, one_more), Ok(()));
        assert_eq!(judge(&machine, Coefficients { na: 4, ..one_more }), Ok(()));
        // The order is right, but a position that is integrated once more diverges.
        assert_ne!(judge(&machine, integrated), Err(Some(Refusal::Structure)));
    }

    #[test]
    fn another_dead_band_or_basis_than_the_configured_one_is_refused() {
        let mut machine = machine(1);
        let input = InputMap { dead_band: (0.05, 0.1), basis: Basis::hinges(&[0.0, 0.2, 0.4]).unwrap() };
        let structure = Structure { na: 2, nb: 0, nk: 5, order: 3, input, ..Structure::PAPER };
        machine.axes[0].identification.structure = structure;
        let judge = Judge::new(&machine.axes[0], 0.01);
        let linear = actuator();
        let model =
            Coefficients { a: linear.a, b: linear.b, f: linear.f, g: linear.g, ..Coefficients::zero(structure) };
        let refusal = |model: Coefficients| judge.judge(&snapshot(model)).err();
        assert_eq!(refusal(model), None);
        assert_eq!(refusal(linear), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { dead_band: [0.05, 0.11], ..model }), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { knots: [0.0, 0.2, 0.5, 0.0, 0.0], ..model }), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { knots: [0.0, 0.2, 0.2, 0.0, 0.0], ..model }), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { basis: 2, ..model }), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { basis: 0, ..model }), Some(Some(Refusal::Structure)));
        assert_eq!(refusal(Coefficients { drift: f64::NAN, ..model }), Some(Some(Refusal::NotFinite)));
        // Commands that end within the dead band do not move the axis.
        let mut snapshot = snapshot(model);
        snapshot.command_high = 0.1;
        assert_eq!(judge.judge(&snapshot), Err(Some(Refusal::Unreachable)));
    }

    #[test]
    fn a_model_is_used_only_for_the_commands_it_was_trained_on() {
        let range = |low, high| {
            let mut snapshot = snapshot(actuator());
            (snapshot.command_low, snapshot.command_high) = (low, high);
            judge().judge(&snapshot).map(|approved| approved.range)
        };
        assert_eq!(range(-0.4, 0.3), Ok((-0.4, 0.3)));
        assert_eq!(range(-9.0, 9.0), Ok((-1.0, 1.0)));
        for (low, high) in [(0.0, 0.5), (-0.5, 0.0), (0.2, 0.5), (f64::NAN, f64::NAN)] {
            // One branch has no data, or the range is unknown.
            assert_eq!(range(low, high), Err(Some(Refusal::Unreachable)), "{low} {high}");
        }
    }

    #[test]
    fn the_adaptive_model_may_not_be_clearly_worse_than_the_classical_one() {
        let with = |adaptive: ErrorStatistics, classical: ErrorStatistics| {
            refusal(move |s| (s.adaptive_errors.h_step, s.classical_errors.h_step) = (adaptive, classical))
        };
        assert_eq!(with(errors(100, 1.4), errors(100, 1.0)), None);
        assert_eq!(with(errors(100, 1.6), errors(100, 1.0)), Some(Some(Refusal::Worse)));
        assert_eq!(with(errors(99, 1.6), errors(100, 1.0)), None);
        assert_eq!(with(errors(100, f64::NAN), errors(100, f64::NAN)), Some(Some(Refusal::Worse)));
        assert_eq!(with(errors(100, 1.6), errors(100, f64::NAN)), None);
    }

    #[test]
    fn the_chosen_model_is_the_one_that_is_judged() {
        let mut machine = machine(1);
        machine.axes[0].control.model = ModelChoice::Classical;
        let mut snapshot = snapshot(actuator());
        snapshot.adaptive.a[0] = 7.0;
        assert!(Judge::new(&machine.axes[0], 0.01).judge(&snapshot).is_ok());
        assert_eq!(judge().judge(&snapshot), Err(Some(Refusal::Unstable)));
        machine.axes[0].control.model = ModelChoice::None;
        assert_eq!(Judge::new(&machine.axes[0], 0.01).judge(&snapshot), Err(None));
    }

    /// The judge of an axis whose commissioned curve is `factor` times what the actuator's model says, tested to 0.6.
    fn commissioned(factor: f64) -> Judge {
        let gain = factor * Ramp::of(&actuator(), 31).slope / 0.01;
        let speed = |opening: f64| gain * actuator().nonlinearity().evaluate(opening);
        let mut machine = machine(1);
        machine.axes[0].commissioned = Some(Commissioned {
            dead_time: 0.05,
            time_constant: 0.05,
            dead_band: DeadBand { extend: 0.0, retract: 0.0 },
            hysteresis: 0.0,
            natural_frequency: 0.0,
            damping: 0.2,
            openings: vec![0.3, 0.6],
            speeds_extend: vec![speed(0.3), speed(0.6)],
            speeds_retract: vec![-speed(-0.3), -speed(-0.6)],
            largest_tested: [f64::INFINITY; 2],
            overrun: pipeline::machine::Overrun::NONE,
            mass: f64::INFINITY,
            noise: 0.0,
            fit_percent: 99.0,
        });
        Judge::new(&machine.axes[0], 0.01)
    }

    #[test]
    fn a_model_far_from_the_commissioned_speeds_is_refused() {
        for (factor, expected) in [
            (1.0, None),
            (0.3, None),
            (4.0, None),
            (0.15, Some(Some(Refusal::Speed))),
            (6.0, Some(Some(Refusal::Speed))),
        ] {
            assert_eq!(commissioned(factor).judge(&snapshot(actuator())).err(), expected, "{factor}");
        }
    }

    #[test]
    fn a_model_of_hinges_that_agrees_may_be_asked_for_all_commands() {
        let range = |model: Coefficients| {
            let mut snapshot = snapshot(model);
            (snapshot.command_low, snapshot.command_high) = (-0.2, 0.7);
            commissioned(1.0).judge(&snapshot).map(|approved| approved.range)
        };
        // A polynomial is limited to the commands it was trained on.
        assert_eq!(range(actuator()), Ok((-0.2, 0.7)));
        let mut judge = commissioned(1.0);
        judge.structure.input.basis = Basis::hinges(&[0.0]).unwrap();
        judge.structure.order = 1;
        let (linear, structure) = (actuator(), judge.structure);
        let hinges =
            Coefficients { a: linear.a, b: linear.b, f: linear.f, g: linear.g, ..Coefficients::zero(structure) };
        let mut snapshot = snapshot(hinges);
        (snapshot.command_low, snapshot.command_high) = (-0.2, 0.7);
        assert_eq!(judge.judge(&snapshot).map(|approved| approved.range), Ok((-1.0, 1.0)));
    }
}
