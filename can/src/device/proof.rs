//! The proof of a drive's own time-out: set points stop, and the drive has to stop by itself.
//!
//! ```text
//! activate   the valve becomes active with set point 0         within 1 s
//! silence    nothing is sent                                   1.5 time-outs and 50 ms
//! judge      the valve has stopped after half a time-out or later: it passes       else the axis is refused
//! reset      rising edge of R, then hold                       within 1 s
//! ```
//!
//! A drive without the time-out keeps its last set point for ever when this program dies. The set point is 0 all the
//! time, so a sound valve stays in neutral. The proof is done whenever the valve has been set up, and no axis can be
//! armed before.

/// Time for the valve to become active, or to be reset, ns.
const PATIENCE_NS: u64 = 1_000_000_000;
/// Longest time between the time-out and the status that tells of it, ns: a few SYNC.
const MARGIN_NS: u64 = 50_000_000;

/// Where the proof stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Proof {
    /// The valve has not been set up yet.
    Waiting,
    /// The valve is to become active, until this time.
    Activating(u64),
    /// Nothing is sent from the first time until the second one.
    Silent(u64, u64),
    /// The valve has stopped by itself and is reset, until this time.
    Resetting(u64),
    /// The time-out acts.
    Passed,
    /// The valve did not stop.
    Failed,
    /// The valve did not become active, or was not reset.
    Stuck,
}

impl Proof {
    /// Begins.
    pub(super) fn begin(now_ns: u64) -> Self {
        Self::Activating(now_ns + PATIENCE_NS)
    }

    /// Where it stands now, by the state of the valve.
    pub(super) fn advance(self, now_ns: u64, timeout_ns: u64, is_active: bool, is_ready: bool) -> Self {
        match self {
            Self::Activating(_) if is_active => Self::Silent(now_ns, now_ns + timeout_ns * 3 / 2 + MARGIN_NS),
            Self::Activating(until) if now_ns >= until => Self::Stuck,
            // A valve that stops so soon does it for another reason, which proves nothing.
            Self::Silent(since, _) if !is_active && now_ns.saturating_sub(since) < timeout_ns / 2 => Self::Stuck,
            Self::Silent(..) if !is_active => Self::Resetting(now_ns + PATIENCE_NS),
            Self::Silent(_, until) if now_ns >= until => Self::Failed,
            Self::Resetting(_) if is_ready => Self::Passed,
            Self::Resetting(until) if now_ns >= until => Self::Stuck,
            other => other,
        }
    }

    /// Whether it has come to its end.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Passed | Self::Failed | Self::Stuck)
    }
}
