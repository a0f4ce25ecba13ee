//! Where samples come from: `[source]`.

use std::path::{Path, PathBuf};

use super::document::Section;

/// Where samples come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// plant-sim.
    Sim,
    /// A CSV record, columns by [`Axis::columns`].
    Replay(PathBuf),
}

impl Source {
    pub(super) fn read(mut section: Section, folder: &Path) -> Self {
        let replay = section.choice("kind", &[("sim", false), ("replay", true)]) == Some(true);
        let source = if replay {
            Self::Replay(folder.join(section.text("file", "the path of a CSV record, relative to the machine file")))
        } else {
            Self::Sim
        };
        section.finish();
        source
    }
}
