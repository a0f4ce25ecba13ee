//! The CAN bus with encoders and valves: `[can]`. Its devices are in `[axis.NAME.can]`, and its messages that are no
//! CANopen in `[[can.message]]` or a DBC file.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use super::{document::Section, timing::Timing};

/// The bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CanBus {
    /// An interface of the kernel such as `can0`, or the path of a serial port with an adapter that speaks slcan.
    pub interface: String,
    /// Bit rate, bit/s: set at an adapter; for the load only at an interface of the kernel.
    pub bit_rate: u32,
    /// Bit rate of the data of CAN FD frames, bit/s; `None` where it is that of the bus.
    pub data_bit_rate: Option<u32>,
    /// Time between two SYNC: all encoders are read at each of them.
    pub sync: Duration,
    /// Period of the heartbeats of all devices.
    pub heartbeat: Duration,
    /// Longest time that a device may take to answer while it is set up.
    pub answer: Duration,
    /// A DBC file with the messages that are no CANopen.
    pub dbc: Option<PathBuf>,
    /// Messages, or what the DBC file does not say of them.
    pub messages: Vec<CanMessage>,
    /// Signal that is not 0 while the emergency stop is pressed.
    pub emergency_stop: Option<String>,
    /// Signal that is 0 while the pilot pressure is cut off.
    pub pilot: Option<String>,
}

/// A message that is no CANopen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CanMessage {
    /// Its name.
    pub name: String,
    /// Its identifier and whether that has 29 bits; `None` where the DBC file has it.
    pub id: Option<(u32, bool)>,
    /// Its bytes.
    pub length: u8,
    /// Whether its frames are of CAN FD.
    pub is_flexible: bool,
    /// Its signals, in the notation of DBC files with the name in front.
    pub signals: Vec<String>,
    /// Name of the signal with the alive counter.
    pub counter: Option<String>,
    /// Byte of the checksum, from 0.
    pub checksum: Option<u8>,
    /// How it is made.
    pub checksum_kind: ChecksumKind,
    /// Time without the message after which it is a fault.
    pub timeout: Option<Duration>,
    /// Least time between two of them, where it is sent.
    pub period: Duration,
    /// Values of signals while an axis follows, while none does, and with the pilot pressure cut off, where it is sent.
    pub patterns: [Vec<String>; 3],
}

/// How a checksum is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChecksumKind {
    /// Exclusive or of all other bytes.
    Xor,
    /// Sum of all other bytes.
    Sum,
    /// CRC of 8 bits of SAE J1850.
    Crc8J1850,
}

/// Names of checksums in the machine file.
const CHECKSUMS: [(&str, ChecksumKind); 3] =
    [("xor", ChecksumKind::Xor), ("sum", ChecksumKind::Sum), ("crc8-j1850", ChecksumKind::Crc8J1850)];
/// Largest identifier of 29 bits, and of 11 bits.
const MAX_EXTENDED: usize = 0x1FFF_FFFF;
const MAX_STANDARD: usize = 0x7FF;

/// Most bytes of a classical frame, and numbers of bytes above that CAN FD has.
const MAX_CLASSICAL: u8 = 8;
const FD_LENGTHS: [u8; 7] = [12, 16, 20, 24, 32, 48, 64];

impl CanMessage {
    /// Refuses keys that contradict each other, and those without an effect.
    fn expect_sound(&self, section: &mut Section) {
        if self.id.is_some_and(|(id, is_extended)| !is_extended && id > MAX_STANDARD as u32) {
            section.refuse("extended", "false", "true with an identifier above 2047");
        }
        if self.id.is_none() && !section.is_refused(&section.path_of("id")) {
            section.exclude(
                &["extended", "length", "fd", "signals"],
                false,
                "beside id; the DBC file says it of this message",
            );
        }
        let is_long = self.length > MAX_CLASSICAL;
        if is_long && !FD_LENGTHS.contains(&self.length) {
            section.refuse("length", self.length.to_string(), "1 to 8, 12, 16, 20, 24, 32, 48 or 64");
        }
        if is_long && !self.is_flexible {
            section.refuse("fd", "false", "true with a message of more than 8 bytes");
        }
        if self.checksum.is_none() {
            section.exclude(&["checksum_kind"], false, "beside checksum, the byte that it is made for");
        }
    }

