//! The predictive controller on simulated processes that equal a model.

use super::*;
use crate::{protection::limits::Limits, tests::models::linear};
use pipeline::{
    hammerstein::{Basis, Coefficients, InputMap, Structure},
    machine::MoveWeight,
};

fn approved(model: &Coefficients) -> Approved<'_> {
    Approved { model, range: (-1.0, 1.0) }
}

const PERIOD: f64 = 0.01;
const ANYWHERE: (f64, f64) = (-1e9, 1e9);

fn plan(horizon: usize, moves: usize, weight: f64) -> Plan {
    Plan { step: 1, horizon, moves, weight: MoveWeight::Relative(weight), response: 31, spring_time: 0.0 }
}

/// Controls a process that equals the model plus a disturbance of its output. Returns outputs and commands.
fn run(
    model: &Coefficients,
    mut predictive: Predictive,
    ticks: usize,
    target: impl Fn(usize) -> f64,
    disturbance: impl Fn(usize) -> f64,
) -> (Vec<f64>, Vec<f64>) {
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    let structure = model.structure().unwrap();
    let nonlinearity = model.nonlinearity();
    let (mut undisturbed, mut x) = (vec![0.0; ticks], vec![0.0; ticks]);
    let (mut outputs, mut commands) = (Vec::new(), Vec::new());
    let mut history = History::resting(disturbance(0));
    for k in 0..ticks {
        for (j, a) in model.a().iter().enumerate().filter(|(j, _)| k > *j) {
            undisturbed[k] -= a * undisturbed[k - 1 - j];
        }
        for (j, b) in model.b().iter().enumerate().filter(|(j, _)| k >= structure.nk + j) {
            undisturbed[k] += b * x[k - structure.nk - j];
        }
        undisturbed[k] += model.drift;
        let y = undisturbed[k] + disturbance(k);
        history.push_output(y, 0);
        let targets: Vec<f64> = (0..MAX_AHEAD).map(|i| target(k + i)).collect();
        let wanted = predictive.update(&approved(model), &limits, &history, &targets).expect("a command");
        let u = wanted;
        history.push_command(u);
        x[k] = nonlinearity.evaluate(u);
        outputs.push(y);
        commands.push(u);
    }
    (outputs, commands)
}

#[test]
fn table_2_with_its_zero_outside_the_circle_is_stable_and_without_offset() {
    for (horizon, moves) in [(10, 1), (20, 4), (31, 8), (20, 8)] {
        let predictive = Predictive::new(plan(horizon, moves, 0.1), ANYWHERE, PERIOD);
        let (y, u) =
            run(&Coefficients::TABLE_2, predictive.clone(), 1500, |_| 20.0, |k| if k < 500 { 0.0 } else { 5.0 });
        for settled in [400..500, 1400..1500] {
            for k in settled {
                assert!((y[k] - 20.0).abs() < 1e-6, "{horizon} {moves}: y({k}) = {}", y[k]);
                assert!((u[k] - u[k - 1]).abs() < 1e-6, "{horizon} {moves}: u({k}) still moves");
            }
        }
    }
}

#[test]
fn a_model_that_is_wrong_by_a_third_still_leaves_no_offset() {
    let mut wrong = Coefficients::TABLE_2;
    wrong.b.iter_mut().for_each(|b| *b *= 1.3);
    wrong.a[0] += 0.01;
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    let (process, mut predictive) = (Coefficients::TABLE_2, Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD));
    let mut history = History::resting(0.0);
    let (mut y, mut x) = ([0.0; 4], [0.0; 3]);
    for _ in 0..2000 {
        y.rotate_right(1);
        y[0] = process.predict_one(&y[1..], &x[..2]);
        history.push_output(y[0] + 3.0, 0);
        let u = predictive.update(&approved(&wrong), &limits, &history, &[20.0]).unwrap();
        history.push_command(u);
        x.rotate_right(1);
        x[0] = process.nonlinearity().evaluate(u);
    }
    assert!((y[0] + 3.0 - 20.0).abs() < 1e-6, "{}", y[0]);
}

