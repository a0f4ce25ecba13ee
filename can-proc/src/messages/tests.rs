use std::path::Path;

use can::{
    Frame, Received,
    device::{Cause, Fault},
};

use super::*;

const EXCAVATOR: &str = include_str!("../../../examples/excavator.toml");
const TABLES: &str = include_str!("../../../examples/excavator-can.toml");

/// The excavator with the tables of the example, one of whose texts is replaced.
fn machine(from: &str, to: &str) -> Result<Machine, String> {
    assert!(TABLES.contains(from), "{from}");
    machine_of(&TABLES.replacen(from, to, 1))
}

/// The excavator with these tables.
fn machine_of(tables: &str) -> Result<Machine, String> {
    let mut settings = vec![("source.kind", "can"), ("timing.drive_timeout", "100ms")];
    settings.push(("axis.telescope.encoder.resolution", "1e-4"));
    let mut settings: Vec<(String, String)> =
        settings.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    for axis in ["boom", "arm", "bucket"] {
        settings.push((format!("axis.{axis}.encoder.kind"), "rotary-encoder".to_owned()));
        settings.push((format!("axis.{axis}.encoder.angle_resolution"), "1e-4".to_owned()));
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
    let text = format!("{EXCAVATOR}\n{tables}");
    Machine::parse(&text, "m.toml", &folder, &settings).map_err(|error| error.to_string())
}

#[test]
fn the_example_is_a_machine_whose_messages_are_known() {
    let mut network = crate::network(&machine("", "").unwrap()).unwrap();
    let held = Fault::of(network.reading(0).unwrap().1).unwrap();
    assert_eq!((held.cause, held.detail), (Cause::Absent, 0x0100), "message 18FF0100h of the boom");
    // A good message of the boom: its count is 1, and its checksum fits.
    let mut data = [0x10, 0x27, 0, 0, 60, 0, 1, 0];
    data[7] = data.iter().fold(0, |sum, byte| sum ^ byte);
    let id = embedded_can::ExtendedId::new(0x18FF_0100).unwrap();
    let frame = <Frame as embedded_can::Frame>::new(id, &data).unwrap();
    network.take(&Received { frame, time_ns: 1000 }, 1000);
    assert_eq!((network.reading(0).unwrap().0, network.pressures(0)), (Some(10_000), Some([12e6, 0.0])));
    // Without a SYNC: there is no node.
    network.begin(2000);
    assert!(network.outbox().frames().iter().all(|frame| frame.standard_id().is_none()));
}

/// Each text is replaced by the next one, and the network says the last one.
fn expect_refused(cases: &[(&str, &str, &str)]) {
    for (from, to, expected) in cases {
        let said = crate::network(&machine(from, to).unwrap()).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn names_and_values_that_are_none_are_refused() {
    expect_refused(&[
        ("\"excavator.dbc\"", "\"none.dbc\"", "can.dbc: "),
        ("\"excavator.dbc\"", "\"/dev/zero\"", "can.dbc: /dev/zero: found no file; allowed: a DBC file"),
        ("BoomState.Angle", "BoomState.Angel", "axis.boom.can.position: found \"Angel\"; allowed: a signal of"),
        ("Levers.Boom", "Lever.Boom", "axis.boom.can.command: found \"Lever\"; allowed: a message: BoomState"),
        ("counter = \"Alive\"", "counter = \"Live\"", "can.message \"BoomState\": counter: found \"Live\""),
        (
            "Mode=1",
            "Mode=1.5",
            "can.message \"Levers\": found \"Mode=1.5\"; allowed: a signal of the message and a value",
        ),
        (
            "active = [\"Mode=1\"]",
            "active = [\"Mode=1\", \"Mode=2\"]",
            "can.message \"Levers\".active: found a bit with two values; allowed: one value for each signal",
        ),
        (
            "name = \"Levers\"",
            "name = \"Levers\"\ntimeout = \"50ms\"",
            "\"Levers\": found timeout, which has no effect",
        ),
        (
            "name = \"MachineState\"",
            "name = \"MachineState\"\nactive = [\"Lock=1\"]",
            "can.message \"MachineState\": found active, neutral or off, which has no effect; allowed: these with",
        ),
        ("Mode=1", "Mode=9", "can.message \"Levers\": found \"Mode=9\"; allowed: a signal of the message and a value"),
        (
            "BoomState.Angle",
            "BoomState.Rate",
            "axis.boom.can.position: found the unit \"rad/s\" of Rate; allowed: rad, mrad, deg, °, or none",
        ),
        ("BoomState.Piston", "BoomState.Rate", "found the unit \"rad/s\" of BoomState.Rate; allowed: Pa, kPa"),
        (
            "command = \"Levers.Boom\"",
            "command = \"Levers.Boom\"\ncommand_scale = 2",
            "axis.boom.can.command_scale: found 2 for Levers.Boom; allowed: a command_scale that the signal",
        ),
        (
            "command = \"Levers.Boom\"",
            "command = \"Levers.Boom\"\ncommand_scale = 0.01",
            "axis.boom.can.command_scale: found 0.01, which is 20 counts of Levers.Boom; allowed: 50 counts or more",
        ),
    ]);
}

#[test]
fn tables_that_lack_something_or_say_too_much_are_refused() {
    for (from, to, expected) in [
        ("active = \"MachineState.Lock\"", "", "axis.boom.can.active: found nothing; allowed: a signal: without it"),
        (
            "command = \"Levers.Boom\"\nactive",
            "valve = 9\ndirection = \"Levers.Mode\"\nactive",
            "axis.boom.can.direction: found a signal without command; allowed: beside command",
        ),
        ("rod_pressure = \"BoomState.Rod\"", "", "axis.boom.can.piston_pressure: found one pressure"),
        ("position = \"BoomState.Angle\"", "", "axis.boom.can.encoder: found nothing; allowed: 1 to 127"),
        ("position = \"BoomState.Angle\"", "encoder = 7\nposition = \"BoomState.Angle\"", "encoder or position"),
        ("name = \"Levers\"", "name = \"Levers\"\nperiod = \"90ms\"", "half of timing.drive_timeout"),
    ] {
        let said = machine(from, to).unwrap_err();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn what_contradicts_itself_is_refused() {
    expect_refused(&[
        ("off = [\"Mode=2\"]", "off = [\"Mode=1\"]", "can.message \"Levers\".off: found the values of active"),
        ("neutral = [\"Mode=0\"]", "neutral = [\"Mode=1\"]", "\"Levers\".neutral: found the values of active"),
        (
            "neutral = [\"Mode=0\"]",
            "neutral = [\"Mode=0\", \"Boom=1\"]",
            "can.message \"Levers\".neutral: found bits that axis.boom.can.command has; allowed: a signal",
        ),
        ("counter = \"Alive\"", "counter = \"Angle\"", "counter: found bits that axis.boom.can.position has"),
        ("checksum = 7", "checksum = 6", "checksum: found bits that can.message \"BoomState\".counter has"),
        ("MachineState.Lock", "Levers.Mode", "axis.boom.can.command: found message Levers, which is sent and"),
        ("Levers.Arm", "Levers.Boom", "axis.arm.can.command: found bits that axis.boom.can.command has"),
        ("ArmState.Angle", "BoomState.Angle", "axis.arm.can.position: found BoomState.Angle, the position of"),
        ("MachineState.PilotShutOff", "MachineState.EmergencyStop", "can.pilot: found bits that can.emergency_stop"),
        (
            "MachineState.Lock",
            "BoomState.Alive",
            "can.message \"BoomState\".counter: found bits that axis.boom.can.act",
        ),
        ("MachineState.Lock", "BoomState.Angle", "axis.boom.can.active: found bits that axis.boom.can.position has"),
    ]);
}

#[test]
fn messages_are_written_in_the_machine_file_as_well() {
    let own = "[[can.message]]\nname = \"Own\"\nid = 0x123\nlength = 4\nsignals = [\"Place 0|16@1- (1e-4,0) m\"]\n";
    let tables = format!("{own}\n[axis.boom.can]");
    let with_own = machine("[axis.boom.can]", &tables).unwrap();
    let database = database(with_own.can.as_ref().unwrap()).unwrap();
    let (message, place) = database.signal("Own.Place").unwrap();
    assert_eq!((message.layout.id, message.layout.is_extended, place.unit.as_str()), (0x123, false, "m"));
    for (from, to, expected) in [
        ("0|16@1-", "0|40@1-", "can.message \"Own\": signal Place: found bits up to byte 4"),
        ("Place 0|16@1- (1e-4,0) m", "Place", "found \"Place\"; allowed: NAME START|BITS"),
    ] {
        let wrong = machine("[axis.boom.can]", &tables.replacen(from, to, 1)).unwrap();
        let said = super::database(wrong.can.as_ref().unwrap()).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
    let said = machine("[axis.boom.can]", &tables.replacen("\"Own\"", "\"Levers\"", 1)).unwrap_err();
    assert!(said.contains("can.message: found Levers twice; allowed: one table for each message"), "{said}");
    // The telescope has its position of this message: with the identifier of another one, and reversed.
    let telescope = "[axis.telescope.can]\nposition = \"TelescopeState.Length\"";
    let of_own = telescope.replace("TelescopeState.Length", "Own.Place");
    for (own, expected) in [
        (own.replace("0x123", "0x18FF0100"), "18FF0100h, which message BoomState has; allowed: one message"),
        (own.replace("1e-4", "-1e-4"), "axis.telescope.can.position: found the factor -0.0001 of Place"),
        (
            own.replace("(1e-4,0)", "(1e-4,0.5)"),
            "found the offset 0.5 of Place, which counts do not have; allowed: axis.telescope.can.zero for it, such as",
        ),
        (own.replace("0|16@1-", "0|8@1-"), "axis.telescope.can.position: found Own.Place, which has no "),
    ] {
        let wrong = machine(telescope, &format!("{own}\n{of_own}")).unwrap();
        let said = crate::network(&wrong).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}

/// The excavator whose telescope has its position in a message of CAN FD, at this interface.
fn flexible(interface: &str, message: &str) -> Result<Machine, String> {
    let own = format!("[[can.message]]\nname = \"Own\"\nid = 0x123\n{message}\n\n[axis.boom.can]");
    let tables = TABLES.replacen("[axis.boom.can]", &own, 1).replacen("TelescopeState.Length", "Own.Place", 1);
    machine_of(&tables.replacen("\"can0\"", &format!("\"{interface}\""), 1))
}

#[test]
fn a_message_of_can_fd_has_up_to_64_bytes() {
    let long = "length = 64\nsignals = [\"Place 496|16@1- (1e-4,0) m\"]\nchecksum = 0";
    let mut network = crate::network(&flexible("can0", long).unwrap()).unwrap();
    assert!(network.is_flexible());
    let mut data = [0; 64];
    (data[62], data[0]) = (77, 77);
    let id = embedded_can::StandardId::new(0x123).unwrap();
    network.take(&Received { frame: Frame::flexible(id, true, &data).unwrap(), time_ns: 1000 }, 1000);
    assert_eq!(network.reading(2).unwrap().0, Some(77));
    // A frame that is too short, or a classical one, is none of it.
    data[62] = 78;
    network.take(&Received { frame: Frame::flexible(id, true, &data[..48]).unwrap(), time_ns: 2000 }, 2000);
    network.take(&Received { frame: Frame::standard(0x123, [78; 8]), time_ns: 2000 }, 2000);
    assert_eq!(network.reading(2).unwrap().0, Some(77));
}

#[test]
fn can_fd_is_refused_where_it_is_not() {
    let short = "length = 4\nsignals = [\"Place 0|16@1- (1e-4,0) m\"]";
    let said = |interface: &str, message: &str| {
        let machine = flexible(interface, message)?;
        crate::network(&machine).map(|network| network.is_flexible()).map_err(|error| error.to_string())
    };
    assert_eq!(said("can0", &format!("{short}\nfd = true")), Ok(true));
    assert_eq!(said("can0", short), Ok(false));
    assert_eq!(said("/dev/ttyACM0", short), Ok(false));
    for (message, interface, expected) in [
        (
            format!("{short}\nfd = true"),
            "/dev/ttyACM0",
            "can.interface: found \"/dev/ttyACM0\", and message \"Own\" is of CAN FD, which slcan has not",
        ),
        (short.replace("length = 4", "length = 12"), "/dev/ttyACM0", "message \"Own\" is of CAN FD"),
        (short.replace("length = 4", "length = 9"), "can0", "length: found 9; allowed: 1 to 8, 12, 16"),
        (short.replace("length = 4", "length = 12\nfd = false"), "can0", "fd: found false; allowed: true"),
    ] {
        let error = said(interface, &message).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_direction_has_a_number_for_each_way() {
    for (way, is_sound) in [("8|2@1+", true), ("8|1@1+", false), ("8|2@1-", false)] {
        let signals = format!("[\"Flow 0|8@1+ (0.004,0)\", \"Way {way} (1,0)\"]");
        let own =
            format!("[[can.message]]\nname = \"Own\"\nid = 0x123\nlength = 4\nsignals = {signals}\n\n[axis.boom.can]");
        let tables = TABLES.replacen("[axis.boom.can]", &own, 1);
        let command = "command = \"Own.Flow\"\ndirection = \"Own.Way\"";
        let found = crate::network(&machine_of(&tables.replacen("command = \"Levers.Boom\"", command, 1)).unwrap());
        let said = found.map(|_| String::new()).unwrap_or_else(|error| error.to_string());
        let expected = "axis.boom.can.direction: found Way; allowed: a signal that has the numbers 0, 1 and 2";
        assert!(if is_sound { said.is_empty() } else { said.starts_with(expected) }, "{way}: {said}");
    }
}

#[test]
fn a_signal_of_an_angle_has_numbers_for_all_postures() {
    let boom = "[axis.boom.can]";
    for axis in ["Boom", "Arm", "Bucket"] {
        let position = format!("position = \"{axis}State.Angle\"");
        let found = |bits: u32, zero: i64| {
            let signal = format!("Angle 0|{bits}@1- (1e-4,0) rad");
            let own = format!("[[can.message]]\nname = \"Own\"\nid = 0x123\nlength = 4\nsignals = [\"{signal}\"]\n");
            let tables = TABLES.replacen(&position, &format!("position = \"Own.Angle\"\nzero = {zero}"), 1);
            let machine = machine_of(&tables.replacen(boom, &format!("{own}{boom}"), 1)).unwrap();
            crate::network(&machine).map(|_| ()).map_err(|error| error.to_string())
        };
        let key = format!("axis.{}.can.position: found Own.Angle, which has no ", axis.to_lowercase());
        assert_eq!(found(17, 0), Ok(()));
        for (bits, zero) in [(12, 0), (17, 200_000)] {
            let said = found(bits, zero).unwrap_err();
            assert!(said.starts_with(&key) && said.contains(" rad; allowed: a signal with numbers"), "{said}");
        }
    }
}

#[test]
fn identifiers_of_canopen_are_no_messages_where_there_are_nodes() {
    let with_node = machine("position = \"TelescopeState.Length\"", "encoder = 13").unwrap();
    let without = machine("", "").unwrap();
    let refuses = |machine: &Machine, id: u32, is_extended: bool| {
        let layout = Layout { id, is_extended, length: 8, is_flexible: false };
        let message = Message { name: "Own".to_owned(), layout, signals: Vec::new() };
        let mut uses = Uses::default();
        uses.add("own", &message, Signal::byte(0), false).unwrap();
        uses.expect_identifiers(machine).is_err()
    };
    for id in [0x00, 0x80, 0x8D, 0x18D, 0x70D] {
        assert!(refuses(&with_node, id, false) && !refuses(&with_node, id, true), "{id:X}");
        assert!(!refuses(&without, id, false), "{id:X}");
    }
    assert!(!refuses(&with_node, 0x123, false) && !refuses(&with_node, 0x100, false));
}
