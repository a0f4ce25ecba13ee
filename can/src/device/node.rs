//! A node: found, set up, started, and watched.
//!
//! ```text
//! absent --answer--> configuring --all steps--> started --heartbeat "operational"--> operational
//!    ^                    |                         |                                     |
//!    +---- no answer, setting refused, boot-up, heartbeat stopped, another state ---------+
//! ```
//!
//! Whatever ends the operation of a node begins anew with its configuration: a device that has restarted has forgotten
//! it. An emergency does not: the device says when it is over. The frame that says so may be lost, with the bus or
//! alone; hence the error register is read in each configuration whose plan asks for it.

use super::{
    Cause, Fault, Outbox,
    plan::{Action, Plan},
};
use crate::{
    Frame, Received,
    canopen::{
        Command, Emergency, NodeId, NodeState, SdoClient, SdoError, SdoEvent, emergency_code, heartbeat_of, nmt,
    },
};

/// Time until a device that did not answer, or refused a setting, is tried again, ns.
const RETRY_NS: u64 = 500_000_000;
/// A heartbeat is missed after so many halves of its period: one and a half, as in the table of faults.
const PATIENCE_HALVES: u64 = 3;
/// Heartbeats after which a started node has to be operational.
const START_BEATS: u64 = 4;

/// Times of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeTiming {
    /// Period of the heartbeat, ns.
    pub heartbeat_ns: u64,
    /// Longest time of an answer to a service data request, ns.
    pub answer_ns: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Tried again at this time.
    Absent(u64),
    /// The step that waits for its answer.
    Configuring(usize),
    /// Waits for a heartbeat with the state "operational".
    Started,
    Operational,
}

/// A node.
#[derive(Debug, Clone)]
pub struct Node {
    id: NodeId,
    plan: Plan,
    timing: NodeTiming,
    sdo: SdoClient,
    phase: Phase,
    /// When the heartbeat is missed.
    due_ns: u64,
    /// Why the node is not operational.
    fault: Fault,
    /// The emergency that is not over.
    emergency: Option<u16>,
}

impl Node {
    /// A node that has not been heard yet. The plan is followed whenever it begins.
    pub fn new(id: NodeId, plan: Plan, timing: NodeTiming) -> Self {
        let fault = Fault { cause: Cause::Absent, node: id.number(), detail: 0 };
        let sdo = SdoClient::new(id, timing.answer_ns);
        Self { id, plan, timing, sdo, phase: Phase::Absent(0), due_ns: 0, fault, emergency: None }
    }

    /// Its number.
    pub fn id(&self) -> NodeId {
        self.id
    }

    /// Whether process data are exchanged.
    pub fn is_operational(&self) -> bool {
        self.phase == Phase::Operational
    }

    /// What is wrong: why the node is not operational, or its emergency.
    pub fn fault(&self) -> Option<Fault> {
        match (self.phase, self.emergency) {
            (Phase::Operational, None) => None,
            (Phase::Operational, Some(code)) => Some(self.because(Cause::Emergency, code)),
            _ => Some(self.fault),
        }
    }

    /// Forgets an emergency, whose cause has been removed.
    pub fn forget_emergency(&mut self) {
        self.emergency = None;
    }

    pub(super) fn because(&self, cause: Cause, detail: u16) -> Fault {
        Fault { cause, node: self.id.number(), detail }
    }

    fn lose(&mut self, cause: Cause, detail: u16, retry_ns: u64) {
        self.fault = self.because(cause, detail);
        self.phase = Phase::Absent(retry_ns);
    }

    /// Sets the node up anew where an emergency stands, which asks whether it is over.
    pub fn ask_again(&mut self, now_ns: u64) {
        if let (Phase::Operational, Some(code)) = (self.phase, self.emergency) {
            self.lose(Cause::Emergency, code, now_ns + RETRY_NS);
        }
    }

    /// The bus is gone. The node is set up anew once it is back.
    pub fn lose_bus(&mut self, now_ns: u64) {
        self.lose(Cause::Bus, 0, now_ns);
    }

    /// Does what is due: begins the configuration, ends a transfer without an answer, misses a heartbeat.
    pub fn check(&mut self, now_ns: u64, out: &mut Outbox) {
        match self.phase {
            Phase::Absent(retry_ns) if now_ns >= retry_ns => {
                out.push(nmt(Command::PreOperational, Some(self.id)));
                self.begin(0, now_ns, out);
            }
            Phase::Absent(_) => {}
            Phase::Configuring(_) => {
                if let SdoEvent::Failed(_, frame) = self.sdo.check(now_ns) {
                    frame.into_iter().for_each(|frame| out.push(frame));
                    self.lose(Cause::Absent, 0, now_ns + RETRY_NS);
                }
            }
            Phase::Started | Phase::Operational if now_ns >= self.due_ns => {
                self.lose(Cause::Heartbeat, 0, now_ns);
            }
            Phase::Started | Phase::Operational => {}
        }
    }

