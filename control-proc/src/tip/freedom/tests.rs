//! Free axes on the built-in excavator.

use pipeline::machine::{Machine, TipPiece, TipShape, TipWithout, Walls};

use super::*;

#[test]
fn the_curve_goes_through_its_points_without_an_overshoot_or_a_kink() {
    let points = [(0.0, 0.2), (1.0, 0.5), (1.5, 0.5), (3.0, 0.1), (4.0, 0.9)];
    for (s, position) in points {
        assert!((curve(&points, s) - position).abs() < 1e-12);
    }
    assert!((curve(&[(1.0, 0.2), (3.0, 0.6)], 2.5) - 0.5).abs() < 1e-12, "a straight line between two points");
    let all: Vec<f64> = (0..=4000).map(|k| curve(&points, 1e-3 * f64::from(k))).collect();
    assert!(all[..1000].windows(2).all(|pair| pair[1] > pair[0]), "rises");
    assert!(all[1000..=1500].iter().all(|position| (position - 0.5).abs() < 1e-12), "stays");
    let slopes: Vec<f64> = all.windows(2).map(|pair| (pair[1] - pair[0]) / 1e-3).collect();
    assert!(slopes.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.01));
}

fn task(start: [f64; 2], pitch: f64, pieces: &[TipShape]) -> TipTask {
    let pieces = pieces.iter().map(|shape| TipPiece { shape: *shape, pitch: None, free: None }).collect();
    let without = TipWithout::default();
    TipTask { start, pitch, speed: 0.35, free: None, rounding: 0.0, file: None, pieces, without }
}

/// The built-in machine with a load in the bucket, kg, and a wall above it, m.
fn machine(payload: f64, height: Option<f64>) -> Machine {
    let mut machine = Machine::load(None, &[]).unwrap();
    machine.mechanism.as_mut().unwrap().masses.payload.mass = payload;
    let corners = vec![[1.15, 0.62], [0.45, 0.8]];
    machine.walls = height.map(|_| Walls { depth: None, height, reach: None, clearance: 0.3, payload: 0.0, corners });
    machine
}

/// Regression: along this slope the boom went by 15 mm in 10 s, for a little more room of the telescope.
#[test]
fn a_boom_that_can_stand_does_not_creep() {
    let machine = machine(0.0, None);
    let slope = task([7.25, 0.2], -115.0, &[TipShape::Line([4.22, -1.55])]);
    let (_, found) = chosen(&machine, &slope);
    let Freedom::Boom(runs) = found.unwrap() else { panic!("the boom is chosen") };
    assert_eq!(runs.len(), 1);
    assert!(runs[0].iter().all(|point| point.1 == runs[0][0].1), "{runs:?}");
}

/// Whether the soft limits alone would leave another boom, and the choice.
fn chosen(machine: &Machine, task: &TipTask) -> (Result<(), NoPosture>, Result<Freedom, NoPosture>) {
    let mechanism = machine.mechanism.unwrap();
    let way = Way::new(task, mechanism.geometry.bucket_length).unwrap();
    let cylinders = Cylinders::new(machine, &mechanism);
    let search = Search { cylinders: &cylinders, way: &way, runs: way.runs(), fixed: Vec::new() };
    let parts: Vec<Parts> = search.runs.iter().map(|run| search.parts(*run, f64::INFINITY)).collect();
    let by_limits = search.cheapest(&parts, &search.stretches(&parts), Demand::Limits).unwrap();
    let free = by_limits.expect_free(&cylinders, &way, &search.runs);
    let found = Freedom::choose(&cylinders, &way, task);
    if let Ok(found) = &found {
        found.expect_free(&cylinders, &way, &search.runs).unwrap();
    }
    (free, found)
}

