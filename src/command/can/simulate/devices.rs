//! The simulated encoder and valve of each axis, and the messages of a machine that has its own.

use std::time::Duration;

use can::{
    Frame,
    canopen::NodeId,
    device::{Outbox, PositionObject},
    simulated::{Flaw, SimulatedEncoder, SimulatedFrames, SimulatedValve},
};
use pipeline::{
    machine::{Axis, Machine},
    message::ValveCommand,
    stage::monotonic_ns,
};
use plant_sim::PlantSim;

use super::faults::{DeviceFault, MachineFault};
use crate::failure::Failure;

/// An encoder.
struct EncoderNode {
    device: SimulatedEncoder,
    number: NodeId,
    object: PositionObject,
    step: u32,
    /// How it is mounted.
    is_reversed: bool,
    zero: i64,
}

/// A valve.
struct ValveNode {
    device: SimulatedValve,
    number: NodeId,
    full_scale: i16,
}

/// Nodes of one axis. What it has not is in messages.
struct AxisNodes {
    encoder: Option<EncoderNode>,
    valve: Option<ValveNode>,
}

/// Devices of all axes.
pub struct Devices {
    axes: Vec<AxisNodes>,
    names: Vec<String>,
    frames: SimulatedFrames,
}

impl Devices {
    /// Those of a machine file.
    ///
    /// # Errors
    /// An axis has no devices, or a message is none.
    pub fn new(machine: &Machine) -> Result<Self, Failure> {
        let network = can_proc::network(machine).map_err(Failure::usage)?;
        let axes = machine.axes.iter().map(AxisNodes::new).collect();
        let names = machine.axes.iter().map(|axis| axis.name.clone()).collect();
        Ok(Self {
            axes,
            names,
            frames: SimulatedFrames::new(network.frames(), machine.timing.period.as_nanos() as u64),
        })
    }

    /// Whether messages are of CAN FD.
    pub fn is_flexible(&self) -> bool {
        self.frames.is_flexible()
    }

    /// Names of the axes.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// How far the valve of each axis is open, -1 to 1; 0 of an axis without one.
    pub fn openings(&self) -> impl Iterator<Item = f64> {
        self.axes.iter().enumerate().map(|(i, axis)| match &axis.valve {
            Some(valve) => valve.device.opening(),
            None => self.frames.opening(i).unwrap_or_default(),
        })
    }

    /// Moves the machine on under the openings of the valves; the encoders see where it is.
    pub fn move_on(&mut self, plant: &mut PlantSim, steps: u64, step: Duration) {
        let mut command = ValveCommand::default();
        for (axis, opening) in command.axes.iter_mut().zip(self.openings()) {
            axis.command = opening.clamp(-1.0, 1.0);
        }
        for _ in 0..steps {
            plant.command(&command);
            plant.advance(step);
        }
        let reading = plant.read();
        for (i, (nodes, value)) in self.axes.iter_mut().zip(&reading.encoders).enumerate() {
            if let Some(encoder) = &mut nodes.encoder {
                let counts = if encoder.is_reversed { -value.counts } else { value.counts };
                encoder.device.set_counts(encoder.zero + counts);
            }
            self.frames.set_counts(i, value.counts);
            self.frames.set_pressures(i, [value.piston_pressure, value.rod_pressure]);
        }
    }

    /// Sends what is due.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        for AxisNodes { encoder, valve } in &mut self.axes {
            encoder.iter_mut().for_each(|encoder| encoder.device.step(now_ns, out));
            valve.iter_mut().for_each(|valve| valve.device.step(now_ns, out));
        }
        self.frames.step(now_ns, out);
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, out: &mut Outbox) {
        let now_ns = monotonic_ns();
        for AxisNodes { encoder, valve } in &mut self.axes {
            encoder.iter_mut().for_each(|encoder| encoder.device.take(frame, out));
            valve.iter_mut().for_each(|valve| valve.device.take(frame, now_ns, out));
        }
        self.frames.take(frame, now_ns);
    }

    /// A fault of the encoder of an axis, or of the message that has its position.
    ///
    /// # Errors
    /// It has no such fault.
    pub fn spoil_encoder(&mut self, place: usize, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        match self.axes.get_mut(place).and_then(|nodes| nodes.encoder.as_mut()) {
            Some(encoder) => encoder.spoil(fault, out),
            None => {
                let flaw = message_flaw(fault).filter(|flaw| *flaw != Some(Flaw::NoTimeout));
                self.frames.spoil_position(place, flaw.ok_or("a message has no such fault")?);
                Ok(())
            }
        }
    }

    /// A fault of the valve of an axis, or of the drive that a message commands.
    ///
    /// # Errors
    /// It has no such fault, or the axis has no valve.
    pub fn spoil_valve(&mut self, place: usize, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        match (self.axes.get_mut(place).and_then(|nodes| nodes.valve.as_mut()), fault) {
            (Some(valve), _) => return valve.spoil(fault, out),
            (None, _) if !self.frames.has_drive(place) => return Err("the axis has no valve".to_owned()),
            (None, DeviceFault::Stuck(part)) => self.frames.stick(place, Some(part)),
            (None, DeviceFault::Well) => {
                self.frames.stick(place, None);
                self.frames.spoil_drive(place, None);
            }
            (None, DeviceFault::Mute) => self.frames.spoil_drive(place, Some(Flaw::Mute)),
            (None, DeviceFault::NoTimeout) => self.frames.spoil_drive(place, Some(Flaw::NoTimeout)),
            _ => return Err("a drive that a message commands has no such fault".to_owned()),
        }
        Ok(())
    }

    /// A fault of the machine: its emergency stop, or its pilot pressure.
    ///
    /// # Errors
    /// No message says so.
    pub fn spoil_machine(&mut self, fault: MachineFault) -> Result<(), String> {
        let (says_stop, says_pilot) = self.frames.interlocks();
        match fault {
            MachineFault::Well => {
                self.frames.stop(false);
                self.frames.cut_off(false);
            }
            MachineFault::Stopped if says_stop => self.frames.stop(true),
            MachineFault::CutOff if says_pilot => self.frames.cut_off(true),
            MachineFault::Stopped => return Err("no message of the machine says so: can.emergency_stop".to_owned()),
            MachineFault::CutOff => return Err("no message of the machine says so: can.pilot".to_owned()),
        }
        Ok(())
    }
}

