//! Offline identification, step 3 of the paper: least squares (15) on the over-parametrised form (14) and the
//! separation into b, f, g (16)-(17). Rows are taken in one at a time and not kept.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::Split,
};

use crate::{
    least_squares::{RankGuard, Triangle},
    regression::Regression,
    sample::RegressorRow,
    separation::OfflineSeparation,
};

/// Part of the products' weighted norm below which a separation costs nothing.
const EXACT: f64 = 1e-6;

/// Collects rows and solves them. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Batch {
    structure: Structure,
    regression: Regression,
    split: Split,
    collected: Triangle,
    data: Triangle,
    guard: RankGuard,
    separation: OfflineSeparation,
    phi: Vec<f64>,
    theta: Vec<f64>,
}

/// The result of offline identification, without theta and the data.
#[derive(Debug, Clone, Copy)]
pub struct Offline {
    /// a, b, f, g and the drift of the identified structure: an integrator is not multiplied in.
    pub coefficients: Coefficients,
    /// The model as it is published: an integrator is multiplied in.
    pub published: Coefficients,
    /// Standard deviation of the prediction error over the rows, in the unit of the output.
    pub residual_sigma: f64,
    /// Part of the products' weighted norm that the separation does not explain.
    pub split_residual: f64,
    /// Whether the rows do not determine every coefficient. Products that they do not determine are held at zero,
    /// unless the separated model fits the rows better otherwise.
    pub rank_deficient: bool,
}

impl Batch {
    /// No rows yet.
    pub fn new(structure: Structure, split: Split) -> Self {
        let regression = Regression::full(structure);
        let n = regression.len();
        Self {
            structure,
            regression,
            split,
            collected: Triangle::new(n),
            data: Triangle::new(n),
            guard: RankGuard::new(n),
            separation: OfflineSeparation::new(structure),
            phi: vec![0.0; n],
            theta: vec![0.0; n],
        }
    }

    /// Number of rows collected.
    pub fn rows(&self) -> u64 {
        self.collected.count()
    }

    /// Takes in y(k) and the row of sample k.
    pub fn add(&mut self, y: f64, row: &RegressorRow) {
        self.regression.regressor(row.values(), &row.structure(), &mut self.phi);
        self.collected.add(&self.phi, self.regression.target(y, row.values()));
    }

    /// Forgets all rows.
    pub fn restart(&mut self) {
        self.collected.clear();
    }

    /// Solves the collected rows. Allocates nothing.
    pub fn solve(&mut self) -> Offline {
        let held = self.guard.dependent(&self.collected);
        let rank_deficient = held.contains(&true);
        self.collected.hold_into(held, &mut self.data);
        self.data.solve(&mut self.theta);
        let mut coefficients = self.separation.separate(&self.theta, &self.data, self.split);
        let mut split_residual = self.separation.residual(&self.theta, &coefficients, &self.collected);
        if rank_deficient && self.split == Split::Als && split_residual > EXACT {
            // Products that are held at zero need not be those of any b and f. The rows alone decide.
            coefficients = self.separation.alternate(coefficients, &self.collected);
            split_residual = self.separation.residual(&self.theta, &coefficients, &self.collected);
        }
        let free = held.iter().filter(|held| !**held).count() as u64;
        let freedom = self.collected.count().saturating_sub(free).max(1);
        let residual_sigma = (self.data.residual() / freedom as f64).sqrt();
        let integrator = self.structure.integrator;
        let published = if integrator { coefficients.integrated() } else { coefficients };
        Offline { coefficients, published, residual_sigma, split_residual, rank_deficient }
    }

    /// The rows collected so far, in the layout of the full form.
    pub fn collected(&self) -> &Triangle {
        &self.collected
    }

    /// The coefficients that the rows do not determine and that are held at zero, after [`Self::solve`].
    pub fn held(&self) -> &[bool] {
        self.guard.last()
    }

    /// The triangle that theta solves, after [`Self::solve`].
    pub fn data(&self) -> &Triangle {
        &self.data
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dot, regression::write_out, sample::SlidingBuffer};

    /// Two levels of the command leave the rank 6 of 15. The three numbers of the command that they determine are those
    /// of some b and f, so the separation costs nothing.
    #[test]
    fn with_two_levels_of_the_command_the_separated_model_fits_as_well_as_the_products() {
        let structure = Structure::PAPER;
        let mut batch = Batch::new(structure, Split::Als);
        let mut row = RegressorRow::new(structure);
        let (mut outputs, mut commands) = (SlidingBuffer::new(3, 1), SlidingBuffer::new(2, 6));
        let (mut rows, mut y) = (Vec::new(), 4.9);
        for k in 0..600u32 {
            let u = if (f64::from(k) * 12.9898).sin() * 43758.5453 % 1.0 > 0.0 { 6.41 } else { 3.41 };
            commands.push_with(|slot| structure.input.features(u, slot));
            if k >= 3 {
                row.fill(&outputs, &commands);
                y += 0.1 * (u - y) + 0.01 * (f64::from(k) * 91.7).sin();
                batch.add(y, &row);
                rows.push((row.values().to_vec(), y));
            }
            outputs.push(y);
        }
        let offline = batch.solve();
        assert!(offline.rank_deficient && offline.split_residual < 1e-6, "{offline:?}");
        let mut theta = vec![0.0; structure.full_len()];
        write_out(&offline.published, &structure, &mut theta);
        let squares: f64 = rows.iter().map(|(row, y)| (y - dot(&theta, row)).powi(2)).sum();
        let ratio = (squares / (rows.len() as f64 - 6.0)).sqrt() / offline.residual_sigma;
        assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
    }
}
