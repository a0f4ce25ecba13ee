//! What changes while the simulated machine works: `scenario = "NAME"`, and own ones as `[scenarios.NAME]`.
//!
//! The built-in ones stand in `scenarios.toml`, in the form that a machine file uses for its own.

use super::{
    document::{Document, Section},
    error::MachineError,
};

/// The built-in scenarios.
const BUILT_IN: &str = include_str!("scenarios.toml");

/// Nothing changes: what runs when nobody says.
const NOMINAL: &str = "nominal";

/// A course of changes, and for an open-loop experiment the commands.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scenario {
    /// What `--scenario` takes.
    pub name: String,
    /// One line for a list.
    pub summary: String,
    /// What changes, and when.
    pub changes: Vec<Change>,
    /// Commands of an open-loop experiment, sines that are added; empty for the closed loop.
    pub commands: Vec<CommandSine>,
}

/// One sine of an open-loop command: amplitude sin(2 pi frequency t + phase).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandSine {
    /// In parts of the full command.
    pub amplitude: f64,
    /// Hz
    pub frequency: f64,
    /// rad
    pub phase: f64,
}

/// A parameter that moves linearly to a new value between two times, and stays there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Index of the axis, all without one.
    pub axis: Option<usize>,
    /// What changes.
    pub parameter: Parameter,
    /// When it begins to, s.
    pub start: f64,
    /// When it has, s; equal to `start` for a step.
    pub end: f64,
    /// A factor, or a value; see [`Parameter`].
    pub to: f64,
}

/// What a [`Change`] can change. Most by a factor, and factors of the same parameter multiply.
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
    /// Internal and external leakage, by a factor.
    Leakage,
    /// A force against extension, to a value: a part of supply pressure times piston area.
    ExternalForce,
    /// The pump's pressure, by a factor; of the whole machine, as all that follow.
    SupplyPressure,
    /// The pump's largest flow, by a factor.
    PumpFlow,
    /// The oil's bulk modulus without air, by a factor.
    BulkModulus,
    /// The oil's air, by a factor.
    Air,
    /// The oil's temperature, to a value in degrees Celsius.
    Temperature,
}

impl Parameter {
    const NAMES: [(&'static str, Self); 14] = [
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
    ];

    /// Every parameter.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::NAMES.into_iter().map(|(_, parameter)| parameter)
    }

    /// Whether all axes share it.
    pub fn is_shared(self) -> bool {
        matches!(self, Self::SupplyPressure | Self::PumpFlow | Self::BulkModulus | Self::Air | Self::Temperature)
    }
}

impl Scenario {
    /// Reads the choice, `scenario`, and the machine's own scenarios.
    pub(super) fn read(root: &mut Section, axes: &[String]) -> Self {
        let mut scenarios = Self::built_in();
        let built_in: Vec<String> = scenarios.iter().map(|scenario| scenario.name.clone()).collect();
        let mut table = root.section("scenarios");
        for name in table.names() {
            let section = table.section(&name);
            if built_in.contains(&name) {
                section.refuse("", "the name of a built-in scenario", "another name");
            }
            scenarios.push(Self::read_one(&name, section, axes));
        }
        table.finish();
        let choices: Vec<(&str, usize)> =
            scenarios.iter().enumerate().map(|(index, scenario)| (scenario.name.as_str(), index)).collect();
        let nominal = choices.iter().position(|(name, _)| *name == NOMINAL).unwrap_or_default();
        let chosen = root.choice_or("scenario", nominal, &choices);
        scenarios.swap_remove(chosen)
    }

    /// The built-in scenarios, in the order of their table.
    pub fn built_in() -> Vec<Self> {
        match Self::parse(BUILT_IN) {
            Ok(scenarios) => scenarios,
            // The text is part of the program; a test reads it.
            Err(error) => unreachable!("{error}"),
        }
    }

    fn parse(text: &str) -> Result<Vec<Self>, MachineError> {
        let document = Document::parse(text, &[]);
        let mut root = document.root();
        let names = root.names();
        let scenarios = names.iter().map(|name| Self::read_one(name, root.section(name), &[])).collect();
        root.finish();
        document.into_result("scenarios.toml", scenarios)
    }

    fn read_one(name: &str, mut section: Section, axes: &[String]) -> Self {
        let scenario = Self {
            name: name.to_owned(),
            summary: section.text_or("summary", ""),
            changes: section.list("changes").into_iter().filter_map(|item| Change::read(item, axes)).collect(),
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
            amplitude: section.number("amplitude", 0.0..=1.0, ""),
            frequency: section.number("frequency", 0.0..=1000.0, "Hz"),
            phase: section.number_or("phase", 0.0, -10.0..=10.0, "rad"),
        };
        section.finish();
        sine
    }
}

impl Change {
    fn read(mut section: Section, axes: &[String]) -> Option<Self> {
        let parameter = section.choice("parameter", &Parameter::NAMES);
        let axis = section.optional_text("axis").and_then(|name| {
            let index = axes.iter().position(|axis| *axis == name);
            if index.is_none() {
                section.refuse("axis", format!("\"{name}\""), format!("one of the axes {}", axes.join(", ")));
            } else if parameter.is_some_and(Parameter::is_shared) {
                section.refuse("axis", format!("\"{name}\""), "no axis: all axes share this parameter");
            }
            index
        });
        let (start, end) = (section.number("start", 0.0..=1e6, "s"), section.number("end", 0.0..=1e6, "s"));
        if end < start {
            section.refuse("end", end.to_string(), format!("a time not before start, {start} s"));
        }
        let to = match parameter {
            None => 1.0, // nobody can say which key belongs to an unknown parameter
            Some(Parameter::Temperature) => section.number("value", -40.0..=120.0, "degrees Celsius"),
            Some(Parameter::ExternalForce) => {
                section.number("value", -2.0..=2.0, "times supply pressure times piston area")
            }
            Some(_) => section.number("factor", 0.05..=20.0, ""),
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
