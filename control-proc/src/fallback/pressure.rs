//! Pressure feedback: damps the swing of a load on its spring of oil.
//!
//! ```text
//! T_F dF_s/dt + F_s = F          v_p = n k (F - F_s)          k = 2 zeta_p / (w m)
//! m dv/dt = F - F_load           dF/dt = m w^2 (v_c - v_p - v)
//! ```
//!
//! F force of the cylinder in N (`cylinder`) and F_s its slow part, which holds the load; v_p speed in m/s
//! that is taken off the command; w natural frequency in rad/s and m mass in kg of the commissioned load, zeta_p
//! `pressure_damping`, and n by how much more another load needs ([`crate::load`]); v_c speed of the curve and v that
//! of the axis in m/s. What accelerates a load shows in the pressures before it shows in its position. The damping
//! ratio is greater by zeta_p, and the load follows the curve by 2 zeta_p / w later. Source: dynamic pressure feedback,
//! Merritt, Hydraulic Control Systems (1967).
//!
//! It never opens a valve: v_p changes an opening by that opening at most. Without readings, and with readings that
//! stay the same while the axis moves, the gains of the fallback are reduced to the gain margin that they have with it.
//! They come back within `BACK`, so that readings that come and go do not leave a high gain without its damping.
//!
//! Runs in the loop: nothing here allocates after construction.

use std::f64::consts::TAU;

use pipeline::{
    machine::{Axis, Commissioned, Control, Law},
    message::AxisSample,
};

use crate::{
    cylinder::Cylinder,
    load::SLOW,
    margins::{Loop, mean_slope},
};

/// Time in which the gains come back with the readings, s.
const BACK: f64 = 1.0;
/// Time for which both readings may stay the same while the axis moves, s, and the speed from which on it does, m/s.
const STUCK: f64 = 0.5;
const MOVES: f64 = 5e-3;

/// zeta_p of an axis that is damped, and of one whose pressures act late.
pub const RATIO: f64 = 0.3;
const LATE_RATIO: f64 = 0.15;
/// w t beyond which pressures act late, and beyond which an axis is not damped, t time from the pressures to the motion
/// in s. Trap: a machine has swings of several axes at once, two and three times as fast as that of one; pressures that
/// act late excite them.
const LATE: f64 = 1.2;
const LATEST: f64 = 3.0;

/// zeta_p for an axis with this model, which measures the force of its cylinder, with a command every `period` s: 0
/// where the load does not swing, its mass is not known, or the valve is too slow.
pub fn ratio(model: &Commissioned, period: f64) -> f64 {
    // Only the sum of dead time, lag and delay of the swing is certain.
    let late = TAU * model.natural_frequency * (model.reaction() + period);
    if !(late > 0.0 && late <= LATEST && model.mass.is_finite()) {
        return 0.0;
    }
    if late <= LATE { RATIO } else { LATE_RATIO }
}

/// What the pressures change in one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// v_p, m/s.
    pub speed: f64,
    /// Part of kp and ki that is left.
    pub gain: f64,
}

impl Damping {
    /// Of an axis that is not damped by its pressures.
    pub const NONE: Self = Self { speed: 0.0, gain: 1.0 };
}

/// The pressure feedback of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct PressureFeedback {
    /// None in a comparison without the damping.
    cylinder: Option<Cylinder>,
    /// k, m/(s N).
    gain: f64,
    /// Part of a new force in F_s.
    new: f64,
    /// F_s; none before the first reading.
    slow: Option<f64>,
    /// Part of the gains without readings, and the present one.
    without: f64,
    present: f64,
    /// By how much it grows from tick to tick.
    growth: f64,
    /// The last readings, Pa, and for how many ticks of motion they have been these.
    last: Option<(f64, f64)>,
    unchanged: u64,
    /// Ticks of [`STUCK`].
    stuck: u64,
}

