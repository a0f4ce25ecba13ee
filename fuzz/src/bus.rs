//! Bytes from a bus: text of an adapter, a log, dialogues, frames among those of devices; and a data base of messages.

use can::{
    Frame, MAX_DATA, Received,
    bus::{Decoded, Decoder, LogLine, MAX_TEXT, encode, write_line},
    canopen::{
        AbortCode, Dictionary, Emergency, MAX_VALUE, NodeId, Object, SdoClient, SdoEvent, SdoServer, heartbeat_of,
    },
    device::{
        AxisDevices, AxisState, AxisTarget, Demand, Encoder, Fault, Network, NodeTiming, Outbox, PositionObject, Valve,
    },
    frames::Database,
    simulated::{SimulatedEncoder, SimulatedValve},
};
use embedded_can::{Frame as _, StandardId};

/// The bytes of a frame in the data: two of its identifier, then its own.
const FRAME_BYTES: usize = 2 + MAX_DATA;
const MS: u64 = 1_000_000;

/// Text of an adapter: its frames are read as they were written.
pub fn slcan(data: &[u8]) {
    let mut decoder = Decoder::default();
    for byte in data {
        if let Some(Decoded::Frame(frame)) = decoder.take(*byte) {
            expect_same_text(&frame);
        }
    }
}

/// A log of a bus.
pub fn candump(data: &[u8]) {
    for line in String::from_utf8_lossy(data).lines() {
        if let Some(LogLine::Frame(received)) = LogLine::parse(line) {
            expect_same_text(&received.frame);
        }
    }
}

/// A frame is read as it was written.
fn expect_same_text(frame: &Frame) {
    let (mut text, mut decoder) = ([0; MAX_TEXT], Decoder::default());
    let Some(length) = encode(frame, &mut text) else {
        // slcan has no frames of CAN FD.
        let (mut line, received) = (Vec::new(), Received { frame: *frame, time_ns: 0 });
        write_line(&mut line, &received, "can0").expect("memory can be written");
        assert_eq!(LogLine::parse(&String::from_utf8_lossy(&line)), Some(LogLine::Frame(received)));
        return;
    };
    let last = text[..length].iter().filter_map(|byte| decoder.take(*byte)).last();
    assert_eq!(last, Some(Decoded::Frame(*frame)));
}

/// A device that takes and gives any value.
struct Anything(Vec<u8>);

impl Dictionary for Anything {
    fn read(&self, object: Object, value: &mut [u8; MAX_VALUE]) -> Result<usize, AbortCode> {
        value[..self.0.len()].copy_from_slice(&self.0);
        if object.index == 0x6503 { Err(AbortCode::NO_OBJECT) } else { Ok(self.0.len()) }
    }

    fn write(&mut self, _: Object, value: &[u8]) -> Result<(), AbortCode> {
        self.0 = value.to_vec();
        Ok(())
    }
}

/// A client and a server that get each other's frames and foreign ones. Steps of nine bytes: what happens, and the
/// frame. A dialogue has an end.
pub fn sdo(data: &[u8]) {
    let Some(node) = NodeId::new(5) else { return };
    let (mut client, mut server) = (SdoClient::new(node, 1000), SdoServer::new(node));
    let mut device = Anything(vec![1; 20]);
    // On their way to the server and to the client.
    let (mut requests, mut replies) = (None, None);
    for (now, step) in data.chunks_exact(1 + MAX_DATA).enumerate() {
        let (now, bytes) = (now as u64, &step[1..]);
        let from = |id: u16| StandardId::new(id).and_then(|id| Frame::new(id, bytes));
        match step[0] % 8 {
            0 => requests = Some(client.read(Object::new(u16::from_le_bytes([bytes[0], bytes[1]]), bytes[2]), now)),
            1 => requests = client.write(Object::new(0x2000, bytes[0]), &bytes[1..1 + usize::from(bytes[0] % 8)], now),
            2 => requests = from(0x605),
            3 => replies = from(0x585),
            4 => requests = None,
            5 => replies = None,
            _ => {}
        }
        if let Some(request) = requests.take() {
            replies = server.take(&request, &mut device).or(replies);
        }
        if let Some(SdoEvent::Send(next)) = replies.take().map(|reply| client.take(&reply, now)) {
            requests = Some(next);
        }
    }
    client.check(u64::MAX);
    assert!(client.is_idle() && client.value().len() <= MAX_VALUE);
}

