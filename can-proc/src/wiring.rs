//! The devices of a machine file.

use std::time::Duration;

use crate::{error::WiringError, messages::frames, range::Counted};
use can::{
    BitRates, Frame, MAX_DATA,
    bus::Address,
    canopen::{NodeId, sync},
    device::{
        AxisDevices, Encoder, EncoderSettings, Frames, Network, NodeTiming, PositionObject, Valve, ValveSettings,
    },
    frames::Signal,
};
use pipeline::{
    layout,
    machine::{Axis, CanBus, CanDevices, CanPosition, Machine, Slope},
};

/// One micrometre, m: the unit of 6005h.
const MICROMETRE: f64 = 1e-6;
/// The unit of 6000h, degrees.
const MILLIDEGREE: f64 = 1e-3;
/// Bytes of control word and set point of a valve, and of its status.
const SET_POINT_BYTES: usize = 4;
const STATUS_BYTES: usize = 2;
/// Byte of a heartbeat: the state.
const HEARTBEAT_BYTES: usize = 1;
/// A sample waits for a message that comes late for this part of `timing.feedback_timeout`, or for one and a half
/// periods.
const PATIENCE: u32 = 3;
/// What else may be done where a slope of 16 bits does not reach.
const COARSER: &str = "or a larger angle_resolution, which 6000h has to be";
/// Least number of SYNC without a position after which an encoder is silent: two may be lost.
const LEAST_SILENCE: u128 = 3;

fn bus(machine: &Machine) -> Result<&CanBus, WiringError> {
    machine.can.as_ref().ok_or_else(|| WiringError::Missing("can".to_owned()))
}

/// Where the bus of a machine is.
///
/// # Errors
/// The machine has no bus, or its interface is none.
pub fn bus_address(machine: &Machine) -> Result<Address, WiringError> {
    bus(machine)?.interface.parse().map_err(|error| WiringError::Address(format!("{error}")))
}

/// The bit rates of the bus of a machine.
///
/// # Errors
/// The machine has no bus.
pub fn bit_rates(machine: &Machine) -> Result<BitRates, WiringError> {
    let bus = bus(machine)?;
    Ok(BitRates { bus: bus.bit_rate, data: bus.data_bit_rate })
}

/// All devices of a machine, which have not been heard yet.
///
/// # Errors
/// The machine has no bus, or an axis no devices.
pub fn network(machine: &Machine) -> Result<Network, WiringError> {
    let bus = bus(machine)?;
    let timing = NodeTiming { heartbeat_ns: bus.heartbeat.as_nanos() as u64, answer_ns: bus.answer.as_nanos() as u64 };
    let timeout_ms = machine.timing.drive_timeout.as_millis().clamp(1, u128::from(u16::MAX)) as u16;
    let has_valves = machine.drive.is_real();
    let silent_after = machine.timing.feedback_timeout.as_nanos().div_ceil(bus.sync.as_nanos().max(1));
    let silent_after = silent_after.clamp(LEAST_SILENCE, u128::from(u32::MAX)) as u32;
    let shared = Shared { timing, silent_after, timeout_ms: has_valves.then_some(timeout_ms) };
    let devices = (0..machine.axes.len()).map(|place| devices(machine, place, &shared));
    let devices = devices.collect::<Result<_, _>>()?;
    expect_room(machine, bus)?;
    let patience = (machine.timing.feedback_timeout / PATIENCE).max(machine.timing.period * 3 / 2);
    let patience_ns = patience.as_nanos() as u64;
    Ok(Network::with_frames(devices, Frames { patience_ns, ..frames(machine, bus)? }))
}