/// The flaw of a message, which may be the end of one.
fn message_flaw(fault: DeviceFault) -> Option<Option<Flaw>> {
    match fault {
        DeviceFault::Well => Some(None),
        DeviceFault::Hung => Some(Some(Flaw::Hung)),
        DeviceFault::Wrong => Some(Some(Flaw::Wrong)),
        _ => flaw(fault).map(Some),
    }
}

/// The flaw that stays until it is taken away.
fn flaw(fault: DeviceFault) -> Option<Flaw> {
    match fault {
        DeviceFault::Mute => Some(Flaw::Mute),
        DeviceFault::Babble => Some(Flaw::Babble),
        DeviceFault::Double => Some(Flaw::Double),
        DeviceFault::NoTimeout => Some(Flaw::NoTimeout),
        _ => None,
    }
}

impl EncoderNode {
    fn new(axis: &Axis) -> Option<Self> {
        let wired = axis.can.as_ref()?;
        let number = NodeId::new(wired.encoder?)?;
        // A step that is none of a device is not compared either.
        let (object, step) = (can_proc::position_object(wired), can_proc::step(axis).unwrap_or(1));
        let device = SimulatedEncoder::new(number, object, step);
        Some(Self { device, number, object, step, is_reversed: wired.is_reversed, zero: wired.zero })
    }

    fn spoil(&mut self, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        let numbered = |number| SimulatedEncoder::new(number, self.object, self.step);
        match (fault, flaw(fault)) {
            (_, Some(flaw)) => self.device.spoil(Some(flaw)),
            (DeviceFault::Well, _) => {
                self.device.spoil(None);
                self.device.alarm(0);
                self.device.emergency(0, out);
            }
            (DeviceFault::Restart, _) => self.device.restart(),
            (DeviceFault::Emergency(code), _) => self.device.emergency(code, out),
            (DeviceFault::Alarm(alarms), _) => self.device.alarm(alarms),
            (DeviceFault::Number(number), _) => self.device = numbered(number),
            _ => return Err("an encoder has no such fault".to_owned()),
        }
        if fault == DeviceFault::Well && self.device.id() != self.number {
            self.device = numbered(self.number);
        }
        Ok(())
    }
}

impl ValveNode {
    fn new(axis: &Axis) -> Option<Self> {
        let wired = axis.can.as_ref()?;
        let number = NodeId::new(wired.valve?)?;
        Some(Self { device: SimulatedValve::new(number, wired.full_scale), number, full_scale: wired.full_scale })
    }

    fn spoil(&mut self, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        match (fault, flaw(fault)) {
            (_, Some(flaw)) => self.device.spoil(Some(flaw)),
            (DeviceFault::Well, _) => {
                self.device.spoil(None);
                self.device.stick(None);
                self.device.emergency(0, out);
            }
            (DeviceFault::Restart, _) => self.device.restart(),
            (DeviceFault::Emergency(code), _) => self.device.emergency(code, out),
            (DeviceFault::Fail(code), _) => self.device.fail(code, out),
            (DeviceFault::Stuck(part), _) => self.device.stick(Some(part)),
            (DeviceFault::Number(number), _) => self.device = SimulatedValve::new(number, self.full_scale),
            _ => return Err("a valve has no such fault".to_owned()),
        }
        if fault == DeviceFault::Well && self.device.id() != self.number {
            self.device = SimulatedValve::new(self.number, self.full_scale);
        }
        Ok(())
    }
}

impl AxisNodes {
    fn new(axis: &Axis) -> Self {
        Self { encoder: EncoderNode::new(axis), valve: ValveNode::new(axis) }
    }
}
