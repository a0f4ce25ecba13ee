//! The plant of a generated record: a valve and a cylinder, as few equations as show what a class is about.
//!
//! ```text
//! spool' = (play(u(t - t_d)) - spool) / t_v
//! v''    = w^2 (v_s - v) - 2 z w v'              v_s = V g(t) N(spool) - c(t) V - l V (p - P/2) / P
//! p'     = v                                     between the end stops 0 and P
//! N(x)   = r (max(|x| - d, 0) / (s - d))^e sign x,  |x| up to s
//! ```
//!
//! u command in parts of 1, t_d dead time s, t_v lag of the valve s, p position m, P stroke m, v speed m/s, V largest
//! speed m/s, w natural frequency rad/s, z damping, g gain, c sinking and l leakage in parts of V, d dead band, s
//! opening at which the valve saturates, e exponent, r ratio of the speeds of retracting and extending, 1 when
//! extending. Integrated by steps of at most a twentieth of 1 / w.

use super::class::Class;
use crate::command::bench::drawn::Draw;

/// Longest step of the integration, in parts of 1 / w.
const LONGEST_STEP: f64 = 0.05;

/// What is drawn of a plant.
#[derive(Debug, Clone)]
pub struct Plant {
    /// Class of its record.
    pub class: Class,
    /// Factor on all times of the plant, for long periods.
    pub slowness: f64,
    /// P, m.
    pub stroke: f64,
    /// V, m/s.
    pub speed: f64,
    /// t_d at the start, s.
    pub dead_time: f64,
    /// t_v, s.
    pub lag: f64,
    /// w rad/s and z.
    pub oscillation: (f64, f64),
    /// d, s, e and r.
    curve: [f64; 4],
    /// Width of the valve's play, in parts of the full command.
    play: f64,
    /// l.
    leakage: f64,
    /// What changes while the record lasts.
    change: Change,
}

/// How a plant changes. Times are parts of the length of the record.
#[derive(Debug, Clone, Copy)]
struct Change {
    /// Gain at the end by that at the start, approached with a time constant of a quarter of the record.
    warm_up: f64,
    /// From when to when a load acts.
    loaded: (f64, f64),
    /// Factors of the load on the gains of extending and retracting; its sinking in parts of V.
    load: [f64; 3],
    /// Amplitude of a slow change of c, and c itself.
    sinking: (f64, f64),
    /// When the dead time changes, and by which factor.
    delay: (f64, f64),
}

/// The state of a plant.
struct State {
    spool: f64,
    /// Behind the play.
    acting: f64,
    speed: f64,
    acceleration: f64,
    position: f64,
}

impl Plant {
    /// A plant of this class, for a period in s that is at most `longest_dead_time` / 60.
    pub fn draw(draw: &mut Draw, class: Class, slowness: f64, longest_dead_time: f64) -> Self {
        let stroke = draw.log(0.3..=1.5);
        let dead_time = (slowness * draw.log(3e-3..=0.2)).min(longest_dead_time);
        let lag = slowness * draw.log(5e-3..=0.08);
        let oscillation = (draw.log(3.0..=20.0) * std::f64::consts::TAU / slowness, draw.even(0.15..=0.8));
        let saturates = class == Class::Saturation;
        let saturation = if saturates { draw.even(0.4..=0.8) } else { 1.0 };
        let curve = [draw.even(0.0..=0.15), saturation, draw.even(0.8..=1.6), draw.even(0.5..=1.0)];
        let play = draw.even(0.02..=0.1) * f64::from(u8::from(class == Class::Play));
        Self {
            class,
            slowness,
            stroke,
            speed: stroke / (slowness * draw.log(1.5..=6.0)),
            dead_time,
            lag,
            oscillation,
            curve,
            play,
            leakage: draw.even(0.0..=0.1),
            change: Change::draw(draw, class),
        }
    }

