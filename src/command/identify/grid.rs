//! The structures that the search tries. Each stage changes one or two parts of a structure and keeps the rest.

use pipeline::hammerstein::{Basis, InputMap, MAX_LINEAR, MAX_ORDER, Structure};

/// Delays of the coarse search, samples.
const DELAYS: [usize; 16] = [1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64];
/// Range of the fine search around a delay, samples.
const NEAR: usize = 3;
/// Edges of the dead band, as parts of the largest command.
const DEAD_BANDS: [f64; 10] = [0.0, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3];
/// Number of knots of a start with hinges.
const STARTING_KNOTS: usize = 4;
/// Significant digits of edges and knots, so that a user can type them.
const DIGITS: usize = 3;

/// What the stages need of the record: the longest delay, the largest command, and the commands.
pub struct Grid {
    longest_delay: usize,
    largest: f64,
    commands: Vec<f64>,
}

/// The stages in their order. The delay comes first, because with a wrong delay no other part can be judged. It is
/// tried with the integrator, because without an integrator the delay of a position is hard to see; and again with B,
/// because coefficients of B can replace a delay.
pub const STAGES: [fn(&Grid, &Structure) -> Vec<Structure>; 6] =
    [Grid::delays, Grid::poles, Grid::zeros, Grid::drifts, Grid::dead_bands, Grid::nonlinearities];

impl Grid {
    /// A grid for these commands and for delays up to `longest_delay`.
    pub fn new(commands: &[f64], longest_delay: usize) -> Self {
        let largest = commands.iter().fold(0.0f64, |largest, u| largest.max(u.abs()));
        Self { longest_delay, largest, commands: commands.to_vec() }
    }

    /// The structures that searches start from: `from`, and variants that a search reaches only by more than one step.
    pub fn starts(&self, from: &Structure) -> Vec<Structure> {
        let hinges = self.hinges(from.input.dead_band, STARTING_KNOTS).map(|basis| (STARTING_KNOTS, basis));
        let nonlinearities = [Some((from.order, from.input.basis)), hinges];
        let structure = |(order, basis), integrator, na| {
            let input = InputMap { basis, ..from.input };
            Structure { na, integrator, order, input, ..*from }
        };
        let orders = [(false, from.na), (true, 2), (false, MAX_LINEAR), (true, MAX_LINEAR)];
        let starts = nonlinearities
            .into_iter()
            .flatten()
            .flat_map(|nonlinearity| orders.map(|(integrator, na)| structure(nonlinearity, integrator, na)));
        starts.collect()
    }

    /// Coarse delays, with and without the integrator.
    fn delays(&self, from: &Structure) -> Vec<Structure> {
        let delays = DELAYS.into_iter().filter(|nk| *nk <= self.longest_delay);
        delays.flat_map(|nk| [false, true].map(|integrator| Structure { nk, integrator, ..*from })).collect()
    }

    /// Orders of A, with and without the integrator.
    fn poles(&self, from: &Structure) -> Vec<Structure> {
        (1..=MAX_LINEAR).flat_map(|na| [false, true].map(|integrator| Structure { na, integrator, ..*from })).collect()
    }

    /// Orders of B, each with delays near the present one.
    fn zeros(&self, from: &Structure) -> Vec<Structure> {
        let near = from.nk.saturating_sub(NEAR).max(1)..=(from.nk + NEAR).min(self.longest_delay.max(from.nk));
        near.flat_map(|nk| (0..MAX_LINEAR).map(move |nb| Structure { nk, nb, ..*from })).collect()
    }

    /// The drift, with and without the integrator, because the integrator changes the meaning of the drift.
    fn drifts(&self, from: &Structure) -> Vec<Structure> {
        let both = [false, true];
        both.into_iter().flat_map(|drift| both.map(|integrator| Structure { drift, integrator, ..*from })).collect()
    }

