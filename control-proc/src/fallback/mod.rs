//! The fallback: PI controller with dead-band compensation, and velocity feed-forward where the axis is commissioned.
//!
//! | module | what it holds |
//! |---|---|
//! | [`feedforward`] | the command of a motion that the preview shows |
//! | [`hysteresis`] | the inverse of the valve's hysteresis |
//! | [`pressure`] | damping of the load by the chamber pressures |
//!
//! ```text
//! e(k) = y_r(k) - y(k)          v(k) = kp e(k)/q + I(k) + v_r(k) + a L(k)        I(k+1) = I(k) + p ki T e(k)/q
//! u(k) = H(C(v - v_p), a)       C(v) = v + d(v) min(|v| / w, 1)    d(v) = +d_extend for v > 0, -d_retract for v < 0
//! v_r  = C^-1(u_r)                          0 without feed-forward
//! q    = max(1, g c'(u_r)/(r c'_m)) / p      1 / p at rest and without feed-forward
//! L(k+1) = L(k) + a kp e(k) T/(q T_l)  |L| <= L_max      a = min(|v_r| / w, 1)      T_l = 24 (t_d + tau + T)
//! ```
//!
//! e following error in m, v opening beyond the dead band, kp in 1/m, ki in 1/(m s), T period in s, d calibrated dead
//! band, w [`BLEND_WIDTH`], H the inverse of the [`hysteresis`] that was commissioned, u_r the command of
//! [`feedforward`]; H(u, a) = u without feed-forward. The fallback needs no identified model: it controls while the
//! identifier is trained, and takes over whenever the model may not be used. Source: the usual loop of mobile
//! hydraulics.
//!
//! I is one of three: at rest, where u_r is 0, extending, and retracting. What an axis needed against its dead band at
//! rest is wrong in the motion that follows, and what a motion needed pushes the axis on when it stands. One that is
//! not in use fades with its own time, kp/ki. v_p is what the [`pressure`] feedback takes off, |v_p| <= |v|.
//!
//! L is what the feed-forward lacks, one number for each direction: a commissioned curve is least exact where it
//! begins, and dead bands drift. It is learned while the reference moves and acts only then, so that at rest, where an
//! integral makes an axis with a dead band cycle, the loop is the one without it. T_l is so long that the margins of
//! the loop hardly change; L_max is [`MOST_LEARNED`]. Nothing is learned on the way to a reference that starts
//! elsewhere, nor do the I of motion change there: all axes of a machine go there at once, and what the pump cannot
//! give them then is no lack of a curve.
//!
//! q keeps the margins of the loop while the axis moves: they hold for the mean slope c'_m of the static curve c, and
//! the curve of a pilot-operated valve is an S, in its middle much steeper. r is [`SPARED`]: of a straight curve with
//! two speeds the faster direction keeps its gains. g is by how much the load makes the axis faster, and p the part of
//! the gains that it leaves ([`Load`]); ki has p twice, so that the loop of a smaller kp has the same damping.
//!
//! Feedback and feed-forward are added as openings, so the dead band is jumped once, by their sum. Without an error the
//! command is exactly u_r. But for q the gains have the same meaning with and without feed-forward.
//!
//! After another controller, v goes on from the value that this controller had and comes to the fallback's own value
//! within some tenths of a second. Trap: the usual bumpless transfer puts the difference into the integral. The
//! integral would then keep for seconds what the other controller did at one moment, even if that was its largest
//! error.
//!
//! Traps: a jump over the whole dead band at v = 0 chatters with every count of noise, so it is blended in where v is
//! smaller than w. The calibrated dead band must not exceed the valve's: too much compensation acts as a relay, and a
//! relay cycles. The integral stops while the limits cut the command off and the error would only push further.
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod feedforward;
pub mod hysteresis;
pub mod pressure;

use pipeline::machine::{Commissioned, Control, DeadBand};

use feedforward::{Coming, Feedforward};
use hysteresis::Hysteresis;
use pressure::Damping;

use crate::{load::Load, margins::mean_slope, protection::limits::Limits};

