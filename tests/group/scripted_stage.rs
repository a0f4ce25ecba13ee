//! The test plays each stage in turn. The other three are processes in lock-step.

use crate::harness::{
    TestGroup,
    channel::{AXES, receive, send},
};
use pipeline::{
    machine::Machine,
    message::{
        CoefficientSnapshot, ControlMode, EncoderReading, EncoderSample, Reference, ValveCommand, control_flag,
        model_fault, sample_fault,
    },
    stage::StageKind,
};

#[test]
fn a_disarmed_controller_never_moves_a_scripted_plant() {
    let mut group = TestGroup::new("plant-off");
    let channels = group.join();
    let readings = channels.publisher::<EncoderReading>().unwrap();
    let (mut commands, mut snapshots) = (channels.reader().unwrap(), channels.reader::<CoefficientSnapshot>().unwrap());
    group.start_all_but(StageKind::PlantSim, &["--lockstep", "--ticks", "300"]);
    for tick in 0..300 {
        let mut reading = EncoderReading::default();
        reading.encoders[..AXES].iter_mut().for_each(|encoder| encoder.counts = 6000 + (tick as i64 % 7));
        send(&readings, reading, tick);
        let command: ValveCommand = receive(&mut commands, tick, || readings.greet());
        for axis in &command.axes[..AXES] {
            assert_eq!((axis.command, axis.mode), (0.0, ControlMode::Neutral as u32), "tick {tick}");
            assert_ne!(axis.flags & control_flag::DISARMED, 0);
        }
        receive(&mut snapshots, tick, || readings.greet());
    }
    group.expect_end();
}

#[test]
fn a_scripted_plant_is_brought_to_its_reference() {
    let mut group = TestGroup::new("plant-on");
    let channels = group.join();
    let readings = channels.publisher::<EncoderReading>().unwrap();
    let (mut commands, mut snapshots) = (channels.reader().unwrap(), channels.reader::<CoefficientSnapshot>().unwrap());
    group.start_all_but(StageKind::PlantSim, &["--lockstep", "--ticks", "1500", "--arm"]);
    // An integrator with a dead band and 0.3 m/s at full command.
    let mut positions = [0.65, 0.75, 0.6, 0.55];
    let mut worst_error: f64 = 0.0;
    for tick in 0..1500 {
        let mut reading = EncoderReading::default();
        for (encoder, position) in reading.encoders.iter_mut().zip(positions) {
            encoder.counts = (position / 1e-4f64).round() as i64;
        }
        send(&readings, reading, tick);
        let command: ValveCommand = receive(&mut commands, tick, || readings.greet());
        if tick == 0 {
            assert!(command.axes.iter().all(|axis| axis.command == 0.0), "no motion at start");
        }
        for (axis, position) in command.axes.iter().zip(&mut positions) {
            assert!(axis.command.abs() <= 1.0);
            let beyond = axis.command.signum() * (axis.command.abs() - 0.1).max(0.0);
            *position += 0.01 * 0.3 * beyond / 0.9;
            if tick > 300 {
                worst_error = worst_error.max(axis.error.abs());
            }
        }
        receive(&mut snapshots, tick, || readings.greet());
    }
    assert!(worst_error > 0.0 && worst_error < 0.15, "{worst_error}");
    group.expect_end();
}

