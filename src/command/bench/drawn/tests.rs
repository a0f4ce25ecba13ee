use std::ops::RangeInclusive;

use pipeline::machine::{Commissioned, Control, Law, SmithSettings};
use plant_sim::PlantSim;

use super::{
    drive::model_file,
    machine_file::{SCENARIO, machine},
    rig::{self, Rig},
    wrong::{Kind, WrongModel},
    *,
};

#[test]
fn every_value_is_in_its_range_and_the_ranges_are_used_up() {
    type Value = (fn(&Rig) -> f64, RangeInclusive<f64>);
    let values: [Value; 9] = [
        (Rig::period, rig::PERIOD),
        (|rig| rig.valve_bandwidth, rig::VALVE_BANDWIDTH),
        (|rig| rig.dead_time, rig::DEAD_TIME),
        (|rig| rig.dead_band.extend, rig::DEAD_BAND),
        (|rig| rig.dead_band.retract, rig::DEAD_BAND),
        (|rig| rig.hysteresis, rig::HYSTERESIS),
        (|rig| rig.resolution, rig::RESOLUTION),
        (|rig| rig.specific_mass, rig::SPECIFIC_MASS),
        (|rig| rig.load, rig::LOAD),
    ];
    let rigs: Vec<Rig> = (0..1000).map(|number| Rig::draw(3, number)).collect();
    for (index, (value, range)) in values.into_iter().enumerate() {
        let (least, most) = (range.start(), range.end());
        let found = rigs.iter().map(value);
        let (low, high) = found.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        assert!(range.contains(&low) && range.contains(&high), "{index}: {low} to {high}");
        let part = 0.05 * (most - least);
        assert!(low < least + part && high > most - part, "{index}: {low} to {high}");
    }
    let shaped = rigs.iter().filter(|rig| rig.is_s_shaped).count();
    assert!((400..600).contains(&shaped), "{shaped}");
    let changes: std::collections::BTreeSet<&str> = rigs.iter().map(|rig| rig.change.name).collect();
    assert_eq!(changes.len(), 6, "{changes:?}");
}

#[test]
fn a_machine_depends_on_seed_and_number_alone() {
    let numbers = |count, half, only: &[u64]| {
        let choice = Choice { count, seed: 5, half, only: only.to_vec() };
        choice.rigs().into_iter().map(|rig| rig.number).collect::<Vec<_>>()
    };
    assert_eq!(numbers(5, None, &[]), [0, 1, 2, 3, 4]);
    assert_eq!(numbers(5, Some(Half::Design), &[]), [0, 2, 4]);
    assert_eq!(numbers(5, Some(Half::Judge), &[]), [1, 3]);
    assert_eq!(numbers(5, Some(Half::Judge), &[2, 3]), [3]);
    assert_eq!(Rig::draw(5, 3), Rig::draw(5, 3));
    assert_ne!(Rig::draw(5, 3).dead_time, Rig::draw(5, 4).dead_time);
    assert_ne!(Rig::draw(5, 3).dead_time, Rig::draw(6, 3).dead_time);
}

#[test]
fn every_machine_can_be_simulated_and_moves_its_load_whatever_changes() {
    for number in 0..200 {
        let rig = Rig::draw(1, number);
        let scenario = [("scenario".to_owned(), SCENARIO.to_owned())];
        let task = Task::ALL[number as usize % Task::ALL.len()];
        let machine = machine(&rig, task, &scenario).unwrap_or_else(|error| panic!("{number}: {error}"));
        PlantSim::new(&machine, 1).unwrap_or_else(|error| panic!("{number}: {error}"));
        assert!(!machine.scenario.changes.is_empty());
        let [extend, retract] = rig.speeds();
        assert!(extend.min(retract) > 0.999 * rig.speed && extend.max(retract) < 5.0 * rig.speed, "{rig:?}");
        let frequency = swing(&rig);
        assert!((2.0..60.0).contains(&frequency), "{number}: {frequency} Hz");
    }
}

/// Frequency of the load on its oil in the middle of the stroke, Hz.
fn swing(rig: &Rig) -> f64 {
    let (piston, rod) = rig.areas();
    let stiffness = 1.4e9 * (piston + rod) / (0.6 * rig.stroke);
    (stiffness / rig.mass()).sqrt() / std::f64::consts::TAU
}

