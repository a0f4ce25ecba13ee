//! What the model of an axis depends on: period, stroke, and the simulated machine.
//!
//! ```text
//! measured_on = "stroke 1.334 m, period 10ms, machine 5f0c2a91"        of a simulated machine
//! measured_on = "stroke 1.334 m, period 10ms, rig 1b9d77e0"            of a real one
//! ```
//!
//! `hydraxis commission` writes this text into the model file. The text of another machine differs. The number of a
//! simulated machine is a hash (FNV-1a) of the names of the axes and of the values that describe the simulated axis,
//! pump, oil and mechanism, that of a real one a hash of the names and of the machine file's `name`. Only values that
//! are given count, so a new key with a default changes no number. References, controller settings, scenarios and
//! errors of the sensors do not count.
//!
//! A real machine has a twin that is simulated by the same file. The twin takes the models of the real one, but not the
//! other way round: what describes the twin is an estimate.
//!
//! Trap: a user who sets such a value on the command line studies another machine on purpose. Nothing is compared then.

use std::hash::Hasher;

use fnv::FnvHasher;

use super::Axis;
use crate::machine::document::{EffectiveValue, Origin};

/// How the value of `source.kind` of a real machine is shown.
const REAL: [&str; 2] = ["\"external\"", "\"can\""];
/// Keys of the simulated machine that its models do not depend on.
const OTHERS: [&str; 7] = [
    "initial_position",
    "encoder_noise",
    "angle_noise",
    "angle_error",
    "angle_bandwidth",
    "pressure_noise",
    "heaviest",
];

/// What the model of an axis depends on.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Hardware {
    /// The text that `measured_on` of a model file has.
    pub text: String,
    /// The text of the machine of which this one is the twin.
    original: Option<String>,
    /// The text of the twin of this machine.
    twin: Option<String>,
    /// Whether one of the values comes from the command line.
    is_typed: bool,
}

impl Hardware {
    /// Finds it for the axis `name` among the axes `names`, in the values of all tables of the machine file.
    pub(in crate::machine) fn of(values: &[EffectiveValue], names: &[String], name: &str) -> Self {
        let (stroke, period) = (format!("axis.{name}.stroke"), "timing.period");
        let tables = [&format!("axis.{name}.plant."), "supply.", "oil.", "mechanism."];
        let is_other = |key: &str| OTHERS.iter().any(|other| key.ends_with(other));
        let is_machine = |key: &str| tables.iter().any(|table| key.starts_with(table)) && !is_other(key);
        let mut hardware = Self::default();
        let [mut length, mut time] = [String::new(), String::new()];
        let [mut machine, mut rig] = [FnvHasher::default(), FnvHasher::default()];
        machine.write(names.join(" ").as_bytes());
        rig.write(names.join(" ").as_bytes());
        for value in values {
            let (key, shown) = (value.key.as_str(), value.value.as_deref().unwrap_or_default());
            match value.origin {
                Origin::Default | Origin::Derived { .. } => continue,
                _ if key == stroke => length = shown.to_owned(),
                _ if key == period => time = shown.to_owned(),
                _ if key == "name" => {
                    rig.write(format!("\n{shown}").as_bytes());
                    continue;
                }
                _ if is_machine(key) => machine.write(format!("\n{key} {shown}").as_bytes()),
                _ => continue,
            }
            hardware.is_typed |= value.origin == Origin::CommandLine;
        }
        let kind = values.iter().find(|value| value.key == "source.kind");
        let is_real = kind.and_then(|kind| kind.value.as_deref()).is_some_and(|kind| REAL.contains(&kind));
        let text = |kind, number: FnvHasher| {
            format!("stroke {length} m, period {}, {kind} {:08x}", time.trim_matches('"'), number.finish() as u32)
        };
        let simulated = text("machine", machine);
        if is_real {
            (hardware.text, hardware.twin) = (text("rig", rig), Some(simulated));
        } else {
            hardware.text = simulated;
        }
        hardware
    }

    /// That of the twin of this machine.
    pub(in crate::machine) fn into_twin(self) -> Self {
        match self.twin {
            Some(twin) => Self { text: twin, original: Some(self.text), twin: None, ..self },
            None => self,
        }
    }
}

