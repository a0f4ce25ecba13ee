//! Everything of a machine that is no CANopen: messages that are received, and drives that are commanded by frames.

use super::{Cause, Demand, Fault, FrameDrive, Outbox, Receiver, fault::FRAME};
use crate::{Received, frames::Signal};

/// A signal of a received message: the place of its receiver, and where it is.
pub type Source = (usize, Signal);

/// The position of an axis in a received message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalPosition {
    /// The signal.
    pub source: Source,
    /// Whether it grows while the axis retracts.
    pub is_reversed: bool,
    /// Its number at count 0.
    pub zero: i64,
}

/// What an axis has of frames.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AxisFrames {
    /// Its position.
    pub position: Option<SignalPosition>,
    /// Pressures of piston side and rod side, and the Pa of a unit of their values.
    pub pressures: Option<[(Source, f64); 2]>,
}

/// All messages of a machine that are no CANopen.
#[derive(Debug, Clone, Default)]
pub struct Frames {
    /// Messages that are received.
    pub receivers: Vec<Receiver>,
    /// Drives that are commanded by frames.
    pub drives: Vec<FrameDrive>,
    /// What each axis has.
    pub axes: Vec<AxisFrames>,
    /// A signal that is not 0 while the emergency stop is pressed.
    pub emergency_stop: Option<Source>,
    /// A signal that is 0 while the pilot pressure is cut off.
    pub pilot: Option<Source>,
    /// Longest time for which a sample waits for a position beyond one and a half periods, ns.
    pub patience_ns: u64,
    /// The emergency stop was pressed in a frame since the last sample.
    pub was_stopped: bool,
}

impl Frames {
    /// A new cycle begins: messages that are late are found, and frames that are due are sent.
    pub fn begin(&mut self, now_ns: u64, out: &mut Outbox) {
        self.receivers.iter_mut().for_each(|receiver| receiver.check(now_ns));
        for drive in &mut self.drives {
            drive.begin(&self.receivers, now_ns, out);
        }
    }

    /// Takes a frame from the bus: whether it was one of these messages.
    pub fn take(&mut self, received: &Received) -> bool {
        let mut is_known = false;
        for receiver in &mut self.receivers {
            is_known |= receiver.take(received);
        }
        // A stop that the next frame releases counts as well.
        self.was_stopped |= self.is_pressed();
        for drive in &mut self.drives {
            is_known |= drive.take(received);
            drive.watch(&self.receivers);
        }
        is_known
    }

    /// The bus is gone.
    pub fn lose_bus(&mut self) {
        self.receivers.iter_mut().for_each(Receiver::lose_bus);
        self.drives.iter_mut().for_each(FrameDrive::lose_bus);
    }

    /// Whether some message is of CAN FD.
    pub fn is_flexible(&self) -> bool {
        self.receivers.iter().any(|receiver| receiver.layout().is_flexible)
            || self.drives.iter().any(|drive| drive.settings().message.layout.is_flexible)
    }

    fn receiver_fault(&self, source: Option<Source>) -> Option<Fault> {
        self.receivers.get(source?.0)?.fault()
    }

    /// What is wrong with the messages of an axis, and with those of all axes.
    pub fn fault(&self, axis: usize) -> Option<Fault> {
        let own = self.axes.get(axis).copied().unwrap_or_default();
        let position = self.receiver_fault(own.position.map(|position| position.source));
        let pressures =
            || own.pressures.and_then(|both| both.iter().find_map(|(source, _)| self.receiver_fault(Some(*source))));
        let shared = || self.receiver_fault(self.emergency_stop).or_else(|| self.receiver_fault(self.pilot));
        let drive = || self.drives.iter().find_map(|drive| drive.fault(axis, &self.receivers));
        let cut_off = || {
            let (receiver, signal) = self.pilot?;
            let is_off = self.receivers.get(receiver)?.raw(&signal) == 0;
            is_off.then_some(Fault { cause: Cause::Pilot, node: FRAME, detail: 0 })
        };
        position.or_else(pressures).or_else(shared).or_else(cut_off).or_else(drive)
    }