#[test]
fn a_drift_leaves_no_offset() {
    // Retracts by 0.2 mm per tick under its load, and needs a fifth of the full command to stay.
    let model = Coefficients { drift: -2e-4, has_drift: 1, ..linear(&[-1.8, 0.8], &[0.001], 3) };
    let (y, u) = run(&model, Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD), 1000, |_| 0.3, |_| 0.0);
    for k in 900..1000 {
        assert!((y[k] - 0.3).abs() < 1e-6 && (u[k] - 0.2).abs() < 1e-4, "y({k}) = {}, u = {}", y[k], u[k]);
    }
}

#[test]
fn a_model_of_hinges_with_a_dead_band_reaches_its_reference() {
    let input = InputMap { dead_band: (0.1, 0.2), basis: Basis::hinges(&[0.0, 0.3]).unwrap() };
    let structure = Structure { na: 2, nb: 0, nk: 3, order: 2, input, ..Structure::PAPER };
    let plain = linear(&[-1.8, 0.8], &[0.001], 3);
    let mut model = Coefficients { a: plain.a, b: plain.b, ..Coefficients::zero(structure) };
    (model.f[0], model.f[1], model.g[0], model.g[1]) = (0.5, 1.0, 0.8, -0.3);
    let target = |k: usize| if k < 500 { 0.3 } else { -0.1 };
    let (y, u) = run(&model, Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD), 1000, target, |_| 0.0);
    // At rest, before the next reference is in the preview.
    for k in (400..470).chain(900..1000) {
        assert!((y[k] - target(k)).abs() < 1e-9, "y({k}) = {}", y[k]);
    }
    assert!(u.iter().all(|u| u.abs() <= 1.0));
}

#[test]
fn coefficients_of_zero_do_not_change_the_control() {
    // Poles of 0 up to order 6, as from na = 5 with an integrator.
    let plain = linear(&[-1.8, 0.8], &[0.001], 5);
    let six = Coefficients { na: 6, ..plain };
    let target = |k: usize| if k < 300 { 0.4 } else { 0.1 };
    let run = |model| run(model, Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD), 600, target, |_| 0.0);
    assert_eq!(run(&six), run(&plain));
    // A model of order 6 with no coefficient of zero reaches its reference too.
    let mut full = Coefficients { na: 5, ..plain };
    full.a[..5].copy_from_slice(&[-0.9, 0.3, -0.15, 0.06, -0.02]);
    let full = full.integrated();
    let (y, _) = run(&full);
    assert!((y[270] - 0.4).abs() < 1e-6 && (y[599] - 0.1).abs() < 1e-6, "{} {}", y[270], y[599]);
}

#[test]
fn another_model_changes_the_command_by_no_more_than_two_percent_where_the_axis_follows() {
    let model = linear(&[-1.8, 0.8], &[0.001], 5);
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    let others = [
        linear(&[-1.8, 0.8], &[0.0013], 5),
        linear(&[-1.8, 0.8], &[0.0007], 5),
        linear(&[-1.6, 0.6], &[0.002], 5),
        linear(&[-1.8, 0.8], &[0.001], 9),
        Coefficients { f: [1.3, 0.0, 0.0, 0.0, 0.0], ..model },
    ];
    let target = |k: usize| (k as f64 - 100.0).clamp(0.0, 200.0) * 0.2 * PERIOD;
    // On the ramp, and after its end.
    for changed in [280, 500] {
        let mut predictive = Predictive::new(plan(20, 20, 25.0), ANYWHERE, PERIOD);
        let (mut history, mut y, mut x) = (History::resting(0.0), [0.0; 3], [0.0; 8]);
        for k in 0..changed {
            y.rotate_right(1);
            y[0] = model.predict_one(&y[1..], &x[4..]);
            history.push_output(y[0], 0);
            let targets: Vec<f64> = (0..MAX_AHEAD).map(|i| target(k + i)).collect();
            let as_before = |predictive: &mut Predictive, model: &Coefficients| {
                predictive.update(&approved(model), &limits, &history, &targets).expect("a command")
            };
            if k + 1 == changed {
                assert!((y[0] - target(k)).abs() < 1e-4, "{changed}: {} m off", y[0] - target(k));
                let before = as_before(&mut predictive.clone(), &model);
                for other in &others {
                    let change = as_before(&mut predictive.clone(), other) - before;
                    assert!(change.abs() <= 0.02, "{changed}: {change} by {other:?}");
                }
            }
            let u = as_before(&mut predictive, &model);
            history.push_command(u);
            x.rotate_right(1);
            x[0] = u;
        }
    }
}

