//! The outputs and commands of one axis up to the present sample, and the regressor row that they give.
//!
//! ```text
//! position:  y(k) = p(k)                          velocity:  y(k) = (p(k) - p(k-1)) / T
//! ```
//!
//! p measured position in m, y identified output in m or m/s, T period in s.
//!
//! Trap: after a gap nothing before it may be combined with what follows. Outputs and commands have separate gaps: an
//! output may be missing while the command is known.

use pipeline::{
    hammerstein::{InputMap, Structure},
    machine::{Identification, IdentifiedOutput},
};

use super::{buffer::SlidingBuffer, row::RegressorRow};

/// The past of one axis. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Past {
    output: IdentifiedOutput,
    period: f64,
    input: InputMap,
    /// p(k-1), if that sample was measured. Needed where the velocity is identified.
    position: Option<f64>,
    /// u(k-1).
    command: f64,
    /// y(..k-1).
    outputs: SlidingBuffer,
    /// Features of u(..k-1).
    commands: SlidingBuffer,
    row: RegressorRow,
}

impl Past {
    /// An empty past for regressor rows of the structure `row`.
    pub fn new(settings: &Identification, row: Structure) -> Self {
        Self {
            output: settings.output,
            period: settings.period,
            input: settings.structure.input,
            position: None,
            command: 0.0,
            // Increments need two outputs, the persistence error a whole horizon of them.
            outputs: SlidingBuffer::new(row.na.max(settings.horizon).max(2), 1),
            commands: SlidingBuffer::new(row.nk + row.nb, 2 * row.order),
            row: RegressorRow::new(row),
        }
    }

    /// Adds u(k-1).
    pub fn push_command(&mut self, u: f64) {
        self.command = u;
        let input = self.input;
        self.commands.push_with(|slot| input.features(u, slot));
    }

    /// Removes all commands, after one that is not known. No velocity can be computed over the gap.
    pub fn interrupt_commands(&mut self) {
        self.commands.clear();
        self.position = None;
    }

    /// y(k) from p(k). `None` without a measurement, and for a velocity also without the measurement before it.
    pub fn identified(&mut self, position: Option<f64>) -> Option<f64> {
        let before = std::mem::replace(&mut self.position, position);
        match self.output {
            IdentifiedOutput::Position => position,
            IdentifiedOutput::Velocity => Some((position? - before?) / self.period),
        }
    }

    /// Whether there are outputs and commands enough for a regressor row.
    pub fn is_complete(&self) -> bool {
        let Structure { na, nb, nk, .. } = self.row.structure();
        self.outputs.len() >= na && self.commands.len() >= nk + nb
    }

    /// Writes the regressor row of sample k. The past must be complete.
    pub fn fill_row(&mut self) {
        self.row.fill(&self.outputs, &self.commands);
    }

    /// Adds y(k), after everything that needs y(..k-1).
    pub fn push_output(&mut self, y: f64) {
        self.outputs.push(y);
    }

    /// Removes all outputs, after a gap.
    pub fn interrupt_outputs(&mut self) {
        self.outputs.clear();
    }

    /// The regressor row as it was last written.
    pub fn row(&self) -> &RegressorRow {
        &self.row
    }

    /// The outputs: y(..k-1), or y(..k) after [`Self::push_output`].
    pub fn outputs(&self) -> &SlidingBuffer {
        &self.outputs
    }

    /// The output `samples` before the present one, 1 for y(k-1). `None` where it is not known. To be called before
    /// [`Self::push_output`].
    pub fn output_before(&self, samples: usize) -> Option<f64> {
        (self.outputs.len() >= samples).then(|| self.outputs.latest(samples)[0])
    }

    /// u(k-1).
    pub fn command(&self) -> f64 {
        self.command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    fn past(output: IdentifiedOutput) -> Past {
        let built_in = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
        let settings = Identification { output, period: 0.01, ..built_in };
        Past::new(&settings, settings.structure.published())
    }

    #[test]
    fn a_velocity_needs_two_measurements_without_a_gap_between() {
        let mut past = past(IdentifiedOutput::Velocity);
        assert_eq!(past.identified(Some(0.5)), None);
        assert!((past.identified(Some(0.52)).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(past.identified(None), None);
        assert_eq!(past.identified(Some(0.5)), None);
        past.interrupt_commands();
        assert_eq!(past.identified(Some(0.5)), None);
        assert!(past.identified(Some(0.5)).is_some());
    }

    #[test]
    fn it_is_complete_with_enough_outputs_and_commands_and_not_after_a_gap() {
        let mut past = past(IdentifiedOutput::Position);
        let Structure { na, nb, nk, .. } = past.row().structure();
        for k in 0..na.max(nk + nb) {
            assert!(!past.is_complete(), "{k}");
            past.push_command(0.1);
            past.push_output(0.5);
        }
        assert!(past.is_complete());
        assert_eq!((past.output_before(1), past.output_before(1000)), (Some(0.5), None));
        past.interrupt_outputs();
        assert!(!past.is_complete());
    }
}
