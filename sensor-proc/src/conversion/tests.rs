use super::*;
use crate::Acquisition;
use mechanism::Pose;
use pipeline::message::{EncoderReading, EncoderSample, sample_fault};

/// Angle of a count of the sensors at joints, rad.
const COUNT: f64 = 1e-4;
/// Angle at count 0, rad.
const ZERO: f64 = -0.3;
/// All ways to measure boom, arm and bucket.
const KINDS: [&str; 3] = ["cylinder", "rotary-encoder", "inclinometer"];

/// The built-in machine with these sensors of boom, arm and bucket.
fn machine(kinds: [&str; 3]) -> Machine {
    let mut settings = Vec::new();
    for (axis, kind) in ["boom", "arm", "bucket"].iter().zip(kinds).filter(|(_, kind)| *kind != "cylinder") {
        let mut set = |key: &str, value: String| settings.push((format!("axis.{axis}.encoder.{key}"), value));
        set("kind", kind.to_owned());
        set("angle_resolution", COUNT.to_string());
        set("angle_zero", ZERO.to_string());
    }
    Machine::load(None, &settings).unwrap()
}

/// Values of the sensors with the pistons at these positions, m, without errors.
fn values(machine: &Machine, positions: &[f64; 4], pose: &Pose) -> [EncoderValue; MAX_AXES] {
    let mut values = [EncoderValue::default(); MAX_AXES];
    for (axis, encoder) in machine.axes.iter().map(|axis| axis.encoder).enumerate() {
        let exact = match encoder.angle {
            None => positions[axis] / encoder.resolution,
            Some(sensor) => {
                let angle = match sensor.kind {
                    AngleKind::RotaryEncoder => pose.joint(sensor.joint).angle(),
                    AngleKind::Inclinometer => pose.body(sensor.joint).angle(),
                };
                (angle - sensor.zero) / sensor.resolution
            }
        };
        values[axis].counts = exact.round() as i64;
    }
    values
}

/// Postures over the strokes, with their poses.
fn postures(machine: &Machine) -> Vec<([f64; 4], Pose)> {
    let prepared = machine.mechanism.unwrap().prepared();
    let of = |k: u32| {
        // Each axis goes over its stroke in parts of its own, so that their combinations differ.
        let part = |i: usize| f64::from(k * [1, 7, 11, 17][i] % 41) / 40.0;
        let positions: [f64; 4] = std::array::from_fn(|i| part(i) * machine.axes[i].stroke);
        (positions, prepared.pose(&positions))
    };
    (0..41).map(of).collect()
}

#[test]
fn positions_come_back_within_half_a_count_with_every_combination_of_sensors() {
    for kinds in (0..27).map(|k| [KINDS[k % 3], KINDS[k / 3 % 3], KINDS[k / 9]]) {
        let machine = machine(kinds);
        let conversion = Conversion::new(&machine);
        for (positions, pose) in postures(&machine) {
            let found = conversion.positions(&values(&machine, &positions, &pose));
            for (axis, position) in positions.iter().enumerate() {
                // Half a count of every sensor involved, and the curvature of the linkage over it.
                let allowed = 0.505 * machine.count_length(axis, *position);
                assert!((found[axis] - position).abs() <= allowed, "{kinds:?}, axis {axis} at {position} m");
                assert!(allowed <= 0.5051 * machine.axes[axis].encoder.resolution);
            }
        }
    }
}

#[test]
fn an_error_of_the_angle_shifts_the_position_by_the_moment_arm() {
    // 1 dq = J dl, and d2l/dq2 = -J'/J^3 for the next term.
    for (kind, joint) in KINDS[1..].iter().flat_map(|kind| Joint::ALL.map(|joint| (kind, joint))) {
        let mut kinds = ["cylinder"; 3];
        kinds[joint as usize] = kind;
        let machine = machine(kinds);
        let (conversion, axis) = (Conversion::new(&machine), joint.axis());
        for (positions, pose) in postures(&machine) {
            let mut values = values(&machine, &positions, &pose);
            let before = conversion.positions(&values)[axis];
            values[axis].counts += 20;
            let (dq, rate) = (20.0 * COUNT, pose.rate[axis]);
            let expected = dq / rate - 0.5 * pose.curvature[axis] * dq * dq / rate.powi(3);
            let shift = conversion.positions(&values)[axis] - before;
            assert!((shift - expected).abs() < 2e-3 * expected.abs(), "{kind} {joint:?}: {shift} {expected}");
        }
    }
}

