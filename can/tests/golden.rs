//! Every frame that the Python package `canopen` makes in `golden.txt`, byte for byte. `.ci/canopen` has written the
//! file: its two ends are compared with ours, one at a time.

use can::{
    Frame,
    bus::LogLine,
    canopen::{
        AbortCode, Command, Dictionary, Emergency, MAX_VALUE, Mapped, Mapping, NodeId, NodeState, Object, SdoClient,
        SdoError, SdoEvent, SdoServer, heartbeat, nmt, nmt_of, signed, sync,
    },
};

const GOLDEN: &str = include_str!("golden.txt");
const NAME: &[u8] = b"Hydraxis encoder, 25 bit";

fn node() -> NodeId {
    NodeId::new(5).unwrap()
}

/// Frames of a dialogue: whether the master has sent it, and the frame.
fn dialogue(name: &str) -> Vec<(bool, Frame)> {
    let frames = GOLDEN.lines().filter_map(|line| {
        let (head, frame) = line.split_once(' ')?;
        let (found, direction) = head.split_at(head.len() - 1);
        let Some(LogLine::Frame(received)) = LogLine::parse(&format!("(0) can0 {frame}")) else { panic!("{line}") };
        (found == name).then_some((direction == ">", received.frame))
    });
    let frames: Vec<_> = frames.collect();
    assert!(!frames.is_empty(), "{name}");
    frames
}

fn only(name: &str) -> Frame {
    let frames = dialogue(name);
    assert_eq!(frames.len(), 1, "{name}");
    frames[0].1
}

/// The objects of the device in `.ci/canopen`.
#[derive(Default)]
struct Device {
    written: Vec<(Object, Vec<u8>)>,
}

impl Dictionary for Device {
    fn read(&self, object: Object, value: &mut [u8; MAX_VALUE]) -> Result<usize, AbortCode> {
        let bytes = match (object.index, object.sub) {
            (0x6004, 0) => &0x0123_4567_u32.to_le_bytes()[..],
            (0x6503, 0) => &0x1000_u16.to_le_bytes(),
            (0x1029, 1) => &[1],
            (0x1008, 0) => NAME,
            (0x1800, _) => return Err(AbortCode::NO_SUBINDEX),
            _ => return Err(AbortCode::NO_OBJECT),
        };
        value[..bytes.len()].copy_from_slice(bytes);
        Ok(bytes.len())
    }

    fn write(&mut self, object: Object, value: &[u8]) -> Result<(), AbortCode> {
        self.written.push((object, value.to_vec()));
        Ok(())
    }
}

/// Plays the client against the golden frames of the device; the event at the end.
fn play(name: &str, begin: impl FnOnce(&mut SdoClient) -> Frame) -> (SdoClient, SdoEvent) {
    let mut client = SdoClient::new(node(), 1);
    let mut next = Some(begin(&mut client));
    let mut last = SdoEvent::Ignored;
    for (is_from_master, frame) in dialogue(name) {
        if is_from_master {
            assert_eq!(next.take(), Some(frame), "{name}");
        } else {
            last = client.take(&frame, 0);
            if let SdoEvent::Send(frame) = last {
                next = Some(frame);
            }
        }
    }
    assert_eq!(next, None, "{name}");
    (client, last)
}

/// Plays the server against the golden frames of the master.
fn serve(name: &str) -> Device {
    let (mut server, mut device) = (SdoServer::new(node()), Device::default());
    let mut answer = None;
    for (is_from_master, frame) in dialogue(name) {
        if is_from_master {
            answer = server.take(&frame, &mut device);
        } else {
            assert_eq!(answer.take(), Some(frame), "{name}");
        }
    }
    device
}

