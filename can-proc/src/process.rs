//! The stage: valve commands in, encoder readings out, in real time.
//!
//! ```text
//! SYNC ---- positions ---- SYNC ---- positions ----      every can.sync
//!      \__ reading, as soon as all positions are there
//! set points: with every SYNC, and as soon as a command comes
//! ```
//!
//! No reading is sent before all devices are ready for the first time, or `START_PATIENCE_NS` has passed: a machine
//! that is switched on is no fault. A position that has not come when the next SYNC is due is missing in the reading: a
//! sample is of one time, and an encoder that is mute takes no other axis with it. The time of a reading is that of its
//! SYNC, because all encoders take their positions then. A command is looked for every `COMMAND_POLL` while the stage
//! waits for frames: it can wait for one of the two only.

use std::time::Duration;

use can::{
    BitRates, Counters,
    bus::{Address, Bus, BusError, open},
    device::{AxisState, AxisTarget, Demand, Network},
};
use pipeline::{
    channel::{Group, Publisher, Reader},
    machine::Machine,
    message::{EncoderReading, EncoderValue, ValveCommand, control_flag},
    stage::{
        Channels, Next, Stage, StageError, StageKind, StageOptions, Turn, monotonic_ns, run as run_stage, sleep_until,
    },
};

use crate::wiring;

/// Longest time for which a command waits while the stage waits for frames.
const COMMAND_POLL: Duration = Duration::from_micros(250);
/// Most frames that are taken at once: a bus that is full must not keep the stage from its set points.
const MOST_FRAMES: usize = 256;

/// Time between two tries to open a bus that is gone, ns.
const RETRY_NS: u64 = 200_000_000;
/// Time that devices may take to be found, set up and proven before their faults are told, ns.
const START_PATIENCE_NS: u64 = 5_000_000_000;

/// Runs the stage until the last tick of `options` or a signal.
///
/// # Errors
/// The bus cannot be opened, or a channel cannot be used.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let network = wiring::network(machine).map_err(StageError::setup)?;
    let address = wiring::bus_address(machine).map_err(StageError::setup)?;
    let rates = wiring::bit_rates(machine).map_err(StageError::setup)?;
    let bus = open(&address, rates, network.is_flexible()).map_err(StageError::setup)?;
    let wired = Wired { network, bus, address, rates };
    run_stage(StageKind::PlantSim, machine, options, |group, _| Process::new(machine, wired, group))
}

/// An error with what has caused it.
fn full(error: &dyn std::error::Error) -> String {
    let cause = error.source().map(|cause| format!(": {}", full(cause)));
    error.to_string() + &cause.unwrap_or_default()
}

/// The devices, and the open bus.
struct Wired {
    network: Network,
    bus: Box<dyn Bus>,
    address: Address,
    rates: BitRates,
}

struct Process {
    network: Network,
    /// `None` while it is gone.
    bus: Option<Box<dyn Bus>>,
    address: Address,
    rates: BitRates,
    /// When it is tried to open the bus again, ns.
    next_try_ns: u64,
    /// What has happened on the bus before it was opened again.
    before: Counters,
    readings: Publisher<EncoderReading>,
    commands: Reader<ValveCommand>,
    targets: Vec<AxisTarget>,
    /// When the last command came.
    heard_ns: u64,
    drive_timeout_ns: u64,
    sync_ns: u64,
    next_sync_ns: u64,
    /// When the SYNC of the sample was sent, until its reading is sent.
    open_since_ns: Option<u64>,
    sequence: u64,
    /// When readings are sent though devices are not ready, ns.
    patient_until_ns: u64,
}

