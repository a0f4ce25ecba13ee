//! `hydraxis clean`: removes what dead groups have left, and touches no other group.
//!
//! Runs in a process of its own and opens no channel.

use std::path::PathBuf;

use clap::Args;
use pipeline::channel::{FoundGroup, GroupState, Prefix, RemoveError, groups, place, remove_leftovers};
use serde::Serialize;

use crate::{
    failure::Failure,
    recording::black_box::write_left,
    report::{output::Output, table::table},
};

/// `clean`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis clean --dry-run          shows the groups of this computer, and what dead ones have left
  hydraxis clean                    removes what dead groups have left
  hydraxis clean --prefix demo      removes what the group \"demo\" has left; refused while the group is alive

  alive     a member runs: never touched
  dead      no member runs: its files in /dev/shm, and its folder hydraxis.NAME in TMPDIR or /dev/shm, are removed
  unknown   shared memory without a folder hydraxis.NAME. The folder may be in another TMPDIR, or the memory may belong
            to another program. Removed only with --prefix, and only while no process has it mapped
  foreign   its folder, or one of its files, belongs to another user: never touched

What the supervisor of a dead group has kept for a black box is written to the folder of its run, and named. A group
that ends by itself leaves nothing, and `hydraxis run --prefix NAME` removes what a dead group of that name has
left before it starts. Exit codes: 0 done, 1 the group of --prefix is alive or something could not be removed.")]
pub struct CleanArguments {
    /// Only this group [default: all groups of this computer]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Show what would be removed, and remove nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Write what was found and removed as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What was found of one group and what was done about it.
#[derive(Debug, Serialize)]
struct CleanedGroup {
    prefix: String,
    state: &'static str,
    files: Vec<PathBuf>,
    removed: Vec<PathBuf>,
    /// Files that were to be removed and are still there.
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
        return Err(Failure::run(format!(
            "group \"{prefix}\" is alive, nothing was removed; end it first: Ctrl-C, or SIGTERM to its `hydraxis run`"
        )));
    }
    if let Some(prefix) = &arguments.prefix
        && found.iter().any(|group| group.state == GroupState::Foreign)
        && let Err(error) = remove_leftovers(prefix)
    {
        return Err(Failure::run(format!("{error}; nothing was removed")));
    }
    if !arguments.dry_run {
        // A person reads them also where standard output is JSON.
        write_left(arguments.prefix.as_ref()).iter().for_each(|line| eprintln!("{line}"));
    }
    let cleaned: Vec<CleanedGroup> = found.into_iter().map(|group| clean(group, arguments)).collect();
    output.write(|| text(&cleaned, arguments), &cleaned)?;
    let left: Vec<String> =
        cleaned.iter().flat_map(|group| &group.left).map(|path| path.display().to_string()).collect();
    if left.is_empty() {
        return Ok(());
    }
    Err(Failure::run(format!(
        "cannot be removed; type the same command as the owner of these files, or as root: {}",
        left.join(", ")
    )))
}

fn clean(group: FoundGroup, arguments: &CleanArguments) -> CleanedGroup {
    let is_wanted = match group.state {
        GroupState::Alive | GroupState::Foreign => false,
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
            Err(RemoveError::Foreign { .. }) => state = GroupState::Foreign,
            // A process has joined the group since it was found.
            Err(_) => state = GroupState::Alive,
        }
    }
    CleanedGroup { prefix: group.prefix.to_string(), state: state.name(), files: group.files, removed, left }
}

fn text(cleaned: &[CleanedGroup], arguments: &CleanArguments) -> String {
    if cleaned.is_empty() {
        return match &arguments.prefix {
            Some(prefix) => format!("group \"{prefix}\" has left nothing\n"),
            None => "found no group, and nothing that a group has left\n".to_owned(),
        };
    }
    let row = |group: &CleanedGroup| {
        let count = |files: &[PathBuf]| files.len().to_string();
        vec![group.prefix.clone(), group.state.to_owned(), count(&group.files), count(&group.removed)]
    };
    let mut text = format!("{}\n", table(&["group", "state", "files", "removed"], cleaned.iter().map(row).collect()));
    let of = |state: GroupState| cleaned.iter().filter(move |group| group.state == state.name());
    if arguments.dry_run && of(GroupState::Dead).next().is_some() {
        text += "nothing was removed; without --dry-run the files of dead groups are removed\n";
    }
    if arguments.prefix.is_none() {
        for group in of(GroupState::Unknown) {
            text += &format!(
                "group \"{0}\": found no folder hydraxis.{0} in {1}, so hydraxis does not know its owner; \
                 once you do: hydraxis clean --prefix {0}\n",
                group.prefix,
                place().display()
            );
        }
    }
    text
}
