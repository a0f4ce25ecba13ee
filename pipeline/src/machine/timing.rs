//! Period and time-outs: `[timing]`.

use std::time::Duration;

use super::document::Section;

/// Rates and time-outs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Sample and control period.
    pub period: Duration,
    /// Without a sample for this long the valve goes neutral and stays so.
    pub feedback_timeout: Duration,
    /// A snapshot older than this is said to be stale.
    pub model_timeout: Duration,
    /// A snapshot older than this is not used, and the axis is slowed down.
    pub model_lifetime: Duration,
    /// Without a command for this long the drive itself goes neutral.
    pub drive_timeout: Duration,
}

impl Timing {
    pub(super) fn read(mut section: Section) -> Self {
        let millis = Duration::from_millis;
        let period = section.duration("period", Duration::from_micros(100)..=Duration::from_secs(10));
        let model_timeout = section.duration_or("model_timeout", millis(2000), millis(1)..=millis(600_000));
        let lifetime = millis(30_000).max(model_timeout);
        let timing = Self {
            period,
            feedback_timeout: section.duration_or("feedback_timeout", period * 3, millis(1)..=millis(60_000)),
            model_timeout,
            model_lifetime: section.duration_or("model_lifetime", lifetime, millis(1)..=millis(3_600_000)),
            drive_timeout: section.duration_or("drive_timeout", millis(50), millis(1)..=millis(60_000)),
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
