//! `hydraxis can sdo`: one object of a device, read or written.

use std::{
    io::{self, BufRead, Write},
    time::Duration,
};

use can::canopen::{MAX_VALUE, NodeId, Object};
use clap::{Args, Subcommand};

use super::{
    bus::{BusArguments, duration, node},
    dialogue::{Dialogue, number},
};
use crate::{failure::Failure, report::output::show};

/// What is done with an object.
#[derive(Debug, Subcommand)]
pub enum Sdo {
    /// Read an object of a device
    Read(ReadArguments),
    /// Write an object of a device; asks before
    Write(WriteArguments),
}

/// A device and one of its objects.
#[derive(Debug, Args)]
pub struct ObjectArguments {
    #[command(flatten)]
    bus: BusArguments,
    /// Number of the node, 1 to 127
    #[arg(long, value_name = "NODE", value_parser = node)]
    node: NodeId,
    /// Index in hexadecimal digits, and subindex, such as 6004 or 1800:2
    #[arg(long, value_name = "INDEX[:SUB]", value_parser = object)]
    object: Object,
    /// Longest time that the node may take to answer
    #[arg(long, default_value = "500ms", value_parser = duration)]
    answer: Duration,
}

/// `can sdo read`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can sdo read machine.toml --node 11 --object 6004           position of an encoder
  hydraxis can sdo read --interface can0 --node 21 --object 1400:5     time-out of a valve, ms

Prints the bytes as they came, and what they are as numbers and as text. Refused while a group has the bus.")]
pub struct ReadArguments {
    #[command(flatten)]
    object: ObjectArguments,
}

/// `can sdo write`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can sdo write machine.toml --node 11 --object 1017 --value 100 --type u16     heartbeat every 100 ms
  hydraxis can sdo write --interface can0 --node 11 --object 6003 --value 0 --type u32   the encoder's zero is here

The value is read before and after; a value that the device does not keep is an error. A setting may be gone once the
device is switched off: many devices store it by 1010h:1, type u32, value 1702257011 (\"save\").

A written object can move a valve. Pressure off, nobody near. Refused while a group has the bus.")]
pub struct WriteArguments {
    #[command(flatten)]
    object: ObjectArguments,
    /// The value: a number, or a text with --type text
    #[arg(long, allow_hyphen_values = true)]
    value: String,
    /// Type of the object
    #[arg(long = "type", value_name = "TYPE", value_enum)]
    kind: Kind,
    /// Write without a question
    #[arg(long)]
    yes: bool,
}

/// Types of objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    U8,
    U16,
    U32,
    U64,
    I8,
    I16,
    I32,
    I64,
    F32,
    Text,
}

/// An object such as `1800:2`.
fn object(text: &str) -> Result<Object, String> {
    let allowed = || "allowed: an index of four hexadecimal digits, and a subindex, such as 6004 or 1800:2".to_owned();
    let (index, sub) = text.split_once(':').unwrap_or((text, "0"));
    let index = index.trim_end_matches('h').trim_start_matches("0x");
    let is_index = index.len() == 4;
    let index = u16::from_str_radix(index, 16).ok().filter(|_| is_index).ok_or_else(allowed)?;
    Ok(Object::new(index, sub.parse().map_err(|_| allowed())?))
}

/// The bytes of a value.
fn bytes(kind: Kind, text: &str) -> Result<Vec<u8>, String> {
    fn number<T: std::str::FromStr>(text: &str) -> Result<T, String> {
        text.parse().map_err(|_| format!("found {text}; allowed: a number that the type holds"))
    }
    Ok(match kind {
        Kind::U8 => number::<u8>(text)?.to_le_bytes().to_vec(),
        Kind::U16 => number::<u16>(text)?.to_le_bytes().to_vec(),
        Kind::U32 => number::<u32>(text)?.to_le_bytes().to_vec(),
        Kind::U64 => number::<u64>(text)?.to_le_bytes().to_vec(),
        Kind::I8 => number::<i8>(text)?.to_le_bytes().to_vec(),
        Kind::I16 => number::<i16>(text)?.to_le_bytes().to_vec(),
        Kind::I32 => number::<i32>(text)?.to_le_bytes().to_vec(),
        Kind::I64 => number::<i64>(text)?.to_le_bytes().to_vec(),
        Kind::F32 => {
            let value = number::<f32>(text)?;
            if !value.is_finite() {
                return Err(format!("found {text}; allowed: a finite number that the type holds"));
            }
            value.to_le_bytes().to_vec()
        }
        Kind::Text => text.as_bytes().to_vec(),
    })
}

/// Runs the command.
pub fn run(sdo: &Sdo) -> Result<(), Failure> {
    match sdo {
        Sdo::Read(arguments) => read(arguments),
        Sdo::Write(arguments) => write(arguments),
    }
}