/// Refuses a bit rate at which what is always sent does not fit, even without stuff bits: SYNC, positions, set points
/// and states of the valves with every SYNC, and the heartbeats of the devices.
fn expect_room(machine: &Machine, bus: &CanBus) -> Result<(), WiringError> {
    let frame = |bytes: usize| Frame::standard_of(0, [0; MAX_DATA], bytes).wire_bits().0;
    let wired = machine.axes.iter().filter_map(|axis| axis.can.as_ref());
    let encoders = wired.clone().filter(|wired| wired.encoder.is_some());
    let positions = encoders.map(|wired| frame(usize::from(position_object(wired).mapped().bits) / 8));
    let has_valve = |wired: &&CanDevices| wired.valve.is_some() && machine.drive.is_real();
    let valves = wired.filter(has_valve).map(|_| frame(SET_POINT_BYTES) + frame(STATUS_BYTES));
    let of_nodes: Vec<u32> = positions.chain(valves).collect();
    let bits = |frames: u32, every: Duration| f64::from(frames) / every.as_secs_f64();
    let needed = bits(sync().wire_bits().0 + of_nodes.iter().sum::<u32>(), bus.sync)
        + bits(of_nodes.len() as u32 * frame(HEARTBEAT_BYTES), bus.heartbeat);
    if of_nodes.is_empty() || needed <= f64::from(bus.bit_rate) {
        return Ok(());
    }
    Err(WiringError::Text(format!(
        "can.bit_rate: found {}, and the nodes need {needed:.0} bit/s at least with can.sync = {:?} and \
         can.heartbeat = {:?}; allowed: a bit rate with room for them, or a longer can.sync or can.heartbeat",
        bus.bit_rate, bus.sync, bus.heartbeat
    )))
}

/// Number that tells whether two programs mean the same devices and messages: a hash of what machine file and data base
/// say of them.
///
/// # Errors
/// As [`network`].
pub fn number(machine: &Machine) -> Result<u64, WiringError> {
    Ok(layout::named(&format!("{:?} {:?}", machine.can, network(machine)?)))
}

/// What the devices of all axes share.
struct Shared {
    timing: NodeTiming,
    silent_after: u32,
    /// Time-out of the valves, ms, where there are any.
    timeout_ms: Option<u16>,
}

/// Devices of one axis.
fn devices(machine: &Machine, place: usize, shared: &Shared) -> Result<AxisDevices, WiringError> {
    let axis = &machine.axes[place];
    let timing = shared.timing;
    let name = || axis.name.clone();
    let missing = || WiringError::Missing(format!("axis.{}.can", axis.name));
    let node = |found: u8| NodeId::new(found).ok_or_else(|| WiringError::Node { axis: name(), found });
    let failed = |source| WiringError::Mapping { axis: name(), source };
    let wired: &CanDevices = axis.can.as_ref().ok_or_else(missing)?;
    let encoder_settings = |id: NodeId| EncoderSettings {
        node: id,
        object: position_object(wired),
        is_signed: wired.is_signed,
        is_reversed: wired.is_reversed,
        zero: wired.zero,
        has_alarms: wired.has_alarms,
        is_fixed: wired.is_fixed,
        step: step(axis),
        silent_after: shared.silent_after,
    };
    if wired.encoder.is_some() {
        expect_range(machine, place, wired)?;
    }
    let encoder = match (wired.encoder, &wired.signals.position) {
        (Some(found), _) => Some(Encoder::new(encoder_settings(node(found)?), timing).map_err(failed)?),
        (None, Some(_)) => None,
        (None, None) => return Err(missing()),
    };
    let Some(timeout_ms) = shared.timeout_ms.filter(|_| wired.signals.command.is_none()) else {
        return Ok(AxisDevices { encoder, valve: None });
    };
    let settings = ValveSettings {
        node: node(wired.valve.ok_or_else(missing)?)?,
        full_scale: wired.full_scale,
        timeout_ms,
        spool_tolerance: wired.spool_tolerance,
        is_fixed: wired.is_fixed,
    };
    Ok(AxisDevices { encoder, valve: Some(Valve::new(settings, timing).map_err(failed)?) })
}

