//! The controller does not allocate while models control its axes, nor when a fault makes it neutral.

use std::hint::black_box;

use control_proc::Controller;
use pipeline::{
    hammerstein::Coefficients,
    machine::Machine,
    message::{CoefficientSnapshot, ControlMode, EncoderSample, control_flag},
};

use crate::allocations;

/// A lag and an integrator behind the dead time of the machine file: both the simulated axes and their models.
fn model(machine: &Machine, axis: usize) -> Coefficients {
    let mut model = Coefficients::zero(machine.axes[axis].identification.structure);
    // (1 - z^-1)(1 - 0.8 z^-1), or without the lag where A has one coefficient only; 0.5 m/s at full command.
    let (a, b): (&[f64], f64) = if model.na >= 2 { (&[-1.8, 0.8], 0.2) } else { (&[-1.0], 1.0) };
    model.a[..a.len()].copy_from_slice(a);
    model.b[0] = b * 0.5 * machine.timing.period.as_secs_f64();
    (model.f[0], model.g[0]) = (1.0, 1.0);
    model
}

/// Number of allocations for every cause of a latch: of the neutral message, the ticks after it, and the reset.
fn neutral_allocations(controller: &Controller, snapshot: &CoefficientSnapshot) -> u64 {
    let mut allocated = 0;
    let count = snapshot.header.axis_count as usize;
    for bit in (0..32).map(|bit| 1 << bit).filter(|bit| control_flag::LATCHED & bit != 0) {
        let mut controller = controller.clone();
        let mut sample = EncoderSample::default();
        sample.header.axis_count = count as u32;
        sample.axes[..count].iter_mut().for_each(|axis| axis.position = 0.6);
        let before = allocations();
        if bit == control_flag::EMERGENCY_STOP {
            sample.emergency_stop = 1;
        } else {
            controller.latch(bit);
        }
        for tick in 5000..5010 {
            sample.header.sequence = tick;
            let command = black_box(controller.update(&sample, Some(snapshot), None));
            let neutral = black_box(controller.neutral(tick));
            for axis in command.axes[..count].iter().chain(&neutral.axes[..count]) {
                assert!(axis.command == 0.0 && axis.flags & control_flag::LATCHED == bit, "{bit}: {}", axis.flags);
            }
        }
        sample.emergency_stop = 0;
        sample.header.sequence += 1;
        controller.update(&sample, Some(snapshot), None);
        controller.disarm();
        controller.arm();
        assert!(!controller.is_latched());
        allocated += allocations() - before;
    }
    allocated
}

#[test]
fn the_controller_allocates_nothing_while_models_control() {
    let machine = Machine::four_axes(&[]).unwrap();
    let count = machine.axes.len();
    let models: Vec<Coefficients> = (0..count).map(|axis| model(&machine, axis)).collect();
    let mut commands: Vec<Vec<f64>> = vec![vec![0.0; 64]; count];
    let mut outputs: Vec<[f64; 8]> =
        machine.axes.iter().map(|axis| [0.5 * (axis.soft_limits.0 + axis.soft_limits.1); 8]).collect();
    let mut controller = Controller::new(&machine).unwrap();
    controller.arm();
    let mut snapshot = CoefficientSnapshot::default();
    snapshot.header.axis_count = count as u32;
    for (entry, model) in snapshot.axes.iter_mut().zip(&models) {
        (entry.adaptive, entry.classical) = (*model, *model);
        (entry.command_low, entry.command_high) = (-1.0, 1.0);
    }

    let (mut by_model, mut allocated) = (0, 0);
    for tick in 0..5000u64 {
        let mut sample = EncoderSample::default();
        (sample.header.sequence, sample.header.axis_count) = (tick, count as u32);
        for (entry, y) in sample.axes.iter_mut().zip(&outputs) {
            entry.position = y[0];
        }
        snapshot.header.sequence = tick.saturating_sub(1);
        let before = allocations();
        let command = black_box(controller.update(black_box(&sample), Some(&snapshot), None));
        allocated += allocations() - before;
        for (axis, entry) in command.axes[..count].iter().enumerate() {
            by_model += u64::from(entry.mode == ControlMode::Model as u32);
            let (u, y) = (&mut commands[axis], &mut outputs[axis]);
            u.rotate_right(1);
            u[0] = entry.command;
            let model = &models[axis];
            let next = model.predict_one(&y[..], &u[model.nk as usize - 1..]);
            y.rotate_right(1);
            y[0] = next;
        }
    }
    assert_eq!(allocated, 0);
    assert_eq!(neutral_allocations(&controller, &snapshot), 0);
    assert!(by_model > 4 * 4000, "models controlled for {by_model} ticks of axes");
}

#[test]
fn an_excavator_whose_payload_is_estimated_allocates_nothing() {
    let settings = [("mechanism.payload.heaviest", "3000"), ("axis.boom.pressure.resolution", "1e3")];
    let machine = Machine::load(None, &settings.map(|(key, value)| (key.to_owned(), value.to_owned()))).unwrap();
    let mut controller = Controller::new(&machine).unwrap();
    controller.arm();
    let (mut allocated, mut payloads) = (0, (f64::INFINITY, 0.0_f64));
    for tick in 0..500 {
        let mut sample = EncoderSample::default();
        (sample.header.sequence, sample.header.axis_count) = (tick, 4);
        sample.axes[..4].iter_mut().for_each(|axis| axis.position = 0.6);
        let boom = &mut sample.axes[0];
        (boom.piston_pressure, boom.rod_pressure, boom.has_pressures) = (1e5 * tick as f64, 1e6, 1);
        let before = allocations();
        let command = black_box(controller.update(black_box(&sample), None, None));
        allocated += allocations() - before;
        payloads = (payloads.0.min(command.teeth.payload), payloads.1.max(command.teeth.payload));
    }
    assert!(payloads.0 == 0.0 && payloads.1 > 1000.0, "{payloads:?}");
    assert_eq!(allocated, 0);
}
