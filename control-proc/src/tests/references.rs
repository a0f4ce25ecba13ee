//! References: generated, read from a file, and received from another program.

use std::fs;

use pipeline::{
    machine::{Axis, Machine},
    message::{AxisCommand, ControlMode, MAX_PREVIEW, Reference, control_flag},
};

use super::{Loop, SINES, machine, machine_with};
use crate::{
    Controller,
    reference::{References, generator::ReferenceGenerator},
    trajectory_file::read_references,
};

/// A message of `preview` equal references from tick `sequence` on.
fn constant(sequence: u64, target: f64, preview: u32) -> Reference {
    let mut reference = Reference { preview, ..Reference::default() };
    (reference.header.sequence, reference.header.axis_count) = (sequence, 1);
    reference.positions[0][..(preview as usize).min(MAX_PREVIEW)].fill(target);
    reference
}

/// A loop at tick 150 that has settled at 0.6 m and follows the channel.
fn following() -> Loop {
    let mut axis = Loop::new(&machine_with(SINES, "kind = \"channel\"\n"), 0.0);
    for k in 0..150 {
        let command = axis.tick_with(None, Some(&constant(k, 0.6, 5)), |_| ()).axes[0];
        assert_eq!(command.flags & control_flag::REFERENCE, 0, "tick {k}");
    }
    axis
}

/// Whether a command follows the channel, on the way from one reference (m) to another.
fn is_on_the_way(command: &AxisCommand, from: f64, to: f64) -> bool {
    command.flags & control_flag::REFERENCE == 0 && command.reference > from && command.reference < to
}

/// Whether the axis holds 0.6 m and shows the flag over ticks with `reference`.
fn holds(axis: &mut Loop, reference: Option<&Reference>) -> bool {
    let command = axis.tick_with(None, reference, |_| ()).axes[0];
    command.flags & control_flag::REFERENCE != 0
        && command.reference == 0.6
        && command.mode == ControlMode::Fallback as u32
}

#[test]
fn sines_and_ramps_have_the_configured_positions() {
    let generator = read_references(&machine(1)).unwrap();
    let expected = 0.65 + 0.12 * (std::f64::consts::TAU * 0.3 * 1.7 + 0.4).sin();
    assert!((generator.position(0, 1.7).unwrap() - expected).abs() < 1e-15);
    assert_eq!(generator.position(1, 0.0), None);

    let ramps = "kind = \"ramps\"\ntimes = [0.0, 1.0, 3.0]\npositions = [0.4, 0.6, 0.4]\n";
    let generator = read_references(&machine_with(SINES, ramps)).unwrap();
    for (t, position) in [(0.0, 0.4), (0.5, 0.5), (2.0, 0.5), (3.0, 0.4), (3.5, 0.5), (302.0, 0.5)] {
        assert!((generator.position(0, t).unwrap() - position).abs() < 1e-9, "{t}");
    }
}

fn trajectory(text: &str) -> Result<ReferenceGenerator, String> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("path.csv"), text).unwrap();
    let machine_text = super::machine_text(1).replace(SINES, "kind = \"trajectory\"\nfile = \"path.csv\"\n");
    let machine = Machine::parse(&machine_text, "test.toml", folder.path(), &[]).unwrap();
    read_references(&machine).map_err(|error| error.to_string())
}

#[test]
fn a_trajectory_is_followed_and_its_last_row_held() {
    let generator = trajectory("t, other, a0\n0.5, x, 0.5\n1.0, , 0.7\n2.0,,0.6\n").unwrap();
    for (t, position) in [(0.0, 0.5), (0.5, 0.5), (0.75, 0.6), (1.5, 0.65), (2.0, 0.6), (1e9, 0.6)] {
        assert!((generator.position(0, t).unwrap() - position).abs() < 1e-12, "{t}");
    }
}

