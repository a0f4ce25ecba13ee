//! What a search has found, and whether more of it is kept.

use super::{AnalysisError, BETTER, CLEARLY_BETTER, Data, Point, STRAIGHTNESSES, Search};

/// The end of a search, and how much of the rest of the record its model explains, percent.
pub(super) struct Candidate<'a> {
    pub search: Search<'a>,
    pub point: Point,
    pub explained: f64,
    /// Square of what it leaves unexplained, in blocks of the rest.
    pub squares: Vec<f64>,
}

impl<'a> Candidate<'a> {
    /// Whether the difference to `best` may be chance: it is within a standard error.
    fn is_as_good_as(&self, best: &Self) -> bool {
        let count = best.squares.len() as f64;
        let worse: Vec<f64> = self.squares.iter().zip(&best.squares).map(|(own, best)| own - best).collect();
        let mean = worse.iter().sum::<f64>() / count;
        let variance = worse.iter().map(|worse| (worse - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let error = (variance / count).sqrt();
        // Not a number, of a rest that is too short, is no difference that shows.
        mean <= error || error.is_nan()
    }

    /// With loads that overrun the axis where that explains better.
    pub fn overrun(self, rest: &Data<'_>) -> Result<Self, AnalysisError> {
        if self.search.seen.most_overruns().iter().all(|most| *most <= 1.0) {
            return Ok(self);
        }
        self.with(rest, BETTER, Search::with_overrun)
    }

    /// The straightest curve that explains `rest` as well as the best one, as far as the record tells.
    pub fn straightened(self, rest: &Data<'_>) -> Result<Self, AnalysisError> {
        let Self { search, point, .. } = self;
        let with = |straightness: &f64| {
            let search = Search { fitted: Data { straightness: *straightness, ..search.fitted }, ..search };
            search.judged(search.searched(point), rest)
        };
        let mut candidates = vec![self];
        for straightness in &STRAIGHTNESSES[1..] {
            candidates.push(with(straightness)?);
        }
        let explained = |i: &usize| candidates[*i].explained;
        let best = (0..candidates.len()).max_by(|a, b| explained(a).total_cmp(&explained(b))).unwrap_or_default();
        let is_as_good = |i: &usize| candidates[*i].is_as_good_as(&candidates[best]);
        let straight = (best..candidates.len()).rev().find(is_as_good).unwrap_or(best);
        Ok(candidates.swap_remove(straight))
    }

    /// With a start of the oil where that explains clearly better.
    pub fn started(self, rest: &Data<'_>) -> Result<Self, AnalysisError> {
        self.with(rest, CLEARLY_BETTER, Search::with_start)
    }

    /// With a hysteresis where that explains better: a start may have hidden it, as a swing does.
    pub fn hysteretic(self, rest: &Data<'_>) -> Result<Self, AnalysisError> {
        if self.point.at[4] > 0.0 {
            return Ok(self);
        }
        let better = if self.point.at[5] > 0.0 { BETTER } else { CLEARLY_BETTER };
        self.with(rest, better, |search, point| search.searched(search.with_some_hysteresis(point)))
    }

    /// With what `add` adds to the point on the whole record, where the error there falls below `better` of the one
    /// without it. Few motions tell that, so a part of the record finds something else, or nothing.
    fn with(
        self,
        rest: &Data<'_>,
        better: f64,
        add: impl Fn(&Search<'a>, Point) -> Point,
    ) -> Result<Self, AnalysisError> {
        let whole = self.search.to_end(rest.end);
        let found = add(&whole, self.point);
        if found.cost >= better * whole.searched(self.point).cost {
            return Ok(self);
        }
        self.search.judged(self.search.searched(found), rest)
    }
}
