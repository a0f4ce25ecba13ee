//! Scenarios: what changes while the simulated machine works.
//!
//! `scenario = "NAME"` chooses one; `[scenarios.NAME]` defines one in the machine file. The built-in scenarios stand in
//! `scenarios.toml`, in the form that a machine file uses.

use std::ops::RangeInclusive;

use mechanism::AXES;

use crate::nearest::did_you_mean;

use super::{
    document::{Document, Section},
    error::MachineError,
};

/// The built-in scenarios.
const BUILT_IN: &str = include_str!("scenarios.toml");

/// Changes of the simulated machine over time, and the commands of an open-loop experiment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scenario {
    /// Name of the scenario, as `--scenario` takes it.
    pub name: String,
    /// What happens, in one line.
    pub summary: String,
    /// What changes, and when.
    pub changes: Vec<Change>,
    /// Commands of an open-loop experiment, the sum of these sines; empty for the closed loop.
    pub commands: Vec<CommandSine>,
}

/// One sine of an open-loop command: amplitude sin(2 pi frequency t + phase).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandSine {
    /// Amplitude, in parts of the full command.
    pub amplitude: f64,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Phase at the start, rad.
    pub phase: f64,
}

/// A parameter that moves linearly to a new value between two times, and stays there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Index of the axis; `None` changes all axes.
    pub axis: Option<usize>,
    /// What changes.
    pub parameter: Parameter,
    /// Time at which the change begins, s.
    pub start: f64,
    /// Time at which the change ends, s; equal to `start` for a step.
    pub end: f64,
    /// The factor or the value at the end; [`Parameter`] says which.
    pub to: f64,
}

/// What a [`Change`] can change. Most parameters change by a factor; factors of one parameter multiply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// `rated_flow`, by a factor.
    FlowGain,
    /// Viscous, Coulomb and static friction and the bristles' stiffness together, by a factor.
    Friction,
    /// `mass`, by a factor.
    Mass,
    /// `load_force`, by a factor.
    LoadForce,
    /// `valve_time_constant`, by a factor.
    ValveTimeConstant,
    /// Both dead bands, by a factor.
    DeadBand,
    /// `hysteresis`, by a factor.
    Hysteresis,
    /// Internal and external leakage and that of the spool, by a factor.
    Leakage,
    /// A force against extension, to a value: a part of supply pressure times piston area.
    ExternalForce,
    /// The pump's largest pressure, by a factor. All axes share this parameter and the ones below.
    SupplyPressure,
    /// The pump's largest flow and its power, by a factor.
    PumpFlow,
    /// The oil's bulk modulus without air, by a factor.
    BulkModulus,
    /// The oil's air, by a factor.
    Air,
    /// The oil's temperature, to a value in degrees Celsius.
    Temperature,
    /// What the bucket of the mechanism carries, to a value in kg.
    Payload,
    /// Strength of the soil at the teeth, to a value: a part of that in the machine file.
    Soil,
}

impl Parameter {
    const NAMES: [(&'static str, Self); 16] = [
        ("flow_gain", Self::FlowGain),
        ("friction", Self::Friction),
        ("mass", Self::Mass),
        ("load_force", Self::LoadForce),
        ("valve_time_constant", Self::ValveTimeConstant),
        ("dead_band", Self::DeadBand),
        ("hysteresis", Self::Hysteresis),
        ("leakage", Self::Leakage),
        ("external_force", Self::ExternalForce),
        ("supply_pressure", Self::SupplyPressure),
        ("pump_flow", Self::PumpFlow),
        ("bulk_modulus", Self::BulkModulus),
        ("air", Self::Air),
        ("temperature", Self::Temperature),
        ("payload", Self::Payload),
        ("soil", Self::Soil),
    ];

    /// All parameters.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::NAMES.into_iter().map(|(_, parameter)| parameter)
    }