/// Regression: forces and walls were looked at after the choice. These tasks were refused, and other booms can do them.
#[test]
fn a_load_or_a_wall_that_is_in_the_way_of_one_boom_is_avoided_by_another() {
    let line = |start, pitch, to| task(start, pitch, &[TipShape::Line(to)]);
    let boom = line([4.96, 0.45], -90.1, [7.97, 1.38]);
    let (before, found) = chosen(&machine(4500.0, None), &boom);
    assert!(matches!(before, Err(NoPosture::Place(_, Short::Force(0, _)))), "{before:?}");
    assert!(found.is_ok(), "{found:?}");
    let arm = line([7.83, -0.315], -118.5, [7.69, 2.227]);
    let (before, found) = chosen(&machine(3895.0, None), &arm);
    assert!(matches!(before, Err(NoPosture::Place(_, Short::Force(1, _)))), "{before:?}");
    assert!(found.is_ok(), "{found:?}");
    let wall = line([7.565, 1.235], -118.8, [6.49, -0.083]);
    // Of a machine without a model a task stays 0.25 m away.
    let (before, found) = chosen(&machine(0.0, Some(4.78)), &wall);
    assert!(matches!(before, Err(NoPosture::Place(_, Short::Wall("height", _)))), "{before:?}");
    assert!(found.is_ok(), "{found:?}");
    // No boom can do these.
    let (_, found) = chosen(&machine(9000.0, None), &arm);
    assert!(matches!(found, Err(NoPosture::Place(_, Short::Force(..)))), "{found:?}");
    let (_, found) = chosen(&machine(0.0, Some(3.0)), &wall);
    assert!(matches!(found, Err(NoPosture::Place(_, Short::Wall("height", _)))), "{found:?}");
}

/// Lowest and highest boom at every place of a way, m, from the soft limits alone; an empty range where there is none.
fn ranges(machine: &Machine, task: &TipTask) -> Vec<(f64, f64)> {
    let mechanism = machine.mechanism.unwrap();
    let way = Way::new(task, mechanism.geometry.bucket_length).unwrap();
    let cylinders = Cylinders::new(machine, &mechanism);
    let range = |s: f64| {
        let booms = (0..=400).map(|k| {
            let (low, high) = cylinders.limits[0];
            low + (high - low) * f64::from(k) / 400.0
        });
        let free = booms.filter(|boom| cylinders.expect_free(&way.place(s), Free::Boom(*boom)).is_ok());
        free.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), boom| (low.min(boom), high.max(boom)))
    };
    stations((0.0, way.length())).map(range).collect()
}

/// Whether the boom can go one way from begin to end: it never has to be higher, or lower, than it may be later on.
fn leads_one_way(ranges: &[(f64, f64)]) -> bool {
    let mut rises = ranges.iter().scan(f64::NEG_INFINITY, |least, range| {
        *least = least.max(range.0);
        Some(*least <= range.1)
    });
    let mut falls = ranges.iter().scan(f64::INFINITY, |most, range| {
        *most = most.min(range.1);
        Some(*most >= range.0)
    });
    rises.all(|is_possible| is_possible) || falls.all(|is_possible| is_possible)
}

#[test]
fn the_boom_turns_round_in_a_run_only_where_it_has_to() {
    let machine = machine(0.0, None);
    let circle = task([7.0, -0.5], -115.0, &[TipShape::Arc { center: [6.0, -0.5], angle: -360.0 }]);
    assert!(!leads_one_way(&ranges(&machine, &circle)));
    assert_eq!(chosen_for(&machine, &circle).unwrap().reversals(), 1);
    let (mut curved, mut one_way) = (0, 0);
    for k in 0..60 {
        let [x, z] = [5.0 + 0.05 * f64::from(k), -1.0 + 0.5 * f64::from(k % 7)];
        let angle = 60.0 + 40.0 * f64::from(k % 6);
        let arc = task([x, z], -110.0, &[TipShape::Arc { center: [x - 0.9, z + 0.4], angle: -angle }]);
        let Ok(found) = chosen_for(&machine, &arc) else { continue };
        curved += usize::from(found.points() > 2);
        if leads_one_way(&ranges(&machine, &arc)) {
            one_way += 1;
            assert_eq!(found.reversals(), 0, "{k} {found:?}");
        } else {
            assert!(found.reversals() > 0, "{k} {found:?}");
        }
    }
    println!("{curved} curves, {one_way} one way");
    assert!(curved > 0 && one_way > 0);
}

