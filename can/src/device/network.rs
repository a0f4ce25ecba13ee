//! All devices of a machine.
//!
//! ```text
//! SYNC k --> positions of all encoders --> one sample
//! fault of a device of an axis --> the axis is held, until the fault is over and the controller has let the axis go
//! ```
//!
//! The interlock: an axis whose encoder or valve has a fault is held at once. Its error word stays until the controller
//! shows by its flags that it has latched or disarmed the axis. So no fault is too short for the controller, and no
//! axis goes on by itself after one. A fault that the valve itself keeps is reset when the axis is disarmed: when a
//! person has acknowledged the latch.
//!
//! Devices that become ready for the first time have no error to show. Their axis follows no command either before the
//! controller has shown once that it is latched or disarmed: a program that is started anew beside a controller that is
//! armed moves nothing.

use super::{Cause, Demand, Encoder, Fault, Outbox, Valve};
use crate::{Received, canopen::sync};

/// Devices of one axis.
#[derive(Debug, Clone)]
pub struct AxisDevices {
    /// Its encoder.
    pub encoder: Encoder,
    /// Its valve; without one the axis is only read.
    pub valve: Option<Valve>,
}

/// What the controller says of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTarget {
    /// What its valve is to do.
    pub demand: Demand,
    /// The axis is not armed.
    pub is_disarmed: bool,
    /// A fault has latched the axis.
    pub is_latched: bool,
}

/// Numbers of events since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NetworkCounters {
    /// SYNC that were sent.
    pub syncs: u64,
    /// SYNC for which a position was missing: they are no sample.
    pub incomplete: u64,
    /// Frames that belong to no device.
    pub foreign: u64,
    /// Times at which an axis was held because of a fault.
    pub trips: u64,
}

#[derive(Debug, Clone)]
struct Axis {
    devices: AxisDevices,
    /// Why the axis is held.
    held: Option<Fault>,
    /// Whether the devices have been ready.
    was_ready: bool,
    /// Whether the controller has let the axis go since it was held.
    may_follow: bool,
    target: Option<AxisTarget>,
}

/// All devices of a machine.
#[derive(Debug, Clone)]
pub struct Network {
    axes: Vec<Axis>,
    outbox: Outbox,
    counters: NetworkCounters,
}

impl Network {
    /// Devices that have not been heard yet; all axes are held.
    pub fn new(devices: Vec<AxisDevices>) -> Self {
        let axes = devices.into_iter().map(|devices| {
            let held = devices.encoder.fault();
            Axis { devices, held, was_ready: false, may_follow: false, target: None }
        });
        Self { axes: axes.collect(), outbox: Outbox::default(), counters: NetworkCounters::default() }
    }

    /// Sends SYNC: a new sample begins. Devices that are due are set up, and all set points are sent again.
    pub fn begin(&mut self, now_ns: u64) {
        if self.counters.syncs > 0 {
            let is_incomplete = self.axes.iter().any(|axis| !axis.devices.encoder.is_complete());
            self.counters.incomplete += u64::from(is_incomplete);
        }
        self.outbox.push(sync());
        self.counters.syncs += 1;
        for axis in &mut self.axes {
            axis.devices.encoder.begin(now_ns, &mut self.outbox);
            if let Some(valve) = &mut axis.devices.valve {
                valve.begin(now_ns, &mut self.outbox);
            }
        }
        self.interlock(now_ns);
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, received: &Received, now_ns: u64) {
        let mut is_known = false;
        for axis in &mut self.axes {
            is_known |= axis.devices.encoder.take(received, now_ns, &mut self.outbox);
            if let Some(valve) = &mut axis.devices.valve {
                is_known |= valve.take(received, now_ns, &mut self.outbox);
            }
        }
        self.counters.foreign += u64::from(!is_known);
        self.interlock(now_ns);
    }

    /// The bus is gone: all axes are held, and all devices are set up anew once it is back.
    pub fn lose_bus(&mut self, now_ns: u64) {
        for axis in &mut self.axes {
            axis.devices.encoder.lose_bus(now_ns);
            axis.devices.valve.iter_mut().for_each(|valve| valve.lose_bus(now_ns));
        }
        self.interlock(now_ns);
        self.outbox.clear();
    }

