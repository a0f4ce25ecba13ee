//! The simulated axis: `[axis.NAME.plant]`.

use super::{
    dead_band::DeadBand,
    ports::Ports,
    sensor_errors::{SensorErrors, Sensors},
};
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
    /// m, moved mass, referred to the cylinder, kg; 0 where the mechanism gives it.
    pub mass: f64,
    /// F_L, force of the load against extension; 0 where the mechanism gives it.
    pub load_force: LoadForce,
    /// K, load elasticity about the middle of the stroke, N/m.
    pub load_stiffness: f64,
    /// B_p, sigma_2, viscous friction, N s/m.
    pub viscous_friction: f64,
    /// F_c, friction at speed, N.
    pub coulomb_friction: f64,
    /// F_s, friction at which motion begins, N.
    pub static_friction: f64,
    /// v_s, speed over which friction falls from static to Coulomb, m/s.
    pub stribeck_speed: f64,
    /// sigma_0, stiffness of the bristles, N/m.
    pub bristle_stiffness: f64,
    /// sigma_1, damping of the bristles, N s/m.
    pub bristle_damping: f64,
    /// C_ip, leakage between the chambers, m3/(s Pa).
    pub internal_leakage: f64,
    /// C_ep, leakage out of each chamber, m3/(s Pa).
    pub external_leakage: f64,
    /// Pressure at which the relief valve of a chamber opens, Pa.
    pub relief_pressure: f64,
    /// Flow of one fully open control edge at `rated_pressure_drop`, m3/s.
    pub rated_flow: f64,
    /// Pressure drop over one control edge at `rated_flow`, Pa.
    pub rated_pressure_drop: f64,
    /// How the valve opens between dead band and saturation.
    pub valve_curve: ValveCurve,
    /// Spool positions up to which the valve stays shut.
    pub dead_band: DeadBand,
    /// Spool positions from which on the valve is fully open.
    pub saturation: DeadBand,
    /// Width of the valve's hysteresis, in parts of the full command.
    pub hysteresis: f64,
    /// tau_v, time constant of the valve, s.
    pub valve_time_constant: f64,
    /// Time from a command to the first reaction of the valve, s.
    pub dead_time: f64,
    /// Valves and hoses between spool and cylinder.
    pub ports: Ports,
    /// Stiffness of the end stops, N/m.
    pub end_stop_stiffness: f64,
    /// Damping of the end stops, N s/m.
    pub end_stop_damping: f64,
    /// What the sensors do beyond their resolution.
    pub sensor_errors: SensorErrors,
}

/// Force of the load against extension, N, at three positions, with a parabola between them.
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
    /// A force that does not depend on the position, N.
    pub const fn constant(force: f64) -> Self {
        Self { retracted: force, middle: force, extended: force }
    }
}

/// How a valve opens between dead band and saturation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValveCurve {
    /// In proportion to the command, as a spool with position feedback does.
    Linear,
    /// Along an S, as the notched spool of a pilot-operated valve does.
    S,
}

/// Default of the presliding F_s/sigma_0, m.
const PRESLIDING: f64 = 2e-4;

/// Least part of the command between dead band and saturation.
const LEAST_SPAN: f64 = 0.05;

/// Largest ratio of static to Coulomb friction.
const LARGEST_STICTION: f64 = 10.0;

