//! Snapshots with models that must never be used.

use pipeline::{
    hammerstein::Coefficients,
    message::{AxisSnapshot, CoefficientSnapshot, ControlMode, REFUSALS, control_flag, model_fault},
};
use proptest::{prelude::*, sample::select, test_runner::Config};

use super::{Loop, machine, models::actuator, snapshot};

/// Ways to spoil a model; `place` and `size` choose where and how much.
fn spoil(axis: &mut AxisSnapshot, way: usize, place: usize, size: f64) {
    let model: &mut Coefficients = &mut axis.adaptive;
    let nonsense = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][place % 3];
    match way {
        0 => model.a[place % 5] = nonsense,
        1 => model.b[place % 5] = nonsense,
        2 => model.f[place % 5] = nonsense,
        3 => model.g[place % 5] = nonsense,
        // (1 - p z^-1)(1 - 0.8 z^-1) with p outside the limit on either side.
        4 => {
            let pole = if place.is_multiple_of(2) { 1.03 + size } else { -1.03 - size };
            (model.a[0], model.a[1]) = (-0.8 - pole, 0.8 * pole);
        }
        5 => model.b[0] = -model.b[0] * (0.1 + size),
        6 => model.f.iter_mut().for_each(|f| *f = -*f * size),
        7 => model.g = [0.0; 5],
        8 => [model.na, model.nb, model.nk, model.order][place % 4] = 0,
        9 => model.nk = [0, 4, 6, 65, u32::MAX][place % 5],
        10 => model.na = [0, 1, 4, 6, u32::MAX][place % 5],
        11 => model.nb = [2, 3, 5, u32::MAX][place % 4],
        12 => model.order = [0, 1, 4, 6, u32::MAX][place % 5],
        13 => axis.faults |= model_fault::TRAINING,
        14 => axis.faults |= model_fault::NOT_FINITE,
        15 => model.b[0] *= 1e-4 * size.min(1.0),
        _ => {
            axis.adaptive_errors.h_step.count = 200;
            axis.adaptive_errors.h_step.m2 = 200.0 * (1.6 + size).powi(2);
            axis.classical_errors.h_step.count = 200;
            axis.classical_errors.h_step.m2 = 200.0;
        }
    }
}

proptest! {
    #![proptest_config(Config::with_cases(1000))]

    #[test]
    fn poisoned_snapshots_are_never_used(
        ways in prop::collection::vec(
            (select(vec![0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 16]), 0usize..60, 0.0f64..10.0),
            1..4,
        ),
    ) {
        let machine = machine(1);
        let (mut with, mut without) = (Loop::new(&machine, 0.05), Loop::new(&machine, 0.05));
        for k in 0..80u64 {
            let mut poisoned: CoefficientSnapshot = snapshot(k, actuator());
            let (way, place, size) = ways[k as usize % ways.len()];
            spoil(&mut poisoned.axes[0], way, place, size);
            // Otherwise the classical model would be used instead.
            poisoned.axes[0].classical = Coefficients::default();
            let (a, b) = (with.tick(Some(&poisoned)).axes[0], without.tick(None).axes[0]);
            prop_assert_eq!(a.command.to_bits(), b.command.to_bits());
            prop_assert_eq!(a.mode, b.mode);
            prop_assert!(a.flags & (control_flag::NO_MODEL | control_flag::MODEL_REFUSED) != 0);
        }
    }
}

#[test]
fn a_refused_model_is_counted_once_by_its_reason_and_the_last_approved_model_stays_in_use() {
    // Way of spoiling, place, size, and the expected reason.
    let ways: [(usize, usize, f64, &str); 10] = [
        (0, 0, 0.0, "not-finite"),
        (1, 1, 0.0, "not-finite"),
        (14, 0, 0.0, "not-finite"),
        (9, 0, 0.0, "structure"),
        (12, 0, 0.0, "structure"),
        (4, 0, 0.5, "unstable"),
        (4, 1, 0.5, "unstable"),
        (5, 0, 1.0, "direction"),
        (7, 0, 0.0, "unreachable"),
        (15, 0, 1.0, "unreachable"),
    ];
    for (way, place, size, reason) in ways {
        let (mut spoilt, mut whole) = (Loop::new(&machine(1), 0.0), Loop::new(&machine(1), 0.0));
        spoilt.run(100, Some(actuator()));
        whole.run(100, Some(actuator()));
        let old = snapshot(99, actuator());
        for k in 0..150 {
            // A new one every other tick.
            let mut bad = snapshot(100 + k / 2 * 2, actuator());
            spoil(&mut bad.axes[0], way, place, size);
            // The classical model could be used, but the last approved one is preferred.
            bad.axes[0].classical.b[0] *= 0.9;
            let (command, expected) = (spoilt.tick(Some(&bad)).axes[0], whole.tick(Some(&old)).axes[0]);
            assert_eq!(command.command.to_bits(), expected.command.to_bits(), "{reason}, tick {k}");
            assert_eq!((command.mode, command.flags), (ControlMode::Model as u32, control_flag::MODEL_REFUSED));
            let mut counts = [0; REFUSALS.len()];
            counts[REFUSALS.iter().position(|name| *name == reason).unwrap()] = k / 2 + 1;
            assert_eq!(command.rejected_snapshots, counts);
        }
    }
}

