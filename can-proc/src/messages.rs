//! The messages of a machine file that are no CANopen: DBC file, signals, drives.

use std::collections::BTreeMap;

use can::{
    device::{AxisFrames, FrameDrive, FrameDriveSettings, Frames, Pattern, Receiver, SetPoint, SignalPosition, Source},
    frames::{Checksum, Database, Guard, Message, NamedSignal, Signal},
};
use pipeline::machine::{Axis, CanBus, CanMessage, CanSignals, ChecksumKind, Machine};

use crate::{error::WiringError, judge::Uses};

/// Pa of a unit of pressure.
const PRESSURES: [(&str, f64); 5] = [("Pa", 1.0), ("kPa", 1e3), ("bar", 1e5), ("MPa", 1e6), ("psi", 6_894.757_293)];
/// m of a unit of length.
const LENGTHS: [(&str, f64); 4] = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6)];
/// rad of a degree.
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// rad of a unit of angle.
const ANGLES: [(&str, f64); 4] = [("rad", 1.0), ("mrad", 1e-3), ("deg", DEGREE), ("°", DEGREE)];
/// Part by which the length of a count may differ between machine file and data base.
const SAME: f64 = 1e-6;

/// The messages of a machine that its bus and axes name.
///
/// # Errors
/// The DBC file or a message is none, or a name is none of them.
pub fn frames(machine: &Machine, bus: &CanBus) -> Result<Frames, WiringError> {
    let mut wiring = Wiring {
        database: database(bus)?,
        bus,
        machine,
        frames: Frames::default(),
        places: BTreeMap::new(),
        uses: Uses::default(),
    };
    let mut drives: BTreeMap<String, Vec<SetPoint>> = BTreeMap::new();
    for (i, axis) in machine.axes.iter().enumerate() {
        let wired = axis.can.as_ref().map(|wired| (&wired.signals, wired.is_reversed, wired.zero));
        let Some((signals, is_reversed, zero)) = wired else { continue };
        let key = |name: &str| format!("axis.{}.can.{name}", axis.name);
        let mut own = AxisFrames::default();
        if let Some(name) = &signals.position {
            expect_own(&machine.axes[..i], &key("position"), name)?;
            expect_scale(axis, &key("position"), &wiring.signal(&key("position"), name)?.1)?;
            let source = wiring.source(&key("position"), name)?;
            let position = SignalPosition { source, is_reversed, zero };
            expect_range(axis, &key("position"), name, &position)?;
            own.position = Some(position);
        }
        if let Some([piston, rod]) = &signals.pressures {
            let piston = wiring.pressure(&key("piston_pressure"), piston)?;
            own.pressures = Some([piston, wiring.pressure(&key("rod_pressure"), rod)?]);
        }
        wiring.frames.axes.push(own);
        if let (Some(name), true) = (&signals.command, machine.drive.is_real()) {
            let (message, set_point) = wiring.set_point(i, axis, signals, name)?;
            drives.entry(message).or_default().push(set_point);
        }
    }
    for (message, set_points) in drives {
        let drive = wiring.drive(&message, set_points)?;
        wiring.frames.drives.push(drive);
    }
    wiring.frames.emergency_stop =
        bus.emergency_stop.as_ref().map(|name| wiring.source("can.emergency_stop", name)).transpose()?;
    wiring.frames.pilot = bus.pilot.as_ref().map(|name| wiring.source("can.pilot", name)).transpose()?;
    wiring.expect_sound()?;
    Ok(wiring.frames)
}

