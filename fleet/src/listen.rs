//! Receives from all machines of a site, or of all sites.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use zenoh::{
    Session, Wait,
    pubsub::Subscriber,
    sample::{Sample, SampleKind},
};

use crate::{
    fleet::Fleet,
    kernel::utc_ns,
    key::{ALIVE, EVENTS, MODEL, Name, STATUS, of_all, telemetry},
    stamp::Stamp,
};

/// Subscribes to everything of these machines that is published.
///
/// # Errors
/// Zenoh refuses a key.
pub fn subscribe(
    session: &Session,
    site: Option<&Name>,
    take: impl Fn(Sample) + Clone + Send + Sync + 'static,
) -> Result<Vec<Subscriber<()>>, zenoh::Error> {
    let keys = [telemetry("*"), STATUS.to_owned(), MODEL.to_owned(), EVENTS.to_owned()];
    let one = |of: &String| session.declare_subscriber(of_all(site, of)).callback(take.clone()).wait();
    keys.iter().map(one).collect()
}

/// Fills a fleet for as long as it lives.
pub struct Listener {
    fleet: Arc<Mutex<Fleet>>,
    _subscribers: Vec<Subscriber<()>>,
}

impl Listener {
    /// Subscribes to everything of these machines that is published.
    ///
    /// # Errors
    /// Zenoh refuses a key.
    pub fn new(session: &Session, site: Option<&Name>, fleet: Fleet) -> Result<Self, zenoh::Error> {
        let fleet = Arc::new(Mutex::new(fleet));
        let taken = Arc::clone(&fleet);
        let take = move |sample: Sample| _ = take(&mut locked(&taken), &sample, utc_ns());
        let mut subscribers = subscribe(session, site, take)?;
        let told = Arc::clone(&fleet);
        let tell = move |token: Sample| locked(&told).alive(token.key_expr().as_str(), token.kind() == SampleKind::Put);
        let tokens = session.liveliness().declare_subscriber(of_all(site, ALIVE)).history(true);
        subscribers.push(tokens.callback(tell).wait()?);
        Ok(Self { fleet, _subscribers: subscribers })
    }

    /// What is known now.
    pub fn fleet(&self) -> MutexGuard<'_, Fleet> {
        locked(&self.fleet)
    }
}

fn locked(fleet: &Mutex<Fleet>) -> MutexGuard<'_, Fleet> {
    // A message that was judged by half is counted by half, and the next one is judged as ever.
    fleet.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives a message that has come at `now_ns` to a fleet. Its stamp, if it has one.
pub fn take(fleet: &mut Fleet, sample: &Sample, now_ns: i64) -> Option<Stamp> {
    let (payload, encoding) = (sample.payload().to_bytes(), sample.encoding().to_string());
    let attachment = sample.attachment().map(|attachment| attachment.to_bytes().into_owned()).unwrap_or_default();
    fleet.take(sample.key_expr().as_str(), &encoding, &payload, &attachment, now_ns);
    Stamp::of(&attachment)
}