    fn read(mut section: Section) -> Self {
        let name = section.key("name", "Name of the message; that of the DBC file, or any other").text("a name");
        let id = section
            .key("id", "Identifier of the message, where the DBC file has none of this name")
            .optional_integer(0..=MAX_EXTENDED);
        let is_extended = section
            .key("extended", "Whether the identifier has 29 bits")
            .rule("true above 2047")
            .flag_or(id.is_some_and(|id| id > MAX_STANDARD));
        let length = section
            .key("length", "Bytes of the message; more than 8 are of CAN FD: 12, 16, 20, 24, 32, 48 or 64")
            .integer_or(8, 1..=64) as u8;
        let is_flexible = section
            .key("fd", "Whether its frames are of CAN FD")
            .rule("true above 8 bytes")
            .flag_or(length > MAX_CLASSICAL);
        let mut texts = |key, meaning, allowed| section.key(key, meaning).optional_texts(allowed).unwrap_or_default();
        let signals = texts(
            "signals",
            "Its signals: NAME START|BITS@ORDER SIGN (FACTOR,OFFSET) UNIT, as in a DBC file",
            "a list of texts such as [\"Boom 0|16@1- (0.001,0) m\"]",
        );
        let values = "a list of texts such as [\"Enable=1\"]";
        let patterns = [
            texts("active", "Values of its signals while an axis follows, with a message that is sent", values),
            texts("neutral", "Values of its signals while no axis follows", values),
            texts("off", "Values of its signals with the pilot pressure cut off", values),
        ];
        let message = Self {
            name,
            id: id.map(|id| (id as u32, is_extended)),
            length,
            is_flexible,
            signals,
            counter: section.key("counter", "Signal with the alive counter").optional_text(),
            checksum: section
                .key("checksum", "Byte of the checksum, from 0")
                .optional_integer(0..=63)
                .map(|byte| byte as u8),
            checksum_kind: section
                .key("checksum_kind", "How the checksum of all other bytes is made")
                .choice_or(ChecksumKind::Xor, &CHECKSUMS),
            timeout: section
                .key("timeout", "Time without the message after which it is a fault")
                .rule("timing.feedback_timeout")
                .optional_duration(Duration::from_millis(1)..=Duration::from_secs(1)),
            period: section
                .key("period", "Least time between two messages that are sent; one that stops an axis goes at once")
                .rule("every can.sync, and with every command")
                .duration_or(Duration::ZERO, Duration::ZERO..=Duration::from_secs(1)),
            patterns,
        };
        message.expect_sound(&mut section);
        section.finish();
        message
    }
}

/// Bit rates of CAN.
const BIT_RATES: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];

/// Bit rates of the bus, and of the data of CAN FD.
fn bit_rates(section: &mut Section) -> (u32, Option<u32>) {
    let bit_rate = section.key("bit_rate", "Bit rate, bit/s").integer_or(500_000, 10_000..=1_000_000) as u32;
    if !BIT_RATES.contains(&bit_rate) {
        let allowed = BIT_RATES.map(|rate| rate.to_string()).join(", ");
        section.refuse("bit_rate", bit_rate.to_string(), allowed);
    }
    let data_bit_rate = section
        .key("data_bit_rate", "Bit rate of the data of CAN FD frames, bit/s, as ip link has set it (dbitrate)")
        .optional_integer(100_000..=8_000_000);
    if let Some(rate) = data_bit_rate.filter(|rate| *rate < bit_rate as usize) {
        section.refuse("data_bit_rate", rate.to_string(), "can.bit_rate or more");
    }
    (bit_rate, data_bit_rate.map(|rate| rate as u32))
}

/// Shortest time between two SYNC.
const SHORTEST_SYNC: Duration = Duration::from_micros(500);

/// Time between two SYNC where none is given.
fn default_sync(period: Duration) -> Duration {
    (period / 2).max(Duration::from_millis(1)).min(period.max(SHORTEST_SYNC))
}

impl CanBus {
    pub(super) fn read(mut section: Section, timing: &Timing, folder: &Path) -> Self {
        let period = timing.period;
        let millis = Duration::from_millis;
        let interface = section
            .key(
                "interface",
                "The bus, with source.kind = \"can\": an interface such as can0, or a serial port with an adapter",
            )
            .text("an interface such as \"can0\", or a serial port such as \"/dev/ttyACM0\"");
        let (bit_rate, data_bit_rate) = bit_rates(&mut section);
        let bus = Self {
            interface,
            bit_rate,
            data_bit_rate,
            sync: section
                .key("sync", "Time between two SYNC; all encoders are read at each of them")
                .rule("half a period, or 1ms where that is longer and no longer than the period")
                .duration_or(default_sync(period), SHORTEST_SYNC..=millis(1000)),
            heartbeat: section
                .key("heartbeat", "Period of the devices' heartbeats; one that is missing for 1.5 periods is a fault")
                .duration_or(millis(50), millis(5)..=millis(60_000)),
            answer: section
                .key("answer", "Longest time that a device may take to answer while it is set up")
                .duration_or(millis(200), millis(5)..=millis(10_000)),
            dbc: section
                .key("dbc", "A DBC file with messages that are no CANopen, relative to the machine file")
                .optional_text()
                .map(|file| folder.join(file)),
            messages: section.list("message").into_iter().map(CanMessage::read).collect(),
            emergency_stop: section
                .key("emergency_stop", "Signal that is not 0 while the emergency stop is pressed")
                .optional_text(),
            pilot: section.key("pilot", "Signal that is 0 while the pilot pressure is cut off").optional_text(),
        };
        for (i, message) in bus.messages.iter().enumerate() {
            if bus.messages[..i].iter().any(|other| other.name == message.name) {
                section.refuse("message", format!("{} twice", message.name), "one table for each message");
            }
        }
        for message in bus.messages.iter().filter(|message| message.period * 2 > timing.drive_timeout) {
            let allowed =
                "half of timing.drive_timeout or shorter, so that the drive does not stop between two messages";
            section.refuse("message", format!("{}: period = {:?}", message.name, message.period), allowed);
        }
        if bus.sync > period && !section.is_refused("timing.period") {
            let allowed = format!("timing.period or shorter, {SHORTEST_SYNC:?} at least: a tick needs a new position");
            section.refuse("sync", format!("{:?}", bus.sync), allowed);
        }
        if bus.sync * 2 > timing.drive_timeout {
            let allowed = "half of timing.drive_timeout or shorter: every SYNC brings the drives a set point";
            section.refuse("sync", format!("{:?}", bus.sync), allowed);
        }
        section.finish();
        bus
    }
}

