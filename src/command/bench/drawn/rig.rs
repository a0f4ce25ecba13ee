//! Machines drawn at random: a test rig of one axis each, with a valve, a cylinder, a load and an encoder.
//!
//! ```text
//! v_e^2 = k^2 (p_s A_1 - p_0 A_2 - F - F_f) / (A_1^3 + A_2^3)        k = rated_flow / sqrt(rated_pressure_drop)
//! v_r^2 = k^2 (p_s A_2 - p_0 A_1 + F - F_f) / (A_1^3 + A_2^3)
//! ```
//!
//! v_e and v_r speeds m/s of the fully open valve extending and retracting; p_s and p_0 pressures of pump and return
//! line Pa; A_1 and A_2 areas of piston and rod side m2; F load N against extension; F_f friction N. Source: the flow
//! through both edges of the valve at the balance of forces of a piston in steady motion.
//!
//! What a data sheet says is drawn ([`Rig`]): the ranges are the constants here. What an engineer would choose for such
//! a machine follows from it: [`Rig::speeds`] and `machine_file`.
//!
//! Every machine has a generator of random numbers of its own, whose stream is the machine's number. Machine 7 of a
//! seed is therefore the same machine in a set of 10 and in a set of 300.
//!
//! Trap: the number of draws before a value is a part of what the value depends on. A new draw belongs at the end.

use std::ops::RangeInclusive;

use pipeline::machine::{DeadBand, Parameter};
use rand_pcg::{Pcg64, rand_core::Rng};

/// Bandwidth of the valve, Hz.
pub const VALVE_BANDWIDTH: RangeInclusive<f64> = 2.0..=50.0;
/// Dead time, s.
pub const DEAD_TIME: RangeInclusive<f64> = 5e-3..=0.5;
/// Control period, s; a whole number of milliseconds.
pub const PERIOD: RangeInclusive<f64> = 1e-3..=50e-3;
/// Dead band of either direction.
pub const DEAD_BAND: RangeInclusive<f64> = 0.0..=0.4;
/// Hysteresis of the valve, in parts of the full command.
pub const HYSTERESIS: RangeInclusive<f64> = 0.0..=0.05;
/// Length of a count of the encoder, m.
pub const RESOLUTION: RangeInclusive<f64> = 10e-6..=1e-3;
/// Moved mass in kg for each newton that the cylinder pushes with: a factor of 30. With [`STROKE`] the load swings on
/// its oil with 3 to 35 Hz.
pub const SPECIFIC_MASS: RangeInclusive<f64> = 0.01..=0.3;
/// Load in the middle of the stroke, as a part of the force that the cylinder has against it. Even the heaviest load
/// with the weakest supply of a [`PlantChange`] leaves a third of the force for motion.
pub const LOAD: RangeInclusive<f64> = -0.3..=0.3;
/// Change of the load from the middle to the ends of the stroke, as a part of the load.
pub const LOAD_SLOPE: RangeInclusive<f64> = -0.2..=0.2;
/// Part of the command between dead band and full opening of an S-shaped curve, as a part of what the dead band leaves.
pub const S_SPAN: RangeInclusive<f64> = 0.6..=1.0;
/// Time in which the slower direction goes over the whole stroke with the valve fully open, s.
pub const TRAVEL_TIME: RangeInclusive<f64> = 1.2..=6.0;
/// Travel of the piston, m.
pub const STROKE: RangeInclusive<f64> = 0.4..=1.6;
/// Bore of the cylinder, m.
pub const BORE: RangeInclusive<f64> = 0.063..=0.16;
/// Area of the rod side as a part of that of the piston side.
pub const AREA_RATIO: RangeInclusive<f64> = 0.45..=0.75;
/// Pressure of the pump, Pa.
pub const PRESSURE: RangeInclusive<f64> = 15e6..=30e6;
/// Coulomb friction as a part of the force of the cylinder's weaker direction.
pub const COULOMB: RangeInclusive<f64> = 0.005..=0.05;
/// Static friction as a multiple of Coulomb friction.
pub const STATIC: RangeInclusive<f64> = 1.1..=2.0;
/// Viscous friction at the speed of the slower direction, as a part of the force of the cylinder's weaker direction.
pub const VISCOUS: RangeInclusive<f64> = 0.01..=0.06;
/// When the plant begins to change, s.
pub const CHANGE_START: RangeInclusive<f64> = 14.0..=16.0;
/// How long the plant changes, s.
pub const CHANGE_LENGTH: RangeInclusive<f64> = 0.0..=2.0;

