//! The simulated axis: `[axis.NAME.plant]`.

use super::dead_band::DeadBand;
use crate::machine::document::Section;

/// Parameters of one simulated axis, SI units; the symbols are the paper's, and LuGre's for friction.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// Position at start, m.
    pub initial_position: f64,
    /// A_1, piston side, m2.
    pub piston_area: f64,
    /// A_2, rod side, m2.
    pub rod_area: f64,
    /// V_01, piston side at position 0, m3.
    pub piston_dead_volume: f64,
    /// V_02, rod side at full stroke, m3.
    pub rod_dead_volume: f64,
    /// m, referred to the cylinder, kg.
    pub mass: f64,
    /// F_L.
    pub load_force: LoadForce,
    /// K, load elasticity about the middle of the stroke, N/m.
    pub load_stiffness: f64,
    /// B_p, sigma_2, N s/m.
    pub viscous_friction: f64,
    /// F_c, friction at speed, N.
    pub coulomb_friction: f64,
    /// F_s, friction at which motion begins, N.
    pub static_friction: f64,
    /// v_s, speed over which friction falls from static to Coulomb, m/s.
    pub stribeck_speed: f64,
    /// sigma_0, N/m.
    pub bristle_stiffness: f64,
    /// sigma_1, N s/m.
    pub bristle_damping: f64,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: f64,
    /// C_ep, m3/(s Pa).
    pub external_leakage: f64,
    /// Pressure at which the relief valve of a chamber opens, Pa.
    pub relief_pressure: f64,
    /// Flow of one control edge, fully open, at `rated_pressure_drop`, m3/s.
    pub rated_flow: f64,
    /// Pa.
    pub rated_pressure_drop: f64,
    /// From spool position to opening.
    pub valve_curve: ValveCurve,
    /// Spool positions up to which the valve stays shut.
    pub dead_band: DeadBand,
    /// Spool positions from which on it is fully open.
    pub saturation: DeadBand,
    /// Width of the valve's hysteresis, in parts of the full command.
    pub hysteresis: f64,
    /// tau_v, s.
    pub valve_time_constant: f64,
    /// From command to the valve's first reaction, s.
    pub dead_time: f64,
    /// N/m.
    pub end_stop_stiffness: f64,
    /// N s/m.
    pub end_stop_damping: f64,
    /// Standard deviation of the encoder's noise, m.
    pub encoder_noise: f64,
}

/// Force of the load against extension, N, at three positions; a parabola between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadForce {
    /// At position 0.
    pub retracted: f64,
    /// In the middle of the stroke.
    pub middle: f64,
    /// At full stroke.
    pub extended: f64,
}

impl LoadForce {
    /// The same force everywhere, N.
    pub const fn constant(force: f64) -> Self {
        Self { retracted: force, middle: force, extended: force }
    }
}

/// How a valve opens between dead band and saturation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValveCurve {
    /// In proportion: a spool with position feedback.
    Linear,
    /// As an S: the notched spool of a pilot-operated valve.
    S,
}

/// Presliding, m, of an axis whose bristle stiffness is not given: F_s/sigma_0.
const PRESLIDING: f64 = 2e-4;

/// Least part of the command between dead band and saturation.
const LEAST_SPAN: f64 = 0.05;

/// Largest ratio of static to Coulomb friction.
const LARGEST_STICTION: f64 = 10.0;

