//! The recording of one machine: what is judged and waits for its file, and what no file has.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use super::{
    file::{Entry, Facts, LATE, Note, RECORDER, RecordingFile},
    inbox::{Post, Received},
};
use crate::{
    fleet::{Counts, Fleet, Machine, Verdict},
    kernel::utc_ns,
    key::Place,
    stamp::Stamp,
};

/// Time in which a machine says the names of its axes, which stand at the beginning of its first file.
const AXES: Duration = Duration::from_secs(3);

/// The recording of a machine.
#[derive(Default)]
pub struct Track {
    /// The open file.
    pub file: Option<RecordingFile>,
    /// What is to be written.
    pub entries: Vec<Entry>,
    /// Since when something waits.
    since: Option<Instant>,
    /// Refused messages that a note has told already.
    told: Counts,
    /// Numbers that were never received, by key, since the last file that has an end.
    lost: BTreeMap<String, u64>,
    /// Messages that the disk has not taken, since the file before.
    unwritten: u64,
}

impl Track {
    /// Judges what has come of a machine, and adds what is to be recorded.
    pub fn take(&mut self, fleet: &mut Fleet, place: &Place, post: Post) {
        let last_ns = post.messages.last().map_or_else(utc_ns, |received| received.at_ns);
        post.messages.into_iter().for_each(|received| self.judge(fleet, place, received));
        let counts = fleet.machines().get(place).map(|machine| machine.counts).unwrap_or_default();
        let Counts { unknown, malformed, repeated, .. } = self.told;
        let [unknown, malformed, repeated] =
            [counts.unknown - unknown, counts.malformed - malformed, counts.repeated - repeated];
        if unknown + malformed + repeated > 0 {
            self.entries.push(Note::Refused { unknown, malformed, repeated }.entry(last_ns));
        }
        self.told = counts;
        if post.dropped > 0 {
            self.entries.push(Note::Dropped { count: post.dropped }.entry(last_ns));
        }
    }

    fn judge(&mut self, fleet: &mut Fleet, place: &Place, received: Received) {
        let Received { key, encoding, payload, attachment, at_ns } = received;
        let Some((_, of)) = Place::of(&key) else { return };
        let before = fleet.machines().get(place).and_then(|machine| machine.stamps.get(of)).copied();
        let topic = match fleet.take(&key, &encoding, &payload, &attachment, at_ns) {
            Verdict::Fresh => of.to_owned(),
            Verdict::Late => format!("{LATE}{of}"),
            Verdict::Unknown | Verdict::Malformed | Verdict::Repeated | Verdict::Stranger => return,
        };
        let Some(stamp) = Stamp::of(&attachment) else { return };
        if let Some(before) = before.filter(|before| before.run == stamp.run && stamp.number > before.number + 1) {
            let (first, last) = (before.number + 1, stamp.number - 1);
            self.entries.push(Note::Gap { key: of, run: stamp.run, first, last }.entry(at_ns));
            let lost = self.lost.entry(of.to_owned()).or_default();
            *lost = lost.saturating_add(stamp.number - before.number - 1);
        }
        self.entries.push(Entry { topic, stamp, at_ns, bytes: payload });
    }

    /// Whether what waits is to be written now: the first file of a machine waits a moment for the names of the axes.
    pub fn is_due(&mut self, machine: &Machine, now: Instant) -> bool {
        let since = *self.since.get_or_insert(now);
        self.file.is_some() || machine.newest.state.is_some() || now - since >= AXES
    }

    /// Begins a file.
    pub fn begin(&mut self, file: RecordingFile) {
        self.file = Some(file);
        if self.unwritten > 0 {
            let at_ns = self.entries.first().map_or(0, |entry| entry.at_ns);
            self.entries.insert(0, Note::Unwritten { count: self.unwritten }.entry(at_ns));
        }
    }

    /// Writes what waits into the file that was begun. Messages and bytes that were written.
    ///
    /// # Errors
    /// The disk does not take it; then nothing of it is in the file.
    pub fn write(&mut self, machine: &Machine) -> mcap::McapResult<(u64, u64)> {
        let messages = self.messages();
        let Some(file) = &mut self.file else { return Ok((0, 0)) };
        let before = file.length();
        file.write(&axes(machine), &self.entries)?;
        let written = (messages, file.length().saturating_sub(before));
        self.entries.clear();
        self.unwritten = 0;
        Ok(written)
    }

    /// Gives up what waits, because the disk does not take it. How many messages.
    pub fn give_up(&mut self) -> u64 {
        let messages = self.messages();
        self.unwritten += messages;
        self.entries.clear();
        messages
    }

    /// What is known at the end of a file, which is then told.
    pub fn end_facts(&mut self) -> Facts {
        let mut lost = std::mem::take(&mut self.lost);
        let topics = self.file.iter().flat_map(RecordingFile::topics);
        for topic in topics.filter(|topic| *topic != RECORDER && !topic.starts_with(LATE)) {
            lost.entry(topic.to_owned()).or_default();
        }
        lost.into_iter().map(|(key, count)| (format!("{key} lost"), count.to_string())).collect()
    }

    fn messages(&self) -> u64 {
        self.entries.iter().filter(|entry| entry.topic != RECORDER).count() as u64
    }
}

/// Names of the axes of a machine.
fn axes(machine: &Machine) -> Vec<String> {
    let Some(state) = &machine.newest.state else { return Vec::new() };
    let count = (state.header.axis_count as usize).min(state.axes.len());
    state.axes[..count].iter().map(|axis| axis.name().to_owned()).collect()
}
