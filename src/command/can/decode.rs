//! What frames mean: CANopen with the names of a machine file's devices, and the signals of its messages.

use std::collections::BTreeMap;

use can::{
    Frame,
    canopen::{Emergency, NodeId, NodeState, function, heartbeat_of, signed},
    frames::{Database, Message, NamedSignal},
};
use embedded_can::Frame as _;

use super::{bus::NamedBus, scan::named_state};
use crate::failure::Failure;

/// Reads frames.
#[derive(Clone)]
pub struct Decoder {
    /// Devices of the machine file by their numbers, and whether each is a valve.
    devices: BTreeMap<NodeId, (String, bool)>,
    /// Messages that are no CANopen.
    database: Database,
}

impl Decoder {
    /// Of a bus.
    ///
    /// # Errors
    /// The messages of the machine file are none.
    pub fn of(named: &NamedBus) -> Result<Self, Failure> {
        let devices = NodeId::all().filter_map(|node| {
            let name = named.device(node)?;
            let is_valve = name.ends_with("valve");
            Some((node, (name, is_valve)))
        });
        let bus = named.machine.as_ref().and_then(|machine| machine.can.as_ref());
        let database = bus.map(can_proc::database).transpose().map_err(Failure::usage)?.unwrap_or_default();
        Ok(Self { devices: devices.collect(), database })
    }

    /// What a frame says.
    pub fn meaning(&self, frame: &Frame) -> String {
        let is_it = |message: &&Message| message.layout.is_of(frame);
        if let Some(message) = self.database.messages().iter().find(is_it) {
            return signals(message, frame.data());
        }
        let Some(id) = frame.standard_id() else { return String::new() };
        let (function, node) = (id & !0x7F, NodeId::new((id & 0x7F) as u8));
        let data = frame.data();
        match (function, node) {
            (function::NMT, None) => nmt(data),
            (function::SYNC, None) => "SYNC".to_owned(),
            (function::EMERGENCY, Some(node)) => match Emergency::of(frame) {
                Some((_, Emergency { code: 0, .. })) => format!("{}: emergency over", self.name(node)),
                Some((_, emergency)) => format!("{}: emergency {:04X}h", self.name(node), emergency.code),
                None => String::new(),
            },
            (function::HEARTBEAT, Some(node)) => match heartbeat_of(frame) {
                Some((_, NodeState::BootUp)) => format!("{}: boot-up", self.name(node)),
                Some((_, state)) => format!("{}: heartbeat, {}", self.name(node), named_state(state)),
                None => String::new(),
            },
            (function::SDO_REQUEST, Some(node)) => format!("{}: asked {}", self.name(node), sdo(data)),
            (function::SDO_RESPONSE, Some(node)) => format!("{}: answers {}", self.name(node), sdo(data)),
            (0x180..=0x480, Some(node)) if function & 0x80 != 0 => self.device_says(node, function, data),
            (0x200..=0x500, Some(node)) => self.device_is_told(node, function, data),
            _ => String::new(),
        }
    }

    fn name(&self, node: NodeId) -> String {
        match self.devices.get(&node) {
            Some((name, _)) => format!("{name} (node {})", node.number()),
            None => format!("node {}", node.number()),
        }
    }

    /// The first process data of a known device are mapped as `can-proc` does it.
    fn device_says(&self, node: NodeId, function: u16, data: &[u8]) -> String {
        let name = self.name(node);
        match (self.devices.get(&node), data) {
            (Some((_, false)), &[a, b, c, d, ref rest @ ..]) if function == function::TPDO1 => {
                let raw = u32::from_le_bytes([a, b, c, d]);
                let alarms = match *rest {
                    [a, b, c, d] if [a, b, c, d] != [0; 4] => format!(
                        ", alarms {:04X}h, warnings {:04X}h",
                        u16::from_le_bytes([a, b]),
                        u16::from_le_bytes([c, d])
                    ),
                    _ => String::new(),
                };
                format!("{name}: position {}{alarms}", signed(raw.into(), 32))
            }
            (Some((_, true)), &[a, b, c, d]) if function == function::TPDO1 => {
                let spool = i16::from_le_bytes([c, d]);
                format!("{name}: {}, spool {spool}", status(u16::from_le_bytes([a, b])))
            }
            _ => format!("{name}: TPDO {}", (function >> 8) & 0xF),
        }
    }

    fn device_is_told(&self, node: NodeId, function: u16, data: &[u8]) -> String {
        let name = self.name(node);
        match (self.devices.get(&node), data) {
            (Some((_, true)), &[a, b, c, d]) if function == function::RPDO1 => {
                let set_point = i16::from_le_bytes([c, d]);
                format!("{name}: {}, set point {set_point}", control(u16::from_le_bytes([a, b])))
            }
            _ => format!("{name}: RPDO {}", (function >> 8) - 1),
        }
    }
}

