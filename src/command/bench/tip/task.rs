//! The six tasks of `hydraxis bench tip`, for the built-in excavator.

use clap::ValueEnum;
use pipeline::machine::{TipFree, TipPiece, TipShape, TipTask, TipWithout};

/// A task of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TipTaskKind {
    /// level cut, telescope still
    LevelStill,
    /// level cut
    Level,
    /// slope that falls towards the machine
    SlopeIn,
    /// slope that rises towards the machine
    SlopeOut,
    /// circle
    Circle,
    /// dig cycle
    Dig,
}

impl TipTaskKind {
    /// All tasks, in the order of the report.
    pub const ALL: [Self; 6] = [Self::LevelStill, Self::Level, Self::SlopeIn, Self::SlopeOut, Self::Circle, Self::Dig];

    /// The name as a user types it.
    pub fn name(self) -> &'static str {
        match self {
            Self::LevelStill => "level-still",
            Self::Level => "level",
            Self::SlopeIn => "slope-in",
            Self::SlopeOut => "slope-out",
            Self::Circle => "circle",
            Self::Dig => "dig",
        }
    }

    /// The task at this speed of the teeth, m/s.
    pub fn task(self, speed: f64) -> TipTask {
        let line = |x: f64, z: f64| TipPiece { shape: TipShape::Line([x, z]), pitch: None, free: None };
        let (start, pitch, pieces) = match self {
            Self::LevelStill | Self::Level => ([7.2, 0.0], -115.0, vec![line(3.7, 0.0)]),
            Self::SlopeIn => ([7.25, 0.2], -115.0, vec![line(4.22, -1.55)]),
            Self::SlopeOut => ([7.5, -0.5], -110.0, vec![line(4.47, 1.25)]),
            Self::Circle => {
                let shape = TipShape::Arc { center: [6.0, -0.5], angle: -360.0 };
                ([7.0, -0.5], -115.0, vec![TipPiece { shape, pitch: None, free: None }])
            }
            Self::Dig => {
                let turned = |x: f64, z: f64, pitch: f64| TipPiece { pitch: Some(pitch), ..line(x, z) };
                let pieces = vec![
                    line(7.0, -0.2),
                    line(4.8, -0.2),
                    turned(4.8, 0.3, -150.0),
                    line(5.0, 1.5),
                    turned(7.0, 1.5, -100.0),
                    turned(7.0, 0.5, -110.0),
                ];
                ([7.0, 0.5], -110.0, pieces)
            }
        };
        let free = (self == Self::LevelStill).then_some(TipFree::Telescope(0.6));
        let without = TipWithout::default();
        TipTask { start, pitch, speed, free, rounding: 0.0, file: None, pieces, without }
    }
}