#[cfg(test)]
mod tests {
    use crate::machine::{Drive, Machine, Source};

    const WIRED: [(&str, &str); 10] = [
        ("source.kind", "can"),
        ("can.interface", "\"can0\""),
        ("axis.boom.can.encoder", "11"),
        ("axis.boom.can.valve", "21"),
        ("axis.arm.can.encoder", "12"),
        ("axis.arm.can.valve", "22"),
        ("axis.telescope.can.encoder", "13"),
        ("axis.telescope.can.valve", "23"),
        ("axis.bucket.can.encoder", "14"),
        ("axis.bucket.can.valve", "24"),
    ];

    fn machine(more: &[(&str, &str)]) -> Result<Machine, String> {
        let all = WIRED.iter().chain(more).map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
        Machine::four_axes(&all.collect::<Vec<_>>()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_machine_on_a_bus_has_its_devices_and_is_real() {
        let machine = machine(&[]).unwrap();
        assert_eq!((&machine.source, machine.drive, machine.source.is_real()), (&Source::Can, Drive::Can, true));
        assert_eq!(machine.can.as_ref().unwrap().sync, machine.timing.period / 2);
        assert_eq!(machine.axes[3].can.as_ref().unwrap().valve, Some(24));
        // The wiring is nothing that identification and control depend on.
        assert_eq!(machine.fingerprint(), Machine::four_axes(&[]).unwrap().fingerprint());
        assert_eq!(machine.into_twin().source, Source::Sim);
    }

    #[test]
    fn wrong_wiring_is_refused() {
        for (key, value, expected) in [
            ("axis.arm.can.encoder", "21", "axis.arm.can: found node 21; allowed: a number that no other device"),
            ("axis.arm.can.encoder", "0", "axis.arm.can.encoder: found 0 (from the command line); allowed: a whole"),
            ("axis.arm.can.full_scale", "0", "axis.arm.can.full_scale: found 0"),
            (
                "axis.arm.can.full_scale",
                "-49",
                "axis.arm.can.full_scale: found -49 (from the command line); allowed: -32767 to -50",
            ),
            (
                "can.data_bit_rate",
                "250000",
                "can.data_bit_rate: found 250000 (from the command line); allowed: can.bit_rate",
            ),
            ("can.bit_rate", "123456", "can.bit_rate: found 123456 (from the command line); allowed: 10000, 20000"),
            ("can.sync", "20ms", "can.sync: found 20ms (from the command line); allowed: timing.period or shorter"),
            ("timing.drive_timeout", "9ms", "can.sync: found 5ms"),
            ("drive.kind", "sim", "drive.kind: found sim"),
            (
                "axis.arm.can.command_scale",
                "100",
                "axis.arm.can.command_scale: found 100 (from the command line); allowed: beside command",
            ),
        ] {
            let said = machine(&[(key, value)]).unwrap_err();
            assert!(said.contains(expected), "{said}");
        }
        let said = |table: &str| {
            let text = format!("{}\n[can]\ninterface = \"can0\"\n[[can.message]]\n{table}", crate::machine::FOUR_AXES);
            Machine::parse(&text, "m.toml", std::path::Path::new("."), &[]).unwrap_err().to_string()
        };
        for (table, expected) in [
            ("name = \"A\"\nlength = 4", "can.message[0].length: found 4; allowed: beside id"),
            ("name = \"A\"\nid = 9\nchecksum_kind = \"sum\"", "checksum_kind: found \"sum\"; allowed: beside checksum"),
            ("name = \"A\"\ntimeout = \"1m\"", "can.message[0].timeout: found \"1m\"; allowed: "),
        ] {
            assert!(said(table).contains(expected), "{}", said(table));
        }
        let twice = "[[can.message]]\nname = \"A\"\n".repeat(2);
        let text = format!("{}\n[can]\ninterface = \"can0\"\n{twice}", crate::machine::FOUR_AXES);
        let said = Machine::parse(&text, "m.toml", std::path::Path::new("."), &[]).unwrap_err().to_string();
        assert!(said.contains("can.message: found A twice; allowed: one table for each message"), "{said}");
        let missing = Machine::four_axes(&[("source.kind".to_owned(), "can".to_owned())]).unwrap_err().to_string();
        assert!(
            missing.contains("axis.boom.can.encoder: found nothing") && !missing.contains("found node"),
            "{missing}"
        );
    }
}
