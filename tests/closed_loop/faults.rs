//! Faults of encoder and supply on the simulated machine; and that no scenario is taken for one.

use pipeline::{
    machine::{Machine, ModelChoice, Scenario},
    message::{bit_names, control_flag},
};

use super::{ClosedLoop, commissioned};

/// The scenarios of the closed loop.
fn scenarios() -> Vec<Scenario> {
    Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty()).collect()
}

/// The built-in machine on its own references, commissioned or as it is.
fn built_in(scenario: &str, is_commissioned: bool, model: ModelChoice) -> Machine {
    let mut settings = vec![("scenario".to_owned(), scenario.to_owned())];
    if is_commissioned {
        settings.extend_from_slice(commissioned());
    }
    let mut machine = Machine::load(None, &settings).unwrap();
    for axis in &mut machine.axes {
        (axis.control.model, axis.control.feedforward) = (model, is_commissioned);
    }
    machine
}

/// What latches in `seconds`, and the floor of the following error, m, that each axis needs not to be stopped.
fn run(machine: Machine, seconds: u64) -> (Vec<String>, Vec<f64>) {
    let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.clone()).collect();
    let mut closed = ClosedLoop::new(machine, 1);
    let mut latched = Vec::new();
    let mut needed = vec![0.0f64; names.len()];
    let mut recent = vec![[0.0f64; 20]; names.len()];
    let mut before = vec![0.0; names.len()];
    while closed.tick < 100 * seconds {
        let command = closed.tick(None);
        for (i, axis) in command.axes[..names.len()].iter().enumerate() {
            let flags = axis.flags & control_flag::LATCHED;
            if flags != 0 && !latched.iter().any(|said: &String| said.starts_with(&names[i])) {
                let why: Vec<_> = bit_names(flags, &control_flag::NAMES).collect();
                latched.push(format!("{} after {:.2} s: {}", names[i], 0.01 * closed.tick as f64, why.join(", ")));
            }
            let speed = (axis.reference - before[i]) / 0.01;
            before[i] = axis.reference;
            recent[i].rotate_right(1);
            recent[i][0] = axis.error.abs() - 0.2 * speed.abs();
            needed[i] = needed[i].max(recent[i].iter().copied().fold(f64::INFINITY, f64::min));
        }
    }
    (latched, needed)
}

#[test]
fn no_scenario_is_taken_for_a_fault() {
    let mut wrong = Vec::new();
    for (is_commissioned, model) in [
        (false, ModelChoice::Adaptive),
        (false, ModelChoice::None),
        (true, ModelChoice::Adaptive),
        (true, ModelChoice::None),
    ] {
        for scenario in scenarios() {
            let (latched, needed) = run(built_in(&scenario.name, is_commissioned, model), 60);
            println!("{} {is_commissioned} {model:?}: needs {needed:.3?} {latched:?}", scenario.name);
            wrong.extend(latched.into_iter().map(|said| format!("{} {is_commissioned} {model:?} {said}", scenario.name)));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
