//! A million random, malformed and out-of-order frames, those of CAN FD among them, texts and dialogues: no panic, no
//! allocation, all of them counted, and no valve that moves.

#![allow(unsafe_code, reason = "a global allocator that counts")]

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

use can::{
    Frame, Received,
    bus::{Decoded, Decoder, MAX_TEXT, encode},
    canopen::{NodeId, Object, SdoClient, SdoEvent},
    device::{
        AxisDevices, AxisState, AxisTarget, Demand, Encoder, EncoderSettings, Network, NodeTiming, Valve, ValveSettings,
    },
    simulated::{SimulatedEncoder, SimulatedValve},
};

/// Counts what a thread takes from the heap: the harness of the tests has a thread of its own.
struct Counting;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: all calls go to the allocator of the system as they are.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = TAKEN.try_with(|taken| taken.set(taken.get() + 1));
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Numbers after Marsaglia: xorshift of 64 bits.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A frame, half of them of the devices.
    fn frame(&mut self) -> Frame {
        let (id, length) = (self.next(), self.next() % 9);
        let of_device = [0x080, 0x180, 0x580, 0x700][(id >> 8) as usize % 4] + [11, 21][(id >> 10) as usize % 2];
        let id = if id.is_multiple_of(2) { of_device } else { (id >> 1) as u16 & 0x7FF };
        Frame::standard_of(id, self.next().to_le_bytes(), length as usize)
    }

    /// A frame of CAN FD with the identifier of another one.
    fn flexible(&mut self, frame: &Frame) -> Frame {
        let length = [0, 8, 12, 64][self.next() as usize % 4];
        let data = [self.next() as u8; 64];
        Frame::flexible(embedded_can::Frame::id(frame), self.next().is_multiple_of(2), &data[..length]).unwrap()
    }
}

fn node(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

fn network() -> Network {
    let timing = NodeTiming { heartbeat_ns: 50_000_000, answer_ns: 100_000_000 };
    let encoder = EncoderSettings { step: None, ..SimulatedEncoder::settings(node(11)) };
    let valve = ValveSettings { spool_tolerance: None, ..SimulatedValve::settings(node(21), 16384) };
    Network::new(vec![AxisDevices {
        encoder: Some(Encoder::new(encoder, timing).unwrap()),
        valve: Some(Valve::new(valve, timing).unwrap()),
    }])
}

/// Whether a frame is a set point that is not 0, to the valve.
fn moves(frame: &Frame) -> bool {
    let data = embedded_can::Frame::data(frame);
    frame.standard_id() == Some(0x215) && data.len() == 4 && data[2..] != [0, 0]
}

#[test]
fn a_million_frames_take_no_memory_and_move_nothing() {
    let mut dice = Dice(20_261_124);
    let (mut network, mut client) = (network(), SdoClient::new(node(11), 1000));
    let (mut decoder, mut text) = (Decoder::default(), [0; MAX_TEXT]);
    let before = TAKEN.get();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(TAKEN.get() - before, 1, "the allocator counts");
    let before = TAKEN.get();
    let (mut frames, mut malformed, mut moving, mut dialogues) = (0_u64, 0_u64, 0_u64, 0_u64);
    for i in 0..1_000_000_u64 {
        let frame = dice.frame();
        // Across the text of an adapter, of which one line in eight has another byte somewhere.
        let length = encode(&frame, &mut text).unwrap();
        if i.is_multiple_of(8) {
            text[dice.next() as usize % (length - 1)] = dice.next() as u8;
        }
        for byte in &text[..length] {
            match decoder.take(*byte) {
                Some(Decoded::Frame(frame)) => {
                    frames += 1;
                    let now_ns = i * 100_000;
                    network.take(&Received { frame, time_ns: now_ns }, now_ns);
                    if client.is_idle() {
                        client.read(Object::new(dice.next() as u16, 0), now_ns);
                        dialogues += 1;
                    }
                    if !matches!(client.take(&frame, now_ns), SdoEvent::Ignored) {
                        client.check(now_ns + 1_000_000);
                    }
                }
                Some(Decoded::Malformed) => malformed += 1,
                _ => {}
            }
        }
        if i.is_multiple_of(16) {
            let frame = dice.flexible(&frame);
            network.take(&Received { frame, time_ns: i * 100_000 }, i * 100_000);
            assert!(matches!(client.take(&frame, i * 100_000), SdoEvent::Ignored));
            assert!(encode(&frame, &mut text).is_none());
        }
        if i.is_multiple_of(50) {
            network.begin(i * 100_000);
            let state = if i.is_multiple_of(1000) { AxisState::Disarmed } else { AxisState::Following };
            let target = AxisTarget { demand: Demand::Follow(0.7), state };
            network.command(Some(&[target]), i * 100_000);
        }
        moving += network.outbox().frames().iter().filter(|frame| moves(frame)).count() as u64;
        network.outbox().clear();
    }
    assert_eq!(TAKEN.get(), before, "nothing was taken from the heap");
    // Every line was either a frame, an answer or malformed, and no valve that was not proven has got a set point.
    assert!(frames > 870_000 && malformed > 50_000 && dialogues > 1000, "{frames} {malformed} {dialogues}");
    assert_eq!((moving, network.outbox().dropped()), (0, 0));
    assert!(network.counters().foreign > 100_000);
    println!("{frames} frames, {malformed} malformed lines, {dialogues} dialogues; {:?}", network.counters());
}