    /// Name of the parameter in a machine file.
    pub fn name(self) -> &'static str {
        let (name, _) = Self::NAMES[self as usize];
        name
    }

    /// What a change of the parameter changes, with the bounds that hold after it. Names in backquotes are keys of the
    /// machine file.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::FlowGain => "`rated_flow` of every control edge: the flow at equal openings and pressures",
            Self::Friction => {
                "`viscous_friction`, `coulomb_friction`, `static_friction`, `bristle_stiffness` and `bristle_damping` \
                 together; dry friction stays above 0.000001 N"
            }
            Self::Mass => "`mass`; not of the axes of `[mechanism]`",
            Self::LoadForce => {
                "`load_force` at all positions, without `load_stiffness`; not of the axes of `[mechanism]`"
            }
            Self::ValveTimeConstant => "`valve_time_constant`",
            Self::DeadBand => {
                "`dead_band_extend` and `dead_band_retract`, up to 0.95; saturation stays where it is, but at least \
                 0.05 above the dead band"
            }
            Self::Hysteresis => "`hysteresis`",
            Self::Leakage => "`internal_leakage`, `external_leakage` and `spool_leakage`",
            Self::ExternalForce => {
                "force against extension that is added to the load; 1 is the `pressure` of the supply in the machine \
                 file times `piston_area`"
            }
            Self::SupplyPressure => "`pressure` of the supply",
            Self::PumpFlow => "`flow` and `power` of the supply, as the speed of the engine does",
            Self::BulkModulus => "`bulk_modulus` of the oil, which is that without air",
            Self::Air => "`air` in the oil",
            Self::Temperature => {
                "temperature of the oil: viscous friction is proportional to the viscosity, leakage to its inverse, \
                 the time constant of the valve to its square root"
            }
            Self::Payload => "`mass` of `[mechanism.payload]`, what the bucket carries",
            Self::Soil => {
                "strength of `[soil]` at the teeth: 0 until a scenario sets it, 1 as in the machine file; then no \
                 `external_force` acts on the axes of the mechanism"
            }
        }
    }

    /// What a change of the parameter goes to.
    pub const fn target(self) -> Target {
        match self {
            Self::Temperature => Target::Value(-40.0..=120.0, "degrees Celsius"),
            Self::ExternalForce => Target::Value(-2.0..=2.0, "times supply pressure times piston area"),
            Self::Payload => Target::Value(0.0..=1e4, "kg"),
            Self::Soil => Target::Value(0.0..=5.0, ""),
            _ => Target::Factor(0.05..=20.0),
        }
    }

    /// Whether all axes share the parameter, so that a change names no axis.
    pub fn is_shared(self) -> bool {
        matches!(
            self,
            Self::SupplyPressure
                | Self::PumpFlow
                | Self::BulkModulus
                | Self::Air
                | Self::Temperature
                | Self::Payload
                | Self::Soil
        )
    }

    /// What the machine needs so that the parameter changes something on the axis with this number, or on any axis.
    fn needs(self, machine: &Described, axis: Option<usize>) -> Option<&'static str> {
        let is_coupled = match axis {
            Some(index) => machine.has_mechanism && index < AXES,
            None => machine.has_mechanism && machine.axes.len() <= AXES,
        };
        match self {
            Self::Mass | Self::LoadForce if is_coupled => {
                Some("payload, or an axis whose mass [mechanism] does not give")
            }
            Self::ExternalForce if is_coupled && machine.has_soil => {
                Some("soil, or an axis on whose teeth [soil] does not act")
            }
            Self::Payload if !machine.has_mechanism => Some("payload on a machine with [mechanism] alone"),
            Self::Soil if !machine.has_soil => Some("soil on a machine with [soil] alone"),
            _ => None,
        }
    }
}

/// What a scenario of the machine file has to know of the machine. The built-in scenarios are for machines of all
/// kinds: a parameter that the machine does not have changes nothing there.
pub(super) struct Described<'a> {
    /// Names of the axes.
    pub axes: &'a [String],
    /// Whether the first four axes are those of a mechanism.
    pub has_mechanism: bool,
    /// Whether soil acts on the teeth of the mechanism.
    pub has_soil: bool,
}

/// What a change of a parameter goes to.
#[derive(Debug, Clone, PartialEq)]
pub enum Target {
    /// A factor in this range: key `factor`.
    Factor(RangeInclusive<f64>),
    /// A value in this range, with its unit: key `value`.
    Value(RangeInclusive<f64>, &'static str),
}

impl Scenario {
    /// Name of the default, in which nothing changes.
    pub const NOMINAL: &str = "nominal";

    /// Reads the choice, `scenario`, and the machine's own scenarios. One with the name of a built-in scenario takes
    /// its place.
    pub(super) fn read(root: &mut Section, machine: &Described) -> Self {
        let mut scenarios = Self::built_in();
        let mut table = root.section("scenarios");
        for name in table.names() {
            let section = table.section(&name);
            let own = Self::read_one(&name, section, Some(machine));
            match scenarios.iter_mut().find(|built_in| built_in.name == name) {
                Some(built_in) => *built_in = own,
                None => scenarios.push(own),
            }
        }
        table.finish();
        let choices: Vec<(&str, usize)> =
            scenarios.iter().enumerate().map(|(index, scenario)| (scenario.name.as_str(), index)).collect();
        let nominal = choices.iter().position(|(name, _)| *name == Self::NOMINAL).unwrap_or_default();
        let chosen = root
            .key(
                "scenario",
                "What changes while the simulated machine works: a built-in scenario, or one of [scenarios]",
            )
            .allows("a built-in scenario, or the NAME of a table [scenarios.NAME]")
            .choice_or(nominal, &choices);
        scenarios.swap_remove(chosen)
    }