impl Plant {
    /// `is_carried` says that the mechanism gives mass and load of this axis.
    pub(super) fn read(mut section: Section, stroke: f64, is_carried: bool, sensors: Sensors) -> Self {
        let (mass, load_force, load_stiffness) = read_load(&mut section, is_carried);
        let friction = Friction::read(&mut section);
        let valve = Valve::read(&mut section);
        let ports = Ports::read(&mut section);
        let leakage =
            |section: &mut Section, key, meaning| section.key(key, meaning).number_or(0.0, 0.0..=1e-9, "m3/(s Pa)");
        let number = |section: &mut Section, key, meaning, range, unit| section.key(key, meaning).number(range, unit);
        let end_stop = section.key("end_stop_stiffness", "Stiffness of the end stops");
        let end_stop_stiffness = end_stop.number_or(2e8, 1e5..=1e9, "N/m");
        let end_stop = section.key("end_stop_damping", "Damping of the end stops");
        let end_stop_damping = end_stop.number_or(4e6, 0.0..=1e7, "N s/m");
        let plant = Self {
            initial_position: section
                .key("initial_position", "Position at the start")
                .allows("a number from 0 to the stroke")
                .number(0.0..=stroke, "m"),
            piston_area: number(&mut section, "piston_area", "A_1, area of the piston side", 1e-5..=1.0, "m2"),
            rod_area: number(&mut section, "rod_area", "A_2, area of the rod side", 1e-5..=1.0, "m2"),
            piston_dead_volume: section
                .key("piston_dead_volume", "V_01, volume of the piston side at position 0")
                .number(1e-5..=1.0, "m3"),
            rod_dead_volume: section
                .key("rod_dead_volume", "V_02, volume of the rod side at full stroke")
                .number(1e-5..=1.0, "m3"),
            mass,
            load_force,
            load_stiffness,
            viscous_friction: friction.viscous,
            coulomb_friction: friction.coulomb,
            static_friction: friction.breakaway,
            stribeck_speed: friction.stribeck_speed,
            bristle_stiffness: friction.bristle_stiffness,
            bristle_damping: friction.bristle_damping,
            internal_leakage: leakage(&mut section, "internal_leakage", "C_ip, leakage between the chambers"),
            external_leakage: leakage(&mut section, "external_leakage", "C_ep, leakage out of each chamber"),
            relief_pressure: section
                .key("relief_pressure", "Pressure that opens the relief valve of a chamber")
                .number_or(35e6, 1e6..=1e8, "Pa"),
            rated_flow: valve.rated_flow,
            rated_pressure_drop: valve.rated_pressure_drop,
            valve_curve: valve.curve,
            dead_band: valve.dead_band,
            saturation: valve.saturation,
            hysteresis: valve.hysteresis,
            valve_time_constant: valve.time_constant,
            dead_time: valve.dead_time,
            ports,
            end_stop_stiffness,
            end_stop_damping,
            sensor_errors: SensorErrors::read(&mut section, sensors),
        };
        section.finish();
        plant
    }
}

/// Mass in kg, force of the load, and its stiffness in N/m; none of them where the mechanism gives them.
fn read_load(section: &mut Section, is_carried: bool) -> (f64, LoadForce, f64) {
    if is_carried {
        for key in ["mass", "load_force", "load_stiffness"] {
            section.forbid(key, "no such key here: [mechanism] says what this axis moves");
        }
        return (0.0, LoadForce::constant(0.0), 0.0);
    }
    let mass = section.key("mass", "Moved mass, referred to the cylinder; not with [mechanism], as the next two keys");
    let mass = mass.number(1.0..=1e6, "kg");
    let load_force = LoadForce::read(section);
    let stiffness = section.key("load_stiffness", "K, load elasticity about the middle of the stroke");
    (mass, load_force, stiffness.number_or(0.0, 0.0..=1e8, "N/m"))
}

/// The keys of friction.
struct Friction {
    viscous: f64,
    coulomb: f64,
    /// Static friction.
    breakaway: f64,
    stribeck_speed: f64,
    bristle_stiffness: f64,
    bristle_damping: f64,
}

