//! Every option of the structure, on a plant that has exactly this structure: the model is found offline and kept
//! online. Each option is also tested on a plant where the plain structure is wrong.

use std::iter::zip;

use ident_proc::Identifier;
use pipeline::{
    hammerstein::{Basis, Coefficients, InputMap, MAX_A, Structure},
    machine::{Estimator, Form, Identification, IdentifiedOutput, Machine, Split},
    message::{AxisSnapshot, model_fault},
};

const PLAIN: Structure = Structure { na: 2, nb: 1, nk: 2, order: 3, ..Structure::PAPER };
const TRAINING: usize = 1000;
const PERIOD: f64 = 0.01;

/// A fixed pseudo-random sequence between -1 and 1.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

/// Commands of all sizes and both signs.
fn commands(count: usize) -> Vec<f64> {
    (0..count).map(|k| 0.6 * (k as f64 * 0.05).sin() + 0.4 * noise(k / 3)).collect()
}

/// The structure with each option, and with all of them at once.
fn structures() -> [Structure; 6] {
    let input = InputMap { dead_band: (0.08, 0.12), basis: Basis::hinges(&[0.0, 0.2, 0.5]).unwrap() };
    [
        PLAIN,
        Structure { integrator: true, ..PLAIN },
        Structure { drift: true, ..PLAIN },
        Structure { input: InputMap { dead_band: input.dead_band, ..InputMap::PAPER }, ..PLAIN },
        Structure { input: InputMap { basis: input.basis, ..InputMap::PAPER }, ..PLAIN },
        Structure { integrator: true, drift: true, input, ..PLAIN },
    ]
}

/// A plant of the structure, as its model is published.
fn plant(structure: Structure) -> Coefficients {
    let mut model = Coefficients::zero(structure);
    model.a[..2].copy_from_slice(&[-1.2, 0.4]);
    model.b[..2].copy_from_slice(&[0.03, 0.02]);
    model.f[..3].copy_from_slice(&[1.0, 0.4, -0.3]);
    model.g[..3].copy_from_slice(&[0.8, -0.2, 0.1]);
    model.drift = if structure.drift { -0.004 } else { 0.0 };
    if structure.integrator { model.integrated() } else { model }
}

/// y(0), y(1), .. of the plant from rest.
fn outputs(plant: &Coefficients, commands: &[f64]) -> Vec<f64> {
    let x: Vec<f64> = commands.iter().map(|u| plant.nonlinearity().evaluate(*u)).collect();
    let mut outputs: Vec<f64> = Vec::new();
    for k in 0..commands.len() {
        let past: Vec<f64> = (1..=MAX_A).map(|i| k.checked_sub(i).map_or(0.0, |at| outputs[at])).collect();
        let driven: Vec<f64> = (2..=3).map(|lag| k.checked_sub(lag).map_or(0.0, |at| x[at])).collect();
        outputs.push(plant.predict_one(&past, &driven));
    }
    outputs
}

fn settings(structure: Structure) -> Identification {
    let built_in = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
    Identification {
        structure,
        period: PERIOD,
        training: TRAINING,
        horizon: 20,
        estimator: Estimator::Constant(0.995),
        ..built_in
    }
}

/// The last snapshot of a record; row k holds y(k) and u(k).
fn identify(settings: &Identification, outputs: &[f64], commands: &[f64]) -> AxisSnapshot {
    let mut identifier = Identifier::new(settings);
    for (k, y) in outputs.iter().enumerate() {
        identifier.update(Some(*y), k.checked_sub(1).map(|before| commands[before]));
    }
    identifier.snapshot()
}

/// The largest difference of two coefficients.
fn distance(one: &Coefficients, two: &Coefficients) -> f64 {
    let all = |model: &Coefficients| [&model.a[..], &model.b, &model.f, &model.g, &[model.drift]].concat();
    zip(all(one), all(two)).map(|(one, two)| (one - two).abs()).fold(0.0, f64::max)
}