    /// The built-in scenarios, in the order of their table.
    pub fn built_in() -> Vec<Self> {
        match Self::parse(BUILT_IN) {
            Ok(scenarios) => scenarios,
            // The text is part of the program, and a test reads it.
            Err(error) => unreachable!("{error}"),
        }
    }

    fn parse(text: &str) -> Result<Vec<Self>, MachineError> {
        let document = Document::parse(text, Vec::new());
        let mut root = document.root();
        let names = root.names();
        let scenarios = names.iter().map(|name| Self::read_one(name, root.section(name), None)).collect();
        root.finish();
        document.into_result("scenarios.toml", scenarios)
    }

    fn read_one(name: &str, mut section: Section, machine: Option<&Described>) -> Self {
        let scenario = Self {
            name: name.to_owned(),
            summary: section.key("summary", "What happens in the scenario, in one line").text_or(""),
            changes: section.list("changes").into_iter().filter_map(|item| Change::read(item, machine)).collect(),
            commands: section.list("commands").into_iter().map(CommandSine::read).collect(),
        };
        let reach: f64 = scenario.commands.iter().map(|sine| sine.amplitude).sum();
        if reach > 1.0 {
            section.refuse("commands", format!("amplitudes of {reach} together"), "up to 1, the full command");
        }
        section.finish();
        scenario
    }
}

impl CommandSine {
    fn read(mut section: Section) -> Self {
        let sine = Self {
            amplitude: section
                .key("amplitude", "Amplitude of one sine of an open-loop command, in parts of the full command")
                .number(0.0..=1.0, ""),
            frequency: section
                .key("frequency", "Frequency of one sine of an open-loop command")
                .number(0.0..=1000.0, "Hz"),
            phase: section.key("phase", "Phase at the start of one sine of an open-loop command").number_or(
                0.0,
                -10.0..=10.0,
                "rad",
            ),
        };
        section.finish();
        sine
    }
}

impl Change {
    fn read(mut section: Section, machine: Option<&Described>) -> Option<Self> {
        let parameter = section.key("parameter", "What changes").choice(&Parameter::NAMES);
        let axis =
            section.key("axis", "Axis whose parameter changes; without it the parameter of all axes").optional_text();
        let axes = machine.map_or(&[][..], |machine| machine.axes);
        let axis = axis.and_then(|name| {
            let index = axes.iter().position(|axis| *axis == name);
            if index.is_none() {
                let hint = did_you_mean(&name, axes.iter().map(String::as_str));
                section.refuse("axis", format!("\"{name}\""), format!("one of the axes {}{hint}", axes.join(", ")));
            } else if parameter.is_some_and(Parameter::is_shared) {
                section.refuse("axis", format!("\"{name}\""), "no axis: all axes share this parameter");
            }
            index
        });
        if let (Some(parameter), Some(machine)) = (parameter, machine)
            && let Some(needed) = parameter.needs(machine, axis)
        {
            section.refuse("parameter", format!("\"{}\"", parameter.name()), needed);
        }
        let start = section.key("start", "Time at which the change begins").number(0.0..=1e6, "s");
        let end = section
            .key("end", "Time at which the change ends; equal to start for a step")
            .allows("a number from start to 1000000")
            .number(0.0..=1e6, "s");
        if end < start {
            section.refuse("end", end.to_string(), format!("a time not before start, {start} s"));
        }
        let to = match parameter {
            None => 1.0, // it is not known which key belongs to an unknown parameter
            Some(parameter) => match parameter.target() {
                Target::Factor(range) => {
                    section.key("factor", "Factor of the parameter when the change has ended").number(range, "")
                }
                Target::Value(range, unit) => section
                    .key("value", "Value of the parameter when the change has ended")
                    .allows(
                        "-40 to 120 degrees Celsius, -2 to 2 times supply pressure times piston area, 0 to 10000 kg, \
                         or 0 to 5 times [soil]",
                    )
                    .number(range, unit),
            },
        };
        let parameter = parameter?;
        section.finish();
        Some(Self { axis, parameter, start, end, to })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_scenarios_are_readable_and_told() {
        let scenarios = Scenario::parse(BUILT_IN).unwrap();
        let names: Vec<&str> = scenarios.iter().map(|scenario| scenario.name.as_str()).collect();
        let expected = [
            "nominal",
            "cold-start",
            "payload",
            "aeration",
            "supply-sag",
            "dead-band-drift",
            "valve-wear",
            "everything",
            "digging",
            "open-loop",
        ];
        assert_eq!(names, expected);
        for scenario in &scenarios {
            assert!(!scenario.summary.is_empty(), "{}", scenario.name);
            assert_eq!(scenario.changes.is_empty(), ["nominal", "open-loop"].contains(&scenario.name.as_str()));
            assert_eq!(scenario.commands.is_empty(), scenario.name != "open-loop");
        }
    }
}
