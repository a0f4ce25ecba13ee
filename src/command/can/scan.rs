//! `hydraxis can scan`: the nodes of a bus, who they are, and how they are.

use std::{collections::BTreeMap, path::PathBuf, time::Duration};

use can::{
    bus::Bus,
    canopen::{Emergency, NodeId, NodeState, Object, SdoClient, SdoEvent, heartbeat_of},
};
use clap::Args;
use pipeline::stage::monotonic_ns;
use serde::Serialize;

use super::{
    bus::{BusArguments, NamedBus, duration},
    dialogue::Dialogue,
};
use crate::{
    failure::Failure,
    report::{output::Output, table::table},
};

/// `can scan`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can scan machine.toml                          the devices of the machine file, and all others
  hydraxis can scan --interface can0
  hydraxis can scan --interface /dev/ttyACM0 --bit-rate 250000
  hydraxis can scan --interface can0 --listen             sends nothing: only nodes with a heartbeat are seen

Each number from 1 to 127 is asked for its profile (1000h), and each node that answers for its identity (1018h) and its
heartbeat (1017h). This changes nothing. It is refused while a group has the bus.

  profile    406 encoder, 408 valve, 410 inclinometer
  state      by its heartbeat: pre-operational before it is set up, operational after; - where none has come

No node: check power, the two resistors of 120 ohm, CAN-H and CAN-L, and the bit rate. Nodes of one number answer as
one, or with errors: connect new devices one at a time. Exit code 1 where no node was found.")]
pub struct ScanArguments {
    #[command(flatten)]
    bus: BusArguments,
    /// How long heartbeats are listened for
    #[arg(long, default_value = "1s", value_parser = duration)]
    duration: Duration,
    /// Longest time that a node may take to answer
    #[arg(long, default_value = "200ms", value_parser = duration)]
    answer: Duration,
    /// Send nothing: only listen for heartbeats
    #[arg(long)]
    listen: bool,
    /// Write the nodes as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What was found of a node.
#[derive(Debug, Default, Serialize)]
struct Found {
    node: u8,
    device: Option<String>,
    profile: Option<u16>,
    vendor: Option<u64>,
    product: Option<u64>,
    revision: Option<u64>,
    serial: Option<u64>,
    name: Option<String>,
    heartbeat_ms: Option<u64>,
    state: Option<&'static str>,
    emergency: Option<u16>,
}

/// Runs the command.
pub fn run(arguments: &ScanArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let named = arguments.bus.named()?;
    let mut bus = if arguments.listen { named.listen()? } else { named.open()? };
    let mut scan = Scan { bus: &mut *bus, found: BTreeMap::new(), clients: Vec::new() };
    if !arguments.listen {
        scan.clients = NodeId::all().map(|node| SdoClient::new(node, arguments.answer.as_nanos() as u64)).collect();
        scan.ask(named.rates.bus)?;
    }
    scan.listen(arguments.duration.max(if arguments.listen { Duration::ZERO } else { arguments.answer }))?;
    let mut found: Vec<Found> = scan.found.into_values().collect();
    for node in &mut found {
        if let (Some(_), Some(id)) = (node.profile, NodeId::new(node.node)) {
            identify(node, id, &mut Dialogue { bus: &mut *bus, patience: arguments.answer });
        }
        node.device = NodeId::new(node.node).and_then(|id| named.device(id));
    }
    let counters = *bus.counters();
    output.write(|| text(&found, &named, counters.errors + counters.malformed), &found)?;
    let missing = missing(&named, &found);
    match (found.is_empty(), missing.is_empty()) {
        (true, _) => Err(Failure::run(format!("{}: no node was found", named.address))
            .advising("; check power, wiring, the resistors of 120 ohm and the bit rate")),
        (_, false) => Err(Failure::run(format!("{}: not found: {}", named.address, missing.join(", ")))),
        _ => Ok(()),
    }
}

struct Scan<'b> {
    bus: &'b mut dyn Bus,
    found: BTreeMap<u8, Found>,
    clients: Vec<SdoClient>,
}

/// Bits of a request and its answer on the wire, with stuff bits.
const DIALOGUE_BITS: u32 = 2 * 135;
/// The profile of a device.
const DEVICE_TYPE: Object = Object::new(0x1000, 0);

