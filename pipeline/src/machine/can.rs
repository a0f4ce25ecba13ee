//! The CAN bus with encoders and valves: `[can]`. Its devices are in `[axis.NAME.can]`.

use std::time::Duration;

use super::{document::Section, timing::Timing};

/// The bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CanBus {
    /// An interface of the kernel such as `can0`, or the path of a serial port with an adapter that speaks slcan.
    pub interface: String,
    /// Bit rate, bit/s: set at an adapter; for the load only at an interface of the kernel.
    pub bit_rate: u32,
    /// Time between two SYNC: all encoders are read at each of them.
    pub sync: Duration,
    /// Period of the heartbeats of all devices.
    pub heartbeat: Duration,
    /// Longest time that a device may take to answer while it is set up.
    pub answer: Duration,
}

/// Bit rates of CAN.
const BIT_RATES: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];

impl CanBus {
    pub(super) fn read(mut section: Section, timing: &Timing) -> Self {
        let period = timing.period;
        let millis = Duration::from_millis;
        let interface = section
            .key(
                "interface",
                "The bus, with source.kind = \"can\": an interface such as can0, or a serial port with an adapter",
            )
            .text("an interface such as \"can0\", or a serial port such as \"/dev/ttyACM0\"");
        let bit_rate = section.key("bit_rate", "Bit rate, bit/s").integer_or(500_000, 10_000..=1_000_000) as u32;
        if !BIT_RATES.contains(&bit_rate) {
            let allowed = BIT_RATES.map(|rate| rate.to_string()).join(", ");
            section.refuse("bit_rate", bit_rate.to_string(), allowed);
        }
        let bus = Self {
            interface,
            bit_rate,
            sync: section
                .key("sync", "Time between two SYNC; all encoders are read at each of them")
                .rule("half a period, 1ms or longer")
                .duration_or((period / 2).max(millis(1)), Duration::from_micros(500)..=millis(1000)),
            heartbeat: section
                .key("heartbeat", "Period of the devices' heartbeats; one that is missing for 1.5 periods is a fault")
                .duration_or(millis(50), millis(5)..=millis(60_000)),
            answer: section
                .key("answer", "Longest time that a device may take to answer while it is set up")
                .duration_or(millis(200), millis(5)..=millis(10_000)),
        };
        if bus.sync > period {
            section.refuse("sync", format!("{:?}", bus.sync), "timing.period or shorter: a tick needs a new position");
        }
        if bus.sync * 2 > timing.drive_timeout {
            let allowed = "half of timing.drive_timeout or shorter: every SYNC brings the drives a set point";
            section.refuse("sync", format!("{:?}", bus.sync), allowed);
        }
        section.finish();
        bus
    }
}
