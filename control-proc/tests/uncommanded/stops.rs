//! What an axis at full speed still travels once it is to stop, by the cause of the stop.

use control_proc::Controller;
use pipeline::{
    channel::Stop,
    machine::Machine,
    message::{AxisMode, EncoderSample, control_flag, sample_fault},
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

use super::{AXES, BEGIN, PERIOD, excavator, request};

/// Ticks for which an axis is driven before the first stop of all that are tried.
const DRIVEN: u64 = 80;
/// Ticks by which stops come later.
const TRIED: [u64; 3] = [0, 7, 14];
/// Time in which an axis comes to rest, ticks.
const REST: u64 = 150;
/// Ticks within which two unusable samples in three are to latch.
const LEAKY: u64 = 20;

/// Why the axes are to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cause {
    /// A person disarms them.
    Disarmed,
    /// One sample shows the emergency stop.
    Pulse,
    /// A sample is from the future.
    Future,
    /// Two samples in three are unusable.
    TwoInThree,
}

/// Drives all axes by hand with `command` for so many ticks, then stops them. Returns for each the speed when the cause
/// begins, m/s, its travel from then on until it rests, m, and the number of ticks that were not neutral.
fn stopped(machine: &Machine, command: f64, driven: u64, cause: Cause) -> [(f64, f64, u64); AXES] {
    let mut plant = PlantSim::new(machine, 1).unwrap();
    let (mut acquisition, mut controller) = (Acquisition::new(machine), Controller::new(machine).unwrap());
    let begin = BEGIN + driven;
    let mut seen = [(0.0, 0.0, 0); AXES];
    let mut before = [0.0; AXES];
    for tick in 0..begin + REST {
        let mut sample = acquisition.update(tick, Some(&plant.read()));
        controller.ask(&request(tick, 0, AxisMode::Manual, command));
        if tick >= begin {
            disturb(cause, tick - begin, &mut sample, &mut controller);
        }
        let command = controller.update(&sample, None, None);
        for (axis, seen) in seen.iter_mut().enumerate() {
            let position = plant.axes()[axis].position;
            if tick == begin - 1 {
                before[axis] = position;
            } else if tick == begin {
                *seen = ((position - before[axis]) / PERIOD, 0.0, 0);
                before[axis] = position;
            }
            if tick >= begin {
                seen.1 = f64::max(seen.1, (position - before[axis]).abs());
                seen.2 += u64::from(command.axes[axis].command != 0.0);
            }
        }
        plant.command(&command);
        plant.advance(machine.timing.period);
    }
    assert!(controller.message().axes[..AXES].iter().all(|axis| axis.command == 0.0), "{cause:?}");
    seen
}

fn disturb(cause: Cause, since: u64, sample: &mut EncoderSample, controller: &mut Controller) {
    match cause {
        Cause::Disarmed if since == 0 => controller.stop(Stop::ALL),
        Cause::Pulse if since == 0 => sample.emergency_stop = 1,
        // What the stage does with such a sample.
        Cause::Future if since == 0 => controller.latch(control_flag::CLOCK),
        Cause::TwoInThree if since % 3 < 2 => {
            sample.axes.iter_mut().for_each(|axis| axis.faults = sample_fault::ENCODER);
        }
        _ => {}
    }
}

#[test]
fn every_stop_is_neutral_at_once_and_the_axes_travel_no_further_than_their_valves_need_to_shut() {
    let machine = excavator(true);
    // The travel of axis and direction when a person disarms them.
    let mut disarmed = Vec::new();
    for cause in [Cause::Disarmed, Cause::Pulse, Cause::Future, Cause::TwoInThree] {
        let (mut longest, mut fastest, mut ticks) = (0.0_f64, 0.0_f64, 0);
        let tries = TRIED.into_iter().flat_map(|later| [(DRIVEN + later, 1.0), (DRIVEN + later, -1.0)]);
        let seen = tries.flat_map(|(driven, command)| stopped(&machine, command, driven, cause));
        for (i, (speed, travel, not_neutral)) in seen.enumerate() {
            longest = longest.max(travel);
            fastest = fastest.max(speed.abs());
            ticks = ticks.max(not_neutral);
            match cause {
                Cause::Disarmed => disarmed.push((speed, travel)),
                _ => {
                    let (speed, way) = disarmed[i];
                    let further = speed.abs() * not_neutral as f64 * PERIOD;
                    assert!(travel <= 1.1 * (way + further) + 1e-3, "{cause:?}: {travel} m, not {way}");
                }
            }
        }
        assert!(fastest > 0.1, "the axes are fast before they stop: {fastest} m/s");
        assert!(if cause == Cause::TwoInThree { ticks <= LEAKY } else { ticks == 0 }, "{cause:?}: {ticks}");
        println!("{cause:?}: up to {ticks} ticks not neutral, {:.1} mm at {fastest:.2} m/s", 1e3 * longest);
    }
}