/// Magnitude of v (command) below which the dead band is compensated only in part. With a kp of 4 1/m this is an error
/// of 2.5 mm: some tens of encoder counts, and so well above the noise.
pub const BLEND_WIDTH: f64 = 0.01;

/// T_l by the reaction of the axis and a period.
const LEARNING: f64 = 24.0;
/// L_max, an opening.
pub const MOST_LEARNED: f64 = 0.1;

/// r: the part of the gain margin that a steep place of the curve may take.
pub const SPARED: f64 = 1.3;

/// Time in which the difference to the last controller falls to a third, s.
pub const HANDOVER: f64 = 0.2;

/// What the controller remembers from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory {
    hysteresis: Hysteresis,
    /// I at rest, of extending and of retracting.
    integrals: [f64; 3],
    /// What is left in v of the difference to the last controller.
    offset: f64,
    /// L of extending and of retracting.
    learned: [f64; 2],
}

/// The fallback controller of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Fallback {
    kp: f64,
    /// ki T, 1/m.
    ki_period: f64,
    learning: Learning,
    dead_band: DeadBand,
    /// Part of kp and ki that is in use.
    gain: f64,
    limits: Limits,
    feedforward: Option<Feedforward>,
    memory: Memory,
    load: Load,
    damping: Damping,
    /// c'_m, m/s; infinite where it is not known.
    slope: f64,
    kept: Kept,
}

/// How what the feed-forward lacks is learned.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Learning {
    /// kp T/T_l, 1/m; 0 without feed-forward, and in a comparison without learning.
    rate: f64,
    /// Whether L and the I of motion change.
    is_on: bool,
}

/// Parts that are left a tick later.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Kept {
    /// Of the difference to the last controller.
    offset: f64,
    /// Of an I that is not in use.
    idle: f64,
}

impl Fallback {
    /// Gains and dead band from the machine file; feed-forward by `commissioned` if the file asks for it; `period` in
    /// s.
    pub fn new(control: &Control, commissioned: Option<&Commissioned>, period: f64) -> Self {
        let damping = control.damping_in_use();
        let model = commissioned.filter(|_| control.feedforward).map(|model| model.damped(damping));
        let model = model.as_ref();
        let learning = model.filter(|_| !control.without.learning);
        let hysteresis = model.filter(|_| !control.without.hysteresis);
        Self {
            kp: control.kp,
            ki_period: control.ki * period,
            learning: Learning {
                rate: learning.map_or(0.0, |model| control.kp * period / learning_time(model, period)),
                is_on: true,
            },
            gain: 1.0,
            dead_band: control.dead_band,
            limits: Limits::new(control, period),
            feedforward: model.map(|model| Feedforward::new(model, control.pump_response, period)),
            memory: Memory {
                hysteresis: Hysteresis::new(hysteresis.map_or(0.0, |model| model.hysteresis)),
                integrals: [0.0; 3],
                offset: 0.0,
                learned: [0.0; 2],
            },
            load: Load::USUAL,
            damping: Damping::NONE,
            slope: commissioned.map_or(f64::INFINITY, mean_slope),
            kept: Kept {
                offset: (-period / HANDOVER).exp(),
                idle: if control.kp > 0.0 { (-control.ki * period / control.kp).exp() } else { 0.0 },
            },
        }
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.feedforward.as_ref().map_or(0, Feedforward::ahead)
    }

    /// Changes the largest magnitude of a command.
    pub fn limit(&mut self, magnitude: f64) {
        self.limits.magnitude = magnitude;
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.load = load;
    }

    /// The pressures change this from now on.
    pub fn damp(&mut self, damping: Damping) {
        self.damping = damping;
    }

    /// Uses this part of kp and ki from now on. The command does not jump by more than the change of kp e.
    pub fn scale(&mut self, gain: f64) {
        self.gain = gain;
    }

    /// Whether L and the I of motion change from now on.
    pub fn learn(&mut self, learns: bool) {
        self.learning.is_on = learns;
    }

    /// What is remembered.
    pub fn memory(&self) -> Memory {
        self.memory
    }

