//! `hydraxis-fleet bridge`: a group on this machine, read only, to the router of its site.
//!
//! ```text
//! channels --selection--> ring --network--> router
//!                           |
//!                    the oldest overwritten
//! ```
//!
//! | file | what |
//! |---|---|
//! | `topic` | the keys, their encodings and priorities |
//! | `selection` | what of the group is published, and when |
//! | `network` | the thread that puts, and its watchdog |
//! | `known`, `answers` | what is known for whoever asks |
//!
//! The process runs when no other program wants its core, within a limit of memory. Nothing that comes over the network
//! reaches the group: the bridge has no publisher in it.

mod answers;
mod known;
pub mod network;
mod selection;
pub mod topic;

use std::{
    collections::BTreeMap,
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle, sleep},
    time::{Duration, Instant, SystemTime},
};

use pipeline::channel::Prefix;
use sd_notify::NotifyState;
use thiserror::Error;

use crate::{
    connection::ConnectionError,
    group::{Search, Watched},
    kernel,
    recordings::Recordings,
    ring::Ring,
    settings::Settings,
};
use known::Shared;
use network::Progress;
use selection::Selection;

/// Time between two looks at the channels: they keep 64 ms and more at 1 kHz.
const POLL: Duration = Duration::from_millis(10);
/// Pause after a group that could not be joined.
const JOIN_AGAIN: Duration = Duration::from_secs(2);
/// Time between two messages to the watchdog of the service manager.
const FEED: Duration = Duration::from_millis(500);
/// Time between two looks at the folder of recordings.
const RECORDINGS_APART: Duration = Duration::from_secs(30);
/// Time in which the connection is closed.
const CLOSING: Duration = Duration::from_secs(2);

/// Why a bridge has ended.
#[derive(Debug, Error)]
pub enum BridgeError {
    /// The kernel does not confine it.
    #[error("the bridge cannot be confined: {0}")]
    Confinement(io::Error),
    /// The router cannot be reached.
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    /// A thread of its own has panicked.
    #[error("the thread that publishes has panicked")]
    Panicked,
}

/// Runs a bridge until it is told to stop.
///
/// # Errors
/// It cannot be confined, or Zenoh refuses its configuration.
pub fn run(settings: Settings, stop: &Arc<AtomicBool>) -> Result<(), BridgeError> {
    kernel::run_when_idle().map_err(BridgeError::Confinement)?;
    kernel::limit_memory(settings.limits.memory_mb << 20).map_err(BridgeError::Confinement)?;
    settings.connection().check()?;
    let settings = Arc::new(settings);
    let ring = Arc::new(Ring::new(settings.limits.ring));
    let (shared, progress) = (Arc::new(Shared::default()), Arc::new(Progress::default()));
    let publisher = {
        let (settings, ring, shared) = (Arc::clone(&settings), Arc::clone(&ring), Arc::clone(&shared));
        let (progress, stop) = (Arc::clone(&progress), Arc::clone(stop));
        thread::spawn(move || {
            network::publish(&settings.connection(), &settings.place(), &ring, &shared, &progress, &stop)
        })
    };
    let (watched, longest) = (Arc::clone(&progress), settings.limits.put);
    thread::spawn(move || network::watch(&watched, longest));
    if let Some(folder) = settings.recordings.clone() {
        let (shared, stop) = (Arc::clone(&shared), Arc::clone(stop));
        thread::spawn(move || list_recordings(Recordings::new(folder), &shared, &stop));
    }
    let mut search = Search::new(settings.prefix());
    read(&mut search, Selection::new(settings, ring, shared), &progress, &publisher, stop);
    close(publisher)
}

/// Reads groups, one after the other, until the bridge is told to stop or cannot publish any more.
fn read(
    search: &mut Search,
    mut selection: Selection,
    progress: &Progress,
    publisher: &JoinHandle<Result<(), ConnectionError>>,
    stop: &AtomicBool,
) {
    let mut group: Option<Watched> = None;
    let mut fed: Option<Instant> = None;
    let _ = sd_notify::notify(&[NotifyState::Ready]);
    while !stop.load(Ordering::Relaxed) && !publisher.is_finished() {
        let now = Instant::now();
        selection.look_at_clock(now);
        if group.is_none() {
            group = search.look().and_then(|prefix| join(&prefix, &mut selection));
        }
        if let Some(watched) = &mut group {
            let read = watched.step(&mut selection);
            if let Some(error) = read.as_ref().err() {
                eprintln!("group \"{}\": {error}", watched.prefix());
            }
            if read.is_err() || watched.is_over() {
                selection.end(&watched.prefix().to_string());
                group.take().into_iter().for_each(Watched::leave);
            }
        }
        selection.publish(now);
        let unread: BTreeMap<&str, u64> = group.iter().flat_map(Watched::lost).collect();
        let name = group.as_ref().map(|group| group.prefix().to_string());
        selection.status(now, name.as_deref(), &unread, progress.refused());
        if fed.is_none_or(|fed| fed.elapsed() > FEED) {
            fed = Some(now);
            let _ = sd_notify::notify(&[NotifyState::Watchdog]);
        }
        sleep(POLL);
    }
    group.into_iter().for_each(Watched::leave);
}

/// Joins a group that was found.
fn join(prefix: &Prefix, selection: &mut Selection) -> Option<Watched> {
    match Watched::join(prefix) {
        Ok(watched) => {
            selection.begin(&prefix.to_string());
            Some(watched)
        }
        Err(error) => {
            eprintln!("group \"{prefix}\": {error}");
            sleep(JOIN_AGAIN);
            None
        }
    }
}

/// Waits for the thread that publishes, but not for one that hangs.
fn close(publisher: JoinHandle<Result<(), ConnectionError>>) -> Result<(), BridgeError> {
    let until = Instant::now() + CLOSING;
    while !publisher.is_finished() && Instant::now() < until {
        sleep(POLL);
    }
    // One that still waits for its router ends with the process.
    if !publisher.is_finished() {
        return Ok(());
    }
    Ok(publisher.join().map_err(|_| BridgeError::Panicked)??)
}

fn list_recordings(mut recordings: Recordings, shared: &Shared, stop: &AtomicBool) {
    let is_over = || stop.load(Ordering::Relaxed);
    let mut looked: Option<Instant> = None;
    while !is_over() {
        if looked.is_none_or(|looked| looked.elapsed() > RECORDINGS_APART) {
            looked = Some(Instant::now());
            let found = recordings.look(SystemTime::now(), is_over).map_err(|error| error.to_string());
            shared.known().recordings = Some(found);
        }
        sleep(FEED);
    }
}
