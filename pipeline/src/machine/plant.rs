//! The simulated axis: `[axis.NAME.plant]`.

use super::{DeadBand, document::Section};

/// Parameters of one simulated axis, SI units; the symbols are the paper's.
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
    /// F_L, positive against extension, N.
    pub load_force: f64,
    /// K, load elasticity about the middle of the stroke, N/m.
    pub load_stiffness: f64,
    /// B_p, N s/m.
    pub viscous_friction: f64,
    /// Friction at speed, N.
    pub coulomb_friction: f64,
    /// Friction at rest, N.
    pub static_friction: f64,
    /// Speed over which friction falls from static to Coulomb, m/s.
    pub stribeck_speed: f64,
    /// p_s, Pa.
    pub supply_pressure: f64,
    /// p_0, Pa.
    pub return_pressure: f64,
    /// beta_e, Pa.
    pub bulk_modulus: f64,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: f64,
    /// C_ep, m3/(s Pa).
    pub external_leakage: f64,
    /// Flow of one control edge, fully open, at `rated_pressure_drop`, m3/s.
    pub rated_flow: f64,
    /// Pa.
    pub rated_pressure_drop: f64,
    /// tau_v, s.
    pub valve_time_constant: f64,
    /// From command to the valve's first reaction, s.
    pub dead_time: f64,
    /// Dead band of the spool.
    pub dead_band: DeadBand,
    /// N/m.
    pub end_stop_stiffness: f64,
    /// N s/m.
    pub end_stop_damping: f64,
    /// Standard deviation of the encoder's noise, m.
    pub encoder_noise: f64,
    /// Parameters that change over time.
    pub schedule: Vec<Schedule>,
}

/// A parameter that moves linearly from 1 to `factor` times its value between two times, and stays there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// What changes.
    pub parameter: Parameter,
    /// When it begins to, s.
    pub start: f64,
    /// When it has, s; equal to `start` for a step.
    pub end: f64,
    /// What its value is multiplied by then.
    pub factor: f64,
}

/// What a [`Schedule`] can change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// `rated_flow`.
    FlowGain,
    /// Viscous, Coulomb and static friction together.
    Friction,
    /// `mass`.
    Mass,
    /// `load_force`.
    LoadForce,
    /// `supply_pressure`.
    SupplyPressure,
    /// `valve_time_constant`.
    ValveTimeConstant,
    /// Both dead bands.
    DeadBand,
    /// `bulk_modulus`.
    BulkModulus,
    /// Internal and external leakage.
    Leakage,
}

impl Parameter {
    const NAMES: [(&'static str, Self); 9] = [
        ("flow_gain", Self::FlowGain),
        ("friction", Self::Friction),
        ("mass", Self::Mass),
        ("load_force", Self::LoadForce),
        ("supply_pressure", Self::SupplyPressure),
        ("valve_time_constant", Self::ValveTimeConstant),
        ("dead_band", Self::DeadBand),
        ("bulk_modulus", Self::BulkModulus),
        ("leakage", Self::Leakage),
    ];
}

impl Plant {
    pub(super) fn read(mut section: Section, stroke: f64) -> Self {
        let extend = section.number("dead_band_extend", 0.0..=0.9, "");
        let retract = section.number("dead_band_retract", 0.0..=0.9, "");
        let plant = Self {
            initial_position: section.number("initial_position", 0.0..=stroke, "m (the stroke)"),
            piston_area: section.number("piston_area", 1e-5..=1.0, "m2"),
            rod_area: section.number("rod_area", 1e-5..=1.0, "m2"),
            piston_dead_volume: section.number("piston_dead_volume", 1e-5..=1.0, "m3"),
            rod_dead_volume: section.number("rod_dead_volume", 1e-5..=1.0, "m3"),
            mass: section.number("mass", 1.0..=1e6, "kg"),
            load_force: section.number("load_force", -1e7..=1e7, "N"),
            load_stiffness: section.number_or("load_stiffness", 0.0, 0.0..=1e8, "N/m"),
            viscous_friction: section.number("viscous_friction", 0.0..=1e7, "N s/m"),
            coulomb_friction: section.number("coulomb_friction", 0.0..=1e6, "N"),
            static_friction: section.number("static_friction", 0.0..=1e6, "N"),
            stribeck_speed: section.number("stribeck_speed", 1e-4..=1.0, "m/s"),
            supply_pressure: section.number("supply_pressure", 1e5..=1e8, "Pa"),
            return_pressure: section.number_or("return_pressure", 0.0, 0.0..=1e7, "Pa"),
            bulk_modulus: section.number("bulk_modulus", 1e7..=5e9, "Pa"),
            internal_leakage: section.number_or("internal_leakage", 0.0, 0.0..=1e-9, "m3/(s Pa)"),
            external_leakage: section.number_or("external_leakage", 0.0, 0.0..=1e-9, "m3/(s Pa)"),
            rated_flow: section.number("rated_flow", 1e-6..=1.0, "m3/s"),
            rated_pressure_drop: section.number("rated_pressure_drop", 1e4..=1e8, "Pa"),
            valve_time_constant: section.number("valve_time_constant", 1e-3..=10.0, "s"),
            dead_time: section.number("dead_time", 0.0..=0.5, "s"),
            dead_band: DeadBand { extend, retract },
            end_stop_stiffness: section.number_or("end_stop_stiffness", 2e8, 1e5..=1e9, "N/m"),
            end_stop_damping: section.number_or("end_stop_damping", 4e6, 0.0..=1e7, "N s/m"),
            encoder_noise: section.number_or("encoder_noise", 0.0, 0.0..=0.1, "m"),
            schedule: section.list("schedule").into_iter().filter_map(Schedule::read).collect(),
        };
        section.finish();
        plant
    }
}

impl Schedule {
    fn read(mut section: Section) -> Option<Self> {
        let parameter = section.choice("parameter", &Parameter::NAMES);
        let (start, end) = (section.number("start", 0.0..=1e6, "s"), section.number("end", 0.0..=1e6, "s"));
        if end < start {
            section.refuse("end", end.to_string(), format!("a time not before start, {start} s"));
        }
        let factor = section.number("factor", 0.05..=20.0, "");
        section.finish();
        Some(Self { parameter: parameter?, start, end, factor })
    }
}
