//! The bus that a command of `hydraxis can` works on: that of a machine file, or one that is named.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use can::{
    BitRates,
    bus::{self, Address, BIT_RATES, Bus},
    canopen::NodeId,
};
use clap::Args;
use pipeline::machine::{CanBus, Machine};

use crate::{arguments::values::setting, failure::Failure};

/// Bit rate where neither the machine file nor the command line has one, bit/s: the default of the machine file.
const BIT_RATE: u32 = 500_000;

/// A bus: that of a machine file, or one that is named.
#[derive(Debug, Args)]
pub struct BusArguments {
    /// Machine file; its [can] names the bus, and its devices get the names of their axes
    #[arg(value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Replace the value of a key of the machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
    /// The bus: an interface such as can0, or a serial port such as /dev/ttyACM0 [default: that of the machine file]
    #[arg(long, value_name = "BUS")]
    pub interface: Option<Address>,
    /// Bit rate of a serial adapter, bit/s [default: that of the machine file, or 500000]
    #[arg(long, value_name = "BIT/S", value_parser = bit_rate)]
    pub bit_rate: Option<u32>,
    /// Bit rate of the data of CAN FD frames, bit/s: for the load [default: that of the machine file, or of the bus]
    #[arg(long, value_name = "BIT/S", value_parser = clap::value_parser!(u32).range(100_000..=8_000_000))]
    pub data_bit_rate: Option<u32>,
}

fn bit_rate(text: &str) -> Result<u32, String> {
    let allowed = || format!("allowed: {}", BIT_RATES.map(|rate| rate.to_string()).join(", "));
    text.parse().ok().filter(|rate| BIT_RATES.contains(rate)).ok_or_else(allowed)
}

/// `--node`: 1 to 127.
pub fn node(text: &str) -> Result<NodeId, String> {
    text.parse().ok().and_then(NodeId::new).ok_or_else(|| "allowed: 1 to 127, the number of a node".to_owned())
}

/// Durations that a command takes.
const SHORTEST: Duration = Duration::from_millis(1);
const LONGEST: Duration = Duration::from_secs(24 * 3600);

/// A duration with its unit.
pub fn duration(text: &str) -> Result<Duration, String> {
    let parsed = humantime::parse_duration(text).ok().filter(|duration| (SHORTEST..=LONGEST).contains(duration));
    parsed.ok_or_else(|| "allowed: 1ms to 1day, such as 500ms or 10s".to_owned())
}

/// A bus that is not open yet.
pub struct NamedBus {
    /// Where it is.
    pub address: Address,
    /// Its bit rates.
    pub rates: BitRates,
    /// The machine file, where there is one.
    pub machine: Option<Machine>,
}

impl BusArguments {
    fn machine(&self) -> Result<Option<Machine>, Failure> {
        Ok(self.machine.as_deref().map(|path| Machine::load(Some(path), &self.settings)).transpose()?)
    }

    /// The bus that was asked for.
    ///
    /// # Errors
    /// The machine file is wrong, or neither it nor the command line names a bus.
    pub fn named(&self) -> Result<NamedBus, Failure> {
        let machine = self.machine()?;
        let wired = machine.as_ref().and_then(|machine| machine.can.as_ref());
        let address = match (&self.interface, wired) {
            (Some(address), _) => address.clone(),
            (None, Some(can)) => {
                can.interface.parse().map_err(|error| Failure::usage(format!("can.interface: {error}")))?
            }
            (None, None) => {
                let found = if machine.is_some() { "a machine file without [can]" } else { "neither" };
                return Err(Failure::usage(format!(
                    "the bus: found {found}; allowed: --interface can0, --interface /dev/ttyACM0, or a machine file \
                     with source.kind = \"can\""
                )));
            }
        };
        Ok(NamedBus { address, rates: self.rates(wired)?, machine })
    }

    fn rates(&self, wired: Option<&CanBus>) -> Result<BitRates, Failure> {
        let bus = self.bit_rate.or(wired.map(|can| can.bit_rate)).unwrap_or(BIT_RATE);
        let data = self.data_bit_rate.or(wired.and_then(|can| can.data_bit_rate));
        if let Some(data) = data.filter(|data| *data < bus) {
            return Err(Failure::usage(format!(
                "--data-bit-rate: found {data}; allowed: {bus}, the bit rate, or more"
            )));
        }
        Ok(BitRates { bus, data })
    }
}

impl NamedBus {
    /// A log in the place of the bus.
    ///
    /// # Errors
    /// The machine file is wrong.
    pub fn of_log(arguments: &BusArguments, log: &Path) -> Result<Self, Failure> {
        let machine = arguments.machine()?;
        let wired = machine.as_ref().and_then(|machine| machine.can.as_ref());
        let rates = arguments.rates(wired)?;
        Ok(Self { address: Address::Serial(log.to_owned()), rates, machine })
    }

    /// Opens the bus to send on it; refused while a group has it.
    ///
    /// # Errors
    /// The bus cannot be opened.
    pub fn open(&self) -> Result<Box<dyn Bus>, Failure> {
        bus::open(&self.address, self.rates, false).map_err(Failure::run)
    }

    /// Opens the bus to listen.
    ///
    /// # Errors
    /// The bus cannot be opened.
    pub fn listen(&self) -> Result<Box<dyn Bus>, Failure> {
        bus::listen(&self.address, self.rates).map_err(Failure::run)
    }

    /// Which device of the machine file has this number, such as `boom encoder`.
    pub fn device(&self, node: NodeId) -> Option<String> {
        let axes = &self.machine.as_ref()?.axes;
        axes.iter().find_map(|axis| {
            let wired = axis.can.as_ref()?;
            match node.number() {
                number if Some(number) == wired.encoder => Some(format!("{} encoder", axis.name)),
                number if Some(number) == wired.valve => Some(format!("{} valve", axis.name)),
                _ => None,
            }
        })
    }
}