impl Plant {
    pub(super) fn read(mut section: Section, stroke: f64) -> Self {
        let dead_band = DeadBand {
            extend: section.number("dead_band_extend", 0.0..=0.9, ""),
            retract: section.number("dead_band_retract", 0.0..=0.9, ""),
        };
        let saturation = DeadBand {
            extend: section.number_or("saturation_extend", 1.0, LEAST_SPAN..=1.0, ""),
            retract: section.number_or("saturation_retract", 1.0, LEAST_SPAN..=1.0, ""),
        };
        for (key, saturation, dead_band) in [
            ("saturation_extend", saturation.extend, dead_band.extend),
            ("saturation_retract", saturation.retract, dead_band.retract),
        ] {
            if saturation < dead_band + LEAST_SPAN {
                let allowed = format!("a number from {} (the dead band and {LEAST_SPAN}) to 1", dead_band + LEAST_SPAN);
                section.refuse(key, saturation.to_string(), allowed);
            }
        }
        let coulomb_friction = section.number("coulomb_friction", 0.0..=1e6, "N");
        let static_friction = section.number("static_friction", 0.0..=1e6, "N");
        if !(coulomb_friction..=LARGEST_STICTION * coulomb_friction).contains(&static_friction) {
            let allowed =
                format!("a number from coulomb_friction, {coulomb_friction} N, to {LARGEST_STICTION} times it");
            section.refuse("static_friction", static_friction.to_string(), allowed);
        }
        let viscous_friction = section.number("viscous_friction", 0.0..=1e7, "N s/m");
        let bristle_damping = section.number_or("bristle_damping", 0.0, 0.0..=1e7, "N s/m");
        // More makes LuGre friction a source of energy (Barabanov and Ortega, 2000).
        if bristle_damping * (static_friction - coulomb_friction) > viscous_friction * coulomb_friction {
            let most = viscous_friction * coulomb_friction / (static_friction - coulomb_friction);
            let allowed = format!(
                "up to {most} N s/m, viscous_friction coulomb_friction/(static_friction - coulomb_friction): more would \
                 make friction a source of energy"
            );
            section.refuse("bristle_damping", bristle_damping.to_string(), allowed);
        }
        let curves = [("linear", ValveCurve::Linear), ("s", ValveCurve::S)];
        let plant = Self {
            initial_position: section.number("initial_position", 0.0..=stroke, "m (the stroke)"),
            piston_area: section.number("piston_area", 1e-5..=1.0, "m2"),
            rod_area: section.number("rod_area", 1e-5..=1.0, "m2"),
            piston_dead_volume: section.number("piston_dead_volume", 1e-5..=1.0, "m3"),
            rod_dead_volume: section.number("rod_dead_volume", 1e-5..=1.0, "m3"),
            mass: section.number("mass", 1.0..=1e6, "kg"),
            load_force: LoadForce::read(&mut section),
            load_stiffness: section.number_or("load_stiffness", 0.0, 0.0..=1e8, "N/m"),
            viscous_friction,
            coulomb_friction,
            static_friction,
            stribeck_speed: section.number("stribeck_speed", 1e-4..=1.0, "m/s"),
            bristle_stiffness: section.number_or("bristle_stiffness", static_friction / PRESLIDING, 0.0..=1e10, "N/m"),
            bristle_damping,
            internal_leakage: section.number_or("internal_leakage", 0.0, 0.0..=1e-9, "m3/(s Pa)"),
            external_leakage: section.number_or("external_leakage", 0.0, 0.0..=1e-9, "m3/(s Pa)"),
            relief_pressure: section.number_or("relief_pressure", 35e6, 1e6..=1e8, "Pa"),
            rated_flow: section.number("rated_flow", 1e-6..=1.0, "m3/s"),
            rated_pressure_drop: section.number("rated_pressure_drop", 1e4..=1e8, "Pa"),
            valve_curve: section.choice_or("valve_curve", ValveCurve::Linear, &curves),
            dead_band,
            saturation,
            hysteresis: section.number_or("hysteresis", 0.0, 0.0..=0.2, ""),
            valve_time_constant: section.number("valve_time_constant", 1e-3..=10.0, "s"),
            dead_time: section.number("dead_time", 0.0..=0.5, "s"),
            end_stop_stiffness: section.number_or("end_stop_stiffness", 2e8, 1e5..=1e9, "N/m"),
            end_stop_damping: section.number_or("end_stop_damping", 4e6, 0.0..=1e7, "N s/m"),
            encoder_noise: section.number_or("encoder_noise", 0.0, 0.0..=0.1, "m"),
        };
        section.finish();
        plant
    }
}

impl LoadForce {
    /// One number, or three.
    fn read(section: &mut Section) -> Self {
        let [retracted, middle, extended] =
            section.number_or_three("load_force", -1e7..=1e7, "N", "[retracted, middle, extended]");
        Self { retracted, middle, extended }
    }
}
