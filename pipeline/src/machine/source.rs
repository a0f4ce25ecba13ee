//! Where samples come from: `[source]`.

use std::path::{Path, PathBuf};

use super::document::Section;

/// Where samples come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// The simulated machine, plant-sim.
    Sim,
    /// A CSV record, with the columns of [`Axis::columns`](super::Axis::columns).
    Replay(PathBuf),
}

impl Source {
    pub(super) fn read(mut section: Section, folder: &Path) -> Self {
        let replay = section
            .key("kind", "Where samples come from: the simulated machine, or a record that is replayed")
            .choice(&[("sim", false), ("replay", true)])
            == Some(true);
        let source = if replay {
            let file = section.key("file", "The record to replay, with kind = \"replay\"");
            Self::Replay(folder.join(file.text("the path of a CSV record, relative to the machine file")))
        } else {
            Self::Sim
        };
        section.finish();
        source
    }
}
