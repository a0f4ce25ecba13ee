//! What a machine's valve block has beyond the control edges of one spool: keys of `[axis.NAME.plant]`, all off without
//! them.

use crate::machine::document::Section;

/// One number for each direction of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Directions {
    /// While the rod extends.
    pub extend: f64,
    /// While the rod retracts.
    pub retract: f64,
}

impl Directions {
    /// One number that holds for both directions.
    pub const fn both(value: f64) -> Self {
        Self { extend: value, retract: value }
    }
}

/// Valves and hoses between spool and cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ports {
    /// Opening of the edge that drains, divided by that of the edge that feeds.
    pub meter_out: Directions,
    /// Opening of the edge from the chamber that drains to the chamber that is fed, divided by that of the edge that
    /// feeds.
    pub regeneration: Directions,
    /// Pressure of the chamber that drains at which its counterbalance valve opens without pilot pressure, Pa; 0
    /// without that valve.
    pub counterbalance: Directions,
    /// Pilot ratio of the counterbalance valves: by how much more the pressure of the fed chamber opens them.
    pub pilot_ratio: f64,
    /// Leakage of the spool from each chamber to the return line, m3/(s Pa).
    pub spool_leakage: f64,
    /// Which chambers have a valve that keeps their oil from the spool's leakage.
    pub load_holding: LoadHolding,
    /// Volume of the hose at the piston side, m3.
    pub piston_hose_volume: f64,
    /// Volume of the hose at the rod side, m3.
    pub rod_hose_volume: f64,
    /// Pressure that would widen a hose by its volume, Pa.
    pub hose_modulus: f64,
}

/// Chambers with a load-holding valve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoadHolding {
    /// No chamber.
    None,
    /// The piston side.
    Piston,
    /// The rod side.
    Rod,
    /// Both sides.
    Both,
}

impl LoadHolding {
    /// Whether piston side and rod side have the valve.
    pub fn sides(self) -> [bool; 2] {
        [matches!(self, Self::Piston | Self::Both), matches!(self, Self::Rod | Self::Both)]
    }
}

impl Ports {
    /// One spool and nothing else.
    pub const NONE: Self = Self {
        meter_out: Directions::both(1.0),
        regeneration: Directions::both(0.0),
        counterbalance: Directions::both(0.0),
        pilot_ratio: 0.5,
        spool_leakage: 0.0,
        load_holding: LoadHolding::None,
        piston_hose_volume: 0.0,
        rod_hose_volume: 0.0,
        hose_modulus: 1e9,
    };

    pub(super) fn read(section: &mut Section) -> Self {
        let none = Self::NONE;
        let drains = "Opening of the edge that drains the cylinder, divided by that of the edge that feeds it";
        let regenerates = "Opening of the edge, with its check valve, from the draining to the fed chamber, divided by \
                           that of the edge that feeds";
        let balances = "Pressure in the draining chamber that opens its counterbalance valve alone, above that of the \
                        largest load; 0 without that valve";
        let mut factor = |key, meaning, default, range| section.key(key, meaning).number_or(default, range, "");
        let meter_out = Directions {
            extend: factor("meter_out_extend", drains, none.meter_out.extend, 0.01..=2.0),
            retract: factor("meter_out_retract", drains, none.meter_out.retract, 0.01..=2.0),
        };
        let regeneration = Directions {
            extend: factor("regeneration_extend", regenerates, none.regeneration.extend, 0.0..=2.0),
            retract: factor("regeneration_retract", regenerates, none.regeneration.retract, 0.0..=2.0),
        };
        let mut pressure = |key| section.key(key, balances).number_or(0.0, 0.0..=1e8, "Pa");
        let counterbalance =
            Directions { extend: pressure("counterbalance_extend"), retract: pressure("counterbalance_retract") };
        let held = [
            ("none", LoadHolding::None),
            ("piston", LoadHolding::Piston),
            ("rod", LoadHolding::Rod),
            ("both", LoadHolding::Both),
        ];
        let mut volume = |key, meaning| section.key(key, meaning).number_or(0.0, 0.0..=1.0, "m3");
        let (piston_hose_volume, rod_hose_volume) = (
            volume("piston_hose_volume", "Volume of the hose between valve and piston side"),
            volume("rod_hose_volume", "Volume of the hose between valve and rod side"),
        );
        Self {
            meter_out,
            regeneration,
            counterbalance,
            pilot_ratio: section
                .key("pilot_ratio", "By how much more the pressure of the fed chamber opens a counterbalance valve")
                .number_or(none.pilot_ratio, 0.1..=20.0, ""),
            spool_leakage: section
                .key("spool_leakage", "Leakage of the spool from each chamber to the return line")
                .number_or(none.spool_leakage, 0.0..=1e-9, "m3/(s Pa)"),
            load_holding: section
                .key("load_holding", "Chambers with a valve that keeps the leakage of the spool from them")
                .choice_or(none.load_holding, &held),
            piston_hose_volume,
            rod_hose_volume,
            hose_modulus: section
                .key("hose_modulus", "Pressure that would widen a hose by its volume, if it could")
                .number_or(none.hose_modulus, 1e8..=1e12, "Pa"),
        }
    }
}
