//! Dialogues with a device that sends anything: no panic, no endless transfer, and no value that was not written.

use can::{
    Frame, MAX_DATA,
    canopen::{
        AbortCode, Dictionary, Emergency, MAX_VALUE, NodeId, Object, SdoClient, SdoError, SdoEvent, SdoServer,
        heartbeat_of,
    },
};
use proptest::prelude::*;

const OBJECT: Object = Object::new(0x2000, 1);

fn node() -> NodeId {
    NodeId::new(9).unwrap()
}

/// One object of any length.
struct One(Vec<u8>);

impl Dictionary for One {
    fn read(&self, object: Object, value: &mut [u8; MAX_VALUE]) -> Result<usize, AbortCode> {
        if object != OBJECT {
            return Err(AbortCode::NO_OBJECT);
        }
        value[..self.0.len()].copy_from_slice(&self.0);
        Ok(self.0.len())
    }

    fn write(&mut self, object: Object, value: &[u8]) -> Result<(), AbortCode> {
        if object != OBJECT {
            return Err(AbortCode::NO_OBJECT);
        }
        self.0 = value.to_vec();
        Ok(())
    }
}

/// Lets client and server talk to their end.
fn talk(client: &mut SdoClient, server: &mut SdoServer, device: &mut One, first: Frame) -> SdoEvent {
    let mut request = first;
    for _ in 0..100 {
        let answer = server.take(&request, device).expect("an answer to every request");
        match client.take(&answer, 0) {
            SdoEvent::Send(next) => request = next,
            other => return other,
        }
    }
    panic!("a dialogue without an end");
}

proptest! {
    #[test]
    fn values_of_any_length_are_written_and_read(value in prop::collection::vec(0_u8.., 1..=MAX_VALUE)) {
        let (mut client, mut server) = (SdoClient::new(node(), 1), SdoServer::new(node()));
        let mut device = One(Vec::new());
        let first = client.write(OBJECT, &value, 0).unwrap();
        prop_assert_eq!(talk(&mut client, &mut server, &mut device, first), SdoEvent::Written);
        prop_assert_eq!(&device.0, &value);
        let first = client.read(OBJECT, 0);
        prop_assert_eq!(talk(&mut client, &mut server, &mut device, first), SdoEvent::Read);
        prop_assert_eq!(client.value(), &value[..]);
    }

    /// A device that answers with random messages, most of them with bytes of a command.
    #[test]
    fn a_device_that_answers_anything_ends_no_client(
        answers in prop::collection::vec((0_u8.., any::<[u8; 7]>(), 0_usize..=8, any::<bool>()), 0..60), reads: bool
    ) {
        let mut client = SdoClient::new(node(), 10);
        if reads { client.read(OBJECT, 0); } else { client.write(OBJECT, &[7; 40], 0); }
        for (i, (command, rest, length, is_about_it)) in answers.into_iter().enumerate() {
            let [a, b, c, d, e, f, g] = rest;
            let [a, b, c] = if is_about_it { [0x00, 0x20, 1] } else { [a, b, c] };
            let data: [u8; MAX_DATA] = [command, a, b, c, d, e, f, g];
            let length = if is_about_it { 8 } else { length };
            let frame = Frame::standard_of(0x589, data, length);
            let _ = (heartbeat_of(&frame), Emergency::of(&frame));
            client.take(&frame, i as u64);
            prop_assert!(client.value().len() <= MAX_VALUE);
        }
        if !client.is_idle() {
            prop_assert!(matches!(client.check(1000), SdoEvent::Failed(SdoError::Silent(OBJECT), Some(_))));
        }
        prop_assert!(client.is_idle());
    }

    #[test]
    fn a_client_that_asks_anything_ends_no_server(requests in prop::collection::vec(any::<[u8; 8]>(), 0..100)) {
        let (mut server, mut device) = (SdoServer::new(node()), One(vec![1; 20]));
        for data in requests {
            server.take(&Frame::standard(0x609, data), &mut device);
        }
        // It still answers.
        let mut client = SdoClient::new(node(), 1);
        device.0 = vec![5; 30];
        let first = client.read(OBJECT, 0);
        prop_assert_eq!(talk(&mut client, &mut server, &mut device, first), SdoEvent::Read);
        prop_assert_eq!(client.value(), &[5; 30]);
    }
}

#[test]
fn an_answer_about_another_object_is_none() {
    let mut client = SdoClient::new(node(), 10);
    client.read(OBJECT, 0);
    assert_eq!(client.take(&Frame::standard(0x589, [0x43, 0, 0x21, 1, 1, 2, 3, 4]), 0), SdoEvent::Ignored);
    assert_eq!(client.take(&Frame::standard(0x589, [0x80, 0, 0x21, 1, 1, 2, 3, 4]), 0), SdoEvent::Ignored);
    assert_eq!(client.take(&Frame::standard(0x588, [0x43, 0, 0x20, 1, 1, 2, 3, 4]), 0), SdoEvent::Ignored);
    assert_eq!(client.take(&Frame::standard(0x589, [0x43, 0, 0x20, 1, 1, 2, 3, 4]), 0), SdoEvent::Read);
    assert_eq!(client.number(), Some(0x0403_0201));
}

#[test]
fn a_value_for_which_there_is_no_room_is_refused() {
    let mut client = SdoClient::new(node(), 10);
    client.read(OBJECT, 0);
    let event = client.take(&Frame::standard(0x589, [0x41, 0, 0x20, 1, 65, 0, 0, 0]), 0);
    let SdoEvent::Failed(SdoError::Wrong { code, .. }, Some(frame)) = event else { panic!("{event:?}") };
    assert_eq!((code, frame), (AbortCode::MEMORY, Frame::standard(0x609, [0x80, 0, 0x20, 1, 5, 0, 4, 5])));
    assert_eq!(client.write(OBJECT, &[0; 65], 0), None);
    assert_eq!(client.write(OBJECT, &[], 0), None);
}

#[test]
fn a_segment_with_the_toggle_bit_of_the_last_one_is_refused() {
    let mut client = SdoClient::new(node(), 10);
    client.read(OBJECT, 0);
    assert!(matches!(client.take(&Frame::standard(0x589, [0x41, 0, 0x20, 1, 20, 0, 0, 0]), 0), SdoEvent::Send(_)));
    assert!(matches!(client.take(&Frame::standard(0x589, [0, 1, 2, 3, 4, 5, 6, 7]), 0), SdoEvent::Send(_)));
    let event = client.take(&Frame::standard(0x589, [0, 1, 2, 3, 4, 5, 6, 7]), 0);
    assert!(matches!(event, SdoEvent::Failed(SdoError::Wrong { code: AbortCode::TOGGLE, .. }, Some(_))), "{event:?}");
}
