//! What in the samples keeps axes from being armed or released, and what to do.

use std::fmt::Write;

use pipeline::{
    MAX_AXES,
    channel::GroupMachine,
    message::{EncoderSample, bit_names, sample_fault},
};

/// Counts the samples that no axis can be armed with.
#[derive(Debug, Default)]
pub struct Obstacles {
    samples: u64,
    /// Whether the emergency stop is pressed in the last sample.
    is_pressed: bool,
    /// Unusable samples of each axis, and the [`sample_fault`] bits of them all.
    axes: [(u64, u32); MAX_AXES],
}

impl Obstacles {
    /// Takes in a sample.
    pub fn see(&mut self, sample: &EncoderSample) {
        self.samples += 1;
        self.is_pressed = sample.emergency_stop != 0;
        for ((count, faults), axis) in self.axes.iter_mut().zip(&sample.axes) {
            if axis.usable().is_none() {
                *count += 1;
                *faults |= axis.faults;
            }
        }
    }

    /// In words; empty where every sample was usable.
    pub fn text(&self, machine: &GroupMachine) -> String {
        if self.is_pressed {
            return "; the emergency stop is pressed: release it, then type the command again".to_owned();
        }
        let mut text = String::new();
        for (axis, (count, faults)) in self.axes.iter().take(machine.axis_count as usize).enumerate() {
            if *count == 0 {
                continue;
            }
            let names: Vec<&str> = bit_names(*faults, &sample_fault::NAMES).collect();
            let samples = match *count {
                all if all == self.samples => "its samples are".to_owned(),
                some => format!("{some} of {} samples were", self.samples),
            };
            let _ = write!(
                text,
                "\naxis.{}: {samples} {}: look at its sensor, its valve, or the device that `hydraxis run` names",
                machine.name(axis),
                names.join(", ")
            );
        }
        text
    }
}
