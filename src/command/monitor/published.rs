//! What the watcher publishes and the server reads.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use pipeline::channel::Prefix;
use tokio::sync::watch;

use super::history::History;
use crate::report::status::StatusReport;

/// A text with the number of its version.
#[derive(Debug, Clone)]
pub struct Part {
    /// 0 for none yet.
    pub version: u64,
    /// JSON in one line.
    pub text: Arc<str>,
}

/// Kinds of parts, in the order in which a browser gets them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Group and machine; or why there are none.
    Hello = 0,
    /// What has happened.
    Events = 1,
    /// Stages with channels and latencies.
    Stages = 2,
    /// Axes and pose.
    Axes = 3,
}

impl Kind {
    /// All kinds, by their numbers.
    pub const ALL: [Self; 4] = [Self::Hello, Self::Events, Self::Stages, Self::Axes];

    /// Name of the event that carries it.
    pub fn name(self) -> &'static str {
        ["hello", "events", "stages", "axes"][self as usize]
    }
}

/// The newest texts of all kinds.
pub type Parts = [Part; Kind::ALL.len()];

/// What the watcher publishes and the server reads. Neither waits for the other longer than a copy takes.
pub struct Published {
    parts: watch::Sender<Parts>,
    history: Mutex<History>,
    report: Mutex<Option<StatusReport>>,
    group: Mutex<Option<Prefix>>,
    details: Mutex<String>,
    details_asked: Mutex<Option<Instant>>,
}

impl Published {
    /// Nothing yet.
    pub fn new() -> Self {
        let none = || Part { version: 0, text: Arc::from("{}") };
        let (parts, _) = watch::channel([none(), none(), none(), none()]);
        Self {
            parts,
            history: Mutex::new(History::new()),
            report: Mutex::new(None),
            group: Mutex::new(None),
            details: Mutex::new("{}".to_owned()),
            details_asked: Mutex::new(None),
        }
    }

    /// Replaces a part.
    pub fn put(&self, kind: Kind, text: String) {
        self.parts.send_modify(|parts| {
            let part = &mut parts[kind as usize];
            *part = Part { version: part.version + 1, text: text.into() };
        });
    }

    /// The newest parts, and a sign when there are newer ones.
    pub fn subscribe(&self) -> watch::Receiver<Parts> {
        self.parts.subscribe()
    }

    /// Number of browsers that are told of new parts.
    pub fn readers(&self) -> usize {
        self.parts.receiver_count()
    }

    /// The trends.
    pub fn history(&self) -> MutexGuard<'_, History> {
        // A thread that panicked while it held the lock has left whole rows.
        self.history.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The details as JSON.
    pub fn details(&self) -> MutexGuard<'_, String> {
        self.details.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// When somebody asked for the details last.
    pub fn details_asked(&self) -> MutexGuard<'_, Option<Instant>> {
        self.details_asked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The group that is shown; none while there is none.
    pub fn group(&self) -> MutexGuard<'_, Option<Prefix>> {
        self.group.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The figures of the group; none while there is no group.
    pub fn report(&self) -> MutexGuard<'_, Option<StatusReport>> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