    /// Puts back what was remembered earlier: the commands since then were not sent.
    pub fn restore(&mut self, memory: Memory) {
        self.memory = memory;
    }

    /// Forgets the integral and what was learned: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.memory.integrals, self.memory.offset, self.memory.learned) = ([0.0; 3], 0.0, [0.0; 2]);
        self.memory.hysteresis.reset();
    }

    /// What the feed-forward makes of these references (m, from this tick on); none without feed-forward.
    pub fn coming(&self, references: &[f64]) -> Option<Coming> {
        self.feedforward.as_ref().map(|feedforward| feedforward.coming(references, &self.load))
    }

    /// u_r for these references (m, from this tick on); 0 without feed-forward.
    pub fn forward(&self, references: &[f64]) -> f64 {
        self.coming(references).map_or(0.0, |coming| coming.command)
    }

    /// Takes over from another controller that sent `last`, at a following error of `error` m. The next command for
    /// this error and this u_r is `last` again; its difference to the fallback's own fades.
    pub fn resume(&mut self, last: f64, error: f64, forward: f64) {
        self.memory.hysteresis.reset();
        self.memory.offset = self.uncompensated(last)
            - self.gain_at(forward) * self.kp * error
            - self.coming_opening(forward)
            - self.memory.integrals[phase(forward)];
    }

    /// Another controller has sent `last` at a following error of `error` m: the integral comes to what it would have
    /// to be for that, within its own time kp/ki.
    pub fn track(&mut self, last: f64, error: f64, forward: f64) {
        let part = 1.0 - (-self.ki_period / self.kp).exp();
        let needed = self.uncompensated(last) - self.gain_at(forward) * self.kp * error - self.coming_opening(forward);
        if part.is_finite() {
            let integral = self.memory.integrals[phase(forward)];
            self.memory.integrals[phase(forward)] = self.bounded(integral + part * (needed - integral));
        }
    }

    /// The command for a following error of `error` m and `forward` as u_r, after the command `last`, within the
    /// limits.
    pub fn update(&mut self, error: f64, forward: f64, last: f64) -> f64 {
        let (part, steepness) = (self.part(forward), self.steepness(forward));
        let gain = part / steepness;
        let proportional = gain * self.kp * error;
        let now = phase(forward);
        let integral = self.memory.integrals[now];
        let opening = proportional + integral + self.memory.offset + self.coming_opening(forward);
        let opening = opening - self.damped(opening, now, steepness);
        let (_, side, moving) = self.moving(forward);
        let wanted = self.memory.hysteresis.update(self.compensated(opening), moving);
        self.memory.offset *= self.kept.offset;
        for idle in (0..3).filter(|phase| *phase != now) {
            self.memory.integrals[idle] *= self.kept.idle;
        }
        let command = self.limits.apply(wanted, last);
        if (wanted - command) * error <= 0.0 {
            if self.learning.is_on || now == 0 {
                self.memory.integrals[now] = self.bounded(integral + part * gain * self.ki_period * error);
            }
            if self.learning.is_on {
                let learned = self.memory.learned[side] + moving * gain * self.learning.rate * error;
                self.memory.learned[side] = learned.clamp(-MOST_LEARNED, MOST_LEARNED);
            }
        }
        command
    }

    /// The part of kp and ki that is in use at this u_r: 1/q of what is asked for.
    fn gain_at(&self, forward: f64) -> f64 {
        self.part(forward) / self.steepness(forward)
    }

    /// p.
    fn part(&self, forward: f64) -> f64 {
        self.load.gain[phase(forward)] * self.damping.gain * self.gain
    }

    /// max(1, g c'/(r c'_m)) of this u_r.
    fn steepness(&self, forward: f64) -> f64 {
        let moving = self.feedforward.as_ref().filter(|_| forward != 0.0);
        let steepness = moving.map_or(1.0, |of| of.steepness(forward) * self.load.faster(forward));
        (steepness / SPARED).max(1.0)
    }

    /// What the pressures take off an opening: never more than the opening, so they do not move an axis. An
    /// opening that is no number stays none, and the limits make it neutral. Trap: `clamp` would panic there.
    fn damped(&self, opening: f64, phase: usize, steepness: f64) -> f64 {
        let speed = self.load.damping[phase] * self.damping.speed;
        (speed / (steepness * self.slope)).max(-opening.abs()).min(opening.abs())
    }

    /// v_r + a L of this u_r.
    fn coming_opening(&self, forward: f64) -> f64 {
        let (opening, side, part) = self.moving(forward);
        opening + part * self.memory.learned[side]
    }

    /// v_r of this u_r, its direction as an index, and a.
    fn moving(&self, forward: f64) -> (f64, usize, f64) {
        let opening = self.uncompensated(forward);
        (opening, usize::from(opening < 0.0), (opening.abs() / BLEND_WIDTH).min(1.0))
    }

    /// C(v).
    fn compensated(&self, v: f64) -> f64 {
        v + self.dead_band(v) * (v.abs() / BLEND_WIDTH).min(1.0)
    }

    /// C^-1(u).
    fn uncompensated(&self, u: f64) -> f64 {
        let dead_band = self.dead_band(u);
        if u.abs() < BLEND_WIDTH + dead_band.abs() {
            u * BLEND_WIDTH / (BLEND_WIDTH + dead_band.abs())
        } else {
            u - dead_band
        }
    }

    fn dead_band(&self, direction: f64) -> f64 {
        if direction >= 0.0 { self.dead_band.extend } else { -self.dead_band.retract }
    }

    /// The integral within the openings of the largest commands: more would only have to be unwound.
    fn bounded(&self, integral: f64) -> f64 {
        let (low, high) = self.limits.range();
        integral.max(self.uncompensated(low)).min(self.uncompensated(high))
    }
}

