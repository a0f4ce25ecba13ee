//! Whether an axis that is driven moves.
//!
//! ```text
//! stuck     sum of s(u) T while u is one way >= stuck_after + t_d, and y has not changed at all for stuck_after
//!           s(u) = 0 up to d + 0.05, 1 from d + 0.1 on, a straight line between them
//! stalled   u beyond d + 0.1 one way for t_s + t_r, in which y has not moved that way by 0.4 s * v_max / 200 or 5 r;
//!           t_s after y has turned, where the axis ran on against u for up to t_s + t_r, or within t_r + 4 t_p of
//!           its last motion was pushed back, by 5 r or behind the place of that motion
//! t_s       0.4 s, or 5 r / (v_max / 50) or 4 t_p where that is longer, but at most 2 s
//! ```
//!
//! u command, d calibrated or commissioned dead band, whichever is wider, y position m, T period s, t_d dead time s,
//! t_r dead time and time constant of the commissioned model together, at least t_d, s, t_p time constant of a
//! load-sensing pump, s, v_max `max_speed` m/s, r length of a count m. All times begin anew after a
//! gap in the ticks that is longer than `drive_timeout`: by then the drive is neutral.
//!
//! Stuck is an encoder that does not report any change; this is seen from the positions alone. Stalled is an axis
//! without supply, or one that stands against an obstacle. Its encoder may be healthy and show noise.
//!
//! Traps: a valve whose dead band has grown stands still above the calibrated dead band, until the integral of the
//! fallback has passed it; hence the margins. Close to its set point such an axis needs longer than `stuck_after` to
//! come from one margin to the other; hence the weight s. Motion against the command does not count as motion. But
//! after a reversal an axis runs on against its new command until that command acts. Then the axis has to come back all
//! of that way before it passes the position of the reversal. So the motion is measured from the furthest point of the
//! run-out. An axis that still moves against the command after t_s + t_r does not run out: it is stalled at 2 t_s +
//! t_r. A slow axis with a coarse encoder passes few counts in 0.4 s, though it moves.
//!
//! A load that comes at once may be more than a load-sensing pump gives at that time. It pushes the axis back until the
//! pump has followed, and only then the axis goes on: the boom of the built-in excavator with servo valves after 0.4 s
//! where 1.5 t came, by a pump of 0.1 s.

use std::time::Duration;

use pipeline::machine::{Axis, Commissioned, DeadBand, Timing, samples_of};

/// Command beyond the dead band from which on a position that stands still is a fault in time. The calibration is a
/// little low on purpose, and just above the dead band the axis may creep below the resolution of the encoder.
pub const STUCK_MARGIN: f64 = 0.05;
/// Command beyond the dead band from which on an axis that hardly moves is a fault. A dead band that has grown by half,
/// friction and hysteresis are within this margin.
pub const STALL_MARGIN: f64 = 0.1;
/// Least and longest time in which a driven axis has to move, s.
pub const STALL_TIME: f64 = 0.4;
const LONGEST_STALL_TIME: f64 = 2.0;
/// Part of `max_speed` below which an axis hardly moves. The judge refuses a model that moves less than twice that.
const HARDLY_MOVING: f64 = 0.005;
/// Counts of the encoder that are no motion.
pub const NOISE_COUNTS: f64 = 5.0;
/// t_p after which a pump has followed a load.
const PUMP_RESPONSES: f64 = 4.0;
/// Part of `max_speed` at which an axis has the time to pass these counts.
const SEEN_SPEED: f64 = 0.02;

/// t_s: time in which a driven axis has to move, s.
fn stall_time(axis: &Axis) -> f64 {
    let seen = NOISE_COUNTS * axis.encoder.resolution / (SEEN_SPEED * axis.max_speed);
    seen.max(pump_time(axis)).clamp(STALL_TIME, LONGEST_STALL_TIME)
}

/// 4 t_p, s.
fn pump_time(axis: &Axis) -> f64 {
    PUMP_RESPONSES * axis.control.pump_response
}

