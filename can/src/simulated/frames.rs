//! A simulated machine whose positions, interlocks and commands are messages of its own: the other side of [`Frames`].
//!
//! ```text
//! message = positions, pressures, pilot, emergency stop, active, alive counter, checksum
//! opening = set point / scale      while the drive is active, by the values of its message
//! ```
//!
//! A message is sent once in a period of the machine, and three times at least within its time-out.
//! A drive is active from the first message of its active state on, and until one of another state comes or none comes
//! for its time-out.

use super::node::{BABBLE, Flaw};
use crate::{
    Frame, MAX_DATA, MAX_FD_DATA,
    device::{FrameDriveSettings, Frames, Outbox, Pattern, Receiver, SetPoint},
    frames::Verdict,
};
use embedded_can::Frame as _;

/// Messages within a time-out of their receiver.
const WITHIN_TIMEOUT: u64 = 3;
/// A message that the machine sends.
#[derive(Debug, Clone)]
struct Sent {
    receiver: Receiver,
    period_ns: u64,
    due_ns: u64,
    count: i64,
    data: [u8; MAX_FD_DATA],
    flaw: Option<Flaw>,
}

/// A drive that is commanded by a message.
#[derive(Debug, Clone)]
struct Drive {
    settings: FrameDriveSettings,
    counter: Option<i64>,
    heard_ns: u64,
    is_active: bool,
    is_off: bool,
    /// Opening of each axis, in the order of the set points.
    openings: Vec<f64>,
    flaw: Option<Flaw>,
}

/// All of a machine that is no CANopen.
#[derive(Debug, Clone)]
pub struct SimulatedFrames {
    frames: Frames,
    sent: Vec<Sent>,
    drives: Vec<Drive>,
    /// Where the spool of each axis is stuck.
    stuck: Vec<Option<f64>>,
    is_stopped: bool,
    is_cut_off: bool,
}

impl SimulatedFrames {
    /// The machine that these messages are received from and sent to. It sends every `period_ns`, and more often where
    /// their time-outs ask for that.
    pub fn new(frames: &Frames, period_ns: u64) -> Self {
        let sent = frames.receivers.iter().map(|receiver| Sent::new(receiver, period_ns)).collect();
        let drives = frames.drives.iter().map(|drive| Drive::new(drive.settings().clone())).collect();
        let stuck = vec![None; frames.axes.len()];
        Self { frames: frames.clone(), sent, drives, stuck, is_stopped: false, is_cut_off: false }
    }

    /// Whether messages are of CAN FD.
    pub fn is_flexible(&self) -> bool {
        self.frames.is_flexible()
    }

    /// Whether a message moves this axis.
    pub fn has_drive(&self, axis: usize) -> bool {
        self.frames.has_drive(axis)
    }

    /// Whether messages say that the emergency stop is pressed, and that the pilot pressure is cut off.
    pub fn interlocks(&self) -> (bool, bool) {
        (self.frames.emergency_stop.is_some(), self.frames.pilot.is_some())
    }

    /// Presses or releases the emergency stop.
    pub fn stop(&mut self, is_pressed: bool) {
        self.is_stopped = is_pressed;
    }

    /// Cuts the pilot pressure off by hand, or no more.
    pub fn cut_off(&mut self, is_cut_off: bool) {
        self.is_cut_off = is_cut_off;
    }

    /// What is wrong from now on with the message that has the position of this axis.
    pub fn spoil_position(&mut self, axis: usize, flaw: Option<Flaw>) {
        let position = self.frames.axes.get(axis).and_then(|axis| axis.position);
        if let Some(sent) = position.and_then(|position| self.sent.get_mut(position.source.0)) {
            sent.flaw = flaw;
        }
    }

    /// What is wrong from now on with the drive of this axis.
    pub fn spoil_drive(&mut self, axis: usize, flaw: Option<Flaw>) {
        self.drives.iter_mut().filter(|drive| drive.settings.place(axis).is_some()).for_each(|drive| drive.flaw = flaw);
    }

    /// The spool of this axis is stuck at this part of full scale.
    pub fn stick(&mut self, axis: usize, spool: Option<f64>) {
        self.stuck.iter_mut().skip(axis).take(1).for_each(|stuck| *stuck = spool);
    }

    /// Moves an axis to this position, counts.
    pub fn set_counts(&mut self, axis: usize, counts: i64) {
        let Some(position) = self.frames.axes.get(axis).and_then(|axis| axis.position) else { return };
        let counts = if position.is_reversed { counts.wrapping_neg() } else { counts };
        let number = position.zero.wrapping_add(counts);
        put(&mut self.sent, position.source.0, |data| position.source.1.put_raw(number, data));
    }

    /// Pressures of piston side and rod side of an axis, Pa.
    pub fn set_pressures(&mut self, axis: usize, pressures: [f64; 2]) {
        let Some(both) = self.frames.axes.get(axis).and_then(|axis| axis.pressures) else { return };
        for (((receiver, signal), pascal), pressure) in both.into_iter().zip(pressures) {
            put(&mut self.sent, receiver, |data| signal.put(pressure / pascal, data));
        }
    }

    /// How far the spool of an axis is open, -1 to 1; `None` of an axis without a drive.
    pub fn opening(&self, axis: usize) -> Option<f64> {
        let stuck = self.stuck.get(axis).copied().flatten();
        let commanded = self.drives.iter().find_map(|drive| Some(drive.openings[drive.settings.place(axis)?]))?;
        Some(stuck.unwrap_or(if self.is_off() { 0.0 } else { commanded }))
    }

