//! The commissioned model of an axis, as `hydraxis commission` writes it: `[axis.NAME.commissioned]`.
//!
//! ```text
//! tau dx/dt + x = w(t)    w(t) = min(max(w(t-), u(t - t_d) - h/2), u(t - t_d) + h/2)    v = c(x + sign(x) h/2)
//! c(x) = 0 for -d_r <= x <= d_e, straight lines through the points beyond, the last line going on
//! ```
//!
//! u command and x spool position in [-1, 1], w position that the spool approaches behind the play of its hysteresis h,
//! v speed m/s, t_d dead time s, tau time constant s, d_e and d_r dead bands; points (x - d_e, v) while extending,
//! (-x - d_r, -v) while retracting. The model is a static curve behind a lag and a dead time. It is small, and all of
//! it can be measured on a real machine in a minute. Under a load that overruns it, v is g times as much ([`Overrun`]).
//!
//! Trap: c is the curve of commands that move away from neutral: half of the hysteresis is in the dead bands. On the
//! way back to neutral the same speed needs a command that is nearer to neutral by h.

use std::{f64::consts::TAU, time::Duration};

use super::{dead_band::DeadBand, overrun::Overrun};
use crate::{
    hammerstein::{Basis, InputMap, MAX_DELAY, Structure},
    machine::document::Section,
};

/// The commissioned model of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Commissioned {
    /// t_d, s.
    pub dead_time: f64,
    /// tau, s.
    pub time_constant: f64,
    /// d_e and d_r.
    pub dead_band: DeadBand,
    /// h.
    pub hysteresis: f64,
    /// w / 2 pi, Hz; 0 for a load that does not swing. Its delay, 2 zeta / w, is a part of the time constant.
    pub natural_frequency: f64,
    /// zeta.
    pub damping: f64,
    /// Commands beyond the dead band, rising, of the points of either direction.
    pub openings: Vec<f64>,
    /// Speeds at the openings while extending, m/s, rising.
    pub speeds_extend: Vec<f64>,
    /// Speeds at the openings while retracting, m/s, rising, as magnitudes.
    pub speeds_retract: Vec<f64>,
    /// Largest commands that were tested while extending and while retracting, as magnitudes; infinite where they are
    /// not known: those at the last opening then. The curve beyond them is the line that its bends go on with.
    pub largest_tested: [f64; 2],
    /// Pull of a load from which on it overruns the axis.
    pub overrun: Overrun,
    /// Mass that moved with the axis, kg; infinite where it is not known.
    pub mass: f64,
    /// Standard deviation of the position's noise at rest, m; 0 where it is not known.
    pub noise: f64,
    /// Part of the motion half a second ahead that the model explains, percent: 100 is all of it.
    pub fit_percent: f64,
}

/// How much narrower than the commissioned dead band the one for identification is.
const NARROWER: f64 = 0.01;
/// Knots of the hinges for identification, in parts of the largest tested opening.
const KNOTS: [f64; 3] = [0.0, 0.1, 0.35];

/// Number of points of the curve of [`Commissioned::at_knots`].
pub(super) const POINTS_AT_KNOTS: usize = KNOTS.len();

/// Least usual time constant of the observer of a Smith predictor, s.
const FASTEST_OBSERVER: f64 = 0.06;

/// Part of the commissioned dead band that the fallback compensates. Full compensation of a dead band that is measured
/// too wide, or that has shrunk, would make the loop switch like a relay.
pub const COMPENSATED: f64 = 0.9;

/// Largest number of points of a curve.
pub const MOST_POINTS: usize = 16;

