//! The drive, the encoders, and machines that cannot be simulated.

use pipeline::machine::{Change, Parameter};
use plant_sim::PlantError;

use super::*;

fn millis(time: u64) -> Duration {
    Duration::from_millis(time)
}

#[test]
fn the_drive_goes_neutral_without_commands_and_works_again_after_a_command() {
    let mut machine = excavator();
    plant_of(&mut machine, 0).dead_time = 0.0;
    let (mut silent, mut neutral) = (simulate(&machine), simulate(&machine));
    for sim in [&mut silent, &mut neutral] {
        sim.command(&all(0.5));
    }
    silent.advance(millis(50));
    neutral.advance(millis(50));
    assert_eq!(silent.axes(), neutral.axes());

    neutral.command(&all(0.0));
    silent.advance(millis(40));
    neutral.advance(millis(40));
    assert_eq!(silent.axes(), neutral.axes(), "no command for longer than the time-out acts as a neutral command");

    let spool = silent.axes()[0].spool_position;
    silent.command(&all(0.5));
    silent.advance(millis(10));
    assert!(silent.axes()[0].spool_position > spool);
}

#[test]
fn cutting_the_pilot_pressure_off_moves_the_spools_to_neutral_at_once() {
    let machine = excavator();
    let moving = || {
        let mut sim = simulate(&machine);
        hold(&mut sim, 0.5, 1.0);
        sim
    };
    let (mut cut, mut neutral) = (moving(), moving());
    cut.command(&ValveCommand { cut_off: 1, ..all(0.5) });
    neutral.command(&all(0.0));
    let open = cut.axes()[0].spool_position;
    // 5 ms are less than the shortest dead time: the neutral command does not act yet.
    cut.advance(millis(5));
    neutral.advance(millis(5));
    for (cut, neutral) in cut.axes().iter().zip(neutral.axes()) {
        assert!(neutral.spool_position > 0.99 * open, "{neutral:?}");
        assert!(cut.spool_position < 0.95 * open, "{cut:?}");
    }
    // The pilot pressure stays cut off while the drive times out, and no hysteresis keeps the spools open.
    cut.advance(millis(2000));
    assert!(cut.axes().iter().all(|axis| axis.spool_position.abs() < 1e-6 && axis.velocity.abs() < 5e-3));
    hold(&mut cut, 0.5, 0.5);
    assert!(cut.axes().iter().all(|axis| axis.velocity > 0.05), "the command acts again");
}

#[test]
fn the_time_out_does_not_depend_on_how_time_is_divided() {
    let machine = excavator();
    let (mut whole, mut cut) = (simulate(&machine), simulate(&machine));
    for sim in [&mut whole, &mut cut] {
        sim.command(&all(-0.7));
    }
    whole.advance(millis(210));
    for _ in 0..3000 {
        cut.advance(Duration::from_micros(70));
    }
    assert_eq!((whole.time(), whole.axes()), (cut.time(), cut.axes()));
}

#[test]
fn parts_of_a_step_add_up() {
    let mut sim = simulate(&excavator());
    for _ in 0..3 {
        sim.advance(Duration::from_nanos(33_333));
    }
    assert_eq!(sim.time(), Duration::from_nanos(99_999));
    sim.advance(Duration::from_nanos(1));
    assert_eq!(sim.time(), STEP);
}

/// A machine whose boom moves at about 0.2 m/s after 1 s.
fn moving() -> PlantSim {
    let mut machine = excavator();
    plant_of(&mut machine, 0).dead_time = 0.0;
    let mut sim = simulate(&machine);
    hold(&mut sim, 0.6, 1.0);
    sim
}

#[test]
fn the_states_between_two_steps_are_those_of_the_time_asked_for() {
    let (mut begin, mut within) = (moving(), moving());
    let at_begin = begin.axes()[0];
    begin.advance(STEP);
    let at_end = begin.axes()[0];
    for part in 1..=3 {
        within.advance(STEP / 4);
        let expected = at_begin.position + 0.25 * f64::from(part) * (at_end.position - at_begin.position);
        let found = within.axes()[0].position;
        assert!((found - expected).abs() < 1e-13, "{part}/4 of a step: {found}, not {expected}");
    }
    within.advance(STEP / 4);
    assert_eq!(within.axes(), begin.axes());
}

#[test]
fn a_command_within_a_step_acts_from_the_next_step_on() {
    let (mut early, mut due) = (moving(), moving());
    early.advance(STEP / 2);
    early.command(&all(-1.0));
    early.advance(STEP / 2);
    due.advance(STEP);
    assert_eq!(early.axes(), due.axes(), "the step has begun under the command before");
    due.command(&all(-1.0));
    early.advance(STEP);
    due.advance(STEP);
    assert_eq!(early.axes(), due.axes());
}

