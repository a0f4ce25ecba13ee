//! The black box of a group: the last seconds of all channels, in a file, when a fault latches an axis or a stage dies.
//!
//! The messages are in shared memory until then ([`super::kept`]). A thread of its own writes the file, because the
//! supervisor has other things to watch. A file holds what came before the fault and [`AFTER`] of what came after it;
//! further faults within the span share it. What a supervisor that was killed has left in shared memory, the next
//! `hydraxis run` or `hydraxis clean` writes.

use std::{
    fs, io,
    path::{Path, PathBuf},
    thread::{JoinHandle, sleep},
    time::{Duration, Instant, SystemTime},
};

use pipeline::{
    MAX_AXES,
    channel::{ChannelError, Group, Prefix},
    machine::Machine,
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Message, Reference, Request, StageHealth,
        ValveCommand, bit_names, control_flag,
    },
    stage::monotonic_ns,
};

use mcap::{McapError, McapResult};

use super::{
    Facts, axes_in, clock_ns,
    controller_state::{self, ControllerStates},
    default_folder,
    file::{Encoded, RecordingFile},
    kept::{self, About, KeptFile, LeftFile},
    tape::{Strip, Tape},
};

/// What a file holds.
pub const SPAN: Duration = Duration::from_secs(10);
/// Part of it that comes after the fault.
const AFTER: Duration = Duration::from_secs(1);
/// Least time between two snapshots: a snapshot is by far the largest message.
const SNAPSHOTS_APART: Duration = Duration::from_millis(50);
/// Longest wait for the disk at the end of a run. What was written by then is in the memory of the system, from which
/// the disk takes it later.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time between two looks at the writer while the run ends.
const LOOK: Duration = Duration::from_millis(5);
/// Files that are kept in a folder.
pub const MOST_FILES: usize = 20;
/// Beginning and end of their names.
const NAME: (&str, &str) = ("fault-", ".mcap");

/// All channels of a group, read by one reader each.
pub struct Tapes {
    pub readings: Tape<EncoderReading>,
    pub samples: Tape<EncoderSample>,
    pub commands: Tape<ValveCommand>,
    pub snapshots: Tape<CoefficientSnapshot>,
    pub references: Tape<Reference>,
    pub requests: Tape<Request>,
    pub health: Tape<StageHealth>,
    pub states: Tape<MachineState>,
}

impl Tapes {
    /// Attaches to the channels of `group`, and keeps nothing.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn new(group: &Group) -> Result<Self, ChannelError> {
        Ok(Self {
            readings: Tape::new(group)?,
            samples: Tape::new(group)?,
            commands: Tape::new(group)?,
            snapshots: Tape::new(group)?,
            references: Tape::new(group)?,
            requests: Tape::new(group)?,
            health: Tape::new(group)?,
            states: Tape::new(group)?,
        })
    }

    /// Keeps what is read in this file for [`SPAN`], in the order in which [`Strips::left`] reads it.
    ///
    /// # Errors
    /// Shared memory has no room.
    pub fn keep(&mut self, file: &mut KeptFile) -> io::Result<()> {
        self.readings.keep(file, SPAN, 0)?;
        self.samples.keep(file, SPAN, 0)?;
        self.commands.keep(file, SPAN, 0)?;
        self.snapshots.keep(file, SPAN, SNAPSHOTS_APART.as_nanos() as u64)?;
        self.references.keep(file, SPAN, 0)?;
        self.requests.keep(file, SPAN, 0)?;
        self.health.keep(file, SPAN, 0)?;
        self.states.keep(file, SPAN, 0)
    }

    fn take(&mut self) -> io::Result<Strips> {
        Ok(Strips {
            readings: self.readings.take()?,
            samples: self.samples.take()?,
            commands: self.commands.take()?,
            snapshots: self.snapshots.take()?,
            references: self.references.take()?,
            requests: self.requests.take()?,
            health: self.health.take()?,
            states: self.states.take()?,
        })
    }
}

