//! The thread that hands messages to the network, and the one that watches it.

use std::{
    process,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread::sleep,
    time::Duration,
};

use zenoh::{Session, Wait, pubsub::Publisher, qos::CongestionControl};

use super::{
    answers,
    known::Shared,
    topic::{Outgoing, Topic},
};
use crate::{
    connection::{Connection, ConnectionError},
    key::{ALIVE, Place},
    ring::Ring,
};

/// Time that is waited for a message.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time between two looks of the watchdog.
const LOOK: Duration = Duration::from_millis(100);

/// What the thread says of itself.
#[derive(Default)]
pub struct Progress {
    /// Number of puts that have begun and ended: odd while one is under way.
    puts: AtomicU64,
    /// Puts that Zenoh has refused.
    refused: AtomicU64,
}

impl Progress {
    /// Puts that Zenoh has refused.
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }
}

/// Finds a put that takes too long.
///
/// Trap: a process that was suspended has not put for as long. So the watchdog counts its own looks, which stand still
/// meanwhile as well.
struct Watchdog {
    most: u32,
    seen: u64,
    looks: u32,
}

impl Watchdog {
    fn new(longest: Duration) -> Self {
        Self { most: longest.div_duration_f64(LOOK).ceil() as u32, seen: 0, looks: 0 }
    }

    /// Whether the same put has been under way in more looks than it may.
    fn look(&mut self, puts: u64) -> bool {
        self.looks = if puts % 2 == 1 && puts == self.seen { self.looks + 1 } else { 0 };
        self.seen = puts;
        self.looks > self.most
    }
}

/// Ends the process when a put takes longer than `longest`. The service manager starts it again.
pub fn watch(progress: &Progress, longest: Duration) {
    let mut watchdog = Watchdog::new(longest);
    loop {
        sleep(LOOK);
        if watchdog.look(progress.puts.load(Ordering::Acquire)) {
            eprintln!("a put has taken longer than {}: the bridge ends", humantime::format_duration(longest));
            process::exit(1);
        }
    }
}

/// Publishes what is in the ring until it is told to stop.
///
/// # Errors
/// Zenoh refuses the configuration or a key.
pub fn publish(
    connection: &Connection,
    place: &Place,
    ring: &Ring<Outgoing>,
    shared: &Arc<Shared>,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<(), ConnectionError> {
    let session = connection.open()?;
    let _answers = answers::declare(&session, place, shared)?;
    let publishers: Vec<Publisher> =
        Topic::ALL.iter().map(|topic| publisher(&session, place, *topic)).collect::<Result<_, _>>()?;
    let _alive = session.liveliness().declare_token(place.key(ALIVE)).wait()?;
    let mut reached = Reached::default();
    while !stop.load(Ordering::Relaxed) {
        reached.look(&session);
        let Some(Outgoing { topic, stamp, payload }) = ring.take(PATIENCE) else { continue };
        progress.puts.fetch_add(1, Ordering::AcqRel);
        let put = publishers[topic as usize].put(payload).attachment(&stamp.to_bytes()[..]).wait();
        progress.puts.fetch_add(1, Ordering::AcqRel);
        progress.refused.fetch_add(u64::from(put.is_err()), Ordering::Relaxed);
    }
    Ok(session.close().wait()?)
}

/// The end of one key of a machine. A put on it never waits for a reader.
///
/// # Errors
/// Zenoh refuses the key.
pub fn publisher<'a>(session: &Session, place: &Place, topic: Topic) -> Result<Publisher<'a>, zenoh::Error> {
    session
        .declare_publisher(place.key(&topic.key()))
        .encoding(topic.encoding().as_str())
        .congestion_control(CongestionControl::Drop)
        .priority(topic.priority())
        .wait()
}

/// Tells when a router is reached and when it is lost.
#[derive(Default)]
struct Reached {
    is_reached: bool,
    looks: u32,
}

impl Reached {
    fn look(&mut self, session: &Session) {
        // Routers are asked for once in so many turns: a turn is a message.
        self.looks += 1;
        if self.looks % 16 != 1 {
            return;
        }
        let is_reached = session.info().routers_zid().wait().next().is_some();
        if is_reached != self.is_reached {
            eprintln!("{}", if is_reached { "the router is reached" } else { "the router is lost; trying again" });
        }
        self.is_reached = is_reached;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_put_that_lasts_is_too_long() {
        let mut watchdog = Watchdog::new(Duration::from_secs(1));
        // Between two puts, and with a new put at each look, nothing hangs.
        assert!((0..100).all(|_| !watchdog.look(4)));
        assert!((0..100).all(|i| !watchdog.look(2 * i + 1)));
        let looks = (0..).take_while(|_| !watchdog.look(201)).count();
        assert_eq!(looks, 11);
    }
}