#[test]
fn every_bad_row_is_refused_by_row_and_column() {
    for (text, expected) in [
        ("t,a0\n0,0.5\n1,abc\n", ":3: row 2, column \"a0\": found \"abc\"; allowed: a finite number"),
        ("t,a0\n0,0.5\n1,\n", ":3: row 2, column \"a0\": found an empty field"),
        ("t,a0\n0,NaN\n1,0.5\n", ":2: row 1, column \"a0\": found \"NaN\""),
        ("t,a0\n0,0.5\ninf,0.5\n", ":3: row 2, column \"t\": found \"inf\""),
        ("t,a0\n0,0.5\n0,0.5\n", ":3: row 2, column \"t\": found 0 after 0; allowed: a time later"),
        ("t,a0\n0,0.5\n1,1.3\n", ":3: row 2, column \"a0\": found 1.3; allowed: positions in the soft limits, 0.05 to"),
        ("t,a0\n0,0.5\n0.1,0.7\n", ":3: row 2, column \"a0\": found 0.7, a speed of 2.000 m/s; allowed: speeds up to"),
        ("t,a0\n0,0.5\n1\n", ":3: row 2, column \"a0\": found an empty field"),
        ("t,b\n0,0.5\n", ":1: found no column \"a0\"; the columns are: t, b"),
        ("a0\n0.5\n", "a header with \"t\""),
        ("t,a0\n", "found no row"),
    ] {
        let error = trajectory(text).unwrap_err();
        assert!(error.starts_with("axis.a0.reference.file: ") && error.contains("path.csv:"), "{error}");
        assert!(error.contains(expected), "{text:?}\n{error}");
    }
    let both = trajectory("t,a0\nx,0.5\n1,y\n").unwrap_err();
    assert!(both.contains("row 1, column \"t\"") && both.contains("row 2, column \"a0\""), "{both}");
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let machine = machine_with(SINES, "kind = \"trajectory\"\nfile = \"nowhere.csv\"\n");
    let error = Controller::new(&machine).unwrap_err().to_string();
    assert!(error.contains("nowhere.csv: found a file that cannot be read"), "{error}");
}

#[test]
fn hold_stays_where_the_axis_was() {
    let mut axis = Loop::new(&machine_with(SINES, "kind = \"hold\"\n"), 0.0);
    for command in axis.run(300, None) {
        assert_eq!((command.axes[0].command, command.axes[0].reference), (0.0, 0.6));
    }
}

#[test]
fn the_channel_is_followed_over_its_preview() {
    let mut axis = following();
    let mut reference = constant(150, 0.6, 4);
    reference.positions[0][..4].copy_from_slice(&[0.601, 0.602, 0.603, 0.604]);
    for expected in [0.601, 0.602, 0.603, 0.604] {
        let command = axis.tick_with(None, Some(&reference), |_| ()).axes[0];
        assert_eq!((command.reference, command.flags & control_flag::REFERENCE), (expected, 0));
    }
    // The preview is used up: the reference goes on, and comes to a stand.
    let command = axis.tick_with(None, Some(&reference), |_| ()).axes[0];
    assert!(command.reference > 0.604 && command.reference <= 0.605, "{}", command.reference);
    assert_ne!(command.flags & control_flag::REFERENCE, 0);
    // A message for a later tick within its preview starts at its first reference.
    let command = axis.tick_with(None, Some(&constant(157, 0.605, 4)), |_| ()).axes[0];
    assert!(is_on_the_way(&command, 0.604, 0.606), "{}", command.reference);
}

/// Behind the end of a preview a reference seems to stop at once.
#[test]
fn what_comes_is_known_of_a_generator_and_of_an_axis_that_holds_but_not_of_a_channel() {
    let references = |machine: &Machine| References::new(0, &machine.axes[0], 0.01, 3, 8);
    assert_eq!(references(&machine_with(SINES, SINES)).coming().map(<[f64]>::len), Some(9));
    let mut channel = references(&machine_with(SINES, "kind = \"channel\"\n"));
    assert_eq!(channel.coming(), None);
    channel.hold(Some((0.6, 0.0)));
    assert_eq!((channel.coming().map(<[f64]>::len), channel.positions().len()), (Some(9), 4));
}