#[test]
fn a_plant_of_each_structure_is_found_and_kept() {
    let commands = commands(3 * TRAINING);
    for structure in structures() {
        let plant = plant(structure);
        let outputs = outputs(&plant, &commands);
        for (form, split) in [(Form::Linear, Split::Als), (Form::Full, Split::Als), (Form::Linear, Split::Paper)] {
            let found = identify(&Identification { form, split, ..settings(structure) }, &outputs, &commands);
            let name = format!("{structure:?} {form:?} {split:?}");
            assert_eq!((found.faults, found.updates), (0, 2000), "{name}");
            assert_eq!(found.classical.structure(), Some(structure.published()), "{name}");
            assert!(distance(&found.classical, &plant) < 1e-6, "{name}: {:?}", found.classical);
            assert!(distance(&found.adaptive, &plant) < 1e-6, "{name}: {:?}", found.adaptive);
            let size = found.output.sigma();
            for errors in [found.classical_errors, found.adaptive_errors] {
                let (ahead, free) = (errors.h_step.rmse(), errors.free_run.rmse());
                assert!(errors.h_step.count > 1900 && ahead < 1e-9 * size, "{name}: {ahead} of {size}");
                assert!(free < 1e-7 * size, "{name}: {free} of {size}");
            }
        }
    }
}

#[test]
fn auto_predicts_a_plant_of_each_structure_without_error() {
    let commands = commands(3 * TRAINING);
    let smallest = Structure { na: 1, nb: 0, nk: 3, order: 1, ..Structure::PAPER };
    let largest = Structure { na: 5, nb: 4, nk: 2, order: 5, integrator: true, drift: true, ..Structure::PAPER };
    for structure in structures().into_iter().chain([smallest, largest]) {
        let outputs =
            outputs(&plant(if structure.order < 3 || structure.na > 2 { PLAIN } else { structure }), &commands);
        let found =
            identify(&Identification { estimator: Estimator::Auto, ..settings(structure) }, &outputs, &commands);
        let (published, adaptive) = (structure.published(), found.adaptive.structure().unwrap());
        assert!((published.na..=published.na + 1).contains(&adaptive.na), "{structure:?}: {adaptive:?}");
        assert!((published.nb..=published.nb + 1).contains(&adaptive.nb), "{structure:?}: {adaptive:?}");
        assert_eq!(found.faults & model_fault::NOT_FINITE, 0, "{structure:?}");
        let (mixture, classical) = (found.unseparated_h_step.rmse(), found.classical_errors.h_step.rmse());
        assert!(mixture <= 1.03 * classical + 1e-6 * found.output.sigma(), "{structure:?}: {mixture} {classical}");
        // The separation solves normal equations, which costs the largest structure digits.
        let adaptive = found.adaptive_errors.h_step.rmse();
        assert!(adaptive <= 1.03 * classical + 1e-4 * found.output.sigma(), "{structure:?}: {adaptive} {classical}");
    }
}

#[test]
fn both_forms_follow_a_gain_and_a_drift_that_change() {
    let commands = commands(6 * TRAINING);
    let structure = structures()[5];
    let before = plant(structure);
    let after = Coefficients { b: before.b.map(|b| 1.5 * b), drift: 0.01, ..before };
    let (one, two) = (outputs(&before, &commands), outputs(&after, &commands));
    // The plant changes in the middle: after the seam the increments are those of the second plant.
    let seam = 2 * TRAINING;
    let shift = one[seam] - two[seam];
    let record: Vec<f64> = (0..commands.len()).map(|k| if k < seam { one[k] } else { two[k] + shift }).collect();
    for form in [Form::Linear, Form::Full] {
        let found = identify(&Identification { form, ..settings(structure) }, &record, &commands);
        assert!(distance(&found.classical, &before) < 1e-6, "{form:?}");
        assert!(distance(&found.adaptive, &after) < 1e-4, "{form:?}: {:?}", found.adaptive);
    }
}

#[test]
fn an_integrator_predicts_a_position_that_runs_away() {
    // Measured by an encoder with steps of 1e-3.
    let structure = Structure { integrator: true, drift: true, ..PLAIN };
    let commands = commands(4 * TRAINING);
    let outputs = outputs(&plant(structure), &commands);
    let outputs: Vec<f64> = outputs.iter().map(|y| (y * 1e3).round() / 1e3).collect();
    let plain = identify(&settings(Structure { na: 3, ..PLAIN }), &outputs, &commands);
    let with = identify(&settings(structure), &outputs, &commands);
    assert!((with.classical.a().iter().sum::<f64>() + 1.0).abs() < 1e-12, "{:?}", with.classical.a);
    let (plain, with) = (plain.classical_errors.h_step.rmse(), with.classical_errors.h_step.rmse());
    assert!(with < 0.5 * plain, "{with} {plain}");
}