#[test]
fn references_from_another_program_are_followed_unless_they_are_invalid() {
    let mut group = TestGroup::new("reference");
    let channels = group.join();
    let (readings, references) = (channels.publisher::<EncoderReading>().unwrap(), channels.publisher().unwrap());
    let (mut commands, mut snapshots) = (channels.reader().unwrap(), channels.reader::<CoefficientSnapshot>().unwrap());
    let mut arguments = vec!["--lockstep", "--ticks", "400", "--arm"];
    for axis in ["boom", "arm", "telescope", "bucket"] {
        let setting = format!("axis.{axis}.reference.kind=channel");
        arguments.extend(["--set", Box::leak(setting.into_boxed_str())]);
    }
    group.start_all_but(StageKind::PlantSim, &arguments);
    let mut position = 0.6;
    // The reference holds for 1.5 s, then rises by 0.1 m/s. A message holds ten ticks of it.
    let target = |tick: u64| 0.6 + 0.001 * tick.saturating_sub(150) as f64;
    let mut machine = 0;
    for tick in 0..400 {
        let mut reference = Reference { preview: 10, ..Reference::default() };
        reference.header.machine = machine;
        for targets in &mut reference.positions {
            (0..10).for_each(|ahead| targets[ahead] = target(tick + ahead as u64));
        }
        if (300..310).contains(&tick) {
            reference.positions[0][0] = f64::NAN;
        }
        send(&references, reference, tick);
        let mut reading = EncoderReading::default();
        reading.encoders[..AXES].iter_mut().for_each(|encoder| encoder.counts = (position / 1e-4f64).round() as i64);
        send(&readings, reading, tick);
        let command: ValveCommand = receive(&mut commands, tick, || readings.greet());
        machine = command.header.machine;
        let axis = &command.axes[0];
        let beyond = axis.command.signum() * (axis.command.abs() - 0.1).max(0.0);
        position += 0.01 * 0.5 * beyond;
        receive(&mut snapshots, tick, || readings.greet());
        match tick {
            0..50 => assert!(tick > 20 || axis.command == 0.0, "no motion at start"),
            50..300 => assert_eq!((axis.reference, axis.flags & control_flag::REFERENCE), (target(tick), 0), "{tick}"),
            300..310 => {
                assert_ne!(axis.flags & control_flag::REFERENCE, 0, "{tick}");
                let way = axis.reference - target(299);
                assert!((0.0..0.02).contains(&way), "the reference comes to a stand: {way} m");
            }
            _ => assert!(axis.command.is_finite() && axis.reference.is_finite()),
        }
    }
    assert!((position - target(399)).abs() < 0.05, "{position}");
    group.expect_end();
}

#[test]
fn a_scripted_sensor_without_usable_samples_latches_the_axis() {
    let mut group = TestGroup::new("sensor");
    let channels = group.join();
    let samples = channels.publisher::<EncoderSample>().unwrap();
    let mut readings = channels.reader::<EncoderReading>().unwrap();
    let mut commands = channels.reader::<ValveCommand>().unwrap();
    group.start_all_but(StageKind::SensorProc, &["--lockstep", "--ticks", "600", "--arm"]);
    let (mut moved, mut neutral_after) = (false, None);
    for tick in 0..600 {
        let reading: EncoderReading = receive(&mut readings, tick, || samples.greet());
        let mut sample = EncoderSample::default();
        for (axis, encoder) in sample.axes.iter_mut().zip(&reading.encoders) {
            axis.position = encoder.counts as f64 * 1e-4;
        }
        if (400..500).contains(&tick) {
            sample.axes[1].faults = sample_fault::STALE;
        }
        send(&samples, sample, tick);
        let command: ValveCommand = receive(&mut commands, tick, || samples.greet());
        let arm = &command.axes[1];
        moved |= tick < 400 && arm.command != 0.0;
        if tick >= 400 && arm.command == 0.0 && arm.flags & control_flag::FEEDBACK != 0 {
            neutral_after.get_or_insert(tick - 400);
        } else if neutral_after.is_some() {
            panic!("tick {tick}: the axis was commanded {} after its fault", arm.command);
        }
        // The other axes have good samples and go on.
        assert_eq!(command.axes[0].flags & control_flag::FEEDBACK, 0);
    }
    assert!(moved, "the axis followed its reference before");
    assert!(neutral_after.is_some_and(|ticks| ticks <= 3), "{neutral_after:?}");
    group.expect_end();
}

