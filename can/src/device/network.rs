//! All devices of a machine.
//!
//! ```text
//! SYNC k --> positions of all encoders --> one sample
//! fault of a device of an axis --> the axis is held, until the fault is over and the controller has let the axis go
//! ```
//!
//! The interlock: an axis whose encoder or valve has a fault is held at once. Its error word stays until the controller
//! shows by its flags that it has latched or disarmed the axis. So no fault is too short for the controller, and no
//! axis goes on by itself after one. An axis that settles has not moved since it was armed, and waits for healthy
//! samples; the word stays until a reading has told of it. A fault that the valve itself keeps is reset when the axis
//! is disarmed: when a person has acknowledged the latch.
//!
//! Devices that become ready for the first time have no error to show to a controller that has said nothing yet, nor to
//! one whose axis settles: it was armed while they were set up. Otherwise their axis follows no command before the
//! controller has shown once that it is latched or disarmed: a program that is started anew beside a controller that
//! follows moves nothing, and the error word says so.

use super::{Cause, Demand, Encoder, Fault, Frames, Outbox, Valve};
use crate::{Received, canopen::sync};

/// Nodes of one axis. What it has not comes from frames.
#[derive(Debug, Clone)]
pub struct AxisDevices {
    /// Its encoder.
    pub encoder: Option<Encoder>,
    /// Its valve; without one, and without a drive by frames, the axis is only read.
    pub valve: Option<Valve>,
}

/// What the controller says of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTarget {
    /// What its valve is to do.
    pub demand: Demand,
    /// In which state the axis is.
    pub state: AxisState,
}

/// State of an axis in the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisState {
    /// It is not armed.
    Disarmed,
    /// It is armed, and waits at neutral until its samples have been healthy for a while.
    Settling,
    /// It is commanded.
    Following,
    /// A fault has latched it.
    Latched,
}

/// Numbers of events since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NetworkCounters {
    /// SYNC that were sent.
    pub syncs: u64,
    /// SYNC for which a position did not come.
    pub incomplete: u64,
    /// Frames that belong to no device.
    pub foreign: u64,
    /// Times at which an axis was held because of a fault.
    pub trips: u64,
}

#[derive(Debug, Clone)]
struct Axis {
    devices: AxisDevices,
    /// Whether anything moves it.
    has_drive: bool,
    /// Why the axis is held.
    held: Option<Fault>,
    /// Whether the devices have been ready.
    was_ready: bool,
    /// Its position is not in the sample.
    is_missing: bool,
    /// Whether the controller has let the axis go since it was held.
    may_follow: bool,
    target: Option<AxisTarget>,
}

/// All devices of a machine.
#[derive(Debug, Clone)]
pub struct Network {
    axes: Vec<Axis>,
    frames: Frames,
    /// Whether there are nodes, which are told by SYNC when to take their positions.
    has_nodes: bool,
    outbox: Outbox,
    counters: NetworkCounters,
}

impl Network {
    /// Devices that have not been heard yet; all axes are held.
    pub fn new(devices: Vec<AxisDevices>) -> Self {
        Self::with_frames(devices, Frames::default())
    }

    /// Devices and messages that have not been heard yet; all axes are held.
    pub fn with_frames(devices: Vec<AxisDevices>, frames: Frames) -> Self {
        let has_nodes = devices.iter().any(|devices| devices.encoder.is_some() || devices.valve.is_some());
        let axes = devices.into_iter().enumerate().map(|(i, devices)| {
            let held = devices.fault().or_else(|| frames.fault(i));
            let has_drive = devices.valve.is_some() || frames.has_drive(i);
            let [was_ready, is_missing, may_follow] = [false; 3];
            Axis { devices, has_drive, held, was_ready, is_missing, may_follow, target: None }
        });
        let axes = axes.collect();
        Self { axes, frames, has_nodes, outbox: Outbox::default(), counters: NetworkCounters::default() }
    }

