//! A drive that is commanded by one frame for one or several axes, without CANopen.
//!
//! ```text
//! set point = scale x command     or, with a direction: |scale x command| and extend, retract or neutral
//! frame     = pattern of the state, set points of all axes, alive counter, checksum
//! state     active while an axis follows, neutral while none does, off with the pilot pressure cut off
//! ```
//!
//! The drive has to say by a signal of each axis that it follows the bus. By this signal its own time-out is proven
//! before an axis can be armed (`proof.rs`): the frame is sent with the active pattern and set points 0, then not at
//! all, and the signal has to become 0 in time. A drive that does not say so cannot be proven, and is not used.

use super::{
    Cause, Demand, Fault, Outbox, Proof, Receiver,
    fault::FRAME,
    valve::{FOLLOW_NS, lasts},
};
use crate::{
    MAX_FD_DATA, Received,
    frames::{Guard, Message, Signal},
};

/// Least time between two proofs, ns.
const PROOF_PAUSE_NS: u64 = 5_000_000_000;

/// Values of signals that tell a state of the drive.
pub type Pattern = Vec<(Signal, f64)>;

/// Where the command of an axis is in the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetPoint {
    /// The axis.
    pub axis: usize,
    /// Its set point.
    pub signal: Signal,
    /// Set point at command 1; negative where a positive one retracts.
    pub scale: f64,
    /// A signal with the direction, where the set point has no sign: 0 neutral, 1 extend, 2 retract, as the auxiliary
    /// valves of ISO 11783-7 have it.
    pub direction: Option<Signal>,
    /// The signal by which the drive says that it follows, in this receiver.
    pub active: (usize, Signal),
}

/// What a drive is set up to.
#[derive(Debug, Clone)]
pub struct FrameDriveSettings {
    /// The message.
    pub message: Message,
    /// Its counter and checksum.
    pub guard: Guard,
    /// Its axes.
    pub set_points: Vec<SetPoint>,
    /// Values while an axis follows, while none does, and with the pilot pressure cut off.
    pub active: Pattern,
    /// See `active`.
    pub neutral: Pattern,
    /// See `active`.
    pub off: Pattern,
    /// Without the frame for this long the drive stops, ns.
    pub timeout_ns: u64,
    /// Least time between two frames, ns; a frame that makes an axis neutral is sent at once.
    pub period_ns: u64,
}

impl FrameDriveSettings {
    /// Place of an axis among the set points; `None` where the frame does not move it.
    pub fn place(&self, axis: usize) -> Option<usize> {
        self.set_points.iter().position(|set_point| set_point.axis == axis)
    }
}

/// A drive.
#[derive(Debug, Clone)]
pub struct FrameDrive {
    settings: FrameDriveSettings,
    /// What each axis is to do, in the order of the set points.
    demands: Vec<Demand>,
    proof: Proof,
    fault: Option<Cause>,
    count: i64,
    /// When the last frame was sent, ns.
    sent_ns: u64,
    /// Since when an axis that follows is not active, ns; 0 where all are.
    late_since_ns: u64,
    /// Whether all axes have been active since the first of them follows.
    was_active: bool,
    next_proof_ns: u64,
}

impl FrameDrive {
    /// A drive that has not been heard yet.
    pub fn new(settings: FrameDriveSettings) -> Self {
        let demands = vec![Demand::Hold; settings.set_points.len()];
        Self {
            settings,
            demands,
            proof: Proof::Waiting,
            fault: None,
            count: 0,
            sent_ns: 0,
            late_since_ns: 0,
            was_active: false,
            next_proof_ns: 0,
        }
    }

    /// What it is set up to.
    pub fn settings(&self) -> &FrameDriveSettings {
        &self.settings
    }

    /// Whether it moves this axis.
    pub fn moves(&self, axis: usize) -> bool {
        self.settings.place(axis).is_some()
    }

    /// The bus is gone: the time-out is proven anew once it is back.
    pub fn lose_bus(&mut self) {
        (self.proof, self.fault) = (Proof::Waiting, None);
        (self.late_since_ns, self.was_active) = (0, false);
    }

    /// Judges the drive, and sends its frame where it is due.
    pub fn begin(&mut self, receivers: &[Receiver], now_ns: u64, out: &mut Outbox) {
        let is_heard = self
            .settings
            .set_points
            .iter()
            .all(|set_point| receivers.get(set_point.active.0).is_some_and(|receiver| receiver.fault().is_none()));
        if !is_heard {
            // What a drive that was silent has become meanwhile is not known.
            self.lose_bus();
            self.send_due(now_ns, out);
            return;
        }
        let (all, any) = self.activity(receivers);
        if self.proof == Proof::Waiting {
            self.proof = Proof::begin(now_ns);
        }
        if !self.proof.is_over() {
            // Stopped is a drive of which no axis follows any more.
            let is_active = if matches!(self.proof, Proof::Activating(_)) { all } else { any };
            self.proof = self.proof.advance(now_ns, self.settings.timeout_ns, is_active, true);
            if self.proof.is_over() {
                self.next_proof_ns = now_ns + PROOF_PAUSE_NS;
            }
            self.fault = match self.proof {
                Proof::Failed => Some(Cause::Proof),
                Proof::Stuck => Some(Cause::Valve),
                _ => None,
            };
        } else if self.proof == Proof::Passed {
            let follows = self.demands.iter().any(|demand| matches!(demand, Demand::Follow(_)));
            self.was_active = follows && (all || self.was_active);
            if lasts(follows && !all, &mut self.late_since_ns, now_ns, FOLLOW_NS) {
                self.fault = Some(Cause::Valve);
            }
            self.watch(receivers);
        }
        self.send_due(now_ns, out);
    }

