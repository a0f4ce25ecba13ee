//! Messages to and from a group in which the test is a member.

use pipeline::{
    channel::{Publisher, Reader},
    message::{Header, Message},
    stage::monotonic_ns,
};

use super::wait_for;

/// Axes of the built-in machine.
pub const AXES: usize = 4;

/// Sends a message of this tick, about the machine that it names already.
pub fn send<M: Message>(publisher: &Publisher<M>, mut message: M, sequence: u64) {
    let now = monotonic_ns();
    let machine = message.header().machine;
    *message.header_mut() =
        Header { sequence, acquired_ns: now, sent_ns: now, axis_count: AXES as u32, machine, ..Header::default() };
    publisher.send(&message).unwrap();
}

/// Waits for the message of a tick. `greet` is called meanwhile, so that readers that came late get the last message.
pub fn receive<M: Message>(reader: &mut Reader<M>, sequence: u64, greet: impl Fn()) -> M {
    wait_for(M::CHANNEL, || {
        if reader.reach(sequence).unwrap() {
            return reader.last().copied();
        }
        greet();
        None
    })
}

/// Waits for a message for which this holds; others are skipped.
pub fn await_message<M: Message>(reader: &mut Reader<M>, what: &str, mut is_it: impl FnMut(&M) -> bool) -> M {
    wait_for(what, || {
        while let Some(message) = reader.read().unwrap().if_new() {
            if is_it(message) {
                return Some(*message);
            }
        }
        None
    })
}