    /// Dead bands with one width for both directions, and with another width for one direction.
    fn dead_bands(&self, from: &Structure) -> Vec<Structure> {
        let (low, high) = from.input.dead_band;
        let edges = DEAD_BANDS.map(|part| rounded(part * self.largest));
        // An edge on a side without commands cannot be judged.
        let occur = |negative: bool| self.commands.iter().any(|u| *u != 0.0 && (*u < 0.0) == negative);
        let (below, above) = (occur(true), occur(false));
        let only = |(low, high)| (if below { low } else { 0.0 }, if above { high } else { 0.0 });
        let bands = edges.into_iter().flat_map(|edge| [(edge, edge), (low, edge), (edge, high)]).map(only);
        bands.filter_map(|band| self.with_dead_band(from, band)).collect()
    }

    fn with_dead_band(&self, from: &Structure, dead_band: (f64, f64)) -> Option<Structure> {
        let basis = match from.input.basis {
            Basis::Powers => Basis::Powers,
            Basis::Hinges(_) => self.hinges(dead_band, from.order)?,
        };
        Some(Structure { input: InputMap { dead_band, basis }, ..*from })
    }

    /// Powers and hinges of every order. One hinge equals the first power and is left out.
    fn nonlinearities(&self, from: &Structure) -> Vec<Structure> {
        let dead_band = from.input.dead_band;
        let powers = (1..=MAX_ORDER).map(|order| (order, Basis::Powers));
        let hinges = (2..=MAX_ORDER).filter_map(|order| self.hinges(dead_band, order).map(|basis| (order, basis)));
        let structure = |(order, basis)| Structure { order, input: InputMap { dead_band, basis }, ..*from };
        powers.chain(hinges).map(structure).collect()
    }

    /// `count` hinges: one at zero, the others at the quantiles that divide the magnitudes beyond the dead band into
    /// parts with equally many commands. None where too few magnitudes differ.
    fn hinges(&self, dead_band: (f64, f64), count: usize) -> Option<Basis> {
        let input = InputMap { dead_band, basis: Basis::Powers };
        let mut openings: Vec<f64> = self.commands.iter().map(|u| input.opening(*u).abs()).collect();
        openings.retain(|opening| *opening > 0.0);
        openings.sort_by(f64::total_cmp);
        let knot = |i: usize| openings.get(i * openings.len() / count).map_or(0.0, |opening| rounded(*opening));
        let knots: Vec<f64> = (0..count).map(|i| if i == 0 { 0.0 } else { knot(i) }).collect();
        Basis::hinges(&knots)
    }
}

fn rounded(value: f64) -> f64 {
    format!("{value:.*e}", DIGITS - 1).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hinges_divide_the_commands_into_equal_parts() {
        let commands: Vec<f64> =
            (0..=1000).map(|i| f64::from(i) / 1000.0 * if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let grid = Grid::new(&commands, 64);
        assert_eq!(grid.hinges((0.0, 0.0), 4), Basis::hinges(&[0.0, 0.251, 0.501, 0.751]));
        assert_eq!(grid.hinges((0.2, 0.2), 2), Basis::hinges(&[0.0, 0.401]));
    }

    #[test]
    fn commands_of_two_levels_give_no_hinges() {
        let grid = Grid::new(&[0.5, -0.5, 0.5, 0.5], 64);
        assert_eq!(grid.hinges((0.0, 0.0), 3), None);
        assert!(grid.nonlinearities(&Structure::PAPER).iter().all(|s| s.order == 2 || s.input.basis == Basis::Powers));
    }

    #[test]
    fn delays_stay_within_the_longest() {
        let grid = Grid::new(&[1.0], 9);
        let from = Structure { nk: 8, ..Structure::PAPER };
        for stage in [Grid::delays, Grid::zeros] {
            let delays: Vec<usize> = stage(&grid, &from).iter().map(|structure| structure.nk).collect();
            assert!(delays.iter().all(|nk| (1..=9).contains(nk)) && delays.contains(&8), "{delays:?}");
        }
    }
}
