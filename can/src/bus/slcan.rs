//! slcan: frames as lines of text, as adapters with a serial port speak it (Lawicel).
//!
//! ```text
//! tIIILDD..   data frame with 11 bits        TIIIIIIIILDD..   data frame with 29 bits
//! rIIIL       remote frame with 11 bits      RIIIIIIIIL       remote frame with 29 bits
//! ```
//!
//! I identifier and D data as hexadecimal digits, L number of bytes 0 to 8; a carriage return ends the line. After the
//! data of a received frame an adapter may add four digits of its own clock, which are passed over. Answers: a carriage
//! return or `z`, `Z` is done, BEL is refused. `F` with two digits has the adapter's status.
//!
//! Trap: an adapter keeps its channel open when the program ends, and a line that was cut off at the start of the
//! program is no error of the bus. `C` closes the channel first, and all text before the first answer is passed over.
//!
//! Trap: text waits where the adapter takes none. A set point that came late would move a valve that has been neutral
//! since. What has waited for [`STALL_NS`] is dropped and counted, and the bus is full.

use std::{
    io::ErrorKind,
    os::fd::OwnedFd,
    path::Path,
    thread::sleep,
    time::{Duration, Instant},
};

use embedded_can::Frame as _;

use super::{Bus, BusError, serial::Port};
use crate::{Counters, Format, Frame, MAX_DATA, Received, frame_clock::monotonic_ns};

/// Bit rates that slcan knows, bit/s; the place of each is its digit.
pub const BIT_RATES: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];
/// Longest line: T, 8 digits, length, 16 digits, 4 digits of the clock, carriage return.
pub const MAX_TEXT: usize = 31;
/// Text that is read at once.
const READ_ROOM: usize = 4096;
/// Text that waits to be written: 64 frames of the longest kind.
const WRITE_ROOM: usize = 64 * MAX_TEXT;
/// Longest time that an adapter may take to answer when it is opened.
const ANSWER: Duration = Duration::from_millis(500);
/// Time without progress after which the frames that wait are given up, ns. A bus of 10 kbit/s takes a frame in 11 ms.
const STALL_NS: u64 = 100_000_000;
/// Status bits of the answer to `F`: bus error, and data overrun with receive queue full.
const STATUS_ERRORS: u8 = 0x80;
const STATUS_LOST: u8 = 0x09;

/// Digit of a bit rate; that of the nearest one below where there is none.
fn bit_rate_digit(bit_rate: u32) -> usize {
    BIT_RATES.iter().rposition(|known| *known <= bit_rate).unwrap_or(0)
}

/// Writes a frame as text; returns the number of bytes. `None` of a frame of CAN FD: slcan has none.
pub fn encode(frame: &Frame, text: &mut [u8; MAX_TEXT]) -> Option<usize> {
    let kind = match (frame.is_extended(), frame.format()) {
        (false, Format::Classical) => b't',
        (true, Format::Classical) => b'T',
        (false, Format::Remote) => b'r',
        (true, Format::Remote) => b'R',
        (_, Format::Flexible { .. }) => return None,
    };
    let digits = if frame.is_extended() { 8 } else { 3 };
    let mut length = 0;
    let mut put = |byte: u8| {
        text[length] = byte;
        length += 1;
    };
    put(kind);
    for i in (0..digits).rev() {
        put(digit((frame.raw_id() >> (4 * i)) as u8));
    }
    put(digit(frame.dlc() as u8));
    for byte in frame.data() {
        put(digit(byte >> 4));
        put(digit(*byte));
    }
    put(b'\r');
    Some(length)
}

fn digit(value: u8) -> u8 {
    b"0123456789ABCDEF"[usize::from(value & 0xF)]
}

fn value(digit: u8) -> Option<u32> {
    char::from(digit).to_digit(16)
}

fn number(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0, |sum, digit| Some(sum << 4 | value(*digit)?))
}

/// What a line says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decoded {
    /// A frame was received.
    Frame(Frame),
    /// A command was done, or a frame was taken.
    Done,
    /// A command was refused, or there was no room for a frame.
    Refused,
    /// Status bits of the adapter.
    Status(u8),
    /// A command that opens, closes or sets up the channel: only the end of the adapter gets it.
    Command,
    /// A line that is none of the protocol.
    Malformed,
}

