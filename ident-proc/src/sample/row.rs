//! The row of one sample: everything that any estimator learns from, built once.
//!
//! ```text
//! (-y(k-1) .. -y(k-na),  phi_1(v(k-nk)) .. phi_1(v(k-nk-nb)),  phi_2(v(k-nk)) ..,  1)               (14)
//! ```
//!
//! phi_1 .. phi_r are the functions of the basis for u >= 0 and then the same for u < 0, u to u^r if they are powers;
//! the paper writes (14) for one sign only. The 1 is there for a drift. y in the unit of the output; v, what of the
//! command opens the valve, without unit.

use pipeline::hammerstein::Structure;

use crate::sample::SlidingBuffer;

/// The row of the over-parametrised form of one structure; its memory is taken at construction.
#[derive(Debug, Clone)]
pub struct RegressorRow {
    structure: Structure,
    values: Vec<f64>,
}

impl RegressorRow {
    /// For the orders of `structure` as they are published: outputs, not their increments.
    pub fn new(structure: Structure) -> Self {
        let structure = structure.published();
        Self { structure, values: vec![0.0; structure.full_len()] }
    }

    /// The structure, without integrator.
    pub fn structure(&self) -> Structure {
        self.structure
    }

    /// Reads the row of sample k off `outputs` = y(..k-1), na or more, and `commands` = features of u(..k-1), nk + nb
    /// or more.
    pub fn fill(&mut self, outputs: &SlidingBuffer, commands: &SlidingBuffer) {
        let Structure { na, nb, nk, order, .. } = self.structure;
        let width = 2 * order;
        let (past, driven) = self.values.split_at_mut(na);
        past.iter_mut().zip(outputs.latest(na).iter().rev()).for_each(|(value, y)| *value = -y);
        let commands = commands.latest(nk + nb);
        for (j, features) in commands[..(nb + 1) * width].chunks_exact(width).rev().enumerate() {
            for (power, feature) in features.iter().enumerate() {
                driven[power * (nb + 1) + j] = *feature;
            }
        }
        driven[width * (nb + 1)..].fill(1.0);
    }

    /// All of it.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Whether a positive, and whether a negative command contributes.
    pub fn signs(&self) -> [bool; 2] {
        let Structure { nb, order, .. } = self.structure;
        let (positive, negative) = self.driven().split_at(order * (nb + 1));
        let used = |features: &[f64]| features.iter().any(|feature| *feature != 0.0);
        [used(positive), used(&negative[..order * (nb + 1)])]
    }

    /// What the commands, and the 1 of the drift, contribute.
    pub fn driven(&self) -> &[f64] {
        &self.values[self.structure.na..]
    }
}
