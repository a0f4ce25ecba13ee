//! The oil: bulk modulus of oil with entrained air, and viscosity.
//!
//! ```text
//! beta_e = (1 + r) / (1/beta + r/(kappa p))        r = alpha (p_a/p)^(1/kappa)
//! log10 log10(nu + 0.7) = a - b log10 T
//! ```
//!
//! beta_e bulk modulus of the mixture at the absolute pressure p, Pa; beta bulk modulus of the oil without air, Pa; r
//! volume of the air divided by the volume of the oil, which is alpha at the atmospheric pressure p_a; kappa = 1.4 for
//! adiabatic compression; nu viscosity at the absolute temperature T K, mm2/s.
//!
//! Sources: beta_e follows from adding the compressibilities of oil and bubbles, weighted by their volumes; no air
//! dissolves. 1 % of air takes six sevenths of the modulus at 5 bar and one tenth at 50 bar. The viscosity is Walther's
//! law (ASTM D341) through two points of a data sheet.
//!
//! Traps: all other modules count pressures from the atmosphere, as a gauge does, but p in these equations is absolute.
//! A chamber that is pulled apart cavitates: its pressure approaches zero, the mixture has almost no stiffness left,
//! and the air fills the space. That space has to be filled with oil before the piston can be pushed back. The pressure
//! represents the cavity down to 100 Pa, where the volume of the air is 139 alpha times that of the oil; the model does
//! not represent a larger cavity.

use crate::lanes::{LANES, Lanes, lanes};

/// p_a, Pa.
pub const ATMOSPHERE: f64 = 101_325.0;

/// kappa of air. The code uses 1/kappa = 5/7 and takes roots of order seven.
pub const ADIABATIC_INDEX: f64 = 1.4;

/// Least pressure above the atmosphere, Pa: about 100 Pa of absolute pressure are left.
pub const LOWEST_PRESSURE: f64 = -0.999 * ATMOSPHERE;

/// Newton steps from the seed, which is within 6 % of the seventh root, to the root's last bits.
const NEWTON_STEPS: usize = 5;

/// 0 degrees Celsius, K.
const FREEZING: f64 = 273.15;

/// Compressible mixture of oil and air.
#[derive(Debug, Clone, Copy)]
pub struct OilMixture<T> {
    /// 1/beta, 1/Pa.
    pub compressibility: T,
    /// alpha.
    pub air: T,
}

impl OilMixture<f64> {
    /// beta_e, Pa, at `pressure` Pa above the atmosphere. For reports: its last bits depend on the computer's library.
    pub fn bulk_modulus(&self, pressure: f64) -> f64 {
        let absolute = pressure.max(LOWEST_PRESSURE) + ATMOSPHERE;
        let air = self.air * (ATMOSPHERE / absolute).powf(1.0 / ADIABATIC_INDEX);
        (1.0 + air) / (self.compressibility + air / (ADIABATIC_INDEX * absolute))
    }
}

impl OilMixture<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[OilMixture<f64>; LANES]) -> Self {
        Self { compressibility: lanes(axes, |oil| oil.compressibility), air: lanes(axes, |oil| oil.air) }
    }

    /// dp/dt = `inflow`/(`volume`/beta_e + `walls`), Pa/s, of a chamber of `volume` m3 at `pressure` Pa above the
    /// atmosphere, whose walls give way by `walls` m3/Pa. `inflow` is the flow of oil into the chamber less the growth
    /// of its volume by the piston, m3/s.
    #[inline]
    pub fn pressure_rate(&self, pressure: Lanes, inflow: Lanes, volume: Lanes, walls: Lanes) -> Lanes {
        let ratio = pressure.fast_max(Lanes::splat(LOWEST_PRESSURE)) * Lanes::splat(1.0 / ATMOSPHERE) + Lanes::ONE;
        // With w = (p/p_a)^(-1/7): r = alpha w^5, and r/(kappa p) = alpha w^12/(kappa p_a).
        let w = inverse_seventh_root(ratio);
        let w2 = w * w;
        let w5 = w2 * w2 * w;
        let air = self.air * w5;
        let compressibility = self.compressibility + air * w5 * w2 * Lanes::splat(1.0 / (ADIABATIC_INDEX * ATMOSPHERE));
        let mixture = Lanes::ONE + air;
        inflow * mixture / (compressibility * volume + walls * mixture)
    }
}