    /// Looks whether a drive that was active has stopped by itself: it must not go on by itself.
    pub fn watch(&mut self, receivers: &[Receiver]) {
        if self.was_active && self.proof == Proof::Passed && !self.activity(receivers).0 {
            self.fault = self.fault.or(Some(Cause::Valve));
        }
    }

    /// Takes a frame from the bus: whether it has the identifier that only this program sends. Then somebody else
    /// commands the drive as well.
    pub fn take(&mut self, received: &Received) -> bool {
        let is_own = self.settings.message.layout.is_of(&received.frame);
        if is_own && self.proof.is_over() {
            self.fault = Some(Cause::Sender);
        }
        is_own
    }

    /// Whether all axes, and whether any of them, follows by the drive's own words.
    fn activity(&self, receivers: &[Receiver]) -> (bool, bool) {
        let mut active = self.settings.set_points.iter().map(|set_point| {
            let (receiver, signal) = &set_point.active;
            receivers.get(*receiver).is_some_and(|receiver| receiver.raw(signal) != 0)
        });
        let first = active.next().unwrap_or_default();
        active.fold((first, first), |(all, any), is_active| (all && is_active, any || is_active))
    }

    /// Takes another demand of an axis. One that makes it neutral is sent at once.
    pub fn demand(&mut self, axis: usize, demand: Demand, now_ns: u64, out: &mut Outbox) {
        let Some(place) = self.settings.place(axis) else { return };
        let stops = matches!(self.demands[place], Demand::Follow(_)) && !matches!(demand, Demand::Follow(_));
        let is_command = self.demands[place] != demand;
        self.demands[place] = demand;
        self.was_active &= self.demands.iter().any(|demand| matches!(demand, Demand::Follow(_)));
        if stops && self.proof == Proof::Passed {
            self.send(now_ns, out);
        } else if is_command {
            self.send_due(now_ns, out);
        }
    }

    fn send_due(&mut self, now_ns: u64, out: &mut Outbox) {
        if now_ns.saturating_sub(self.sent_ns) >= self.settings.period_ns {
            self.send(now_ns, out);
        }
    }

    fn send(&mut self, now_ns: u64, out: &mut Outbox) {
        if matches!(self.proof, Proof::Silent(..)) {
            return;
        }
        let layout = &self.settings.message.layout;
        let mut room = [0; MAX_FD_DATA];
        let data = &mut room[..usize::from(layout.length).min(MAX_FD_DATA)];
        let is_off = self.demands.contains(&Demand::Off);
        let follows = self.proof == Proof::Passed
            && self.fault.is_none()
            && self.demands.iter().any(|demand| matches!(demand, Demand::Follow(_)));
        let pattern = match () {
            () if is_off => &self.settings.off,
            () if follows || matches!(self.proof, Proof::Activating(_)) => &self.settings.active,
            () => &self.settings.neutral,
        };
        pattern.iter().for_each(|(signal, value)| signal.put(*value, data));
        for (set_point, demand) in self.settings.set_points.iter().zip(&self.demands) {
            let command = match demand {
                Demand::Follow(command) if follows && !is_off && command.is_finite() => command.clamp(-1.0, 1.0),
                _ => 0.0,
            };
            set_point.put(command, data);
        }
        self.count = (self.count + 1) % self.settings.guard.counter.map_or(i64::MAX, |signal| signal.modulus());
        self.settings.guard.seal(self.count, data);
        if let Some(frame) = layout.frame(data) {
            out.push(frame);
            self.sent_ns = now_ns;
        }
    }

    /// Tries again, once a person has acknowledged the fault.
    pub fn reset(&mut self, now_ns: u64) {
        if self.fault.is_some() && now_ns >= self.next_proof_ns {
            self.lose_bus();
        }
    }

    /// What is wrong with the drive, or with the signal by which it says that this axis follows.
    pub fn fault(&self, axis: usize, receivers: &[Receiver]) -> Option<Fault> {
        let place = self.settings.place(axis)?;
        let (receiver, _) = self.settings.set_points[place].active;
        let own = |cause| Fault { cause, node: FRAME, detail: self.settings.message.layout.id as u16 };
        receivers.get(receiver).and_then(Receiver::fault).or(match self.proof {
            proof if !proof.is_over() => Some(own(Cause::Configuring)),
            _ => self.fault.map(own),
        })
    }

    /// Where the proof of the time-out stands.
    pub fn proof(&self) -> Proof {
        self.proof
    }
}

impl SetPoint {
    fn put(&self, command: f64, data: &mut [u8]) {
        let value = self.scale * command;
        let Some(direction) = &self.direction else { return self.signal.put(value, data) };
        self.signal.put(value.abs(), data);
        let way = match value {
            value if value > 0.0 => 1,
            value if value < 0.0 => 2,
            _ => 0,
        };
        direction.put_raw(way, data);
    }
}