/// All signals of a message.
fn signals(message: &Message, data: &[u8]) -> String {
    let values = message.signals.iter().map(|NamedSignal { name, signal, unit }| match signal.value(data) {
        Some(value) if unit.is_empty() => format!("{name} {value}"),
        // No more digits than the factor has.
        Some(value) => format!("{name} {} {unit}", (value * 1e9).round() / 1e9),
        None => format!("{name} missing"),
    });
    format!("{}: {}", message.name, values.collect::<Vec<_>>().join(", "))
}

fn nmt(data: &[u8]) -> String {
    let &[command, node] = data else { return String::new() };
    let to = if node == 0 { "all nodes".to_owned() } else { format!("node {node}") };
    let what = match command {
        0x01 => "start",
        0x02 => "stop",
        0x80 => "pre-operational",
        0x81 => "reset",
        0x82 => "reset communication",
        _ => return format!("NMT {command:02X}h to {to}"),
    };
    format!("NMT: {what}, {to}")
}

/// Object and abort code of service data.
fn sdo(data: &[u8]) -> String {
    let &[command, low, high, sub, ref value @ ..] = data else { return String::new() };
    let object = format!("{:04X}h:{sub}", u16::from_le_bytes([low, high]));
    match (command >> 5, <[u8; 4]>::try_from(value)) {
        (4, Ok(code)) => format!("{object}, {}", can::canopen::AbortCode(u32::from_le_bytes(code))),
        (1..=3, _) if low != 0 || high != 0 => object,
        _ => "a segment".to_owned(),
    }
}

fn status(word: u16) -> &'static str {
    match word & 0xF {
        0x8 => "off",
        0x9 => "disabled",
        0xB => "hold",
        0xF => "active",
        _ => "fault",
    }
}

fn control(word: u16) -> &'static str {
    match word & 0xF {
        0x0 => "off",
        0x1 => "disable",
        0x3 => "hold",
        0x7 => "active",
        word if word & 8 != 0 => "reset",
        _ => "unknown control word",
    }
}

#[cfg(test)]
mod tests {
    use can::canopen::{Command, heartbeat, nmt, sync};

    use super::*;

    fn decoder() -> Decoder {
        let device = |node, name: &str, is_valve| (NodeId::new(node).unwrap(), (name.to_owned(), is_valve));
        let text = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A\n\nBO_ 1911 Oil: 2 A\n \
                    SG_ Temperature : 0|8@1+ (0.5,-40) [0|0] \"degC\" A\n SG_ Alive : 8|8@1+ (1,0) [0|0] \"\" A\n";
        Decoder {
            devices: [device(11, "boom encoder", false), device(21, "boom valve", true)].into(),
            database: Database::parse(text).unwrap(),
        }
    }

    #[test]
    fn frames_say_which_device_they_are_about() {
        let node = NodeId::new(11).unwrap();
        for (frame, expected) in [
            (sync(), "SYNC"),
            (nmt(Command::Start, Some(node)), "NMT: start, node 11"),
            (nmt(Command::ResetNode, None), "NMT: reset, all nodes"),
            (heartbeat(node, NodeState::Operational), "boom encoder (node 11): heartbeat, operational"),
            (Frame::standard(0x18B, [0x18, 0xFC, 0xFF, 0xFF, 0, 0, 0, 0]), "boom encoder (node 11): position -1000"),
            (
                Frame::standard(0x18B, [1, 0, 0, 0, 0, 0x10, 0, 0]),
                "boom encoder (node 11): position 1, alarms 1000h, warnings 0000h",
            ),
            (Frame::standard(0x215, [7, 0, 0, 0x20]), "boom valve (node 21): active, set point 8192"),
            (Frame::standard(0x195, [0xF, 0, 0, 0xE0]), "boom valve (node 21): active, spool -8192"),
            (Frame::standard(0x08B, [0, 0x50, 1, 0, 0, 0, 0, 0]), "boom encoder (node 11): emergency 5000h"),
            (
                Frame::standard(0x58B, [0x80, 0x04, 0x60, 0, 0, 0, 2, 6]),
                "boom encoder (node 11): answers 6004h:0, abort 06020000h (no such object)",
            ),
            (Frame::standard(0x281, [0; 8]), "node 1: TPDO 2"),
            (Frame::standard(0x301, [0; 8]), "node 1: RPDO 2"),
            (Frame::standard(0x7FF, [0; 8]), ""),
            (Frame::standard(1911, [130, 7]), "Oil: Temperature 25 degC, Alive 7"),
            (Frame::standard(1911, [130]), "Oil: Temperature 25 degC, Alive missing"),
        ] {
            assert_eq!(decoder().meaning(&frame), expected);
        }
    }
}