#[test]
fn every_task_stays_within_speed_and_force_of_its_machine() {
    for number in 0..200 {
        let rig = Rig::draw(2, number);
        let limits = (0.05 * rig.stroke, 0.95 * rig.stroke);
        for task in Task::ALL {
            let points = task.points(&rig, limits);
            let used: Vec<_> = points.windows(2).take_while(|pair| pair[1].0 < task.end()).collect();
            let speed = used.iter().map(|p| ((p[1].1 - p[0].1) / (p[1].0 - p[0].0)).abs()).fold(0.0, f64::max);
            assert!(speed < 0.45 * rig.speed, "{number} {}: {speed} of {}", task.name(), rig.speed);
            assert!(points.iter().all(|point| (limits.0..=limits.1).contains(&point.1)), "{number} {}", task.name());
            assert!(points.windows(2).all(|pair| pair[0].0 < pair[1].0), "{number} {}", task.name());
        }
        let hold = Task::Hold.points(&rig, limits);
        let stands = hold.iter().rev().nth(2).unwrap().0;
        assert!(stands < task::WATCHED.0 - 5.0, "{number}: stands from {stands} s on");
    }
}

/// A model that has something of everything that can be wrong.
fn right_model(rig: &Rig) -> Commissioned {
    Commissioned {
        dead_time: rig.dead_time,
        time_constant: rig.valve_time_constant(),
        dead_band: rig.dead_band,
        hysteresis: rig.hysteresis.min(2.0 * rig.dead_band.extend.min(rig.dead_band.retract)),
        natural_frequency: 0.0,
        damping: 0.2,
        openings: vec![0.05, 0.2, 0.5],
        speeds_extend: vec![0.02, 0.11, 0.3],
        speeds_retract: vec![0.03, 0.12, 0.25],
        largest_tested: [f64::INFINITY; 2],
        overrun: pipeline::machine::Overrun::NONE,
        mass: f64::INFINITY,
        noise: 0.0,
        fit_percent: 95.0,
    }
}

#[test]
fn every_wrong_model_is_wrong_in_its_kind_and_one_that_a_machine_file_may_have() {
    for number in 0..48 {
        let rig = Rig::draw(1, number);
        let right = right_model(&rig);
        let still = machine(&rig, Task::Sines, &[]).unwrap();
        let WrongModel { kind, amount, model } = WrongModel::draw(1, &rig, &right);
        let law = Law::Smith(SmithSettings { kp: 1.0, ki: 0.0, observer_time: 0.1 });
        let control = Control { feedforward: true, law, ..still.axes[0].control };
        let settings = model_file(&still, &model, Some(control)).unwrap();
        let read = machine(&rig, Task::Sines, &settings).unwrap_or_else(|error| panic!("{number} {amount}: {error}"));
        assert_eq!(read.axes[0].commissioned.as_ref(), Some(&model), "{number} {amount}");
        let differs = [
            model.speeds_extend.last() != right.speeds_extend.last(),
            model.dead_time != right.dead_time,
            model.time_constant != right.time_constant,
            model.speeds_extend[0] != right.speeds_extend[0] && kind != Kind::Gain,
            model.dead_band != right.dead_band,
            model.hysteresis != right.hysteresis,
        ];
        assert_eq!(differs, Kind::ALL.map(|other| other == kind), "{number} {amount}");
        assert_eq!(WrongModel::draw(1, &rig, &right), WrongModel { kind, amount, model });
    }
}

#[test]
fn a_set_and_either_half_of_it_have_every_kind_of_wrong_model_equally_often() {
    for (half, each) in [(None, 8), (Some(Half::Design), 4), (Some(Half::Judge), 4)] {
        let rigs = Choice { count: 48, seed: 7, half, only: Vec::new() }.rigs();
        let count = |kind| rigs.iter().filter(|rig| Kind::of(7, rig.number) == kind).count();
        assert_eq!(Kind::ALL.map(count), [each; 6], "{half:?}");
    }
}

#[test]
fn amounts_of_wrong_models_use_up_their_ranges() {
    let factors = |kind: Kind, of: fn(&Commissioned) -> f64, range: RangeInclusive<f64>| {
        let rigs = (0..1200).filter(|number| Kind::of(1, *number) == kind).map(|number| Rig::draw(1, number));
        let factors = rigs.map(|rig| {
            let right = Commissioned { time_constant: 0.1, ..right_model(&rig) };
            of(&WrongModel::draw(1, &rig, &right).model) / of(&right)
        });
        let (low, high) = factors.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let (least, most) = (range.start() - 1e-9, range.end() + 1e-9);
        assert!(least <= low && low < 1.2 * least && 0.8 * most < high && high <= most, "{kind:?}: {low} to {high}");
    };
    factors(Kind::Gain, |model| model.speeds_extend[2], wrong::GAIN);
    factors(Kind::DeadTime, |model| model.dead_time, wrong::DEAD_TIME);
    factors(Kind::Lag, |model| model.time_constant, wrong::LAG);
}
