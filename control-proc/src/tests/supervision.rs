//! Wrong models under the predictive controller of a commissioned axis: it has to lose control to a better fallback.

use pipeline::{
    hammerstein::Coefficients,
    machine::Machine,
    message::{ControlMode, control_flag},
};

use super::{
    Loop, machine,
    models::{actuator, commission_without_dead_band},
};

/// Ticks of a run, and the first that counts.
const TICKS: usize = 12_000;
const FIRST: usize = 500;
/// More than twice the largest following error of the fallback, m.
const FAR: f64 = 0.01;

/// What a run has shown.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// Part of the ticks with a following error of more than [`FAR`].
    far: f64,
    /// Part of the ticks by the model.
    by_model: f64,
    /// Whether the model was found worse.
    is_worse: bool,
}

/// An axis without a dead band, whose fallback knows it well; delay of its models in ticks.
fn rig(delay: usize) -> Machine {
    let mut machine = machine(1);
    let axis = &mut machine.axes[0];
    commission_without_dead_band(axis, [0.06, 0.6]);
    axis.identification.structure.nk = delay;
    machine
}

/// Follows the sine with this model of this delay, or by the fallback alone.
fn run(model: Option<Coefficients>, delay: usize) -> Run {
    let mut axis = Loop::new(&rig(delay), 0.0);
    let commands = axis.run(TICKS, model);
    let counted: Vec<_> = commands[FIRST..].iter().map(|command| command.axes[0]).collect();
    let ousted = control_flag::MODEL_TRIAL | control_flag::MODEL_WORSE | control_flag::CAUTION;
    let mean = |value: &dyn Fn(usize) -> f64| (0..counted.len()).map(value).sum::<f64>() / counted.len() as f64;
    Run {
        far: mean(&|k| f64::from(u8::from(counted[k].error.abs() > FAR))),
        by_model: mean(&|k| f64::from(u8::from(counted[k].mode == ControlMode::Model as u32))),
        is_worse: counted.iter().any(|command| command.flags & ousted != 0),
    }
}

/// The right model with speeds, delay in ticks and lag in s as they are told.
fn with(gain: f64, delay: u32, lag: f64) -> (Coefficients, usize) {
    let kept = (-0.01 / lag).exp();
    let mut model = actuator();
    model.nk = delay;
    model.a[..2].copy_from_slice(&[-1.0 - kept, kept]);
    model.b[0] = gain * 0.6 * 0.01 * (1.0 - kept);
    (model, delay as usize)
}

#[test]
fn a_predictive_controller_with_a_wrong_model_is_not_much_worse_than_its_fallback() {
    assert_eq!(run(None, 5).far, 0.0);
    for (gain, delay, lag) in [
        (0.3, 5, 0.045),
        (0.5, 5, 0.045),
        (2.0, 5, 0.045),
        (3.0, 5, 0.045),
        (1.0, 2, 0.045),
        (1.0, 10, 0.045),
        (0.5, 2, 0.045),
        (1.0, 5, 0.015),
        (1.0, 5, 0.135),
    ] {
        let (model, delay) = with(gain, delay, lag);
        let seen = run(Some(model), delay);
        assert!(seen.far < 0.05, "gain {gain}, delay {delay}, lag {lag}: {seen:?}");
    }
}

#[test]
fn a_predictive_controller_with_the_right_model_keeps_control() {
    let seen = run(Some(actuator()), 5);
    assert!(seen.by_model > 0.99 && !seen.is_worse, "{seen:?}");
}
