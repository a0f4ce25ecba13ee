//! Period and time-outs: `[timing]`.

use std::time::Duration;

use super::document::Section;

/// Period and time-outs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Sample and control period.
    pub period: Duration,
    /// Without a sample, or a reading in it, for this long the valve goes to neutral and stays there.
    pub feedback_timeout: Duration,
    /// A snapshot older than this is stale.
    pub model_timeout: Duration,
    /// A snapshot older than this is not used any more, and the axis is slowed down.
    pub model_lifetime: Duration,
    /// Without a command for this long the drive itself goes to neutral.
    pub drive_timeout: Duration,
}

impl Timing {
    pub(super) fn read(mut section: Section) -> Self {
        let millis = Duration::from_millis;
        let period = section
            .key("period", "Sample and control period of all axes")
            .duration(Duration::from_micros(100)..=Duration::from_secs(10));
        let model_timeout = section
            .key("model_timeout", "A snapshot older than this is stale; the last approved model is used further")
            .duration_or(millis(2000), millis(1)..=millis(600_000));
        let lifetime = millis(30_000).max(model_timeout);
        let timing = Self {
            period,
            feedback_timeout: section
                .key(
                    "feedback_timeout",
                    "Without a sample, or a reading in it, for this long the valve goes to neutral and stays there",
                )
                .rule("3 periods")
                .duration_or(period * 3, millis(1)..=millis(60_000)),
            model_timeout,
            model_lifetime: section
                .key("model_lifetime", "A snapshot older than this is not used any more, and the axis is slowed down")
                .rule("30s, or model_timeout where that is longer")
                .duration_or(lifetime, millis(1)..=millis(3_600_000)),
            drive_timeout: section
                .key("drive_timeout", "Without a command for this long the drive itself goes to neutral")
                .rule("50ms, or 3 periods where that is longer")
                .duration_or(millis(50).max(period * 3), millis(1)..=millis(60_000)),
        };
        if timing.model_lifetime < timing.model_timeout {
            section.refuse(
                "model_lifetime",
                format!("{:?}", timing.model_lifetime),
                format!("model_timeout, {:?}, or longer", timing.model_timeout),
            );
        }
        section.finish();
        timing
    }
}
