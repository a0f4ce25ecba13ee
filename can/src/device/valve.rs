//! A valve with electronics of its own (CiA 408).
//!
//! ```text
//! RPDO 1 with every SYNC and with every command:   6040h control word, 6300h:1 set point
//! TPDO 1 with every SYNC:                          6041h status word,  6301h:1 spool position
//! set point = full scale x command
//! ```
//!
//! Bits of both words: 0 not disabled (D), 1 not held (H), 2 active (M), 3 ready (R). So 7 is active, 3 hold, 0 off; a
//! status without bit 3 is a fault, and a rising edge of bit 3 in the control word resets it. In hold the valve takes
//! its hold set point 6314h:1, which is 0, whatever the bus says.
//!
//! The drive's own time-out is the event timer of the RPDO, 1400h:5. It is written, read back, and proven
//! (`proof.rs`) before the axis can be armed.
//!
//! Trap: a master that recovers must not go on with an old set point. After every fault the valve is held until the
//! controller itself has let the axis go.

use super::{Cause, Fault, Node, NodeTiming, Outbox, Plan, Proof, Value, plan::Message};
use crate::{
    Received,
    canopen::{Mapped, Mapping, MappingError, NodeId, Object, function, signed},
};

/// Number of the profile of fluid power.
const PROFILE: u16 = 408;
/// Bits of control word and status word.
const ENABLED: u16 = 1;
const NOT_HELD: u16 = 2;
const ACTIVE: u16 = 4;
const READY: u16 = 8;
/// The bits that tell the state.
const STATE: u16 = 0xF;
/// Time that a valve or a drive may take to follow its command, ns.
pub(super) const FOLLOW_NS: u64 = 500_000_000;
/// Least time between two resets of a fault that does not go, ns.
const RESET_PAUSE_NS: u64 = 5_000_000_000;
/// Time that the spool may be out of tolerance, ns, as valves with a monitor of their own allow it.
const DEVIATION_NS: u64 = 500_000_000;

/// What a valve is set up to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValveSettings {
    /// Its number.
    pub node: NodeId,
    /// Set point at command 1; negative where a positive set point retracts.
    pub full_scale: i16,
    /// Without set points for this long the valve stops, ms.
    pub timeout_ms: u16,
    /// How much further out than commanded, or on the other side, the spool may be, as a part of full scale; without it
    /// nothing is compared.
    pub spool_tolerance: Option<f64>,
    /// Whether the mapping cannot be written, and is compared only.
    pub is_fixed: bool,
}

/// What the valve is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Demand {
    /// No current in the solenoids.
    Off,
    /// The valve holds its neutral position.
    Hold,
    /// The valve follows a command from -1 to 1.
    Follow(f64),
}

/// A valve.
#[derive(Debug, Clone)]
pub struct Valve {
    node: Node,
    settings: ValveSettings,
    command: Mapping,
    feedback: Mapping,
    timeout_ns: u64,
    proof: Proof,
    demand: Demand,
    status: u16,
    spool: i16,
    /// The control word that was sent last.
    word: u16,
    /// A fault of the valve is being reset until this time, ns; 0 where none is.
    reset_until_ns: u64,
    /// Before this time no fault is reset again, ns.
    next_reset_ns: u64,
    /// Whether the valve has been active since it follows.
    was_active: bool,
    /// Since when the valve does not follow the control word, and the spool not its set point, ns; 0 where they do.
    late_since_ns: u64,
    apart_since_ns: u64,
    fault: Option<Fault>,
}

impl Valve {
    /// A valve that has not been heard yet.
    ///
    /// # Errors
    /// Never: the messages of this file have 32 bits.
    pub fn new(settings: ValveSettings, timing: NodeTiming) -> Result<Self, MappingError> {
        let mapped = |index, sub| Mapped { object: Object::new(index, sub), bits: 16 };
        let command = Mapping::new(&[mapped(0x6040, 0), mapped(0x6300, 1)])?;
        let feedback = Mapping::new(&[mapped(0x6041, 0), mapped(0x6301, 1)])?;
        let mut plan = Plan::default();
        plan.profile(PROFILE);
        plan.ensure(Object::new(0x1017, 0), Value::u16((timing.heartbeat_ns / 1_000_000) as u16));
        // Set points from the bus, spool position in open loop; the hold set point is neutral; no ramps.
        plan.ensure_if_any(Object::new(0x6042, 0), Value::u8(1));
        plan.ensure_if_any(Object::new(0x6043, 0), Value::u8(1));
        plan.ensure_if_any(Object::new(0x6314, 1), Value::u16(0));
        plan.ensure_if_any(Object::new(0x6330, 0), Value::u8(0));
        let settled = Message {
            parameters: 0x1400,
            id: settings.node.id(function::RPDO1),
            mapping: &command,
            kind: 255,
            timeout_ms: Some(settings.timeout_ms),
        };
        plan.message(&settled, settings.is_fixed);
        let status = Message {
            parameters: 0x1800,
            id: settings.node.id(function::TPDO1),
            mapping: &feedback,
            kind: 1,
            timeout_ms: None,
        };
        plan.message(&status, settings.is_fixed);
        Ok(Self {
            node: Node::new(settings.node, plan, timing),
            settings,
            command,
            feedback,
            timeout_ns: u64::from(settings.timeout_ms) * 1_000_000,
            proof: Proof::Waiting,
            demand: Demand::Hold,
            status: 0,
            spool: 0,
            word: 0,
            reset_until_ns: 0,
            next_reset_ns: 0,
            was_active: false,
            late_since_ns: 0,
            apart_since_ns: 0,
            fault: None,
        })
    }