/// x^(-1/7) for x > 0 by Newton's method on w^-7 = x, which needs no division.
#[inline]
fn inverse_seventh_root(x: Lanes) -> Lanes {
    // The bits of a positive number, read as an integer, are about 2^52 (log2 x + 1023). The seed therefore is the
    // number whose bits lie below those of 1 by a seventh of what the bits of x lie above them. 1/7 = 1/8 + 1/64 +
    // 1/512 + ..
    let seed = x.to_array().map(|x| {
        const ONE: u64 = 1.0f64.to_bits();
        let bits = x.to_bits();
        let seventh = (bits >> 3) + (bits >> 6) + (bits >> 9) + (bits >> 12) + (bits >> 15) + (bits >> 18);
        f64::from_bits((ONE + ONE / 7).wrapping_sub(seventh))
    });
    let mut w = Lanes::new(seed);
    for _ in 0..NEWTON_STEPS {
        let w2 = w * w;
        let w4 = w2 * w2;
        w *= Lanes::splat(8.0 / 7.0) - x * Lanes::splat(1.0 / 7.0) * (w4 * w2 * w);
    }
    w
}

/// nu, mm2/s, at `temperature` degrees Celsius of an oil with the viscosities `at_40` and `at_100` mm2/s.
pub fn viscosity((at_40, at_100): (f64, f64), temperature: f64) -> f64 {
    let log_log = |nu: f64| (nu + 0.7).log10().log10();
    let log_kelvin = |celsius: f64| (celsius + FREEZING).log10();
    let slope = (log_log(at_100) - log_log(at_40)) / (log_kelvin(100.0) - log_kelvin(40.0));
    let walther = log_log(at_40) + slope * (log_kelvin(temperature) - log_kelvin(40.0));
    10f64.powf(10f64.powf(walther)) - 0.7
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modulus(bulk_modulus: f64, air: f64, absolute: f64) -> f64 {
        let oil = OilMixture { compressibility: Lanes::splat(1.0 / bulk_modulus), air: Lanes::splat(air) };
        oil.pressure_rate(Lanes::splat(absolute - ATMOSPHERE), Lanes::ONE, Lanes::ONE, Lanes::ZERO).to_array()[0]
    }

    #[test]
    fn the_modulus_follows_the_formula_from_vacuum_to_relief_pressure() {
        for air in [1e-3, 0.01, 0.05, 0.3] {
            for absolute in [2e2, 2e3, 1e4, 5e4, ATMOSPHERE, 5e5, 2e6, 5e6, 2e7, 4e7, 1e8] {
                let r = air * (ATMOSPHERE / absolute).powf(1.0 / 1.4);
                let expected = (1.0 + r) / (1.0 / 1.4e9 + r / (1.4 * absolute));
                let found = modulus(1.4e9, air, absolute);
                assert!((found / expected - 1.0).abs() < 1e-13, "{air} at {absolute}: {found} for {expected}");
                let reported = OilMixture { compressibility: 1.0 / 1.4e9, air }.bulk_modulus(absolute - ATMOSPHERE);
                assert!((reported / expected - 1.0).abs() < 1e-11, "{air} at {absolute}: {reported} for {expected}");
            }
        }
    }

    #[test]
    fn one_percent_of_air_costs_most_of_the_modulus_at_low_pressure() {
        for (air, absolute, expected) in
            [(0.01, 5e5, 0.19), (0.01, 2e6, 0.88), (0.01, 5e6, 1.25), (0.01, 2e7, 1.38), (0.03, 5e5, 0.07)]
        {
            let found = modulus(1.4e9, air, absolute) / 1e9;
            assert!((found - expected).abs() < 0.006, "{air} at {absolute}: {found} for {expected}");
        }
    }

    #[test]
    fn walls_that_give_way_add_their_compliance() {
        let oil = OilMixture { compressibility: Lanes::splat(1.0 / 1.4e9), air: Lanes::splat(0.01) };
        for absolute in [5e5, 2e7] {
            let (volume, walls) = (3e-3, 2e-12);
            let found = oil.pressure_rate(
                Lanes::splat(absolute - ATMOSPHERE),
                Lanes::splat(1e-3),
                Lanes::splat(volume),
                Lanes::splat(walls),
            );
            let expected = 1e-3 / (volume / modulus(1.4e9, 0.01, absolute) + walls);
            assert!((found.to_array()[0] / expected - 1.0).abs() < 1e-13);
        }
    }

    #[test]
    fn the_modulus_is_constant_below_the_lowest_pressure() {
        assert_eq!(modulus(1.4e9, 0.01, -1e9), modulus(1.4e9, 0.01, 0.0));
        assert!(modulus(1.4e9, 0.01, 0.0) > 0.0);
    }

    #[test]
    fn walthers_law_meets_the_data_sheet_and_extrapolates() {
        let hm_46 = (46.0, 6.8);
        assert!((viscosity(hm_46, 40.0) - 46.0).abs() < 1e-9);
        assert!((viscosity(hm_46, 100.0) - 6.8).abs() < 1e-9);
        // The figure that accompanies ISO 3448 shows 500 to 620 mm2/s at 0 degrees for a viscosity index near 100.
        let cold = viscosity(hm_46, 0.0);
        assert!((500.0..620.0).contains(&cold), "{cold}");
        assert!(viscosity(hm_46, -40.0).is_finite() && viscosity(hm_46, 120.0) > 1.0);
    }
}
