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
        assert_eq!(machine.axes[3].can.unwrap().valve, Some(24));
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
            ("can.bit_rate", "123456", "can.bit_rate: found 123456 (from the command line); allowed: 10000, 20000"),
            ("can.sync", "20ms", "can.sync: found 20ms (from the command line); allowed: timing.period or shorter"),
            ("timing.drive_timeout", "9ms", "can.sync: found 5ms"),
            ("drive.kind", "sim", "drive.kind: found sim"),
        ] {
            let said = machine(&[(key, value)]).unwrap_err();
            assert!(said.contains(expected), "{said}");
        }
        let missing = Machine::four_axes(&[("source.kind".to_owned(), "can".to_owned())]).unwrap_err().to_string();
        assert!(
            missing.contains("axis.boom.can.encoder: found nothing") && !missing.contains("found node"),
            "{missing}"
        );
    }
}
