//! Logs of `candump -l`: reading, playing and writing.
//!
//! ```text
//! (1436509052.249713) vcan0 044#2A366C2B        (1436509052.449) can0 1CF0A080#R
//! ```
//!
//! Time in s, interface, identifier as 3 or 8 hexadecimal digits, `#`, data or `R` and a length. A frame of CAN FD has
//! `##` and a digit of flags before its data, of which 1 says that these have a bit rate of their own. Error frames
//! (identifier with the bit 20000000h) are passed over and counted.

use std::{io, time::Duration};

use embedded_can::Frame as _;

use super::{Bus, BusError};
use crate::{Counters, Format, Frame, MAX_FD_DATA, Received};

/// Bit of an error frame in the identifier.
const ERROR_FRAME: u32 = 0x2000_0000;
/// Flag of CAN FD: its data have a bit rate of their own.
const FAST: u32 = 1;
/// Longest line that is read.
const MAX_LINE: usize = 256;

/// One line of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogLine {
    /// A frame, with its time in ns.
    Frame(Received),
    /// An error frame.
    Error,
}

/// A line that is none of a log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "line {line}: found \"{found}\"; allowed: lines such as (1436509052.249713) can0 181#2A366C2B, or with \
     181##12A366C2B and 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes of CAN FD"
)]
pub struct LogError {
    /// Number of the line, from 1 on.
    pub line: usize,
    /// Its first characters.
    pub found: String,
}

impl LogLine {
    /// Reads one line; `None` where it is none of a log.
    pub fn parse(line: &str) -> Option<Self> {
        let line = line.trim();
        if line.len() > MAX_LINE {
            return None;
        }
        let (time, rest) = line.strip_prefix('(')?.split_once(')')?;
        let time_ns = nanoseconds(time)?;
        let frame = rest.split_ascii_whitespace().nth(1)?;
        let (id, data) = frame.split_once('#')?;
        let digits = id.len();
        let raw = (digits == 3 || digits == 8).then(|| u32::from_str_radix(id, 16).ok()).flatten()?;
        if digits == 8 && raw & ERROR_FRAME != 0 {
            return Some(Self::Error);
        }
        let frame = if let Some(length) = data.strip_prefix('R') {
            let length = if length.is_empty() { 0 } else { length.parse().ok()? };
            Frame::remote(raw, digits == 8, length)?
        } else {
            let (format, data) = match data.strip_prefix('#') {
                None => (Format::Classical, data),
                Some(rest) => {
                    let (flags, data) = rest.split_at_checked(1)?;
                    let is_fast = u32::from_str_radix(flags, 16).ok()? & FAST != 0;
                    (Format::Flexible { is_fast }, data)
                }
            };
            let (bytes, length) = bytes(data)?;
            Frame::from_raw(raw, digits == 8, format, &bytes[..length])?
        };
        Some(Self::Frame(Received { frame, time_ns }))
    }
}

fn nanoseconds(time: &str) -> Option<u64> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let (seconds, fraction) = time.split_once('.').unwrap_or((time, "0"));
    if !is_number(seconds) || !is_number(fraction) || fraction.len() > 9 {
        return None;
    }
    let scale = 10_u64.pow(9 - fraction.len() as u32);
    seconds.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(fraction.parse::<u64>().ok()? * scale)
}

/// Data of up to 64 bytes, which may be parted by dots.
fn bytes(text: &str) -> Option<([u8; MAX_FD_DATA], usize)> {
    let (mut data, mut length, mut high) = ([0; MAX_FD_DATA], 0, None);
    for c in text.chars().filter(|c| *c != '.') {
        let digit = c.to_digit(16)? as u8;
        match high.take() {
            None => high = Some(digit),
            Some(high) => {
                *data.get_mut(length)? = high << 4 | digit;
                length += 1;
            }
        }
    }
    high.is_none().then_some((data, length))
}

/// Writes one line of a log.
///
/// # Errors
/// `out` cannot be written.
pub fn write_line(out: &mut impl io::Write, received: &Received, interface: &str) -> io::Result<()> {
    let (seconds, rest) = (received.time_ns / 1_000_000_000, received.time_ns % 1_000_000_000);
    let frame = &received.frame;
    write!(out, "({seconds}.{:06}) {interface} ", rest / 1000)?;
    if frame.is_extended() {
        write!(out, "{:08X}#", frame.raw_id())?
    } else {
        write!(out, "{:03X}#", frame.raw_id())?
    }
    if frame.is_remote_frame() {
        return if frame.dlc() == 0 { writeln!(out, "R") } else { writeln!(out, "R{}", frame.dlc()) };
    }
    if let Format::Flexible { is_fast } = frame.format() {
        write!(out, "#{}", u32::from(is_fast) * FAST)?;
    }
    frame.data().iter().try_for_each(|byte| write!(out, "{byte:02X}"))?;
    writeln!(out)
}