/// What was kept of all channels.
struct Strips {
    readings: Strip<EncoderReading>,
    samples: Strip<EncoderSample>,
    commands: Strip<ValveCommand>,
    snapshots: Strip<CoefficientSnapshot>,
    references: Strip<Reference>,
    requests: Strip<Request>,
    health: Strip<StageHealth>,
    states: Strip<MachineState>,
}

impl Strips {
    /// What a dead supervisor has left.
    fn left(file: &mut LeftFile) -> io::Result<Self> {
        fn next<M: Message>(file: &mut LeftFile, apart_ns: u64) -> io::Result<Strip<M>> {
            Ok(Strip { messages: file.next(SPAN, apart_ns)?, lost: 0 })
        }
        Ok(Self {
            readings: next(file, 0)?,
            samples: next(file, 0)?,
            commands: next(file, 0)?,
            snapshots: next(file, SNAPSHOTS_APART.as_nanos() as u64)?,
            references: next(file, 0)?,
            requests: next(file, 0)?,
            health: next(file, 0)?,
            states: next(file, 0)?,
        })
    }

    fn channels(self, axes: &[String]) -> Vec<Box<dyn Messages>> {
        let states = StatesStrip::new(axes, &self.samples, &self.commands);
        vec![
            Box::new(self.readings),
            Box::new(self.samples),
            Box::new(self.commands),
            Box::new(states),
            Box::new(self.snapshots),
            Box::new(self.references),
            Box::new(self.requests),
            Box::new(self.health),
            Box::new(self.states),
        ]
    }
}

/// The messages of one channel, of any type.
trait Messages: Send {
    /// Adds the channel and all its messages to a file.
    fn write(&self, file: &mut RecordingFile) -> McapResult<()>;
    /// Name of the channel, and messages that were lost before they came here.
    fn lost(&self) -> (&'static str, u64);
}

impl<M: Message + Send> Messages for Strip<M> {
    fn write(&self, file: &mut RecordingFile) -> McapResult<()> {
        file.add_channel::<M>()?;
        self.messages.iter().try_for_each(|(read_ns, message)| file.write(&Encoded::new(*read_ns, message)))
    }

    fn lost(&self) -> (&'static str, u64) {
        (M::CHANNEL, self.lost)
    }
}

/// The states of the controllers.
struct StatesStrip {
    axes: Vec<String>,
    states: Vec<Encoded>,
    lost: u64,
}

impl StatesStrip {
    fn new(axes: &[String], samples: &Strip<EncoderSample>, commands: &Strip<ValveCommand>) -> Self {
        let mut states = ControllerStates::new(axes.len());
        let mut samples = samples.messages.iter().peekable();
        let state = |(read_ns, command): &(u64, ValveCommand)| {
            let tick = command.header.sequence;
            while let Some((_, sample)) = samples.next_if(|(_, sample)| sample.header.sequence <= tick) {
                states.sample(sample);
            }
            states.state(*read_ns, command)
        };
        Self { axes: axes.to_vec(), states: commands.messages.iter().map(state).collect(), lost: commands.lost }
    }
}

impl Messages for StatesStrip {
    fn write(&self, file: &mut RecordingFile) -> McapResult<()> {
        controller_state::add_to(file, &self.axes)?;
        self.states.iter().try_for_each(|state| file.write(state))
    }

