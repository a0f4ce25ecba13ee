//! Models of the machine file and of `--model` that were measured on another machine.

use pipeline::machine::{Axis, Machine};

/// One problem for each axis of a real machine whose model was measured on another machine, or on a simulated one.
pub fn refused(machine: &Machine) -> Vec<String> {
    if machine.source.is_real() {
        foreign(machine, "leave this model out of the run, and measure its own")
    } else {
        Vec::new()
    }
}

/// One warning for each axis of a simulated machine whose model was measured on another one.
pub fn doubtful(machine: &Machine) -> Vec<String> {
    if machine.source.is_real() { Vec::new() } else { foreign(machine, "measure its own") }
}

fn foreign(machine: &Machine, what_to_do: &str) -> Vec<String> {
    let line = |axis: &Axis| {
        let (name, found, here) = (&axis.name, axis.foreign_machine()?, &axis.hardware.text);
        Some(format!(
            "axis.{name}.commissioned.measured_on: found \"{found}\", and this machine is \"{here}\": {what_to_do} \
             with `hydraxis commission`"
        ))
    };
    machine.axes.iter().filter_map(line).collect()
}

/// One note for each axis whose model does not say what it was measured on.
pub fn unknown(machine: &Machine) -> Vec<String> {
    let axes = machine.axes.iter().filter(|axis| axis.commissioned.is_some() && axis.measured_on.is_none());
    let note = |name| format!("axis.{name}.commissioned.measured_on: found nothing, so the machine is not compared");
    axes.map(|axis| note(&axis.name)).collect()
}
