//! What the sensors read, against the true states.

use super::*;

#[test]
fn chamber_pressures_are_read_within_half_a_step_and_draw_nothing_from_the_encoders() {
    const RESOLUTION: f64 = 2e4;
    let without = excavator();
    let mut with = excavator();
    for axis in [0, 3] {
        with.axes[axis].pressure = Some(PressureTransducers { resolution: RESOLUTION, range: 60e6 });
    }
    let (mut plant, mut bare) = (PlantSim::new(&with, 3).unwrap(), PlantSim::new(&without, 3).unwrap());
    let mut command = ValveCommand::default();
    command.axes.iter_mut().take(AXES).for_each(|axis| axis.command = 0.5);
    for _ in 0..100 {
        let (reading, other) = (plant.read(), bare.read());
        for (axis, state) in plant.axes().iter().enumerate() {
            let value = &reading.encoders[axis];
            assert_eq!(value.counts, other.encoders[axis].counts);
            assert_eq!(value.has_pressures, u32::from([0, 3].contains(&axis)));
            if value.has_pressures == 1 {
                assert!((value.piston_pressure - state.piston_pressure).abs() <= 0.5001 * RESOLUTION);
                assert!((value.rod_pressure - state.rod_pressure).abs() <= 0.5001 * RESOLUTION);
            } else {
                assert_eq!((value.piston_pressure, value.rod_pressure), (0.0, 0.0));
            }
        }
        for simulated in [&mut plant, &mut bare] {
            simulated.command(&command);
            simulated.advance(Duration::from_millis(10));
        }
    }
}

/// Sensors at the joints of boom, arm and bucket, with counts of 0.1 mrad.
fn at_joints(kind: AngleKind, bandwidth: Option<f64>) -> Machine {
    let mut machine = excavator();
    for joint in Joint::ALL {
        let axis = &mut machine.axes[joint.axis()];
        axis.encoder.angle = Some(AngleSensor { joint, kind, resolution: 1e-4, zero: 0.2 });
        let plant = axis.plant.as_mut().unwrap();
        plant.sensor_errors = SensorErrors { encoder_noise: 0.0, angle_error: 3e-3, bandwidth, pressure_noise: 0.0 };
    }
    machine
}

#[test]
fn sensors_at_joints_read_the_angles_of_the_pose() {
    for kind in [AngleKind::RotaryEncoder, AngleKind::Inclinometer] {
        let mut sim = simulate(&at_joints(kind, None));
        for k in 0..60u32 {
            let (reading, pose) = (sim.read(), mechanism().prepared().pose(&positions(&sim)));
            for joint in Joint::ALL {
                let angle = match kind {
                    AngleKind::RotaryEncoder => pose.joints()[joint.axis()],
                    AngleKind::Inclinometer => pose.body(joint).angle(),
                };
                let counts = reading.encoders[joint.axis()].counts;
                let error = Rotation::by(0.2 - 3e-3 + counts as f64 * 1e-4 - angle).angle();
                assert!(error.abs() <= 0.5001e-4, "{kind:?} {joint:?}: {error}");
            }
            sim.command(&commands(mixed(f64::from(k) * 0.1)));
            // Times between two steps of the integration are among them.
            sim.advance(Duration::from_micros(100_000 + u64::from(k % 3) * 37));
        }
    }
}

#[test]
fn a_lag_does_not_depend_on_how_time_is_divided() {
    let machine = at_joints(AngleKind::Inclinometer, Some(4.0));
    let (mut whole, mut parts) = (simulate(&machine), simulate(&machine));
    let mut late = 0.0f64;
    for k in 0..200u32 {
        let command = commands(mixed(f64::from(k) * 0.01));
        whole.command(&command);
        parts.command(&command);
        whole.advance(Duration::from_millis(10));
        for _ in 0..10 {
            parts.advance(Duration::from_millis(1));
        }
        let (one, other) = (whole.read(), parts.read());
        assert_eq!(one.encoders, other.encoders);
        let boom = mechanism().prepared().pose(&positions(&whole)).body(Joint::Boom).angle();
        late = late.max((one.encoders[0].counts as f64 * 1e-4 + 0.2 - 3e-3 - boom).abs());
    }
    // The boom turns by up to a few tenths of a radian a second, and the lag is 40 ms.
    assert!(late > 1e-3, "{late}");
}

#[test]
fn a_sensor_at_a_joint_of_a_machine_without_a_mechanism_is_refused() {
    let machine = Machine { mechanism: None, ..at_joints(AngleKind::RotaryEncoder, None) };
    let said = PlantSim::new(&machine, 1).unwrap_err().to_string();
    assert!(said.starts_with("axis.boom.encoder.kind: found a sensor at a joint"), "{said}");
}