    fn lost(&self) -> (&'static str, u64) {
        (controller_state::CHANNEL, self.lost)
    }
}

/// Writes a new file with all messages into a folder, and removes the oldest ones there. What is to be said about it,
/// also where it could not be written.
fn write(
    folder: &Path,
    prefix: &Prefix,
    mut facts: Facts,
    fault: &Fault,
    channels: &[Box<dyn Messages>],
) -> Result<String, String> {
    let clock_ns = clock_ns();
    facts.extend(
        [
            ("cause", fault.cause.clone()),
            ("cause_monotonic_ns", fault.at.to_string()),
            ("realtime_minus_monotonic_ns", clock_ns.to_string()),
        ]
        .map(|(name, fact)| (name.to_owned(), fact)),
    );
    facts.extend(channels.iter().map(|channel| {
        let (name, lost) = channel.lost();
        (format!("{name} lost"), lost.to_string())
    }));
    let path = folder.join(file_name(prefix, SystemTime::now()));
    let written = RecordingFile::create(&path, &facts, &[], clock_ns).and_then(|mut file| {
        let written = channels.iter().try_for_each(|channel| channel.write(&mut file));
        written.and_then(|()| file.finish(&Facts::new())).inspect_err(|_| {
            // Half a file explains nothing; the disk may be full.
            let _ = fs::remove_file(&path);
        })
    });
    let is_written = written.is_ok();
    let said = match written {
        Ok(()) => format!("black box: {}: {}", fault.cause, path.display()),
        Err(error) => {
            // What this error says of itself is that there was one.
            let error = if let McapError::Io(source) = error { source.to_string() } else { error.to_string() };
            format!("warning: no black box of \"{}\": {}: {error}", fault.cause, path.display())
        }
    };
    let said = match remove_oldest(folder) {
        Err(error) if is_written => format!("{said}; older files could not be removed: {error}"),
        _ => said,
    };
    if is_written { Ok(said) } else { Err(said) }
}

fn file_name(prefix: &Prefix, now: SystemTime) -> String {
    let now = humantime::format_rfc3339_millis(now).to_string().replace(':', "-");
    format!("{}{now}-{prefix}{}", NAME.0, NAME.1)
}

/// A fault that is to be written.
struct Fault {
    /// When, ns.
    at: u64,
    cause: String,
}

/// The black box of one run.
pub struct BlackBox {
    folder: PathBuf,
    prefix: Prefix,
    facts: Facts,
    axes: Vec<String>,
    /// Latches of each axis so far, as its commands count them.
    latches: [u64; MAX_AXES],
    /// The first fault that is not in a file yet.
    fault: Option<Fault>,
    /// When the last file was begun, ns.
    last: Option<u64>,
    writer: Option<JoinHandle<String>>,
    /// Removed when the run ends.
    kept: Option<KeptFile>,
}

impl BlackBox {
    /// Of a group that runs this machine, with files in `folder`, which is made.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new(folder: PathBuf, prefix: &Prefix, machine: &Machine) -> io::Result<Self> {
        fs::create_dir_all(&folder)?;
        Ok(Self {
            folder,
            prefix: prefix.clone(),
            facts: facts(prefix, machine),
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            latches: [0; MAX_AXES],
            fault: None,
            last: None,
            writer: None,
            kept: None,
        })
    }

    /// Keeps the messages of all channels in shared memory, from now until the end of the run. Begins to write what other
    /// supervisors have left there.
    ///
    /// # Errors
    /// The file in shared memory is there, or there is no room for it.
    pub fn keep(&mut self, period: Duration, tapes: &mut Tapes) -> io::Result<()> {
        let (folder, facts) = (self.folder.clone(), self.facts.clone());
        let mut file = KeptFile::create(&self.prefix, &About { folder, facts, period_ns: period.as_nanos() as u64 })?;
        tapes.keep(&mut file)?;
        self.kept = Some(file);
        // A start does not wait for a disk.
        self.writer = Some(std::thread::spawn(|| write_left(None).join("\n")));
        Ok(())
    }

    /// Notes that something has failed.
    pub fn note(&mut self, cause: impl Into<String>) {
        self.fault.get_or_insert_with(|| Fault { at: monotonic_ns(), cause: cause.into() });
    }

    /// Looks at a command: whether a fault has latched axes.
    pub fn look(&mut self, command: &ValveCommand) {
        let mut latched = Vec::new();
        for ((axis, name), before) in command.axes.iter().zip(&self.axes).zip(&mut self.latches) {
            // A controller that is started again counts from 0.
            if axis.latches > std::mem::replace(before, axis.latches) {
                let faults: Vec<&str> = bit_names(axis.latched_by, &control_flag::NAMES).collect();
                latched.push(format!("axis.{name} latched by {}", faults.join(", ")));
            }
        }
        if !latched.is_empty() {
            self.note(latched.join("; "));
        }
    }