/// Pressure of the return line, Pa.
pub const RETURN_PRESSURE: f64 = 3e5;

/// What is drawn of one machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// Number of the machine, from 0.
    pub number: u64,
    /// ms.
    pub period_ms: u64,
    /// Hz.
    pub valve_bandwidth: f64,
    /// s.
    pub dead_time: f64,
    /// Of the valve.
    pub dead_band: DeadBand,
    /// Spool positions from which on the valve is fully open; less than 1 on an S-shaped curve only.
    pub saturation: DeadBand,
    /// Whether the valve opens along an S.
    pub is_s_shaped: bool,
    /// Of the valve.
    pub hysteresis: f64,
    /// m per count.
    pub resolution: f64,
    /// kg/N.
    pub specific_mass: f64,
    /// Part of the force against the load.
    pub load: f64,
    /// Part of the load.
    pub load_slope: f64,
    /// Of the slower direction with the valve fully open, m/s.
    pub speed: f64,
    /// m.
    pub stroke: f64,
    /// m.
    pub bore: f64,
    /// Rod side by piston side.
    pub area_ratio: f64,
    /// Pa.
    pub pressure: f64,
    /// Part of the force of the weaker direction.
    pub coulomb: f64,
    /// Times Coulomb friction.
    pub static_ratio: f64,
    /// Part of the force of the weaker direction.
    pub viscous: f64,
    /// What changes while the machine works.
    pub change: PlantChange,
}

/// The change of the plant while the machine works.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantChange {
    /// What it is, in one word.
    pub name: &'static str,
    /// Parameters and the factors or values that they go to.
    pub changes: Vec<(Parameter, f64)>,
    /// s.
    pub start: f64,
    /// s.
    pub end: f64,
}

/// A stream of random numbers.
pub struct Draw(Pcg64);

impl Draw {
    /// Numbers that are thrown away at the beginning: neighbouring streams of the generator begin alike.
    const WARM_UP: usize = 16;

    /// Stream number `number` of this seed.
    pub fn new(seed: u64, number: u64) -> Self {
        let mut generator = Pcg64::new(seed.into(), number.into());
        (0..Self::WARM_UP).for_each(|_| {
            generator.next_u64();
        });
        Self(generator)
    }

    /// From 0 to 1, of 53 random bits.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Evenly in the range.
    pub fn even(&mut self, range: RangeInclusive<f64>) -> f64 {
        range.start() + (range.end() - range.start()) * self.unit()
    }

    /// Evenly in the logarithm.
    pub fn log(&mut self, range: RangeInclusive<f64>) -> f64 {
        (range.start() * (range.end() / range.start()).powf(self.unit())).clamp(*range.start(), *range.end())
    }
}

impl Rig {
    /// Machine number `number` of the set with this seed.
    pub fn draw(seed: u64, number: u64) -> Self {
        let mut draw = Draw::new(seed, number);
        let period_ms = (1e3 * draw.log(PERIOD)).round() as u64;
        let valve_bandwidth = draw.log(VALVE_BANDWIDTH);
        let dead_time = draw.log(DEAD_TIME);
        let dead_band = DeadBand { extend: draw.even(DEAD_BAND), retract: draw.even(DEAD_BAND) };
        let is_s_shaped = draw.unit() < 0.5;
        let mut saturated = |dead_band: f64| {
            let span = draw.even(S_SPAN);
            if is_s_shaped { dead_band + span * (1.0 - dead_band) } else { 1.0 }
        };
        let saturation = DeadBand { extend: saturated(dead_band.extend), retract: saturated(dead_band.retract) };
        let stroke = draw.log(STROKE);
        Self {
            number,
            period_ms,
            valve_bandwidth,
            dead_time,
            dead_band,
            saturation,
            is_s_shaped,
            hysteresis: draw.even(HYSTERESIS),
            resolution: draw.log(RESOLUTION),
            specific_mass: draw.log(SPECIFIC_MASS),
            load: draw.even(LOAD),
            load_slope: draw.even(LOAD_SLOPE),
            speed: stroke / draw.log(TRAVEL_TIME),
            stroke,
            bore: draw.log(BORE),
            area_ratio: draw.even(AREA_RATIO),
            pressure: draw.even(PRESSURE),
            coulomb: draw.log(COULOMB),
            static_ratio: draw.even(STATIC),
            viscous: draw.even(VISCOUS),
            change: PlantChange::draw(&mut draw),
        }
    }