    /// Whether the pilot pressure is off, or some drive was told so.
    fn is_off(&self) -> bool {
        self.is_cut_off || self.drives.iter().any(|drive| drive.is_off)
    }

    /// Sends what is due, and stops the drives that hear nothing any more.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        for drive in &mut self.drives {
            drive.step(now_ns);
            for SetPoint { active: (receiver, signal), .. } in &drive.settings.set_points {
                put(&mut self.sent, *receiver, |data| signal.put_raw(drive.is_active.into(), data));
            }
        }
        let (is_stopped, has_pilot) = (self.is_stopped, !self.is_off());
        for (source, value) in [(self.frames.emergency_stop, is_stopped), (self.frames.pilot, has_pilot)] {
            if let Some((receiver, signal)) = source {
                put(&mut self.sent, receiver, |data| signal.put_raw(value.into(), data));
            }
        }
        self.sent.iter_mut().for_each(|sent| sent.step(now_ns, out));
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, now_ns: u64) {
        self.drives.iter_mut().for_each(|drive| drive.take(frame, now_ns));
    }
}

impl Sent {
    fn new(receiver: &Receiver, period_ns: u64) -> Self {
        let period_ns = period_ns.min(receiver.timeout_ns() / WITHIN_TIMEOUT);
        Self { receiver: receiver.clone(), period_ns, due_ns: 0, count: 0, data: [0; MAX_FD_DATA], flaw: None }
    }

    fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        let is_due = now_ns >= self.due_ns;
        if is_due {
            self.due_ns = self.due_ns.max(now_ns.saturating_sub(self.period_ns)) + self.period_ns;
        }
        let messages = match self.flaw {
            Some(Flaw::Mute) => 0,
            Some(Flaw::Babble) => BABBLE,
            Some(Flaw::Double) if is_due => 2,
            _ => usize::from(is_due),
        };
        for _ in 0..messages {
            self.send(out);
        }
    }

    fn send(&mut self, out: &mut Outbox) {
        let layout = self.receiver.layout();
        self.count = self.count.wrapping_add(i64::from(self.flaw != Some(Flaw::Hung)));
        let mut data = self.data;
        let data = &mut data[..usize::from(layout.length)];
        self.receiver.guard().seal(self.count, data);
        // A message that is too short is as wrong as one with a wrong checksum, and every message can be it.
        let sent = if self.flaw == Some(Flaw::Wrong) { &data[..data.len().min(MAX_DATA + 1) - 1] } else { data };
        layout.frame(sent).into_iter().for_each(|frame| out.push(frame));
    }
}

impl Drive {
    fn new(settings: FrameDriveSettings) -> Self {
        let openings = vec![0.0; settings.set_points.len()];
        Self { settings, counter: None, heard_ns: 0, is_active: false, is_off: false, openings, flaw: None }
    }

    fn step(&mut self, now_ns: u64) {
        let is_late = now_ns.saturating_sub(self.heard_ns) > self.settings.timeout_ns;
        if is_late && self.flaw != Some(Flaw::NoTimeout) {
            self.is_active = false;
            self.openings.fill(0.0);
        }
    }

    fn take(&mut self, frame: &Frame, now_ns: u64) {
        let layout = &self.settings.message.layout;
        let is_it = layout.is_of(frame);
        let Some(data) = frame.data().get(..usize::from(layout.length)).filter(|_| is_it) else { return };
        if self.flaw == Some(Flaw::Mute)
            || !matches!(self.settings.guard.judge(data, &mut self.counter), Verdict::Good(_))
        {
            return;
        }
        let FrameDriveSettings { active, neutral, off, set_points, .. } = &self.settings;
        let is_one_of = |states: &[&Pattern]| states.iter().any(|state| !state.is_empty() && has(data, state));
        let is_active = has(data, active) && !is_one_of(&[neutral, off]);
        let openings = set_points.iter().map(|set_point| if is_active { opening(set_point, data) } else { 0.0 });
        (self.heard_ns, self.is_active, self.is_off) = (now_ns, is_active, is_one_of(&[off]));
        self.openings = openings.collect();
    }
}

/// Changes the data of a message that is sent.
fn put(sent: &mut [Sent], receiver: usize, change: impl FnOnce(&mut [u8])) {
    if let Some(sent) = sent.get_mut(receiver) {
        change(&mut sent.data);
    }
}

/// Whether a message has all these values.
fn has(data: &[u8], state: &Pattern) -> bool {
    state.iter().all(|(signal, value)| {
        let mut wanted = [0; MAX_FD_DATA];
        signal.put(*value, &mut wanted);
        signal.raw(data) == signal.raw(&wanted)
    })
}

/// The opening that a message asks for.
fn opening(set_point: &SetPoint, data: &[u8]) -> f64 {
    let value = set_point.signal.value(data).unwrap_or_default();
    let way = match set_point.direction.map(|signal| signal.raw(data)) {
        None | Some(Some(1)) => 1.0,
        Some(Some(2)) => -1.0,
        _ => 0.0,
    };
    // With a direction the set point has no sign, and the direction has that of the scale.
    (way * value / set_point.scale).clamp(-1.0, 1.0)
}
