//! What is wrong with a device, as the error word of a reading.
//!
//! ```text
//! word = detail << 16 | node << 8 | cause         0: nothing is wrong
//! ```
//!
//! A message that is no CANopen has no node: it has the number 255, and the detail is the lower half of its identifier.

use std::fmt;

use super::super::canopen::NodeState;

/// Why a device cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Cause {
    /// The device has not answered yet.
    Absent = 1,
    /// The device is being set up.
    Configuring = 2,
    /// The device refuses a setting or keeps another one; the detail is the index of the object.
    Setting = 3,
    /// A device of another profile; the detail is the number of its profile.
    Profile = 4,
    /// The step of the encoder is another one than the machine file says; the detail is the step in 0.001 mm, or in
    /// 0.001 degrees.
    Scale = 5,
    /// The heartbeat has stopped.
    Heartbeat = 6,
    /// The device has restarted.
    Restart = 7,
    /// The device has left its operational state; the detail is the state.
    State = 8,
    /// The device has sent an emergency; the detail is its code.
    Emergency = 9,
    /// The encoder has an alarm; the detail is 6503h.
    Alarm = 10,
    /// No position for so many SYNC in a row as the time-out of the feedback has.
    Silent = 11,
    /// More than one position for a SYNC: two devices have one number.
    Double = 12,
    /// The valve has a fault or does not follow the control word; the detail is the status word.
    Valve = 13,
    /// The valve did not stop when set points stopped: its time-out does not act.
    Proof = 14,
    /// The spool is further out than commanded, or on the other side; the detail is the spool's position.
    Spool = 15,
    /// The bus is gone: adapter unplugged, interface down.
    Bus = 16,
    /// The message has not come for its time-out.
    Stale = 17,
    /// The alive counter of the message stands still.
    Counter = 18,
    /// The checksum of the message is wrong, or the message is too short.
    Checksum = 19,
    /// The pilot pressure is cut off, by the signal of the machine.
    Pilot = 20,
    /// Set points that this program has not sent: somebody else commands the drive as well.
    Sender = 21,
}

/// In the place of a node's number: the detail has the lower half of a message's identifier.
pub(super) const FRAME: u8 = 255;

/// What is said of [`Cause::Sender`].
const SENDER: &str = "its set points are sent by somebody else as well: find who, before anything is armed";

/// Causes in the order of their numbers.
const CAUSES: [Cause; 21] = [
    Cause::Absent,
    Cause::Configuring,
    Cause::Setting,
    Cause::Profile,
    Cause::Scale,
    Cause::Heartbeat,
    Cause::Restart,
    Cause::State,
    Cause::Emergency,
    Cause::Alarm,
    Cause::Silent,
    Cause::Double,
    Cause::Valve,
    Cause::Proof,
    Cause::Spool,
    Cause::Bus,
    Cause::Stale,
    Cause::Counter,
    Cause::Checksum,
    Cause::Pilot,
    Cause::Sender,
];

/// What is wrong with a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault {
    /// Why it cannot be used.
    pub cause: Cause,
    /// Its number; 0 of the bus.
    pub node: u8,
    /// What the cause says; 0 where it says nothing.
    pub detail: u16,
}

impl Fault {
    /// As the error word of a reading.
    pub fn word(self) -> u32 {
        u32::from(self.detail) << 16 | u32::from(self.node) << 8 | self.cause as u32
    }

    /// Of an error word; `None` of 0 and of words that are none.
    pub fn of(word: u32) -> Option<Self> {
        let [cause, node, low, high] = word.to_le_bytes();
        let cause = *CAUSES.get(usize::from(cause).checked_sub(1)?)?;
        Some(Self { cause, node, detail: u16::from_le_bytes([low, high]) })
    }
}

impl Cause {
    /// What is wrong with a message, or with the drive that takes it.
    fn of_message(self) -> &'static str {
        match self {
            Self::Absent => "has not come yet: check power, wiring, bit rate and identifier",
            Self::Configuring => "the time-out of its drive is being proven",
            Self::Stale => "comes no more",
            Self::Counter => "its alive counter stands still",
            Self::Checksum => "its checksum is wrong, or it is too short",
            Self::Proof => "its drive did not stop when the message stopped: its time-out does not act",
            Self::Valve => "its drive does not follow it",
            Self::Sender => SENDER,
            _ => "a fault",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let detail = self.detail;
        if self.cause == Cause::Bus {
            return out.write_str("the bus is gone: adapter unplugged or interface down");
        }
        if self.cause == Cause::Pilot {
            return out.write_str("the pilot pressure is cut off, by its signal");
        }
        if self.node == FRAME {
            write!(out, "message ..{detail:04X}h: ")?;
            return out.write_str(self.cause.of_message());
        }
        write!(out, "node {}: ", self.node)?;
        match self.cause {
            Cause::Absent => out.write_str("no answer: check power, wiring, bit rate and number of the node"),
            Cause::Configuring => out.write_str("is being set up"),
            Cause::Setting => write!(out, "refuses {detail:04X}h, or keeps another value"),
            Cause::Profile => {
                write!(
                    out,
                    "found a device of profile {detail}; allowed: 406 of encoders, 408 of valves, 410 of inclinometers"
                )
            }
            Cause::Scale => {
                write!(
                    out,
                    "a count of {detail} um (6005h), or of {detail} thousandths of a degree (6000h); allowed: "
                )?;
                out.write_str("the length of a count in the machine file, encoder.resolution or angle_resolution")
            }
            Cause::Heartbeat => out.write_str("the heartbeat has stopped"),
            Cause::Restart => out.write_str("has restarted"),
            Cause::State => match NodeState::of(detail as u8) {
                Some(state) => write!(out, "has become {state:?}"),
                None => write!(out, "has state {detail}"),
            },
            Cause::Emergency => write!(out, "emergency {detail:04X}h"),
            Cause::Alarm => write!(out, "alarm, 6503h is {detail:04X}h"),
            Cause::Silent => out.write_str("sends no position"),
            Cause::Sender => out.write_str(SENDER),
            Cause::Double => out.write_str("sends more than one position for a SYNC: two devices have this number"),
            Cause::Valve => write!(out, "fault, status word {detail:04X}h"),
            Cause::Proof => out.write_str("did not stop when set points stopped: its time-out, 1400h:5, does not act"),
            Cause::Spool => write!(out, "spool at {} against its set point", detail as i16),
            // Those of messages, and of the whole bus.
            Cause::Bus | Cause::Stale | Cause::Counter | Cause::Checksum | Cause::Pilot => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_were_written() {
        for (i, cause) in CAUSES.into_iter().enumerate() {
            assert_eq!(cause as usize, i + 1);
            let fault = Fault { cause, node: 127, detail: 0x8130 };
            assert_eq!(Fault::of(fault.word()), Some(fault));
        }
        assert_eq!((Fault::of(0), Fault::of(200)), (None, None));
        let fault = Fault { cause: Cause::Emergency, node: 5, detail: 0x8130 };
        assert_eq!(fault.to_string(), "node 5: emergency 8130h");
    }
}
