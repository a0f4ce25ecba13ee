//! The messages as structures of ctypes.

use pipeline::stage::StageKind;

use super::{Definitions, MAX_AXES, MAX_PREVIEW, MEMBERS, Names, REFUSALS, Shape, Struct, comment};

const HEAD: &str = r#""""Messages, channels, flags and modes of Hydraxis, as structures of ctypes.

This file is written out of the message types in pipeline/src/message/. Changes are lost: change the types, and type
HYDRAXIS_BOOK=overwrite cargo test --test book
"""

import ctypes
from ctypes import c_double as f64, c_int64 as i64, c_uint8 as u8, c_uint32 as u32, c_uint64 as u64
from enum import IntEnum, IntFlag

"#;

/// The text of the module.
pub fn module(definitions: &Definitions) -> String {
    let mut text = HEAD.to_owned();
    text += &format!("MAX_AXES = {MAX_AXES}  # axes in a message; the entries beyond header.axis_count are zero\n");
    text += &format!("MAX_PREVIEW = {MAX_PREVIEW}  # positions of an axis in a Reference, the present tick included\n");
    text += "# Why models were refused, in the order of AxisCommand.rejected_snapshots.\n";
    text += &format!("REFUSALS = {REFUSALS:?}\n");
    text += "# Estimators that run side by side, and their memory in horizons, in the order of AxisSnapshot.weights.\n";
    text += &MEMBERS.iter().fold("MEMBERS = [\n".to_owned(), |text, name| text + &format!("    {name:?},\n"));
    text += "]\n";
    text += "# Stages, in the order of StageHealth.stage.\n";
    text += &format!("STAGES = {:?}\n", StageKind::ALL.map(StageKind::name));
    definitions.names.iter().for_each(|names| text += &enumeration(names));
    definitions.structs.iter().for_each(|one| text += &structure(definitions, one));
    text += "\n\n# All messages, by the names of their channels, in the order of the data.\nMESSAGES = {\n";
    for message in &definitions.messages {
        text += &format!("    \"{}\": {},\n", message.channel, message.name);
    }
    text + "}\n"
}

fn enumeration(names: &Names) -> String {
    let base = if names.is_bits { "IntFlag" } else { "IntEnum" };
    let mut text = format!("\n\nclass {}({base}):\n", names.name);
    for constant in &names.constants {
        text += &comment(&constant.doc, "    # ");
        text += &format!("    {} = {}\n", constant.name, constant.value);
    }
    for (set, value) in &names.sets {
        let bits = names.constants.iter().filter(|bit| bit.value & value != 0);
        let bits: Vec<&str> = bits.map(|bit| bit.name.as_str()).collect();
        text += &format!("    {set} = {}\n", bits.join(" | "));
    }
    text
}

fn structure(definitions: &Definitions, one: &Struct) -> String {
    let mut text = format!("\n\nclass {}(ctypes.Structure):\n", one.name);
    if let Some(message) = definitions.messages.iter().find(|message| message.name == one.name) {
        text += &format!("    CHANNEL = \"{}\"\n", message.channel);
        text += &format!("    LAYOUT = \"{:016x}\"\n", message.layout);
        text += &format!("    MAX_PUBLISHERS = {}\n", message.publishers);
        text += &format!("    BUFFER = {}  # messages that a reader may fall behind\n", message.buffer);
        let is_from_clients = if message.is_from_clients { "True" } else { "False" };
        text += &format!("    IS_FROM_CLIENTS = {is_from_clients}\n");
    }
    text += &format!("    SIZE = {}\n    _fields_ = [\n", one.size);
    for (field, _) in &one.fields {
        text += &comment(field.doc, "        # ");
        text += &format!("        (\"{}\", {}),\n", field.name, kind(&field.shape));
    }
    text += "    ]\n";
    if let Some(message) = definitions.messages.iter().find(|message| message.name == one.name) {
        text += &format!("\n    @staticmethod\n    def type_name():\n        return \"{}\"\n", message.type_name);
    }
    text
}

fn kind(shape: &Shape) -> String {
    match shape {
        Shape::Number(name) | Shape::Struct(name, _) => (*name).to_owned(),
        Shape::Array(of, count) => match of {
            Shape::Array(..) => format!("({}) * {count}", kind(of)),
            _ => format!("{} * {count}", kind(of)),
        },
    }
}