fn chosen_for(machine: &Machine, task: &TipTask) -> Result<Freedom, NoPosture> {
    let mechanism = machine.mechanism.unwrap();
    let way = Way::new(task, mechanism.geometry.bucket_length).unwrap();
    Freedom::choose(&Cylinders::new(machine, &mechanism), &way, task)
}

/// Down, back, and down again: three runs, and the boom may turn round between them.
#[test]
fn between_runs_the_boom_turns_round_for_nothing() {
    let line = |x, z| TipShape::Line([x, z]);
    let cycle = task([7.5, 1.5], -105.0, &[line(7.5, -2.0), line(7.5, 1.5), line(7.5, -2.0)]);
    let found = chosen_for(&machine(0.0, None), &cycle).unwrap();
    assert_eq!((found.reversals(), found.points()), (0, 2));
    let Freedom::Boom(runs) = &found else { panic!("{found:?}") };
    let moved: Vec<f64> = runs.iter().map(|run| run[1].1 - run[0].1).collect();
    assert!(moved[0] * moved[1] < 0.0 && moved[1] * moved[2] < 0.0, "{moved:?}");
}

#[test]
fn a_person_says_where_boom_or_telescope_is() {
    let machine = machine(0.0, None);
    let level = task([7.2, 0.0], -115.0, &[TipShape::Line([5.5, 0.0]), TipShape::Line([3.7, 0.0])]);
    let boom = |free: Freedom, s: f64| match free.at(s) {
        Free::Boom(position) => position,
        Free::Telescope(_) => f64::NAN,
    };
    let still = TipTask { free: Some(TipFree::Boom(0.85)), ..level.clone() };
    let found = chosen_for(&machine, &still).unwrap();
    assert!((0..=35).all(|k| boom(found.clone(), 0.1 * f64::from(k)) == 0.85));
    let far = TipTask { free: Some(TipFree::Boom(0.6)), ..level.clone() };
    assert!(matches!(chosen_for(&machine, &far), Err(NoPosture::Place(_, Short::Axis(2, _)))));
    // At the end of the first piece, inside the run: the boom comes by there without a kink.
    let mut by_piece = level.clone();
    by_piece.pieces[0].free = Some(TipFree::Boom(0.87));
    let found = chosen_for(&machine, &by_piece).unwrap();
    assert!((boom(found.clone(), 1.7) - 0.87).abs() < 1e-12);
    let slope = |s: f64| (boom(found.clone(), s + 1e-4) - boom(found.clone(), s)) / 1e-4;
    assert!((slope(1.7) - slope(1.7 - 1e-4)).abs() < 1e-3);
    // The telescope there decides the boom.
    by_piece.pieces[0].free = Some(TipFree::Telescope(0.5));
    let mechanism = machine.mechanism.unwrap();
    let cylinders = Cylinders::new(&machine, &mechanism);
    let way = Way::new(&by_piece, mechanism.geometry.bucket_length).unwrap();
    let found = Freedom::choose(&cylinders, &way, &by_piece).unwrap();
    let positions = cylinders.positions(&way.place(1.7), found.at(1.7)).unwrap();
    assert!((positions[2] - 0.5).abs() < 1e-9, "{positions:?}");
    by_piece.pieces[1].free = Some(TipFree::Boom(1.3));
    let refused = chosen_for(&machine, &by_piece).unwrap_err();
    assert!(matches!(refused, NoPosture::Place(s, Short::Axis(0, 1.3)) if (s - 3.5).abs() < 1e-9), "{refused:?}");
}