/// Refuses an encoder or inclinometer whose position cannot say where the soft limits are.
fn expect_range(machine: &Machine, place: usize, wired: &CanDevices) -> Result<(), WiringError> {
    let axis = &machine.axes[place].name;
    let bits = u64::from(position_object(wired).mapped().bits);
    let is_slope = matches!(wired.object, CanPosition::Slope(_));
    let signal = Signal::new((0, bits), (false, wired.is_signed), (1.0, 0.0), MAX_DATA as u8)
        .map_err(|error| WiringError::Text(format!("axis.{axis}.can: {error}")))?;
    let counted = Counted { signal: &signal, is_reversed: wired.is_reversed, zero: wired.zero, is_slope };
    let Some((position, at)) = counted.lacking(machine, place) else { return Ok(()) };
    let (low, high) = signal.range();
    let (key, found, allowed) = match wired.object {
        CanPosition::Slope(Slope::Long16) => ("slope", "long16".to_owned(), format!("\"long32\", {COARSER}")),
        CanPosition::Slope(Slope::Lateral16) => ("slope", "lateral16".to_owned(), format!("\"lateral32\", {COARSER}")),
        _ => ("zero", wired.zero.to_string(), format!("another zero, or signed = {}", !wired.is_signed)),
    };
    Err(WiringError::Text(format!(
        "axis.{axis}.can.{key}: found {found}, with which the position would be {position:.0} at {at}; allowed: \
         positions from {low:.0} to {high:.0}, so {allowed}"
    )))
}

/// The object that has the position.
pub fn position_object(wired: &CanDevices) -> PositionObject {
    match wired.object {
        CanPosition::Position => PositionObject::Position,
        CanPosition::HighPrecision => PositionObject::HighPrecision,
        CanPosition::Slope(Slope::Long16) => PositionObject::SlopeLong16,
        CanPosition::Slope(Slope::Lateral16) => PositionObject::SlopeLateral16,
        CanPosition::Slope(Slope::Long32) => PositionObject::SlopeLong32,
        CanPosition::Slope(Slope::Lateral32) => PositionObject::SlopeLateral32,
    }
}

