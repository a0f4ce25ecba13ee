//! `hydraxis record`: writes all messages of a running group to files.
//!
//! Runs in a process of its own, with the least priority, beside the loop. No stage waits for it.

mod arguments;

use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::Duration,
};

use pipeline::{
    channel::{ChannelError, FoundGroup, Group, GroupState, Prefix, groups, remove_leftovers},
    machine::{BUILT_IN, Machine},
    stage::StageKind,
};

use crate::{
    arguments::{BareMachine, load_bare},
    failure::Failure,
    group::{
        lifeline,
        operator::OperatorError,
        running::{machine_of, meant},
        signals::stop_flag,
    },
    recording::{
        Facts, default_folder,
        recorder::{Recorded, Recorder},
        store::{Contents, Place, Store},
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
    // Without the right to it, the process keeps its priority.
    let _ = rustix::process::nice(NICE);
    let group = Group::join(&prefix, "record").map_err(ChannelError::from)?;
    let contents = contents(&prefix)?;
    let place = match (&arguments.output, &arguments.folder) {
        (Some(file), _) => Place::File(file.clone()),
        (None, folder) => Place::Folder(folder.clone().unwrap_or_else(default_folder), arguments.limit),
    };
    let store = Store::new(place, contents, |said| eprintln!("{said}"));
    let store = store.map_err(|error| Failure::run(error).about("record"))?;
    let path = store.path().map(|path| path.display().to_string()).unwrap_or_default();
    let mut recorder = Recorder::new(&group, store)?;
    show(&format!("recording: {path}\n"))?;
    let ended = record(&mut recorder, &stop);
    let recorded = recorder.finish();
    drop(group);
    // The last member of a group that has ended meanwhile removes its files.
    let _ = remove_leftovers(&prefix);
    ended?;
    show(&text(&recorded))?;
    Ok(())
}

/// Records until a signal or the end of the group.
fn record(recorder: &mut Recorder, stop: &AtomicBool) -> Result<(), ChannelError> {
    while !stop.load(Ordering::Relaxed) && recorder.silent_for() < SILENCE {
        recorder.step()?;
        sleep(POLL);
    }
    recorder.step()
}

/// What stands in every file of the group.
fn contents(prefix: &Prefix) -> Result<Contents, Failure> {
    let bare = machine_of(prefix, &[])?;
    let machine = load_bare(&bare, None).map_err(Failure::usage)?;
    let BareMachine { machine: file, settings, .. } = bare;
    let text = match &file {
        Some(file) => std::fs::read(file).map_err(|error| Failure::run(error).about(file.display().to_string()))?,
        None => BUILT_IN.as_bytes().to_vec(),
    };
    let settings = serde_json::to_vec_pretty(&settings).map_err(Failure::run)?;
    let attached = vec![("machine.toml".to_owned(), text), ("settings.json".to_owned(), settings)];
    Ok(Contents { facts: facts(prefix, &machine), attached })
}

fn facts(prefix: &Prefix, machine: &Machine) -> Facts {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    [
        ("version", env!("HYDRAXIS_VERSION").to_owned()),
        ("group", prefix.to_string()),
        ("machine", machine.name.clone()),
        ("axes", axes.join(" ")),
        ("period_s", machine.timing.period.as_secs_f64().to_string()),
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
