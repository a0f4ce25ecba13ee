//! Faults of encoder and supply on the simulated machine, and scenarios that must not be taken for a fault.

use pipeline::{
    machine::{Change, Machine, ModelChoice, Parameter},
    message::{ControlMode, EncoderReading, bit_names, control_flag, sample_fault},
};

use super::{ClosedLoop, commissioned, scenarios};

/// The built-in machine with its own references, commissioned or not.
fn built_in(scenario: &str, is_commissioned: bool, model: ModelChoice) -> Machine {
    let mut settings = vec![("scenario".to_owned(), scenario.to_owned())];
    if is_commissioned {
        settings.extend_from_slice(commissioned());
    }
    let mut machine = Machine::four_axes(&settings).unwrap();
    for axis in &mut machine.axes {
        (axis.control.model, axis.control.feedforward) = (model, is_commissioned);
    }
    machine
}

/// Runs for `seconds`. Returns what latches, and for each axis the least `following_error` with which it does not
/// latch, m.
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

/// Expects that nothing latches in a minute of any scenario.
fn expect_no_fault(is_commissioned: bool, model: ModelChoice) {
    let mut wrong = Vec::new();
    for scenario in scenarios() {
        let (latched, needed) = run(built_in(&scenario.name, is_commissioned, model), 60);
        println!("{} {is_commissioned} {model:?}: needs {needed:.3?} {latched:?}", scenario.name);
        wrong.extend(latched.into_iter().map(|said| format!("{} {is_commissioned} {model:?} {said}", scenario.name)));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_scenario_is_taken_for_a_fault_by_the_model() {
    expect_no_fault(false, ModelChoice::Adaptive);
}

#[test]
fn no_scenario_is_taken_for_a_fault_by_the_fallback() {
    expect_no_fault(false, ModelChoice::None);
}

#[test]
fn no_scenario_is_taken_for_a_fault_by_the_commissioned_model() {
    expect_no_fault(true, ModelChoice::Adaptive);
}

#[test]
fn no_scenario_is_taken_for_a_fault_by_the_commissioned_fallback() {
    expect_no_fault(true, ModelChoice::None);
}

/// Whether every axis is latched by this cause.
fn are_latched(closed: &ClosedLoop, cause: u32) -> bool {
    let axes = closed.machine.axes.len();
    let command = closed.controller.neutral(0);
    command.axes[..axes].iter().all(|axis| axis.flags & control_flag::LATCHED == cause)
}

/// The commissioned machine after 15 s, when models control its axes.
fn moving() -> ClosedLoop {
    let mut closed = ClosedLoop::new(built_in("nominal", true, ModelChoice::Adaptive), 1);
    while closed.tick < 1500 {
        closed.tick(None);
    }
    assert!(closed.controller.neutral(0).axes[..4].iter().all(|axis| axis.flags & control_flag::LATCHED == 0));
    closed
}

#[test]
fn a_bit_of_an_encoder_that_flips_moves_no_command_by_a_hundredth_of_its_range() {
    let moving = moving();
    for bit in 0..32 {
        let (mut clean, mut spoilt) = (moving.clone(), moving.clone());
        let flip = |reading: &mut EncoderReading| reading.encoders[..4].iter_mut().for_each(|e| e.counts ^= 1 << bit);
        let (mut worst, mut dropped) = (0.0f64, false);
        for k in 0..50 {
            let expected = clean.tick(None);
            let command = if k == 10 { spoilt.tick_with(None, flip) } else { spoilt.tick(None) };
            if k == 10 {
                let faults = spoilt.sample.axes[..4].iter().map(|axis| axis.faults & sample_fault::UNUSABLE);
                dropped = faults.clone().all(|faults| faults != 0);
                // 128 counts are 12.8 mm, more than an axis moves in a tick.
                assert!(dropped || bit < 7, "{bit}: {:?}", faults.collect::<Vec<_>>());
            }
            for (command, expected) in command.axes[..4].iter().zip(&expected.axes) {
                worst = worst.max((command.command - expected.command).abs());
            }
        }
        println!("bit {bit}: {:.3} % of the range, dropped {dropped}", 50.0 * worst);
        assert!(!dropped || worst <= 0.02, "bit {bit}: {worst}");
        assert!(are_latched(&spoilt, 0), "bit {bit}");
    }
}

#[test]
fn a_position_that_steps_by_twenty_millimetres_and_stays_is_never_followed() {
    for step in [200, -200] {
        let mut closed = moving();
        let before: Vec<f64> = closed.plant.axes().iter().map(|axis| axis.position).collect();
        let slip = |reading: &mut EncoderReading| reading.encoders[..4].iter_mut().for_each(|e| e.counts += step);
        for k in 0..300 {
            let command = closed.tick_with(None, slip);
            for axis in &command.axes[..4] {
                assert!(k < 3 || (axis.command == 0.0 && axis.mode == ControlMode::Neutral as u32), "{k}");
            }
        }
        assert!(are_latched(&closed, control_flag::FEEDBACK));
        for (axis, before) in closed.plant.axes().iter().zip(before) {
            assert!((axis.position - before).abs() < 0.05, "{} m", axis.position - before);
        }
        // After half a second the new position is believed. Then the axes can be reset, and go on from there.
        closed.controller.disarm();
        closed.controller.arm();
        let command = (0..60).map(|_| closed.tick_with(None, slip)).last().unwrap();
        assert!(command.axes[..4].iter().all(|axis| axis.flags & control_flag::LATCHED == 0));
        assert!(command.axes[..4].iter().all(|axis| axis.mode != ControlMode::Neutral as u32));
    }
}

#[test]
fn without_supply_no_axis_lurches_when_it_is_back() {
    let mut machine = built_in("nominal", true, ModelChoice::Adaptive);
    // The pressure that is left carries no load.
    let gone = [Parameter::SupplyPressure, Parameter::PumpFlow].map(|parameter| {
        [
            Change { axis: None, parameter, start: 15.0, end: 15.0, to: 0.05 },
            Change { axis: None, parameter, start: 20.0, end: 20.0, to: 20.0 },
        ]
    });
    machine.scenario.changes = gone.concat();
    let mut closed = ClosedLoop::new(machine, 1);
    let mut latched = [None; 4];
    let mut stood = Vec::new();
    while closed.tick < 2500 {
        let command = closed.tick(None);
        for (latched, axis) in latched.iter_mut().zip(&command.axes) {
            if axis.flags & control_flag::LATCHED != 0 {
                latched.get_or_insert((closed.tick, axis.flags & control_flag::LATCHED));
            }
        }
        if closed.tick == 2000 {
            stood = closed.plant.axes().iter().map(|axis| axis.position).collect();
        }
        for (axis, stood) in closed.plant.axes().iter().zip(&stood) {
            assert!((axis.position - stood).abs() < 0.02, "{}: {}", closed.tick, axis.position - stood);
        }
    }
    println!("{latched:?}");
    assert!(latched.iter().flatten().any(|(_, cause)| *cause == control_flag::STALL), "{latched:?}");
    for (tick, cause) in latched.into_iter().flatten() {
        assert!(tick > 1500 && cause & (control_flag::STALL | control_flag::FOLLOWING) != 0, "{tick} {cause}");
    }
}
