//! Bytes from a bus: text of an adapter, frames of devices, a log; and a data base of its messages.

use can::{
    Frame, MAX_DATA,
    bus::{Decoded, Decoder, LogLine, MAX_TEXT, encode},
    canopen::{
        AbortCode, Dictionary, Emergency, MAX_VALUE, NodeId, Object, SdoClient, SdoEvent, SdoServer, heartbeat_of,
    },
    frames::Database,
};

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

/// Text of an adapter; its frames are those of a device, and of a client. Then a log of a bus.
pub fn bus(data: &[u8]) {
    let (Some(node), mut decoder) = (NodeId::new(5), Decoder::default()) else { return };
    let (mut client, mut server) = (SdoClient::new(node, 1000), SdoServer::new(node));
    let mut device = Anything(vec![1; 20]);
    for (i, byte) in data.iter().enumerate() {
        let now = i as u64;
        match decoder.take(*byte) {
            Some(Decoded::Frame(frame)) => {
                expect_same_text(&frame);
                let _ = (heartbeat_of(&frame), Emergency::of(&frame));
                if let SdoEvent::Send(next) = client.take(&frame, now) {
                    server.take(&next, &mut device);
                }
                server.take(&frame, &mut device);
            }
            Some(Decoded::Done) => drop(client.read(Object::new(u16::from(*byte), 1), now)),
            Some(Decoded::Malformed) => drop(client.write(Object::new(0x2000, 0), data, now)),
            _ => {}
        }
    }
    client.check(u64::MAX);
    assert!(client.is_idle() && client.value().len() <= MAX_VALUE);
    for line in String::from_utf8_lossy(data).lines() {
        if let Some(LogLine::Frame(received)) = LogLine::parse(line) {
            expect_same_text(&received.frame);
        }
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

/// A frame is read as it was written.
fn expect_same_text(frame: &Frame) {
    let (mut text, mut decoder) = ([0; MAX_TEXT], Decoder::default());
    let length = encode(frame, &mut text);
    let last = text[..length].iter().filter_map(|byte| decoder.take(*byte)).last();
    assert_eq!(last, Some(Decoded::Frame(*frame)));
}
