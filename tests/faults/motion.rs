//! Rows 29 to 35: faults of the motion, and of references and requests.

use pipeline::{
    message::{AxisMode, ControlMode, control_flag},
    stage::StageKind,
};

use crate::{
    harness::{
        TestGroup,
        channel::{AXES, receive},
    },
    script::{RATE, Scripted, from_channel, is_latched},
};

fn borrowed(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

/// Row 29: an axis without supply latches, and does not move when the supply is back.
#[test]
fn row_29_without_supply_an_axis_latches_and_does_not_move_when_it_is_back() {
    let mut scripted = Scripted::start("row-29", 900, &["--arm"]);
    scripted.steps(300);
    scripted.speed = 0.0;
    let (mut driven, mut latched) = (0, false);
    for _ in 0..300 {
        // The position changes by a count, so that it is not found stuck.
        let tick = scripted.tick as i64;
        let command = scripted.step(|reading| reading.encoders[0].counts += tick % 2);
        let boom = &command.axes[0];
        if is_latched(boom, control_flag::LATCHED) {
            latched = true;
        } else if !latched {
            driven = if boom.command.abs() > 0.20 { driven + 1 } else { 0 };
            assert!(driven <= 50, "driven for half a second without motion");
        }
    }
    assert!(latched, "stopped without supply");
    scripted.speed = 0.5;
    let before = scripted.positions[0];
    scripted.steps(300);
    assert!((scripted.positions[0] - before).abs() < 0.020, "no lurch");
    scripted.end();
}

/// Row 30: an axis whose following error stays above the limit latches.
#[test]
fn row_30_an_axis_that_does_not_follow_is_stopped() {
    let mut arguments = from_channel();
    arguments.extend(["--arm".to_owned()]);
    for axis in ["boom", "arm", "telescope", "bucket"] {
        arguments.extend(["--set".to_owned(), format!("axis.{axis}.control.following_error=0.03")]);
    }
    let mut scripted = Scripted::start("row-30", 700, &borrowed(&arguments));
    // The axis moves far more slowly than its reference, but it is neither stuck nor stalled.
    scripted.speed = 0.06;
    let start = scripted.positions;
    let (mut beyond, mut latched) = (0, None);
    for tick in 0..700u64 {
        let target = |tick: u64| start[0] + 0.001 * tick.saturating_sub(100) as f64;
        let targets: Vec<f64> = (0..10).map(|ahead| target(tick + ahead)).collect();
        scripted.positions[1..].copy_from_slice(&[start[0]; 3]);
        scripted.refer(&targets);
        let error = (target(tick) - scripted.positions[0]).abs();
        let command = scripted.step(|_| ());
        // The limit is 30 mm plus 0.2 s of the speed of 0.1 m/s.
        let speed = if tick > 100 { 0.1 } else { 0.0 };
        beyond = if error > 0.03 + 0.2 * speed { beyond + 1 } else { 0 };
        if is_latched(&command.axes[0], control_flag::LATCHED) {
            assert_ne!(command.axes[0].flags & control_flag::FOLLOWING, 0, "{:#b}", command.axes[0].flags);
            latched = Some(tick);
            break;
        }
        assert!(beyond <= 21, "tick {tick}: 210 ms beyond the bound");
    }
    assert!(latched.is_some(), "{beyond}");
    eprintln!("row 30: latched {beyond} ticks after the bound was crossed");
    scripted.steps(700 - latched.unwrap() - 1);
    scripted.end();
}

/// Row 31: a set point outside of the soft limits is refused; a fast motion to one within them does not overrun.
#[test]
fn row_31_a_set_point_outside_the_soft_limits_is_refused_and_one_within_is_not_overrun() {
    let mut scripted = Scripted::start("row-31", 1500, &[]);
    // As fast as the reference moves.
    scripted.speed = 1.2;
    scripted.steps(10);
    scripted.ask(AxisMode::Off, 0.0, None);
    scripted.steps(10);
    scripted.ask(AxisMode::Hold, 0.0, None);
    let holding = scripted.steps(100).axes[0];
    assert_eq!(holding.operation, AxisMode::Hold as u32, "{:#b}", holding.flags);
    // Beyond the soft limit of the boom, 1.284 m.
    scripted.ask(AxisMode::Hold, 0.0, Some(1.3));
    let refused = scripted.steps(50).axes[0];
    assert!(refused.refused_requests >= 50 && refused.reference == holding.reference);
    assert_ne!(refused.flags & control_flag::REQUEST, 0);
    // Within the soft limits of all axes.
    scripted.ask(AxisMode::Hold, 0.0, Some(1.07));
    let mut furthest: f64 = 0.0;
    for _ in 0..(1500 - scripted.tick) {
        let flags = scripted.step(|_| ()).axes[3].flags;
        assert_eq!(flags & control_flag::LATCHED, 0, "tick {}: {flags:#b}", scripted.tick);
        furthest = furthest.max(scripted.positions[3]);
    }
    assert!((scripted.positions[3] - 1.07).abs() < 0.02, "{}", scripted.positions[3]);
    assert!(furthest <= 1.07 + 0.002, "{furthest}");
    scripted.end();
}

/// Row 32: a reference that is not finite, jumps, or is outside of the limits is refused, and the axis holds.
#[test]
fn row_32_an_invalid_reference_is_refused_and_the_axis_holds() {
    let arguments = [from_channel(), vec!["--arm".to_owned()]].concat();
    for (name, nonsense) in [("nan", f64::NAN), ("inf", f64::INFINITY), ("jump", 1.15), ("outside", 1.3)] {
        let mut scripted = Scripted::start(&format!("row-32-{name}"), 300, &borrowed(&arguments));
        scripted.positions = [0.65; AXES];
        for tick in 0..300 {
            let first = if (200..220).contains(&tick) { nonsense } else { 0.65 };
            scripted.refer(&[first; 10]);
            let command = scripted.step(|_| ());
            for axis in &command.axes[..AXES] {
                if (200..220).contains(&tick) {
                    assert_ne!(axis.flags & control_flag::REFERENCE, 0, "{name}, tick {tick}");
                }
                assert!(axis.reference.is_finite() && (axis.reference - 0.65).abs() < 1e-9, "{}", axis.reference);
                assert!(axis.command.abs() < 0.2, "{name}, tick {tick}: {}", axis.command);
            }
        }
        scripted.end();
    }
}

/// Row 33: when references stop, the axis brakes softly to standstill.
#[test]
fn row_33_references_that_stop_end_in_a_soft_stop() {
    let arguments = [from_channel(), vec!["--arm".to_owned()]].concat();
    let mut scripted = Scripted::start("row-33", 600, &borrowed(&arguments));
    scripted.positions = [0.4; AXES];
    let mut targets = Vec::new();
    for tick in 0..600u64 {
        let target = |tick: u64| 0.4 + 0.001 * tick.saturating_sub(100) as f64;
        if tick < 300 {
            let coming: Vec<f64> = (0..10).map(|ahead| target(tick + ahead)).collect();
            scripted.refer(&coming);
        }
        targets.push(scripted.step(|_| ()).axes[0].reference);
    }
    scripted.end();
    let speeds: Vec<f64> = targets.windows(2).map(|pair| (pair[1] - pair[0]) * RATE).collect();
    assert!((speeds[290] - 0.1).abs() < 1e-6, "{}", speeds[290]);
    let steepest = speeds[250..].windows(2).map(|pair| (pair[1] - pair[0]).abs() * RATE).fold(0.0, f64::max);
    eprintln!("row 33: the target slows down by {steepest:.2} m/s2 at the most");
    assert!(steepest < 2.0, "{steepest} m/s2: a stop from one tick to the next has 10");
    // The axis brakes 100 ms after the end of the preview.
    assert!(speeds[360..].iter().all(|speed| speed.abs() < 1e-6), "it stands");
}

/// Row 34: the emergency stop makes the axes neutral in the same tick, in every mode.
#[test]
fn row_34_the_emergency_stop_is_obeyed_in_the_same_tick_in_every_mode() {
    for mode in [AxisMode::Track, AxisMode::Hold, AxisMode::Manual, AxisMode::Commission] {
        let mut scripted = Scripted::start(&format!("row-34-{}", mode.name()), 500, &[]);
        scripted.steps(10);
        scripted.ask(AxisMode::Off, 0.0, None);
        scripted.steps(10);
        scripted.ask(mode, 0.3, None);
        let before = scripted.steps(200);
        assert_eq!(before.axes[0].operation, mode as u32, "{mode:?} {:#b}", before.axes[0].flags);
        assert_eq!(before.cut_off, 0);
        let pressed = scripted.step(|reading| reading.emergency_stop = 1);
        assert_eq!(pressed.cut_off, 1, "{mode:?}");
        assert!(pressed.axes[..AXES].iter().all(|axis| is_latched(axis, control_flag::EMERGENCY_STOP)), "{mode:?}");
        // While the stop is pressed, mode off is refused, and so is every other mode.
        for request in [AxisMode::Off, mode] {
            scripted.ask(request, 0.3, None);
            for _ in 0..30 {
                let held = scripted.step(|reading| reading.emergency_stop = 1);
                assert!(held.axes[..AXES].iter().all(|axis| is_latched(axis, control_flag::EMERGENCY_STOP)));
            }
        }
        // After its release the axes stay latched until mode off resets them.
        let released = scripted.steps(50);
        assert_eq!(released.cut_off, 1);
        assert!(released.axes[..AXES].iter().all(|axis| is_latched(axis, control_flag::EMERGENCY_STOP)));
        scripted.ask(AxisMode::Off, 0.0, None);
        let off = scripted.steps(50);
        assert_eq!((off.cut_off, off.axes[0].flags & control_flag::LATCHED), (0, 0));
        scripted.steps(500 - scripted.tick);
        scripted.end();
    }
}

/// Row 35: a change between manual and automatic mode changes the command by its rate limit at most.
#[test]
fn row_35_between_manual_and_automatic_mode_the_command_does_not_jump() {
    let mut scripted = Scripted::start("row-35", 1200, &[]);
    scripted.steps(10);
    scripted.ask(AxisMode::Off, 0.0, None);
    scripted.steps(10);
    // The built-in rate limit of 10 per second, over one tick.
    let limit = 10.0 / RATE + 1e-9;
    let (mut last, mut modes) = (0.0f64, [false; 6]);
    let turns = [AxisMode::Manual, AxisMode::Hold, AxisMode::Manual, AxisMode::Track];
    while scripted.tick < 1200 {
        let turn = scripted.tick as usize / 130 % turns.len();
        let sign = if (scripted.tick / 520).is_multiple_of(2) { 1.0 } else { -1.0 };
        scripted.ask(turns[turn], 0.35 * sign, None);
        let boom = scripted.step(|_| ()).axes[0];
        assert!((boom.command - last).abs() <= limit, "tick {}: {last} to {}", scripted.tick, boom.command);
        assert_eq!(boom.flags & control_flag::LATCHED, 0);
        modes[boom.mode as usize] = true;
        last = boom.command;
    }
    assert!(modes[ControlMode::Manual as usize] && modes[ControlMode::Fallback as usize], "{modes:?}");
    scripted.end();
}

/// Row 29: on the simulated machine, a pump that fails latches, and nothing moves when its pressure is back.
#[test]
fn row_29_a_failing_pump_latches_and_nothing_moves_when_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pump.toml");
    let scenario = "\n[scenarios.pump-fails]\nsummary = \"no pressure for a while\"\nchanges = [\n  \
                    { parameter = \"supply_pressure\", start = 5, end = 5.1, factor = 0.05 },\n  \
                    { parameter = \"supply_pressure\", start = 9, end = 9.1, factor = 20.0 },\n]\n";
    std::fs::write(&file, format!("{}{scenario}", pipeline::machine::FOUR_AXES)).unwrap();
    let file = file.to_str().unwrap();
    let mut group = TestGroup::new("row-29-pump");
    let channels = group.join();
    let mut commands = channels.reader().unwrap();
    let mut readings = channels.reader::<pipeline::message::EncoderReading>().unwrap();
    for kind in StageKind::ALL {
        group.start(kind, &[file, "--scenario", "pump-fails", "--lockstep", "--ticks", "1300", "--arm"]);
    }
    let (mut latched, mut at_return) = ([false; AXES], [0i64; AXES]);
    for tick in 0..1300 {
        let command: pipeline::message::ValveCommand = receive(&mut commands, tick, || ());
        readings.newest().unwrap();
        for (i, axis) in command.axes[..AXES].iter().enumerate() {
            latched[i] |= is_latched(axis, control_flag::LATCHED);
            assert!(!latched[i] || axis.command == 0.0, "tick {tick}");
        }
        if let Some(reading) = readings.last().filter(|_| tick == 899 || tick == 1290) {
            for (i, encoder) in reading.encoders[..AXES].iter().enumerate() {
                if tick == 899 {
                    at_return[i] = encoder.counts;
                } else {
                    assert!((encoder.counts - at_return[i]).abs() < 200, "axis {i} lurched");
                }
            }
        }
    }
    assert!(latched.iter().all(|latched| *latched), "{latched:?}");
    drop(channels);
    group.expect_end();
}