    /// Runs the plant for `samples` periods of `period` s under the commands that `course` gives for a time in s and a
    /// position in m. Returns the commands u(k) and the positions p(k) in m; u(k) acts from sample k to sample k + 1.
    pub fn run(&self, mut course: impl FnMut(f64, f64) -> f64, period: f64, samples: usize) -> (Vec<f64>, Vec<f64>) {
        let steps = (period * self.oscillation.0 / LONGEST_STEP).ceil() as usize;
        let step = period / steps as f64;
        let (mut commands, mut positions) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
        let mut state = State { spool: 0.0, acting: 0.0, speed: 0.0, acceleration: 0.0, position: 0.5 * self.stroke };
        for k in 0..samples {
            positions.push(state.position);
            commands.push(course(k as f64 * period, state.position));
            for i in 0..steps {
                let time = (k * steps + i) as f64 * step;
                let part = time / (samples as f64 * period);
                let sent = (time - self.change.dead_time(self.dead_time, part)).div_euclid(period);
                let arrived = if sent < 0.0 { 0.0 } else { commands[sent as usize] };
                self.advance(&mut state, arrived, part, step);
            }
        }
        (commands, positions)
    }

    fn advance(&self, state: &mut State, command: f64, part: f64, step: f64) {
        let half = 0.5 * self.play;
        state.acting = state.acting.clamp(command - half, command + half);
        state.spool += (1.0 - (-step / self.lag).exp()) * (state.acting - state.spool);
        let travel = (state.position - 0.5 * self.stroke) / self.stroke;
        let gain = self.change.gain(part, state.spool);
        let leakage = if self.class == Class::OneSided { 0.0 } else { self.leakage * travel };
        let steady = self.speed * (gain * self.opening(state.spool) - self.change.sinking(part, travel) - leakage);
        let (w, z) = self.oscillation;
        let w = if self.change.is_loaded(part) { 0.75 * w } else { w };
        state.acceleration += step * (w * w * (steady - state.speed) - 2.0 * z * w * state.acceleration);
        state.speed += step * state.acceleration;
        state.position += step * state.speed;
        if self.class != Class::OneSided && !(0.0..=self.stroke).contains(&state.position) {
            state.position = state.position.clamp(0.0, self.stroke);
            (state.speed, state.acceleration) = (0.0, 0.0);
        }
    }

    /// N(x).
    fn opening(&self, spool: f64) -> f64 {
        let [dead_band, saturation, exponent, ratio] = self.curve;
        let open = ((spool.abs().min(saturation) - dead_band) / (saturation - dead_band)).max(0.0).powf(exponent);
        if spool < 0.0 { -ratio * open } else { open }
    }
}

impl Change {
    fn draw(draw: &mut Draw, class: Class) -> Self {
        let mut unchanged =
            Self { warm_up: 1.0, loaded: (2.0, 3.0), load: [1.0, 1.0, 0.0], sinking: (0.0, 0.0), delay: (2.0, 1.0) };
        // Half of the other plants warm up a little, as most machines do.
        let [little, much] = [draw.even(0.8..=1.25), draw.log(0.6..=1.67)];
        if class != Class::Constant && draw.unit() < 0.5 {
            unchanged.warm_up = little;
        }
        let on = draw.even(0.45..=0.6);
        let loaded = (on, on + draw.even(0.15..=0.3));
        let load = [draw.even(0.5..=0.9), draw.even(1.1..=1.5), draw.even(0.0..=0.08)];
        let sinking = (draw.even(0.01..=0.05), draw.even(-0.08..=0.08));
        let delay = (draw.even(0.45..=0.8), draw.log(0.4..=2.5));
        match class {
            Class::WarmUp => Self { warm_up: much, ..unchanged },
            Class::Payload => Self { loaded, load, ..unchanged },
            Class::Delay => Self { delay, ..unchanged },
            Class::Drift => Self { sinking, ..unchanged },
            _ => unchanged,
        }
    }

    fn is_loaded(&self, part: f64) -> bool {
        (self.loaded.0..self.loaded.1).contains(&part)
    }

    fn gain(&self, part: f64, spool: f64) -> f64 {
        let warm_up = 1.0 + (self.warm_up - 1.0) * (1.0 - (-4.0 * part).exp()) / (1.0 - (-4f64).exp());
        let load = if self.is_loaded(part) { self.load[usize::from(spool < 0.0)] } else { 1.0 };
        warm_up * load
    }

    fn sinking(&self, part: f64, travel: f64) -> f64 {
        let load = if self.is_loaded(part) { self.load[2] } else { 0.0 };
        let (amplitude, constant) = self.sinking;
        load + (constant + amplitude * (3.0 * std::f64::consts::TAU * part).sin()) * (1.0 + 0.5 * travel)
    }

    fn dead_time(&self, at_first: f64, part: f64) -> f64 {
        if part < self.delay.0 { at_first } else { self.delay.1 * at_first }
    }
}