impl Process {
    fn new(machine: &Machine, wired: Wired, group: &Group) -> Result<Self, StageError> {
        let now_ns = monotonic_ns();
        Ok(Self {
            network: wired.network,
            bus: Some(wired.bus),
            address: wired.address,
            rates: wired.rates,
            next_try_ns: 0,
            before: Counters::default(),
            readings: group.publisher()?,
            commands: group.reader()?,
            targets: vec![target(None); machine.axes.len()],
            heard_ns: now_ns,
            drive_timeout_ns: machine.timing.drive_timeout.as_nanos() as u64,
            sync_ns: machine.can.as_ref().map_or(machine.timing.period, |can| can.sync).as_nanos() as u64,
            next_sync_ns: now_ns,
            open_since_ns: None,
            sequence: 0,
            patient_until_ns: now_ns + START_PATIENCE_NS,
        })
    }

    /// Hands the frames of the network to the bus.
    fn send(&mut self) {
        let frames = self.network.outbox();
        let sent = self.bus.as_mut().map(|bus| {
            frames.frames().iter().try_for_each(|frame| bus.send(frame).map(|_| ()))?;
            bus.flush()
        });
        frames.clear();
        if let Some(Err(error)) = sent {
            self.lose(&error);
        }
    }

    /// Takes the frames that have come. A controller that has gone bus-off reaches no device, even if it is back soon.
    fn receive(&mut self) {
        let before = self.bus.as_ref().map_or(0, |bus| bus.counters().bus_off);
        for _ in 0..MOST_FRAMES {
            match self.bus.as_mut().map(|bus| bus.receive()) {
                Some(Ok(Some(received))) => self.network.take(&received, monotonic_ns()),
                Some(Err(error)) => self.lose(&error),
                Some(Ok(None)) | None => break,
            }
        }
        if self.bus.as_ref().is_some_and(|bus| bus.counters().bus_off > before) {
            self.lose(&BusError::Off);
        }
    }

    /// The bus is gone. No valve can be reached: the drives stop by their own time-outs.
    fn lose(&mut self, error: &BusError) {
        self.before = self.counters();
        eprintln!("can-proc: {}: {}; waits for it", self.address, full(error));
        let now_ns = monotonic_ns();
        (self.bus, self.next_try_ns, self.open_since_ns) = (None, now_ns + RETRY_NS, None);
        self.network.lose_bus(now_ns);
    }

    /// What has happened on the bus since the start.
    fn counters(&self) -> Counters {
        self.bus.as_ref().map_or(self.before, |bus| self.before + *bus.counters())
    }

    /// Waits for frames; without a bus it is opened again. Only then this stage allocates, opens a file and waits for
    /// an answer: there is nothing that it could control.
    fn wait(&mut self) {
        let rest = Duration::from_nanos(self.next_sync_ns.saturating_sub(monotonic_ns())).min(COMMAND_POLL);
        match self.bus.as_mut().map(|bus| bus.wait(rest)) {
            Some(Ok(())) => {}
            Some(Err(error)) => self.lose(&error),
            None if monotonic_ns() < self.next_try_ns => sleep_until(monotonic_ns() + rest.as_nanos() as u64),
            None => {
                self.bus = open(&self.address, self.rates, self.network.is_flexible()).ok();
                self.next_try_ns = monotonic_ns() + RETRY_NS;
                if self.bus.is_some() {
                    eprintln!("can-proc: {}: is back", self.address);
                }
            }
        }
    }

    /// Takes the newest command; without one for the drive's time-out all valves are held.
    fn command(&mut self) -> Result<(), StageError> {
        let now_ns = monotonic_ns();
        if self.commands.newest()?.if_new().is_some()
            && let Some(command) = self.commands.last()
        {
            for (i, target_of) in self.targets.iter_mut().enumerate() {
                *target_of = target(Some((command, i)));
            }
            self.heard_ns = now_ns;
            self.network.command(Some(&self.targets), now_ns);
        } else if now_ns.saturating_sub(self.heard_ns) > self.drive_timeout_ns {
            self.heard_ns = now_ns;
            self.network.command(None, now_ns);
        }
        Ok(())
    }

