//! `hydraxis record`: writes all messages of a running group to files.
//!
//! Runs in a process of its own, with the least priority, beside the loop. No stage waits for it.

mod arguments;

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::Duration,
};

use pipeline::{
    channel::{Board, ChannelError, FoundGroup, Group, GroupState, Prefix, groups, remove_leftovers},
    machine::{BUILT_IN, BUILT_IN_MODEL, Machine, ReferenceSource, model_settings_in, samples_of},
    stage::StageKind,
};

use crate::{
    arguments::{BareMachine, load_bare},
    failure::Failure,
    group::{
        lifeline,
        operator::OperatorError,
        running::{facts_of, machine_of, meant, recording_mark},
        signals::stop_flag,
    },
    recording::{
        Facts, MACHINE, SETTINGS, default_folder,
        file::cause,
        recorder::{Recorded, Recorder, SNAPSHOTS, SNAPSHOTS_FACT},
        recordings_folder,
        store::{Contents, Place, Store},
        trajectory_name,
    },
    report::output::show,
};
pub use arguments::{RecordArguments, size};

/// Time between two looks at the channels. At 1 kHz a channel keeps messages for ten of them.
const POLL: Duration = Duration::from_millis(20);
/// A group without any message for so long has ended.
const SILENCE: Duration = Duration::from_secs(5);
/// Longest time to end a file after the supervisor has died.
const ENDING: Duration = Duration::from_secs(10);
/// Least priority among the processes that share a core.
const NICE: i32 = 19;

/// Runs the command.
pub fn run(arguments: &RecordArguments) -> Result<(), Failure> {
    let stop = stop_flag()?;
    if let Some(parent) = arguments.parent {
        let held = lifeline::hold(parent, "record", ENDING);
        held.map_err(|error| Failure::from(error).about("record"))?;
    }
    let prefix = meant(arguments.prefix.as_ref())?;
    let alive = |group: &FoundGroup| group.state == GroupState::Alive && group.prefix == prefix;
    if arguments.parent.is_none() && !groups().iter().any(alive) {
        return Err(OperatorError::NoGroup(prefix).into());
    }
    let group = Group::join(&prefix, "record").map_err(ChannelError::from)?;
    let (contents, snapshot_ticks) = contents(&prefix, arguments.lockstep)?;
    let axes = contents.axes().len();
    let place = match (&arguments.output, &arguments.folder) {
        (Some(file), _) => Place::File(file.clone()),
        (None, Some(folder)) => Place::Folder(folder.clone(), arguments.limit),
        (None, None) => Place::Folder(recordings_folder().unwrap_or_else(default_folder), arguments.limit),
    };
    // A run in lock-step waits for its recorder, and does not begin without one.
    let is_part_of_run = arguments.parent.is_some() && !arguments.lockstep;
    let (Place::File(target) | Place::Folder(target, _)) = &place;
    let target = target.display().to_string();
    let store = Store::new(place, contents, is_part_of_run, |said| eprintln!("{said}"));
    let store = store.map_err(|error| Failure::run(cause(&error)).about(target).about("record"))?;
    let path = store.place().display().to_string();
    let mut recorder = Recorder::new(group, axes, snapshot_ticks, store, arguments.lockstep)?;
    if !arguments.lockstep {
        // Without the right to it, the process keeps its priority.
        let _ = rustix::process::nice(NICE);
    }
    if is_part_of_run {
        // The supervisor goes on without it after a while.
        let _ = fs::write(recording_mark(&prefix), path);
    } else {
        show(&format!("recording: {path}\n"))?;
    }
    let ended = if arguments.lockstep {
        keep_up(&mut recorder, &stop, &prefix)
    } else {
        record(&mut recorder, &stop, is_part_of_run)
    };
    let ending = recorder.leave();
    // The last member of a group that has ended meanwhile removes its files.
    let _ = remove_leftovers(&prefix);
    let recorded = ending.finish();
    ended?;
    show(&text(&recorded))?;
    Ok(())
}

