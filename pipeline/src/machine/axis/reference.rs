//! Where an axis gets its reference from: `[axis.NAME.reference]`.

use std::path::{Path, PathBuf};

use crate::machine::document::Section;

/// Where an axis gets its reference from.
#[derive(Debug, Clone, PartialEq)]
pub enum ReferenceSource {
    /// The position at the start, held.
    Hold,
    /// center + sum of amplitude sin(2 pi frequency t + phase).
    Sines {
        /// Middle, m.
        center: f64,
        /// The sines that are added.
        sines: Vec<Sine>,
    },
    /// Straight lines through points (time, position); after the last point they begin again.
    Ramps(Vec<(f64, f64)>),
    /// A CSV file with columns `t` (s) and one per axis (m): straight lines between its rows, the last row held.
    Trajectory {
        /// The file.
        file: PathBuf,
        /// The column of the axis.
        column: String,
    },
    /// The channel of [`Reference`](crate::message::Reference) messages.
    Channel,
    /// The motion of the teeth, [`TipTask`](crate::machine::TipTask), which four axes follow together.
    Tip,
}

/// One sine of a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// Amplitude, m.
    pub amplitude: f64,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Phase at the start, rad.
    pub phase: f64,
}

/// What a reference must keep to.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// Lowest and highest position, m.
    pub soft_limits: (f64, f64),
    /// Fastest speed, m/s.
    pub max_speed: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Hold,
    Sines,
    Ramps,
    Trajectory,
    Channel,
    Tip,
}

impl ReferenceSource {
    pub(super) fn read(mut section: Section, limits: Limits, folder: &Path, axis: &str) -> Self {
        let kinds = [
            ("hold", Kind::Hold),
            ("sines", Kind::Sines),
            ("ramps", Kind::Ramps),
            ("trajectory", Kind::Trajectory),
            ("channel", Kind::Channel),
            ("tip", Kind::Tip),
        ];
        let chosen = section.key("kind", "Where the reference comes from").choice(&kinds);
        let source = match chosen {
            None | Some(Kind::Hold) => Self::Hold,
            Some(Kind::Channel) => Self::Channel,
            Some(Kind::Tip) => Self::Tip,
            Some(Kind::Sines) => read_sines(&mut section, limits),
            Some(Kind::Ramps) => read_ramps(&mut section, limits),
            Some(Kind::Trajectory) => Self::Trajectory {
                file: folder.join(
                    section
                        .key("file", "CSV file with the trajectory, for kind = \"trajectory\"")
                        .text("the path of a CSV file, relative to the machine file"),
                ),
                column: section
                    .key("column", "Column of this axis, for kind = \"trajectory\"")
                    .rule("the name of the axis")
                    .text_or(axis),
            },
        };
        // A kind from the command line leaves the keys of the file's kind behind, which are not unknown. After an
        // unknown kind it is not known which keys belong to it.
        if chosen.is_some() && !section.is_set("kind") {
            section.finish();
        }
        source
    }
}

fn read_sines(section: &mut Section, limits: Limits) -> ReferenceSource {
    let Limits { soft_limits: (low, high), max_speed } = limits;
    let center = section
        .key("center", "Middle of the sum of sines, for kind = \"sines\"")
        .allows("a number within the soft limits")
        .number(low..=high, "m (the soft limits)");
    let mut sines = Vec::new();
    for mut item in section.list("sines") {
        sines.push(Sine {
            amplitude: item.key("amplitude", "Amplitude of one sine").number(0.0..=100.0, "m"),
            frequency: item.key("frequency", "Frequency of one sine").number(0.0..=1000.0, "Hz"),
            phase: item.key("phase", "Phase of one sine at the start").number_or(0.0, -10.0..=10.0, "rad"),
        });
        item.finish();
    }
    let reach: f64 = sines.iter().map(|sine| sine.amplitude).sum();
    if center - reach < low || center + reach > high {
        let found = format!("a reach from {} to {} m", center - reach, center + reach);
        section.refuse("sines", found, format!("what stays in the soft limits, {low} to {high} m"));
    }
    let speed: f64 = sines.iter().map(|sine| sine.amplitude * sine.frequency * std::f64::consts::TAU).sum();
    if speed > max_speed {
        section.refuse("sines", format!("speeds up to {speed:.3} m/s"), format!("up to max_speed, {max_speed} m/s"));
    }
    ReferenceSource::Sines { center, sines }
}

fn read_ramps(section: &mut Section, limits: Limits) -> ReferenceSource {
    let Limits { soft_limits: (low, high), max_speed } = limits;
    let times = section
        .key("times", "Times of the corners of the ramps, which begin again after the last, for kind = \"ramps\"")
        .allows("2 or more times that start at 0 and rise")
        .numbers(0.0..=1e6, "s", 2);
    let positions = section
        .key("positions", "Positions of the corners of the ramps, for kind = \"ramps\"")
        .allows("as many positions within the soft limits as times, the last equal to the first")
        .numbers(low..=high, "m (the soft limits)", 2);
    if times.len() != positions.len() {
        let found = format!("{} times for {} positions", times.len(), positions.len());
        section.refuse("times", found, "as many times as positions");
    }
    if times.first().is_some_and(|&first| first != 0.0) || times.windows(2).any(|pair| pair[1] <= pair[0]) {
        section.refuse("times", format!("{times:?}"), "times that start at 0 and rise");
    }
    let points: Vec<(f64, f64)> = times.into_iter().zip(positions).collect();
    if points.first().map(|point| point.1) != points.last().map(|point| point.1) {
        section.refuse("positions", "an end that differs from the start", "a closed round: the ramps repeat");
    }
    let fastest = points.windows(2).map(|p| ((p[1].1 - p[0].1) / (p[1].0 - p[0].0)).abs()).fold(0.0, f64::max);
    if fastest > max_speed {
        section.refuse("positions", format!("a ramp of {fastest:.3} m/s"), format!("up to max_speed, {max_speed} m/s"));
    }
    ReferenceSource::Ramps(points)
}
