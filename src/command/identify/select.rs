//! `--select`: searches the structure that predicts the held-out rows of the training part best.
//!
//! ```text
//! score = sqrt(h-step rmse / h-step rmse of the first structure) sqrt(free-run rmse / free-run rmse of the first)
//! ```
//!
//! There are too many structures to try all of them. So the search has stages: each tries other values for one or two
//! parts of the structure chosen so far, and the stages are repeated until no new structure is chosen. The chosen
//! structure is always the one with the fewest parameters among all whose score is within 2 % of the best. An unstable
//! structure loses against every stable one. Parts that the user typed are kept.

use std::cmp::Ordering;

use indicatif::ProgressBar;
use pipeline::{
    hammerstein::Structure,
    machine::{Identification, IdentifiedOutput},
};
use serde::Serialize;

use super::{
    grid::{Grid, STAGES},
    held_out::{Candidate, HeldOut},
    record::Record,
    settings::TypedStructure,
    structure::{description, flags},
};
use crate::report::table::{number, table};

/// A model with fewer parameters is preferred when its score is within this factor of the best.
const AS_GOOD: f64 = 1.02;
/// Number of candidates in the table.
const SHOWN: usize = 12;

/// The result of the search.
#[derive(Debug, Serialize)]
pub struct Selection {
    /// Rows that candidates were fitted on.
    pub fit_rows: usize,
    /// Rows that candidates were judged on.
    pub held_out_rows: usize,
    /// Structures that were tried.
    pub tried: usize,
    /// The best candidates, the best one first.
    pub candidates: Vec<Candidate>,
    /// The structure to identify with.
    pub chosen: Chosen,
}

/// The chosen structure.
#[derive(Debug, Serialize)]
pub struct Chosen {
    /// Its errors and criteria.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// The options that choose this structure without a search.
    pub flags: String,
}

/// Searches, starting at the structure of the settings. None when no structure can be fitted.
pub fn select(
    settings: &Identification,
    typed: &TypedStructure,
    record: &Record,
    progress: &ProgressBar,
) -> Option<Selection> {
    let validation = HeldOut::new(settings, record);
    if !validation.can_judge() {
        return None;
    }
    let grid = Grid::new(validation.commands(), validation.longest_delay());
    let mut search = Search { validation, seen: Vec::new(), tried: Vec::new() };
    for start in grid.starts(&settings.structure) {
        search.descend(&grid, typed.over(start), typed, progress);
    }
    let chosen = chosen(&search.ranks(&search.all()))?;
    search.score();
    let candidate = search.tried[chosen].clone();
    Some(Selection {
        fit_rows: search.validation.fit_rows(),
        held_out_rows: search.validation.held_out_rows(),
        tried: search.tried.len(),
        candidates: search.shown(chosen),
        chosen: Chosen { flags: flags(&candidate.structure, settings.output), candidate },
    })
}

struct Search<'a> {
    validation: HeldOut<'a>,
    /// All structures so far, with their place in `tried`; none for a structure that has too many parameters for the
    /// rows.
    seen: Vec<(Structure, Option<usize>)>,
    tried: Vec<Candidate>,
}

impl Search<'_> {
    /// Goes from one structure through the stages until they choose no new structure.
    fn descend(&mut self, grid: &Grid, start: Structure, typed: &TypedStructure, progress: &ProgressBar) {
        let mut places = Vec::new();
        self.try_into(&mut places, vec![start], progress);
        loop {
            let before = places.len();
            for stage in STAGES {
                let Some(chosen) = chosen(&self.ranks(&places)) else { return };
                let from = self.tried[places[chosen]].structure;
                let structures = stage(grid, &from).into_iter().map(|structure| typed.over(structure)).collect();
                self.try_into(&mut places, structures, progress);
            }
            if places.len() == before {
                return;
            }
        }
    }

    /// Judges the structures that were not judged before, and adds the places of all of them to `places`.
    fn try_into(&mut self, places: &mut Vec<usize>, structures: Vec<Structure>, progress: &ProgressBar) {
        progress.inc_length(structures.len() as u64);
        for structure in structures {
            let seen = self.seen.iter().find(|(seen, _)| *seen == structure).map(|(_, place)| *place);
            let place = seen.unwrap_or_else(|| {
                let place = self.validation.judge(structure).map(|candidate| {
                    self.tried.push(candidate);
                    self.tried.len() - 1
                });
                self.seen.push((structure, place));
                place
            });
            places.extend(place.filter(|place| !places.contains(place)));
            progress.inc(1);
        }
    }

    fn all(&self) -> Vec<usize> {
        (0..self.tried.len()).collect()
    }

    fn ranks(&self, places: &[usize]) -> Vec<Rank> {
        let rank = |candidate: &Candidate| {
            let error = self.validation.error(candidate);
            Rank {
                unstable: candidate.unstable,
                error: if error.is_nan() { f64::INFINITY } else { error },
                parameters: candidate.parameters,
            }
        };
        places.iter().map(|place| rank(&self.tried[*place])).collect()
    }

    /// Sets the scores of all candidates.
    fn score(&mut self) {
        let errors: Vec<f64> = self.tried.iter().map(|candidate| self.validation.error(candidate)).collect();
        for (candidate, error) in self.tried.iter_mut().zip(&errors) {
            candidate.score = error / errors[0];
        }
    }

    /// The best candidates, the best one first. The chosen one and the first one are always among them.
    fn shown(&self, chosen: usize) -> Vec<Candidate> {
        let mut places = self.all();
        let ranks = self.ranks(&places);
        places.sort_by(|a, b| ranks[*a].compare(&ranks[*b]));
        let shown =
            places.iter().enumerate().filter(|(rank, place)| *rank < SHOWN || **place == chosen || **place == 0);
        shown.map(|(_, place)| self.tried[*place].clone()).collect()
    }
}