#[test]
fn an_integrator_with_dead_time_follows_a_ramp_of_the_preview_without_lag() {
    // y moves 0.005 m per tick at full command, through a valve of 0.8 and 5 ticks of dead time.
    let model = linear(&[-1.8, 0.8], &[0.001], 5);
    let predictive = Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD);
    let target = |k: usize| (k as f64 - 100.0).clamp(0.0, 200.0) * 0.2 * PERIOD;
    let (y, _) = run(&model, predictive.clone(), 600, target, |_| 0.0);
    for (k, y) in y.iter().enumerate() {
        assert!((y - target(k)).abs() < 3e-3, "y({k}) = {y} for {}", target(k));
    }
    // On the ramp, after the start has decayed and before the end is in the preview.
    let worst = (220..270).map(|k| (y[k] - target(k)).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-6, "{worst}");
}

#[test]
fn the_axis_slows_down_before_its_soft_limits_and_stops_there() {
    // 0.6 m/s at full command, through a lag of 45 ms and 10 ticks of dead time; the reference jumps beyond a limit.
    let model = linear(&[-1.8, 0.8], &[0.6 * 0.01 * 0.2], 10);
    let predictive = Predictive::new(plan(20, 20, 0.1), (-0.4, 0.5), PERIOD);
    let (y, _) = run(&model, predictive, 1500, |k| if k / 300 % 2 == 0 { 0.7 } else { -0.7 }, |_| 0.0);
    let (low, high) = y.iter().fold((0.0f64, 0.0f64), |(low, high), y| (low.min(*y), high.max(*y)));
    println!("from {low} to {high} m");
    assert!(low > -0.402 && high < 0.502 && low < -0.39 && high > 0.49, "from {low} to {high} m");
}

#[test]
fn saturation_does_not_wind_up() {
    let model = linear(&[-1.8, 0.8], &[0.001], 3);
    let predictive = Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD);
    // Far out of reach for 3 s, then back to where the axis is by then.
    let (y, _) = run(&model, predictive.clone(), 500, |k| if k < 300 { 1e3 } else { 1.4 }, |_| 0.0);
    let highest = y.iter().fold(0.0f64, |highest, y| highest.max(*y));
    assert!(highest < y[300] + 0.1, "{highest} after {}", y[300]);
    assert!((y[499] - 1.4).abs() < 1e-3, "{}", y[499]);
}

#[test]
fn there_is_no_command_without_a_finite_answer() {
    let mut predictive = Predictive::new(plan(20, 4, 0.1), ANYWHERE, PERIOD);
    let (history, limits) = (History::resting(0.0), Limits { magnitude: 1.0, step: 0.1 });
    assert_eq!(predictive.update(&approved(&Coefficients::default()), &limits, &history, &[1.0]), None);
    assert_eq!(predictive.update(&approved(&linear(&[-1.0], &[0.0], 1)), &limits, &history, &[1.0]), None);
    assert_eq!(predictive.update(&approved(&linear(&[f64::NAN], &[0.1], 1)), &limits, &history, &[1.0]), None);
    assert_eq!(predictive.update(&approved(&Coefficients::TABLE_2), &limits, &history, &[f64::NAN]), None);
    assert_eq!(predictive.update(&approved(&Coefficients::TABLE_2), &limits, &history, &[]), None);
}

/// A model as it was identified on a valve with a dead band of 0.1: N turns the wrong way for small commands.
fn with_dips() -> Coefficients {
    let mut model = Coefficients::zero(Structure { na: 3, nb: 1, nk: 3, order: 3, ..Structure::PAPER });
    model.a[..3].copy_from_slice(&[-1.0988, -0.2981, 0.3969]);
    model.b[..2].copy_from_slice(&[4.01e-3, -6.09e-3]);
    model.f[..3].copy_from_slice(&[1.0, -14.45, 25.0]);
    model.g[..3].copy_from_slice(&[0.995, 12.06, 19.6]);
    model
}