    /// Sends SYNC: a new sample begins. Devices that are due are set up, and all set points are sent again.
    pub fn begin(&mut self, now_ns: u64) {
        if self.counters.syncs > 0 {
            let is_incomplete = self.axes.iter().any(|axis| !axis.devices.is_complete());
            self.counters.incomplete += u64::from(is_incomplete);
        }
        if self.has_nodes {
            self.outbox.push(sync());
        }
        self.counters.syncs += 1;
        self.frames.begin(now_ns, &mut self.outbox);
        for axis in &mut self.axes {
            if let Some(encoder) = &mut axis.devices.encoder {
                encoder.begin(now_ns, &mut self.outbox);
            }
            if let Some(valve) = &mut axis.devices.valve {
                valve.begin(now_ns, &mut self.outbox);
            }
        }
        self.interlock(now_ns);
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, received: &Received, now_ns: u64) {
        let mut is_known = self.frames.take(received);
        for axis in &mut self.axes {
            if let Some(encoder) = &mut axis.devices.encoder {
                is_known |= encoder.take(received, now_ns, &mut self.outbox);
            }
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
            axis.devices.encoder.iter_mut().for_each(|encoder| encoder.lose_bus(now_ns));
            axis.devices.valve.iter_mut().for_each(|valve| valve.lose_bus(now_ns));
        }
        self.frames.lose_bus();
        self.interlock(now_ns);
        self.outbox.clear();
    }