/// Place of the I that is in use at this u_r.
fn phase(forward: f64) -> usize {
    if forward == 0.0 { 0 } else { 1 + usize::from(forward < 0.0) }
}

/// T_l of an axis with this model, s; `period` in s.
pub fn learning_time(model: &Commissioned, period: f64) -> f64 {
    LEARNING * (model.reaction() + period)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;
    use pipeline::machine::FallbackWithout;
    use proptest::prelude::*;

    fn fallback() -> Fallback {
        Fallback::new(&crate::tests::machine(1).axes[0].control, None, 0.01)
    }

    #[test]
    fn the_command_is_proportional_and_integral_beyond_the_dead_band() {
        let mut fallback = fallback();
        // kp 4, ki 1, dead band 0.08 and 0.07. The last command is so near that the rate limit does not act.
        assert!((fallback.update(0.05, 0.0, 0.28) - (0.2 + 0.08)).abs() < 1e-12);
        assert!((fallback.update(0.05, 0.0, 0.28) - (0.2 + 0.0005 + 0.08)).abs() < 1e-12);
        fallback.reset();
        assert!((fallback.update(-0.05, 0.0, -0.27) - (-0.2 - 0.07)).abs() < 1e-12);
        fallback.reset();
        // Inside the blend, v = 0.004 adds 0.4 of the dead band.
        assert!((fallback.update(0.001, 0.0, 0.0) - (0.004 + 0.4 * 0.08)).abs() < 1e-12);
    }

    #[test]
    fn scaled_gains_scale_the_command_beyond_the_dead_band() {
        let (mut whole, mut half) = (fallback(), fallback());
        half.scale(0.5);
        assert!((half.update(0.05, 0.0, 0.18) - (0.1 + 0.08)).abs() < 1e-12);
        assert!((half.update(0.05, 0.0, 0.18) - (0.1 + 0.000125 + 0.08)).abs() < 1e-12);
        half.reset();
        half.scale(1.0);
        assert_eq!(half, whole);
        assert_eq!(half.update(0.013, 0.0, 0.1), whole.update(0.013, 0.0, 0.1));
    }

    #[test]
    fn a_part_of_the_gains_leaves_dead_band_and_feed_forward_as_they_are() {
        let mut fallback = fallback();
        fallback.scale(0.25);
        assert!((fallback.update(0.1, 0.0, 0.18) - (0.25 * 0.4 + 0.08)).abs() < 1e-12);
        assert!((fallback.memory.integrals[0] - 0.25 * 0.25 * 0.001).abs() < 1e-12, "so that its poles stay equal");
    }

    #[test]
    fn without_an_error_the_command_is_the_feed_forward() {
        let with = Control { feedforward: true, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let mut fallback = Fallback::new(&with, Some(&commissioned()), 0.01);
        for speed in [0.3, 0.005, -0.002, -0.2] {
            let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| speed * 0.01 * k as f64).collect();
            let command = fallback.update(0.0, fallback.forward(&targets), 0.0);
            assert!((commissioned().speed(command) - speed).abs() < 1e-9, "{speed}: {command}");
        }
    }

    /// A load pulls the axis twice as fast as its curve says while it extends, and it swings at half the gain.
    #[test]
    fn under_a_load_the_commands_of_a_motion_are_smaller_and_so_are_the_gains() {
        let with = Control { feedforward: true, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let model = commissioned();
        let targets: Vec<f64> = (0..60).map(|k| 0.2 * 0.01 * f64::from(k)).collect();
        let command = |load: Load, error: f64| {
            let mut fallback = Fallback::new(&with, Some(&model), 0.01);
            fallback.bear(load);
            fallback.update(error, fallback.forward(&targets), 0.0)
        };
        let loads = [
            Load::USUAL,
            Load { faster: [2.0, 1.0], ..Load::USUAL },
            Load { faster: [1.0, 2.0], gain: [0.5; 3], ..Load::USUAL },
        ];
        let speeds = loads.map(|load| model.speed(command(load, 0.0)));
        for (speed, expected) in speeds.into_iter().zip([0.2, 0.1, 0.2]) {
            assert!((speed - expected).abs() < 1e-9, "{speeds:?}");
        }
        let slopes = loads.map(|load| command(load, 0.01) - command(load, 0.0));
        assert!(slopes[1] < 0.9 * slopes[0] && (slopes[2] / slopes[0] - 0.5).abs() < 1e-9, "{slopes:?}");
    }

    #[test]
    fn pressures_change_an_opening_by_itself_at_most_and_move_no_axis() {
        let with = Control { command_rate: 1e4, ki: 0.0, ..crate::tests::machine(1).axes[0].control };
        let command = |speed: f64, error: f64| {
            let mut fallback = Fallback::new(&with, Some(&commissioned()), 0.01);
            fallback.damp(Damping { speed, gain: 1.0 });
            fallback.update(error, 0.0, 0.0)
        };
        // kp 4, dead band 0.08; the curve has a mean slope of 1 m/s.
        let slope = mean_slope(&commissioned());
        assert!((command(0.05 * slope, 0.05) - (0.15 + 0.08)).abs() < 1e-12);
        assert!((command(-0.05 * slope, 0.05) - (0.25 + 0.08)).abs() < 1e-12);
        for swing in [-10.0, 10.0] {
            assert_eq!(command(swing, 0.0), 0.0);
        }
        assert_eq!(command(10.0, 0.05), 0.0);
        assert!((command(-10.0, 0.05) - (0.4 + 0.08)).abs() < 1e-12);
        assert_eq!(command(-10.0, -0.05), 0.0);
    }

    #[test]
    fn errors_beyond_all_numbers_make_the_valve_neutral_until_a_reset() {
        let mut fallback = fallback();
        fallback.resume(0.0, 1e308, 0.0);
        assert_eq!([1e308, -1e308, 0.01].map(|error| fallback.update(error, 0.0, 0.0)), [0.0; 3]);
        fallback.reset();
        assert!(fallback.update(0.01, 0.0, 0.0) > 0.0);
    }

    /// A long error at rest asks for the other direction than the motion that follows.
    #[test]
    fn what_was_needed_at_rest_does_not_act_in_motion_and_fades_there() {
        let with = Control { feedforward: true, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let mut fallback = Fallback::new(&with, Some(&commissioned()), 0.01);
        for _ in 0..300 {
            fallback.update(-0.01, 0.0, -0.2);
        }
        assert!((fallback.memory.integrals[0] + 0.03).abs() < 1e-9, "{:?}", fallback.memory);
        let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| 1e-3 * k as f64).collect();
        let forward = fallback.forward(&targets);
        assert!((fallback.update(0.0, forward, forward) - forward).abs() < 1e-12);
        // ki/kp is 0.25 1/s: after 4 s a third is left.
        for _ in 1..400 {
            fallback.update(0.0, forward, forward);
        }
        assert!((fallback.memory.integrals[0] + 0.03 * (-1.0f64).exp()).abs() < 1e-4, "{:?}", fallback.memory);
    }

    /// The valve needs 0.04 more than its model says to extend, and 0.02 less to retract.
    #[test]
    fn what_the_feed_forward_lacks_is_learned_in_motion_for_each_direction() {
        let with = Control { feedforward: true, ki: 0.0, ..crate::tests::machine(1).axes[0].control };
        let model = commissioned();
        let mut fallback = Fallback::new(&with, Some(&model), 0.01);
        let (turn, lead) = (600, (model.reaction() / 0.01) as usize + 2);
        // Up for 6 s, down for 6 s, and so on.
        let reference = |tick: usize| {
            let place = tick % (2 * turn);
            0.0005 * if place < turn { place } else { 2 * turn - place } as f64
        };
        let (mut position, mut last, mut late) = (0.0, 0.0, std::collections::VecDeque::from(vec![0.0; lead]));
        let mut errors = Vec::new();
        for tick in 0..20 * turn {
            let references: Vec<f64> = (tick..=tick + fallback.ahead()).map(reference).collect();
            errors.push((references[0] - position).abs());
            last = fallback.update(references[0] - position, fallback.forward(&references), last);
            late.push_back(last);
            let command: f64 = late.pop_front().unwrap();
            let lacks = if command > 0.0 { 0.04 } else { 0.02 };
            position += 0.01 * model.speed(command - lacks);
        }
        let middle = |motion: usize| errors[motion * turn + turn / 2];
        for side in 0..2 {
            let (first, last) = (middle(side), middle(18 + side));
            assert!(first > 1.5e-3 && last < 0.2 * first, "{side}: {first} m, {last} m");
        }
        let [extend, retract] = fallback.memory.learned;
        assert!((extend - 0.04).abs() < 0.01 && (retract - 0.02).abs() < 0.01, "{extend} {retract}");
        // At rest nothing of it is in the command.
        fallback.memory.offset = 0.0;
        assert_eq!(fallback.update(0.0, 0.0, 0.0), 0.0);
    }

    #[test]
    fn what_is_learned_is_bounded() {
        let with =
            Control { feedforward: true, ki: 0.0, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let mut fallback = Fallback::new(&with, Some(&commissioned()), 0.01);
        let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| 1e-3 * k as f64).collect();
        for _ in 0..100_000 {
            fallback.update(0.05, fallback.forward(&targets), 0.3);
        }
        assert_eq!(fallback.memory.learned, [MOST_LEARNED, 0.0]);
    }

    #[test]
    fn a_comparison_leaves_out_the_inverse_of_the_hysteresis_or_the_learning_alone() {
        let usual = Control { feedforward: true, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let model = Commissioned { hysteresis: 0.04, ..commissioned() };
        let run = |without: FallbackWithout| {
            let mut fallback = Fallback::new(&Control { without, ..usual }, Some(&model), 0.01);
            let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| 1e-3 * k as f64).collect();
            let forward = fallback.forward(&targets);
            let rising = fallback.update(0.02, forward, 0.3);
            let turned = fallback.update(0.01, forward, rising);
            (forward, rising, rising - turned, fallback.memory.learned[0])
        };
        let all = run(FallbackWithout::default());
        let no_hysteresis = run(FallbackWithout { hysteresis: true, ..FallbackWithout::default() });
        let no_learning = run(FallbackWithout { learning: true, ..FallbackWithout::default() });
        assert!(all.0 > 0.1 && all.0 == no_hysteresis.0 && all.0 == no_learning.0);
        // The command turns back by less where the hysteresis is not made good.
        assert!(all.2 > 0.06 && no_hysteresis.2 < 0.045 && no_learning.2 > 0.06, "{all:?} {no_hysteresis:?}");
        assert_eq!((all.3, no_learning.3), (no_hysteresis.3, 0.0));
        assert!(all.3 > 0.0);
    }

    /// What an error of 5 mm adds to the command of a motion at `speed` m/s, in parts of what it adds at rest.
    fn added(speeds_extend: [f64; 3], speeds_retract: [f64; 3], speed: f64) -> f64 {
        let with =
            Control { feedforward: true, ki: 0.0, command_rate: 1e4, ..crate::tests::machine(1).axes[0].control };
        let model = Commissioned {
            openings: vec![0.1, 0.2, 0.3],
            speeds_extend: speeds_extend.to_vec(),
            speeds_retract: speeds_retract.to_vec(),
            ..commissioned()
        };
        let mut fallback = Fallback::new(&with, Some(&model), 0.01);
        let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| speed * 0.01 * k as f64).collect();
        let forward = fallback.forward(&targets);
        let without = fallback.clone().update(0.0, forward, 0.3);
        (fallback.update(0.005 * speed.signum(), forward, 0.3) - without).abs() / (with.kp * 0.005)
    }

    #[test]
    fn gains_are_reduced_where_the_curve_is_much_steeper_than_in_the_mean() {
        // Mean slope 1 m/s; 0.1, then 1.9, then 1 m/s.
        let added = |speed| added([0.01, 0.2, 0.3], [0.01, 0.2, 0.3], speed);
        // From an opening of 0.075 to one of 0.225 the speed rises by 0.2175 m/s.
        let steep = 1.3 * 0.15 / 0.2175;
        assert!((added(0.105) - steep).abs() < 1e-6, "{}", added(0.105));
        assert!((added(-0.105) - steep).abs() < 1e-6, "{}", added(-0.105));
        assert!((added(0.005) - 1.0).abs() < 1e-6, "a flat begin: {}", added(0.005));
    }

    #[test]
    fn of_a_straight_curve_neither_direction_has_smaller_gains() {
        for speed in [0.15, -0.15, -0.3] {
            let added = added([0.1, 0.2, 0.3], [0.16, 0.32, 0.48], speed);
            assert!((added - 1.0).abs() < 1e-6, "{speed}: {added}");
        }
    }

    #[test]
    fn the_integral_does_not_wind_up() {
        let mut fallback = fallback();
        let mut last = 0.0;
        for _ in 0..10_000 {
            last = fallback.update(10.0, 0.0, last);
        }
        assert_eq!(last, 1.0);
        assert!(fallback.memory.integrals[0].abs() < 1e-12, "{}", fallback.memory.integrals[0]);
    }

    proptest! {
        #[test]
        fn taking_over_does_not_change_the_command(last in -1.0f64..1.0, error in -0.02f64..0.02) {
            let with = Control { feedforward: true, ..crate::tests::machine(1).axes[0].control };
            for mut fallback in [fallback(), Fallback::new(&with, Some(&commissioned()), 0.01)] {
                let targets: Vec<f64> = (0..=fallback.ahead()).map(|k| 1e-3 * k as f64).collect();
                let forward = fallback.forward(&targets);
                fallback.resume(last, error, forward);
                let mut command = fallback.update(error, forward, last);
                prop_assert!((command - last).abs() < 1e-12);
                // A second later the integral is what it would have been without taking over.
                let mut alone = fallback.clone();
                (alone.memory.integrals, alone.memory.offset) = ([0.0; 3], 0.0);
                for _ in 0..100 {
                    command = fallback.update(error, forward, command);
                    alone.update(error, forward, command);
                }
                let [integral, without] = [fallback, alone].map(|of| of.memory.integrals[phase(forward)]);
                prop_assert!((integral - without).abs() < 0.02, "{integral}");
            }
        }

        #[test]
        fn compensation_is_inverted(u in -1.0f64..1.0) {
            let fallback = fallback();
            prop_assert!((fallback.compensated(fallback.uncompensated(u)) - u).abs() < 1e-12);
        }
    }
}