#[test]
fn the_classical_model_replaces_the_last_approved_one_when_that_is_stale() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(100, Some(actuator()));
    for k in 100..4000 {
        let mut bad = snapshot(k, actuator());
        spoil(&mut bad.axes[0], 0, 0, 0.0);
        let command = axis.tick(Some(&bad)).axes[0];
        // The classical model is as fresh as its snapshot.
        assert_eq!((command.mode, command.flags), (ControlMode::Model as u32, control_flag::MODEL_REFUSED), "{k}");
    }
}

#[test]
fn an_adaptive_model_that_predicts_worse_is_replaced_by_the_classical_one_at_once() {
    let machine = machine(1);
    let (mut worse, mut held) = (Loop::new(&machine, 0.0), Loop::new(&machine, 0.0));
    let slower = Coefficients { b: actuator().b.map(|b| 0.8 * b), ..actuator() };
    worse.run(100, Some(actuator()));
    held.run(100, Some(actuator()));
    for k in 100..200 {
        let mut bad = snapshot(k, actuator());
        bad.axes[0].classical = slower;
        spoil(&mut bad.axes[0], 16, 0, 0.0);
        let command = worse.tick(Some(&bad)).axes[0];
        let expected = held.tick(Some(&snapshot(k, slower))).axes[0];
        assert_eq!(command.command.to_bits(), expected.command.to_bits(), "{k}");
        assert_eq!(command.rejected_snapshots[6], k - 99);
    }
}

#[test]
fn one_snapshot_is_judged_per_tick_and_disarming_judges_the_newest_again() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(100, Some(actuator()));
    let mut bad = snapshot(99, actuator());
    spoil(&mut bad.axes[0], 0, 0, 0.0);
    for k in 0..10 {
        // Ten snapshots come per tick; the newest one is judged.
        bad.header.sequence = 100 + 10 * k;
        assert_eq!(axis.tick(Some(&bad)).axes[0].rejected_snapshots[0], k + 1);
    }
    let good = snapshot(axis.sequence, actuator());
    axis.tick(Some(&good));
    axis.controller.disarm();
    axis.controller.arm();
    let commands: Vec<_> = (0..60).map(|_| axis.tick(Some(&good)).axes[0]).collect();
    assert_eq!(commands[59].mode, ControlMode::Model as u32);
}

#[test]
fn a_distrusted_model_does_not_come_back_as_the_last_approved_one() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(400, Some(actuator()));
    let last = snapshot(399, actuator());
    // The axis is far from its reference whatever it is commanded.
    for k in 0..100 {
        axis.tick_with(Some(&last), None, |sample| {
            if k < 25 {
                sample.axes[0].position = 0.4
            }
        });
    }
    // Five seconds later, and for as long as nothing new comes.
    let commands: Vec<_> = (0..1000).map(|_| axis.tick(Some(&last)).axes[0]).collect();
    assert!(commands.iter().all(|command| command.mode == ControlMode::Fallback as u32));
    let commands = axis.run(50, Some(actuator()));
    assert_eq!(commands[49].axes[0].mode, ControlMode::Model as u32);
}

#[test]
fn the_classical_model_replaces_a_refused_adaptive_one() {
    let classical = super::machine_with("command_rate = 10.0\n", "command_rate = 10.0\nmodel = \"classical\"\n");
    let (mut refused, mut held) = (Loop::new(&machine(1), 0.0), Loop::new(&classical, 0.0));
    for k in 0..200 {
        let mut snapshot = snapshot(k, actuator());
        let expected = held.tick(Some(&snapshot)).axes[0];
        spoil(&mut snapshot.axes[0], k as usize % 4, k as usize, 1.0);
        let command = refused.tick(Some(&snapshot)).axes[0];
        assert_eq!((command.command.to_bits(), command.mode), (expected.command.to_bits(), expected.mode), "{k}");
        assert_eq!(
            (command.flags & control_flag::MODEL_REFUSED != 0, command.rejected_snapshots.iter().sum()),
            (true, k + 1)
        );
    }
    assert_eq!(held.tick(Some(&snapshot(200, actuator()))).axes[0].mode, ControlMode::Model as u32);
}

#[test]
fn the_classical_model_does_not_suffer_from_a_poisoned_adaptive_one() {
    let machine = super::machine_with("command_rate = 10.0\n", "command_rate = 10.0\nmodel = \"classical\"\n");
    let mut axis = Loop::new(&machine, 0.0);
    for k in 0..100 {
        let mut poisoned = snapshot(k, actuator());
        poisoned.axes[0].adaptive.a = [f64::NAN; 7];
        axis.tick(Some(&poisoned));
    }
    assert_eq!(axis.tick(Some(&snapshot(99, actuator()))).axes[0].mode, ControlMode::Model as u32);
}