#[test]
fn a_controller_never_uses_invalid_models_of_a_scripted_identifier() {
    let mut group = TestGroup::new("ident");
    let channels = group.join();
    let snapshots = channels.publisher::<CoefficientSnapshot>().unwrap();
    let mut samples = channels.reader::<EncoderSample>().unwrap();
    let mut commands = channels.reader::<ValveCommand>().unwrap();
    group.start_all_but(StageKind::IdentProc, &["--lockstep", "--ticks", "500", "--arm"]);
    for tick in 0..500 {
        receive(&mut samples, tick, || snapshots.greet());
        let mut snapshot = CoefficientSnapshot::default();
        for (i, axis) in snapshot.axes[..AXES].iter_mut().enumerate() {
            axis.adaptive.na = 3;
            axis.adaptive.nb = 1;
            axis.adaptive.nk = 3;
            axis.adaptive.order = 3;
            (axis.command_low, axis.command_high) = (-1.0, 1.0);
            match i {
                0 => axis.adaptive.a = [f64::NAN; 7],
                1 => axis.adaptive.a[0] = -2.5,
                2 => axis.faults = model_fault::TRAINING,
                _ => axis.adaptive.na = u32::MAX,
            }
        }
        send(&snapshots, snapshot, tick);
        let command: ValveCommand = receive(&mut commands, tick, || snapshots.greet());
        for (i, axis) in command.axes[..AXES].iter().enumerate() {
            assert_ne!(axis.mode, ControlMode::Model as u32, "tick {tick} axis {i}");
            if tick > 100 {
                let expected = if i == 2 { control_flag::NO_MODEL } else { control_flag::MODEL_REFUSED };
                assert_eq!(axis.mode, ControlMode::Fallback as u32, "the fallback goes on");
                assert_ne!(axis.flags & expected, 0, "tick {tick} axis {i}");
                assert!(i == 2 || axis.rejected_snapshots.iter().sum::<u64>() > 50);
            }
        }
    }
    group.expect_end();
}

#[test]
fn a_scripted_controller_is_learned_from() {
    let mut group = TestGroup::new("control");
    let channels = group.join();
    let commands = channels.publisher::<ValveCommand>().unwrap();
    let mut samples = channels.reader::<EncoderSample>().unwrap();
    let mut snapshots = channels.reader::<CoefficientSnapshot>().unwrap();
    let training = Machine::four_axes(&[]).unwrap().axes[0].identification.training as u64;
    let ticks = training + 200;
    group.start_all_but(StageKind::ControlProc, &["--lockstep", "--ticks", &ticks.to_string()]);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for tick in 0..ticks {
        let sample: EncoderSample = receive(&mut samples, tick, || commands.greet());
        low = low.min(sample.axes[0].position);
        high = high.max(sample.axes[0].position);
        let mut command = ValveCommand::default();
        let t = tick as f64 * 0.01;
        for axis in &mut command.axes[..AXES] {
            axis.command = 0.4 * (2.0 * t).sin() + 0.2 * (7.0 * t).sin();
        }
        send(&commands, command, tick);
        let snapshot: CoefficientSnapshot = receive(&mut snapshots, tick, || commands.greet());
        let boom = &snapshot.axes[0];
        assert_eq!(boom.faults & model_fault::TRAINING != 0, tick + 1 < training, "tick {tick}");
    }
    let snapshot = snapshots.last().unwrap();
    assert!(high - low > 0.05, "the plant answered: {low} to {high} m");
    for axis in &snapshot.axes[..AXES] {
        assert_eq!(axis.updates, 200);
        assert!(axis.adaptive.is_finite() && axis.adaptive.pole_radius() < 1.1);
        assert!(axis.adaptive_errors.one_step.sigma() < 1e-3, "{:?}", axis.adaptive_errors.one_step);
        assert!((axis.command_low + 0.6).abs() < 0.1 && (axis.command_high - 0.6).abs() < 0.1);
    }
    group.expect_end();
}
