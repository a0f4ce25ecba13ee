//! The valve: dead time, hysteresis, spool and curve turn the command into the opening of the control edges.
//!
//! ```text
//! w(t) = max(min(w(t-), u(t - t_d) + h/2), u(t - t_d) - h/2)           hysteresis
//! tau_v dx_v/dt + x_v = w                                             (1), K_1 = 1
//! c = clamp((x_v - d_e)/(e_e - d_e), 0, 1)                            while the spool extends the rod
//! c = clamp((-x_v - d_r)/(e_r - d_r), 0, 1)                           while the spool retracts the rod
//! X = +-c on a linear curve, +-(3 c^2 - 2 c^3) on an S-shaped one
//! ```
//!
//! u command, in [-1, 1]; w position that the spool approaches; x_v spool position, in [-1, 1]; X opening of the
//! control edges, in [-1, 1]; t_d dead time, s; h width of the hysteresis, which is the play between command and spool;
//! tau_v time constant of the spool, s; d_e and d_r dead bands; e_e and e_r spool positions at which the edges are
//! fully open.
//!
//! The S-shaped curve is that of a pilot-operated spool with notches: closed up to about 40 % of the command, fully
//! open from about 70 % on. It stays within 3.2 % of full opening of logistic curves that were fitted to boom and arm
//! of a real excavator; a test shows it.
//!
//! The command is constant over a step, so (1) has the closed solution w + (x_v - w) exp(-t/tau_v). The valve uses this
//! solution in place of a numerical one, and therefore no time constant is too short for the step.
//!
//! Only [`DelayLine::new`] allocates.
//!
//! Trap: dead time and time constant are different. The dead time shifts the response, the time constant bends it. Only
//! the dead time needs samples of delay in an identified model.

use pipeline::machine::{Plant, ValveCurve};

use crate::{
    conditions::Conditions,
    lanes::{LANES, Lanes, lanes},
};

/// Widest dead band. A scenario that widens the dead band more could otherwise keep a valve closed for all commands.
pub const WIDEST_DEAD_BAND: f64 = 0.95;

/// Least distance between dead band and saturation after a scenario has widened the dead band.
pub const LEAST_SPAN: f64 = 0.05;

/// The dead time: a command that is put in comes out a fixed number of steps later.
#[derive(Debug, Clone)]
pub struct DelayLine {
    commands: Box<[f64]>,
    oldest: usize,
}

impl DelayLine {
    /// A delay of `steps` steps, filled with neutral commands.
    pub fn new(steps: usize) -> Self {
        Self { commands: vec![0.0; steps].into(), oldest: 0 }
    }

    /// Puts in the command of this step and takes out the command that acts in it.
    #[inline]
    pub fn pass(&mut self, command: f64) -> f64 {
        let Some(slot) = self.commands.get_mut(self.oldest) else {
            return command;
        };
        let acting = std::mem::replace(slot, command);
        self.oldest += 1;
        if self.oldest == self.commands.len() {
            self.oldest = 0;
        }
        acting
    }
}

/// Hysteresis, spool and control edges of one axis (`T = f64`) or of four (`T = Lanes`), without the dead time.
#[derive(Debug, Clone, Copy)]
pub struct Valve<T> {
    /// exp(-(step/2)/tau_v): part of the distance between x_v and w that is left after half a step.
    half_step_decay: T,
    /// h/2.
    play: T,
    /// d_e and d_r.
    dead_band: [T; 2],
    /// 1/(e_e - d_e) and 1/(e_r - d_r).
    inverse_span: [T; 2],
    /// 1 for an S-shaped curve, 0 for a linear one.
    shape: T,
}

impl Valve<f64> {
    /// Valve of `plant` under `conditions`, advanced in steps of `step` s.
    pub fn new(plant: &Plant, conditions: &Conditions, step: f64) -> Self {
        let time_constant = plant.valve_time_constant * conditions.valve_time_constant;
        let dead_band = [plant.dead_band.extend, plant.dead_band.retract]
            .map(|dead_band| (dead_band * conditions.dead_band).min(WIDEST_DEAD_BAND));
        let saturation = [plant.saturation.extend, plant.saturation.retract];
        Self {
            half_step_decay: (-0.5 * step / time_constant).exp(),
            play: 0.5 * plant.hysteresis * conditions.hysteresis,
            dead_band,
            inverse_span: [0, 1].map(|side| 1.0 / (saturation[side] - dead_band[side]).max(LEAST_SPAN)),
            shape: if plant.valve_curve == ValveCurve::S { 1.0 } else { 0.0 },
        }
    }
}

