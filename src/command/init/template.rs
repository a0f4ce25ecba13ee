//! The text of the machine file: one line for each key, with its unit and what it means.

use std::fmt::Write as _;

use pipeline::machine::quantity;

use super::{
    quantity::{DIGITS, significant},
    rig::{BULK_MODULUS, RATED_DROP, RETURN_PRESSURE, Rig, SECOND},
};

/// Column of the comments.
const COLUMN: usize = 34;

/// `--source` of a rig on a CAN bus.
pub const CAN: &str = "can";
/// Numbers of the nodes of the first axis.
const FIRST_ENCODER: usize = 11;
const FIRST_VALVE: usize = 21;

/// What the file describes.
pub struct Machine<'a> {
    pub name: &'a str,
    /// Control period, s.
    pub period: f64,
    /// Pressure of the pump, Pa.
    pub pressure: f64,
    pub rigs: &'a [Rig],
    /// `sim`, `can` or `external`.
    pub source: &'a str,
}

/// A text that grows line by line.
struct Page(String);

impl Page {
    fn line(&mut self, text: &str) {
        self.0 += text;
        self.0.push('\n');
    }

    /// The head of a table, with what it describes.
    fn table(&mut self, name: &str, comment: &str) {
        self.line("");
        self.line(&format!("[{name}]{:pad$}# {comment}", "", pad = COLUMN.saturating_sub(name.len() + 2).max(2)));
    }

    /// A key with a comment.
    fn key(&mut self, key: &str, value: &str, comment: &str) {
        let given = format!("{key} = {value}");
        self.line(&format!("{given:COLUMN$}# {comment}"));
    }

    /// A quantity in a unit that reads well; `unit` is that unit and that of the key.
    fn quantity(&mut self, key: &str, value: f64, (unit, of_key): (&str, &str), comment: &str) {
        self.key(key, &with_unit(value, unit, of_key), comment);
    }

    /// A number, rounded for people.
    fn number(&mut self, key: &str, value: f64, comment: &str) {
        self.key(key, &shown(value), comment);
    }
}

/// A quantity as a text in this unit, of the dimension of its key.
fn with_unit(value: f64, unit: &str, of_key: &str) -> String {
    let one = quantity(&format!("1{unit}"), of_key).unwrap_or(1.0);
    format!("\"{}{unit}\"", significant(value / one, DIGITS))
}

/// A number in the notation of TOML.
fn shown(value: f64) -> String {
    format!("{:?}", significant(value, DIGITS))
}

/// A duration with its unit.
fn duration(seconds: f64) -> String {
    format!("\"{}us\"", (1e6 * seconds).round()).replace("000us", "ms")
}

/// The text of the file.
pub fn text(machine: &Machine) -> String {
    let mut page = Page(String::new());
    head(&mut page, machine);
    source(&mut page, machine.source);
    hydraulics(&mut page, machine);
    for (number, rig) in machine.rigs.iter().enumerate() {
        axis(&mut page, rig);
        if machine.source == CAN {
            devices(&mut page, rig, number);
        }
        control(&mut page, rig);
        reference(&mut page, rig);
        cylinder(&mut page, rig);
        valve(&mut page, rig);
    }
    page.0
}

fn head(page: &mut Page, machine: &Machine) {
    page.line(
        "# Machine file, begun by `hydraxis init`. Numbers are in SI units; a text may have another unit, such as",
    );
    page.line("# \"50mm\" or \"210bar\". `hydraxis check --explain FILE` shows all keys with what is allowed.");
    page.key("name", &format!("{:?}", machine.name), "shown in reports");
    page.table("timing", "times of the control loop");
    page.key("period", &duration(machine.period), "sample and control period");
    page.key(
        "feedback_timeout",
        &duration(3.0 * machine.period),
        "without a position for so long, valves go to neutral",
    );
}