impl Commissioned {
    pub(super) fn read(mut section: Section) -> Option<Self> {
        if !section.is_given() {
            section.finish();
            return None;
        }
        let openings = section
            .key(
                "openings",
                "Commands beyond the dead band at which the static curve has its points, in both directions",
            )
            .allows("1 to 16 rising numbers greater than 0")
            .numbers(0.0..=1.0, "", 1);
        if openings.first().is_none_or(|first| *first <= 0.0)
            || !openings.is_sorted_by(|a, b| a < b)
            || openings.len() > MOST_POINTS
        {
            let allowed = format!("1 to {MOST_POINTS} rising numbers greater than 0");
            section.refuse("openings", format!("{openings:?}"), allowed);
        }
        let speeds_extend =
            read_speeds(&mut section, "speeds_extend", "Speeds at the openings while extending", &openings);
        let speeds_retract = read_speeds(
            &mut section,
            "speeds_retract",
            "Speeds at the openings while retracting, as magnitudes",
            &openings,
        );
        let commissioned = Self {
            dead_time: section.key("dead_time", "Time from command to motion").number(0.0..=5.0, "s"),
            time_constant: section
                .key("time_constant", "Time constant of the first-order lag between command and speed")
                .number(0.0..=10.0, "s"),
            dead_band: read_dead_band(&mut section),
            hysteresis: section
                .key("hysteresis", "Width of the valve's hysteresis, as a part of the full command")
                .number_or(0.0, 0.0..=0.5, ""),
            natural_frequency: section
                .key(
                    "natural_frequency",
                    "Frequency at which the load swings on its spring of oil; 0 where none was found",
                )
                .number_or(0.0, 0.0..=1000.0, "Hz"),
            damping: section.key("damping", "Damping ratio of that swing").number_or(0.2, 0.0..=1.0, ""),
            openings,
            speeds_extend,
            speeds_retract,
            largest_tested: read_largest_tested(&mut section),
            overrun: Overrun::read(&mut section),
            mass: read_mass(&mut section),
            noise: section
                .key("noise", "Standard deviation of the noise of the position at rest; 0 where it is not known")
                .number_or(0.0, 0.0..=0.1, "m"),
            fit_percent: section
                .key("fit_percent", "Part of the motion half a second ahead that the model explains; 100 is all of it")
                .number(-1e9..=100.0, ""),
        };
        commissioned.expect_held_hysteresis(&section);
        section.finish();
        Some(commissioned)
    }

    /// Refuses a hysteresis of which the dead bands do not hold half.
    fn expect_held_hysteresis(&self, section: &Section) {
        let widest = 2.0 * self.dead_band.extend.min(self.dead_band.retract);
        if self.hysteresis > widest {
            let allowed = format!("up to {widest}, twice the narrower dead band, which holds half of the hysteresis");
            section.refuse("hysteresis", self.hysteresis.to_string(), allowed);
        }
    }

    /// nk: the dead time in whole periods, and the period in which the command is sent; [`MAX_DELAY`] at most.
    pub fn delay(&self, period: Duration) -> usize {
        self.unlimited_delay(period).min(MAX_DELAY)
    }

    /// The dead time in whole periods, and the period in which the command is sent.
    pub(super) fn unlimited_delay(&self, period: Duration) -> usize {
        // The small part keeps a dead time of whole periods from counting one period more by rounding.
        (self.dead_time / period.as_secs_f64() - 1e-6).ceil() as usize + 1
    }

    /// Dead band for identification, retracting and extending: the commissioned one less 0.01.
    ///
    /// A dead band that is a little too narrow costs one more bend of the curve; one that is too wide hides commands
    /// that move the axis.
    pub fn identified_dead_band(&self) -> (f64, f64) {
        let narrower = |dead_band: f64| (dead_band - NARROWER).max(0.0);
        (narrower(self.dead_band.retract), narrower(self.dead_band.extend))
    }

    /// Dead band that the fallback compensates: [`COMPENSATED`] times the commissioned one.
    pub fn compensated_dead_band(&self) -> DeadBand {
        DeadBand { extend: COMPENSATED * self.dead_band.extend, retract: COMPENSATED * self.dead_band.retract }
    }

    /// The structure to identify every `period`: nk, the dead band, and hinges where the curve bends are those of this
    /// model, all else is that of `structure`.
    pub fn structure(&self, structure: Structure, period: Duration) -> Structure {
        let last = self.openings.last().copied().unwrap_or(1.0);
        let knots = KNOTS.map(|part| part * last);
        let basis = Basis::hinges(&knots).unwrap_or(Basis::Powers);
        let input = InputMap { dead_band: self.identified_dead_band(), basis };
        Structure { nk: self.delay(period), order: knots.len(), input, ..structure }
    }

    /// The curve at the knots that [`Self::structure`] gives to identification, as the same axis with few points.
    pub fn at_knots(&self) -> Self {
        let last = self.openings.last().copied().unwrap_or(1.0);
        let (retract, extend) = self.identified_dead_band();
        let openings: Vec<f64> = KNOTS[1..].iter().map(|part| part * last).chain([last]).collect();
        let speeds = |sign: f64, edge: f64| openings.iter().map(|x| sign * self.speed(sign * (edge + x))).collect();
        Self {
            speeds_extend: speeds(1.0, extend),
            speeds_retract: speeds(-1.0, retract),
            dead_band: DeadBand { extend, retract },
            openings,
            ..self.clone()
        }
    }

