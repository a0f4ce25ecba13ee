//! What follows from the answers: areas, valve, friction, limits, gains and a reference.
//!
//! ```text
//! F_e = p_s A_1 - p_0 A_2      F_r = p_s A_2 - p_0 A_1                    forces at standstill
//! k   = v sqrt((A_1^3 + A_2^3)/min(F_e - F - F_f, F_r + F - F_f))         rated_flow = k sqrt(1 MPa)
//! w   = sqrt(beta (A_1^2/V_1 + A_2^2/V_2)/m)                              swing of the load on its oil
//! kp  = min(0.3/t_r, 0.1 w)/v                                             gain of the fallback
//! ```
//!
//! A_1 and A_2 areas of piston and rod side m2; p_s and p_0 pressures of pump and return line Pa; F load against
//! extension N, F_f friction N; v largest speed of the slower direction m/s; V_1 and V_2 volumes of the chambers in the
//! middle of the stroke m3; beta bulk modulus Pa; m mass kg; t_r time from a command to its motion s: dead time, lag of
//! the valve and a period. The flow passes two edges of the valve at the balance of forces of a piston in steady
//! motion.
//!
//! Trap: the gain is for a machine that nobody has measured. Commissioning finds a better one.

use std::f64::consts::{PI, TAU};

use super::quantity::{DIGITS, significant, significant_or_more};

/// Pressure of the return line, Pa.
pub const RETURN_PRESSURE: f64 = 3e5;
/// Pressure drop at which the flow of the valve is stated, Pa.
pub const RATED_DROP: f64 = 1e6;
/// Bulk modulus of the oil without air, Pa.
pub const BULK_MODULUS: f64 = 1.4e9;
/// Static friction as a multiple of Coulomb friction.
const STATIC: f64 = 1.5;
/// Coulomb friction, and viscous friction at the largest speed, as parts of the force of the weaker direction.
const FRICTION: (f64, f64) = (0.02, 0.03);
/// Part of the viscous friction for the bristles: with twice of it friction would become a source of energy.
const BRISTLE_DAMPING: f64 = 0.8;
/// Leakage past the piston for a metre of its bore, m3/(s Pa): it goes through a gap as long as the circumference. A
/// bore of 115 mm leaks 2e-13, as those of the built-in machine do.
const LEAKAGE: f64 = 1.75e-12;
/// Volumes of hoses and ports: as a part of the displacement, as a length of the cylinder m, and the least of them m3.
const DEAD_VOLUME: (f64, f64, f64) = (0.1, 0.02, 1e-5);
/// Part of the stroke between an end stop and its soft limit.
const MARGIN: f64 = 0.05;
/// Part of the largest speed that the reference asks for. Commissioning measures the axis up to about a quarter of it.
const REFERENCE_SPEED: f64 = 0.2;
/// Part of the force of the weaker direction with which the reference accelerates the mass.
const REFERENCE_FORCE: f64 = 0.1;
/// Part of the travel between the soft limits that the reference uses on either side of the middle.
const REFERENCE_REACH: f64 = 0.3;
/// Least frequency of the reference, Hz: its first seconds are what a model is learned from.
const SLOWEST: f64 = 0.1;
/// The second sine of the reference: its amplitude and its frequency, as multiples of those of the first.
pub const SECOND: (f64, f64) = (1.0 / 3.0, 2.7);

/// One axis: what was asked for, SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    pub name: String,
    pub stroke: f64,
    pub bore: f64,
    pub rod: f64,
    /// Hz.
    pub valve_hz: f64,
    pub dead_time: f64,
    /// v.
    pub speed: f64,
    pub mass: f64,
    /// F.
    pub load: f64,
    /// Part of the command.
    pub dead_band: f64,
    /// m per count.
    pub resolution: f64,
    /// p_s.
    pub pressure: f64,
    /// Of the control.
    pub period: f64,
}

impl Rig {
    /// A_1 and A_2, m2.
    pub fn areas(&self) -> (f64, f64) {
        let circle = |diameter: f64| 0.25 * PI * diameter * diameter;
        (circle(self.bore), circle(self.bore) - circle(self.rod))
    }

    /// F_e and F_r, N.
    pub fn forces(&self) -> (f64, f64) {
        let (piston, rod) = self.areas();
        (self.pressure * piston - RETURN_PRESSURE * rod, self.pressure * rod - RETURN_PRESSURE * piston)
    }

    fn weaker_force(&self) -> f64 {
        self.forces().0.min(self.forces().1)
    }

    /// Volumes of both sides that the piston does not displace, m3.
    pub fn dead_volumes(&self) -> (f64, f64) {
        let (piston, rod) = self.areas();
        let (part, length, least) = DEAD_VOLUME;
        let volume = |area: f64| (area * length.max(part * self.stroke)).max(least);
        (volume(piston), volume(rod))
    }

    /// tau_v, s.
    pub fn valve_time_constant(&self) -> f64 {
        1.0 / (TAU * self.valve_hz)
    }

