//! The simulated encoder and valve of each axis.

use std::time::Duration;

use can::{
    Frame,
    canopen::NodeId,
    device::{Outbox, PositionObject},
    simulated::{Flaw, SimulatedEncoder, SimulatedValve},
};
use pipeline::{
    machine::{Axis, Machine},
    message::ValveCommand,
    stage::monotonic_ns,
};
use plant_sim::PlantSim;

use super::faults::DeviceFault;
use crate::failure::Failure;

/// Devices of one axis.
struct AxisDevices {
    encoder: SimulatedEncoder,
    object: PositionObject,
    step: u32,
    /// How the encoder is mounted.
    is_reversed: bool,
    zero: i64,
    valve: Option<SimulatedValve>,
    full_scale: i16,
    /// Numbers of encoder and valve.
    numbers: (NodeId, Option<NodeId>),
}

/// Devices of all axes.
pub struct Devices {
    axes: Vec<AxisDevices>,
    names: Vec<String>,
}

impl Devices {
    /// Those of a machine file.
    ///
    /// # Errors
    /// An axis has no nodes.
    pub fn new(machine: &Machine) -> Result<Self, Failure> {
        let axes = machine.axes.iter().map(AxisDevices::new).collect::<Result<_, _>>()?;
        Ok(Self { axes, names: machine.axes.iter().map(|axis| axis.name.clone()).collect() })
    }

    /// Names of the axes.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// How far the valve of each axis is open, -1 to 1; 0 of an axis without one.
    pub fn openings(&self) -> impl Iterator<Item = f64> {
        self.axes.iter().map(|axis| axis.valve.as_ref().map_or(0.0, SimulatedValve::opening))
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
        for (device, value) in self.axes.iter_mut().zip(&reading.encoders) {
            let counts = if device.is_reversed { -value.counts } else { value.counts };
            device.encoder.set_counts(device.zero + counts);
        }
    }

    /// Sends what is due.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        for AxisDevices { encoder, valve, .. } in &mut self.axes {
            encoder.step(now_ns, out);
            valve.iter_mut().for_each(|valve| valve.step(now_ns, out));
        }
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, out: &mut Outbox) {
        for AxisDevices { encoder, valve, .. } in &mut self.axes {
            encoder.take(frame, out);
            valve.iter_mut().for_each(|valve| valve.take(frame, monotonic_ns(), out));
        }
    }

    /// A fault of the encoder of an axis.
    ///
    /// # Errors
    /// Encoders have no such fault.
    pub fn spoil_encoder(&mut self, place: usize, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        let Some(device) = self.axes.get_mut(place) else { return Ok(()) };
        let encoder = &mut device.encoder;
        match (fault, flaw(fault)) {
            (_, Some(flaw)) => encoder.spoil(Some(flaw)),
            (DeviceFault::Well, _) => {
                encoder.spoil(None);
                encoder.alarm(0);
                encoder.emergency(0, out);
            }
            (DeviceFault::Restart, _) => encoder.restart(),
            (DeviceFault::Emergency(code), _) => encoder.emergency(code, out),
            (DeviceFault::Alarm(alarms), _) => encoder.alarm(alarms),
            (DeviceFault::Number(number), _) => *encoder = SimulatedEncoder::new(number, device.object, device.step),
            _ => return Err("an encoder has no such fault".to_owned()),
        }
        if fault == DeviceFault::Well && encoder.id() != device.numbers.0 {
            *encoder = SimulatedEncoder::new(device.numbers.0, device.object, device.step);
        }
        Ok(())
    }

    /// A fault of the valve of an axis.
    ///
    /// # Errors
    /// The axis has no valve, or valves have no such fault.
    pub fn spoil_valve(&mut self, place: usize, fault: DeviceFault, out: &mut Outbox) -> Result<(), String> {
        let Some(device) = self.axes.get_mut(place) else { return Ok(()) };
        let (Some(valve), Some(number)) = (&mut device.valve, device.numbers.1) else {
            return Err("the axis has no valve".to_owned());
        };
        match (fault, flaw(fault)) {
            (_, Some(flaw)) => valve.spoil(Some(flaw)),
            (DeviceFault::Well, _) => {
                valve.spoil(None);
                valve.stick(None);
                valve.emergency(0, out);
            }
            (DeviceFault::Restart, _) => valve.restart(),
            (DeviceFault::Emergency(code), _) => valve.emergency(code, out),
            (DeviceFault::Fail(code), _) => valve.fail(code, out),
            (DeviceFault::Stuck(part), _) => valve.stick(Some(part)),
            (DeviceFault::Number(number), _) => *valve = SimulatedValve::new(number, device.full_scale),
            _ => return Err("a valve has no such fault".to_owned()),
        }
        if fault == DeviceFault::Well && valve.id() != number {
            *valve = SimulatedValve::new(number, device.full_scale);
        }
        Ok(())
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

impl AxisDevices {
    fn new(axis: &Axis) -> Result<Self, Failure> {
        let missing = || Failure::usage(format!("axis.{}.can: found nothing; allowed: a table with nodes", axis.name));
        let wired = axis.can.as_ref().ok_or_else(missing)?;
        // A step that is none of a device is not compared either.
        let step = can_proc::step(axis).unwrap_or(1);
        let node = |number| NodeId::new(number).ok_or_else(missing);
        let (encoder, valve) = (node(wired.encoder.unwrap_or_default())?, wired.valve.map(node).transpose()?);
        let object = can_proc::position_object(wired);
        Ok(Self {
            encoder: SimulatedEncoder::new(encoder, object, step),
            object,
            step,
            is_reversed: wired.is_reversed,
            zero: wired.zero,
            valve: valve.map(|id| SimulatedValve::new(id, wired.full_scale)),
            full_scale: wired.full_scale,
            numbers: (encoder, valve),
        })
    }
}