fn read(arguments: &ReadArguments) -> Result<(), Failure> {
    let ObjectArguments { bus, node, object, answer } = &arguments.object;
    let mut bus = bus.named()?.open()?;
    let value = Dialogue { bus: &mut *bus, patience: *answer }.read(*node, *object).map_err(Failure::run)?;
    Ok(show(&format!("node {}, {object}: {}\n", node.number(), described(&value)))?)
}

fn write(arguments: &WriteArguments) -> Result<(), Failure> {
    let ObjectArguments { bus, node, object, answer } = &arguments.object;
    let value = bytes(arguments.kind, &arguments.value).map_err(|error| Failure::usage(format!("--value: {error}")))?;
    if !(1..=MAX_VALUE).contains(&value.len()) {
        let allowed = format!("1 to {MAX_VALUE} bytes");
        return Err(Failure::usage(format!("--value: found {} bytes; allowed: {allowed}", value.len())));
    }
    let mut bus = bus.named()?.open()?;
    let mut dialogue = Dialogue { bus: &mut *bus, patience: *answer };
    let number = node.number();
    // An object that can only be written has no value before.
    let before = dialogue.read(*node, *object).map_or_else(|error| format!("({error})"), |value| described(&value));
    eprintln!("node {number}, {object}: {before}");
    eprintln!("node {number}, {object}: to be written: {}", described(&value));
    if !arguments.yes && !is_confirmed()? {
        return Err(Failure::run("nothing was written; allowed: yes, or --yes"));
    }
    dialogue.write(*node, *object, &value).map_err(Failure::run)?;
    match dialogue.read(*node, *object) {
        Ok(kept) if kept == value => Ok(show(&format!("node {number}, {object}: written, {}\n", described(&kept)))?),
        Ok(kept) => Err(Failure::run(format!(
            "node {number}, {object}: the device has taken the value and keeps another one: {}",
            described(&kept)
        ))),
        Err(error) => Ok(show(&format!("node {number}, {object}: written; it cannot be read back: {error}\n"))?),
    }
}

/// Asks on standard error; only `yes` is one.
fn is_confirmed() -> Result<bool, Failure> {
    eprint!("A written object can move a valve. Write it? Type yes: ");
    let mut line = String::new();
    io::stderr().flush().and_then(|()| io::stdin().lock().read_line(&mut line)).map_err(Failure::run)?;
    Ok(line.trim() == "yes")
}

/// A value as bytes, as numbers, and as text where it is one.
fn described(value: &[u8]) -> String {
    let hex: Vec<String> = value.iter().map(|byte| format!("{byte:02X}")).collect();
    let mut text = format!("[{}]", hex.join(" "));
    if let Some(unsigned) = number(value) {
        let signed = can::canopen::signed(unsigned, (8 * value.len()) as u8);
        text += &format!(" = {unsigned}");
        if signed < 0 {
            text += &format!(", with a sign {signed}");
        }
        text += &format!(" = {unsigned:X}h");
    }
    let is_text = value.len() > 1 && value.iter().all(|byte| (0x20..0x7F).contains(byte));
    if is_text {
        text += &format!(" = \"{}\"", String::from_utf8_lossy(value));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_an_index_and_a_subindex() {
        assert_eq!(object("6004"), Ok(Object::new(0x6004, 0)));
        assert_eq!(object("1400h:5"), Ok(Object::new(0x1400, 5)));
        assert_eq!(object("0x1800:2"), Ok(Object::new(0x1800, 2)));
        for wrong in ["", "604", "60040", "6004:256", "6004:", "zzzz", "6004:x"] {
            assert!(object(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn values_have_the_bytes_of_their_type() {
        assert_eq!(bytes(Kind::U16, "258"), Ok(vec![2, 1]));
        assert_eq!(bytes(Kind::I32, "-2"), Ok(vec![0xFE, 0xFF, 0xFF, 0xFF]));
        assert_eq!(bytes(Kind::Text, "save"), Ok(b"save".to_vec()));
        for (kind, wrong) in [
            (Kind::U8, "256"),
            (Kind::U16, "-1"),
            (Kind::I8, "128"),
            (Kind::U32, "1.5"),
            (Kind::F32, "nan"),
            (Kind::F32, "1e99"),
        ] {
            assert!(bytes(kind, wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn values_are_shown_as_bytes_numbers_and_text() {
        assert_eq!(described(&[0xFE, 0xFF]), "[FE FF] = 65534, with a sign -2 = FFFEh");
        assert_eq!(described(b"save"), "[73 61 76 65] = 1702257011 = 65766173h = \"save\"");
        assert_eq!(described(&[]), "[]");
    }
}
