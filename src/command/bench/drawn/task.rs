//! What a drawn machine is driven with.
//!
//! ```text
//! 0 to 8 s     for all tasks: sines that fade in and out, from which the identifiers learn; errors do not count
//! sines        c + a sin(2 pi f t) + (a/3) sin(2 pi 2.7 f t + 1)            f = min(max(0.06/t_r, 0.08 Hz), 0.4 Hz)
//! ramps        straight lines with 1, 1/2 and 1/5 of the speed v, with rests
//! steps        moves of the profile 10 r^3 - 15 r^4 + 6 r^5 that reach v, with rests
//! hold         one such move, then one set point
//! v = 0.3 v_s          v^2 <= 0.15 F s/m          rests of 1.5 s + 2 t_r
//! ```
//!
//! c middle of the soft limits m, a amplitude m, t_r time from a command to its motion s, v largest speed m/s, v_s
//! speed of the slower direction with the valve fully open m/s, F force of the weaker direction N, m mass kg, s way of
//! a move m. So every task leaves two thirds of the speed and most of the force for errors and for what changes.
//!
//! Trap: a task that asks for more than the machine has compares the pump, not the controllers.

use std::f64::consts::TAU;

use control_proc::reference::blend::smooth;

use super::rig::Rig;

/// Time from which on errors count, s. The time before is for the identifiers.
pub const BEGIN: f64 = 8.0;
/// End of sines, ramps and steps, s.
const END: f64 = 36.0;
/// When a hold is watched, s: after every [`super::rig::PlantChange`] and the time to recover from it.
pub const WATCHED: (f64, f64) = (25.0, 85.0);
/// Part of the speed of the fully open valve.
const SPEED_PART: f64 = 0.3;
/// Part of the force of the weaker direction that accelerates the mass.
const FORCE_PART: f64 = 0.15;
/// Part of the travel between the soft limits that a task uses on either side of the middle.
const REACH_PART: f64 = 0.3;
/// Time between points, s. Between points the reference is a straight line.
const SPACING: f64 = 0.01;

/// A task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Two sines.
    Sines,
    /// Straight lines and rests.
    Ramps,
    /// Smooth moves and rests.
    Steps,
    /// One set point.
    Hold,
}

impl Task {
    /// All tasks, in the order of the report.
    pub const ALL: [Self; 4] = [Self::Sines, Self::Ramps, Self::Steps, Self::Hold];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sines => "sines",
            Self::Ramps => "ramps",
            Self::Steps => "steps",
            Self::Hold => "hold",
        }
    }

    /// When it ends, s.
    pub fn end(self) -> f64 {
        if self == Self::Hold { WATCHED.1 } else { END }
    }

    /// Points (s, m) with straight lines between them. The last point is at the position of the first, after the end.
    pub fn points(self, rig: &Rig, (low, high): (f64, f64)) -> Vec<(f64, f64)> {
        let size = Size::new(rig, REACH_PART * (high - low));
        let center = 0.5 * (low + high);
        let training = |t: f64| if self == Self::Sines { t / 2.0 } else { (t / 2.0).min(BEGIN - t) };
        let sines = (0..).map(|i| f64::from(i) * SPACING).map(|t| (t, smooth(training(t)) * size.sines(t)));
        let until = if self == Self::Sines { END } else { BEGIN };
        let mut points: Vec<(f64, f64)> = sines.take_while(|(t, _)| *t <= until + 0.5 * SPACING).collect();
        let moves: &[(f64, f64)] = match self {
            Self::Sines => &[],
            Self::Ramps => &[(1.0, 1.0), (-1.0, 0.5), (0.2, 0.2), (-0.6, 1.0), (0.8, 0.5), (-0.4, 0.2)],
            Self::Steps => &[(0.2, 1.0), (1.0, 1.0), (-0.5, 1.0), (-0.6, 1.0), (0.1, 1.0), (-0.2, 1.0)],
            Self::Hold => &[(0.5, 1.0)],
        };
        let mut moves = moves.iter().cycle();
        while let Some((to, speed)) = moves.next().filter(|_| points[points.len() - 1].0 < END) {
            size.rest(&mut points);
            size.go(&mut points, to * size.reach, speed * size.speed, self == Self::Ramps);
            if self == Self::Hold {
                break;
            }
        }
        // The generator begins again after its last point: that is long after the end of the task.
        let (t, last) = points[points.len() - 1];
        let later = t.max(self.end()) + 10.0;
        points.extend([(later, last), (later + 10.0, points[0].1)]);
        points.into_iter().map(|(t, way)| (t, center + way)).collect()
    }
}

/// How far and how fast a machine is driven.
struct Size {
    /// m.
    reach: f64,
    /// v, m/s.
    speed: f64,
    /// m/s2.
    acceleration: f64,
    /// Time of a rest, s.
    rest: f64,
    /// f, Hz.
    frequency: f64,
    /// a, m.
    amplitude: f64,
}

impl Size {
    fn new(rig: &Rig, reach: f64) -> Self {
        let speed = SPEED_PART * rig.speed;
        let acceleration = FORCE_PART * rig.weaker_force() / rig.mass();
        let frequency = (0.06 / rig.reaction()).clamp(0.08, 0.4);
        let rate = TAU * frequency;
        // Largest value, speed and acceleration of the two sines of amplitude 1.
        let [way, first, second] = [1.0 + 1.0 / 3.0, rate * (1.0 + 0.9), rate * rate * (1.0 + 2.43)];
        let amplitude = (reach / way).min(speed / first).min(acceleration / second);
        Self { reach, speed, acceleration, rest: 1.5 + 2.0 * rig.reaction(), frequency, amplitude }
    }

    fn sines(&self, t: f64) -> f64 {
        let phase = TAU * self.frequency * t;
        self.amplitude * (phase.sin() + (2.7 * phase + 1.0).sin() / 3.0)
    }

    fn rest(&self, points: &mut Vec<(f64, f64)>) {
        let (t, at) = points[points.len() - 1];
        points.push((t + self.rest, at));
    }

    /// A move to `to` m with at most `speed` m/s: a straight line, or a smooth one.
    fn go(&self, points: &mut Vec<(f64, f64)>, to: f64, speed: f64, is_straight: bool) {
        let (begin, from) = points[points.len() - 1];
        let way = (to - from).abs();
        if is_straight {
            points.push((begin + way / speed, to));
            return;
        }
        // Speed and acceleration of the profile are at most 1.875 and 5.774 for a unit of way and time.
        let time = (1.875 * way / speed).max((5.774 * way / self.acceleration).sqrt());
        let count = (time / SPACING).ceil().max(1.0) as usize;
        points.extend((1..=count).map(|i| {
            let part = i as f64 / count as f64;
            (begin + part * time, from + (to - from) * smooth(part))
        }));
    }
}
