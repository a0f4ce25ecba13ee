use std::path::Path;

use mechanism::postures;
use pipeline::machine::{BUILT_IN, BUILT_IN_MODEL, model_settings_in};

use super::*;

const TABLE: &str = "[walls]\ndepth = 1.0\nheight = 7.0\nreach = 9.0\nclearance = 0.3\npayload = 1500\n\
                     [[walls.corner]]\nat = [1.1, 0.6]\n";

fn excavator() -> Machine {
    let settings = model_settings_in(BUILT_IN_MODEL, "model").unwrap();
    Machine::parse(&format!("{BUILT_IN}{TABLE}"), "test.toml", Path::new("."), &settings).unwrap()
}

/// Rates of all parts against differences of their places.
#[test]
fn the_rates_towards_the_walls_are_the_derivatives_of_the_distances() {
    let walls = Walls::of(&excavator()).unwrap();
    let distances = |positions: &[f64; AXES]| {
        let mut all = Vec::new();
        walls.each(positions, |_, distance, rates| all.push((distance, *rates)));
        all
    };
    for positions in postures([0.1; AXES], [1.2, 1.3, 1.1, 1.0], 2) {
        let here = distances(&positions);
        assert_eq!(here.len(), 3 * 12);
        for axis in 0..AXES {
            let mut there = positions;
            there[axis] += 1e-6;
            for (before, after) in here.iter().zip(distances(&there)) {
                let rate = (before.0 - after.0) / 1e-6;
                assert!((rate - before.1[axis]).abs() < 2e-3 * (1.0 + rate.abs()), "{axis} {rate} {before:?}");
            }
        }
    }
}

fn still(positions: [f64; AXES], command: f64) -> [Wanted; AXES] {
    positions.map(|position| Wanted { command, motion: Some((position, 0.0)), is_manual: true })
}

/// The teeth are far from all walls: retracted, half drawn in.
const FREE: [f64; AXES] = [0.7, 0.7, 0.1, 0.5];

#[test]
fn commands_far_from_walls_pass_and_an_unknown_position_makes_all_axes_neutral() {
    let mut walls = Walls::of(&excavator()).unwrap();
    walls.limits = [50.0; 3];
    assert_eq!(walls.update(&still(FREE, 0.6)).commands, [0.6; AXES]);
    let mut wanted = still(FREE, 0.6);
    wanted[2].motion = None;
    assert_eq!(walls.update(&wanted), Allowed { commands: [0.0; AXES], stopped: [true; AXES] });
    wanted[2].motion = Some((f64::NAN, 0.0));
    assert_eq!(walls.update(&wanted).commands, [0.0; AXES]);
}

#[test]
fn at_a_wall_only_commands_that_lead_away_pass() {
    let mut walls = Walls::of(&excavator()).unwrap();
    // The teeth stand on the wall.
    let (_, distance) = walls.least_distance(&FREE).unwrap();
    walls.limits = [f64::INFINITY; 3];
    let mut lowest = f64::NEG_INFINITY;
    walls.limits[0] = 0.0;
    walls.each(&FREE, |_, distance, _| lowest = lowest.max(-distance));
    walls.limits[0] = lowest;
    assert!(distance.is_finite() && walls.least_distance(&FREE).unwrap().1.abs() < 1e-12);
    for (command, passes) in [(0.6, true), (-0.6, false)] {
        let mut wanted = still(FREE, 0.0);
        // The boom rises or falls.
        wanted[0].command = command;
        assert_eq!(walls.update(&wanted).commands[0] != 0.0, passes, "{command}");
    }
}

#[test]
fn a_fast_axis_in_closed_loop_is_stopped_and_one_by_hand_is_slowed_before() {
    let mut walls = Walls::of(&excavator()).unwrap();
    walls.limits = [1.0, f64::INFINITY, f64::INFINITY];
    let falling = |is_manual| {
        let mut wanted = still(FREE, 0.0);
        wanted[0] = Wanted { command: -0.6, motion: Some((FREE[0], -0.15)), is_manual };
        wanted
    };
    let mut before = 10.0;
    let mut stopped_at = 0.0;
    for way in (1..200).rev().map(|k| 0.02 * f64::from(k)) {
        let mut limits = walls.clone();
        let mut lowest = f64::NEG_INFINITY;
        limits.limits[0] = 0.0;
        limits.each(&FREE, |_, distance, _| lowest = lowest.max(-distance));
        limits.limits[0] = lowest + way;
        let by_hand = limits.update(&falling(true)).commands[0].abs();
        assert!(by_hand <= before + 1e-12);
        before = by_hand;
        let mut limits = limits.clone();
        if stopped_at == 0.0 && limits.update(&falling(false)).stopped[0] {
            stopped_at = way;
        }
    }
    // 0.15 m/s of the boom's cylinder are about 1.4 m/s of the teeth.
    assert!((0.3..1.5).contains(&stopped_at) && before < 0.45, "{stopped_at} {before}");
}

