//! What a client of a router hears, message by message.

use std::sync::{Arc, Mutex, MutexGuard};

use hydraxis_fleet::{
    connection::Connection,
    fleet::{Counts, Fleet, Machine, Verdict},
    kernel::utc_ns,
    key::{ALIVE, of_all},
    stamp::Stamp,
};
use zenoh::{
    Session, Wait,
    pubsub::Subscriber,
    sample::{Sample, SampleKind},
};

/// A message as it came.
#[derive(Debug, Clone, Copy)]
pub struct Message {
    pub verdict: Verdict,
    pub stamp: Stamp,
    /// When it came, ns since 1970.
    pub at_ns: i64,
}

/// What was heard so far.
pub struct All {
    pub fleet: Fleet,
    /// By key behind the machine.
    pub messages: std::collections::BTreeMap<String, Vec<Message>>,
    /// Payloads of commands and samples.
    pub payloads: Vec<(String, Vec<u8>)>,
}

impl All {
    /// The only machine.
    pub fn machine(&self) -> Option<&Machine> {
        self.fleet.machines().values().next()
    }

    /// Its messages by what became of them.
    pub fn counts(&self) -> Counts {
        self.machine().map(|machine| machine.counts).unwrap_or_default()
    }

    /// Messages under a key.
    pub fn of(&self, key: &str) -> &[Message] {
        self.messages.get(key).map_or(&[], Vec::as_slice)
    }
}

/// A client that listens to everything.
pub struct Heard {
    pub session: Session,
    all: Arc<Mutex<All>>,
    _subscribers: [Subscriber<()>; 2],
}

impl Heard {
    /// Of the site of all tests; a sample counts as fresh for a second.
    pub fn new(connection: &Connection) -> Self {
        let site = "quarry".parse().ok();
        let session = connection.open().unwrap();
        let all = All {
            fleet: Fleet::new(std::time::Duration::from_secs(1)),
            messages: Default::default(),
            payloads: Vec::new(),
        };
        let all = Arc::new(Mutex::new(all));
        let (taken, told) = (Arc::clone(&all), Arc::clone(&all));
        let take = move |sample: Sample| take(&mut taken.lock().unwrap(), &sample);
        let tell = move |token: Sample| {
            told.lock().unwrap().fleet.alive(token.key_expr().as_str(), token.kind() == SampleKind::Put);
        };
        let messages = session.declare_subscriber(of_all(site.as_ref(), "**")).callback(take).wait().unwrap();
        let tokens = session.liveliness().declare_subscriber(of_all(site.as_ref(), ALIVE)).history(true);
        let tokens = tokens.callback(tell).wait().unwrap();
        Self { session, all, _subscribers: [messages, tokens] }
    }

    /// What was heard so far.
    pub fn all(&self) -> MutexGuard<'_, All> {
        self.all.lock().unwrap()
    }
}

fn take(all: &mut All, sample: &Sample) {
    let (at_ns, payload) = (utc_ns(), sample.payload().to_bytes().into_owned());
    let attachment = sample.attachment().map(|bytes| bytes.to_bytes().into_owned()).unwrap_or_default();
    let key = sample.key_expr().as_str();
    let verdict = all.fleet.take(key, &sample.encoding().to_string(), &payload, &attachment, at_ns);
    let of = key.splitn(5, '/').nth(4).unwrap_or_default().to_owned();
    if let Some(stamp) = Stamp::of(&attachment) {
        all.messages.entry(of.clone()).or_default().push(Message { verdict, stamp, at_ns });
    }
    all.payloads.push((of, payload));
}