/// The messages of the DBC file, and those that the machine file writes itself.
///
/// # Errors
/// The file cannot be read, or is none; a message or signal is none.
pub fn database(bus: &CanBus) -> Result<Database, WiringError> {
    let mut database = Database::default();
    if let Some(file) = &bus.dbc {
        let wrong = |error: String| WiringError::Text(format!("can.dbc: {}: {error}", file.display()));
        let text = std::fs::read(file).map_err(|error| wrong(format!("{error}; allowed: a DBC file")))?;
        // Comments of older editors are no UTF-8; names are ASCII.
        database = Database::parse(&String::from_utf8_lossy(&text)).map_err(|error| wrong(error.to_string()))?;
    }
    for message in &bus.messages {
        let key = format!("can.message \"{}\"", message.name);
        let wrong = |error: &dyn std::fmt::Display| WiringError::Text(format!("{key}: {error}"));
        let Some((id, is_extended)) = message.id else {
            database.message(&message.name).map_err(|error| wrong(&error))?;
            continue;
        };
        let signals = message.signals.iter().map(|text| named(text, message.length).map_err(|error| wrong(&error)));
        let signals = signals.collect::<Result<_, _>>()?;
        let found = Message { name: message.name.clone(), id, is_extended, length: message.length, signals };
        database.add(found).map_err(|error| wrong(&error))?;
    }
    Ok(database)
}

/// A signal with its name in front and its unit behind.
fn named(text: &str, length: u8) -> Result<NamedSignal, String> {
    let allowed = "NAME START|BITS@ORDER SIGN (FACTOR,OFFSET) UNIT, such as Boom 0|16@1- (0.001,0) m";
    let (name, rest) = text.trim().split_once(' ').ok_or_else(|| format!("found \"{text}\"; allowed: {allowed}"))?;
    let end = rest.find(')').map_or(rest.len(), |place| place + 1);
    let (notation, unit) = rest.split_at(end);
    let signal = Signal::parse(notation, length).map_err(|error| format!("signal {name}: {error}"))?;
    Ok(NamedSignal { name: name.to_owned(), signal, unit: unit.trim().to_owned() })
}

struct Wiring<'m> {
    database: Database,
    bus: &'m CanBus,
    machine: &'m Machine,
    frames: Frames,
    /// Receivers by the names of their messages.
    places: BTreeMap<String, usize>,
    uses: Uses,
}

