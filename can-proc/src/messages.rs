//! The messages of a machine file that are no CANopen: DBC file, signals, drives.

use std::{collections::BTreeMap, f64::consts::TAU};

use can::{
    bus::Address,
    device::{AxisFrames, FrameDrive, FrameDriveSettings, Frames, Pattern, Receiver, SetPoint, SignalPosition, Source},
    frames::{Checksum, Database, Guard, Layout, Message, NamedSignal, Signal},
};
use pipeline::{
    bounded,
    machine::{Axis, CanBus, CanMessage, CanSignals, ChecksumKind, LEAST_SET_POINT, Machine},
};

use crate::{error::WiringError, judge::Uses, range::Counted};

/// Pa of a unit of pressure.
const PRESSURES: [(&str, f64); 5] = [("Pa", 1.0), ("kPa", 1e3), ("bar", 1e5), ("MPa", 1e6), ("psi", 6_894.757_293)];
/// m of a unit of length.
const LENGTHS: [(&str, f64); 4] = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6)];
/// rad of a degree.
const DEGREE: f64 = TAU / 360.0;
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
            if let Some((number, at)) =
                (Counted { signal: &source.1, is_reversed, zero, is_slope: false }).lacking(machine, i)
            {
                let allowed = "a signal with numbers for both soft limits, or another zero";
                let found = format!("found {name}, which has no {number} for {at}");
                return Err(WiringError::Text(format!("{}: {found}; allowed: {allowed}", key("position"))));
            }
            own.position = Some(SignalPosition { source, is_reversed, zero });
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
        // A device such as /dev/zero has no end.
        if std::fs::metadata(file).is_ok_and(|found| !found.is_file()) {
            return Err(wrong("found no file; allowed: a DBC file".to_owned()));
        }
        let text =
            bounded::read(file, bounded::SETTINGS).map_err(|error| wrong(format!("{error}; allowed: a DBC file")))?;
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
        let layout = Layout { id, is_extended, length: message.length, is_flexible: message.is_flexible };
        let found = Message { name: message.name.clone(), layout, signals };
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
        if let Some(byte) = said.checksum.filter(|byte| *byte >= message.layout.length) {
            return Err(wrong(format!("checksum: found byte {byte}; allowed: 0 to {}", message.layout.length - 1)));
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

    /// Refuses messages that contradict each other or the bus.
    fn expect_sound(&self) -> Result<(), WiringError> {
        for name in self.places.keys() {
            let message = self.database.message(name).map_err(|error| WiringError::Text(error.to_string()))?;
            self.expect_guarded(message, &[&Pattern::new(); 3])?;
            self.expect_carried(message)?;
        }
        self.frames.drives.iter().try_for_each(|drive| self.expect_carried(&drive.settings().message))?;
        for said in &self.bus.messages {
            let is_received = self.places.contains_key(&said.name);
            let is_sent = self.frames.drives.iter().any(|drive| drive.settings().message.name == said.name);
            let (key, allowed) = match () {
                () if is_received && said.patterns.iter().any(|values| !values.is_empty()) => {
                    ("active, neutral or off", "these with a message that is sent, which has the command of an axis")
                }
                () if is_sent && said.timeout.is_some() => ("timeout", "one with a message that is received"),
                () => continue,
            };
            return Err(WiringError::Text(format!(
                "can.message \"{}\": found {key}, which has no effect; allowed: {allowed}",
                said.name
            )));
        }
        self.uses.expect_identifiers(self.machine)
    }

    /// Refuses a message of CAN FD at an adapter.
    fn expect_carried(&self, message: &Message) -> Result<(), WiringError> {
        let interface = &self.bus.interface;
        if !message.layout.is_flexible || !matches!(interface.parse(), Ok(Address::Serial(_))) {
            return Ok(());
        }
        Err(WiringError::Text(format!(
            "can.interface: found \"{interface}\", and message \"{}\" is of CAN FD, which slcan has not; allowed: \
             an interface of the kernel with CAN FD, such as can0",
            message.name
        )))
    }

    /// A signal that is received.
    fn source(&mut self, key: &str, name: &str) -> Result<Source, WiringError> {
        let (message, signal) = self.signal(key, name)?;
        self.uses.add(key, &message, signal.signal, false)?;
        if let Some(place) = self.places.get(&message.name) {
            return Ok((*place, signal.signal));
        }
        let timeout = self.said(&message).and_then(|said| said.timeout).unwrap_or(self.machine.timing.feedback_timeout);
        let receiver = Receiver::new(message.layout, self.guard(&message)?, timeout.as_nanos() as u64);
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
        if let Some((_, way)) =
            direction.as_ref().filter(|(_, way)| ![0.0, 1.0, 2.0].iter().all(|number| way.signal.has(*number)))
        {
            let allowed = "a signal that has the numbers 0, 1 and 2: neutral, extend, retract";
            return Err(WiringError::Text(format!("{}: found {}; allowed: {allowed}", key("direction"), way.name)));
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
        let counts = (scale / signal.signal.factor()).abs();
        if counts < LEAST_SET_POINT {
            return Err(WiringError::Text(format!(
                "{}: found {scale}, which is {counts:.0} counts of {name}; allowed: {LEAST_SET_POINT} counts or more",
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
    let value = value.trim().parse().ok().filter(|value| signal.is_exact(*value)).ok_or_else(allowed)?;
    Ok((signal, value))
}

/// Refuses a position that an axis before has as well.
fn expect_own(before: &[Axis], key: &str, name: &str) -> Result<(), WiringError> {
    let has = |axis: &&Axis| axis.can.as_ref().is_some_and(|wired| wired.signals.position.as_deref() == Some(name));
    let Some(other) = before.iter().find(has) else { return Ok(()) };
    let allowed = "a position of its own for every axis";
    Err(WiringError::Text(format!("{key}: found {name}, the position of axis.{}; allowed: {allowed}", other.name)))
}

/// Refuses a signal with a negative factor, one of another unit than the position, and one whose count has another
/// length than the machine file says. A signal without a unit is taken: its data base does not say what a count is. An
/// offset is refused where the machine file has no zero in its place.
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
    let has_zero = axis.can.as_ref().is_some_and(|wired| wired.zero != 0);
    if named.signal.offset() != 0.0 && !has_zero && axis.encoder.angle.is_none_or(|sensor| sensor.zero == 0.0) {
        let (place, found) = match axis.encoder.angle {
            None => (format!("axis.{}.can.zero", axis.name), -named.signal.offset() / named.signal.factor()),
            Some(_) => (format!("axis.{}.encoder.angle_zero", axis.name), named.signal.offset()),
        };
        return Err(WiringError::Text(format!(
            "{key}: found the offset {} of {}, which counts do not have; allowed: {place} for it, such as {found}",
            named.signal.offset(),
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
mod tests;
