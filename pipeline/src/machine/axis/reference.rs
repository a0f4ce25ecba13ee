//! Where an axis gets its target from: `[axis.NAME.reference]`.

use std::path::{Path, PathBuf};

use crate::machine::document::Section;

/// Where an axis gets its target from.
#[derive(Debug, Clone, PartialEq)]
pub enum ReferenceSource {
    /// Stays where it is at start.
    Hold,
    /// center + sum of amplitude sin(2 pi frequency t + phase).
    Sines {
        /// Middle, m.
        center: f64,
        /// The sines that are added.
        sines: Vec<Sine>,
    },
    /// Straight lines through (time, position), repeated from the start after the last.
    Ramps(Vec<(f64, f64)>),
    /// A CSV file with columns `t` (s) and one per axis (m), straight lines between its rows, the last held.
    Trajectory {
        /// The file.
        file: PathBuf,
        /// Its column.
        column: String,
    },
    /// The `Reference` channel.
    Channel,
}

/// One sine of a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// m
    pub amplitude: f64,
    /// Hz
    pub frequency: f64,
    /// rad
    pub phase: f64,
}

#[derive(Clone, Copy)]
enum Kind {
    Hold,
    Sines,
    Ramps,
    Trajectory,
    Channel,
}

impl ReferenceSource {
    pub(super) fn read(
        mut section: Section,
        soft_limits: (f64, f64),
        max_speed: f64,
        folder: &Path,
        axis: &str,
    ) -> Self {
        let kinds = [
            ("hold", Kind::Hold),
            ("sines", Kind::Sines),
            ("ramps", Kind::Ramps),
            ("trajectory", Kind::Trajectory),
            ("channel", Kind::Channel),
        ];
        let chosen = section.choice("kind", &kinds);
        let source = match chosen {
            None | Some(Kind::Hold) => Self::Hold,
            Some(Kind::Channel) => Self::Channel,
            Some(Kind::Sines) => read_sines(&mut section, soft_limits, max_speed),
            Some(Kind::Ramps) => read_ramps(&mut section, soft_limits, max_speed),
            Some(Kind::Trajectory) => Self::Trajectory {
                file: folder.join(section.text("file", "the path of a CSV file, relative to the machine file")),
                column: section.text_or("column", axis),
            },
        };
        // Another kind from the command line leaves the keys of the one in the file behind; after an unknown kind
        // nobody can say which keys belong to it.
        if chosen.is_some() && !section.is_set("kind") {
            section.finish();
        }
        source
    }
}

fn read_sines(section: &mut Section, (low, high): (f64, f64), max_speed: f64) -> ReferenceSource {
    let center = section.number("center", low..=high, "m (the soft limits)");
    let mut sines = Vec::new();
    for mut item in section.list("sines") {
        sines.push(Sine {
            amplitude: item.number("amplitude", 0.0..=100.0, "m"),
            frequency: item.number("frequency", 0.0..=1000.0, "Hz"),
            phase: item.number_or("phase", 0.0, -10.0..=10.0, "rad"),
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

fn read_ramps(section: &mut Section, (low, high): (f64, f64), max_speed: f64) -> ReferenceSource {
    let times = section.numbers("times", 0.0..=1e6, "s", 2);
    let positions = section.numbers("positions", low..=high, "m (the soft limits)", 2);
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