impl Wiring<'_> {
    fn signal(&self, key: &str, name: &str) -> Result<(Message, NamedSignal), WiringError> {
        let found = self.database.signal(name).map_err(|error| WiringError::Text(format!("{key}: {error}")))?;
        Ok((found.0.clone(), found.1.clone()))
    }

    /// What the machine file says of a message.
    fn said(&self, message: &Message) -> Option<&CanMessage> {
        self.bus.messages.iter().find(|said| said.name == message.name)
    }

    fn guard(&self, message: &Message) -> Result<Guard, WiringError> {
        let Some(said) = self.said(message) else { return Ok(Guard::default()) };
        let wrong = |text: String| WiringError::Text(format!("can.message \"{}\": {text}", message.name));
        let counter = said.counter.as_ref().map(|name| message.signal(name)).transpose();
        let counter = counter.map_err(|error| wrong(format!("counter: {error}")))?.map(|named| named.signal);
        let kind = match said.checksum_kind {
            ChecksumKind::Xor => Checksum::Xor,
            ChecksumKind::Sum => Checksum::Sum,
            ChecksumKind::Crc8J1850 => Checksum::Crc8J1850,
        };
        if let Some(byte) = said.checksum.filter(|byte| *byte >= message.length) {
            return Err(wrong(format!("checksum: found byte {byte}; allowed: 0 to {}", message.length - 1)));
        }
        Ok(Guard { counter, checksum: said.checksum.map(|byte| (byte, kind)) })
    }

    /// Refuses a message whose counter, checksum or states overlap with what it is used for.
    fn expect_guarded(&self, message: &Message, states: &[&Pattern; 3]) -> Result<(), WiringError> {
        let guard = self.guard(message)?;
        let checksum = guard.checksum.map(|(byte, _)| ("checksum", Signal::byte(byte)));
        let own: Vec<_> = guard.counter.map(|counter| ("counter", counter)).into_iter().chain(checksum).collect();
        self.uses.guarded(message, &own, states)
    }

    /// Refuses messages that contradict each other.
    fn expect_sound(&self) -> Result<(), WiringError> {
        for name in self.places.keys() {
            let message = self.database.message(name).map_err(|error| WiringError::Text(error.to_string()))?;
            self.expect_guarded(message, &[&Pattern::new(); 3])?;
        }
        self.uses.expect_identifiers(self.machine)
    }

    /// A signal that is received.
    fn source(&mut self, key: &str, name: &str) -> Result<Source, WiringError> {
        let (message, signal) = self.signal(key, name)?;
        self.uses.add(key, &message, signal.signal, false)?;
        if let Some(place) = self.places.get(&message.name) {
            return Ok((*place, signal.signal));
        }
        let timeout = self.said(&message).and_then(|said| said.timeout).unwrap_or(self.machine.timing.feedback_timeout);
        let receiver = Receiver::new(&message, self.guard(&message)?, timeout.as_nanos() as u64);
        let place = self.frames.receivers.len();
        self.frames.receivers.push(receiver);
        self.places.insert(message.name, place);
        Ok((place, signal.signal))
    }

    fn pressure(&mut self, key: &str, name: &str) -> Result<(Source, f64), WiringError> {
        let unit = self.signal(key, name)?.1.unit;
        let Some((_, pascal)) = PRESSURES.iter().find(|(known, _)| *known == unit) else {
            let allowed = PRESSURES.map(|(known, _)| known).join(", ");
            return Err(WiringError::Text(format!("{key}: found the unit \"{unit}\" of {name}; allowed: {allowed}")));
        };
        Ok((self.source(key, name)?, *pascal))
    }

    /// Where the command of an axis is, and the message that has it.
    fn set_point(
        &mut self,
        place: usize,
        axis: &Axis,
        signals: &CanSignals,
        name: &str,
    ) -> Result<(String, SetPoint), WiringError> {
        let key = |name: &str| format!("axis.{}.can.{name}", axis.name);
        let (message, signal) = self.signal(&key("command"), name)?;
        let direction = signals.direction.as_ref().map(|name| self.signal(&key("direction"), name)).transpose()?;
        if let Some((other, _)) = direction.as_ref().filter(|(other, _)| other.name != message.name) {
            let allowed = format!("a signal of {}, which has the command", message.name);
            return Err(WiringError::Text(format!(
                "{}: found message {}; allowed: {allowed}",
                key("direction"),
                other.name
            )));
        }
        let scale = signals.scale;
        let needed = if direction.is_some() { [scale.abs(), 0.0] } else { [scale, -scale] };
        if let Some(value) = needed.iter().find(|value| !signal.signal.holds(**value)) {
            let allowed = "a command_scale that the signal can say in both directions, or a direction";
            return Err(WiringError::Text(format!(
                "{}: found {value} for {name}; allowed: {allowed}",
                key("command_scale")
            )));
        }
        let active = signals.active.as_ref().ok_or_else(|| WiringError::Missing(key("active")))?;
        let active = self.source(&key("active"), active)?;
        self.uses.add(&key("command"), &message, signal.signal, true)?;
        let direction = direction.map(|(_, direction)| direction.signal);
        if let Some(direction) = direction {
            self.uses.add(&key("direction"), &message, direction, true)?;
        }
        Ok((message.name, SetPoint { axis: place, signal: signal.signal, scale, direction, active }))
    }

    fn drive(&self, name: &str, set_points: Vec<SetPoint>) -> Result<FrameDrive, WiringError> {
        let wrong = |error: String| WiringError::Text(format!("can.message \"{name}\": {error}"));
        let message = self.database.message(name).map_err(|error| wrong(error.to_string()))?.clone();
        let said = self.said(&message);
        let pattern = |i: usize| {
            let texts = said.map_or(&[][..], |said| &said.patterns[i]);
            texts.iter().map(|text| value(&message, text).map_err(wrong)).collect::<Result<Pattern, _>>()
        };
        let (active, neutral, off) = (pattern(0)?, pattern(1)?, pattern(2)?);
        self.expect_guarded(&message, &[&active, &neutral, &off])?;
        Ok(FrameDrive::new(FrameDriveSettings {
            guard: self.guard(&message)?,
            set_points,
            active,
            neutral,
            off,
            timeout_ns: self.machine.timing.drive_timeout.as_nanos() as u64,
            period_ns: said.map_or(0, |said| said.period.as_nanos() as u64),
            message,
        }))
    }
}