    /// t_r, s.
    pub fn reaction(&self) -> f64 {
        self.dead_time + self.valve_time_constant() + self.period
    }

    /// F_c, N.
    pub fn coulomb_friction(&self) -> f64 {
        FRICTION.0 * self.weaker_force()
    }

    /// F_s, N.
    pub fn static_friction(&self) -> f64 {
        STATIC * self.coulomb_friction()
    }

    /// B_p, N s/m.
    pub fn viscous_friction(&self) -> f64 {
        FRICTION.1 * self.weaker_force() / self.speed
    }

    /// sigma_1, N s/m.
    pub fn bristle_damping(&self) -> f64 {
        BRISTLE_DAMPING * self.viscous_friction()
    }

    /// C_ip, m3/(s Pa).
    pub fn internal_leakage(&self) -> f64 {
        LEAKAGE * self.bore
    }

    /// What is left of the forces for the flow, extending and retracting, N.
    fn moving_forces(&self) -> [f64; 2] {
        let friction = (FRICTION.0 + FRICTION.1) * self.weaker_force();
        let (extend, retract) = self.forces();
        [extend - self.load - friction, retract + self.load - friction]
    }

    /// Flow of an open edge at [`RATED_DROP`], m3/s.
    pub fn rated_flow(&self) -> f64 {
        let [extend, retract] = self.moving_forces();
        let (piston, rod) = self.areas();
        self.speed * ((piston.powi(3) + rod.powi(3)) / extend.min(retract)).sqrt() * RATED_DROP.sqrt()
    }

    /// Speed of the faster direction with the valve fully open, m/s.
    pub fn fastest(&self) -> f64 {
        let [extend, retract] = self.moving_forces();
        self.speed * (extend.max(retract) / extend.min(retract)).sqrt()
    }

    /// Speed from which on a position signal is not believed, m/s.
    pub fn max_speed(&self) -> f64 {
        significant(1.5 * self.fastest(), 2)
    }

    /// Oil that the axis takes at most, m3/s.
    pub fn largest_flow(&self) -> f64 {
        self.areas().0 * self.fastest()
    }

    /// w, 1/s.
    fn swing(&self) -> f64 {
        let ((piston, rod), (at_piston, at_rod)) = (self.areas(), self.dead_volumes());
        let spring = |area: f64, dead: f64| area * area / (dead + 0.5 * area * self.stroke);
        (BULK_MODULUS * (spring(piston, at_piston) + spring(rod, at_rod)) / self.mass).sqrt()
    }

    /// kp v, 1/s.
    fn loop_gain(&self) -> f64 {
        (0.3 / self.reaction()).min(0.1 * self.swing())
    }

    /// kp, 1/m.
    pub fn kp(&self) -> f64 {
        self.loop_gain() / self.speed
    }

    /// Largest following error, m.
    pub fn following_error(&self) -> f64 {
        (0.05 * self.stroke).max(0.03).max(1.5 * REFERENCE_SPEED * self.speed / self.loop_gain())
    }

    /// How far outside the stroke a position is believed, m.
    pub fn tolerance(&self) -> f64 {
        (5.0 * self.resolution).max(5e-3)
    }

    /// Following error at which the axis rests, m: 2 counts, a quarter of a millimetre at the least.
    pub fn rest_band(&self) -> f64 {
        significant_or_more(2.0 * self.resolution, DIGITS).max(0.25e-3)
    }

    /// Soft limits, m.
    pub fn soft_limits(&self) -> (f64, f64) {
        (MARGIN * self.stroke, (1.0 - MARGIN) * self.stroke)
    }

    /// Stiffness N/m and damping N s/m of the end stops: less for a light load, which would bounce too fast for the
    /// simulation.
    pub fn end_stops(&self) -> (f64, f64) {
        (2e8_f64.min(1e6 * self.mass), 4e6_f64.min(2e3 * self.mass))
    }

    /// Samples from a command to motion.
    pub fn delay(&self) -> usize {
        (self.dead_time / self.period).ceil() as usize + 1
    }

    /// Amplitude m and frequency Hz of the first sine of the reference.
    pub fn reference(&self) -> (f64, f64) {
        let (amplitude, faster) = SECOND;
        let (low, high) = self.soft_limits();
        let reach = REFERENCE_REACH * (high - low) / (1.0 + amplitude);
        let wide = REFERENCE_SPEED * self.speed / (TAU * reach * (1.0 + amplitude * faster));
        let quickest = (0.06 / self.reaction()).clamp(SLOWEST, 0.4);
        let frequency = significant(wide.clamp(SLOWEST, quickest), 2);
        // Near a soft limit the axis may not go faster than the soft stop can stop it.
        let speed =
            (REFERENCE_SPEED * self.speed).min(0.5 * (high - low)) / (TAU * frequency * (1.0 + amplitude * faster));
        let acceleration = REFERENCE_FORCE * self.weaker_force() / self.mass;
        let force = acceleration / ((TAU * frequency).powi(2) * (1.0 + amplitude * faster * faster));
        (reach.min(speed).min(force), frequency)
    }
}