#[test]
fn knots_describe_a_hinge_that_powers_cannot() {
    let hinged = Structure {
        input: InputMap { basis: Basis::hinges(&[0.1, 0.4]).unwrap(), ..InputMap::PAPER },
        order: 2,
        ..PLAIN
    };
    let commands = commands(2 * TRAINING);
    let outputs = outputs(&plant(hinged), &commands);
    let sigma = |structure| identify(&settings(structure), &outputs, &commands).classical_errors.h_step.sigma();
    let (powers, knots) = (sigma(Structure { order: 5, ..PLAIN }), sigma(hinged));
    assert!(knots < 1e-3 * powers, "{knots} {powers}");
}

#[test]
fn a_velocity_is_identified_and_a_position_published() {
    let commands = commands(3 * TRAINING);
    for structure in [PLAIN, Structure { drift: true, ..PLAIN }, Structure { integrator: true, ..PLAIN }] {
        let of_velocity = plant(structure);
        let velocities = outputs(&of_velocity, &commands);
        let positions = velocities.iter().scan(0.7, |position, velocity| {
            *position += PERIOD * velocity;
            Some(*position)
        });
        let positions: Vec<f64> = positions.collect();
        let of_position = of_velocity.integrated();
        let of_position =
            Coefficients { b: of_position.b.map(|b| PERIOD * b), drift: PERIOD * of_position.drift, ..of_position };
        for form in [Form::Linear, Form::Full] {
            let settings = Identification { form, output: IdentifiedOutput::Velocity, ..settings(structure) };
            let found = identify(&settings, &positions, &commands);
            assert_eq!(found.adaptive.structure(), Some(settings.published()), "{structure:?}");
            for model in [&found.classical, &found.adaptive] {
                assert!(distance(model, &of_position) < 1e-6, "{structure:?} {form:?}: {model:?}");
                // Its predictions of positions are those of the plant.
                let newest: Vec<f64> = positions[..2000].iter().rev().take(MAX_A).copied().collect();
                let mut predicted = [0.0; 20];
                model.predict(&newest, &commands[2000 - 3..], &mut predicted);
                assert!((predicted[19] - positions[2019]).abs() < 1e-6, "{structure:?} {form:?}");
            }
            // Errors and the output are those of the velocity.
            let of = |values: &[f64]| {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
            };
            assert!((found.output.sigma() / of(&velocities[TRAINING..]) - 1.0).abs() < 1e-2);
            assert!(found.adaptive_errors.h_step.rmse() < 1e-6 * found.output.sigma());
        }
    }
}

#[test]
fn a_velocity_needs_two_positions_in_a_row() {
    let mut identifier = Identifier::new(&Identification { output: IdentifiedOutput::Velocity, ..settings(PLAIN) });
    let commands = commands(2 * TRAINING);
    let positions = outputs(&plant(PLAIN).integrated(), &commands);
    let mut skipped = |k: usize, position: Option<f64>, applied: bool| {
        let before = identifier.snapshot().skipped;
        identifier.update(position, applied.then(|| commands[k - 1]));
        identifier.snapshot().skipped - before
    };
    for (k, position) in positions.iter().enumerate() {
        let (position, applied, expected) = match k {
            // Without a position two velocities are missing, and the row needs two more as its past.
            500 => (None, true, 1),
            501..=503 => (Some(*position), true, 1),
            // After a gap the row needs nk + nb commands, and two velocities made of three positions.
            700 => (Some(*position + 9.0), false, 1),
            701..=702 => (Some(*position + 9.0), true, 1),
            0 => (Some(*position), false, 1),
            1..=2 => (Some(*position), true, 1),
            _ => (Some(if k > 700 { *position + 9.0 } else { *position }), true, 0),
        };
        assert_eq!(skipped(k, position, applied), expected, "{k}");
    }
    assert!(identifier.snapshot().classical_errors.one_step.max < 1e-9);
}

#[test]
fn an_input_that_never_moves_leaves_a_finite_model_of_each_structure() {
    let outputs: Vec<f64> = (0..2 * TRAINING).map(|k| 0.5 + 0.02 * (k as f64 * 0.1).sin()).collect();
    for structure in structures() {
        for form in [Form::Linear, Form::Full] {
            let found = identify(&Identification { form, ..settings(structure) }, &outputs, &vec![0.0; outputs.len()]);
            assert!(
                found.adaptive.is_finite() && found.faults & model_fault::NOT_FINITE == 0,
                "{structure:?} {form:?}"
            );
            assert_ne!(found.faults & model_fault::RANK_DEFICIENT, 0, "{structure:?} {form:?}");
            assert!(found.adaptive_errors.one_step.rmse() < 1e-3, "{structure:?} {form:?}");
        }
    }
}