    /// Takes what the controller says of all axes; `None` when it has said nothing for the drive's time-out.
    pub fn command(&mut self, targets: Option<&[AxisTarget]>, now_ns: u64) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.target = targets.and_then(|targets| targets.get(i)).copied();
            axis.demand(&mut self.outbox);
        }
        self.interlock(now_ns);
    }

    /// Holds axes with a fault, and lets those go whose fault is over and which the controller has let go.
    fn interlock(&mut self, now_ns: u64) {
        for axis in &mut self.axes {
            let fault = axis.fault();
            match (axis.held, fault) {
                (None, Some(fault)) => {
                    (axis.held, axis.may_follow) = (Some(fault), false);
                    self.counters.trips += 1;
                    axis.demand(&mut self.outbox);
                }
                (Some(held), Some(fault)) => axis.hold_by(held, fault, now_ns),
                (Some(_), None) if axis.is_let_go() || !axis.was_ready => (axis.held, axis.was_ready) = (None, true),
                _ => {}
            }
            axis.may_follow |= axis.held.is_none() && axis.is_let_go();
        }
    }

    /// Whether all devices have been ready at least once.
    pub fn was_ready(&self) -> bool {
        self.axes.iter().all(|axis| axis.was_ready)
    }

    /// Whether the positions of this SYNC have come from all encoders that are not at fault.
    pub fn is_complete(&self) -> bool {
        self.axes.iter().all(|axis| axis.devices.encoder.is_complete())
    }

    /// Counts and error word of an axis in the sample of this SYNC; the word is 0 where nothing is wrong.
    pub fn reading(&self, axis: usize) -> Option<(i64, u32)> {
        let axis = self.axes.get(axis)?;
        Some((axis.devices.encoder.counts(), axis.held.map_or(0, Fault::word)))
    }

    /// All valves are switched off: the last frames of the program.
    pub fn end(&mut self, now_ns: u64) {
        let off = AxisTarget { demand: Demand::Off, is_disarmed: true, is_latched: false };
        for axis in &mut self.axes {
            axis.target = Some(off);
            axis.demand(&mut self.outbox);
        }
        self.interlock(now_ns);
    }

    /// The frames to be sent. Who has sent them clears them.
    pub fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    /// Devices of an axis.
    pub fn devices(&self, axis: usize) -> Option<&AxisDevices> {
        self.axes.get(axis).map(|axis| &axis.devices)
    }

    /// What has happened so far.
    pub fn counters(&self) -> &NetworkCounters {
        &self.counters
    }
}

impl Axis {
    fn fault(&self) -> Option<Fault> {
        let valve = self.devices.valve.as_ref().and_then(Valve::fault);
        self.devices.encoder.fault().or(valve)
    }

    /// Tells the valve what to do: hold, where the axis is held or nobody commands it.
    fn demand(&mut self, out: &mut Outbox) {
        let Some(valve) = &mut self.devices.valve else { return };
        let demand = match (self.held, self.target) {
            (_, Some(AxisTarget { demand: Demand::Off, .. })) => Demand::Off,
            (None, Some(target)) if self.may_follow && !target.is_disarmed && !target.is_latched => target.demand,
            _ => Demand::Hold,
        };
        valve.demand(demand, out);
    }

    /// The axis stays held. A fault that says more takes the place of "is being set up".
    fn hold_by(&mut self, held: Fault, fault: Fault, now_ns: u64) {
        let is_start = |fault: Fault| matches!(fault.cause, Cause::Absent | Cause::Configuring);
        if is_start(held) || !is_start(fault) {
            self.held = Some(fault);
        }
        let is_acknowledged = self.target.is_some_and(|target| target.is_disarmed && !target.is_latched);
        if is_acknowledged && let Some(valve) = &mut self.devices.valve {
            valve.reset(now_ns);
        }
    }

    /// Whether the controller shows that it knows of the fault: the axis is latched or disarmed. An axis without a
    /// valve has nothing to be held.
    fn is_let_go(&self) -> bool {
        self.devices.valve.is_none() || self.target.is_some_and(|target| target.is_disarmed || target.is_latched)
    }
}