/// d: the calibrated or the commissioned dead band, whichever is wider. The fallback compensates a little less than the
/// valve's dead band, or none of it.
pub fn widest_dead_band(axis: &Axis) -> DeadBand {
    let calibrated = axis.control.dead_band;
    axis.commissioned.as_ref().map_or(calibrated, |model| DeadBand {
        extend: calibrated.extend.max(model.dead_band.extend),
        retract: calibrated.retract.max(model.dead_band.retract),
    })
}

/// An axis that is driven and does not move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// The position does not change at all.
    Stuck,
    /// The axis hardly moves.
    Stalled,
}

/// Watches the motion of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// d of retracting and extending.
    dead_band: (f64, f64),
    /// Ticks without a change of the position that are a fault.
    still_ticks: u64,
    /// Ticks of a command beyond the margin for stalled that are a fault while the position does not change.
    stuck_ticks: f64,
    /// Ticks without a new command for which the drive holds the last one.
    drive_ticks: u64,
    /// Command of the tick before.
    command: f64,
    /// Sum of s(u) over the ticks for which the command has been beyond the margin for stuck, one way.
    driven: f64,
    stall: Stall,
    /// Ticks for which the position has not changed.
    still: u64,
    position: f64,
}

impl Motion {
    /// As the machine file sets it for `axis`.
    pub fn new(axis: &Axis, timing: &Timing) -> Self {
        let ticks = |duration| samples_of(duration, timing.period).max(1) as u64;
        let dead_band = widest_dead_band(axis);
        // The motion cannot show before the dead time.
        let dead_time = axis.identification.structure.nk as u64;
        let reaction = axis.commissioned.as_ref().map_or(0.0, Commissioned::reaction);
        let reaction_ticks = dead_time.max((reaction / timing.period.as_secs_f64()).ceil() as u64);
        let stall_ticks = ticks(Duration::from_secs_f64(stall_time(axis)));
        let noise = NOISE_COUNTS * axis.encoder.resolution;
        let pump_ticks = ticks(Duration::from_secs_f64(pump_time(axis))).min(stall_ticks);
        Self {
            dead_band: (dead_band.retract, dead_band.extend),
            still_ticks: ticks(axis.encoder.stuck_after),
            stuck_ticks: (ticks(axis.encoder.stuck_after) + dead_time) as f64,
            drive_ticks: ticks(timing.drive_timeout),
            command: 0.0,
            driven: 0.0,
            stall: Stall {
                reaction: reaction_ticks,
                longest: stall_ticks + reaction_ticks,
                pushed: if axis.control.pump_response > 0.0 { reaction_ticks + pump_ticks } else { 0 },
                least: (HARDLY_MOVING * axis.max_speed * STALL_TIME).max(noise),
                noise,
                driven: 0,
                unmoved: 0,
                since: 0,
                from: 0.0,
                ahead: 0.0,
            },
            still: 0,
            position: f64::NAN,
        }
    }

    /// Whether the axis stands, `elapsed` ticks after the last call. `command` has been on the valve since then, or
    /// until the drive went neutral; `position` (m) is where the axis is now, if that is known.
    pub fn update(&mut self, elapsed: u64, command: f64, position: Option<f64>) -> Option<Standing> {
        // After a longer time without a command the drive is neutral, so nothing has driven the axis.
        let was_dropped = elapsed > self.drive_ticks;
        if command * self.command <= 0.0 || was_dropped {
            self.driven = 0.0;
            self.stall.reset();
        }
        let driven = if was_dropped { 0 } else { elapsed };
        self.command = command;
        let dead_band = if command < 0.0 { self.dead_band.0 } else { self.dead_band.1 };
        let beyond = command.abs() - dead_band;
        let weight = ((beyond - STUCK_MARGIN) / (STALL_MARGIN - STUCK_MARGIN)).min(1.0);
        self.driven = if weight > 0.0 { self.driven + weight * driven as f64 } else { 0.0 };
        if let Some(position) = position {
            self.still = if position == self.position { self.still.saturating_add(elapsed) } else { 0 };
            self.position = position;
            self.stall.measure(position, command.signum());
        }
        if beyond > STALL_MARGIN {
            self.stall.drive(driven);
        } else {
            self.stall.reset();
        }
        if self.driven >= self.stuck_ticks && self.still >= self.still_ticks {
            Some(Standing::Stuck)
        } else if self.stall.since > self.stall.longest {
            Some(Standing::Stalled)
        } else {
            None
        }
    }
}

