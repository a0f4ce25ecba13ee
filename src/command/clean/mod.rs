//! `hydraxis clean`: removes what dead groups have left, and touches no other.

mod arguments;

use std::path::PathBuf;

use pipeline::channel::{FoundGroup, GroupState, groups, remove_leftovers};
use serde::Serialize;

use crate::{
    failure::Failure,
    report::{output::Output, table::table},
};
pub use arguments::CleanArguments;

/// What became of one group.
#[derive(Debug, Serialize)]
struct Cleaned {
    prefix: String,
    state: &'static str,
    files: Vec<PathBuf>,
    removed: Vec<PathBuf>,
    /// What was to be removed and is still there.
    left: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &CleanArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let is_asked_for = |group: &FoundGroup| arguments.prefix.as_ref().is_none_or(|prefix| *prefix == group.prefix);
    let found: Vec<FoundGroup> = groups().into_iter().filter(is_asked_for).collect();
    if let Some(prefix) = &arguments.prefix
        && found.iter().any(|group| group.state == GroupState::Alive)
    {
        return Err(Failure::Run(format!(
            "group \"{prefix}\" is alive, nothing was removed; end it first: Ctrl-C, or SIGTERM to its `hydraxis run`"
        )));
    }
    let cleaned: Vec<Cleaned> = found.into_iter().map(|group| clean(group, arguments)).collect();
    output.write(|| text(&cleaned, arguments), &cleaned)?;
    let left: Vec<String> =
        cleaned.iter().flat_map(|group| &group.left).map(|path| path.display().to_string()).collect();
    if left.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(format!("cannot be removed; type the same as their owner, or as root: {}", left.join(", "))))
}

fn clean(group: FoundGroup, arguments: &CleanArguments) -> Cleaned {
    let is_wanted = match group.state {
        GroupState::Alive => false,
        GroupState::Dead => true,
        GroupState::Unknown => arguments.prefix.is_some(),
    };
    let (mut removed, mut left) = (Vec::new(), Vec::new());
    let mut state = group.state;
    if is_wanted && !arguments.dry_run {
        match remove_leftovers(&group.prefix) {
            Ok(files) => {
                removed = files;
                left = group.files.iter().filter(|file| file.exists()).cloned().collect();
            }
            // Somebody has joined it since it was looked at.
            Err(_) => state = GroupState::Alive,
        }
    }
    Cleaned { prefix: group.prefix.to_string(), state: state.name(), files: group.files, removed, left }
}

fn text(cleaned: &[Cleaned], arguments: &CleanArguments) -> String {
    if cleaned.is_empty() {
        return match &arguments.prefix {
            Some(prefix) => format!("group \"{prefix}\" has left nothing\n"),
            None => "no group is here, nor anything that one has left\n".to_owned(),
        };
    }
    let row = |group: &Cleaned| {
        let count = |files: &[PathBuf]| files.len().to_string();
        vec![group.prefix.clone(), group.state.to_owned(), count(&group.files), count(&group.removed)]
    };
    let mut text = format!("{}\n", table(&["group", "state", "files", "removed"], cleaned.iter().map(row).collect()));
    let of = |state: GroupState| cleaned.iter().filter(move |group| group.state == state.name());
    if arguments.dry_run && of(GroupState::Dead).next().is_some() {
        text += "nothing was removed; without --dry-run what is left of the dead is\n";
    }
    if arguments.prefix.is_none() {
        for group in of(GroupState::Unknown) {
            text += &format!(
                "group \"{0}\": no folder hydraxis.{0} in {1}, so nobody knows whose it is; once you do: hydraxis clean \
                 --prefix {0}\n",
                group.prefix,
                std::env::temp_dir().display()
            );
        }
    }
    text
}