impl PressureFeedback {
    /// Of an axis whose `pressure_damping` is not 0; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        let control = &axis.control;
        let model = axis.commissioned.as_ref().filter(|_| control.pressure_damping > 0.0)?;
        let without = part_without(control, model, period);
        Some(Self {
            cylinder: Cylinder::of(axis).filter(|_| !control.without.damping),
            gain: model.opposing_speed(control.pressure_damping),
            new: 1.0 - (-period / SLOW).exp(),
            slow: None,
            without,
            present: 1.0,
            growth: (1.0 - without) * period / BACK,
            last: None,
            unchanged: 0,
            stuck: (STUCK / period).round() as u64,
        })
    }

    /// Takes in a sample of an axis at `speed` m/s.
    pub fn update(&mut self, sample: Option<&AxisSample>, speed: f64) -> Damping {
        let pressures = sample.and_then(AxisSample::pressures);
        let is_same = pressures.is_some() && pressures == self.last;
        self.unchanged = if is_same { self.unchanged + u64::from(speed.abs() > MOVES) } else { 0 };
        self.last = pressures;
        let pressures = pressures.filter(|_| self.unchanged < self.stuck);
        let force = self.cylinder.zip(pressures).map(|(cylinder, pressures)| cylinder.force(pressures));
        let Some(force) = force.filter(|force| force.is_finite()) else {
            (self.slow, self.present) = (None, self.without);
            return Damping { speed: 0.0, gain: self.without };
        };
        self.present = (self.present + self.growth).min(1.0);
        let slow = self.slow.get_or_insert(force);
        *slow += self.new * (force - *slow);
        Damping { speed: self.gain * (force - *slow), gain: self.present }
    }
}