/// How long a driven axis has not moved the way of its command.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stall {
    /// t_r, ticks.
    reaction: u64,
    /// Ticks without motion after which the axis is stalled.
    longest: u64,
    /// Ticks without motion for which a load may push the axis back.
    pushed: u64,
    /// Least way that is motion, m.
    least: f64,
    /// Motion that may be noise, m.
    noise: f64,
    /// Ticks for which the command has been beyond the dead band and the margin for stalled, one way.
    driven: u64,
    /// How many of these ticks have passed since the axis has last moved by `least`.
    unmoved: u64,
    /// The same, but at most `reaction` at the furthest point of a run-out, or of where a load has pushed the axis.
    since: u64,
    /// Position from which the motion is measured: where the axis was then, or that furthest point, m.
    from: f64,
    /// Most advanced position since then, m.
    ahead: f64,
}

impl Stall {
    /// The command does not drive the axis, or drives it the other way.
    fn reset(&mut self) {
        (self.driven, self.unmoved, self.since) = (0, 0, 0);
    }

    /// The command has driven the axis for so many more ticks.
    fn drive(&mut self, ticks: u64) {
        self.driven = self.driven.saturating_add(ticks);
        self.unmoved = self.unmoved.saturating_add(ticks);
        self.since = self.since.saturating_add(ticks);
    }