/// An encoder and a valve with their master, on a bus that loses frames and has foreign ones. Steps of eleven bytes:
/// what happens, and a frame. The valve opens only while the axis is commanded to follow.
pub fn devices(data: &[u8]) {
    let Some(mut bench) = Bench::new() else { return };
    for step in data.chunks_exact(1 + FRAME_BYTES) {
        let bytes = &step[1..];
        match step[0] % 8 {
            0 => (0..bytes[0]).for_each(|_| bench.advance()),
            1 | 2 => bench.receive(bytes),
            3 => bench.target.state = AxisState::Disarmed,
            4 => bench.target.state = AxisState::Latched,
            5 => bench.target.state = AxisState::Settling,
            6 => bench.target = AxisTarget { demand: Demand::Follow(0.5), state: AxisState::Following },
            _ if bytes[0] % 2 == 0 => bench.lost = u32::from_le_bytes([bytes[1], bytes[2], bytes[3], bytes[4]]),
            _ => bench.network.lose_bus(bench.now_ns),
        }
        bench.advance();
    }
}

/// An axis in simulated time.
struct Bench {
    network: Network,
    encoder: SimulatedEncoder,
    valve: SimulatedValve,
    replies: Outbox,
    target: AxisTarget,
    /// Which of the next frames are lost, one bit for each.
    lost: u32,
    now_ns: u64,
    /// When the axis has last been commanded to follow.
    followed_ns: u64,
}

impl Bench {
    fn new() -> Option<Self> {
        let (encoder, valve) = (NodeId::new(11)?, NodeId::new(21)?);
        let timing = NodeTiming { heartbeat_ns: 50 * MS, answer_ns: 100 * MS };
        let devices = AxisDevices {
            encoder: Some(Encoder::new(SimulatedEncoder::settings(encoder), timing).ok()?),
            valve: Some(Valve::new(SimulatedValve::settings(valve, 16384), timing).ok()?),
        };
        Some(Self {
            network: Network::new(vec![devices]),
            encoder: SimulatedEncoder::new(encoder, PositionObject::Position, 50),
            valve: SimulatedValve::new(valve, 16384),
            replies: Outbox::default(),
            target: AxisTarget { demand: Demand::Follow(0.0), state: AxisState::Disarmed },
            lost: 0,
            now_ns: 1000 * MS,
            followed_ns: 0,
        })
    }

    /// The master gets the frame that these bytes are.
    fn receive(&mut self, bytes: &[u8]) {
        let id = StandardId::new(u16::from_le_bytes([bytes[0], bytes[1]]) & 0x7FF);
        let length = usize::from(bytes[1] >> 4).min(MAX_DATA);
        let Some(frame) = id.and_then(|id| Frame::new(id, &bytes[2..2 + length])) else { return };
        let _ = (heartbeat_of(&frame), Emergency::of(&frame));
        self.network.take(&Received { frame, time_ns: self.now_ns }, self.now_ns);
    }

    /// One millisecond.
    fn advance(&mut self) {
        self.now_ns += MS;
        self.encoder.step(self.now_ns, &mut self.replies);
        self.valve.step(self.now_ns, &mut self.replies);
        if self.now_ns.is_multiple_of(5 * MS) {
            if self.network.is_over(self.now_ns, 5 * MS) {
                self.network.take_sample(self.now_ns - 5 * MS);
            }
            self.network.begin(self.now_ns);
            self.network.command(Some(&[self.target]), self.now_ns);
        }
        if self.target.state == AxisState::Following {
            self.followed_ns = self.now_ns;
        }
        for _ in 0..20 {
            let frames = self.network.outbox().frames().to_vec();
            let replies = self.replies.frames().to_vec();
            self.network.outbox().clear();
            self.replies.clear();
            for frame in &frames {
                if !self.is_lost() {
                    self.encoder.take(frame, &mut self.replies);
                    self.valve.take(frame, self.now_ns, &mut self.replies);
                }
            }
            for frame in replies {
                if !self.is_lost() {
                    self.network.take(&Received { frame, time_ns: self.now_ns }, self.now_ns);
                }
            }
        }
        let word = self.network.reading(0).map_or(0, |(_, word)| word);
        assert!(word == 0 || Fault::of(word).is_some(), "{word:x}");
        // Frames that stop the valve may be lost; then its own time-out acts.
        let is_stopping = self.now_ns - self.followed_ns <= 100 * MS;
        assert!(self.valve.opening() == 0.0 || is_stopping, "open by {} without a command", self.valve.opening());
    }

    fn is_lost(&mut self) -> bool {
        let is_lost = self.lost & 1 != 0;
        self.lost >>= 1;
        is_lost
    }
}

/// A data base. Each of its signals is read and put in some bytes.
pub fn dbc(data: &[u8]) {
    let Ok(database) = Database::parse(&String::from_utf8_lossy(data)) else { return };
    for named in database.messages().iter().flat_map(|message| &message.signals) {
        let mut bytes = [0x5A; MAX_DATA];
        let raw = named.signal.raw(&bytes);
        named.signal.put(f64::from(data.len() as u32), &mut bytes);
        named.signal.put_raw(raw.unwrap_or_default(), &mut bytes);
        assert_eq!((named.signal.raw(&bytes), bytes), (raw, [0x5A; MAX_DATA]));
    }
}
