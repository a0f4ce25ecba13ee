//! What a bridge knows, for whoever asks: state, models, events, recordings.

use std::{
    collections::VecDeque,
    sync::{Mutex, MutexGuard, PoisonError},
};

use pipeline::message::CoefficientSnapshot;

use crate::{events::Event, recordings::Recording, stamp::Stamp};

/// Earlier models that are kept.
const MODELS: usize = 16;
/// Events that are kept.
const EVENTS: usize = 256;

/// Models with the stamp that they were published with.
pub type Models = (Stamp, Box<CoefficientSnapshot>);

/// What a bridge knows.
#[derive(Default)]
pub struct Known {
    /// Its state and that of its group, as JSON.
    pub status: Vec<u8>,
    /// The newest models.
    pub model: Option<Models>,
    /// Models before, the oldest first, each from a change.
    pub earlier: VecDeque<Models>,
    /// What has happened, the oldest first.
    pub events: VecDeque<Event>,
    /// The recordings, or why they are not known.
    pub recordings: Option<Result<Vec<Recording>, String>>,
}

/// Shared by the threads of a bridge.
#[derive(Default)]
pub struct Shared(Mutex<Known>);

impl Shared {
    /// What is known now.
    pub fn known(&self) -> MutexGuard<'_, Known> {
        // Every change is one assignment, so a thread that has panicked leaves nothing half done.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Known {
    /// Keeps an event in the place of the oldest one.
    pub fn add_event(&mut self, event: Event) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }

    /// Keeps models in the place of the oldest ones.
    pub fn add_models(&mut self, models: Models) {
        if self.earlier.len() == MODELS {
            self.earlier.pop_front();
        }
        self.earlier.push_back(models);
    }
}