/// A text such as `Enable=1`.
fn value(message: &Message, text: &str) -> Result<(Signal, f64), String> {
    let allowed =
        || format!("found \"{text}\"; allowed: a signal of the message and a value that it can have, such as Enable=1");
    let (name, value) = text.split_once('=').ok_or_else(allowed)?;
    let signal = message.signal(name.trim()).map_err(|error| error.to_string())?.signal;
    let value = value.trim().parse().ok().filter(|value| signal.holds(*value)).ok_or_else(allowed)?;
    Ok((signal, value))
}

/// Refuses a position that an axis before has as well.
fn expect_own(before: &[Axis], key: &str, name: &str) -> Result<(), WiringError> {
    let has = |axis: &&Axis| axis.can.as_ref().is_some_and(|wired| wired.signals.position.as_deref() == Some(name));
    let Some(other) = before.iter().find(has) else { return Ok(()) };
    let allowed = "a position of its own for every axis";
    Err(WiringError::Text(format!("{key}: found {name}, the position of axis.{}; allowed: {allowed}", other.name)))
}

/// Refuses the position of a cylinder that the signal cannot say at both soft limits.
fn expect_range(axis: &Axis, key: &str, name: &str, position: &SignalPosition) -> Result<(), WiringError> {
    if axis.encoder.angle.is_some() {
        return Ok(());
    }
    let sign = if position.is_reversed { -1.0 } else { 1.0 };
    for limit in <[f64; 2]>::from(axis.soft_limits) {
        let number = position.zero as f64 + sign * (limit / axis.encoder.resolution).round();
        if !position.source.1.has(number) {
            let allowed = "a signal with numbers for both soft limits, or another zero";
            return Err(WiringError::Text(format!(
                "{key}: found {name}, which has no {number} for {limit} m; allowed: {allowed}"
            )));
        }
    }
    Ok(())
}

