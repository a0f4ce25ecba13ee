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