/// Where readings come from and where commands go to.
fn source(page: &mut Page, kind: &str) {
    let meaning = match kind {
        "sim" => "the simulated twin of the rig",
        CAN => "encoders and valves on a CAN bus, or played by `hydraxis can simulate`",
        _ => "a program of yours",
    };
    page.line("");
    page.line(
        "# Where encoder readings come from: \"sim\" is the twin of [supply], [oil] and [axis.NAME.plant] below.",
    );
    page.line(
        "# \"can\" and \"external\" are a real rig: devices on a bus, or any program that writes encoder-reading.",
    );
    page.line("# The twin can still be simulated.");
    page.line("[source]");
    page.key("kind", &format!("{kind:?}"), meaning);
    page.line("");
    page.line("# Where commands go: to the twin, or to any program that reads valve-command.");
    page.line("[drive]");
    page.key("kind", &format!("{kind:?}"), "as the source");
    if kind == CAN {
        page.table("can", "the bus");
        page.key("interface", "\"can0\"", "or an adapter such as \"/dev/ttyACM0\"");
        page.key("bit_rate", "500000", "bit/s, as all devices have it");
    }
}

/// The CANopen devices of the axis with this number.
fn devices(page: &mut Page, rig: &Rig, number: usize) {
    page.table(&format!("axis.{}.can", rig.name), "its devices; `hydraxis can scan` shows their numbers");
    page.key("encoder", &(FIRST_ENCODER + number).to_string(), "number of the node; its step has to be `resolution`");
    page.key("valve", &(FIRST_VALVE + number).to_string(), "number of the node");
    page.key("full_scale", "16384", "set point at command 1; negative where a positive one retracts");
}

fn hydraulics(page: &mut Page, machine: &Machine) {
    let flow: f64 = machine.rigs.iter().map(Rig::largest_flow).sum();
    page.table("supply", "pump of the twin");
    page.quantity("pressure", machine.pressure, ("bar", "Pa"), "as long as the flow suffices");
    page.quantity("return_pressure", RETURN_PRESSURE, ("bar", "Pa"), "in the return line");
    page.quantity("flow", 1.5 * flow, ("l/min", "m3/s"), "largest flow: half more than all axes take together");
    page.table("oil", "oil of the twin");
    page.quantity("bulk_modulus", BULK_MODULUS, ("MPa", "Pa"), "of the oil without air");
}

fn axis(page: &mut Page, rig: &Rig) {
    let Rig { name, stroke, resolution, .. } = rig;
    let (low, high) = rig.soft_limits();
    page.line("");
    page.line(&format!("# {:-<100}", format!("{name} ")));
    page.table(&format!("axis.{name}"), "the cylinder and its limits");
    page.number("stroke", *stroke, "m, travel of the piston");
    page.number("max_speed", rig.max_speed(), "m/s; a faster position signal is not believed");
    page.key("soft_limits", &format!("[{}, {}]", shown(low), shown(high)), "m; no reference leads beyond");
    page.table(&format!("axis.{name}.encoder"), "the position sensor");
    page.quantity("resolution", *resolution, ("um", "m"), "length of one count");
    page.quantity("tolerance", rig.tolerance(), ("mm", "m"), "a position so far outside the stroke is still believed");
    page.table(&format!("axis.{name}.identification"), "how the model is learned");
    page.key("nk", &rig.delay().to_string(), "samples from a command to motion: the dead time");
    page.key("training", "\"8s\"", "the first model is learned from so much motion");
}

fn control(page: &mut Page, rig: &Rig) {
    // A little less than the dead band: compensating too much makes an axis swing.
    let dead_band = 0.8 * rig.dead_band;
    page.table(&format!("axis.{}.control", rig.name), "the fallback; commissioning finds better gains");
    page.number("kp", rig.kp(), "1/m, command per following error");
    page.key("ki", "0.0", "1/(m s), off until the axis is commissioned");
    page.quantity("dead_band_extend", dead_band, ("%", ""), "part of the command that is jumped over");
    page.quantity("dead_band_retract", dead_band, ("%", ""), "the same, while retracting");
    page.key("command_limit", "1.0", "largest command; 1 opens the valve fully");
    page.key("command_rate", "10.0", "1/s, fastest change of a command");
    page.quantity(
        "following_error",
        rig.following_error(),
        ("mm", "m"),
        "so far from the reference for 0.2 s, the axis stops",
    );
    page.quantity("rest_band", rig.rest_band(), ("mm", "m"), "so close to its set point the axis rests");
}