impl Scan<'_> {
    /// Asks every node for its profile. No more than half of the bus is used.
    fn ask(&mut self, bit_rate: u32) -> Result<(), Failure> {
        let pause = Duration::from_nanos(2_000_000_000 * u64::from(DIALOGUE_BITS) / u64::from(bit_rate));
        for i in 0..self.clients.len() {
            let request = self.clients[i].read(DEVICE_TYPE, monotonic_ns());
            self.bus.send(&request).and_then(|_| self.bus.flush()).map_err(Failure::run)?;
            self.listen(pause)?;
        }
        Ok(())
    }

    fn listen(&mut self, duration: Duration) -> Result<(), Failure> {
        let until_ns = monotonic_ns() + duration.as_nanos() as u64;
        while monotonic_ns() < until_ns {
            while let Some(received) = self.bus.receive().map_err(Failure::run)? {
                self.take(&received.frame);
            }
            let rest = Duration::from_nanos(until_ns.saturating_sub(monotonic_ns()));
            self.bus.wait(rest.min(Duration::from_millis(5))).map_err(Failure::run)?;
        }
        Ok(())
    }

    fn take(&mut self, frame: &can::Frame) {
        if let Some((node, state)) = heartbeat_of(frame) {
            self.found(node).state = Some(named_state(state));
        } else if let Some((node, emergency)) = Emergency::of(frame) {
            self.found(node).emergency = (emergency.code != 0).then_some(emergency.code);
        }
        for (i, node) in NodeId::all().enumerate().take(self.clients.len()) {
            match self.clients[i].take(frame, monotonic_ns()) {
                SdoEvent::Read => {
                    let profile = self.clients[i].number().map(|number| number as u16);
                    self.found(node).profile = profile;
                }
                // It is there, but its profile is not known.
                SdoEvent::Failed(..) => drop(self.found(node)),
                _ => {}
            }
        }
    }

    fn found(&mut self, node: NodeId) -> &mut Found {
        let number = node.number();
        self.found.entry(number).or_insert_with(|| Found { node: number, ..Found::default() })
    }
}

/// What a state is called.
pub fn named_state(state: NodeState) -> &'static str {
    match state {
        NodeState::BootUp => "boot-up",
        NodeState::Stopped => "stopped",
        NodeState::Operational => "operational",
        NodeState::PreOperational => "pre-operational",
    }
}

/// Asks a node who it is. What it does not know stays unknown.
fn identify(found: &mut Found, node: NodeId, dialogue: &mut Dialogue<'_>) {
    let mut number = |index, sub| dialogue.number(node, Object::new(index, sub)).ok().flatten();
    found.vendor = number(0x1018, 1);
    found.product = number(0x1018, 2);
    found.revision = number(0x1018, 3);
    found.serial = number(0x1018, 4);
    found.heartbeat_ms = number(0x1017, 0);
    let name = dialogue.read(node, Object::new(0x1008, 0)).ok();
    found.name = name.map(|name| String::from_utf8_lossy(&name).chars().filter(|c| !c.is_control()).collect());
}

/// Devices of the machine file that were not found.
fn missing(named: &NamedBus, found: &[Found]) -> Vec<String> {
    let is_found = |node: &NodeId| found.iter().any(|found| found.node == node.number());
    let expected = NodeId::all().filter(|node| !is_found(node));
    expected.filter_map(|node| Some(format!("node {} ({})", node.number(), named.device(node)?))).collect()
}

fn text(found: &[Found], named: &NamedBus, errors: u64) -> String {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    let hex = |number: Option<u64>| or_dash(number.map(|number| format!("{number:X}h")));
    let rows = found.iter().map(|node| {
        vec![
            node.node.to_string(),
            or_dash(node.device.clone()),
            or_dash(node.profile.map(|profile| profile.to_string())),
            hex(node.vendor),
            hex(node.product),
            hex(node.revision),
            hex(node.serial),
            or_dash(node.heartbeat_ms.map(|ms| if ms == 0 { "off".to_owned() } else { format!("{ms} ms") })),
            or_dash(node.state.map(str::to_owned)),
            or_dash(node.name.clone()),
        ]
    });
    let header = ["node", "device", "profile", "vendor", "product", "revision", "serial", "heartbeat", "state", "name"];
    let emergencies = found
        .iter()
        .filter_map(|node| node.emergency.map(|code| format!("node {}: emergency {code:04X}h\n", node.node)));
    let emergencies: String = emergencies.collect();
    let errors = if errors > 0 { format!("{errors} errors on the bus\n") } else { String::new() };
    let nodes = if found.len() == 1 { "1 node".to_owned() } else { format!("{} nodes", found.len()) };
    let table = table(&header, rows.collect());
    format!("{table}\n{emergencies}{errors}{}, {} bit/s: {nodes}\n", named.address, named.rates.bus)
}
