//! The part that is the same in all devices: states, heartbeat, emergencies, service data.

use super::objects::Objects;
use crate::{
    Frame,
    canopen::{Command, Emergency, NodeId, NodeState, SdoServer, heartbeat, nmt_of},
    device::Outbox,
};

/// What can be wrong with a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// It sends nothing at all.
    Mute,
    /// Its own time-out does not act.
    NoTimeout,
    /// It sends each of its process data twice, as a second device with its number would.
    Double,
    /// It sends its process data at every step, whoever asks.
    Babble,
    /// The alive counter of its message stands still.
    Hung,
    /// Its message is too short.
    Wrong,
}

/// Not 0 while there is an error.
const ERROR_REGISTER: u16 = 0x1001;
/// Messages of one that babbles at each step.
pub(super) const BABBLE: usize = 3;

/// States, heartbeat and service data of a device.
#[derive(Debug, Clone)]
pub(super) struct SimulatedNode {
    pub id: NodeId,
    pub objects: Objects,
    fresh: Objects,
    pub state: NodeState,
    server: SdoServer,
    next_beat_ns: u64,
    pub flaw: Option<Flaw>,
}

impl SimulatedNode {
    /// A device that is switched on at its first step.
    pub fn new(id: NodeId, profile: u16, mut objects: Objects) -> Self {
        objects.add(0x1000, 0, profile.into(), 4, true);
        objects.add(ERROR_REGISTER, 0, 0, 1, true);
        objects.add(0x1017, 0, 0, 2, false);
        // Identity: no maker, the profile as product, the number of the node as serial number.
        for (sub, number) in [(1, 0), (2, profile), (3, 1), (4, u16::from(id.number()))] {
            objects.add(0x1018, sub, number.into(), 4, true);
        }
        objects.add_text(0x1008, &format!("simulated {profile}"));
        Self {
            id,
            fresh: objects.clone(),
            objects,
            state: NodeState::BootUp,
            server: SdoServer::new(id),
            next_beat_ns: 0,
            flaw: None,
        }
    }

    /// Restarts: all settings are forgotten.
    pub fn restart(&mut self) {
        (self.objects, self.state) = (self.fresh.clone(), NodeState::BootUp);
        self.server = SdoServer::new(self.id);
    }

    /// Sends what is due: boot-up and heartbeat.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        if self.state == NodeState::BootUp {
            self.push(heartbeat(self.id, NodeState::BootUp), out);
            self.state = NodeState::PreOperational;
        }
        let period_ns = self.objects.number(0x1017, 0) * 1_000_000;
        if period_ns > 0 && now_ns >= self.next_beat_ns {
            self.next_beat_ns = now_ns + period_ns;
            self.push(heartbeat(self.id, self.state), out);
        }
        if self.flaw == Some(Flaw::Babble) {
            (0..BABBLE).for_each(|_| self.send_process_data(out));
        }
    }

    /// Takes a frame: whether the state has changed.
    pub fn take(&mut self, frame: &Frame, out: &mut Outbox) -> bool {
        let before = self.state;
        match nmt_of(frame, self.id) {
            Some(Command::Start) => self.state = NodeState::Operational,
            Some(Command::Stop) => self.state = NodeState::Stopped,
            Some(Command::PreOperational) => self.state = NodeState::PreOperational,
            Some(Command::ResetNode | Command::ResetCommunication) => self.restart(),
            None if self.state != NodeState::Stopped => {
                if let Some(answer) = self.server.take(frame, &mut self.objects) {
                    self.push(answer, out);
                }
            }
            None => {}
        }
        self.state != before
    }

    pub fn is_operational(&self) -> bool {
        self.state == NodeState::Operational
    }

    /// Sends the message whose parameters are at 1800h and mapping at 1A00h, where it is switched on.
    pub fn send_process_data(&self, out: &mut Outbox) {
        let id = self.objects.number(0x1800, 1) as u32;
        if !self.is_operational() || id >> 31 != 0 {
            return;
        }
        let (value, bits) = self.objects.mapped(0x1A00);
        let frame = Frame::standard_of(id as u16, value.to_le_bytes(), bits.div_ceil(8) as usize);
        self.push(frame, out);
        if self.flaw == Some(Flaw::Double) {
            self.push(frame, out);
        }
    }

    /// Sends an emergency; code 0 says that it is over.
    pub fn emergency(&mut self, code: u16, out: &mut Outbox) {
        let register = u8::from(code != 0);
        self.objects.set(ERROR_REGISTER, 0, register.into());
        self.push(Emergency { code, register, maker: [0; 5] }.frame(self.id), out);
    }

    pub fn push(&self, frame: Frame, out: &mut Outbox) {
        if self.flaw != Some(Flaw::Mute) {
            out.push(frame);
        }
    }
}
