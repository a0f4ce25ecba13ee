//! The classes of generated records: what is special about each of them.

use serde::Serialize;

/// A class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// The plant does not change.
    Constant,
    /// Periods of 1 to 5 ms.
    Fast,
    /// Periods of 0.1 to 1 s, and a plant that is slower by as much.
    Slow,
    /// The gain changes slowly by up to 40 %.
    WarmUp,
    /// A load comes on and goes again: gains by direction, natural frequency and sinking change within 0.2 s.
    Payload,
    /// The dead time changes to 0.4 to 2.5 times its length.
    Delay,
    /// The valve has a play of 2 to 10 % of the full command.
    Play,
    /// The encoder has 150 to 1000 counts on the stroke.
    Quantised,
    /// The output reads a constant for runs of up to 12 samples.
    Dropouts,
    /// Single samples lie far off.
    Spikes,
    /// The axis rests for 2 to 20 s again and again, from the start on.
    Rest,
    /// An axis without limits that turns in one direction only after the training.
    OneSided,
    /// A controller follows a smooth reference; nothing else moves the valve.
    Feedback,
    /// The valve saturates, and the piston reaches its end stops.
    Saturation,
    /// The axis sinks under a load that changes slowly with time and position.
    Drift,
    /// The output is in mm, degrees, volts or counts, and the command may be in volts or percent.
    Units,
    /// The encoder is set to another zero now and then.
    Offsets,
}

impl Class {
    /// All classes. Trap: a record's class follows from its number and this order.
    pub const ALL: [Self; 17] = [
        Self::Constant,
        Self::Fast,
        Self::Slow,
        Self::WarmUp,
        Self::Payload,
        Self::Delay,
        Self::Play,
        Self::Quantised,
        Self::Dropouts,
        Self::Spikes,
        Self::Rest,
        Self::OneSided,
        Self::Feedback,
        Self::Saturation,
        Self::Drift,
        Self::Units,
        Self::Offsets,
    ];

    /// The class of a record. Both halves of a set have all classes equally often.
    pub fn of(number: u64) -> Self {
        Self::ALL[(number / 2 % Self::ALL.len() as u64) as usize]
    }

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Fast => "fast",
            Self::Slow => "slow",
            Self::WarmUp => "warm-up",
            Self::Payload => "payload",
            Self::Delay => "delay",
            Self::Play => "play",
            Self::Quantised => "quantised",
            Self::Dropouts => "dropouts",
            Self::Spikes => "spikes",
            Self::Rest => "rest",
            Self::OneSided => "one-sided",
            Self::Feedback => "feedback",
            Self::Saturation => "saturation",
            Self::Drift => "drift",
            Self::Units => "units",
            Self::Offsets => "offsets",
        }
    }
}