fn reference(page: &mut Page, rig: &Rig) {
    let (low, high) = rig.soft_limits();
    let (amplitude, frequency) = rig.reference();
    let name = &rig.name;
    page.table(&format!("axis.{name}.reference"), "a gentle motion to begin with");
    page.key("kind", "\"sines\"", "or \"hold\", \"ramps\", \"trajectory\", \"channel\"");
    page.number("center", 0.5 * (low + high), "m, middle of the motion");
    page.line("sines = [");
    for (amplitude, frequency, phase) in
        [(amplitude, frequency, 0.0), (SECOND.0 * amplitude, SECOND.1 * frequency, 1.0)]
    {
        let _ = writeln!(
            page.0,
            "  {{ amplitude = {}, frequency = {}, phase = {phase:?} }},    # m, Hz, rad",
            shown(amplitude),
            shown(frequency)
        );
    }
    page.line("]");
}

fn cylinder(page: &mut Page, rig: &Rig) {
    let ((piston, rod), (at_piston, at_rod)) = (rig.areas(), rig.dead_volumes());
    let (stiffness, damping) = rig.end_stops();
    page.table(&format!("axis.{}.plant", rig.name), "the simulated axis");
    page.number("initial_position", 0.5 * rig.stroke, "m, where the simulation begins");
    page.quantity("piston_area", piston, ("cm2", "m2"), &format!("of a bore of {} m", shown(rig.bore)));
    page.quantity("rod_area", rod, ("cm2", "m2"), &format!("of the same bore less a rod of {} m", shown(rig.rod)));
    page.quantity("piston_dead_volume", at_piston, ("cm3", "m3"), "hose and port of the piston side");
    page.quantity("rod_dead_volume", at_rod, ("cm3", "m3"), "hose and port of the rod side");
    page.quantity("mass", rig.mass, ("kg", "kg"), "moved by the cylinder");
    page.quantity("load_force", rig.load, ("kN", "N"), "of the load against extension");
    page.quantity(
        "viscous_friction",
        rig.viscous_friction(),
        ("N s/mm", "N s/m"),
        "3 % of the weaker direction's force, at the largest speed",
    );
    page.quantity("coulomb_friction", rig.coulomb_friction(), ("N", "N"), "2 % of the weaker direction's force");
    page.quantity("static_friction", rig.static_friction(), ("N", "N"), "force from which motion begins");
    page.quantity("stribeck_speed", 0.01, ("mm/s", "m/s"), "speed over which static falls to Coulomb friction");
    page.quantity("bristle_damping", rig.bristle_damping(), ("N s/mm", "N s/m"), "of the friction before it slides");
    page.number("internal_leakage", rig.internal_leakage(), "m3/(s Pa), past the piston, as its circumference");
    page.quantity("end_stop_stiffness", stiffness, ("kN/mm", "N/m"), "of the cylinder's ends");
    page.quantity("end_stop_damping", damping, ("kN s/m", "N s/m"), "of the cylinder's ends");
}

fn valve(page: &mut Page, rig: &Rig) {
    let hertz = format!("of a bandwidth of {} Hz", shown(rig.valve_hz));
    let speed = format!("of one open edge, for {} m/s", shown(rig.speed));
    page.quantity("rated_flow", rig.rated_flow(), ("l/min", "m3/s"), &speed);
    page.quantity("rated_pressure_drop", RATED_DROP, ("bar", "Pa"), "over one edge at rated_flow");
    page.quantity("dead_band_extend", rig.dead_band, ("%", ""), "part of the command up to which the valve stays shut");
    page.quantity("dead_band_retract", rig.dead_band, ("%", ""), "the same, while retracting");
    page.key("hysteresis", "0.01", "part of the full command");
    page.quantity("valve_time_constant", rig.valve_time_constant(), ("ms", "s"), &hertz);
    page.quantity("dead_time", rig.dead_time, ("ms", "s"), "from a command to the first reaction of the valve");
    page.quantity("encoder_noise", 0.3 * rig.resolution, ("um", "m"), "a third of a count");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_whole_and_have_their_unit() {
        assert_eq!([0.01, 5e-4, 1.5e-3].map(duration), ["\"10ms\"", "\"500us\"", "\"1500us\""]);
    }
}