/// Reads text byte by byte.
#[derive(Debug, Clone)]
pub struct Decoder {
    line: [u8; MAX_TEXT],
    length: usize,
    is_too_long: bool,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { line: [0; MAX_TEXT], length: 0, is_too_long: false }
    }
}

impl Decoder {
    /// Takes one byte; says something at the end of a line.
    pub fn take(&mut self, byte: u8) -> Option<Decoded> {
        match byte {
            b'\r' | b'\n' => {
                let line = &self.line[..self.length];
                let decoded = if self.is_too_long { Decoded::Malformed } else { decode(line) };
                let is_nothing = byte == b'\n' && self.length == 0;
                (self.length, self.is_too_long) = (0, false);
                (!is_nothing).then_some(decoded)
            }
            // BEL stands alone.
            7 => {
                (self.length, self.is_too_long) = (0, false);
                Some(Decoded::Refused)
            }
            _ => {
                match self.line.get_mut(self.length) {
                    Some(place) => {
                        *place = byte;
                        self.length += 1;
                    }
                    None => self.is_too_long = true,
                }
                None
            }
        }
    }
}

fn decode(line: &[u8]) -> Decoded {
    match line {
        [] | [b'z' | b'Z'] => Decoded::Done,
        [b'C' | b'O' | b'L' | b'F' | b'V' | b'v' | b'N'] | [b'S' | b'Z', b'0'..=b'9'] => Decoded::Command,
        // A version or a serial number is an answer as well.
        [b'V' | b'v' | b'N', ..] => Decoded::Done,
        [b'F', rest @ ..] if rest.len() == 2 => {
            number(rest).map_or(Decoded::Malformed, |status| Decoded::Status(status as u8))
        }
        // Some adapters answer a frame that was sent by z or Z right before the next line.
        [b'z' | b'Z', rest @ ..] => decode_frame(rest).map_or(Decoded::Malformed, Decoded::Frame),
        _ => decode_frame(line).map_or(Decoded::Malformed, Decoded::Frame),
    }
}

fn decode_frame(line: &[u8]) -> Option<Frame> {
    let (kind, rest) = line.split_first()?;
    let (is_extended, is_remote) = match kind {
        b't' => (false, false),
        b'T' => (true, false),
        b'r' => (false, true),
        b'R' => (true, true),
        _ => return None,
    };
    let (id, rest) = rest.split_at_checked(if is_extended { 8 } else { 3 })?;
    let (length, rest) = rest.split_first()?;
    let length = value(*length).filter(|length| *length <= MAX_DATA as u32)? as usize;
    let (digits, clock) = rest.split_at_checked(if is_remote { 0 } else { 2 * length })?;
    if !matches!(clock.len(), 0 | 4) || number(clock).is_none() {
        return None;
    }
    let mut data = [0; MAX_DATA];
    for (byte, pair) in data.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = number(pair)? as u8;
    }
    let id = number(id)?;
    if is_remote {
        return Frame::remote(id, is_extended, length);
    }
    Frame::from_raw(id, is_extended, Format::Classical, &data[..length])
}

fn explain(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::WouldBlock => {
            "another program has this port, such as a running group; allowed: one at a time, so end that one first"
        }
        ErrorKind::PermissionDenied => {
            "this user may not open the port; allowed: members of its group, mostly dialout: usermod -aG dialout USER"
        }
        _ => "cannot be opened as a serial port",
    }
}

/// An adapter that speaks slcan.
pub struct SlcanBus {
    port: Port,
    decoder: Decoder,
    input: Box<[u8; READ_ROOM]>,
    /// Bytes of `input` that were read, and those of them that were decoded.
    read: usize,
    decoded: usize,
    time_ns: u64,
    output: Box<[u8; WRITE_ROOM]>,
    waiting: usize,
    /// Since when the adapter has taken nothing of what waits, ns.
    stalled_since_ns: Option<u64>,
    /// Whether this is the end of the adapter, which answers commands.
    is_adapter: bool,
    counters: Counters,
}