    /// The bus is gone.
    pub fn lose_bus(&mut self, now_ns: u64) {
        self.node.lose_bus(now_ns);
    }

    /// Takes a frame from the bus: whether it was one of this valve.
    pub fn take(&mut self, received: &Received, now_ns: u64, out: &mut Outbox) -> bool {
        if received.frame.standard_id() == Some(self.settings.node.id(function::RPDO1)) {
            // Only this program sends it: somebody else commands the valve as well.
            if self.proof == Proof::Passed {
                self.fault = Some(self.node.because(Cause::Sender, 0));
            }
            return true;
        }
        if received.frame.standard_id() != Some(self.settings.node.id(function::TPDO1)) {
            return self.node.take(received, now_ns, out);
        }
        if let Some([status, spool, ..]) = self.feedback.unpack(&received.frame) {
            (self.status, self.spool) = (status as u16, signed(spool, 16) as i16);
            self.watch();
        }
        true
    }

    /// Looks whether a valve that was active has stopped by itself: it must not go on by itself.
    fn watch(&mut self) {
        if self.was_active && self.proof == Proof::Passed && !self.is_active() && !self.is_resetting() {
            self.fault = self.fault.or(Some(self.node.because(Cause::Valve, self.status)));
        }
    }

    /// A SYNC is sent: the state of the valve is judged, and the set point sent again, which keeps the drive's
    /// time-out from acting.
    pub fn begin(&mut self, now_ns: u64, out: &mut Outbox) {
        self.node.check(now_ns, out);
        if !self.node.is_operational() {
            (self.proof, self.status, self.fault, self.reset_until_ns) = (Proof::Waiting, 0, None, 0);
            (self.late_since_ns, self.apart_since_ns, self.was_active) = (0, 0, false);
            return;
        }
        self.advance_proof(now_ns);
        if self.proof == Proof::Passed {
            self.judge(now_ns);
        }
        self.send(out);
    }

    fn advance_proof(&mut self, now_ns: u64) {
        if self.proof == Proof::Waiting {
            self.proof = Proof::begin(now_ns);
        }
        let before = self.proof;
        self.proof = before.advance(now_ns, self.timeout_ns, self.is_active(), self.status & READY != 0);
        if self.proof != before && self.proof.is_over() {
            // The emergency of the time-out was asked for.
            self.node.forget_emergency();
            (self.reset_until_ns, self.late_since_ns, self.apart_since_ns) = (0, 0, 0);
        }
        if self.proof != before && matches!(self.proof, Proof::Failed | Proof::Stuck) {
            self.next_reset_ns = now_ns + RESET_PAUSE_NS;
        }
        self.fault = match self.proof {
            Proof::Failed => Some(self.node.because(Cause::Proof, 0)),
            Proof::Stuck => Some(self.node.because(Cause::Valve, self.status)),
            _ => self.fault,
        };
    }

    fn is_active(&self) -> bool {
        self.status & STATE == ENABLED | NOT_HELD | ACTIVE | READY
    }

    /// Faults of the valve while it is used. They stay until [`Self::reset`].
    fn judge(&mut self, now_ns: u64) {
        let follows = matches!(self.demand, Demand::Follow(_));
        let is_late = follows && !self.is_active();
        self.was_active = follows && (self.is_active() || self.was_active);
        let late = lasts(is_late, &mut self.late_since_ns, now_ns, FOLLOW_NS);
        let apart = lasts(self.is_apart(), &mut self.apart_since_ns, now_ns, DEVIATION_NS);
        if self.is_resetting() && self.status & READY != 0 {
            (self.reset_until_ns, self.fault) = (0, None);
            self.node.forget_emergency();
        } else if self.is_resetting() && now_ns >= self.reset_until_ns {
            self.reset_until_ns = 0;
        } else if self.fault.is_none() && !self.is_resetting() {
            self.fault = match () {
                () if self.status & READY == 0 || late => Some(self.node.because(Cause::Valve, self.status)),
                () if apart => Some(self.node.because(Cause::Spool, self.spool as u16)),
                () => None,
            };
        }
    }

    fn is_resetting(&self) -> bool {
        self.reset_until_ns > 0
    }

