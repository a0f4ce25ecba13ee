//! Where samples come from and where commands go: `[source]` and `[drive]`.

use std::path::{Path, PathBuf};

use super::{document::Section, stages::program};
use crate::nearest::nearest;

/// Where samples come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// The simulated machine, plant-sim.
    Sim,
    /// A CSV record, with the columns of [`Axis::columns`](super::Axis::columns).
    Replay(PathBuf),
    /// A program that writes [`EncoderReading`](crate::message::EncoderReading)s: a driver of real encoders.
    External,
    /// Encoders on a CAN bus: [`Machine::can`](super::Machine::can) and [`Axis::can`](super::Axis::can).
    Can,
}

/// Where commands go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// The simulated machine, plant-sim.
    Sim,
    /// A program that reads [`ValveCommand`](crate::message::ValveCommand)s: a driver of real valves.
    External,
    /// Valves on the CAN bus of the encoders.
    Can,
    /// Nowhere. No controller runs. The commands of the controller that the machine has may come as
    /// [`ValveCommand`](crate::message::ValveCommand)s, so that models are identified.
    None,
}

const SIM: &str = "sim";
const REPLAY: &str = "replay";
const EXTERNAL: &str = "external";
const CAN: &str = "can";
const NONE: &str = "none";
const ALL_DRIVES: [(&str, Drive); 4] =
    [(SIM, Drive::Sim), (NONE, Drive::None), (EXTERNAL, Drive::External), (CAN, Drive::Can)];

impl Source {
    /// The source, and the program that `run` starts for it.
    ///
    /// A kind that is refused is read as the nearest one, so that only the kind is refused and not what belongs to it.
    pub(super) fn read(mut section: Section, folder: &Path) -> (Self, Option<Vec<String>>) {
        let kinds = [SIM, REPLAY, EXTERNAL, CAN];
        let typed = section.text_of("kind");
        let kind = section
            .key(
                "kind",
                "Where samples come from: the simulated machine, a record that is replayed, a program that writes \
                 encoder-reading, or encoders on a CAN bus",
            )
            .choice(&kinds.map(|kind| (kind, kind)))
            .or_else(|| nearest(&typed?, kinds).first().copied());
        let mut command = None;
        let source = match kind {
            Some(REPLAY) => {
                let file = section.key("file", "The record to replay, with kind = \"replay\"");
                Self::Replay(folder.join(
                    file.text("the path of a record, CSV or MCAP of `hydraxis record`, relative to the machine file"),
                ))
            }
            Some(EXTERNAL) => {
                command = program(
                    &mut section,
                    "The program that writes encoder-reading and reads valve-command, with kind = \"external\"; \
                     without it the program is started by hand",
                    "a program and its arguments, such as [\"python3\", \"rig.py\"]",
                );
                Self::External
            }
            Some(CAN) => Self::Can,
            _ => Self::Sim,
        };
        match kind {
            Some(_) => section.finish(),
            // It is not known which keys belong to an unknown kind.
            None => section.pass_over(&["file", "command"]),
        }
        (source, command)
    }

    /// Its name in the machine file.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sim => SIM,
            Self::Replay(_) => REPLAY,
            Self::External => EXTERNAL,
            Self::Can => CAN,
        }
    }

    /// Whether it is a real machine, whose time nobody can hold and which a person arms.
    pub fn is_real(&self) -> bool {
        matches!(self, Self::External | Self::Can)
    }

    /// The drives that go with the source, its own first.
    fn drives(&self) -> &'static [(&'static str, Drive)] {
        match self {
            Self::Sim => &[(SIM, Drive::Sim)],
            Self::Replay(_) => &[(NONE, Drive::None)],
            Self::External => &[(EXTERNAL, Drive::External), (NONE, Drive::None)],
            Self::Can => &[(CAN, Drive::Can), (NONE, Drive::None)],
        }
    }
}

impl Drive {
    /// Whether it moves a real machine.
    pub fn is_real(self) -> bool {
        matches!(self, Self::External | Self::Can)
    }

    pub(super) fn read(mut section: Section, source: &Source) -> Self {
        // A source that was refused may be any.
        let choices = if section.is_refused("source.kind") { &ALL_DRIVES } else { source.drives() };
        let drive = section
            .key(
                "kind",
                "Where commands go: the simulated machine, a program that reads valve-command, valves on the CAN bus, \
                 or nowhere, so that no controller runs",
            )
            .rule("as the source; \"none\" with source.kind = \"replay\"")
            .choice_or(choices[0].1, choices);
        section.finish();
        drive
    }
}