    /// Usual time constant of the observer of a Smith predictor, s; `period` in s. The load on its spring of oil, some
    /// 5 Hz, needs 60 ms.
    pub fn observer_time(&self, period: f64) -> f64 {
        (self.reaction() + 0.5 * period).max(FASTEST_OBSERVER)
    }

    /// t_d + tau, s: time from a command to most of its motion.
    pub fn reaction(&self) -> f64 {
        self.dead_time + self.time_constant
    }

    /// 2 zeta / w, s: time by which a swing of the load lags behind at low frequencies; 0 without a swing.
    pub fn swing_delay(&self) -> f64 {
        let w = TAU * self.natural_frequency;
        if w > 0.0 { 2.0 * self.damping / w } else { 0.0 }
    }

    /// This axis with a controller that makes the damping ratio of its swing greater by `more` (zeta_p), by a speed
    /// that opposes the acceleration of the load: zeta + zeta_p cos(w (t_d + tau_v)), with its delay in the time
    /// constant; tau_v is tau less the swing's own delay. As it is without a swing.
    pub fn damped(&self, more: f64) -> Self {
        let w = TAU * self.natural_frequency;
        let late = w * (self.reaction() - self.swing_delay()).max(0.0);
        let mut damped = Self { damping: self.damping + more * late.cos().max(0.0), ..self.clone() };
        damped.time_constant += damped.swing_delay() - self.swing_delay();
        damped
    }

    /// 2 zeta_p / (w m), m/(s N): speed that opposes a newton of the load's swing, so that its damping ratio is greater
    /// by `more` (zeta_p).
    pub fn opposing_speed(&self, more: f64) -> f64 {
        2.0 * more / (TAU * self.natural_frequency * self.mass)
    }

    /// Period of the swing of the load, s; 0 without a swing.
    pub fn swing_period(&self) -> f64 {
        if self.natural_frequency > 0.0 { 1.0 / self.natural_frequency } else { 0.0 }
    }

    /// c(x), m/s.
    pub fn speed(&self, x: f64) -> f64 {
        if x > self.dead_band.extend {
            interpolate(&self.openings, &self.speeds_extend, x - self.dead_band.extend)
        } else if x < -self.dead_band.retract {
            -interpolate(&self.openings, &self.speeds_retract, -x - self.dead_band.retract)
        } else {
            0.0
        }
    }

    /// The speed that the axis reaches both ways with commands up to `limit`, m/s.
    pub fn reached(&self, limit: f64) -> f64 {
        let (retract, extend) = self.tested_speeds(limit);
        retract.min(extend)
    }

    /// Speed of a spool at position x, m/s: c(x + h/2) or c(x - h/2), as half of the hysteresis is in the dead bands.
    pub fn spool_speed(&self, x: f64) -> f64 {
        self.speed(x + (0.5 * self.hysteresis).copysign(x))
    }

    /// Lowest and highest command at which the curve was measured.
    pub fn tested(&self) -> (f64, f64) {
        let last = self.openings.last().copied().unwrap_or_default();
        let [extend, retract] = self.largest_tested;
        (-retract.min(self.dead_band.retract + last), extend.min(self.dead_band.extend + last))
    }

    /// Largest speeds while retracting, as a magnitude, and extending, m/s, with commands up to `limit`: at most those
    /// that were measured.
    pub fn tested_speeds(&self, limit: f64) -> (f64, f64) {
        let (low, high) = self.tested();
        (-self.speed(low.max(-limit)), self.speed(high.min(limit)))
    }

    /// The command whose steady speed is `speed` m/s; 0 for a speed of 0.
    pub fn command(&self, speed: f64) -> f64 {
        if speed > 0.0 {
            self.dead_band.extend + interpolate(&self.speeds_extend, &self.openings, speed)
        } else if speed < 0.0 {
            -self.dead_band.retract - interpolate(&self.speeds_retract, &self.openings, -speed)
        } else {
            0.0
        }
    }
}

fn read_dead_band(section: &mut Section) -> DeadBand {
    let mut key = |name, meaning| section.key(name, meaning).number(0.0..=0.9, "");
    DeadBand {
        extend: key("dead_band_extend", "Dead band of the valve while extending"),
        retract: key("dead_band_retract", "Dead band of the valve while retracting, as a magnitude"),
    }
}