    /// Whether the position of an axis comes from a frame.
    pub fn has_position(&self, axis: usize) -> bool {
        self.axes.get(axis).is_some_and(|axis| axis.position.is_some())
    }

    /// Whether an axis is moved by a frame.
    pub fn has_drive(&self, axis: usize) -> bool {
        self.drives.iter().any(|drive| drive.moves(axis))
    }

    /// Whether a new position of an axis has come since the last sample, or none is expected.
    pub fn is_complete(&self, axis: usize) -> bool {
        let Some(position) = self.axes.get(axis).and_then(|axis| axis.position) else { return true };
        self.receivers.get(position.source.0).is_none_or(|receiver| receiver.is_fresh() || receiver.fault().is_some())
    }

    /// Whether the sample is not to wait for the position of an axis any longer: the message has not come for one and a
    /// half periods of `period_ns`, and neither for half of its time-out, or `patience_ns` where that is shorter: the
    /// other axes wait with it. Such a message has no SYNC that it answers to.
    pub fn is_overdue(&self, axis: usize, now_ns: u64, period_ns: u64) -> bool {
        let Some(position) = self.axes.get(axis).and_then(|axis| axis.position) else { return true };
        self.receivers.get(position.source.0).is_none_or(|receiver| {
            let longest_ns = (period_ns + period_ns / 2).max((receiver.timeout_ns() / 2).min(self.patience_ns));
            now_ns.saturating_sub(receiver.heard_ns()) > longest_ns
        })
    }

    /// The sample was taken: new frames make the next one.
    pub fn begin_sample(&mut self) {
        self.was_stopped = false;
        self.receivers.iter_mut().for_each(Receiver::begin_sample);
    }

    /// Counts of an axis; `None` where its position is of no frame.
    pub fn counts(&self, axis: usize) -> Option<i64> {
        let SignalPosition { source: (receiver, signal), is_reversed, zero } = self.axes.get(axis)?.position?;
        let counts = self.receivers.get(receiver)?.raw(&signal).wrapping_sub(zero);
        Some(if is_reversed { counts.wrapping_neg() } else { counts })
    }

    /// Time of the oldest position in the sample, ns; `None` without new positions of frames.
    pub fn acquired_ns(&self) -> Option<u64> {
        let positions = self.axes.iter().filter_map(|axis| axis.position);
        let receivers = positions.filter_map(|position| self.receivers.get(position.source.0));
        receivers.filter(|receiver| receiver.is_fresh()).map(Receiver::heard_ns).min()
    }

    /// Pressures of piston side and rod side of an axis, Pa.
    pub fn pressures(&self, axis: usize) -> Option<[f64; 2]> {
        let both = self.axes.get(axis)?.pressures?;
        let [piston, rod] = both.map(|((receiver, signal), pascal)| {
            let receiver = self.receivers.get(receiver)?;
            receiver.fault().is_none().then(|| pascal * receiver.value(&signal))
        });
        Some([piston?, rod?])
    }

    /// Whether the emergency stop is pressed, or was pressed since the last sample.
    pub fn is_stopped(&self) -> bool {
        self.was_stopped || self.is_pressed()
    }

    fn is_pressed(&self) -> bool {
        let Some((receiver, signal)) = self.emergency_stop else { return false };
        self.receivers.get(receiver).is_some_and(|receiver| receiver.raw(&signal) != 0)
    }

    /// Tells the drive of an axis what to do.
    pub fn demand(&mut self, axis: usize, demand: Demand, now_ns: u64, out: &mut Outbox) {
        self.drives.iter_mut().for_each(|drive| drive.demand(axis, demand, now_ns, out));
    }

    /// A person has acknowledged the fault of an axis.
    pub fn reset(&mut self, axis: usize, now_ns: u64) {
        self.drives.iter_mut().filter(|drive| drive.moves(axis)).for_each(|drive| drive.reset(now_ns));
    }
}