/// Refuses a signal with a negative factor, one of another unit than the position, and one whose count has another
/// length than the machine file says. A signal without a unit is taken: its data base does not say what a count is.
fn expect_scale(axis: &Axis, key: &str, named: &NamedSignal) -> Result<(), WiringError> {
    let (units, own, name): (&[(&str, f64)], f64, &str) = match axis.encoder.angle {
        None => (&LENGTHS, axis.encoder.resolution, "resolution"),
        Some(sensor) => (&ANGLES, sensor.resolution, "angle_resolution"),
    };
    if named.signal.factor() < 0.0 {
        let allowed = "a factor above 0; where the signal falls while the axis extends, reversed = true";
        return Err(WiringError::Text(format!(
            "{key}: found the factor {} of {}; allowed: {allowed}",
            named.signal.factor(),
            named.name
        )));
    }
    if named.unit.is_empty() {
        return Ok(());
    }
    let Some((_, unit)) = units.iter().find(|(unit, _)| *unit == named.unit) else {
        let known: Vec<&str> = units.iter().map(|(known, _)| *known).collect();
        let (found, allowed) = (&named.unit, known.join(", "));
        return Err(WiringError::Text(format!(
            "{key}: found the unit \"{found}\" of {}; allowed: {allowed}, or none",
            named.name
        )));
    };
    let found = named.signal.factor().abs() * unit;
    if (found - own).abs() <= SAME * own {
        return Ok(());
    }
    let allowed = format!("axis.{}.encoder.{name} = {found:e}", axis.name);
    Err(WiringError::Text(format!("{key}: found {own:e} for a count of {}; allowed: {allowed}", named.name)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use can::{
        Frame, Received,
        device::{Cause, Fault},
    };

    use super::*;

    const EXCAVATOR: &str = include_str!("../../examples/excavator.toml");
    const TABLES: &str = include_str!("../../examples/excavator-can.toml");

    /// The excavator with the tables of the example, one of whose texts is replaced.
    fn machine(from: &str, to: &str) -> Result<Machine, String> {
        assert!(TABLES.contains(from), "{from}");
        let mut settings = vec![("source.kind", "can"), ("timing.drive_timeout", "100ms")];
        settings.push(("axis.telescope.encoder.resolution", "1e-4"));
        let mut settings: Vec<(String, String)> =
            settings.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
        for axis in ["boom", "arm", "bucket"] {
            settings.push((format!("axis.{axis}.encoder.kind"), "rotary-encoder".to_owned()));
            settings.push((format!("axis.{axis}.encoder.angle_resolution"), "1e-4".to_owned()));
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
        let text = format!("{EXCAVATOR}\n{}", TABLES.replacen(from, to, 1));
        Machine::parse(&text, "m.toml", &folder, &settings).map_err(|error| error.to_string())
    }

    #[test]
    fn the_example_is_a_machine_whose_messages_are_known() {
        let mut network = crate::network(&machine("", "").unwrap()).unwrap();
        let held = Fault::of(network.reading(0).unwrap().1).unwrap();
        assert_eq!((held.cause, held.detail), (Cause::Absent, 0x0100), "message 18FF0100h of the boom");
        // A good message of the boom: its count is 1, and its checksum fits.
        let mut data = [0x10, 0x27, 0, 0, 60, 0, 1, 0];
        data[7] = data.iter().fold(0, |sum, byte| sum ^ byte);
        let id = embedded_can::ExtendedId::new(0x18FF_0100).unwrap();
        let frame = <Frame as embedded_can::Frame>::new(id, &data).unwrap();
        network.take(&Received { frame, time_ns: 1000 }, 1000);
        assert_eq!((network.reading(0).unwrap().0, network.pressures(0)), (10_000, Some([12e6, 0.0])));
        // Without a SYNC: there is no node.
        network.begin(2000);
        assert!(network.outbox().frames().iter().all(|frame| frame.standard_id().is_none()));
    }

    /// Each text is replaced by the next one, and the network says the last one.
    fn expect_refused(cases: &[(&str, &str, &str)]) {
        for (from, to, expected) in cases {
            let said = crate::network(&machine(from, to).unwrap()).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn names_and_values_that_are_none_are_refused() {
        expect_refused(&[
            ("\"excavator.dbc\"", "\"none.dbc\"", "can.dbc: "),
            ("BoomState.Angle", "BoomState.Angel", "axis.boom.can.position: found \"Angel\"; allowed: a signal of"),
            ("Levers.Boom", "Lever.Boom", "axis.boom.can.command: found \"Lever\"; allowed: a message: BoomState"),
            ("counter = \"Alive\"", "counter = \"Live\"", "can.message \"BoomState\": counter: found \"Live\""),
            (
                "Mode=1",
                "Mode=9",
                "can.message \"Levers\": found \"Mode=9\"; allowed: a signal of the message and a value",
            ),
            (
                "BoomState.Angle",
                "BoomState.Rate",
                "axis.boom.can.position: found the unit \"rad/s\" of Rate; allowed: rad, mrad, deg, °, or none",
            ),
            ("BoomState.Piston", "BoomState.Rate", "found the unit \"rad/s\" of BoomState.Rate; allowed: Pa, kPa"),
            (
                "command = \"Levers.Boom\"",
                "command = \"Levers.Boom\"\ncommand_scale = 2",
                "axis.boom.can.command_scale: found 2 for Levers.Boom; allowed: a command_scale that the signal",
            ),
        ]);
        for (from, to, expected) in [
            (
                "active = \"MachineState.Lock\"",
                "",
                "axis.boom.can.active: found nothing; allowed: a signal: without it",
            ),
            ("rod_pressure = \"BoomState.Rod\"", "", "axis.boom.can.piston_pressure: found one pressure"),
            ("position = \"BoomState.Angle\"", "", "axis.boom.can.encoder: found nothing; allowed: 1 to 127"),
            ("position = \"BoomState.Angle\"", "encoder = 7\nposition = \"BoomState.Angle\"", "encoder or position"),
            ("name = \"Levers\"", "name = \"Levers\"\nperiod = \"90ms\"", "half of timing.drive_timeout"),
        ] {
            let said = machine(from, to).unwrap_err();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn what_contradicts_itself_is_refused() {
        expect_refused(&[
            ("off = [\"Mode=2\"]", "off = [\"Mode=1\"]", "can.message \"Levers\".off: found the values of active"),
            ("neutral = [\"Mode=0\"]", "neutral = [\"Mode=1\"]", "\"Levers\".neutral: found the values of active"),
            (
                "neutral = [\"Mode=0\"]",
                "neutral = [\"Mode=0\", \"Boom=1\"]",
                "can.message \"Levers\".neutral: found bits that axis.boom.can.command has; allowed: a signal",
            ),
            ("counter = \"Alive\"", "counter = \"Angle\"", "counter: found bits that axis.boom.can.position has"),
            ("checksum = 7", "checksum = 6", "checksum: found bits that can.message \"BoomState\".counter has"),
            ("MachineState.Lock", "Levers.Mode", "axis.boom.can.command: found message Levers, which is sent and"),
            ("Levers.Arm", "Levers.Boom", "axis.arm.can.command: found bits that axis.boom.can.command has"),
            ("ArmState.Angle", "BoomState.Angle", "axis.arm.can.position: found BoomState.Angle, the position of"),
            (
                "MachineState.PilotShutOff",
                "MachineState.EmergencyStop",
                "can.pilot: found bits that can.emergency_stop",
            ),
            (
                "MachineState.Lock",
                "BoomState.Alive",
                "can.message \"BoomState\".counter: found bits that axis.boom.can.act",
            ),
            (
                "MachineState.Lock",
                "BoomState.Angle",
                "axis.boom.can.active: found bits that axis.boom.can.position has",
            ),
        ]);
    }

    #[test]
    fn messages_are_written_in_the_machine_file_as_well() {
        let own = "[[can.message]]\nname = \"Own\"\nid = 0x123\nlength = 4\nsignals = [\"Place 0|16@1- (1e-4,0) m\"]\n";
        let tables = format!("{own}\n[axis.boom.can]");
        let with_own = machine("[axis.boom.can]", &tables).unwrap();
        let database = database(with_own.can.as_ref().unwrap()).unwrap();
        let (message, place) = database.signal("Own.Place").unwrap();
        assert_eq!((message.id, message.is_extended, place.unit.as_str()), (0x123, false, "m"));
        for (from, to, expected) in [
            ("0|16@1-", "0|40@1-", "can.message \"Own\": signal Place: found bits up to byte 4"),
            ("Place 0|16@1- (1e-4,0) m", "Place", "found \"Place\"; allowed: NAME START|BITS"),
            ("\"Own\"", "\"Levers\"", "message Levers: found twice"),
        ] {
            let wrong = machine("[axis.boom.can]", &tables.replacen(from, to, 1)).unwrap();
            let said = super::database(wrong.can.as_ref().unwrap()).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
        // The telescope has its position of this message: with the identifier of another one, and reversed.
        let telescope = "[axis.telescope.can]\nposition = \"TelescopeState.Length\"";
        let of_own = telescope.replace("TelescopeState.Length", "Own.Place");
        for (own, expected) in [
            (own.replace("0x123", "0x18FF0100"), "18FF0100h, which message BoomState has; allowed: one message"),
            (own.replace("1e-4", "-1e-4"), "axis.telescope.can.position: found the factor -0.0001 of Place"),
            (own.replace("0|16@1-", "0|8@1-"), "axis.telescope.can.position: found Own.Place, which has no "),
        ] {
            let wrong = machine(telescope, &format!("{own}\n{of_own}")).unwrap();
            let said = crate::network(&wrong).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn identifiers_of_canopen_are_no_messages_where_there_are_nodes() {
        let with_node = machine("position = \"TelescopeState.Length\"", "encoder = 13").unwrap();
        let without = machine("", "").unwrap();
        let refuses = |machine: &Machine, id: u32, is_extended: bool| {
            let message = Message { name: "Own".to_owned(), id, is_extended, length: 8, signals: Vec::new() };
            let mut uses = Uses::default();
            uses.add("own", &message, Signal::byte(0), false).unwrap();
            uses.expect_identifiers(machine).is_err()
        };
        for id in [0x00, 0x80, 0x8D, 0x18D, 0x70D] {
            assert!(refuses(&with_node, id, false) && !refuses(&with_node, id, true), "{id:X}");
            assert!(!refuses(&without, id, false), "{id:X}");
        }
        assert!(!refuses(&with_node, 0x123, false) && !refuses(&with_node, 0x100, false));
    }
}