impl SlcanBus {
    /// Opens the adapter at `path` with a bit rate, bit/s: one of [`BIT_RATES`].
    ///
    /// # Errors
    /// The port cannot be opened, or the adapter does not answer or refuses.
    pub fn open(path: &Path, bit_rate: u32) -> Result<Self, BusError> {
        let name = path.display().to_string();
        let port = Port::open(path).map_err(|error| BusError::open(&name, explain(&error), error))?;
        let mut bus = Self::with(port);
        let bit_rate = format!("S{}\r", bit_rate_digit(bit_rate));
        // The first C may end a line that was cut off. An adapter whose channel is closed may refuse C.
        for command in ["C\r", "C\r", &bit_rate, "O\r"] {
            bus.put(command.as_bytes()).map_err(BusError::Gone)?;
            bus.await_answer(&name, command.trim_end(), command == "C\r")?;
        }
        bus.counters = Counters::default();
        Ok(bus)
    }

    /// The end of the adapter: answers what [`Self::open`] asks, and exchanges frames. For simulated devices.
    ///
    /// # Errors
    /// The port cannot be used.
    pub fn adapter(port: OwnedFd) -> Result<Self, BusError> {
        Ok(Self { is_adapter: true, ..Self::with(Port::of(port).map_err(BusError::Gone)?) })
    }

    fn with(port: Port) -> Self {
        Self {
            port,
            decoder: Decoder::default(),
            input: Box::new([0; READ_ROOM]),
            read: 0,
            decoded: 0,
            time_ns: 0,
            output: Box::new([0; WRITE_ROOM]),
            waiting: 0,
            stalled_since_ns: None,
            is_adapter: false,
            counters: Counters::default(),
        }
    }

    /// Drops the frames that wait where none of them was taken for too long.
    fn watch(&mut self, has_gone_on: bool) -> Result<(), BusError> {
        let now_ns = monotonic_ns();
        if has_gone_on {
            self.stalled_since_ns = None;
            return Ok(());
        }
        if now_ns.saturating_sub(*self.stalled_since_ns.get_or_insert(now_ns)) < STALL_NS {
            return Ok(());
        }
        self.counters.unsent += self.output[..self.waiting].iter().filter(|byte| **byte == b'\r').count() as u64;
        (self.waiting, self.stalled_since_ns) = (0, None);
        // Nobody listens to a simulated adapter: that is no fault of it.
        if self.is_adapter { Ok(()) } else { Err(BusError::Full) }
    }

    /// Writes all of `bytes`, within the time of an answer.
    fn put(&mut self, mut bytes: &[u8]) -> std::io::Result<()> {
        let until = Instant::now() + ANSWER;
        while !bytes.is_empty() && Instant::now() < until {
            let length = self.port.write(bytes)?;
            bytes = &bytes[length..];
            if length == 0 {
                // A port that takes nothing must not keep a core of real time busy.
                sleep(Duration::from_millis(1));
            }
        }
        Ok(())
    }

    fn await_answer(&mut self, name: &str, command: &str, may_refuse: bool) -> Result<(), BusError> {
        let until = Instant::now() + ANSWER;
        while Instant::now() < until {
            match self.next_line()? {
                Some(Decoded::Done) => return Ok(()),
                Some(Decoded::Refused) if may_refuse => return Ok(()),
                Some(Decoded::Refused) => {
                    let what = format!("the adapter refuses {command}; allowed: a bit rate that it knows");
                    return Err(BusError::open(name, &what, std::io::ErrorKind::InvalidInput.into()));
                }
                Some(_) => {}
                None => self.port.wait(Duration::from_millis(10)).map_err(BusError::Gone)?,
            }
        }
        let what = format!("no answer to {command} within 500ms; allowed: an adapter that speaks slcan");
        Err(BusError::open(name, &what, ErrorKind::TimedOut.into()))
    }

    /// The next line; `None` where nothing has come. One read for each [`READ_ROOM`] bytes: a shorter one took all,
    /// and what has come since is read at the next call.
    fn next_line(&mut self) -> Result<Option<Decoded>, BusError> {
        loop {
            while self.decoded < self.read {
                self.decoded += 1;
                if let Some(line) = self.decoder.take(self.input[self.decoded - 1]) {
                    return Ok(Some(line));
                }
            }
            let was_all = (1..READ_ROOM).contains(&self.read);
            (self.read, self.decoded) = (0, 0);
            if was_all {
                return Ok(None);
            }
            self.read = self.port.read(&mut self.input[..]).map_err(BusError::Gone)?;
            self.time_ns = monotonic_ns();
            if self.read == 0 {
                return Ok(None);
            }
        }
    }
}