impl Friction {
    fn read(section: &mut Section) -> Self {
        let coulomb = section.key("coulomb_friction", "F_c, friction at speed").number(0.0..=1e6, "N");
        let breakaway = section
            .key("static_friction", "F_s, friction at which motion begins")
            .allows("a number from coulomb_friction to 10 times it")
            .number(0.0..=1e6, "N");
        if !(coulomb..=LARGEST_STICTION * coulomb).contains(&breakaway) {
            let allowed = format!("a number from coulomb_friction, {coulomb} N, to {LARGEST_STICTION} times it");
            section.refuse("static_friction", breakaway.to_string(), allowed);
        }
        let viscous = section.key("viscous_friction", "B_p, viscous friction").number(0.0..=1e7, "N s/m");
        let bristle_damping = section
            .key("bristle_damping", "sigma_1, damping of the bristles of LuGre friction")
            .allows("0 to viscous_friction coulomb_friction/(static_friction - coulomb_friction)")
            .number_or(0.0, 0.0..=1e7, "N s/m");
        // More damping makes LuGre friction a source of energy (Barabanov and Ortega, 2000).
        if bristle_damping * (breakaway - coulomb) > viscous * coulomb {
            let most = viscous * coulomb / (breakaway - coulomb);
            let allowed = format!(
                "up to {most} N s/m, viscous_friction coulomb_friction/(static_friction - coulomb_friction): more \
                 would make friction a source of energy"
            );
            section.refuse("bristle_damping", bristle_damping.to_string(), allowed);
        }
        Self {
            viscous,
            coulomb,
            breakaway,
            stribeck_speed: section
                .key("stribeck_speed", "v_s, speed over which friction falls from static to Coulomb")
                .number(1e-4..=1.0, "m/s"),
            bristle_stiffness: section
                .key("bristle_stiffness", "sigma_0, stiffness of the bristles of LuGre friction")
                .rule("static_friction divided by 0.2 mm")
                .number_or(breakaway / PRESLIDING, 0.0..=1e10, "N/m"),
            bristle_damping,
        }
    }
}

/// The keys of the valve.
struct Valve {
    dead_band: DeadBand,
    saturation: DeadBand,
    rated_flow: f64,
    rated_pressure_drop: f64,
    curve: ValveCurve,
    hysteresis: f64,
    time_constant: f64,
    dead_time: f64,
}

impl Valve {
    fn read(section: &mut Section) -> Self {
        let (dead_band, saturation) = read_span(section);
        let curves = [("linear", ValveCurve::Linear), ("s", ValveCurve::S)];
        Self {
            dead_band,
            saturation,
            rated_flow: section
                .key("rated_flow", "Flow of one fully open control edge at rated_pressure_drop")
                .number(1e-6..=1.0, "m3/s"),
            rated_pressure_drop: section
                .key("rated_pressure_drop", "Pressure drop over one control edge at rated_flow")
                .number(1e4..=1e8, "Pa"),
            curve: section
                .key("valve_curve", "How the valve opens between dead band and saturation: in proportion, or as an S")
                .choice_or(ValveCurve::Linear, &curves),
            hysteresis: section
                .key("hysteresis", "Width of the valve's hysteresis, in parts of the full command")
                .number_or(0.0, 0.0..=0.2, ""),
            time_constant: section
                .key("valve_time_constant", "tau_v, time constant of the valve")
                .number(1e-3..=10.0, "s"),
            dead_time: section
                .key("dead_time", "Time from a command to the first reaction of the valve")
                .number(0.0..=1.0, "s"),
        }
    }
}

/// Dead band and saturation, between which the valve opens.
fn read_span(section: &mut Section) -> (DeadBand, DeadBand) {
    let dead = "Spool position up to which the valve stays shut";
    let open = "Spool position from which on the valve is fully open";
    let dead_band = DeadBand {
        extend: section.key("dead_band_extend", dead).number(0.0..=0.9, ""),
        retract: section.key("dead_band_retract", dead).number(0.0..=0.9, ""),
    };
    let mut saturation = |key, dead_band: f64| {
        let saturation = section.key(key, open).allows("a number from the dead band plus 0.05 to 1").number_or(
            1.0,
            LEAST_SPAN..=1.0,
            "",
        );
        if saturation < dead_band + LEAST_SPAN {
            let allowed = format!("a number from {} (the dead band and {LEAST_SPAN}) to 1", dead_band + LEAST_SPAN);
            section.refuse(key, saturation.to_string(), allowed);
        }
        saturation
    };
    let saturation = DeadBand {
        extend: saturation("saturation_extend", dead_band.extend),
        retract: saturation("saturation_retract", dead_band.retract),
    };
    (dead_band, saturation)
}

impl LoadForce {
    /// One number, or three.
    fn read(section: &mut Section) -> Self {
        let [retracted, middle, extended] = section
            .key("load_force", "F_L, force of the load against extension: one number, or three along the stroke")
            .number_or_three(-1e7..=1e7, "N", "[retracted, middle, extended]");
        Self { retracted, middle, extended }
    }
}
