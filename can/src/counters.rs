//! What has happened on a bus, counted.
//!
//! ```text
//! load = (bits / bit rate + fast bits / bit rate of the data) / time
//! ```
//!
//! Fast bits are those of CAN FD frames whose data have a bit rate of their own.
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
    /// Bits of all frames received and sent, without stuff bits: those at the rate of the bus.
    pub bits: u64,
    /// Those at the rate of the data.
    pub fast_bits: u64,
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
            fast_bits: self.fast_bits + other.fast_bits,
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
        self.count_bits(frame);
    }

    pub(crate) fn count_sent(&mut self, frame: &Frame) {
        self.sent += 1;
        self.count_bits(frame);
    }

    fn count_bits(&mut self, frame: &Frame) {
        let (bits, fast_bits) = frame.wire_bits();
        self.bits += u64::from(bits);
        self.fast_bits += u64::from(fast_bits);
    }
}

/// Bit rates of a bus, bit/s.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BitRates {
    /// Of everything but the data of CAN FD frames.
    pub bus: u32,
    /// Of the data of CAN FD frames; `None` where they have that of the bus.
    pub data: Option<u32>,
}

/// Load of a bus over windows of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    rates: BitRates,
    since_ns: u64,
    /// Bits counted before this window.
    bits: (u64, u64),
    last: f64,
}

/// Length of a window, ns.
const WINDOW_NS: u64 = 1_000_000_000;

impl Load {
    /// Of a bus with these rates, from now on. Where the rate of the data is not known, that of the bus counts.
    pub fn new(rates: BitRates, now_ns: u64) -> Self {
        Self { rates, since_ns: now_ns, bits: (0, 0), last: 0.0 }
    }

    /// The load of the last whole second, 0 to 1 and more; 0 before it.
    pub fn at(&mut self, counters: &Counters, now_ns: u64) -> f64 {
        let passed = now_ns.saturating_sub(self.since_ns);
        if passed >= WINDOW_NS {
            let time = |now: u64, before: u64, rate: u32| now.saturating_sub(before) as f64 / f64::from(rate);
            let busy = time(counters.bits, self.bits.0, self.rates.bus)
                + time(counters.fast_bits, self.bits.1, self.rates.data.unwrap_or(self.rates.bus));
            self.last = busy / (passed as f64 * 1e-9);
            (self.since_ns, self.bits) = (now_ns, (counters.bits, counters.fast_bits));
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Format;

    #[test]
    fn a_thousand_frames_of_eight_bytes_fill_a_ninth_of_a_megabit() {
        let mut counters = Counters::default();
        let mut load = Load::new(BitRates { bus: 1_000_000, data: None }, 5);
        (0..1000).for_each(|_| counters.count_received(&Frame::standard(0x181, [0; 8])));
        assert_eq!(load.at(&counters, WINDOW_NS), 0.0);
        assert!((load.at(&counters, WINDOW_NS + 5) - 0.111).abs() < 1e-12);
        assert_eq!(load.at(&counters, 2 * WINDOW_NS + 5), 0.0);
    }

    #[test]
    fn fast_bits_take_the_time_of_their_rate() {
        let frame = Frame::from_raw(1, false, Format::Flexible { is_fast: true }, &[0; 64]).unwrap();
        let mut counters = Counters::default();
        let rates = BitRates { bus: 500_000, data: Some(2_000_000) };
        let (mut load, mut slow) = (Load::new(rates, 0), Load::new(BitRates { data: None, ..rates }, 0));
        (0..1000).for_each(|_| counters.count_sent(&frame));
        assert!((load.at(&counters, WINDOW_NS) - (0.030 / 0.5 + 0.549 / 2.0)).abs() < 1e-12);
        assert!((slow.at(&counters, WINDOW_NS) - 0.579 / 0.5).abs() < 1e-12);
    }
}