    /// s.
    pub fn period(&self) -> f64 {
        1e-3 * self.period_ms as f64
    }

    /// tau_v, s.
    pub fn valve_time_constant(&self) -> f64 {
        1.0 / (std::f64::consts::TAU * self.valve_bandwidth)
    }

    /// Time from a command to most of its motion, s: dead time, valve and period.
    pub fn reaction(&self) -> f64 {
        self.dead_time + self.valve_time_constant() + self.period()
    }

    /// A_1 and A_2, m2.
    pub fn areas(&self) -> (f64, f64) {
        let piston = 0.25 * std::f64::consts::PI * self.bore * self.bore;
        (piston, self.area_ratio * piston)
    }

    /// Forces at standstill with which the cylinder extends and retracts, N.
    pub fn forces(&self) -> (f64, f64) {
        let (piston, rod) = self.areas();
        (self.pressure * piston - RETURN_PRESSURE * rod, self.pressure * rod - RETURN_PRESSURE * piston)
    }

    /// Force of the weaker direction, N.
    pub fn weaker_force(&self) -> f64 {
        self.forces().0.min(self.forces().1)
    }

    /// Moved mass, kg.
    pub fn mass(&self) -> f64 {
        self.specific_mass * self.forces().0
    }

    /// F at the position 0, in the middle and at full stroke, N.
    pub fn loads(&self) -> [f64; 3] {
        let against = if self.load > 0.0 { self.forces().0 } else { self.forces().1 };
        [1.0 - self.load_slope, 1.0, 1.0 + self.load_slope].map(|part| part * self.load * against)
    }

    /// F_c, N.
    pub fn coulomb_friction(&self) -> f64 {
        self.coulomb * self.weaker_force()
    }

    /// B_p, N s/m.
    pub fn viscous_friction(&self) -> f64 {
        self.viscous * self.weaker_force() / self.speed
    }

    /// k of a valve with which the slower direction reaches [`Rig::speed`] at its largest load, m3/(s Pa^(1/2)).
    pub fn valve_gain(&self) -> f64 {
        let [extend, retract] = self.moving_forces();
        let (piston, rod) = self.areas();
        self.speed * ((piston.powi(3) + rod.powi(3)) / extend.min(retract)).sqrt()
    }

    /// v_e and v_r at the load that is the largest for each, m/s.
    pub fn speeds(&self) -> [f64; 2] {
        let (piston, rod) = self.areas();
        self.moving_forces().map(|force| self.valve_gain() * (force / (piston.powi(3) + rod.powi(3))).sqrt())
    }

    /// What is left of the forces for the flow, extending and retracting, N.
    fn moving_forces(&self) -> [f64; 2] {
        let friction = self.coulomb_friction() + self.viscous_friction() * self.speed;
        let (extend, retract) = self.forces();
        let [most, least] = self.loads().iter().fold([f64::MIN, f64::MAX], |[h, l], load| [h.max(*load), l.min(*load)]);
        [extend - most - friction, retract + least - friction]
    }
}

impl PlantChange {
    /// Changes, each with the range of the factors or values that it goes to; the first value of each is drawn.
    fn draw(draw: &mut Draw) -> Self {
        use Parameter::{
            DeadBand, FlowGain, Friction, Leakage, LoadForce, Mass, PumpFlow, SupplyPressure, Temperature,
        };
        let kind = ((draw.unit() * 6.0) as usize).min(5);
        let part = draw.unit();
        let at = |low: f64, high: f64| low + (high - low) * part;
        let (name, changes) = match kind {
            0 => ("payload", vec![(Mass, at(1.3, 2.0)), (LoadForce, at(1.2, 1.5))]),
            1 => ("dead-band", vec![(DeadBand, at(0.75, 1.3))]),
            2 => ("temperature", vec![(Temperature, at(20.0, 70.0))]),
            3 => ("supply", vec![(SupplyPressure, at(0.75, 0.95)), (PumpFlow, at(0.8, 1.0))]),
            4 => ("flow", vec![(FlowGain, at(0.75, 1.25))]),
            _ => ("wear", vec![(Friction, at(0.6, 1.6)), (Leakage, at(1.0, 5.0))]),
        };
        let start = draw.even(CHANGE_START);
        Self { name, changes, start, end: start + draw.even(CHANGE_LENGTH) }
    }
}
