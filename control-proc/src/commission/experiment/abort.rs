//! Reasons that end an experiment before its time.

use std::fmt;

use pipeline::message::{bit_names, sample_fault};

/// Way that the axis should have gone while its encoder stood still that ends the experiment, m.
pub const OWED_DISTANCE: f64 = 0.02;
/// Travel to ask for in parts of the least one.
const WIDER: f64 = 1.5;
/// What to do about a motion against the command, of an axis that has followed and of one that has not.
const SWINGS: &str = "the axis has followed both directions before, so its load swings or sinks: a smaller --speed";
const OTHER_SIGN: &str = "are valve and encoder of the same sign?";
/// Implausible samples in a row that end the experiment; without a reading it waits at neutral from the same number on.
pub const UNUSABLE_LIMIT: usize = crate::axis::UNUSABLE_LIMIT as usize;

/// Why the experiment was ended. The valve has been neutral since.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Abort {
    /// The caller ended it.
    Stopped,
    /// Samples in a row without a usable position, or one outside the stroke.
    Feedback {
        /// [`sample_fault`] bits of the last one.
        faults: u32,
    },
    /// Outside the window by more than the margin.
    Window {
        /// m.
        position: f64,
        /// Low and high end of the window, m.
        window: (f64, f64),
        /// m.
        margin: f64,
    },
    /// Out of the window by itself.
    Creep {
        /// m.
        position: f64,
        /// Low and high end of the window, m.
        window: (f64, f64),
        /// Speed without a command, m/s.
        speed: f64,
    },
    /// Outside the soft limits before the experiment.
    Start {
        /// m.
        position: f64,
        /// m.
        soft_limits: (f64, f64),
    },
    /// Faster than the speed bound allows.
    Speed {
        /// m/s.
        found: f64,
        /// m/s.
        allowed: f64,
    },
    /// The axis moves against the command, or without one.
    Against {
        /// The largest command that can be at work.
        command: f64,
        /// m.
        moved: f64,
        /// m.
        allowed: f64,
        /// The axis has followed commands of both directions before.
        has_followed: bool,
    },
    /// The position does not change although it should.
    Stuck {
        /// The way that the commands should have made, m.
        owed: f64,
    },
    /// No motion in at least one direction.
    NoMotion {
        /// Whether the axis does not extend; otherwise it does not retract.
        extend: bool,
        /// The highest level that was tried.
        level: f64,
        /// Speed that would have been seen, m/s.
        seen: f64,
    },
    /// The window does not let the axis move fast enough to be seen.
    TooSmall {
        /// Travel of the window, m.
        travel: f64,
        /// The least that is needed, m.
        needed: f64,
    },
    /// The time was over before the random steps could last long enough.
    TooShort {
        /// What the experiment has, s.
        duration: f64,
        /// What has to be left for the random steps, s.
        needed: f64,
    },
}

/// Why the position is not known.
fn feedback(faults: u32) -> String {
    if faults == sample_fault::STALE {
        return "feedback: found no reading for timing.feedback_timeout: does the program that reads the sensor run? \
                `hydraxis doctor` shows whether this computer gives it no time; the experiment waits for readings as \
                long as timing.feedback_timeout says"
            .to_owned();
    }
    let names = bit_names(faults, &sample_fault::NAMES).collect::<Vec<_>>().join(", ");
    format!(
        "feedback: found no usable position ({names}); allowed: fewer than {UNUSABLE_LIMIT} in a row, and none out of \
         range: are the sensor and the keys stroke, max_speed and encoder right?"
    )
}

/// An axis that does not stand.
fn creep(position: f64, (low, high): (f64, f64), speed: f64) -> String {
    format!(
        "position: found {position:.4} m; allowed: {low:.4} to {high:.4} m, which the axis has left by itself: at \
         neutral it goes by {:+.1} mm/s, so its valve is not shut there: a trimmed neutral, a dead band wider than the \
         hysteresis, or less leakage",
        1e3 * speed
    )
}

impl fmt::Display for Abort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Stopped => write!(f, "stopped"),
            Self::Feedback { faults } => write!(f, "{}", feedback(faults)),
            Self::Window { position, window: (low, high), margin } => write!(
                f,
                "position: found {position:.4} m; allowed: {low:.4} to {high:.4} m, and {margin:.4} m beyond: a wider \
                 --travel or a smaller --speed"
            ),
            Self::Creep { position, window, speed } => write!(f, "{}", creep(position, window, speed)),
            Self::Start { position, soft_limits: (low, high) } => write!(
                f,
                "position: found {position:.4} m; allowed: {low:.4} to {high:.4} m, the soft_limits: move the axis \
                 there with `hydraxis operate`, or a simulated one by plant.initial_position"
            ),
            Self::Speed { found, allowed } => write!(
                f,
                "speed: found {found:.4} m/s; allowed: up to {allowed:.4} m/s: a greater --speed, where the axis may \
                 move so fast"
            ),
            Self::Against { command, moved, allowed, has_followed } => write!(
                f,
                "direction: found {:+.1} mm under a command of {command:+.3}; allowed: up to {:.1} mm against the \
                 command: {}",
                1e3 * moved,
                1e3 * allowed,
                if has_followed { SWINGS } else { OTHER_SIGN }
            ),
            Self::Stuck { owed } => write!(
                f,
                "position: found no change where the commands should have made {:.1} mm; allowed: up to {:.1} mm: is \
                 the encoder stuck, or the pump too weak?",
                1e3 * owed,
                1e3 * OWED_DISTANCE
            ),
            Self::NoMotion { extend, level, seen } => write!(
                f,
                "does not {} by {:.1} mm/s or more up to a command of {level:.3}: is the pump on, and \
                 control.command_limit beyond the dead band? A slower axis needs a finer encoder",
                if extend { "extend" } else { "retract" },
                1e3 * seen
            ),
            Self::TooSmall { travel, needed } => {
                write!(
                    f,
                    "window: found {travel:.4} m of travel; allowed: at least {needed:.4} m for a motion that the \
                     encoder shows, and more where the axis reacts later than it has so far: a wider --travel such as \
                     {:.3}, a start nearer to the middle of soft_limits, or a finer encoder",
                    WIDER * needed
                )
            }
            Self::TooShort { duration, needed } => write!(
                f,
                "duration: found {duration:.1} s, of which less than {needed:.1} s are left after the strokes; \
                 allowed: a longer --duration"
            ),
        }
    }
}

impl std::error::Error for Abort {}