/// The properties by which a candidate is chosen.
#[derive(Debug, Clone, Copy)]
struct Rank {
    unstable: bool,
    error: f64,
    parameters: usize,
}

impl Rank {
    /// Order of candidates: the better one first.
    fn compare(&self, other: &Self) -> Ordering {
        self.unstable.cmp(&other.unstable).then_with(|| self.error.total_cmp(&other.error))
    }
}

/// Place of the candidate with the fewest parameters among all that are as good as the best.
fn chosen(ranks: &[Rank]) -> Option<usize> {
    let best = ranks.iter().copied().min_by(Rank::compare)?;
    let as_good = |rank: &Rank| rank.unstable == best.unstable && rank.error <= AS_GOOD * best.error;
    let good = ranks.iter().enumerate().filter(|(_, rank)| as_good(rank));
    let smallest = good.min_by(|(_, a), (_, b)| a.parameters.cmp(&b.parameters).then_with(|| a.compare(b)));
    smallest.map(|(place, _)| place)
}

impl Selection {
    /// The candidates as a table.
    pub fn table(&self, output: IdentifiedOutput) -> String {
        let chosen = &self.chosen.candidate;
        let rows = self.candidates.iter().map(|candidate| {
            let mark = if candidate.structure == chosen.structure { "*" } else { " " };
            let name = format!("{mark} {}", description(&candidate.structure, output));
            let figures =
                [candidate.h_step_rmse, candidate.free_run_rmse, candidate.score, candidate.aic, candidate.bic];
            let notes = [(candidate.rank_deficient, "rank-deficient"), (candidate.unstable, "unstable")];
            let notes: Vec<&str> = notes.iter().filter(|note| note.0).map(|note| note.1).collect();
            let mut row = vec![name, candidate.parameters.to_string()];
            row.extend(figures.map(number));
            row.push(notes.join(", "));
            row
        });
        let header = ["  structure", "parameters", "h steps", "free run", "score", "AIC", "BIC", ""];
        format!(
            "{} structures fitted on {} rows of the training part and judged on the {} after them (rmse):\n{}\n\
             * chosen: {}\n",
            self.tried,
            self.fit_rows,
            self.held_out_rows,
            table(&header, rows.collect()),
            self.chosen.flags
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rank(parameters: usize, error: f64) -> Rank {
        Rank { unstable: false, error, parameters }
    }

    fn unstable(parameters: usize, error: f64) -> Rank {
        Rank { unstable: true, ..rank(parameters, error) }
    }

    #[test]
    fn of_equally_good_candidates_the_smallest_is_chosen() {
        assert_eq!(chosen(&[rank(15, 1.0), rank(9, 1.019), rank(5, 1.03)]), Some(1));
        assert_eq!(chosen(&[rank(9, 1.01), rank(9, 1.0)]), Some(1));
        assert_eq!(chosen(&[rank(9, 0.0), rank(5, 0.0)]), Some(1));
    }

    #[test]
    fn an_unstable_candidate_loses() {
        assert_eq!(chosen(&[unstable(3, 0.1), rank(9, 7.0)]), Some(1));
        assert_eq!(chosen(&[unstable(3, f64::INFINITY), unstable(9, 7.0)]), Some(1));
        assert_eq!(chosen(&[unstable(3, f64::INFINITY)]), Some(0));
        assert_eq!(chosen(&[]), None);
    }
}
