//! Pump and oil, which all simulated axes share: `[supply]` and `[oil]`.

use super::document::Section;

/// The simulated machine's pump and oil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hydraulics {
    /// The pump.
    pub supply: Supply,
    /// The oil.
    pub oil: Oil,
}

/// One pump for all axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supply {
    /// How the pump's pressure is controlled.
    pub kind: SupplyKind,
    /// Largest pressure of the pump, Pa; the only one of a constant-pressure pump.
    pub pressure: f64,
    /// p_0, pressure of the return line, Pa.
    pub return_pressure: f64,
    /// Largest flow of the pump, m3/s.
    pub flow: f64,
    /// Largest power of the pump, W; `None` without a limit.
    pub power: Option<f64>,
}

/// How the pressure of a pump is controlled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SupplyKind {
    /// The pump holds its pressure, and every valve gets all of it.
    ConstantPressure,
    /// The pump follows the highest pressure of the chambers that it feeds, and a pressure compensator before every
    /// spool keeps the drop over the spool's edge at `rated_pressure_drop`.
    LoadSensing {
        /// Pressure of the pump above the highest pressure of the chambers, Pa.
        margin: f64,
        /// Time constant with which the pump's pressure follows, s.
        response_time: f64,
    },
}

impl SupplyKind {
    /// Time constant with which the pump follows the load, s; 0 for one that holds its pressure.
    pub fn response(self) -> f64 {
        match self {
            Self::ConstantPressure => 0.0,
            Self::LoadSensing { response_time, .. } => response_time,
        }
    }
}

/// The oil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oil {
    /// beta, bulk modulus of the oil without air, Pa.
    pub bulk_modulus: f64,
    /// Part of the volume at atmospheric pressure that is undissolved air.
    pub air: f64,
    /// Temperature for which friction, leakage and time constants of the file hold, degrees Celsius.
    pub temperature: f64,
    /// Kinematic viscosity at 40 and at 100 degrees Celsius, mm2/s.
    pub viscosity: (f64, f64),
}

impl Hydraulics {
    /// Reads both tables; `None` when no axis is simulated and neither table is given.
    pub(super) fn read(supply: Section, oil: Section, is_simulated: bool) -> Option<Self> {
        let wanted = is_simulated || supply.is_given() || oil.is_given();
        wanted.then(|| Self { supply: Supply::read(supply), oil: Oil::read(oil) })
    }
}

impl Supply {
    fn read(mut section: Section) -> Self {
        let is_load_sensing = section
            .key("kind", "How the pump's pressure is controlled: constant, or a margin above the highest load")
            .choice_or(false, &[("constant-pressure", false), ("load-sensing", true)]);
        let pressure = section
            .key("pressure", "Supply pressure while the flow suffices; the largest one of a load-sensing pump")
            .number(1e5..=1e8, "Pa");
        let return_pressure =
            section.key("return_pressure", "Pressure of the return line").number_or(0.0, 0.0..=1e7, "Pa");
        let flow = section
            .key("flow", "Largest flow of the pump; short of flow, all axes get the same part of their demand")
            .number(1e-6..=10.0, "m3/s");
        let power = section
            .key("power", "Largest power of the pump; short of power, all axes get the same part of their demand")
            .optional_number(1.0..=1e7, "W");
        let kind = if is_load_sensing { SupplyKind::read(&mut section) } else { SupplyKind::ConstantPressure };
        let least = match kind {
            SupplyKind::ConstantPressure => 0.0,
            SupplyKind::LoadSensing { margin, .. } => margin,
        };
        if least >= pressure {
            let allowed = format!("more than {} Pa, margin and return_pressure together", least + return_pressure);
            section.refuse("pressure", pressure.to_string(), allowed);
        } else if return_pressure + least >= pressure {
            section.refuse(
                "return_pressure",
                return_pressure.to_string(),
                format!("less than {} Pa", pressure - least),
            );
        }
        section.finish();
        Self { kind, pressure, return_pressure, flow, power }
    }
}

impl SupplyKind {
    fn read(section: &mut Section) -> Self {
        Self::LoadSensing {
            margin: section
                .key("margin", "Pressure of the pump above the highest load, with kind = \"load-sensing\"")
                .number_or(2e6, 1e5..=1e7, "Pa"),
            response_time: section
                .key(
                    "response_time",
                    "Time constant of the pump's pressure, with kind = \"load-sensing\"; valves come to the edge of \
                     their dead band twice as long before a motion, up to 0.3 s",
                )
                .number_or(0.1, 5e-3..=5.0, "s"),
        }
    }
}

