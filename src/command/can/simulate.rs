//! `hydraxis can simulate`: the devices of a machine on a bus, with the simulated machine behind them.
//!
//! ```text
//! can-proc <--slcan--> pseudo terminal <--> encoders, valves <--> PlantSim
//! ```
//!
//! Every millisecond the openings of the valves command the simulated machine, and its encoders get the counts of their
//! axes. All but the wire is what runs on hardware.

use std::{
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Duration,
};

use can::{
    bus::{Bus, BusError, SlcanBus, pseudo_terminal},
    canopen::NodeId,
    device::Outbox,
    simulated::{SimulatedEncoder, SimulatedValve},
};
use clap::Args;
use pipeline::{
    machine::{Axis, Machine},
    message::ValveCommand,
    stage::{monotonic_ns, sleep_until},
};
use plant_sim::PlantSim;

use crate::{
    arguments::{MachineFile, load, values::whole},
    failure::Failure,
    group::signals::stop_flag,
};

/// Step of the devices and of the machine.
const STEP: Duration = Duration::from_millis(1);
/// Most steps that are made up for at once, after a time without a core.
const MOST_STEPS: u64 = 100;

/// `can simulate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Example, a terminal for each line:
  hydraxis can simulate machine.toml --at /tmp/can
  hydraxis run machine.toml --set 'can.interface=\"/tmp/can\"'

The machine file has source.kind = \"can\", the nodes of its devices, and the twin that is simulated behind them
([axis.NAME.plant]). A pseudo terminal takes the place of an adapter that speaks slcan; --at is a link to it. Ctrl-C
ends it: for the group that is an adapter that was unplugged.")]
pub struct SimulateBusArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Link to the pseudo terminal, made at the start and removed at the end
    #[arg(long, value_name = "PATH")]
    pub at: PathBuf,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
}

/// The link to the pseudo terminal, which is removed at the end.
struct Link<'p>(&'p Path);

impl Drop for Link<'_> {
    fn drop(&mut self) {
        let _ = fs::remove_file(self.0);
    }
}

/// Devices of one axis.
struct Devices {
    encoder: SimulatedEncoder,
    /// How the encoder is mounted.
    is_reversed: bool,
    zero: i64,
    valve: Option<SimulatedValve>,
}

/// Runs the command.
pub fn run(arguments: &SimulateBusArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?;
    let stop = stop_flag()?;
    let mut devices = machine.axes.iter().map(devices).collect::<Result<Vec<_>, _>>()?;
    let mut plant = plant(&machine, arguments.seed)?;
    let (adapter, path) = pseudo_terminal().map_err(Failure::run)?;
    let at = &arguments.at;
    symlink(&path, at).map_err(|error| Failure::usage(format!("--at: {}: {error}", at.display())))?;
    let _link = Link(at);
    let mut bus = SlcanBus::adapter(adapter).map_err(Failure::run)?;
    eprintln!("{}: devices at {} ({path}), Ctrl-C ends them", machine.name, at.display());
    let (mut out, mut next_ns) = (Outbox::default(), monotonic_ns());
    let step_ns = STEP.as_nanos() as u64;
    while !stop.load(Ordering::Relaxed) {
        let now_ns = monotonic_ns();
        if now_ns >= next_ns {
            let steps = ((now_ns - next_ns) / step_ns + 1).min(MOST_STEPS);
            next_ns = now_ns + step_ns;
            advance(&mut plant, &mut devices, steps);
            for Devices { encoder, valve, .. } in &mut devices {
                encoder.step(now_ns, &mut out);
                valve.iter_mut().for_each(|valve| valve.step(now_ns, &mut out));
            }
        }
        match exchange(&mut bus, &mut devices, &mut out) {
            // Nobody has the other end open.
            Err(BusError::Gone(_)) => sleep_until(next_ns),
            other => other.map_err(Failure::run)?,
        }
        let rest = Duration::from_nanos(next_ns.saturating_sub(monotonic_ns()));
        match bus.wait(rest) {
            Err(BusError::Gone(_)) => sleep_until(next_ns),
            other => other.map_err(Failure::run)?,
        }
    }
    Ok(())
}

fn plant(machine: &Machine, seed: u64) -> Result<PlantSim, Failure> {
    let twin = machine.clone().into_twin();
    if twin.source.is_real() {
        let allowed = "tables [axis.NAME.plant], [supply] and [oil] for the machine that is simulated behind the bus";
        return Err(Failure::usage(format!("axis: found no twin; allowed: {allowed}")));
    }
    PlantSim::new(&twin, seed).map_err(Failure::usage)
}

fn devices(axis: &Axis) -> Result<Devices, Failure> {
    let missing = || Failure::usage(format!("axis.{}.can: found nothing; allowed: a table with nodes", axis.name));
    let wired = axis.can.as_ref().ok_or_else(missing)?;
    // A step that is none of a device is not compared either.
    let step = can_proc::step(axis).unwrap_or(1);
    let node = |number| NodeId::new(number).ok_or_else(missing);
    let valve = wired.valve.map(node).transpose()?;
    Ok(Devices {
        encoder: SimulatedEncoder::new(
            node(wired.encoder.unwrap_or_default())?,
            can_proc::position_object(wired),
            step,
        ),
        is_reversed: wired.is_reversed,
        zero: wired.zero,
        valve: valve.map(|id| SimulatedValve::new(id, wired.full_scale)),
    })
}

/// Moves the machine on under the openings of the valves; the encoders see where it is.
fn advance(plant: &mut PlantSim, devices: &mut [Devices], steps: u64) {
    let mut command = ValveCommand::default();
    for (axis, Devices { valve, .. }) in command.axes.iter_mut().zip(devices.iter()) {
        axis.command = valve.as_ref().map_or(0.0, SimulatedValve::opening).clamp(-1.0, 1.0);
    }
    for _ in 0..steps {
        plant.command(&command);
        plant.advance(STEP);
    }
    let reading = plant.read();
    for (device, value) in devices.iter_mut().zip(&reading.encoders) {
        let counts = if device.is_reversed { -value.counts } else { value.counts };
        device.encoder.set_counts(device.zero + counts);
    }
}

/// Takes the frames that have come, and sends what the devices answer.
fn exchange(bus: &mut SlcanBus, devices: &mut [Devices], out: &mut Outbox) -> Result<(), BusError> {
    while let Some(received) = bus.receive()? {
        for Devices { encoder, valve, .. } in devices.iter_mut() {
            encoder.take(&received.frame, out);
            valve.iter_mut().for_each(|valve| valve.take(&received.frame, monotonic_ns(), out));
        }
        send(bus, out)?;
    }
    send(bus, out)
}

fn send(bus: &mut SlcanBus, out: &mut Outbox) -> Result<(), BusError> {
    for frame in out.frames() {
        bus.send(frame)?;
    }
    out.clear();
    bus.flush()
}
