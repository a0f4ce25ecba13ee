//! `hydraxis can simulate`: the devices of a machine on a bus, with the simulated machine behind them.
//!
//! ```text
//! can-proc <--slcan--> pseudo terminal <--> encoders, valves <--> PlantSim
//! can-proc <---- interface vcan0 -----> <--> encoders, valves <--> PlantSim
//! ```
//!
//! Every millisecond the openings of the valves command the simulated machine, and its encoders get the counts of their
//! axes. All but the wire is what runs on hardware.
//!
//! | file | what it is |
//! |---|---|
//! | `devices` | encoder and valve of each axis |
//! | `wire` | pseudo terminal with its link, or interface; faults of the bus |
//! | `faults` | faults as lines of text |
//! | `watch` | says when a valve opens and when it is neutral again |

mod devices;
mod faults;
mod watch;
mod wire;

use std::{io::BufRead, sync::atomic::Ordering, sync::mpsc, thread, time::Duration};

use can::{bus::Address, device::Outbox};
use clap::Args;
use pipeline::{
    machine::Machine,
    stage::{monotonic_ns, sleep_until},
};
use plant_sim::PlantSim;

use self::{
    devices::Devices,
    faults::{FAULTS, Fault},
    watch::Watch,
    wire::Wire,
};
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

The machine file has source.kind = \"can\", the nodes or messages of its devices, and the twin that is simulated
behind them ([axis.NAME.plant]). A pseudo terminal takes the place of an adapter that speaks slcan; --at is a link to
it. An interface of the kernel, such as --at vcan0, is there already. Ctrl-C ends it: for the group that is an adapter
that was unplugged.

With --faults each line of the standard input is a fault: AXIS.encoder, AXIS.valve, machine or bus, and one of
  mute, restart, babble, double, emergency CODE, number NODE     a device
  alarm BITS                                                     an encoder
  stuck PART, fail CODE, no-timeout                              a valve
  hung, wrong                                                    the message that has a position
  stopped, cut-off                                               the machine, where its messages say so
  unplugged, off, full                                           the bus
  well                                                           the end of a fault
What is typed and each opening and closing of a valve is told with its time, which is that at the simulated machine.
  (sleep 10; echo boom.encoder mute; sleep 5; echo boom.encoder well) | hydraxis can simulate .. --faults")]
pub struct SimulateBusArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Link to the pseudo terminal, made at the start and removed at the end; or an interface such as vcan0
    #[arg(long, value_name = "PATH")]
    pub at: Address,
    /// Take faults from the standard input, one on each line
    #[arg(long)]
    pub faults: bool,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
}

/// Runs the command.
pub fn run(arguments: &SimulateBusArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?;
    let stop = stop_flag()?;
    let mut devices = Devices::new(&machine)?;
    let mut plant = plant(&machine, arguments.seed)?;
    let rates = can_proc::bit_rates(&machine).map_err(Failure::usage)?;
    let mut wire = Wire::open(&arguments.at, rates, devices.is_flexible())?;
    let lines = arguments.faults.then(typed_lines);
    eprintln!("{}: devices at {wire}, Ctrl-C ends them", machine.name);
    let (mut out, mut next_ns) = (Outbox::default(), monotonic_ns());
    let mut watch = Watch::new(next_ns);
    let step_ns = STEP.as_nanos() as u64;
    while !stop.load(Ordering::Relaxed) {
        for line in lines.iter().flat_map(mpsc::Receiver::try_iter) {
            match inject(&line, &mut devices, &mut wire, &mut out) {
                Ok(()) => watch.note_fault(line.trim(), monotonic_ns()),
                Err(error) => eprintln!("{error}"),
            }
        }
        let now_ns = monotonic_ns();
        if now_ns >= next_ns {
            let steps = ((now_ns - next_ns) / step_ns + 1).min(MOST_STEPS);
            next_ns = now_ns + step_ns;
            devices.move_on(&mut plant, steps, STEP);
            devices.step(now_ns, &mut out);
            if arguments.faults {
                watch.look(&devices, now_ns);
            }
            wire.step();
        }
        wire.exchange(&mut devices, &mut out)?;
        wire.wait(next_ns)?;
        if wire.is_silent() {
            sleep_until(next_ns);
        }
    }
    Ok(())
}

/// The lines of the standard input, as they come.
fn typed_lines() -> mpsc::Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || std::io::stdin().lock().lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    receiver
}

fn inject(line: &str, devices: &mut Devices, wire: &mut Wire, out: &mut Outbox) -> Result<(), String> {
    match Fault::parse(line, devices.names())? {
        Fault::Bus(fault) => wire.spoil(fault).map_err(|error| format!("bus: {error}; {FAULTS}")),
        Fault::Machine(fault) => devices.spoil_machine(fault).map_err(|error| format!("machine: {error}")),
        Fault::Encoder(place, fault) => devices.spoil_encoder(place, fault, out),
        Fault::Valve(place, fault) => devices.spoil_valve(place, fault, out),
    }
}

fn plant(machine: &Machine, seed: u64) -> Result<PlantSim, Failure> {
    let twin = machine.clone().into_twin();
    if twin.source.is_real() {
        let allowed = "tables [axis.NAME.plant], [supply] and [oil] for the machine that is simulated behind the bus";
        return Err(Failure::usage(format!("axis: found no twin; allowed: {allowed}")));
    }
    PlantSim::new(&twin, seed).map_err(Failure::usage)
}