#[test]
fn commands_out_of_range_are_clamped_and_commands_that_are_not_finite_are_neutral() {
    let machine = excavator();
    for (given, meant) in
        [(f64::NAN, 0.0), (f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0), (1e300, 1.0), (-1e300, -1.0)]
    {
        let (mut sim, mut expected) = (simulate(&machine), simulate(&machine));
        hold(&mut sim, given, 1.0);
        hold(&mut expected, meant, 1.0);
        assert_eq!(sim.axes(), expected.axes(), "{given}");
        assert!(sim.axes().iter().all(|axis| axis.position.is_finite() && axis.piston_pressure.is_finite()));
    }
}

#[test]
fn equal_seeds_give_equal_bits_and_different_seeds_different_noise() {
    let machine = Machine::four_axes(&[]).unwrap();
    let run = |seed| {
        let mut sim = PlantSim::new(&machine, seed).unwrap();
        let readings: Vec<_> = (0..300)
            .map(|i| {
                hold(&mut sim, (f64::from(i) * 0.05).sin(), 0.01);
                sim.read()
            })
            .collect();
        (readings, sim.axes().to_vec())
    };
    let (first, again, other) = (run(1), run(1), run(2));
    assert_eq!(first, again);
    assert_eq!(first.1, other.1, "the seed changes the noise, not the motion");
    assert_ne!(first.0, other.0);
}

#[test]
fn readings_are_numbered_and_hold_every_axis() {
    let mut sim = simulate(&excavator());
    for sequence in 0..3 {
        let reading = sim.read();
        assert_eq!((reading.header.sequence, reading.header.axis_count), (sequence, 4));
        assert_eq!((reading.header.acquired_ns, reading.header.sent_ns), (0, 0));
        for (value, position) in reading.encoders.iter().zip([0.65, 0.75, 0.6, 0.55]) {
            assert!((value.counts as f64 * 1e-4 - position).abs() < 2.5e-4);
        }
        assert!(reading.encoders[4..].iter().all(|value| value.counts == 0));
    }
}

#[test]
fn an_axis_without_a_plant_is_named() {
    let mut machine = excavator();
    machine.axes[2].plant = None;
    let error = PlantSim::new(&machine, 1).unwrap_err();
    assert_eq!(error, PlantError::NoPlant { axis: "telescope".to_owned() });
    assert!(error.to_string().contains("[axis.telescope.plant]"));
}

#[test]
fn an_axis_too_stiff_for_the_step_is_refused_and_named() {
    type Edit = fn(&mut Machine);
    let changes: [Edit; 5] = [
        |machine| plant_of(machine, 3).mass = 20.0,
        |machine| {
            let plant = plant_of(machine, 3);
            (plant.rod_dead_volume, plant.internal_leakage, plant.rated_flow) = (1e-5, 1e-9, 1e-5);
        },
        |machine| (plant_of(machine, 3).piston_dead_volume, plant_of(machine, 3).rated_flow) = (1e-5, 1e-2),
        |machine| {
            let change = Change { axis: Some(3), parameter: Parameter::Mass, start: 1.0, end: 2.0, to: 1e-3 };
            machine.scenario.changes = vec![change];
        },
        |machine| plant_of(machine, 3).end_stop_damping = 1e9,
    ];
    for (case, change) in changes.into_iter().enumerate() {
        let mut machine = excavator();
        change(&mut machine);
        match PlantSim::new(&machine, 1).err() {
            Some(PlantError::TooStiff { axis, rate, limit }) => assert!(axis == "bucket" && rate > limit),
            other => panic!("case {case}: {other:?}"),
        }
    }
}

#[test]
fn axes_just_below_the_stiffness_limit_come_to_rest_in_their_stops() {
    type Edit = fn(&mut Plant);
    let changes: [Edit; 3] = [
        |plant| plant.end_stop_damping = 6e7,
        |plant| (plant.mass, plant.end_stop_damping) = (170.0, 1e6),
        |plant| plant.rated_flow = 6e-3, // the pressure at the orifice chatters within a bound
    ];
    for (case, change) in changes.into_iter().enumerate() {
        let mut machine = excavator();
        change(plant_of(&mut machine, 3));
        let mut sim = simulate(&machine);
        for (command, rest) in [(1.0, machine.axes[3].stroke), (-1.0, 0.0)] {
            hold(&mut sim, command, 10.0);
            let mut chatter = (f64::INFINITY, 0.0f64);
            for _ in 0..100 {
                sim.advance(Duration::from_micros(100));
                let pressure = sim.axes()[3].piston_pressure;
                chatter = (chatter.0.min(pressure), chatter.1.max(pressure));
            }
            let state = sim.axes()[3];
            println!("case {case} at {command:+}: {state:?}, p1 {chatter:?}");
            assert!((state.position - rest).abs() < 4e-3 && state.velocity.abs() < 0.02, "case {case}: {state:?}");
            assert!(chatter.1 - chatter.0 < 1e6, "case {case}: {chatter:?}");
        }
    }
}
