//! `hydraxis record`: writes all messages of a running group to files.
//!
//! Runs in a process of its own, with the least priority, beside the loop. No stage waits for it.

mod arguments;

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::Duration,
};

use pipeline::{
    channel::{Board, ChannelError, FoundGroup, Group, GroupState, Prefix, groups, remove_leftovers},
    machine::{BUILT_IN, BUILT_IN_MODEL, Machine, ReferenceSource, model_settings_in},
    stage::StageKind,
};

use crate::{
    arguments::{BareMachine, load_bare},
    failure::Failure,
    group::{
        lifeline,
        operator::OperatorError,
        running::{RunMode, machine_of, meant, mode_of},
        signals::stop_flag,
    },
    recording::{
        Facts, LOCK_STEP, MACHINE, SETTINGS, default_folder,
        recorder::{Recorded, Recorder},
        store::{Contents, Place, Store},
        trajectory_name,
    },
    report::output::show,
};
pub use arguments::RecordArguments;

/// Time between two looks at the channels. At 1 kHz a channel keeps messages for ten of them.
const POLL: Duration = Duration::from_millis(20);
/// A group without any message for so long has ended.
const SILENCE: Duration = Duration::from_secs(5);
/// Least priority among the processes that share a core.
const NICE: i32 = 19;

/// Runs the command.
pub fn run(arguments: &RecordArguments) -> Result<(), Failure> {
    let stop = stop_flag()?;
    if let Some(parent) = arguments.parent {
        lifeline::hold(parent, "record").map_err(|error| Failure::from(error).about("record"))?;
    }
    let prefix = meant(arguments.prefix.as_ref())?;
    let alive = |group: &FoundGroup| group.state == GroupState::Alive && group.prefix == prefix;
    if arguments.parent.is_none() && !groups().iter().any(alive) {
        return Err(OperatorError::NoGroup(prefix).into());
    }
    if !arguments.lockstep {
        // Without the right to it, the process keeps its priority.
        let _ = rustix::process::nice(NICE);
    }
    let group = Group::join(&prefix, "record").map_err(ChannelError::from)?;
    let contents = contents(&prefix)?;
    let place = match (&arguments.output, &arguments.folder) {
        (Some(file), _) => Place::File(file.clone()),
        (None, folder) => Place::Folder(folder.clone().unwrap_or_else(default_folder), arguments.limit),
    };
    let store = Store::new(place, contents, |said| eprintln!("{said}"));
    let store = store.map_err(|error| Failure::run(error).about("record"))?;
    let path = store.path().map(|path| path.display().to_string()).unwrap_or_default();
    let mut recorder = Recorder::new(&group, store, arguments.lockstep)?;
    show(&format!("recording: {path}\n"))?;
    let ended = if arguments.lockstep { keep_up(&mut recorder, &stop, &prefix) } else { record(&mut recorder, &stop) };
    let recorded = recorder.finish();
    drop(group);
    // The last member of a group that has ended meanwhile removes its files.
    let _ = remove_leftovers(&prefix);
    ended?;
    show(&text(&recorded))?;
    Ok(())
}

/// Records until a signal or the end of the group.
fn record(recorder: &mut Recorder, stop: &AtomicBool) -> Result<(), Failure> {
    while !stop.load(Ordering::Relaxed) && recorder.silent_for() < SILENCE {
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

/// What stands in every file of the group.
fn contents(prefix: &Prefix) -> Result<Contents, Failure> {
    let bare = machine_of(prefix, &[])?;
    let machine = load_bare(&bare, None).map_err(Failure::usage)?;
    let BareMachine { machine: file, mut settings, .. } = bare;
    let read = |file: &Path| std::fs::read(file).map_err(|error| Failure::run(error).about(file.display().to_string()));
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
    Ok(Contents { facts: facts(prefix, &machine, mode_of(prefix)?), attached })
}

fn facts(prefix: &Prefix, machine: &Machine, mode: RunMode) -> Facts {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    [
        ("version", env!("HYDRAXIS_VERSION").to_owned()),
        ("group", prefix.to_string()),
        ("machine", machine.name.clone()),
        ("axes", axes.join(" ")),
        ("period_s", machine.timing.period.as_secs_f64().to_string()),
        ("clock", if mode.lockstep { LOCK_STEP } else { "real time" }.to_owned()),
        ("seed", mode.seed.to_string()),
        ("stages", StageKind::ALL.map(StageKind::name).join(" ")),
    ]
    .map(|(name, fact)| (name.to_owned(), fact))
    .into()
}

fn text(recorded: &Recorded) -> String {
    let mut text = format!("{} messages recorded, {} lost\n", recorded.messages, recorded.all_lost());
    for (channel, lost) in recorded.lost.iter().filter(|(_, lost)| **lost > 0) {
        text += &format!("warning: {channel}: {lost} lost\n");
    }
    text
}