    /// Sends SYNC where it is due. A SYNC that is late by more than a period leaves those out that have passed.
    fn begin(&mut self, turn: &mut Turn) -> Result<(), StageError> {
        let due_ns = self.next_sync_ns;
        if monotonic_ns() < due_ns {
            return Ok(());
        }
        // What has come while this stage had no core is judged before what is missing.
        self.receive();
        if self.network.is_over(monotonic_ns(), self.sync_ns) {
            self.publish(turn)?;
        }
        let now_ns = turn.release(due_ns);
        let passed = now_ns.saturating_sub(due_ns) / self.sync_ns;
        self.next_sync_ns = due_ns + (passed + 1) * self.sync_ns;
        if self.bus.is_some() {
            self.network.begin(now_ns);
            self.open_since_ns = Some(now_ns);
            self.send();
        }
        Ok(())
    }

    /// Sends the reading of the SYNC.
    fn publish(&mut self, turn: &mut Turn) -> Result<(), StageError> {
        let Some(acquired_ns) = self.open_since_ns.take() else { return Ok(()) };
        if self.sequence == 0 && !self.network.was_ready() && acquired_ns < self.patient_until_ns {
            return Ok(());
        }
        let emergency_stop = u32::from(self.network.is_stopped());
        let acquired_ns = self.network.take_sample(acquired_ns);
        let mut reading = EncoderReading { emergency_stop, ..EncoderReading::default() };
        for (i, value) in reading.encoders.iter_mut().enumerate().take(self.targets.len()) {
            if let Some((counts, error)) = self.network.reading(i) {
                value.counts = counts.unwrap_or_default();
                value.error = if (counts, error) == (None, 0) { EncoderValue::NOT_READ } else { error };
            }
            if let Some([piston, rod]) = self.network.pressures(i) {
                (value.piston_pressure, value.rod_pressure, value.has_pressures) = (piston, rod, 1);
            }
        }
        reading.header.axis_count = self.targets.len() as u32;
        turn.finish(&mut reading.header, self.sequence, acquired_ns, acquired_ns);
        self.sequence += 1;
        self.readings.send(&reading)?;
        Ok(())
    }
}

/// What a command says of an axis; without one the valve is held.
fn target(command: Option<(&ValveCommand, usize)>) -> AxisTarget {
    let Some((command, axis)) = command.and_then(|(command, i)| Some((command, command.axes.get(i)?))) else {
        return AxisTarget { demand: Demand::Hold, state: AxisState::Disarmed };
    };
    AxisTarget {
        demand: if command.cut_off != 0 { Demand::Off } else { Demand::Follow(axis.command) },
        state: match axis.flags {
            flags if flags & control_flag::LATCHED != 0 => AxisState::Latched,
            flags if flags & control_flag::DISARMED != 0 => AxisState::Disarmed,
            flags if flags & control_flag::SETTLING != 0 => AxisState::Settling,
            _ => AxisState::Following,
        },
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        self.begin(turn)?;
        let mut has_worked = false;
        self.wait();
        self.receive();
        self.command()?;
        self.send();
        if self.open_since_ns.is_some() && self.network.is_ready(monotonic_ns(), self.sync_ns) {
            self.publish(turn)?;
            has_worked = true;
        }
        if self.commands.last().is_some_and(|command| turn.is_last(command.header.sequence)) {
            return Ok(Next::Finished);
        }
        Ok(if has_worked { Next::Worked } else { Next::Waiting })
    }

    fn greet(&self) {
        self.readings.greet();
    }

    /// All valves are switched off. Then the loop is over, and what has happened on the bus is told.
    fn stop(&mut self) -> Result<(), StageError> {
        self.network.end(monotonic_ns());
        self.send();
        let (all, network) = (self.counters(), self.network.counters());
        eprintln!(
            "can-proc: {}: {all}; {} foreign frames, {} of {} SYNC without all positions",
            self.address, network.foreign, network.incomplete, network.syncs
        );
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.commands);
    }
}
