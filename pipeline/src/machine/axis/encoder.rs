//! The position encoder: `[axis.NAME.encoder]`.

use std::time::Duration;

use crate::machine::document::Section;

/// The position encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// Length of one count, m.
    pub resolution: f64,
    /// How far outside the stroke a position is still plausible, m.
    pub tolerance: f64,
    /// An encoder is stuck when its raw value has not changed for this long while the axis is commanded to move.
    pub stuck_after: Duration,
}

impl Encoder {
    pub(super) fn read(mut section: Section) -> Self {
        let encoder =
            Self {
                resolution: section.key("resolution", "Length of one encoder count").number(1e-9..=0.1, "m"),
                tolerance: section
                    .key("tolerance", "How far outside the stroke a position is still plausible")
                    .number_or(5e-3, 0.0..=1.0, "m"),
                stuck_after: section
                    .key(
                        "stuck_after",
                        "The encoder is stuck when it does not change for this long while the axis should move",
                    )
                    .duration_or(Duration::from_millis(300), Duration::from_millis(1)..=Duration::from_secs(60)),
            };
        section.finish();
        encoder
    }
}