#[test]
fn the_factor_is_the_largest_that_stops_before_the_wall() {
    for (linear, square, distance) in [(0.3, 0.2, 0.1), (-0.3, 0.8, 0.1), (0.4, 0.0, 0.1), (0.1, 0.1, 0.0)] {
        let headway = Headway { linear, square };
        let factor = headway.factor(distance);
        assert!((headway.at(factor) - distance).abs() < 1e-12 && factor < 1.0, "{factor}");
    }
    assert_eq!(Headway { linear: -0.3, square: 0.2 }.factor(0.0), 1.0);
    assert_eq!(Headway { linear: 0.3, square: 0.2 }.factor(f64::NAN), 0.0);
}

/// Less of a command by hand is left before a wall where the load pulls the arm faster than its curve says.
#[test]
fn a_load_that_overruns_an_axis_counts_in_its_way_to_a_wall() {
    let allowed = |extend: f64| {
        let mut machine = excavator();
        machine.axes[1].commissioned.as_mut().unwrap().overrun.extend = extend;
        let mut walls = Walls::of(&machine).unwrap();
        walls.limits = [50.0, f64::INFINITY, f64::INFINITY];
        // The arm hangs out and extends, towards a wall that the teeth are 0.3 m above.
        let positions = [0.5, 0.3, 0.8, 0.6];
        let (_, distance) = walls.least_distance(&positions).unwrap();
        walls.limits[0] -= distance - 0.3;
        let mut wanted = still(positions, 0.0);
        wanted[1].command = 0.6;
        walls.update(&wanted).commands[1]
    };
    let (usual, overrun) = (allowed(f64::INFINITY), allowed(5e3));
    assert!(overrun < usual - 0.02 && overrun > 0.0, "{usual} {overrun}");
}

/// Regression: the boom was close below the height, the arm drew it away by a hair at full speed and was spared.
#[test]
fn an_axis_that_shakes_the_others_more_than_it_leads_away_is_stopped() {
    let mut walls = Walls::of(&excavator()).unwrap();
    let positions = [0.9745, 1.0871, 1.1492, 0.3776];
    let (mut nearest, mut rates) = (f64::INFINITY, [0.0; AXES]);
    walls.limits = [f64::INFINITY, 6.0, f64::INFINITY];
    walls.each(&positions, |_, distance, rate| {
        if distance < nearest {
            (nearest, rates) = (distance, *rate);
        }
    });
    assert!(rates[0] > 5.0 && rates[1] < 0.0 && rates[1] > -0.2, "{rates:?}");
    walls.limits[1] -= nearest - 0.02;
    for (arm, boom, passes) in [(0.02, 0.0, true), (0.3, 0.0, false), (0.3, -0.1, false)] {
        let mut wanted = still(positions, 0.0);
        (wanted[0].command, wanted[0].motion) = (-0.5, Some((positions[0], boom)));
        (wanted[1].command, wanted[1].motion) = (0.6, Some((positions[1], arm)));
        wanted.iter_mut().for_each(|axis| axis.is_manual = false);
        let Allowed { commands, stopped } = walls.update(&wanted);
        assert_eq!((commands[1] != 0.0, stopped[1]), (passes, !passes), "{arm} {boom}");
        assert_eq!(commands[0], -0.5, "the boom leads away");
    }
}

/// Regression: the boom swung before a wall, and went on towards it with every swing that led away. That kept the swing
/// alive, and took the teeth 12 to 21 mm beyond the wall.
#[test]
fn a_direction_that_was_stopped_rests_for_a_swing() {
    let mut walls = Walls::of(&excavator()).unwrap();
    walls.limits = [0.0, f64::INFINITY, f64::INFINITY];
    let mut lowest = f64::NEG_INFINITY;
    walls.each(&FREE, |_, distance, _| lowest = lowest.max(-distance));
    walls.limits[0] = lowest + 0.5;
    let boom = |walls: &mut Walls, speed: f64, command: f64| {
        let mut wanted = still(FREE, 0.0);
        wanted[0] = Wanted { command, motion: Some((FREE[0], speed)), is_manual: false };
        let Allowed { commands, stopped } = walls.update(&wanted);
        (commands[0], stopped[0])
    };
    assert_eq!(boom(&mut walls.clone(), 0.01, -0.4), (-0.4, false));
    assert_eq!(boom(&mut walls, -0.3, -0.4), (0.0, true));
    let rest = walls.stops[0].rest;
    assert!((30..100).contains(&rest), "{rest}");
    for tick in 1..rest {
        assert_eq!(boom(&mut walls.clone(), 0.01, 0.4), (0.4, false), "the boom leads away, {tick}");
        assert_eq!(boom(&mut walls, 0.01, -0.4), (0.0, true), "{tick}");
    }
    assert_eq!(boom(&mut walls, 0.01, -0.4), (-0.4, false));
}