    /// Takes what the controller says of all axes; `None` when it has said nothing for the drive's time-out.
    pub fn command(&mut self, targets: Option<&[AxisTarget]>, now_ns: u64) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.target = targets.and_then(|targets| targets.get(i)).copied();
            axis.demand(i, &mut self.frames, now_ns, &mut self.outbox);
        }
        self.interlock(now_ns);
    }

    /// Holds axes with a fault, and lets those go whose fault is over and which the controller has let go.
    fn interlock(&mut self, now_ns: u64) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let fault = axis.devices.fault().or_else(|| self.frames.fault(i));
            let is_let_go = axis.is_let_go();
            match (axis.held, fault) {
                (None, Some(fault)) => {
                    (axis.held, axis.may_follow) = (Some(fault), false);
                    self.counters.trips += 1;
                    axis.demand(i, &mut self.frames, now_ns, &mut self.outbox);
                }
                (Some(held), Some(fault)) => {
                    axis.hold_by(held, fault, now_ns);
                    if axis.is_acknowledged() {
                        self.frames.reset(i, now_ns);
                    }
                }
                (Some(_), None) if is_let_go || axis.is_new() => (axis.held, axis.was_ready) = (None, true),
                _ => {}
            }
            axis.may_follow |= axis.held.is_none() && is_let_go;
        }
    }

    /// Whether all devices have been ready at least once.
    pub fn was_ready(&self) -> bool {
        self.axes.iter().all(|axis| axis.was_ready)
    }

    /// Whether nothing has to be waited for any more: the positions of this SYNC have come from all that are not at
    /// fault, but for those of messages that are overdue.
    pub fn is_ready(&self, now_ns: u64, period_ns: u64) -> bool {
        self.axes.iter().all(|axis| axis.devices.is_complete()) && self.is_over(now_ns, period_ns)
    }

    /// Whether the sample is taken without the positions that have not come: the next SYNC is due, `period_ns` after
    /// the last one.
    pub fn is_over(&self, now_ns: u64, period_ns: u64) -> bool {
        let is_over = |i| self.frames.is_complete(i) || self.frames.is_overdue(i, now_ns, period_ns);
        (0..self.axes.len()).all(is_over)
    }

    /// The sample is taken: when its positions were taken, where `begun_ns` is the time of the SYNC. The oldest
    /// position counts. A position that has not come is missing in it.
    pub fn take_sample(&mut self, begun_ns: u64) -> u64 {
        let oldest_ns = self.frames.acquired_ns();
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.is_missing = !axis.devices.is_complete() || !self.frames.is_complete(i);
        }
        self.frames.begin_sample();
        let has_encoder = self.axes.iter().any(|axis| axis.devices.encoder.is_some());
        match oldest_ns {
            Some(oldest_ns) if has_encoder => oldest_ns.min(begun_ns),
            Some(oldest_ns) => oldest_ns,
            None => begun_ns,
        }
    }

    /// Pressures of piston side and rod side of an axis, Pa, where they are signals of frames.
    pub fn pressures(&self, axis: usize) -> Option<[f64; 2]> {
        self.frames.pressures(axis)
    }

    /// Whether a signal says that the emergency stop is pressed, or has said so since the last sample.
    pub fn is_stopped(&self) -> bool {
        self.frames.is_stopped()
    }

    /// Counts and error word of an axis in the sample of this SYNC; the word is 0 where nothing is wrong. There are no
    /// counts where the position has not come.
    pub fn reading(&self, axis: usize) -> Option<(Option<i64>, u32)> {
        let place = axis;
        let axis = self.axes.get(axis)?;
        let counts = axis.devices.encoder.as_ref().map(Encoder::counts).or_else(|| self.frames.counts(place));
        Some((counts.filter(|_| !axis.is_missing), axis.held.map_or(0, Fault::word)))
    }

    /// All valves are switched off: the last frames of the program.
    pub fn end(&mut self, now_ns: u64) {
        let off = AxisTarget { demand: Demand::Off, state: AxisState::Disarmed };
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.target = Some(off);
            axis.demand(i, &mut self.frames, now_ns, &mut self.outbox);
        }
        self.interlock(now_ns);
    }

    /// Whether messages are of CAN FD.
    pub fn is_flexible(&self) -> bool {
        self.frames.is_flexible()
    }

    /// The frames to be sent. Who has sent them clears them.
    pub fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    /// Its messages that are no CANopen.
    pub fn frames(&self) -> &Frames {
        &self.frames
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

impl AxisDevices {
    fn fault(&self) -> Option<Fault> {
        self.encoder.as_ref().and_then(Encoder::fault).or_else(|| self.valve.as_ref().and_then(Valve::fault))
    }

    fn is_complete(&self) -> bool {
        self.encoder.as_ref().is_none_or(Encoder::is_complete)
    }
}

impl Axis {
    /// Tells the drive what to do: hold, where the axis is held or nobody commands it.
    fn demand(&mut self, place: usize, frames: &mut Frames, now_ns: u64, out: &mut Outbox) {
        let demand = match (self.held, self.target) {
            (_, Some(AxisTarget { demand: Demand::Off, .. })) => Demand::Off,
            (None, Some(AxisTarget { demand, state: AxisState::Following })) if self.may_follow => demand,
            // The valve is ready, and nothing moves by whatever else the command says.
            (None, Some(AxisTarget { state: AxisState::Settling, .. })) if self.may_follow => Demand::Follow(0.0),
            _ => Demand::Hold,
        };
        if let Some(valve) = &mut self.devices.valve {
            valve.demand(demand, out);
        }
        frames.demand(place, demand, now_ns, out);
    }

    /// The axis stays held. A fault that says more takes the place of "is being set up".
    fn hold_by(&mut self, held: Fault, fault: Fault, now_ns: u64) {
        let is_start = |fault: Fault| matches!(fault.cause, Cause::Absent | Cause::Configuring);
        if is_start(held) || !is_start(fault) {
            self.held = Some(fault);
        }
        if self.is_acknowledged() {
            self.devices.encoder.iter_mut().for_each(|encoder| encoder.acknowledge(now_ns));
            self.devices.valve.iter_mut().for_each(|valve| valve.reset(now_ns));
        }
    }

    /// Whether a person has acknowledged the fault: the axis is disarmed, and not latched any more.
    fn is_acknowledged(&self) -> bool {
        self.target.is_some_and(|target| target.state == AxisState::Disarmed)
    }

    /// Whether the devices become ready for the first time, before any command.
    fn is_new(&self) -> bool {
        !self.was_ready && self.target.is_none()
    }

    /// Whether the controller shows that it knows of the fault: the axis is latched or disarmed. One that settles moves
    /// next, so it has to be latched as one that follows is; devices that are set up for the first time have no fault
    /// yet. An axis without a valve has nothing to be held.
    fn is_let_go(&self) -> bool {
        let shows = |target: AxisTarget| match target.state {
            AxisState::Disarmed | AxisState::Latched => true,
            AxisState::Settling => !self.was_ready,
            AxisState::Following => false,
        };
        !self.has_drive || self.target.is_some_and(shows)
    }
}
