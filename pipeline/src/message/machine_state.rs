//! The machine at one glance, for clients that do not follow every tick.

use iceoryx2::prelude::ZeroCopySend;

use super::{AxisCommand, AxisSample, Header, Message, TeethState};
use crate::{MAX_AXES, layout::shared_struct};

shared_struct! {
    /// One axis of a [`MachineState`].
    #[type_name("hydraxis.AxisState/3")]
    pub struct AxisState {
        /// Name of the axis in UTF-8, cut to the length of the array and filled up with zeros.
        pub name: [u8; 32],
        /// Newest sample of the axis.
        pub sample: AxisSample,
        /// Newest command of the axis.
        pub command: AxisCommand,
        /// Forgetting factor of the newest snapshot; 0 before the first snapshot.
        pub forgetting_factor: f64,
        /// Standard deviation of the adaptive model's h-step error, in the unit of the identified output.
        pub h_step_sigma: f64,
        /// Age of the newest snapshot's sample at this heartbeat, ns.
        pub model_age_ns: u64,
        /// Reasons to distrust the model, [`super::model_fault`] bits.
        pub model_faults: u32,
        /// 1 after the first snapshot; before it 0.
        pub has_model: u32,
        /// Least and largest [`AxisCommand::gain`] that a request may ask for: the loop on the commissioned model keeps
        /// its margins. Both are 1 without such a model.
        pub gain_range: [f64; 2],
    }
}

impl AxisState {
    /// Sets the name; a name that is too long is cut between two letters.
    pub fn set_name(&mut self, name: &str) {
        let mut length = name.len().min(self.name.len());
        while !name.is_char_boundary(length) {
            length -= 1;
        }
        self.name = [0; 32];
        self.name[..length].copy_from_slice(&name.as_bytes()[..length]);
    }

    /// The name of the axis.
    pub fn name(&self) -> &str {
        let length = self.name.iter().position(|byte| *byte == 0).unwrap_or(self.name.len());
        std::str::from_utf8(&self.name[..length]).unwrap_or("?")
    }
}

shared_struct! {
    /// The newest sample and command of all axes. Control-proc sends one at each of its heartbeats.
    #[type_name("hydraxis.MachineState/7")]
    pub struct MachineState {
        /// `sequence` names the sample.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisState; MAX_AXES],
        /// Where the bucket's teeth are.
        pub teeth: TeethState,
    }
}
message!(MachineState, "machine-state", publishers 1, buffer 16);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_cut_between_two_letters() {
        let mut axis = AxisState::default();
        assert_eq!(axis.name(), "");
        axis.set_name("boom");
        assert_eq!(axis.name(), "boom");
        axis.set_name(&"\u{e4}".repeat(20));
        assert_eq!(axis.name(), "\u{e4}".repeat(16));
        axis.set_name(&format!("x{}", "\u{e4}".repeat(20)));
        assert_eq!(axis.name().chars().count(), 16);
    }
}
