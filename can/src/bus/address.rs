//! Addresses of buses, as texts of a machine file.
//!
//! | text | bus |
//! |---|---|
//! | `can0`, `vcan0` | an interface of the kernel, by SocketCAN |
//! | `/dev/ttyACM0`, `./can` | an adapter that speaks slcan; a path begins with `/`, `./` or `../` |

use std::{fmt, path::PathBuf, str::FromStr};

use super::{Bus, BusError, slcan::SlcanBus, socket::SocketBus};
use crate::BitRates;

/// Longest name of an interface that the kernel takes.
const MAX_INTERFACE: usize = 15;

/// Where a bus is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// An interface of the kernel.
    Interface(String),
    /// A serial port or a pseudo terminal with an adapter that speaks slcan.
    Serial(PathBuf),
}

/// A text that is no address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "found \"{0}\"; allowed: an interface such as can0, or the path of a serial port, such as /dev/ttyACM0 or ./can"
)]
pub struct NoAddress(String);

impl FromStr for Address {
    type Err = NoAddress;

    fn from_str(text: &str) -> Result<Self, NoAddress> {
        let is_name = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
        if ["/", "./", "../"].iter().any(|start| text.starts_with(start)) {
            Ok(Self::Serial(text.into()))
        } else if (1..=MAX_INTERFACE).contains(&text.len()) && text.chars().all(is_name) {
            Ok(Self::Interface(text.to_owned()))
        } else {
            Err(NoAddress(text.to_owned()))
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interface(name) => out.write_str(name),
            Self::Serial(path) => write!(out, "{}", path.display()),
        }
    }
}

/// Opens a bus to send on it. The bit rate is set at an adapter; those of an interface are set by `ip link` before.
/// Frames of CAN FD are sent with their data at a bit rate of their own where `rates` has one. One program at a time
/// has the bus.
///
/// # Errors
/// The kernel has no CAN, there is no such interface or port, it is down, the right is missing, another program has it,
/// the adapter does not answer, or CAN FD is needed and not there.
pub fn open(address: &Address, rates: BitRates, needs_flexible: bool) -> Result<Box<dyn Bus>, BusError> {
    let bus = opened(address, rates)?;
    expect_format(&*bus, address, needs_flexible)?;
    Ok(bus)
}

/// Refuses a bus without CAN FD where that is needed.
///
/// # Errors
/// It is needed, and the bus has none.
pub fn expect_format(bus: &dyn Bus, address: &Address, needs_flexible: bool) -> Result<(), BusError> {
    let is_lacking = needs_flexible && !bus.is_flexible();
    if is_lacking { Err(BusError::Classical { address: address.to_string() }) } else { Ok(()) }
}

fn opened(address: &Address, rates: BitRates) -> Result<Box<dyn Bus>, BusError> {
    Ok(match address {
        Address::Interface(name) => Box::new(SocketBus::open(name, rates.data.is_some())?.claimed(name)?),
        Address::Serial(path) => Box::new(SlcanBus::open(path, rates.bus)?),
    })
}

/// Opens a bus to listen. An interface may have another program that sends on it; a serial port cannot.
///
/// # Errors
/// Those of [`open`]; an interface may be claimed by another program.
pub fn listen(address: &Address, rates: BitRates) -> Result<Box<dyn Bus>, BusError> {
    match address {
        Address::Interface(name) => Ok(Box::new(SocketBus::open(name, rates.data.is_some())?)),
        Address::Serial(_) => opened(address, rates),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_interfaces_or_paths() {
        for text in ["can0", "vcan0", "/dev/ttyACM0", "./can", "../can"] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
        for text in ["", "a name with spaces", "an-interface-that-is-too-long", "can/0"] {
            assert!(text.parse::<Address>().is_err(), "{text}");
        }
    }
}