    /// Begins a step of the plan; behind the last one the node is started.
    fn begin(&mut self, place: usize, now_ns: u64, out: &mut Outbox) {
        let Some(step) = self.plan.step(place) else {
            out.push(nmt(Command::Start, Some(self.id)));
            self.phase = Phase::Started;
            self.due_ns = now_ns + START_BEATS * self.timing.heartbeat_ns;
            return;
        };
        self.phase = Phase::Configuring(place);
        let frame = match step.action {
            Action::Expect { .. } | Action::Register => Some(self.sdo.read(step.object, now_ns)),
            Action::Write(value) => {
                let mut room = [0; 8];
                let length = value.bytes(&mut room);
                self.sdo.write(step.object, &room[..length], now_ns)
            }
        };
        frame.into_iter().for_each(|frame| out.push(frame));
    }

    /// Takes a frame from the bus: whether it was one of the node's management.
    pub fn take(&mut self, received: &Received, now_ns: u64, out: &mut Outbox) -> bool {
        let frame = &received.frame;
        if let Some((node, state)) = heartbeat_of(frame) {
            if node == self.id {
                self.take_state(state, now_ns);
            }
            return node == self.id;
        }
        if let Some((node, emergency)) = Emergency::of(frame) {
            if node == self.id {
                self.emergency = (emergency.code != 0).then_some(emergency.code);
            }
            return node == self.id;
        }
        self.take_answer(frame, now_ns, out)
    }

    fn take_state(&mut self, state: NodeState, now_ns: u64) {
        if state == NodeState::BootUp {
            self.emergency = None;
        }
        match (self.phase, state) {
            // The answer to a request before it is lost: the configuration begins anew.
            (Phase::Configuring(_) | Phase::Absent(_), NodeState::BootUp) => {
                self.lose(Cause::Configuring, 0, now_ns);
            }
            (_, NodeState::BootUp) => self.lose(Cause::Restart, 0, now_ns),
            (Phase::Started | Phase::Operational, NodeState::Operational) => {
                self.phase = Phase::Operational;
                self.due_ns = now_ns + self.timing.heartbeat_ns * PATIENCE_HALVES / 2;
            }
            (Phase::Operational, state) => self.lose(Cause::State, state.number().into(), now_ns),
            // A heartbeat that was on its way when the node was started, or one of a node that is being set up.
            _ => {}
        }
    }

    fn take_answer(&mut self, frame: &Frame, now_ns: u64, out: &mut Outbox) -> bool {
        let Phase::Configuring(place) = self.phase else { return false };
        let Some(step) = self.plan.step(place) else { return false };
        let number = self.id.number();
        match self.sdo.take(frame, now_ns) {
            SdoEvent::Ignored => return false,
            SdoEvent::Send(next) => out.push(next),
            SdoEvent::Written => self.begin_next(place, now_ns, out),
            SdoEvent::Read => match (step.action, self.sdo.number()) {
                (Action::Expect { number, mask }, Some(found)) if found & mask == number & mask => {
                    self.begin_next(place, now_ns, out);
                }
                (Action::Expect { mask, .. }, found) => {
                    self.refuse(step.fault(number, found.map(|found| found & mask)), now_ns);
                }
                (Action::Register, Some(found)) => {
                    self.emergency = (found != 0).then(|| self.emergency.unwrap_or(emergency_code::GENERIC));
                    self.begin_next(place, now_ns, out);
                }
                (Action::Write(_) | Action::Register, _) => {}
            },
            SdoEvent::Failed(SdoError::Refused { code, .. }, _) if step.forgives(code) => {
                self.begin_next(place, now_ns, out);
            }
            SdoEvent::Failed(_, frame) => {
                frame.into_iter().for_each(|frame| out.push(frame));
                self.refuse(step.fault(number, None), now_ns);
            }
        }
        true
    }

    fn begin_next(&mut self, place: usize, now_ns: u64, out: &mut Outbox) {
        if self.fault.cause == Cause::Absent {
            self.fault = self.because(Cause::Configuring, 0);
        }
        self.begin(place + 1, now_ns, out);
    }

    fn refuse(&mut self, fault: Fault, now_ns: u64) {
        self.lose(fault.cause, fault.detail, now_ns + RETRY_NS);
    }
}