#[test]
fn a_command_crosses_the_dips_of_the_dead_band_and_does_not_come_back() {
    let model = with_dips();
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    let range = (-0.31, 0.28);
    for (error, far) in [(1e-3, -0.09), (-1e-3, 0.08)] {
        let mut predictive = Predictive::new(plan(20, 20, 25.0), ANYWHERE, PERIOD);
        // The last command was at the other edge of the dead band, and the axis stands beside its set point.
        let mut history = History::resting(error);
        history.push_command(-far);
        let mut commands = Vec::new();
        for _ in 0..30 {
            history.push_output(error, 0);
            let u = predictive.update(&Approved { model: &model, range }, &limits, &history, &[0.0; 60]).unwrap();
            history.push_command(u);
            commands.push(u);
        }
        assert!(commands[10..].iter().all(|u| u / far > 1.0), "{commands:?}");
    }
}

#[test]
fn a_model_that_moves_the_other_way_over_the_horizon_gives_no_command() {
    // Poles 0.95 and the integrator, zero at 1.1: 10 ticks of the final direction do not make up for the begin.
    let model = linear(&[-1.95, 0.95], &[1e-3, -1.1e-3], 3);
    let (history, limits) = (History::resting(0.0), Limits { magnitude: 1.0, step: 0.1 });
    let mut predictive = Predictive::new(plan(20, 8, 0.1), ANYWHERE, PERIOD);
    assert_eq!(predictive.update(&approved(&model), &limits, &history, &[1.0; 60]), None);
    let mut predictive = Predictive::new(plan(20, 8, 0.1), ANYWHERE, PERIOD);
    let minimum_phase = linear(&[-1.95, 0.95], &[1e-3, -0.9e-3], 3);
    assert!(predictive.update(&approved(&minimum_phase), &limits, &history, &[1.0; 60]).is_some());
}

#[test]
fn a_command_outside_the_range_of_the_model_returns_to_it_at_the_full_rate() {
    let model = linear(&[-1.8, 0.8], &[1.2e-3], 5);
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    // The range has shrunk: the command was 0.9 or -0.9, and has to be within 0.3.
    for last in [0.9, -0.9] {
        let mut predictive = Predictive::new(plan(20, 20, 25.0), ANYWHERE, PERIOD);
        let mut history = History::resting(0.0);
        history.push_command(last);
        let small = Approved { model: &model, range: (-0.3, 0.3) };
        let mut before = last;
        for _ in 0..6 {
            history.push_output(0.0, 0);
            // The references ask for an even larger command.
            let u = predictive.update(&small, &limits, &history, &[last.signum(); 60]).expect("a command");
            assert!((before - u - 0.1 * last.signum()).abs() < 1e-9, "{u} after {before}");
            history.push_command(u);
            before = u;
        }
        assert!((before.abs() - 0.3).abs() < 1e-9 && predictive.unsolved() == 0, "{before}");
    }
}

#[test]
fn without_an_answer_of_the_solver_the_first_move_is_clipped_and_counted() {
    let model = linear(&[-1.8, 0.8], &[1.2e-3], 5);
    let limits = Limits { magnitude: 1.0, step: 0.1 };
    let mut predictive = Predictive::new(plan(20, 20, 25.0), ANYWHERE, PERIOD);
    let mut history = History::resting(0.0);
    predictive.solver.iteration_limit = 0;
    for k in 1..=7 {
        history.push_output(0.0, 0);
        let u = predictive.update(&approved(&model), &limits, &history, &[1.0; 60]).expect("a command");
        assert!((u - history.commands()[0]).abs() <= 0.1 + 1e-12 && u > 0.0, "{u}");
        assert_eq!((predictive.unsolved(), predictive.unsolved_in_a_row()), (k, k));
        history.push_command(u);
    }
    predictive.solver.iteration_limit = 1000;
    history.push_output(0.0, 0);
    predictive.update(&approved(&model), &limits, &history, &[1.0; 60]).expect("a command");
    assert_eq!((predictive.unsolved(), predictive.unsolved_in_a_row()), (7, 0));
}