impl Axis {
    /// The machine that the commissioned model was measured on, where it is another one than this.
    pub fn foreign_machine(&self) -> Option<&str> {
        let Hardware { text, original, is_typed, .. } = &self.hardware;
        let is_known = |found: &str| found == text || original.as_deref() == Some(found);
        self.measured_on.as_deref().filter(|found| !is_known(found) && !is_typed)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::machine::{BUILT_IN, BUILT_IN_MODEL, FOUR_AXES, Machine, model_settings_in};

    /// Whether the model of the built-in machine is that of another machine, for the boom of this machine file.
    fn is_foreign(machine: &str, typed: &[(&str, &str)]) -> bool {
        let mut settings = model_settings_in(BUILT_IN_MODEL, "model.toml").unwrap();
        settings.extend(typed.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
        let machine = Machine::parse(machine, "m.toml", Path::new("."), &settings).unwrap();
        machine.axes[0].foreign_machine().is_some()
    }

    #[test]
    fn the_model_of_another_machine_is_recognised() {
        assert!(!is_foreign(BUILT_IN, &[]) && is_foreign(FOUR_AXES, &[]));
        for (from, to, expected) in [
            ("stroke = 1.334 ", "stroke = 1.34 ", true),
            ("period = \"10ms\"", "period = \"20ms\"", true),
            ("dead_time = 0.18 ", "dead_time = 0.2 ", true),
            ("scenario = \"nominal\"", "scenario = \"payload\"", false),
            ("kp = 4.0", "kp = 3.0", false),
            ("initial_position = 0.65", "initial_position = 0.6", false),
            ("encoder_noise = 3e-5", "encoder_noise = 4e-5", false),
        ] {
            assert!(BUILT_IN.contains(from), "{from}");
            assert_eq!(is_foreign(&BUILT_IN.replacen(from, to, 1), &[]), expected, "{to}");
        }
    }

    #[test]
    fn a_twin_takes_the_models_of_the_real_machine_and_not_the_other_way_round() {
        let real = BUILT_IN.replacen("kind = \"sim\"", "kind = \"external\"", 1);
        let text = |machine: &Machine| machine.axes[0].hardware.text.clone();
        let of = |text: &str, measured: &str| {
            let settings = [("axis.boom.commissioned.measured_on".to_owned(), measured.to_owned())];
            let mut all = model_settings_in(BUILT_IN_MODEL, "model.toml").unwrap();
            all.extend(settings);
            Machine::parse(text, "m.toml", Path::new("."), &all).unwrap()
        };
        let rig = text(&of(&real, "\"x\""));
        let twin = text(&of(&real, "\"x\"").into_twin());
        assert!(rig.contains(", rig ") && twin == text(&of(BUILT_IN, "\"x\"")), "{rig} {twin}");
        let is_foreign = |machine: Machine| machine.axes[0].foreign_machine().is_some();
        let [by_rig, by_twin] = [rig, twin].map(|text| format!("\"{text}\""));
        assert!(!is_foreign(of(&real, &by_rig)) && !is_foreign(of(&real, &by_rig).into_twin()));
        assert!(is_foreign(of(&real, &by_twin)) && !is_foreign(of(&real, &by_twin).into_twin()));
        // A simulated machine may play the real one: with the same controllers it is the same group.
        assert_eq!(of(&real, &by_rig).fingerprint(), of(BUILT_IN, &by_rig).fingerprint());
        // Estimates of the twin do not count, the name of the machine does.
        assert!(!is_foreign(of(&real.replacen("dead_time = 0.18 ", "dead_time = 0.2 ", 1), &by_rig)));
        assert!(is_foreign(of(&real.replacen("name = \"", "name = \"other ", 1), &by_rig)));
    }

    #[test]
    fn values_of_the_command_line_are_not_compared() {
        assert!(!is_foreign(FOUR_AXES, &[("axis.boom.plant.dead_time", "0.05")]));
        assert!(is_foreign(FOUR_AXES, &[("axis.boom.plant.encoder_noise", "4e-5"), ("axis.boom.control.kp", "3")]));
    }
}
