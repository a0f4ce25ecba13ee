//! The position encoder: `[axis.NAME.encoder]`.

use std::time::Duration;

use crate::machine::document::Section;

/// The position encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// Length of one count, m.
    pub resolution: f64,
    /// How far outside the stroke a position is still believed, m.
    pub tolerance: f64,
    /// A raw value that has not changed for this long while the axis is commanded to move is stuck.
    pub stuck_after: Duration,
}

impl Encoder {
    pub(super) fn read(mut section: Section) -> Self {
        let encoder = Self {
            resolution: section.number("resolution", 1e-9..=0.1, "m"),
            tolerance: section.number_or("tolerance", 5e-3, 0.0..=1.0, "m"),
            stuck_after: section.duration_or(
                "stuck_after",
                Duration::from_millis(300),
                Duration::from_millis(1)..=Duration::from_secs(60),
            ),
        };
        section.finish();
        encoder
    }
}