    /// Begins the time of a stall anew where the axis has moved in `direction`, and measures the motion from the
    /// furthest point against it.
    fn measure(&mut self, position: f64, direction: f64) {
        let way = (position - self.from) * direction;
        if self.driven == 0 || way >= self.least {
            (self.unmoved, self.since, self.from, self.ahead) = (0, 0, position, position);
            return;
        }
        let runs_out = way < 0.0 && self.driven <= self.longest;
        let goes_back = way < 0.0 || (self.ahead - position) * direction >= self.noise;
        if runs_out || goes_back && self.unmoved <= self.pushed {
            // The axis turns because the command acts, so its reaction is over there.
            (self.since, self.from, self.ahead) = (self.since.min(self.reaction), position, position);
        } else if (position - self.ahead) * direction > 0.0 {
            self.ahead = position;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::machine;

    /// Tick and kind of the fault of the test machine: dead bands 0.08 and 0.07, 1 m/s, 5 ticks of dead time, stuck
    /// after 300 ms.
    fn stands(command: impl Fn(u64) -> f64, position: impl Fn(u64) -> f64) -> Option<(u64, Standing)> {
        let machine = machine(1);
        let mut motion = Motion::new(&machine.axes[0], &machine.timing);
        (0..200).find_map(|k| motion.update(1, command(k), Some(position(k))).map(|standing| (k, standing)))
    }

    /// The position of an axis that stands, with noise.
    fn noise(k: u64) -> f64 {
        0.6 + 1e-4 * (k % 2) as f64
    }

    #[test]
    fn a_position_that_never_changes_is_stuck_after_its_time() {
        assert_eq!(stands(|_| 0.1801, |_| 0.6), Some((34, Standing::Stuck)));
        assert_eq!(stands(|_| -0.1701, |_| 0.6), Some((34, Standing::Stuck)));
        assert_eq!(stands(|_| 0.3, |k| if k < 100 { noise(k) + 1e-3 * k as f64 } else { 0.7 }).map(|s| s.0), Some(130));
        assert_eq!(stands(|_| 0.13, |_| 0.6), None);
        assert_eq!(stands(|_| -0.12, |_| 0.6), None);
        assert_eq!(stands(|_| 0.17, noise), None);
        // An axis that is driven to and fro has no time to move.
        assert_eq!(stands(|k| if k / 30 % 2 == 0 { 0.3 } else { -0.3 }, |_| 0.6), None);
    }

    #[test]
    fn a_command_that_the_drive_has_dropped_drives_no_axis() {
        let machine = machine(1);
        let timeout = samples_of(machine.timing.drive_timeout, machine.timing.period) as u64;
        // An axis that stands in its dead band for 0.1 s; then neither sample nor command for the time `gap`.
        let stands_after = |gap: u64| {
            let mut motion = Motion::new(&machine.axes[0], &machine.timing);
            let before = (0..10).find_map(|_| motion.update(1, 0.3, Some(0.6)));
            before.or_else(|| motion.update(gap, 0.3, Some(0.6)))
        };
        assert_eq!((stands_after(timeout), stands_after(timeout + 1), stands_after(200)), (None, None, None));
        // After the gap the command drives the axis again, and the time begins anew.
        let mut motion = Motion::new(&machine.axes[0], &machine.timing);
        motion.update(200, 0.3, Some(0.6));
        let first = (1..100).find(|_| motion.update(1, 0.3, Some(0.6)).is_some());
        assert_eq!(first, Some(35));
        // Gaps that the drive bridges count.
        let mut motion = Motion::new(&machine.axes[0], &machine.timing);
        assert!((0..20).any(|_| motion.update(timeout, 0.3, Some(0.6)) == Some(Standing::Stuck)));
    }

    #[test]
    fn a_slow_axis_with_a_coarse_encoder_has_the_time_to_pass_a_few_counts() {
        let mut machine = machine(1);
        (machine.axes[0].max_speed, machine.axes[0].encoder.resolution) = (0.15, 5e-4);
        let found = |speed: f64| {
            let mut motion = Motion::new(&machine.axes[0], &machine.timing);
            let position = |k: u64| 0.6 + 5e-4 * (speed * 0.01 * k as f64 / 5e-4).round();
            (0..1000).find(|k| motion.update(1, 0.3, Some(position(*k))).is_some())
        };
        assert_eq!((found(4e-3), found(8e-3), found(-4e-3).is_some()), (None, None, true));
        // 2.5 mm at 3 mm/s take 0.83 s.
        assert!(found(0.1e-3).is_some_and(|tick| tick < 95), "{:?}", found(0.1e-3));
    }

    #[test]
    fn the_closer_the_command_is_to_the_dead_band_the_later_it_is_stuck() {
        // Half way between the margins after twice the time, a quarter above the first after four times.
        assert_eq!(stands(|_| 0.1551, |_| 0.6), Some((69, Standing::Stuck)));
        assert_eq!(stands(|_| -0.1326, |_| 0.6), Some((138, Standing::Stuck)));
        // A command that crosses the first margin and comes back begins anew.
        assert_eq!(stands(|k| if k % 60 == 0 { 0.12 } else { 0.1551 }, |_| 0.6), None);
    }

    #[test]
    fn an_axis_that_hardly_moves_has_stalled_after_its_time() {
        assert_eq!(stands(|_| 0.1801, noise), Some((45, Standing::Stalled)));
        assert_eq!(stands(|_| -0.1701, noise), Some((45, Standing::Stalled)));
        assert_eq!(stands(|_| 0.18, noise), None);
        assert_eq!(stands(|_| -0.17, noise), None);
        // An axis that moves and then stops has stalled after 0.45 s at the latest.
        let stops = |k: u64| noise(k) + 1e-3 * k.min(100) as f64;
        let (tick, standing) = stands(|_| 0.3, stops).unwrap();
        assert!(standing == Standing::Stalled && (140..=146).contains(&tick), "{tick}");
        // Slower than 5 mm/s, faster, against the command, and with pauses of the command.
        assert!(stands(|_| 0.3, |k| noise(k) + 4e-5 * k as f64).is_some());
        assert_eq!(stands(|_| 0.3, |k| noise(k) + 6e-5 * k as f64), None);
        assert!(stands(|_| 0.3, |k| noise(k) - 1e-3 * k as f64).is_some());
        assert_eq!(stands(|k| if k % 40 == 0 { 0.0 } else { 0.3 }, noise), None);
    }

    /// Tick, from when a load comes, at which an axis is stalled that had risen and goes on by `way` m; on the test
    /// machine (t_s + t_r of 45 ticks) with a pump of `pump` s.
    fn stalls_after(pump: f64, way: impl Fn(u64) -> f64) -> Option<u64> {
        let mut machine = machine(1);
        machine.axes[0].control.pump_response = pump;
        let mut motion = Motion::new(&machine.axes[0], &machine.timing);
        let position = |k: u64| noise(k) + 1e-3 * k.min(100) as f64 + way(k.saturating_sub(100));
        (0..400).find(|k| motion.update(1, 0.3, Some(position(*k))).is_some()).map(|k| k - 100)
    }

    /// The same of an axis that goes back for `back` ticks and then on with 10 mm/s, or not at all.
    fn stalls_under_load(pump: f64, back: u64, goes_on: bool) -> Option<u64> {
        let on = |k: u64| if goes_on { k.saturating_sub(back) } else { 0 };
        stalls_after(pump, |k| 1e-4 * on(k) as f64 - 5e-4 * k.min(back) as f64)
    }

    #[test]
    fn an_axis_that_a_load_pushes_back_has_the_time_that_the_pump_needs() {
        // The load is lifted once the pump has followed. One that holds its pressure has nothing to follow.
        assert_eq!(stalls_under_load(0.1, 35, true), None);
        assert!(stalls_under_load(0.0, 35, true).is_some_and(|tick| tick <= 46));
        // It is not lifted: stalled 0.4 s after the axis has come to a stand.
        let held = stalls_under_load(0.1, 35, false).unwrap();
        assert!((75..=77).contains(&held), "{held}");
        // It pushes the axis on: stalled after t_s + t_r + 4 t_p.
        let pushed = [0.05, 0.1, 0.2].map(|pump| stalls_under_load(pump, 299, false).unwrap());
        let expected = [64..=67, 84..=87, 164..=167];
        assert!(pushed.iter().zip(&expected).all(|(tick, expected)| expected.contains(tick)), "{pushed:?}");
        // Before it goes back by 0.8 mm it creeps on by 1.4 mm, less than what is motion.
        let creeps = |k: u64| {
            let [on, back, up] = [k.min(20), k.clamp(20, 35) - 20, k.saturating_sub(35)].map(|k| k as f64);
            7e-5 * on - 5.5e-5 * back + 1e-4 * up
        };
        assert_eq!(stalls_after(0.1, creeps), None);
        assert!(stalls_after(0.0, creeps).is_some_and(|tick| tick <= 46));
        // An axis that stands is stalled as early as by any pump, unless its own is slow; after 2 s at the latest.
        let stands = [0.0, 0.1, 0.3, 2.0].map(|pump| stalls_under_load(pump, 0, false).unwrap());
        assert!(stands[0] <= 47 && stands[1] == stands[0], "{stands:?}");
        assert_eq!([stands[2] - stands[0], stands[3] - stands[0]], [80, 160]);
    }

    /// An axis behind a dead time and two lags: what it does is what was commanded long before.
    struct Drawn {
        machine: pipeline::machine::Machine,
        /// Commands that have not acted yet.
        under_way: std::collections::VecDeque<f64>,
        /// Lags of valve and mass, s.
        lags: [f64; 2],
        states: [f64; 2],
        /// Speed per command beyond the dead band, m/s.
        gain: f64,
        position: f64,
    }

    impl Drawn {
        const PERIOD: f64 = 0.005;
        const DEAD_BAND: f64 = 0.1;
        const MAX_SPEED: f64 = 0.3;

        fn new(random: &mut dyn FnMut(f64, f64) -> f64) -> Self {
            let (dead_time, lags) = (random(0.005, 0.5), [random(0.01, 0.15), random(0.005, 0.1)]);
            let gain = random(0.2, 1.0);
            let model = format!(
                "[axis.a0.commissioned]\ndead_time = {dead_time}\ntime_constant = {}\ndead_band_extend = 0.1\n\
                 dead_band_retract = 0.1\nopenings = [0.5]\nspeeds_extend = [{}]\nspeeds_retract = [{}]\n\
                 fit_percent = 95.0\n",
                lags[0] + lags[1],
                0.5 * gain,
                0.5 * gain
            );
            let text = crate::tests::machine_text(1)
                .replace("period = \"10ms\"", "period = \"5ms\"")
                .replace("max_speed = 1.0", &format!("max_speed = {}", Self::MAX_SPEED))
                .replace("nk = 5\n", "")
                .replace("dead_band_extend = 0.08\ndead_band_retract = 0.07\n", "")
                + &model;
            let machine =
                pipeline::machine::Machine::parse(&text, "test.toml", std::path::Path::new("."), &[]).unwrap();
            // Cold oil makes the dead time longer than that of the model.
            let under_way = vec![0.0; (random(0.8, 1.2) * dead_time / Self::PERIOD).ceil() as usize].into();
            Self { machine, under_way, lags, states: [0.0; 2], gain, position: 0.6 }
        }

        fn motion(&self) -> Motion {
            Motion::new(&self.machine.axes[0], &self.machine.timing)
        }

        /// t_d + tau, ticks.
        fn reaction(&self) -> u64 {
            (self.machine.axes[0].commissioned.as_ref().unwrap().reaction() / Self::PERIOD).ceil() as u64
        }

        /// Position after a tick of the command.
        fn step(&mut self, command: f64) -> f64 {
            self.under_way.push_back(command);
            let acting = self.under_way.pop_front().unwrap();
            let asked = self.gain * (acting - acting.clamp(-Self::DEAD_BAND, Self::DEAD_BAND));
            let mut input = asked;
            for (state, lag) in self.states.iter_mut().zip(self.lags) {
                *state += (input - *state) * (1.0 - (-Self::PERIOD / lag).exp());
                input = *state;
            }
            self.position += input * Self::PERIOD;
            // Counts of 0.1 mm.
            (self.position / 1e-4).round() * 1e-4
        }
    }

    /// Calls `test` with a source of numbers between two bounds, for many seeds.
    fn for_seeds(test: impl Fn(u64, &mut dyn FnMut(f64, f64) -> f64)) {
        for seed in 0..200 {
            let mut state: u64 = 0x9E37_79B9_7F4A_7C15 ^ (seed << 20);
            let mut random = |low: f64, high: f64| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                low + (high - low) * (state >> 11) as f64 / (1u64 << 53) as f64
            };
            test(seed, &mut random);
        }
    }

    #[test]
    fn an_axis_that_answers_late_and_runs_out_is_never_called_stalled() {
        for_seeds(|seed, random| {
            let mut axis = Drawn::new(random);
            let mut motion = axis.motion();
            let (frequency, amplitude) = (random(0.05, 0.8), random(0.25, 1.0));
            let is_sine = seed % 2 == 0;
            let (mut left, mut level) = (0, 0.0);
            for k in 0..4000_u64 {
                if left == 0 {
                    // Violent steps from one way to the other, with and without a pause.
                    left = random(20.0, 400.0) as u32;
                    let magnitude = random(0.21, 1.0);
                    level = if random(0.0, 1.0) < 0.2 { 0.0 } else { -magnitude.copysign(level) };
                }
                left -= 1;
                let phase = std::f64::consts::TAU * frequency * k as f64 * Drawn::PERIOD;
                let command = if is_sine { amplitude * phase.sin() } else { level };
                let position = axis.step(command);
                let standing = motion.update(1, command, Some(position));
                assert_eq!(standing, None, "seed {seed}, tick {k}, command {command}, lags {:?}", axis.lags);
            }
        });
    }

    #[test]
    fn an_axis_that_stands_or_runs_the_wrong_way_is_called_stalled_in_time() {
        for_seeds(|seed, random| {
            let mut axis = Drawn::new(random);
            let mut motion = axis.motion();
            let level = random(0.25, 1.0) * if seed % 2 == 0 { 1.0 } else { -1.0 };
            // It moves one way, is reversed, and then something holds it or moves it on.
            let reversal = 400;
            let held_at = reversal + random(0.0, axis.reaction() as f64) as u64;
            let goes_on = seed % 3 == 0;
            let mut position = 0.6;
            let found = (0..2000).find(|k| {
                let command = if *k < reversal { level } else { -level };
                let moved = axis.step(level);
                if *k < held_at || goes_on {
                    position = moved;
                }
                let noise = 1e-4 * (k % 2) as f64;
                motion.update(1, command, Some(position + noise)).is_some()
            });
            let ticks = |time: Duration| (time.as_secs_f64() / Drawn::PERIOD) as u64;
            let after = if goes_on { 2 } else { 1 };
            let bound = reversal.max(held_at) + after * ticks(Duration::from_secs_f64(STALL_TIME)) + axis.reaction();
            assert!(found.is_some_and(|k| (reversal..=bound + 3).contains(&k)), "seed {seed}: {found:?}, {bound}");
        });
    }
}
