//! Faults of devices, machine and bus, as lines of text: `boom.encoder mute`, `machine stopped`, `bus full`.

use can::canopen::NodeId;

/// What a line may be.
pub const FAULTS: &str = "allowed: AXIS.encoder or AXIS.valve with well, mute, restart, babble, double, \
                          emergency CODE (hexadecimal) or number 1 to 127; AXIS.encoder alarm BITS (hexadecimal); \
                          AXIS.valve with stuck -1 to 1, fail CODE or no-timeout; \
                          AXIS.encoder hung or wrong, of messages; machine with well, stopped or cut-off; \
                          bus with well, unplugged, off or full";

/// What can be wrong with a device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DeviceFault {
    /// Nothing any more.
    Well,
    /// It sends nothing.
    Mute,
    /// It is switched off and on, and forgets its settings.
    Restart,
    /// It sends its process data all the time.
    Babble,
    /// It sends each of its process data twice.
    Double,
    /// An emergency; code 0 ends it.
    Emergency(u16),
    /// It has another number. With the number of another device there are two of one number.
    Number(NodeId),
    /// Alarms of an encoder, 6503h.
    Alarm(u16),
    /// The spool of a valve stands at this part of full scale.
    Stuck(f64),
    /// A fault of a valve, with its emergency.
    Fail(u16),
    /// The own time-out of a valve does not act.
    NoTimeout,
    /// The alive counter of a message stands still.
    Hung,
    /// A message is too short.
    Wrong,
}

/// What can be wrong with a machine of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MachineFault {
    /// Nothing any more.
    Well,
    /// Its emergency stop is pressed.
    Stopped,
    /// Its pilot pressure is cut off.
    CutOff,
}

/// What can be wrong with the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusFault {
    /// Nothing any more.
    Well,
    /// The adapter is not there.
    Unplugged,
    /// The controller of the adapter is bus-off: no frame passes.
    Off,
    /// Frames of somebody else leave no room: the adapter takes no frames, and passes on foreign ones only.
    Full,
}

/// A fault and where it is; axes by their places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// Of the bus.
    Bus(BusFault),
    /// Of the machine.
    Machine(MachineFault),
    /// Of an encoder.
    Encoder(usize, DeviceFault),
    /// Of a valve.
    Valve(usize, DeviceFault),
}

impl Fault {
    /// The fault that a line says of axes with these names.
    ///
    /// # Errors
    /// The line is none, with what was found and what is allowed.
    pub fn parse(line: &str, axes: &[String]) -> Result<Self, String> {
        let refused = || format!("fault: found \"{}\"; {FAULTS}; axes: {}", line.trim(), axes.join(", "));
        let mut words = line.split_whitespace();
        let (target, fault) = words.next().zip(words.next()).ok_or_else(refused)?;
        let (value, rest) = (words.next(), words.next());
        let found = match target.rsplit_once('.') {
            None if target == "bus" && value.is_none() => bus_fault(fault).map(Self::Bus),
            None if target == "machine" && value.is_none() => machine_fault(fault).map(Self::Machine),
            Some((axis, part @ ("encoder" | "valve"))) if rest.is_none() => {
                let place = axes.iter().position(|name| name == axis).ok_or_else(refused)?;
                let is_valve = part == "valve";
                let of = |fault| if is_valve { Self::Valve(place, fault) } else { Self::Encoder(place, fault) };
                device_fault(fault, value, is_valve).map(of)
            }
            _ => None,
        };
        found.ok_or_else(refused)
    }
}

fn bus_fault(word: &str) -> Option<BusFault> {
    Some(match word {
        "well" => BusFault::Well,
        "unplugged" => BusFault::Unplugged,
        "off" => BusFault::Off,
        "full" => BusFault::Full,
        _ => return None,
    })
}

fn machine_fault(word: &str) -> Option<MachineFault> {
    Some(match word {
        "well" => MachineFault::Well,
        "stopped" => MachineFault::Stopped,
        "cut-off" => MachineFault::CutOff,
        _ => return None,
    })
}

fn device_fault(word: &str, value: Option<&str>, is_valve: bool) -> Option<DeviceFault> {
    let bits = |text: &str| u16::from_str_radix(text, 16).ok();
    Some(match (word, value) {
        ("well", None) => DeviceFault::Well,
        ("mute", None) => DeviceFault::Mute,
        ("restart", None) => DeviceFault::Restart,
        ("babble", None) => DeviceFault::Babble,
        ("double", None) => DeviceFault::Double,
        ("emergency", Some(code)) => DeviceFault::Emergency(bits(code)?),
        ("number", Some(number)) => DeviceFault::Number(number.parse().ok().and_then(NodeId::new)?),
        ("alarm", Some(alarms)) if !is_valve => DeviceFault::Alarm(bits(alarms)?),
        ("stuck", Some(part)) if is_valve => {
            DeviceFault::Stuck(part.parse().ok().filter(|part| (-1.0..=1.0).contains(part))?)
        }
        ("fail", Some(code)) if is_valve => DeviceFault::Fail(bits(code)?),
        ("no-timeout", None) if is_valve => DeviceFault::NoTimeout,
        ("hung", None) if !is_valve => DeviceFault::Hung,
        ("wrong", None) if !is_valve => DeviceFault::Wrong,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_lines() {
        let axes = ["boom".to_owned(), "arm.left".to_owned()];
        let parse = |line: &str| Fault::parse(line, &axes);
        assert_eq!(parse(" boom.encoder  mute "), Ok(Fault::Encoder(0, DeviceFault::Mute)));
        assert_eq!(parse("arm.left.valve stuck -0.3"), Ok(Fault::Valve(1, DeviceFault::Stuck(-0.3))));
        assert_eq!(parse("boom.valve emergency 8250"), Ok(Fault::Valve(0, DeviceFault::Emergency(0x8250))));
        assert_eq!(
            parse("boom.encoder number 12"),
            Ok(Fault::Encoder(0, DeviceFault::Number(NodeId::new(12).unwrap())))
        );
        assert_eq!(parse("bus full"), Ok(Fault::Bus(BusFault::Full)));
        assert_eq!(parse("machine cut-off"), Ok(Fault::Machine(MachineFault::CutOff)));
        for wrong in [
            "",
            "bus",
            "bus mute",
            "machine mute",
            "boom.valve hung",
            "bus full now",
            "boom mute",
            "bucket.encoder mute",
            "boom.encoder stuck 0.1",
            "boom.valve stuck 2",
            "boom.valve stuck nan",
            "boom.encoder number 128",
            "boom.encoder emergency 12345",
            "boom.valve alarm 1",
            "boom.encoder mute 3",
            "boom.encoder alarm 1 2",
        ] {
            let said = parse(wrong).unwrap_err();
            assert!(said.starts_with(&format!("fault: found \"{wrong}\"; allowed: AXIS.encoder")), "{said}");
        }
    }
}