    /// Begins a file if one is due; `ends`: there will be no more messages. What is to be said to a person, if
    /// anything.
    pub fn step(&mut self, tapes: &mut Tapes, ends: bool) -> Option<String> {
        if self.writer.is_some() {
            return self.written(ends);
        }
        let now = monotonic_ns();
        let due = self.due()?;
        if now < due && !ends {
            return None;
        }
        let fault = self.fault.take()?;
        self.last = Some(now);
        let channels = match tapes.take() {
            Ok(strips) => strips.channels(&self.axes),
            Err(error) => return Some(format!("warning: no black box of \"{}\": {error}", fault.cause)),
        };
        let (folder, prefix, facts) = (self.folder.clone(), self.prefix.clone(), self.facts.clone());
        self.writer = Some(std::thread::spawn(move || match write(&folder, &prefix, facts, &fault, &channels) {
            Ok(said) | Err(said) => said,
        }));
        self.written(ends)
    }

    /// When the next file is due, ns; none without a fault.
    fn due(&self) -> Option<u64> {
        let after = |time: u64, wait: Duration| time.saturating_add(wait.as_nanos() as u64);
        let fault = after(self.fault.as_ref()?.at, AFTER);
        Some(self.last.map_or(fault, |last| fault.max(after(last, SPAN - AFTER))))
    }

    /// What the writer says once it has ended; `waits` for it, but not for a disk that takes nothing.
    fn written(&mut self, waits: bool) -> Option<String> {
        let until = Instant::now() + if waits { PATIENCE } else { Duration::ZERO };
        while self.writer.as_ref().is_some_and(|writer| !writer.is_finished()) && Instant::now() < until {
            sleep(LOOK);
        }
        let writer = self.writer.take_if(|writer| waits || writer.is_finished())?;
        if !writer.is_finished() {
            let patience = humantime::format_duration(PATIENCE);
            let folder = self.folder.display();
            return Some(format!("warning: {folder}: the disk has not confirmed the black box within {patience}"));
        }
        let said = writer.join().unwrap_or_else(|_| "warning: the black box could not be written".to_owned());
        Some(said).filter(|said| !said.is_empty())
    }
}

/// What is known of a run at its begin.
fn facts(prefix: &Prefix, machine: &Machine) -> Facts {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("group", prefix.to_string()),
        ("machine", machine.name.clone()),
        ("axes", axes.join(" ")),
    ]
    .map(|(name, fact)| (name.to_owned(), fact))
    .into()
}

/// Writes what dead supervisors have left in shared memory, of this group or of all groups of this user, and removes
/// it there. A line for each.
pub fn write_left(prefix: Option<&Prefix>) -> Vec<String> {
    let paths = prefix.map_or_else(kept::paths, |prefix| vec![kept::path(prefix)]);
    paths
        .iter()
        .filter_map(|path| {
            written_left(path).unwrap_or_else(|error| {
                let is_none = matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied);
                (!is_none).then(|| format!("warning: {}: no black box can be read from it: {error}", path.display()))
            })
        })
        .collect()
}

fn written_left(path: &Path) -> io::Result<Option<String>> {
    let Some(mut left) = LeftFile::open(path)? else { return Ok(None) };
    let facts = left.about.facts.clone();
    let fact = |name: &str| facts.get(name).cloned().unwrap_or_default();
    if fact("version") != env!("CARGO_PKG_VERSION") {
        let other = format!("it was kept by version {}, whose `hydraxis clean` writes it", fact("version"));
        return Err(io::Error::new(io::ErrorKind::InvalidData, other));
    }
    let Ok(prefix) = fact("group").parse() else {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "it names no group"));
    };
    let strips = Strips::left(&mut left)?;
    let at = strips.health.messages.last().map_or(0, |(read_ns, _)| *read_ns);
    let fault = Fault { at, cause: "the supervisor was killed".to_owned() };
    let channels = strips.channels(&axes_in(&facts));
    let folder = &left.about.folder;
    // The folder of that run may be gone, or be full.
    let said = write(folder, &prefix, facts.clone(), &fault, &channels)
        .or_else(|_| write(&default_folder(), &prefix, facts, &fault, &channels));
    if said.is_ok() {
        left.remove()?;
    }
    Ok(Some(said.unwrap_or_else(|said| said)))
}