#[test]
fn a_position_is_computed_from_the_sensors_up_to_the_next_inclinometer() {
    let needs = |kinds| {
        let conversion = Conversion::new(&machine(kinds));
        [0, 1, 2, 3].map(|axis| conversion.needs(axis))
    };
    assert_eq!(needs(["cylinder"; 3]), [0; 4]);
    assert_eq!(needs(["rotary-encoder"; 3]), [0; 4]);
    assert_eq!(needs(["inclinometer"; 3]), [0, 0b1, 0, 0b10]);
    assert_eq!(needs(["cylinder", "rotary-encoder", "inclinometer"]), [0, 0, 0, 0b11]);
}

#[test]
fn a_broken_sensor_takes_the_positions_with_it_that_are_computed_from_it() {
    let machine = machine(["inclinometer", "inclinometer", "rotary-encoder"]);
    let (positions, pose) = postures(&machine)[20];
    let mut reading = EncoderReading { encoders: values(&machine, &positions, &pose), ..EncoderReading::default() };
    reading.header.axis_count = 4;
    let mut acquisition = Acquisition::new(&machine);
    let good = acquisition.update(0, Some(&reading));
    assert!(good.axes[..4].iter().all(|axis| axis.faults == 0));
    reading.encoders[0].error = 1;
    let broken = acquisition.update(1, Some(&reading));
    let faults = |sample: &EncoderSample| -> Vec<u32> { sample.axes[..4].iter().map(|axis| axis.faults).collect() };
    assert_eq!(faults(&broken), [sample_fault::ENCODER, sample_fault::ENCODER, 0, 0]);
    assert_eq!(broken.axes[1].position, good.axes[1].position);
    // A sensor that was not read this time has no error, and neither have those behind it.
    reading.encoders[0].error = EncoderValue::NOT_READ;
    let missing = acquisition.update(2, Some(&reading));
    assert_eq!(faults(&missing), [sample_fault::STALE, sample_fault::STALE, 0, 0]);
    // One that is not read behind one that is broken is broken.
    (reading.encoders[0].error, reading.encoders[1].error) = (1, EncoderValue::NOT_READ);
    let both = acquisition.update(3, Some(&reading));
    assert_eq!(faults(&both), [sample_fault::ENCODER, sample_fault::ENCODER, 0, 0]);
}

#[test]
fn an_inclinometer_that_does_not_change_is_marked_although_its_axis_seems_to_move() {
    let machine = machine(["cylinder", "inclinometer", "cylinder"]);
    let (positions, pose) = postures(&machine)[20];
    let mut reading = EncoderReading { encoders: values(&machine, &positions, &pose), ..EncoderReading::default() };
    reading.header.axis_count = 4;
    let mut acquisition = Acquisition::new(&machine);
    let mut last = f64::NAN;
    for tick in 0..40 {
        reading.encoders[0].counts += 10;
        let arm = acquisition.update(tick, Some(&reading)).axes[1];
        assert_ne!(arm.position, last);
        last = arm.position;
        assert_eq!(arm.faults, if tick >= 30 { sample_fault::STUCK } else { 0 }, "tick {tick}");
    }
}

#[test]
fn an_angle_at_which_the_linkage_does_not_close_is_out_of_range() {
    let machine = machine(["cylinder", "cylinder", "rotary-encoder"]);
    let mut reading = EncoderReading::default();
    reading.header.axis_count = 4;
    // The bucket turned to the back of the arm.
    reading.encoders[3].counts = (3.0 / COUNT) as i64;
    let sample = Acquisition::new(&machine).update(0, Some(&reading));
    assert_eq!(sample.axes[3].faults, sample_fault::RANGE);
}
