//! What has happened on a bus, counted.
//!
//! ```text
//! load = bits seen / (bit rate x time)
//! ```
//!
//! Trap: stuff bits are not counted. They make a frame up to a fifth longer, so a bus is full before the load says 1.

use std::{fmt, ops::Add};

use crate::Frame;

/// Numbers of events since the bus was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Frames received.
    pub received: u64,
    /// Frames sent.
    pub sent: u64,
    /// Frames that were not sent: no room at the adapter or in the kernel.
    pub unsent: u64,
    /// Frames that the adapter or the kernel says it has lost.
    pub lost: u64,
    /// Error frames and errors that the adapter reports, without bus-off.
    pub errors: u64,
    /// Times at which the controller has gone bus-off.
    pub bus_off: u64,
    /// Texts or frames that are none of the protocol, or cannot be understood.
    pub malformed: u64,
    /// Bits of all frames received and sent, without stuff bits.
    pub bits: u64,
}

impl Add for Counters {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            received: self.received + other.received,
            sent: self.sent + other.sent,
            unsent: self.unsent + other.unsent,
            lost: self.lost + other.lost,
            errors: self.errors + other.errors,
            bus_off: self.bus_off + other.bus_off,
            malformed: self.malformed + other.malformed,
            bits: self.bits + other.bits,
        }
    }
}

impl fmt::Display for Counters {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { received, sent, unsent, lost, errors, bus_off, malformed, .. } = self;
        write!(
            out,
            "received {received}, sent {sent}, unsent {unsent}, lost {lost}, errors {errors}, bus-off {bus_off}, "
        )?;
        write!(out, "malformed {malformed}")
    }
}

impl Counters {
    pub(crate) fn count_received(&mut self, frame: &Frame) {
        self.received += 1;
        self.bits += u64::from(frame.wire_bits());
    }

    pub(crate) fn count_sent(&mut self, frame: &Frame) {
        self.sent += 1;
        self.bits += u64::from(frame.wire_bits());
    }
}

/// Load of a bus over windows of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    bit_rate: u32,
    since_ns: u64,
    bits: u64,
    last: f64,
}

/// Length of a window, ns.
const WINDOW_NS: u64 = 1_000_000_000;

impl Load {
    /// Of a bus with `bit_rate` bit/s, from now on.
    pub fn new(bit_rate: u32, now_ns: u64) -> Self {
        Self { bit_rate, since_ns: now_ns, bits: 0, last: 0.0 }
    }

    /// The load of the last whole second, 0 to 1 and more; 0 before it.
    pub fn at(&mut self, counters: &Counters, now_ns: u64) -> f64 {
        let passed = now_ns.saturating_sub(self.since_ns);
        if passed >= WINDOW_NS {
            let room = f64::from(self.bit_rate) * passed as f64 * 1e-9;
            self.last = counters.bits.saturating_sub(self.bits) as f64 / room;
            (self.since_ns, self.bits) = (now_ns, counters.bits);
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_frames_of_eight_bytes_fill_a_ninth_of_a_megabit() {
        let mut counters = Counters::default();
        let mut load = Load::new(1_000_000, 5);
        (0..1000).for_each(|_| counters.count_received(&Frame::standard(0x181, [0; 8])));
        assert_eq!(load.at(&counters, WINDOW_NS), 0.0);
        assert!((load.at(&counters, WINDOW_NS + 5) - 0.111).abs() < 1e-12);
        assert_eq!(load.at(&counters, 2 * WINDOW_NS + 5), 0.0);
    }
}