#[test]
fn when_the_channel_stops_the_reference_comes_to_a_stand_and_goes_on_from_there() {
    // At 0.2 m/s, less than a quarter of max_speed, with previews of one and of many ticks.
    for (preview, silent) in [(1, true), (20, true), (20, false)] {
        let mut axis = following();
        let target = |k: u64| 0.6 + 0.002 * (k - 150) as f64;
        let ramp = |k: u64| {
            let mut reference = constant(k, 0.0, preview);
            (0..preview as u64).for_each(|i| reference.positions[0][i as usize] = target(k + i));
            reference
        };
        let mut seen = vec![0.6 - 0.004, 0.6 - 0.002];
        for k in 150..200 {
            seen.push(axis.tick_with(None, Some(&ramp(k)), |_| ()).axes[0].reference);
        }
        // No messages, or refused ones: the rest of the preview is followed first.
        let last = if silent { ramp(199) } else { constant(200, f64::NAN, preview) };
        let left = if silent { preview as usize - 1 } else { 0 };
        for k in 0..200 {
            let command = axis.tick_with(None, Some(&last), |_| ()).axes[0];
            assert_eq!(command.flags & control_flag::REFERENCE != 0, k >= left, "{k}");
            assert_eq!(command.flags & control_flag::LATCHED, 0);
            seen.push(command.reference);
        }
        let rate = |y: &[f64]| y.windows(2).map(|pair| (pair[1] - pair[0]) / 0.01).collect::<Vec<_>>();
        let most = |y: &[f64]| y.iter().fold(0.0f64, |most, value| most.max(value.abs()));
        // The bounds of the profile: 1 m/s2 and 10 m/s3.
        let (a, j) = (most(&rate(&rate(&seen))), most(&rate(&rate(&rate(&seen)))));
        assert!(a <= 1.001 && j <= 10.01, "{a} m/s2, {j} m/s3");
        let stand = seen[seen.len() - 1];
        assert!(seen[seen.len() - 100..].iter().all(|target| *target == stand), "it holds");
        // Braking from 0.2 m/s at 0.8 m/s2 takes 25 mm; half of the mean's 0.2 s is added.
        let way = stand - target(199 + left as u64);
        assert!((0.02..0.06).contains(&way), "{way} m");
        // A reference elsewhere is refused, one at the stand is accepted.
        let next = axis.sequence;
        let command = axis.tick_with(None, Some(&constant(next, stand - 0.05, 5)), |_| ()).axes[0];
        assert_eq!((command.reference, command.flags & control_flag::REFERENCE != 0), (stand, true));
        let command = axis.tick_with(None, Some(&constant(next + 1, stand + 0.001, 5)), |_| ()).axes[0];
        assert!(is_on_the_way(&command, stand, stand + 0.001), "{}", command.reference);
    }
}

#[test]
fn bad_references_are_refused_and_the_axis_holds() {
    let spoilt = |target: f64, index: usize| {
        let mut reference = constant(150, 0.6, 5);
        reference.positions[0][index] = target;
        reference
    };
    let no_axis = Reference { header: Default::default(), ..constant(150, 0.6, 5) };
    let references = [
        None,
        Some(spoilt(f64::NAN, 0)),
        Some(spoilt(f64::INFINITY, 4)),
        Some(spoilt(0.617, 0)),
        Some(spoilt(0.617, 3)),
        Some(constant(150, 0.617, 5)),
        Some(constant(150, 0.04, 5)),
        Some(constant(150, 1.3, 5)),
        Some(constant(148, 0.6, 5)),
        Some(constant(150, 0.6, 0)),
        Some(constant(150, 0.6, 33)),
        Some(constant(150, 0.6, u32::MAX)),
        Some(constant(149, 0.6, 1)),
        Some(constant(155, 0.6, 5)),
        Some(constant(u64::MAX, 0.6, 5)),
        Some(no_axis),
    ];
    for reference in references {
        let mut axis = following();
        assert!(holds(&mut axis, reference.as_ref()), "{reference:?}");
        // A sound message is followed again.
        let command = axis.tick_with(None, Some(&constant(151, 0.601, 5)), |_| ()).axes[0];
        assert!(is_on_the_way(&command, 0.6, 0.601), "{}", command.reference);
    }
}

#[test]
fn a_first_reference_far_away_does_not_move_the_axis() {
    let mut axis = Loop::new(&machine_with(SINES, "kind = \"channel\"\n"), 0.0);
    for k in 0..100 {
        let command = axis.tick_with(None, Some(&constant(k, 0.62, 5)), |_| ()).axes[0];
        assert_eq!(command.command, 0.0);
        assert!(k < 20 || command.flags & control_flag::REFERENCE != 0);
        assert_eq!(command.tracking.count, 0);
    }
    // A reference within 10 mm is taken up, without a step.
    let mut last = 0.6;
    for k in 100..400 {
        let command = axis.tick_with(None, Some(&constant(k, 0.609, 5)), |_| ()).axes[0];
        assert_eq!(command.flags & control_flag::REFERENCE, 0);
        assert_eq!(command.flags & control_flag::SLOWED != 0, command.reference != 0.609);
        assert!((0.0..1e-3).contains(&(command.reference - last)), "{k}: {}", command.reference);
        assert!(k < 390 || command.reference == 0.609, "{}", command.reference);
        last = command.reference;
    }
}