fn read_largest_tested(section: &mut Section) -> [f64; 2] {
    let mut key = |name, meaning| {
        let key = section.key(name, meaning).rule("dead band and the last opening");
        key.optional_number(0.0..=1.0, "").unwrap_or(f64::INFINITY)
    };
    [
        key("tested_extend", "Largest command that was tested while extending"),
        key("tested_retract", "Largest command that was tested while retracting, as a magnitude"),
    ]
}

fn read_mass(section: &mut Section) -> f64 {
    let key = section.key("mass", "Mean mass that moved with the axis, by the mechanism").rule("none");
    key.optional_number(0.0..=1e9, "kg").unwrap_or(f64::INFINITY)
}

/// The speeds of one direction, which must rise and be as many as the openings.
fn read_speeds(section: &mut Section, key: &str, meaning: &'static str, openings: &[f64]) -> Vec<f64> {
    let speeds = section
        .key(key, meaning)
        .allows("as many rising numbers greater than 0 as there are openings")
        .numbers(0.0..=1000.0, "m/s", 1);
    if speeds.len() != openings.len()
        || !speeds.is_sorted_by(|a, b| a < b)
        || speeds.first().is_none_or(|first| *first <= 0.0)
    {
        let allowed = format!("{} rising numbers greater than 0, one for each opening", openings.len());
        section.refuse(key, format!("{speeds:?}"), allowed);
    }
    speeds
}

/// Value at `at` > 0 of the line from (0, 0) through the points (x, y); its last piece goes on beyond them.
fn interpolate(x: &[f64], y: &[f64], at: f64) -> f64 {
    let piece = x.partition_point(|x| *x < at).min(x.len() - 1);
    let (x_0, y_0) = piece.checked_sub(1).map_or((0.0, 0.0), |before| (x[before], y[before]));
    y_0 + (y[piece] - y_0) * (at - x_0) / (x[piece] - x_0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Commissioned {
        Commissioned {
            dead_time: 0.15,
            time_constant: 0.05,
            dead_band: DeadBand { extend: 0.1, retract: 0.08 },
            hysteresis: 0.0,
            natural_frequency: 0.0,
            damping: 0.2,
            openings: vec![0.1, 0.3],
            speeds_extend: vec![0.05, 0.25],
            speeds_retract: vec![0.04, 0.3],
            largest_tested: [f64::INFINITY; 2],
            overrun: Overrun::NONE,
            mass: f64::INFINITY,
            noise: 0.0,
            fit_percent: 97.0,
        }
    }

    #[test]
    fn the_curve_is_zero_in_the_dead_band_and_straight_between_its_points() {
        for (x, v) in [(0.0, 0.0), (0.1, 0.0), (-0.08, 0.0), (0.15, 0.025), (0.2, 0.05), (0.3, 0.15), (-0.38, -0.3)] {
            assert!((model().speed(x) - v).abs() < 1e-12, "{x}: {}", model().speed(x));
        }
        // Beyond the last point the last line goes on.
        assert!((model().speed(0.6) - 0.45).abs() < 1e-12);
    }

    /// Retracting reached the bound of the experiment's speed at a smaller command.
    #[test]
    fn speeds_of_commands_that_were_not_tested_are_not_reached() {
        let known = Commissioned { largest_tested: [0.35, 0.18], ..model() };
        assert_eq!((model().tested(), known.tested()), ((-0.38, 0.4), (-0.18, 0.35)));
        let close = |found: (f64, f64), wanted: (f64, f64)| {
            assert!((found.0 - wanted.0).abs() < 1e-12 && (found.1 - wanted.1).abs() < 1e-12, "{found:?}");
        };
        close(model().tested_speeds(1.0), (0.3, 0.25));
        close(known.tested_speeds(1.0), (0.04, 0.2));
        close(known.tested_speeds(0.3), (0.04, 0.15));
        assert!((known.reached(1.0) - 0.04).abs() < 1e-12 && (model().reached(1.0) - 0.25).abs() < 1e-12);
        // The line goes on: a command for such a speed is not larger than it has to be.
        assert_eq!(known.command(-0.2), model().command(-0.2));
    }

    #[test]
    fn the_command_is_the_curves_inverse() {
        assert_eq!(model().command(0.0), 0.0);
        for v in [-0.5, -0.3, -0.01, 1e-6, 0.02, 0.05, 0.2, 0.4] {
            assert!((model().speed(model().command(v)) - v).abs() < 1e-12, "{v}");
        }
    }
}