    /// Whether the spool is further out than commanded, or on the other side, by more than the tolerance.
    fn is_apart(&self) -> bool {
        let Some(tolerance) = self.settings.spool_tolerance else { return false };
        let full_scale = f64::from(self.settings.full_scale);
        let (spool, command) = (f64::from(self.spool) / full_scale, f64::from(self.set_point()) / full_scale);
        let side = if command < 0.0 { -1.0 } else { 1.0 };
        // Seen from the side of the command: out is positive.
        let (spool, command) = (side * spool, side * command);
        spool > command + tolerance || spool < -tolerance
    }

    /// The set point that goes with the demand: 0 but while the valve follows.
    fn set_point(&self) -> i16 {
        match self.demand {
            Demand::Follow(command) if self.proof == Proof::Passed && self.fault().is_none() && command.is_finite() => {
                (f64::from(self.settings.full_scale) * command.clamp(-1.0, 1.0)).round() as i16
            }
            _ => 0,
        }
    }

    /// The control word for the present demand and state.
    fn control_word(&self) -> u16 {
        let hold = ENABLED | NOT_HELD;
        let is_faulty = self.status & READY == 0;
        match (self.proof, self.demand) {
            (Proof::Activating(_), _) if is_faulty => self.reset_edge(),
            (Proof::Activating(_), _) => toward(self.status, hold | ACTIVE),
            (Proof::Resetting(_), _) => self.reset_edge(),
            (Proof::Passed, _) if self.is_resetting() => self.reset_edge(),
            (Proof::Passed, Demand::Off) => 0,
            (Proof::Passed, Demand::Follow(_)) if self.fault().is_none() => toward(self.status, hold | ACTIVE),
            (Proof::Passed, _) => toward(self.status, hold),
            _ => 0,
        }
    }

    /// Hold, with the bit of the reset on and off in turns, so that each second word has a rising edge.
    fn reset_edge(&self) -> u16 {
        ENABLED | NOT_HELD | (!self.word & READY)
    }

    fn send(&mut self, out: &mut Outbox) {
        if matches!(self.proof, Proof::Waiting | Proof::Silent(..)) || !self.node.is_operational() {
            return;
        }
        self.word = self.control_word();
        let set_point = if self.word & ACTIVE != 0 { self.set_point() } else { 0 };
        let id = self.settings.node.id(function::RPDO1);
        out.push(self.command.pack(id, &[self.word.into(), set_point as u64]));
    }

    /// Takes another demand, and sends it at once.
    pub fn demand(&mut self, demand: Demand, out: &mut Outbox) {
        self.demand = demand;
        self.was_active &= matches!(demand, Demand::Follow(_));
        if self.proof == Proof::Passed && !self.is_resetting() {
            self.send(out);
        }
    }

    /// Resets a fault of the valve, once a person has acknowledged it. A proof that has failed is done again. One that
    /// comes soon after the last one is passed over.
    pub fn reset(&mut self, now_ns: u64) {
        if now_ns < self.next_reset_ns || self.fault().is_none() || !self.proof.is_over() {
            return;
        }
        self.next_reset_ns = now_ns + RESET_PAUSE_NS;
        if self.proof == Proof::Passed {
            self.reset_until_ns = now_ns + FOLLOW_NS;
        } else {
            (self.proof, self.fault) = (Proof::begin(now_ns), None);
        }
    }

    /// What is wrong with the valve.
    pub fn fault(&self) -> Option<Fault> {
        let is_proving = !self.proof.is_over();
        match self.node.fault() {
            // The emergency of the time-out is asked for.
            Some(fault) if !(is_proving && fault.cause == Cause::Emergency) => Some(fault),
            _ if is_proving => Some(self.node.because(Cause::Configuring, 0)),
            _ => self.fault,
        }
    }

    /// The status word that came last.
    pub fn status(&self) -> u16 {
        self.status
    }

    /// The spool position that came last, as a part of full scale.
    pub fn spool(&self) -> f64 {
        f64::from(self.spool) / f64::from(self.settings.full_scale)
    }

    /// Where the proof of the time-out stands.
    pub fn proof(&self) -> Proof {
        self.proof
    }
}

/// The next control word on the way from the state of `status` to `word`: off, disabled, held, active.
fn toward(status: u16, word: u16) -> u16 {
    match status & STATE {
        READY => ENABLED & word,
        state if state == READY | ENABLED => (ENABLED | NOT_HELD) & word,
        _ => word,
    }
}

/// Whether something has lasted for `longest_ns`; `since_ns` is its begin.
pub(super) fn lasts(is_so: bool, since_ns: &mut u64, now_ns: u64, longest_ns: u64) -> bool {
    if !is_so {
        *since_ns = 0;
    } else if *since_ns == 0 {
        *since_ns = now_ns.max(1);
    }
    is_so && now_ns.saturating_sub(*since_ns) >= longest_ns
}
