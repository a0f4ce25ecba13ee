//! Units of the numbers of a channel, by their names.
//!
//! The numbers of a model are in the unit of the identified output per power of it, which a message does not say. They
//! have no unit here, and neither have ratios, counts and bits.

use pipeline::message::{EncoderReading, Message, Reference, Request, StageHealth};

/// Ends of names, with their units. The first one that matches counts.
const ENDINGS: [(&str, &str); 20] = [
    ("_ns", "ns"),
    (".piston_pressure", "Pa"),
    (".rod_pressure", "Pa"),
    (".position", "m"),
    (".velocity", "m/s"),
    (".reference", "m"),
    (".feedback", "m"),
    (".error", "m"),
    (".tracking.mean", "m"),
    (".tracking.max", "m"),
    (".tracking.m2", "m^2"),
    (".model_tracking.mean", "m"),
    (".model_tracking.max", "m"),
    (".model_tracking.m2", "m^2"),
    ("teeth.x", "m"),
    ("teeth.z", "m"),
    ("teeth.way", "m"),
    ("teeth.pitch", "rad"),
    ("teeth.pitch_error", "rad"),
    ("teeth.payload", "kg"),
];
/// Groups of figures in a heartbeat that are times, and those of their numbers that are not.
const LATENCIES: [&str; 4] = ["wait.", "work.", "end_to_end.", "release_jitter."];
const NO_LATENCIES: [&str; 2] = [".count", ".beyond"];

/// The unit of the number `column` of a channel; empty where it has none.
pub(super) fn unit(channel: &str, column: &str) -> &'static str {
    let is_latency = || LATENCIES.iter().any(|group| column.starts_with(group));
    match channel {
        // The error word of a sensor.
        EncoderReading::CHANNEL if column.ends_with(".error") => "",
        Reference::CHANNEL if column.starts_with("positions[") => "m",
        Request::CHANNEL if column.ends_with(".target") => "m",
        StageHealth::CHANNEL if is_latency() => {
            if NO_LATENCIES.iter().any(|ending| column.ends_with(ending)) {
                ""
            } else {
                "ns"
            }
        }
        _ => ENDINGS.iter().find(|(ending, _)| column.ends_with(ending)).map_or("", |(_, unit)| unit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::schema::columns_of;
    use pipeline::message::{EncoderSample, MachineState, ValveCommand};

    fn with_unit<M: Message>(wanted: &str) -> usize {
        columns_of::<M>().iter().filter(|column| unit(M::CHANNEL, &column.name) == wanted).count()
    }

    #[test]
    fn numbers_have_the_units_of_their_fields() {
        let axes = pipeline::MAX_AXES;
        assert_eq!(with_unit::<EncoderSample>("m"), axes);
        assert_eq!(with_unit::<EncoderSample>("Pa"), 2 * axes);
        assert_eq!(with_unit::<EncoderSample>("ns"), 2);
        assert_eq!(with_unit::<EncoderReading>("m"), 0);
        // Reference and error; mean and largest of both errors. Place, error and way of the teeth.
        assert_eq!(with_unit::<ValveCommand>("m"), 6 * axes + 4);
        assert_eq!(with_unit::<ValveCommand>("rad"), 2);
        assert_eq!(with_unit::<ValveCommand>("kg"), 1);
        assert_eq!(with_unit::<ValveCommand>("m^2"), 2 * axes);
        assert_eq!(with_unit::<Reference>("m"), 32 * axes);
        assert_eq!(with_unit::<Request>("m"), axes);
        assert_eq!(with_unit::<MachineState>("m/s"), axes);
        assert_eq!(unit(StageHealth::CHANNEL, "wait.p99_9"), "ns");
        assert_eq!(unit(StageHealth::CHANNEL, "wait.count"), "");
    }
}