impl Bus for SlcanBus {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        // One call looks at so many lines at most: answers of the adapter must not hold up its reader.
        for _ in 0..READ_ROOM {
            match self.next_line()? {
                None => return Ok(None),
                Some(Decoded::Frame(frame)) => {
                    self.counters.count_received(&frame);
                    return Ok(Some(Received { frame, time_ns: self.time_ns }));
                }
                Some(Decoded::Done) => {}
                Some(Decoded::Refused) => self.counters.unsent += 1,
                Some(Decoded::Status(bits)) => {
                    self.counters.errors += u64::from(bits & STATUS_ERRORS != 0);
                    self.counters.lost += u64::from(bits & STATUS_LOST != 0);
                }
                Some(Decoded::Command) if self.is_adapter => self.put(b"\r").map_err(BusError::Gone)?,
                Some(Decoded::Command | Decoded::Malformed) => self.counters.malformed += 1,
            }
        }
        Ok(None)
    }

    fn send(&mut self, frame: &Frame) -> Result<bool, BusError> {
        let mut text = [0; MAX_TEXT];
        let text = encode(frame, &mut text).map(|length| &text[..length]);
        let room = text.and_then(|text| Some((self.output.get_mut(self.waiting..self.waiting + text.len())?, text)));
        let Some((room, text)) = room else {
            self.counters.unsent += 1;
            return Ok(false);
        };
        room.copy_from_slice(text);
        self.waiting += text.len();
        self.counters.count_sent(frame);
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), BusError> {
        if self.waiting > 0 {
            let length = self.port.write(&self.output[..self.waiting]).map_err(BusError::Gone)?;
            self.output.copy_within(length..self.waiting, 0);
            self.waiting -= length;
            self.watch(length > 0)?;
        }
        Ok(())
    }

    fn is_flexible(&self) -> bool {
        false
    }

    fn wait(&mut self, longest: Duration) -> Result<(), BusError> {
        self.port.wait(longest).map_err(BusError::Gone)
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::bus::serial::pseudo_terminal;

    fn lines(text: &[u8]) -> Vec<Decoded> {
        let mut decoder = Decoder::default();
        text.iter().filter_map(|byte| decoder.take(*byte)).collect()
    }

    fn text_of(frame: &Frame) -> String {
        let mut text = [0; MAX_TEXT];
        let length = encode(frame, &mut text).unwrap();
        String::from_utf8(text[..length].to_vec()).unwrap()
    }

    #[test]
    fn bit_rates_have_digits() {
        assert_eq!((bit_rate_digit(1_000_000), bit_rate_digit(250_000), bit_rate_digit(0)), (8, 5, 0));
    }

    #[test]
    fn frames_are_the_lines_of_the_protocol() {
        let frame = Frame::standard(0x100, [0xA0, 0x0B]);
        assert_eq!(text_of(&frame), "t1002A00B\r");
        let remote = Frame::remote(0x1CF0_A080, true, 3).unwrap();
        assert_eq!(text_of(&remote), "R1CF0A0803\r");
        // With the clock of the adapter, and after its answer to a frame that was sent.
        assert_eq!(lines(b"t1002A00B12AB\rzt1002a00b\r"), [Decoded::Frame(frame); 2]);
        assert_eq!(
            lines(b"\rz\rZ\r\x07V1013\rF89\r"),
            [Decoded::Done, Decoded::Done, Decoded::Done, Decoded::Refused, Decoded::Done, Decoded::Status(0x89)]
        );
    }

    #[test]
    fn lines_that_are_none_are_counted_and_the_next_one_is_read() {
        for wrong in ["t1009A00B", "t100", "t10G0", "t1002A00", "t8000", "T200000000", "x", "t1002A00B1", "F8"] {
            assert_eq!(lines(format!("{wrong}\r").as_bytes()), [Decoded::Malformed], "{wrong}");
        }
        let long = [b"T".repeat(500), b"\rt1000\r".to_vec()].concat();
        assert_eq!(lines(&long), [Decoded::Malformed, Decoded::Frame(Frame::standard(0x100, []))]);
    }

    proptest! {
        #[test]
        fn frames_are_read_as_they_were_written(
            raw in 0_u32..0x2000_0000, is_extended: bool, is_remote: bool, data in prop::collection::vec(0_u8.., 0..=8)
        ) {
            let raw = if is_extended { raw } else { raw & 0x7FF };
            let frame = if is_remote {
                Frame::remote(raw, is_extended, data.len())
            } else {
                Frame::from_raw(raw, is_extended, Format::Classical, &data)
            };
            let frame = frame.unwrap();
            prop_assert_eq!(lines(text_of(&frame).as_bytes()), [Decoded::Frame(frame)]);
        }

        #[test]
        fn no_bytes_are_too_strange(text in prop::collection::vec(0_u8.., 0..300)) {
            let mut decoder = Decoder::default();
            for byte in text {
                if let Some(Decoded::Frame(frame)) = decoder.take(byte) {
                    prop_assert!(frame.dlc() <= MAX_DATA);
                }
            }
        }
    }

    #[test]
    fn frames_cross_a_pseudo_terminal() {
        let (adapter, path) = pseudo_terminal().unwrap();
        let device = std::thread::spawn(move || {
            let mut device = SlcanBus::adapter(adapter).unwrap();
            let until = Instant::now() + Duration::from_secs(20);
            let mut seen = 0;
            while seen < 1000 && Instant::now() < until {
                while let Some(received) = device.receive().unwrap() {
                    seen += 1;
                    device.send(&received.frame).unwrap();
                }
                device.flush().unwrap();
                device.wait(Duration::from_millis(10)).unwrap();
            }
            seen
        });
        let mut bus = SlcanBus::open(Path::new(&path), 1_000_000).unwrap();
        let mut next = 0_u16;
        for i in 0..1000_u16 {
            assert!(bus.send(&Frame::standard(0x181, i.to_le_bytes())).unwrap());
            bus.flush().unwrap();
            let until = Instant::now() + Duration::from_secs(5);
            while next <= i && Instant::now() < until {
                bus.wait(Duration::from_millis(10)).unwrap();
                while let Some(received) = bus.receive().unwrap() {
                    assert_eq!(received.frame, Frame::standard(0x181, next.to_le_bytes()));
                    next += 1;
                }
            }
        }
        assert_eq!((next, device.join().unwrap()), (1000, 1000));
        assert_eq!((bus.counters().received, bus.counters().sent, bus.counters().malformed), (1000, 1000, 0));
        // The adapter is unplugged.
        assert!(matches!(bus.receive(), Err(BusError::Gone(_))));
    }

    #[test]
    fn an_adapter_that_takes_nothing_is_a_full_bus_and_no_old_frame_reaches_it_later() {
        let (adapter, path) = pseudo_terminal().unwrap();
        let port = Port::of(adapter).unwrap();
        let mut bus = SlcanBus::with(Port::open(Path::new(&path)).unwrap());
        let (begun, mut sent) = (Instant::now(), 0);
        let error = loop {
            bus.send(&Frame::standard(0x215, [7, 0, 0, 0x40])).unwrap();
            sent += 1;
            match bus.flush() {
                Err(error) => break error,
                Ok(()) => assert!(begun.elapsed() < Duration::from_secs(20), "nobody reads, and the bus is not full"),
            }
        };
        assert!(matches!(error, BusError::Full), "{error}");
        assert!(begun.elapsed() >= Duration::from_nanos(STALL_NS));
        // What the kernel holds was sent; the rest is counted.
        let counters = *bus.counters();
        assert!(counters.unsent > 0 && counters.sent + counters.unsent >= sent, "{counters:?} of {sent}");
        drop(bus);
        let mut bus = SlcanBus::with(Port::open(Path::new(&path)).unwrap());
        bus.send(&Frame::standard(0x300, [])).unwrap();
        bus.flush().unwrap();
        let (mut text, mut length) = ([0; READ_ROOM], 0);
        while length < text.len() && !text[..length].ends_with(b"t3000\r") {
            length += port.read(&mut text[length..]).unwrap();
        }
        let old = text[..length].windows(4).filter(|four| four == b"t215").count();
        assert!((old as u64) < sent - counters.unsent, "{old} of {sent}");
    }

    #[test]
    fn a_port_without_an_adapter_is_explained() {
        let (_silent, path) = pseudo_terminal().unwrap();
        let Err(error) = SlcanBus::open(Path::new(&path), 500_000) else { panic!("nobody answers") };
        assert!(error.to_string().contains("no answer to C within 500ms"), "{error}");
        let Err(error) = SlcanBus::open(Path::new("/dev/none-such"), 500_000) else { panic!("there is no such port") };
        assert_eq!(error.to_string(), "/dev/none-such: cannot be opened as a serial port");
    }
}
