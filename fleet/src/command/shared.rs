//! What questions from the network and the relay share.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use pipeline::channel::Prefix;

use super::{desk::Desk, journal::Journal, protocol::AxisView};
use crate::group::only_one;

/// Why there is no group to command.
pub const NO_GROUP: &str = "no group runs at the machine, or several do and the settings name none";

/// The group, the journal, the desk, and how the axes of the seat are.
pub struct Shared {
    group: Option<Prefix>,
    /// What was asked and answered.
    pub journal: Journal,
    desk: Mutex<Desk>,
    view: Mutex<BTreeMap<String, AxisView>>,
}

impl Shared {
    /// For this group, or for the only one that runs.
    pub fn new(group: Option<Prefix>, journal: Journal, desk: Desk) -> Self {
        Self { group, journal, desk: Mutex::new(desk), view: Mutex::default() }
    }

    /// Who may do what. Trap: the lock lasts to the end of the statement in which this is called.
    pub fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells how the axes of the seat are.
    pub fn show(&self, view: BTreeMap<String, AxisView>) {
        *self.view.lock().unwrap_or_else(PoisonError::into_inner) = view;
    }

    /// How the axes of the seat are.
    pub fn view(&self) -> BTreeMap<String, AxisView> {
        self.view.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The group that commands are for.
    ///
    /// # Errors
    /// None is named, and not exactly one runs.
    pub fn prefix(&self) -> Result<Prefix, String> {
        let prefix = self.group.clone().or_else(only_one);
        prefix.ok_or_else(|| NO_GROUP.to_owned())
    }
}