/// What is taken as even between two choices is off by less than the reserve with which a motion is sought again.
#[test]
fn between_two_choices_a_posture_is_nearly_even() {
    let machine = machine(1500.0, Some(8.0));
    let mechanism = machine.mechanism.unwrap();
    let cylinders = Cylinders::new(&machine, &mechanism);
    let (mut length, mut part, mut wall) = (0.0f64, 0.0f64, 0.0f64);
    for k in 0..200 {
        let at = mechanism::Vector::new(3.5 + 0.1 * f64::from(k % 50), -2.0 + 1.3 * f64::from(k / 50));
        let place = crate::tip::way::TipPlace { at, pitch: (-90.0 - 10.0 * f64::from(k % 4)).to_radians() };
        for pair in choices(cylinders.limits[0]).windows(2) {
            let [Ok(()), Ok(())] = [pair[0], pair[1]].map(|boom| cylinders.expect_free(&place, Free::Boom(boom)))
            else {
                continue;
            };
            let of = |boom: f64| cylinders.posture(&place, Free::Boom(boom)).unwrap();
            let (even, right) = (of(pair[0]).towards(&of(pair[1]), 0.5), of(0.5 * (pair[0] + pair[1])));
            for i in 0..mechanism::AXES {
                let (low, high) = cylinders.allowed_forces(i);
                length = length.max((even.positions[i] - right.positions[i]).abs());
                part = part.max((even.forces[i] - right.forces[i]).abs() / high.min(-low));
            }
            wall = wall.max(even.wall - right.wall);
            assert!(right.wall - even.wall < 0.03, "{even:?} {right:?}");
        }
    }
    println!("{length} m, {part}, {wall} m");
    assert!(length > 0.0 && length < 1e-3 && part < 1e-3 && wall < 5e-3, "{length} m, {part}, {wall} m");
}

/// Regression: at the edge of the reach the boom has less room than between two of its choices. These tasks were
/// refused, and could be planned with a telescope by hand.
#[test]
fn at_the_edge_of_the_reach_a_task_that_a_telescope_by_hand_can_do_is_planned() {
    let machine = machine(0.0, None);
    for (start, pitch, to, telescope) in
        [([5.411, -2.589], -75.26, [6.017, -1.718], 1.13), ([6.859, 3.437], -128.71, [6.772, 3.453], 1.14)]
    {
        let line = task(start, pitch, &[TipShape::Line(to)]);
        let by_hand = TipTask { free: Some(TipFree::Telescope(telescope)), ..line.clone() };
        chosen_for(&machine, &by_hand).unwrap();
        let found = chosen_for(&machine, &line);
        assert!(found.is_ok(), "{start:?}: {found:?}");
    }
}

/// Regression: the boom that puts the telescope at its soft limit puts it there to a rounding error, and the task was
/// refused.
#[test]
fn a_telescope_by_hand_may_be_at_its_soft_limit_for_the_whole_task_or_at_the_end_of_a_piece() {
    let machine = machine(0.0, None);
    for (x, limit) in [(4.5, 0.05), (5.0, 0.05), (7.2, 0.05), (6.2, 1.15), (7.2, 1.15), (8.0, 1.15)] {
        let lines = [TipShape::Line([x - 0.4, 0.0]), TipShape::Line([x - 0.8, 0.0])];
        let level = task([x, 0.0], -115.0, &lines);
        let whole = TipTask { free: Some(TipFree::Telescope(limit)), ..level.clone() };
        chosen_for(&machine, &whole).unwrap();
        let mut by_piece = level.clone();
        by_piece.pieces[0].free = Some(TipFree::Telescope(limit));
        let found = chosen_for(&machine, &by_piece);
        assert!(found.is_ok(), "{x} {limit}: {found:?}");
        by_piece.pieces[1].free = Some(TipFree::Telescope(limit));
        let found = chosen_for(&machine, &by_piece);
        assert!(found.is_ok(), "{x} {limit}: {found:?}");
    }
}