/// Length of a count that the device has to have: in 0.001 mm of an encoder at the cylinder, in 0.001 degrees of an
/// inclinometer, and where it is a whole number of them.
pub fn step(axis: &Axis) -> Option<u32> {
    let is_slope = axis.can.as_ref().is_some_and(|wired| matches!(wired.object, CanPosition::Slope(_)));
    let step = match axis.encoder.angle {
        None => axis.encoder.resolution / MICROMETRE,
        Some(sensor) if is_slope => sensor.resolution.to_degrees() / MILLIDEGREE,
        Some(_) => return None,
    };
    let is_whole = (step - step.round()).abs() < 1e-6 * step && step >= 0.5;
    is_whole.then(|| step.round() as u32)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use pipeline::machine::FOUR_AXES;

    use super::*;

    fn machine(more: &[(&str, &str)]) -> Machine {
        let mut settings = vec![("source.kind".to_owned(), "can".to_owned())];
        settings.push(("can.interface".to_owned(), "\"can0\"".to_owned()));
        for (i, axis) in ["boom", "arm", "telescope", "bucket"].iter().enumerate() {
            settings.push((format!("axis.{axis}.can.encoder"), format!("{}", 11 + i)));
            settings.push((format!("axis.{axis}.can.valve"), format!("{}", 21 + i)));
        }
        settings.extend(more.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
        Machine::parse(FOUR_AXES, "m.toml", Path::new("."), &settings).unwrap()
    }

    #[test]
    fn every_axis_has_its_devices() {
        let machine = machine(&[]);
        assert_eq!(bus_address(&machine), Ok(Address::Interface("can0".to_owned())));
        let network = network(&machine).unwrap();
        for i in 0..4 {
            assert!(network.devices(i).unwrap().valve.is_some());
        }
        assert!(network.devices(4).is_none());
    }

    #[test]
    fn without_a_drive_there_are_no_valves() {
        let network = network(&machine(&[("drive.kind", "none")])).unwrap();
        assert!(network.devices(0).unwrap().valve.is_none());
    }

    #[test]
    fn a_bus_without_room_for_its_devices_is_refused() {
        // 4 x (47 + 32 + 2 x 47 + 32 + 16) + 47 bits every 5 ms, and 8 x (47 + 8) bits every 50 ms.
        let error = network(&machine(&[("can.bit_rate", "125000")])).unwrap_err().to_string();
        let expected = "can.bit_rate: found 125000, and the nodes need 195000 bit/s at least with can.sync = 5ms and \
                        can.heartbeat = 50ms; ";
        assert!(error.starts_with(expected), "{error}");
        assert!(network(&machine(&[("can.bit_rate", "250000")])).is_ok());
        assert!(network(&machine(&[("can.bit_rate", "250000"), ("can.heartbeat", "5ms")])).is_err());
        assert!(network(&machine(&[("can.bit_rate", "125000"), ("drive.kind", "none")])).is_ok());
    }

    #[test]
    fn an_encoder_that_cannot_say_where_the_limits_are_is_refused() {
        let said = |zero: &str, more: (&str, &str)| {
            let settings = [("axis.arm.can.zero", zero), ("axis.arm.can.reversed", "true"), more];
            network(&machine(&settings)).map(|_| ()).map_err(|error| error.to_string())
        };
        let error = said("0", ("axis.arm.can.signed", "false")).unwrap_err();
        let expected = "axis.arm.can.zero: found 0, with which the position would be -500 at 0.05 m; allowed: ";
        assert!(error.starts_with(expected), "{error}");
        assert_eq!(said("20000", ("axis.arm.can.signed", "false")), Ok(()));
        assert_eq!(said("0", ("axis.arm.can.signed", "true")), Ok(()));
        assert!(said("9e15", ("axis.arm.can.signed", "true")).is_err());
    }

    #[test]
    fn a_slope_that_does_not_reach_all_postures_is_refused() {
        let said = |axis: &str, resolution: &str, slope: &str, zero: &str| {
            let settings = [("source.kind", "can"), ("can.interface", "\"can0\""), ("drive.kind", "none")];
            let mut settings: Vec<_> =
                settings.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
            for (i, name) in ["boom", "arm", "telescope", "bucket"].iter().enumerate() {
                settings.push((format!("axis.{name}.can.encoder"), format!("{}", 11 + i)));
            }
            for (key, value) in [
                ("can.slope", slope),
                ("can.zero", zero),
                ("encoder.kind", "inclinometer"),
                ("encoder.angle_resolution", resolution),
            ] {
                settings.push((format!("axis.{axis}.{key}"), value.to_owned()));
            }
            let excavator = include_str!("../../examples/excavator.toml");
            let machine = Machine::parse(excavator, "m.toml", Path::new("."), &settings).unwrap();
            network(&machine).map(|_| ()).map_err(|error| error.to_string())
        };
        // One thousandth of a degree, of which 16 bits reach 32.8 degrees, and one hundredth.
        let error = said("arm", "1.7453292519943296e-5", "long16", "0").unwrap_err();
        let expected = "axis.arm.can.slope: found long16, with which the position would be ";
        assert!(
            error.starts_with(expected)
                && error.ends_with("\"long32\", or a larger angle_resolution, which 6000h has to be"),
            "{error}"
        );
        assert!(said("arm", "1.7453292519943296e-5", "lateral16", "0").unwrap_err().contains("\"lateral32\""));
        assert_eq!(said("arm", "1.7453292519943296e-5", "long32", "0"), Ok(()));
        assert_eq!(said("arm", "1.7453292519943296e-4", "long16", "0"), Ok(()));
        // The bucket turns through 180 degrees, which 32767 of these steps reach, and do not reach.
        assert_eq!(said("bucket", "9.6e-5", "long16", "0"), Ok(()));
        assert!(said("bucket", "9.5e-5", "long16", "0").unwrap_err().contains("3.142 rad"));
        assert!(said("boom", "1.7453292519943296e-4", "long16", "30000").is_err());
    }

    #[test]
    fn an_interface_that_is_none_is_refused() {
        let error = bus_address(&machine(&[("can.interface", "\"no interface\"")])).unwrap_err();
        assert!(error.to_string().starts_with("can.interface: found \"no interface\"; allowed: "), "{error}");
    }

    #[test]
    fn the_number_changes_with_what_is_said_of_a_device() {
        let all = [
            &[][..],
            &[("axis.arm.can.full_scale", "-16384")],
            &[("axis.arm.can.zero", "1")],
            &[("axis.arm.can.reversed", "true"), ("axis.arm.can.zero", "20000")],
            &[("axis.arm.can.valve", "31")],
            &[("can.interface", "\"can1\"")],
        ]
        .map(|more| number(&machine(more)).unwrap());
        assert!((1..all.len()).all(|i| !all[..i].contains(&all[i])), "{all:?}");
        assert_eq!(number(&machine(&[])), Ok(all[0]));
    }
}