#[test]
fn objects_are_read() {
    for (name, object, expected) in [
        ("read-u32", Object::new(0x6004, 0), &0x0123_4567_u32.to_le_bytes()[..]),
        ("read-u16", Object::new(0x6503, 0), &0x1000_u16.to_le_bytes()),
        ("read-u8", Object::new(0x1029, 1), &[1]),
        ("read-text", Object::new(0x1008, 0), NAME),
    ] {
        let (client, event) = play(name, |client| client.read(object, 0));
        assert_eq!((client.value(), event), (expected, SdoEvent::Read), "{name}");
        serve(name);
    }
}

#[test]
fn objects_are_written() {
    for (name, object, value) in [
        ("write-u32", Object::new(0x1800, 1), &0x185_u32.to_le_bytes()[..]),
        ("write-u16", Object::new(0x2017, 0), &100_u16.to_le_bytes()),
        ("write-u8", Object::new(0x1800, 2), &[1]),
        ("write-text", Object::new(0x2000, 0), NAME),
        ("write-seven", Object::new(0x2001, 0), b"seven b"),
        ("write-fourteen", Object::new(0x2002, 0), b"fourteen bytes"),
    ] {
        let (_, event) = play(name, |client| client.write(object, value, 0).unwrap());
        assert_eq!(event, SdoEvent::Written, "{name}");
        assert_eq!(serve(name).written, [(object, value.to_vec())], "{name}");
    }
}

#[test]
fn aborts_have_their_reason() {
    for (name, object, code) in [
        ("abort-object", Object::new(0x2FFF, 0), AbortCode::NO_OBJECT),
        ("abort-subindex", Object::new(0x1800, 9), AbortCode::NO_SUBINDEX),
    ] {
        let (client, event) = play(name, |client| client.read(object, 0));
        assert_eq!(event, SdoEvent::Failed(SdoError::Refused { object, code }, None), "{name}");
        assert!(client.is_idle());
        serve(name);
    }
}

#[test]
fn network_management_and_heartbeat() {
    for (name, command) in [
        ("nmt-operational", Command::Start),
        ("nmt-stopped", Command::Stop),
        ("nmt-pre-operational", Command::PreOperational),
        ("nmt-reset", Command::ResetNode),
        ("nmt-reset-communication", Command::ResetCommunication),
    ] {
        let (is_from_master, frame) = dialogue(name)[0];
        assert!(is_from_master && frame == nmt(command, Some(node())), "{name}");
        assert_eq!(nmt_of(&frame, node()), Some(command));
    }
    for (name, state) in [
        ("nmt-operational", NodeState::Operational),
        ("nmt-stopped", NodeState::Stopped),
        ("nmt-pre-operational", NodeState::PreOperational),
        ("nmt-reset-communication", NodeState::BootUp),
    ] {
        assert_eq!(dialogue(name)[1], (false, heartbeat(node(), state)), "{name}");
    }
    assert_eq!(only("sync"), sync());
}

#[test]
fn emergencies() {
    let emergency = Emergency { code: 0x8250, register: 0x11, maker: [1, 2, 3, 4, 5] };
    assert_eq!(only("emcy"), emergency.frame(node()));
    assert_eq!(Emergency::of(&only("emcy")), Some((node(), emergency)));
    let over = Emergency { code: 0, register: 0, maker: [0; 5] };
    assert_eq!(only("emcy-over"), over.frame(node()));
}

#[test]
fn process_data() {
    let mapping = |entries: [(u16, u8, u8); 2]| {
        Mapping::new(&entries.map(|(index, sub, bits)| Mapped { object: Object::new(index, sub), bits })).unwrap()
    };
    let position = mapping([(0x6004, 0, 32), (0x6503, 0, 16)]);
    assert_eq!(position.pack(0x185, &[-123_456_i64 as u64, 0x1000]), only("tpdo"));
    let values = position.unpack(&only("tpdo")).unwrap();
    assert_eq!((signed(values[0], 32), values[1]), (-123_456, 0x1000));
    let valve = mapping([(0x6040, 0, 16), (0x6300, 1, 16)]);
    assert_eq!(valve.pack(0x205, &[7, -16384_i64 as u64]), only("rpdo"));
}
