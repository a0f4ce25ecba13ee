//! Room that is left for a group's files, and room that a stage needs that starts again.
//!
//! ```text
//! needed = largest sum of the files of one process + margin       where shared memory lies
//! needed = all files of the group's folder + margin               where the folder lies
//! ```
//!
//! A stage that starts again takes its memory a second time: the memory of the dead process is freed only after its
//! readers have let it go. The name of a file tells which process has made it. iceoryx2 puts numbers of 128 bits into
//! the name, in decimal digits: from the highest bits on a counter, the process, ns and s of its clock, 32 bits each.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use rustix::fs::statvfs;

use super::{
    names::{entries, memory},
    prefix::{Prefix, SHARED_MEMORY},
};

/// Room for clients that join meanwhile, and for files that are allocated in pages, bytes.
pub const MARGIN: u64 = 1 << 20;
/// Unit in which the kernel counts the allocated part of a file, bytes.
const BLOCK: u64 = 512;

/// Room in one of the two places where a group has files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Room {
    /// The place: `/dev/shm`, or the group's folder.
    pub place: PathBuf,
    /// Room that is left, bytes.
    pub left: u64,
    /// Room that a stage needs that starts again, bytes.
    pub needed: u64,
}

impl Room {
    /// Whether a stage that dies could not start again.
    pub fn is_short(&self) -> bool {
        self.left < self.needed
    }
}

impl fmt::Display for Room {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mega = |bytes: u64| bytes as f64 / 1e6;
        let (place, left, needed) = (self.place.display(), mega(self.left), mega(self.needed));
        let verb = if self.is_short() { "cannot" } else { "can" };
        write!(f, "{place} has {left:.1} MB left, and a stage needs {needed:.1} MB to start again: it {verb}")
    }
}

/// The room for a group's shared memory and for its folder. A place that does not tell how much is left is left out.
pub fn rooms(prefix: &Prefix) -> Vec<Room> {
    let folder = prefix.folder();
    let of_memory = largest_process(&memory(prefix));
    let places = [(PathBuf::from(SHARED_MEMORY), of_memory), (folder.clone(), all_below(&folder))];
    let room = |(place, used): (PathBuf, u64)| {
        let space = statvfs(&place).ok()?;
        Some(Room { left: space.f_bavail.saturating_mul(space.f_frsize), needed: used + MARGIN, place })
    };
    places.into_iter().filter_map(room).collect()
}

/// The largest allocated sum of the files of one process.
fn largest_process(files: &[PathBuf]) -> u64 {
    let mut sums = BTreeMap::<u32, u64>::new();
    for file in files {
        for process in makers(file) {
            *sums.entry(process).or_default() += allocated(file);
        }
    }
    sums.into_values().max().unwrap_or_default()
}

/// The processes that a name of iceoryx2 names. A connection names the processes at both of its ends.
fn makers(file: &Path) -> BTreeSet<u32> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let numbers = name.split(['_', '.']).filter_map(|part| part.parse::<u128>().ok());
    numbers.map(|number| (number >> 64) as u32).filter(|process| *process != 0).collect()
}

fn all_below(folder: &Path) -> u64 {
    let of = |path: PathBuf| {
        let is_folder = path.symlink_metadata().is_ok_and(|found| found.is_dir());
        allocated(&path) + if is_folder { all_below(&path) } else { 0 }
    };
    entries(folder).map(of).sum()
}

fn allocated(path: &Path) -> u64 {
    path.symlink_metadata().map_or(0, |found| found.blocks() * BLOCK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{channel::Group, message::EncoderSample};

    #[test]
    fn the_names_of_files_tell_the_processes_that_made_them() {
        let of = |rest: &str| {
            let name = format!("/dev/shm/demo.{}_{rest}", "0354a209029e7d094a819e2d4030ea331e6caaf0");
            makers(Path::new(&name)).into_iter().collect::<Vec<_>>()
        };
        let number =
            |process: u128, counter: u128| ((counter << 96) | (process << 64) | (12345 << 32) | 678).to_string();
        assert_eq!(of(&format!("{}.data", number(4321, 7))), [4321]);
        assert_eq!(of(&format!("{}_{}.connection", number(4321, 7), number(99, 1))), [99, 4321]);
        assert_eq!(of(&format!("{}_{}.connection", number(99, 7), number(99, 1))), [99]);
        assert_eq!(of("node.0_10_0.global_mgmt"), []);
        assert_eq!(of("board.stop"), []);
    }

    #[test]
    fn what_a_process_needs_is_at_least_what_it_has_allocated() {
        let prefix: Prefix = format!("t{}-room", std::process::id()).parse().unwrap();
        let group = Group::join(&prefix, "test").unwrap();
        let publisher = group.publisher::<EncoderSample>().unwrap();
        let data = memory(&prefix).into_iter().filter(|path| path.extension().is_some_and(|end| end == "data"));
        let data: u64 = data.map(|path| path.metadata().unwrap().len()).sum();
        let all: u64 = memory(&prefix).iter().map(|path| allocated(path)).sum();
        let [shared, folder] = <[Room; 2]>::try_from(rooms(&prefix)).unwrap();
        assert!(data > 0 && shared.needed >= data + MARGIN, "{shared:?}, {data} bytes");
        assert!(shared.needed <= all + MARGIN, "{shared:?}, {all} bytes");
        assert!(folder.place == prefix.folder() && folder.needed > MARGIN, "{folder:?}");
        drop((publisher, group));
        crate::channel::remove_leftovers(&prefix).unwrap();
    }
}
