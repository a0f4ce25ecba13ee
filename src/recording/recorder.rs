//! Reads all channels of a group and hands the messages to a thread that writes them.
//!
//! A disk can stop for seconds, and a channel keeps messages for a quarter of a second at 1 kHz. So the reader never
//! waits for the writer: a queue is between them, and a batch that finds the queue full is counted and dropped.
//!
//! The writer, which compresses, runs only on a core that nobody else wants.

use std::{
    sync::mpsc::{SyncSender, TrySendError, sync_channel},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use pipeline::{
    MAX_AXES,
    channel::{ChannelError, Group, Reader},
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, Header, MachineState, Message, Reference, Request,
        StageHealth, ValveCommand,
    },
    stage::monotonic_ns,
};

use thread_priority::{
    NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

use super::{
    Counts,
    controller_state::{self, ControllerStates},
    file::Encoded,
    store::{Store, Stored},
};

/// Time between two batches: what a kill of the recorder loses.
pub const BATCH: Duration = Duration::from_millis(100);
/// Time between two recorded snapshots of the coefficients. They are two thirds of all bytes, and models do not change
/// within milliseconds.
pub const SNAPSHOTS: Duration = Duration::from_millis(10);
/// Name of the fact that says of how many snapshots one is recorded.
pub const SNAPSHOTS_FACT: &str = "one coefficient-snapshot of";
/// Batches that wait for the writer at most: ten seconds of all messages.
const WAITING: usize = 100;

/// Which snapshots are recorded: those of every so many ticks, and those whose faults are others than before.
struct Spacing {
    ticks: u64,
    faults: [u32; MAX_AXES],
}

impl Spacing {
    fn keeps(&mut self, snapshot: &CoefficientSnapshot) -> bool {
        let faults = snapshot.axes.each_ref().map(|axis| axis.faults);
        let before = std::mem::replace(&mut self.faults, faults);
        snapshot.header.sequence.is_multiple_of(self.ticks) || faults != before
    }
}

/// All channels of a group, read by one reader each.
struct Channels {
    readings: Reader<EncoderReading>,
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    snapshots: Reader<CoefficientSnapshot>,
    spacing: Spacing,
    references: Reader<Reference>,
    requests: Reader<Request>,
    health: Reader<StageHealth>,
    states: Reader<MachineState>,
    controllers: ControllerStates,
}

impl Channels {
    fn new(group: &Group, axes: usize, snapshot_ticks: u64) -> Result<Self, ChannelError> {
        Ok(Self {
            readings: group.reader()?,
            samples: group.reader()?,
            commands: group.reader()?,
            snapshots: group.reader()?,
            spacing: Spacing { ticks: snapshot_ticks, faults: [0; MAX_AXES] },
            references: group.reader()?,
            requests: group.reader()?,
            health: group.reader()?,
            states: group.reader()?,
            controllers: ControllerStates::new(axes),
        })
    }

    /// Adds all messages that have come to a batch.
    fn drain(&mut self, batch: &mut Vec<Encoded>) -> Result<(), ChannelError> {
        drain(&mut self.readings, batch, |_, _, _| ())?;
        let controllers = &mut self.controllers;
        drain(&mut self.samples, batch, |_, sample, _| controllers.sample(sample))?;
        drain(&mut self.commands, batch, |read_ns, command, batch| batch.push(controllers.state(read_ns, command)))?;
        while let Some(snapshot) = self.snapshots.read()?.if_new() {
            if self.spacing.keeps(snapshot) {
                batch.push(Encoded::new(monotonic_ns(), snapshot));
            }
        }
        drain(&mut self.references, batch, |_, _, _| ())?;
        drain(&mut self.requests, batch, |_, _, _| ())?;
        drain(&mut self.health, batch, |_, _, _| ())?;
        drain(&mut self.states, batch, |_, _, _| ())
    }

    /// Messages that the readers have missed.
    fn lost(&self) -> Counts {
        [
            lost(&self.readings),
            lost(&self.samples),
            lost(&self.commands),
            lost(&self.snapshots),
            lost(&self.references),
            lost(&self.requests),
            lost(&self.health),
            lost(&self.states),
            (controller_state::CHANNEL, self.commands.lost()),
        ]
        .into()
    }
}

/// Adds all messages that have come to a batch; `look` may add more to each.
fn drain<M: Message>(
    reader: &mut Reader<M>,
    batch: &mut Vec<Encoded>,
    mut look: impl FnMut(u64, &M, &mut Vec<Encoded>),
) -> Result<(), ChannelError> {
    while let Some(message) = reader.read()?.if_new() {
        let read_ns = monotonic_ns();
        batch.push(Encoded::new(read_ns, message));
        look(read_ns, message, batch);
    }
    Ok(())
}

fn lost<M: Message>(reader: &Reader<M>) -> (&'static str, u64) {
    (M::CHANNEL, reader.lost())
}

/// What the writer is given.
struct Batch {
    messages: Vec<Encoded>,
    /// Messages that no file has: missed by the readers, or dropped because the queue was full.
    lost: Counts,
}

/// What was recorded.
#[derive(Debug, Default)]
pub struct Recorded {
    /// Messages that no file has, by channel.
    pub lost: Counts,
    /// Where they are.
    pub stored: Stored,
}

impl Recorded {
    /// All messages that no file has.
    pub fn all_lost(&self) -> u64 {
        self.lost.values().sum()
    }
}

/// Records a group.
pub struct Recorder {
    channels: Channels,
    /// Dropped after the channels.
    group: Group,
    batch: Vec<Encoded>,
    due: Instant,
    queue: SyncSender<Batch>,
    writer: JoinHandle<Stored>,
    /// Messages that found the queue full.
    dropped: Counts,
    /// The loop waits for this recorder, which waits for the writer.
    waits: bool,
    last_message: Instant,
}

impl Recorder {
    /// Attaches to all channels of `group`, whose machine has so many axes, and starts the writer. A snapshot is
    /// recorded every `snapshot_ticks`. `waits`: the loop waits for this recorder, so that it can wait for the writer
    /// and drop nothing.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn new(
        group: Group,
        axes: usize,
        snapshot_ticks: u64,
        mut store: Store,
        waits: bool,
    ) -> Result<Self, ChannelError> {
        let channels = Channels::new(&group, axes, snapshot_ticks)?;
        // In lock-step a batch can be large: the loop is as fast as the computer allows.
        let (queue, batches) = sync_channel::<Batch>(if waits { 1 } else { WAITING });
        let writer = thread::spawn(move || {
            // In lock-step the stages never leave a core idle while they wait for the writer.
            if !waits {
                give_way();
            }
            for Batch { messages, lost } in batches {
                store.take(&messages, lost);
            }
            store.finish()
        });
        let now = Instant::now();
        let due = now + BATCH;
        Ok(Self {
            channels,
            group,
            batch: Vec::new(),
            due,
            queue,
            writer,
            dropped: Counts::new(),
            waits,
            last_message: now,
        })
    }

    /// Reads what has come, and hands it on when a batch is due.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self) -> Result<(), ChannelError> {
        let before = self.batch.len();
        self.channels.drain(&mut self.batch)?;
        let now = Instant::now();
        if self.batch.len() > before {
            self.last_message = now;
        }
        if now >= self.due {
            self.due = now + BATCH;
            self.hand_on();
        }
        Ok(())
    }

    /// Number of ticks whose command and snapshot have been read, and so whose sample and reading are about to be.
    pub fn ticks(&self) -> u64 {
        let after = |header: Option<&Header>| header.map_or(0, |header| header.sequence + 1);
        let command = self.channels.commands.last().map(Message::header);
        let snapshot = self.channels.snapshots.last().map(Message::header);
        after(command).min(after(snapshot))
    }

    /// Time since the last message of any channel.
    pub fn silent_for(&self) -> Duration {
        self.last_message.elapsed()
    }

    /// Leaves the group, which need not wait for the disk then.
    pub fn leave(mut self) -> Ending {
        // What comes last need not find room in the queue: the writer empties it.
        let last = Batch { messages: std::mem::take(&mut self.batch), lost: self.lost() };
        let Self { channels, group, queue, writer, .. } = self;
        drop(channels);
        drop(group);
        Ending { last, queue, writer }
    }

    fn hand_on(&mut self) {
        let batch = Batch { messages: std::mem::take(&mut self.batch), lost: self.lost() };
        let sent = if self.waits {
            self.queue.send(batch).map_err(|error| TrySendError::Disconnected(error.0))
        } else {
            self.queue.try_send(batch)
        };
        if let Err(TrySendError::Full(batch) | TrySendError::Disconnected(batch)) = sent {
            for message in &batch.messages {
                *self.dropped.entry(message.channel).or_default() += 1;
            }
        }
    }

    fn lost(&self) -> Counts {
        let mut lost = self.channels.lost();
        for (channel, count) in &self.dropped {
            *lost.entry(channel).or_default() += count;
        }
        lost
    }
}

/// What is left to be written after the end.
pub struct Ending {
    last: Batch,
    queue: SyncSender<Batch>,
    writer: JoinHandle<Stored>,
}

impl Ending {
    /// Writes what was read, and ends the file.
    pub fn finish(self) -> Recorded {
        let mut lost = self.last.lost.clone();
        let _ = self.queue.send(self.last);
        drop(self.queue);
        // A writer that has panicked has written nothing that can be counted.
        let stored = self.writer.join().unwrap_or_default();
        for (channel, count) in &stored.refused {
            *lost.entry(channel).or_default() += count;
        }
        Recorded { lost, stored }
    }
}

/// Lets this thread run only where no other one wants the core.
fn give_way() {
    let idle = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
    // Without the right to it, the thread has the priority of its process, which is low.
    let _ = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, idle);
}
