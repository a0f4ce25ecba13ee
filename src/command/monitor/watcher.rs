//! Attaches to the group that is meant, leaves it when it has ended, and attaches to the next one.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::sleep,
    time::Duration,
};

use pipeline::channel::Prefix;

use super::{
    attached::Attached,
    frame::{Hello, line},
    published::{Kind, Published},
};
use crate::group::live::Search;

/// Time between two looks at the channels. Heartbeats come every 100 ms.
const POLL: Duration = Duration::from_millis(25);

/// Watches a group for as long as the program runs.
pub struct Watcher {
    search: Search,
    published: Arc<Published>,
    /// The page may operate axes.
    controls: bool,
    attached: Option<(Prefix, Attached)>,
    /// Number of groups so far.
    attachments: u64,
    /// Why there is no group, as it was published last.
    why: Option<String>,
}

impl Watcher {
    /// Of this group. `controls`: the page may operate axes.
    pub fn new(prefix: Option<Prefix>, published: Arc<Published>, controls: bool) -> Self {
        Self { search: Search::new(prefix), published, controls, attached: None, attachments: 0, why: None }
    }

    /// Watches until the flag is set.
    pub fn watch(mut self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            match &mut self.attached {
                Some((_, attached)) => match attached.step(&self.published) {
                    Ok(()) if attached.is_over() => self.leave("the group has ended"),
                    Ok(()) => {}
                    Err(error) => self.leave(&error.to_string()),
                },
                None => self.search(),
            }
            sleep(POLL);
        }
        self.leave("the monitor has ended");
    }

    /// Looks for the group.
    fn search(&mut self) {
        let Some(found) = self.search.look() else { return };
        let joined = found.and_then(|prefix| {
            let joined = Attached::join(&prefix, self.attachments + 1, self.controls, &self.published);
            joined.map(|attached| (prefix, attached)).map_err(|error| error.to_string())
        });
        match joined {
            Ok(joined) => {
                self.attachments += 1;
                self.why = None;
                *self.published.group() = Some(joined.0.clone());
                self.attached = Some(joined);
            }
            Err(why) => self.absent(why),
        }
    }

    fn leave(&mut self, why: &str) {
        let Some((prefix, attached)) = self.attached.take() else { return };
        *self.published.group() = None;
        *self.published.details() = "{}".to_owned();
        attached.leave();
        *self.published.report() = None;
        self.absent(format!("group \"{prefix}\": {why}"));
    }

    /// Publishes that there is no group, once for each reason.
    fn absent(&mut self, why: String) {
        if self.why.as_ref() != Some(&why) {
            self.published.put(Kind::Hello, line(&Hello::absent(self.attachments, why.clone(), self.controls)));
            self.why = Some(why);
        }
    }
}
