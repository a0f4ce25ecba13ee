//! Models of the machine file and of `--model` that were measured on another machine.

use pipeline::machine::{Axis, Machine};

/// One warning for each axis whose model was measured on another machine than this one.
pub fn foreign(machine: &Machine) -> Vec<String> {
    let warning = |axis: &Axis| {
        let (name, found, here) = (&axis.name, axis.foreign_machine()?, &axis.hardware.text);
        Some(format!(
            "axis.{name}.commissioned.measured_on: found \"{found}\", and this machine is \"{here}\": `hydraxis \
             commission` measures its model"
        ))
    };
    machine.axes.iter().filter_map(warning).collect()
}

/// One note for each axis whose model does not say what it was measured on.
pub fn unknown(machine: &Machine) -> Vec<String> {
    let axes = machine.axes.iter().filter(|axis| axis.commissioned.is_some() && axis.measured_on.is_none());
    let note = |name| format!("axis.{name}.commissioned.measured_on: found nothing, so the machine is not compared");
    axes.map(|axis| note(&axis.name)).collect()
}