impl Valve<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[Valve<f64>; LANES]) -> Self {
        Self {
            half_step_decay: lanes(axes, |valve| valve.half_step_decay),
            play: lanes(axes, |valve| valve.play),
            dead_band: [0, 1].map(|side| lanes(axes, |valve| valve.dead_band[side])),
            inverse_span: [0, 1].map(|side| lanes(axes, |valve| valve.inverse_span[side])),
            shape: lanes(axes, |valve| valve.shape),
        }
    }

    /// w under the command `command`, when w was `target` in the step before.
    #[inline]
    pub fn target(&self, target: Lanes, command: Lanes) -> Lanes {
        target.fast_min(command + self.play).fast_max(command - self.play)
    }

    /// x_v half a step and a whole step after it was `spool`, under a constant w = `target`: equation (1).
    #[inline]
    pub fn spool_after(&self, spool: Lanes, target: Lanes) -> (Lanes, Lanes) {
        let distance = spool - target;
        let middle = distance * self.half_step_decay;
        (target + middle, target + middle * self.half_step_decay)
    }

    /// X, opening of the edges in [-1, 1]; positive extends the rod.
    #[inline]
    pub fn opening(&self, spool: Lanes) -> Lanes {
        self.open(spool, 0) - self.open(-spool, 1)
    }

    #[inline]
    fn open(&self, spool: Lanes, side: usize) -> Lanes {
        let c = (spool - self.dead_band[side]) * self.inverse_span[side];
        let c = c.fast_max(Lanes::ZERO).fast_min(Lanes::ONE);
        let s = c * c * (Lanes::splat(3.0) - c - c);
        c + self.shape * (s - c)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::{DeadBand, Machine};

    use super::*;

    const STEP: f64 = 1e-4;

    fn plant() -> Plant {
        Machine::four_axes(&[]).unwrap().axes[0].plant.clone().unwrap()
    }

    fn valve(plant: &Plant) -> Valve<Lanes> {
        Valve::pack(&[Valve::new(plant, &Conditions::NOMINAL, STEP); LANES])
    }

    fn opening(plant: &Plant, spool: f64) -> f64 {
        valve(plant).opening(Lanes::splat(spool)).to_array()[0]
    }

    #[test]
    fn the_delay_is_exact_in_steps() {
        for steps in [0, 1, 2, 200] {
            let mut line = DelayLine::new(steps);
            for i in 0..3 * steps + 3 {
                let expected = if i < steps { 0.0 } else { (i - steps + 1) as f64 };
                assert_eq!(line.pass((i + 1) as f64), expected, "{steps} steps, step {i}");
            }
        }
    }

    #[test]
    fn the_spool_follows_the_exponential() {
        let (mut spool, valve) = (Lanes::ZERO, valve(&plant()));
        for _ in 0..500 {
            spool = valve.spool_after(spool, Lanes::splat(0.7)).1;
        }
        assert!((spool.to_array()[0] - 0.7 * (1.0 - (-1.0f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn the_edges_are_shut_inside_the_dead_band_and_fully_open_at_one() {
        let plant = plant();
        for spool in [-0.08, -0.05, 0.0, 0.05, 0.1] {
            assert_eq!(opening(&plant, spool), 0.0);
        }
        assert!((opening(&plant, 0.55) - 0.5).abs() < 1e-12);
        assert!((opening(&plant, -0.54) + 0.5).abs() < 1e-12);
        for (spool, expected) in [(1.0, 1.0), (1.5, 1.0), (-1.0, -1.0), (-1.5, -1.0)] {
            assert!((opening(&plant, spool) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_dead_band_is_limited_to_the_widest_one() {
        let wide = Conditions { dead_band: 18.0, ..Conditions::NOMINAL };
        let valve = Valve::pack(&[Valve::new(&plant(), &wide, STEP); LANES]);
        let openings = [1.0, -1.0, 0.94].map(|spool| valve.opening(Lanes::splat(spool)).to_array()[0]);
        assert!((openings[0] - 1.0).abs() < 1e-12 && (openings[1] + 1.0).abs() < 1e-12 && openings[2] == 0.0);
    }

    #[test]
    fn the_spool_turns_only_after_the_command_has_passed_the_width_of_the_hysteresis() {
        let plant = Plant { hysteresis: 0.04, ..plant() };
        let valve = valve(&plant);
        let mut target = Lanes::ZERO;
        let commands = [(0.5, 0.48), (0.47, 0.48), (0.461, 0.48), (0.44, 0.46), (0.47, 0.46), (0.5, 0.48), (0.0, 0.02)];
        for (command, expected) in commands {
            target = valve.target(target, Lanes::splat(command));
            assert!((target.to_array()[0] - expected).abs() < 1e-12, "{command}: {target:?}");
        }
    }

    #[test]
    fn the_s_shaped_curve_approximates_a_real_pilot_valve() {
        // v = 1/(1 + exp(-c x + a)) is 10, 50 and 90 % of the full speed at these commands; boom and arm, both
        // directions.
        for (ten, fifty, ninety) in [(0.44, 0.54, 0.64), (0.43, 0.57, 0.71), (0.47, 0.56, 0.65), (0.51, 0.61, 0.71)] {
            // 3 c^2 - 2 c^3 is 10 and 90 % at c = 0.196 and c = 0.804.
            let span: f64 = (ninety - ten) / 0.608;
            let (low, high) = (fifty - 0.5 * span, fifty + 0.5 * span);
            let plant = Plant {
                valve_curve: ValveCurve::S,
                dead_band: DeadBand { extend: low, retract: low },
                saturation: DeadBand { extend: high, retract: high },
                ..plant()
            };
            let logistic = |x: f64| 1.0 / (1.0 + (-(x - fifty) * 2.0 * 9f64.ln() / (ninety - ten)).exp());
            let commands = (0..=100).map(|i| 0.01 * f64::from(i));
            let worst = commands.map(|x| (opening(&plant, x) - logistic(x)).abs()).fold(0.0, f64::max);
            println!("dead band {low:.3}, open at {high:.3}: within {:.2} %", 100.0 * worst);
            assert!(worst < 0.032, "{worst}");
            assert!((0.33..0.45).contains(&low) && (0.7..0.85).contains(&high));
        }
    }
}