/// Records until a signal, or, where it is no part of a run, until the end of the group.
fn record(recorder: &mut Recorder, stop: &AtomicBool, is_part_of_run: bool) -> Result<(), Failure> {
    while !stop.load(Ordering::Relaxed) && (is_part_of_run || recorder.silent_for() < SILENCE) {
        recorder.step()?;
        sleep(POLL);
    }
    Ok(recorder.step()?)
}

/// Records in lock-step until a signal: the loop waits for what is told on the board of the group.
fn keep_up(recorder: &mut Recorder, stop: &AtomicBool, prefix: &Prefix) -> Result<(), Failure> {
    let board = Board::find(prefix)?.ok_or_else(|| OperatorError::NoGroup(prefix.clone()))?;
    while !stop.load(Ordering::Relaxed) {
        recorder.step()?;
        board.set_recorded(recorder.ticks());
        rustix::thread::sched_yield();
    }
    // The stages have ended. What they have sent last is still on the channels.
    Ok(recorder.step()?)
}

/// What stands in every file of the group, and the ticks between two snapshots that are recorded.
fn contents(prefix: &Prefix, is_lockstep: bool) -> Result<(Contents, u64), Failure> {
    let bare = machine_of(prefix, &[])?;
    let machine = load_bare(&bare, None).map_err(Failure::usage)?;
    let BareMachine { machine: file, mut settings, .. } = bare;
    let read = |file: &Path| fs::read(file).map_err(|error| Failure::run(error).about(file.display().to_string()));
    let text = match &file {
        Some(file) => read(file)?,
        None => {
            // The built-in machine has its model in a text of its own.
            settings.splice(..0, model_settings_in(BUILT_IN_MODEL, "built-in model")?);
            BUILT_IN.as_bytes().to_vec()
        }
    };
    let settings = serde_json::to_vec_pretty(&settings).map_err(Failure::run)?;
    let mut attached = vec![(MACHINE.to_owned(), text), (SETTINGS.to_owned(), settings)];
    for axis in &machine.axes {
        if let ReferenceSource::Trajectory { file, .. } = &axis.reference {
            attached.push((trajectory_name(&axis.name), read(file)?));
        }
    }
    let mut facts = facts(prefix, &machine);
    facts.extend(facts_of(prefix)?);
    // A run in lock-step is made again bit for bit from all of them.
    let apart = if is_lockstep { 1 } else { samples_of(SNAPSHOTS, machine.timing.period).max(1) };
    facts.insert(SNAPSHOTS_FACT.to_owned(), apart.to_string());
    Ok((Contents { facts, attached }, apart as u64))
}

fn facts(prefix: &Prefix, machine: &Machine) -> Facts {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    [
        ("version", env!("HYDRAXIS_VERSION").to_owned()),
        ("system", system()),
        ("group", prefix.to_string()),
        ("machine", machine.name.clone()),
        ("axes", axes.join(" ")),
        ("period_s", machine.timing.period.as_secs_f64().to_string()),
        ("stages", StageKind::ALL.map(StageKind::name).join(" ")),
    ]
    .map(|(name, fact)| (name.to_owned(), fact))
    .into()
}

/// Name, release and processor of this computer's system.
fn system() -> String {
    let found = rustix::system::uname();
    [found.sysname(), found.release(), found.machine()].map(|part| part.to_string_lossy()).join(" ")
}

fn text(recorded: &Recorded) -> String {
    let mut text = match &recorded.stored.path {
        Some(path) => format!("recording: {}", path.display()),
        None => "recording: no file".to_owned(),
    };
    if recorded.stored.files > 1 {
        text += &format!(", the last of {} files", recorded.stored.files);
    }
    text += &format!("; {} messages recorded, {} lost\n", recorded.stored.messages, recorded.all_lost());
    for (channel, lost) in recorded.lost.iter().filter(|(_, lost)| **lost > 0) {
        text += &format!("warning: {channel}: {lost} lost\n");
    }
    text
}