/// A log as a bus: its frames come with the times of the log, one after the other, and what is sent goes nowhere.
#[derive(Debug)]
pub struct Playback {
    frames: Vec<Received>,
    next: usize,
    counters: Counters,
}

impl Playback {
    /// Reads the text of a log.
    ///
    /// # Errors
    /// A line is none of a log. Empty lines are.
    pub fn read(text: &str) -> Result<Self, LogError> {
        let (mut frames, mut counters) = (Vec::new(), Counters::default());
        for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            match LogLine::parse(line) {
                Some(LogLine::Frame(frame)) => frames.push(frame),
                Some(LogLine::Error) => counters.errors += 1,
                None => return Err(LogError { line: i + 1, found: line.chars().take(60).collect() }),
            }
        }
        Ok(Self { frames, next: 0, counters })
    }
}

impl Bus for Playback {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        let received = *self.frames.get(self.next).ok_or(BusError::Ended)?;
        self.next += 1;
        self.counters.count_received(&received.frame);
        Ok(Some(received))
    }

    fn send(&mut self, _: &Frame) -> Result<bool, BusError> {
        self.counters.unsent += 1;
        Ok(false)
    }

    fn flush(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn wait(&mut self, _: Duration) -> Result<(), BusError> {
        Ok(())
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LOG: &str = "(1436509052.249713) vcan0 044#2A366C2B\n\
                       (1436509052.449847) vcan0 1CF0A080#R3\n\n\
                       (1436509052.65) can1 123##10011\n\
                       (1436509053) can1 20000004#0000000000000000\n\
                       (1436509053.000001) can1 7FF#\n";

    #[test]
    fn a_log_is_played_with_its_times() {
        let mut playback = Playback::read(LOG).unwrap();
        let first = playback.receive().unwrap().unwrap();
        assert_eq!(first.frame, Frame::standard(0x44, [0x2A, 0x36, 0x6C, 0x2B]));
        assert_eq!(first.time_ns, 1_436_509_052_249_713_000);
        let second = playback.receive().unwrap().unwrap().frame;
        assert!(second.is_remote_frame() && second.is_extended() && second.dlc() == 3);
        let third = playback.receive().unwrap().unwrap().frame;
        assert_eq!((third.raw_id(), third.data()), (0x123, &[0x00, 0x11][..]));
        assert_eq!(third.format(), Format::Flexible { is_fast: true });
        assert_eq!(playback.receive().unwrap().unwrap().frame, Frame::standard(0x7FF, []));
        assert!(matches!(playback.receive(), Err(BusError::Ended)));
        assert_eq!((playback.counters().errors, playback.counters().malformed), (1, 0));
        assert!(!playback.send(&first.frame).unwrap());
    }

    #[test]
    fn a_line_that_is_none_is_named() {
        let error = Playback::read("(1.0) can0 181#00\nnot a line\n").unwrap_err();
        let said = error.to_string();
        let expected = "line 2: found \"not a line\"; allowed: lines such as (1436509052.249713) can0 181#2A366C2B, or";
        assert!(said.starts_with(expected), "{said}");
        for wrong in [
            "(1.0) can0 181#0",
            "(1.0) can0 181",
            "(1.0) can0 1811#00",
            "(-1.0) can0 181#00",
            "() can0 181#",
            "(1.0) can0 181#001122334455667788",
            "(1.0) can0 FFF#00",
            "(1.0000000001) can0 181#00",
            "(1.0) can0 181#R9",
            "(1.0) can0 181##",
            "(1.0) can0 181##g00",
            "(1.0) can0 181##1001122334455667788",
        ] {
            assert_eq!(LogLine::parse(wrong), None, "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn lines_are_read_as_they_were_written(
            raw in 0_u32..0x2000_0000,
            is_extended: bool,
            us in 0_u64..1 << 50,
            format in prop::sample::select(vec![
                Format::Classical, Format::Flexible { is_fast: false }, Format::Flexible { is_fast: true }
            ]),
            data in prop::collection::vec(0_u8.., 0..=64)
        ) {
            let raw = if is_extended { raw } else { raw & 0x7FF };
            let Some(frame) = Frame::from_raw(raw, is_extended, format, &data) else { return Ok(()) };
            let received = Received { frame, time_ns: us * 1000 };
            let mut line = Vec::new();
            write_line(&mut line, &received, "can0").unwrap();
            prop_assert_eq!(LogLine::parse(&String::from_utf8(line).unwrap()), Some(LogLine::Frame(received)));
        }

        #[test]
        fn no_text_is_too_strange(text in "\\PC{0,80}") {
            let _ = Playback::read(&text);
        }
    }
}