/// Part of the gains of the fallback that leaves its gain margin where nothing damps the load.
fn part_without(control: &Control, model: &Commissioned, period: f64) -> f64 {
    let margin = |pressure_damping: f64| {
        let fallback = Control { pressure_damping, law: Law::Predictive, ..*control };
        Loop::new(&fallback, model, mean_slope(model), period).margins().gain
    };
    let part = margin(0.0) / margin(control.pressure_damping);
    if part.is_finite() { part.min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::commissioned};

    const PERIOD: f64 = 0.01;

    /// An axis with transducers whose load swings at 2.5 Hz with a damping ratio of 0.1.
    fn axis(pressure_damping: f64) -> Axis {
        let mut axis = machine(1).axes.remove(0);
        let swinging = Commissioned {
            dead_time: 0.005,
            time_constant: 0.02 + 0.2 / (TAU * 2.5),
            natural_frequency: 2.5,
            damping: 0.1,
            mass: 1e5,
            ..commissioned()
        };
        (axis.commissioned, axis.control.pressure_damping) = (Some(swinging), pressure_damping);
        (axis.control.kp, axis.control.ki) = (4.0, 0.0);
        axis
    }

    /// A sample of a cylinder that pushes with `force` N.
    fn sample(axis: &Axis, force: f64) -> AxisSample {
        let plant = axis.plant.as_ref().unwrap();
        let piston_pressure = (force + 1e6 * plant.rod_area) / plant.piston_area;
        AxisSample { piston_pressure, rod_pressure: 1e6, has_pressures: 1, ..AxisSample::default() }
    }

    /// Largest speed after 4 s of a load on its spring that is let go with 0.1 m/s, m/s, behind a valve with a lag.
    fn left(pressure_damping: f64) -> f64 {
        let axis = axis(pressure_damping);
        let model = axis.commissioned.as_ref().unwrap();
        let mut feedback = PressureFeedback::of(&axis, PERIOD);
        let (w, step) = (TAU * model.natural_frequency, 1e-4);
        let (mut speed, mut acceleration, mut valve, mut wanted, mut largest) = (0.1, 0.0, 0.0, 0.0, 0.0f64);
        for k in 0..50_000 {
            if k % 100 == 0 {
                // Its weight shows in the pressures, too.
                let force = 3e5 + model.mass * acceleration;
                wanted = -feedback.as_mut().map_or(0.0, |of| of.update(Some(&sample(&axis, force)), speed).speed);
            }
            valve += (wanted - valve) * step / 0.02;
            acceleration += (w * (valve - speed) - 2.0 * model.damping * acceleration) * w * step;
            speed += acceleration * step;
            largest = if k > 40_000 { largest.max(speed.abs()) } else { largest };
        }
        largest
    }

    #[test]
    fn loads_that_swing_behind_fast_valves_are_damped() {
        let model = |time_constant: f64, natural_frequency: f64, mass: f64| {
            let swinging = Commissioned { natural_frequency, damping: 0.1, mass, dead_time: 0.002, ..commissioned() };
            Commissioned { time_constant: time_constant + swinging.swing_delay(), ..swinging }
        };
        assert_eq!(ratio(&model(0.015, 2.5, 1e5), PERIOD), RATIO);
        assert_eq!(ratio(&model(0.06, 2.5, 1e5), PERIOD), LATE_RATIO);
        for undamped in [model(0.2, 2.5, 1e5), model(0.015, 0.0, 1e5), model(0.015, 2.5, f64::INFINITY)] {
            assert_eq!(ratio(&undamped, PERIOD), 0.0);
        }
    }

    #[test]
    fn a_swing_dies_by_the_damping_that_is_asked_for() {
        // exp(-zeta w t) is 0.0019 without feedback, and 1e-8 with 0.2 more and the lag of the valve.
        let (without, with) = (left(0.0), left(0.2));
        assert!((without / 0.1 - 0.0019).abs() < 0.0005, "{without}");
        assert!(with < 0.02 * without, "{with}");
    }

    #[test]
    fn a_load_that_stands_is_no_swing_and_without_readings_the_gains_are_those_of_its_margin() {
        let axis = axis(0.3);
        let mut feedback = PressureFeedback::of(&axis, PERIOD).unwrap();
        for _ in 0..500 {
            feedback.update(Some(&sample(&axis, 3e5)), 0.0);
        }
        let steady = feedback.update(Some(&sample(&axis, 3e5)), 0.0);
        assert!(steady.speed.abs() < 1e-6 && steady.gain == 1.0, "{steady:?}");
        let silent = AxisSample::default();
        for lost in [None, Some(&silent), Some(&sample(&axis, f64::NAN))] {
            let Damping { speed, gain } = feedback.update(lost, 0.0);
            assert!(speed == 0.0 && gain > 0.1 && gain < 0.6, "{speed} {gain}");
            let control = Control { kp: gain * axis.control.kp, pressure_damping: 0.0, ..axis.control };
            let model = axis.commissioned.as_ref().unwrap();
            let margin = |control: &Control| {
                Loop::new(&Control { law: Law::Predictive, ..*control }, model, mean_slope(model), PERIOD)
                    .margins()
                    .gain
            };
            assert!((margin(&control) / margin(&axis.control) - 1.0).abs() < 0.01);
        }
        // When they are back, the weight is no swing, and the gains come back within a second.
        let back = |feedback: &mut PressureFeedback, k: usize| {
            let Damping { speed, gain } = feedback.update(Some(&sample(&axis, 4e5 + k as f64)), 0.1);
            assert!(speed.abs() < 1e-3, "{speed}");
            gain
        };
        let gains: Vec<f64> = (0..150).map(|k| back(&mut feedback, k)).collect();
        assert!(gains[0] < 0.65 && gains[50] < 0.9 && gains.is_sorted() && gains[101] == 1.0, "{gains:?}");
    }

    #[test]
    fn readings_that_stay_the_same_in_motion_are_none() {
        let axis = axis(0.3);
        let mut feedback = PressureFeedback::of(&axis, PERIOD).unwrap();
        let mut gain = |force: f64, speed: f64| feedback.update(Some(&sample(&axis, force)), speed).gain;
        assert!((0..500).all(|_| gain(3e5, 0.0) == 1.0), "a load that stands");
        assert!((0..49).all(|_| gain(3e5, 0.1) == 1.0));
        assert!((0..200).all(|_| gain(3e5, -0.1) < 0.6));
        assert!((0..101).map(|k| gain(3e5 + f64::from(k), 0.1)).last() == Some(1.0));
    }

    #[test]
    fn an_axis_without_it_and_a_comparison_without_it_are_not_damped() {
        assert_eq!(PressureFeedback::of(&axis(0.0), PERIOD), None);
        let mut without = axis(0.3);
        without.control.without.damping = true;
        let damping = PressureFeedback::of(&without, PERIOD).unwrap().update(Some(&sample(&without, 3e5)), 0.0);
        assert!(damping.speed == 0.0 && damping.gain < 1.0, "{damping:?}");
    }
}
