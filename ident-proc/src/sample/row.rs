//! The regressor row of one sample. It is built once, and every form of the [regression](crate::regression) is read
//! from it.
//!
//! ```text
//! (-y(k-1) .. -y(k-na),  phi_1(v(k-nk)) .. phi_1(v(k-nk-nb)),  phi_2(v(k-nk)) ..,  1)               (14)
//! ```
//!
//! y output in its unit; v the part of the command beyond the dead band, without unit; phi_i features of v. Features 1
//! to r are the functions of the basis for u >= 0, features r + 1 to 2 r those for u < 0. With the paper's basis they
//! are u to u^r. The paper prints (14) for one sign of the command only. The last entry, 1, belongs to the drift.

use pipeline::hammerstein::Structure;

use super::buffer::SlidingBuffer;

/// The row (14) of one structure. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct RegressorRow {
    structure: Structure,
    values: Vec<f64>,
}

impl RegressorRow {
    /// A row for the orders of `structure` as they are published: it holds outputs and not their increments.
    pub fn new(structure: Structure) -> Self {
        let structure = structure.published();
        Self { structure, values: vec![0.0; structure.full_len()] }
    }

    /// The structure of the row, without integrator.
    pub fn structure(&self) -> Structure {
        self.structure
    }

    /// Writes the row of sample k. `outputs` = y(..k-1) holds na values or more, `commands` = features of u(..k-1)
    /// holds nk + nb or more.
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

    /// All entries of the row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Whether the row contains a positive command, and whether it contains a negative one.
    pub fn signs(&self) -> [bool; 2] {
        let Structure { nb, order, .. } = self.structure;
        let (positive, negative) = self.driven().split_at(order * (nb + 1));
        let used = |features: &[f64]| features.iter().any(|feature| *feature != 0.0);
        [used(positive), used(&negative[..order * (nb + 1)])]
    }

    /// The entries after the outputs: the features of the commands and the 1 of the drift.
    pub fn driven(&self) -> &[f64] {
        &self.values[self.structure.na..]
    }
}