#[test]
fn a_moving_reference_is_taken_up_from_a_stand_and_made_good_slowly() {
    // A program that has always been on its way, with previews of one and of many references, at most speeds.
    for (speed, preview) in [(0.1, 1), (0.1, 20), (0.25, 1), (-0.25, 20), (0.25, 32)] {
        let mut axis = Loop::new(&machine_with(SINES, "kind = \"channel\"\n"), 0.0);
        let program = |k: u64| {
            let t = k as f64 * 0.01;
            let ramp = 0.6 + speed * (t - 1.0);
            if t < 3.0 { ramp } else { 0.6 + speed * 2.0 }
        };
        let (mut seen, mut moved) = (Vec::new(), Vec::new());
        for k in 0..700 {
            let mut reference = constant(k, 0.0, preview);
            (0..preview as u64).for_each(|i| reference.positions[0][i as usize] = program(k + i));
            let command = axis.tick_with(None, Some(&reference), |_| ()).axes[0];
            assert_eq!(command.flags & control_flag::LATCHED, 0);
            let is_due = program(k) > 0.5901 && speed > 0.0 || program(k) < 0.6099 && speed < 0.0;
            assert!(k < 25 || is_due == (command.flags & control_flag::REFERENCE == 0), "{k}");
            seen.push(command.reference);
            moved.push(axis.plant.position);
        }
        let rates: Vec<f64> = seen.windows(2).map(|pair| (pair[1] - pair[0]) / 0.01).collect();
        let begin = rates.iter().position(|rate| *rate != 0.0).unwrap();
        assert!((80..101).contains(&begin) && rates[begin].abs() < 0.01, "{speed}: {} m/s", rates[begin]);
        let fastest = rates.iter().fold(0.0f64, |most, rate| most.max(rate.abs()));
        assert!(fastest <= speed.abs() + 0.1 + 1e-9, "{speed}, {preview}: {fastest} m/s");
        let leap = moved.windows(20).fold(0.0f64, |most, part| most.max((part[19] - part[0]).abs() / 0.19));
        assert!(leap <= speed.abs() + 0.15, "{speed}, {preview}: {leap} m/s");
        assert!(seen[699] == program(699), "{speed}, {preview}: {} m", seen[699]);
    }
}

#[test]
fn a_lost_message_costs_little() {
    for preview in [1, 5] {
        let mut axis = following();
        let program = |k: u64| 0.6 + 0.1 * (1.0 - (0.02 * (k - 150) as f64).cos());
        let mut seen = Vec::new();
        for k in 150..800 {
            let mut reference = constant(k, 0.0, preview);
            (0..preview as u64).for_each(|i| reference.positions[0][i as usize] = program(k + i));
            // Every half second the preview is used up by one tick.
            let is_lost = k % 50 == 0 && k > 150;
            let reference = if is_lost { constant(k, f64::NAN, preview) } else { reference };
            let command = axis.tick_with(None, Some(&reference), |_| ()).axes[0];
            assert_eq!(command.flags & control_flag::REFERENCE != 0, is_lost, "{k}");
            seen.push((command.reference, program(k)));
        }
        let behind = seen[150..].iter().fold(0.0f64, |most, (y, wanted)| most.max((y - wanted).abs()));
        assert!(behind < 8e-3, "{preview}: {behind} m");
        let fastest = seen.windows(2).fold(0.0f64, |most, pair| most.max((pair[1].0 - pair[0].0).abs() / 0.01));
        assert!(fastest < 0.2 + 0.1, "{preview}: {fastest} m/s");
    }
}

#[test]
fn an_axis_without_an_entry_in_the_message_has_no_reference() {
    fn axis_with_channel(axis: &mut Axis) {
        axis.reference = pipeline::machine::ReferenceSource::Channel;
    }
    let mut machine = machine(2);
    machine.axes.iter_mut().for_each(axis_with_channel);
    let mut controller = Controller::new(&machine).unwrap();
    controller.arm();
    for k in 0..30 {
        let command = controller.update(&super::sample(k, &[0.6, 0.6]), None, Some(&constant(k, 0.6, 5)));
        if k > 20 {
            assert_eq!(command.axes[0].flags & control_flag::REFERENCE, 0);
            assert_ne!(command.axes[1].flags & control_flag::REFERENCE, 0);
        }
    }
}
