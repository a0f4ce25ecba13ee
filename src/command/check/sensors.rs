//! What a sensor at a joint resolves of the position of its cylinder.

use pipeline::machine::{AngleKind, Machine};

/// One line with the length of a count at both ends and in the middle of the stroke, for every sensor at a joint; empty
/// without such a sensor.
pub fn summary(machine: &Machine) -> String {
    let of_axes = machine.axes.iter().enumerate().filter_map(|(number, axis)| {
        let kind = match axis.encoder.angle?.kind {
            AngleKind::RotaryEncoder => "rotary encoder",
            AngleKind::Inclinometer => "inclinometer",
        };
        let length = |part: f64| format!("{:.3}", 1e3 * machine.count_length(number, part * axis.stroke));
        Some(format!("{} ({kind}) {} / {} / {} mm", axis.name, length(0.0), length(0.5), length(1.0)))
    });
    let lines: Vec<String> = of_axes.collect();
    if lines.is_empty() {
        return String::new();
    }
    format!("one count at position 0, in the middle and at full stroke: {}\n", lines.join(", "))
}