/// Removes the oldest black boxes of a folder until [`MOST_FILES`] are left. Their names begin with the time.
fn remove_oldest(folder: &Path) -> io::Result<()> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if name.is_some_and(|name| name.starts_with(NAME.0) && name.ends_with(NAME.1)) {
            files.push(path);
        }
    }
    files.sort();
    let surplus = files.len().saturating_sub(MOST_FILES);
    files[..surplus].iter().map(fs::remove_file).try_for_each(|removed| match removed {
        // Another run has removed it.
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black_box(folder: &Path) -> BlackBox {
        let machine = Machine::load(None, &[]).unwrap();
        BlackBox::new(folder.to_owned(), &"t-box".parse().unwrap(), &machine).unwrap()
    }

    #[test]
    fn a_latch_is_noted_once_and_again_after_a_restart_of_the_controller() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        let mut command = ValveCommand::default();
        black_box.look(&command);
        assert!(black_box.fault.is_none());
        for axis in &mut command.axes[1..3] {
            (axis.latches, axis.latched_by) = (1, control_flag::STALL);
        }
        black_box.look(&command);
        let causes = |fault: Option<Fault>| fault.map(|fault| fault.cause);
        assert_eq!(
            causes(black_box.fault.take()).unwrap(),
            "axis.arm latched by stall; axis.telescope latched by stall"
        );
        black_box.look(&command);
        assert!(black_box.fault.is_none());
        black_box.look(&ValveCommand::default());
        black_box.look(&command);
        assert!(black_box.fault.is_some());
    }

    #[test]
    fn a_file_is_due_a_second_after_the_first_fault_and_not_sooner_than_its_span_after_the_last_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        assert_eq!(black_box.due(), None);
        black_box.fault = Some(Fault { at: 5_000_000_000, cause: String::new() });
        black_box.note("a second one, which shares the file");
        assert_eq!(black_box.due(), Some(6_000_000_000));
        black_box.last = Some(4_000_000_000);
        assert_eq!(black_box.due(), Some(13_000_000_000));
    }

    #[test]
    fn the_end_of_a_run_does_not_wait_for_a_disk_that_takes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut black_box = black_box(folder.path());
        black_box.writer = Some(std::thread::spawn(|| {
            sleep(20 * PATIENCE);
            String::new()
        }));
        assert_eq!(black_box.written(false), None);
        let began = Instant::now();
        assert!(black_box.written(true).unwrap().contains("not confirmed"));
        assert!(began.elapsed() < 2 * PATIENCE && black_box.writer.is_none());
        black_box.writer = Some(std::thread::spawn(|| "done".to_owned()));
        assert_eq!(black_box.written(true).unwrap(), "done");
    }

    #[test]
    fn the_oldest_files_go_and_foreign_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..MOST_FILES + 3 {
            fs::write(folder.path().join(format!("fault-2026-01-{i:02}.mcap")), "").unwrap();
        }
        let foreign = ["a-first.mcap", "fault-0000.txt"].map(|name| folder.path().join(name));
        foreign.iter().for_each(|path| fs::write(path, "").unwrap());
        remove_oldest(folder.path()).unwrap();
        assert!(foreign.iter().all(|path| path.exists()));
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), MOST_FILES + 2);
        assert!(!folder.path().join("fault-2026-01-02.mcap").exists());
        assert!(folder.path().join("fault-2026-01-03.mcap").exists());
    }
}