impl Oil {
    fn read(mut section: Section) -> Self {
        let allowed = "[at 40, at 100 degrees Celsius], falling, from 1 to 10000 mm2/s";
        let viscosity = section
            .key("viscosity", "Kinematic viscosity of the oil at 40 and at 100 degrees Celsius")
            .rule("[46.0, 6.8], an HM 46 oil")
            .optional_numbers(1.0..=1e4, "mm2/s", allowed);
        let viscosity = match viscosity.as_deref() {
            None => HM_46,
            Some([at_40, at_100]) if at_40 > at_100 => (*at_40, *at_100),
            Some(other) => {
                section.refuse("viscosity", format!("{other:?}"), allowed);
                HM_46
            }
        };
        let oil = Self {
            bulk_modulus: section.key("bulk_modulus", "Bulk modulus of the oil without air").number(1e8..=5e9, "Pa"),
            air: section.key("air", "Part of the volume at atmospheric pressure that is undissolved air").number_or(
                0.01,
                2e-3..=0.3,
                "",
            ),
            temperature: section
                .key("temperature", "Oil temperature at which friction, leakage and time constants of the file hold")
                .number_or(50.0, -40.0..=120.0, "degrees Celsius"),
            viscosity,
        };
        section.finish();
        oil
    }
}

/// Viscosity of an HM 46 at 40 and at 100 degrees Celsius, mm2/s: the first is what the grade means (ISO 3448), the
/// second is that of an ordinary mineral oil of this grade.
const HM_46: (f64, f64) = (46.0, 6.8);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{LoadHolding, Machine, MachineError, Ports};

    fn with(settings: &[(&str, &str)]) -> Result<Machine, MachineError> {
        let settings: Vec<_> = settings.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        Machine::four_axes(&settings)
    }

    #[test]
    fn a_pump_holds_its_pressure_unless_it_is_load_sensing() {
        let supply = |machine: Machine| machine.hydraulics.unwrap().supply;
        let constant = supply(with(&[]).unwrap());
        assert_eq!((constant.kind, constant.power), (SupplyKind::ConstantPressure, None));
        let chosen = [("supply.kind", "load-sensing"), ("supply.power", "110e3")];
        let found = supply(with(&chosen).unwrap());
        let kind = SupplyKind::LoadSensing { margin: 2e6, response_time: 0.1 };
        assert_eq!(found, Supply { kind, power: Some(110e3), ..constant });
    }

    #[test]
    fn the_controllers_of_all_axes_know_how_fast_a_load_sensing_pump_follows() {
        let responses = |settings| -> Vec<f64> {
            with(settings).unwrap().axes.iter().map(|axis| axis.control.pump_response).collect()
        };
        assert_eq!(responses(&[]), [0.0; 4]);
        assert_eq!(responses(&[("supply.kind", "load-sensing"), ("supply.response_time", "0.2")]), [0.2; 4]);
    }

    #[test]
    fn a_margin_belongs_to_a_load_sensing_pump_and_fits_below_its_pressure() {
        let refused = |settings| with(settings).unwrap_err().to_string();
        let text = refused(&[("supply.margin", "1e6")]);
        assert!(text.contains("supply.margin: found an unknown key"), "{text}");
        let text = refused(&[("supply.kind", "load-sensing"), ("supply.pressure", "2.2e6")]);
        assert!(text.contains("supply.return_pressure: found 300000; allowed: less than 200000 Pa"), "{text}");
        let text = refused(&[("supply.kind", "load-sensing"), ("supply.pressure", "1e6")]);
        let expected = "supply.pressure: found 1000000 (from the command line); allowed: more than 2300000 Pa, margin";
        assert!(text.contains(expected) && text.lines().count() == 1, "{text}");
    }

    #[test]
    fn a_valve_is_one_spool_without_the_keys_of_its_block() {
        let ports = |machine: Machine| machine.axes[0].plant.clone().unwrap().ports;
        assert_eq!(ports(with(&[]).unwrap()), Ports::NONE);
        let chosen = [("axis.boom.plant.load_holding", "piston"), ("axis.boom.plant.meter_out_retract", "0.4")];
        let found = ports(with(&chosen).unwrap());
        assert_eq!((found.load_holding.sides(), found.meter_out.retract), ([true, false], 0.4));
        assert_eq!(LoadHolding::Both.sides(), [true, true]);
    }
}
