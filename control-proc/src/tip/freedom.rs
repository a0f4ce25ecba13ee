//! The free axis along the way of the teeth.
//!
//! Boom and telescope share the way of the bucket pin. The boom stands, or moves evenly from one position to another
//! along a run, or follows a smooth curve, and telescope, arm and bucket follow from it ([`super::posture`]):
//!
//! ```text
//! b(s) = b_0 + (b_1 - b_0) (s - s_0)/(s_1 - s_0)
//! ```
//!
//! b position of the boom's cylinder in m, s length of the way in m, index 0 begin and 1 end of a run. The positions at
//! the ends of all runs are chosen together (`choice`). What is tried, one after the other:
//!
//! | the boom moves evenly | along |
//! |---|---|
//! | from end to end | all runs |
//! | every 0.4 m from point to point, joined by a smooth curve | runs along which it cannot move evenly, as a circle |
//! | the same | all runs |
//! | the same, every 0.2 m | all runs |
//!
//! A boom that stands all along is tried at finer positions as well (`standing`). A person may say where the telescope
//! or the boom stays, or where one of them is at the end of a piece: then the begin of a motion of the boom is free.

use pipeline::machine::{TipFree, TipTask};

use super::{
    choice::{BEGIN, CHOICES, Demand, Stretch, cheapest, choices, choices_at, fine_choices, standing, stations},
    posture::{Cylinders, Free, Short},
    way::Way,
};

/// Longest stretches of a run along which the boom cannot move evenly, m.
const STRETCHES: [f64; 2] = [0.4, 0.2];
/// Way of the boom that is no motion, m.
const STILL: f64 = 1e-9;

/// Why there are no postures for a way.
#[derive(Debug, Clone, PartialEq)]
pub enum NoPosture {
    /// The teeth cannot be at this s (m).
    Place(f64, Short),
    /// The teeth can be at every place of the runs, the longest of which is from s to s (m), but no smooth motion of
    /// the boom leads along them.
    Run(f64, f64),
}

/// The free axis along the way.
#[derive(Debug, Clone, PartialEq)]
pub enum Freedom {
    /// The telescope stays at this position, m.
    Telescope(f64),
    /// Points (s, position of the boom) of each run, m: two where the boom moves evenly.
    Boom(Vec<Vec<(f64, f64)>>),
}

/// A run as stretches: from s to s, m.
type Parts = Vec<(f64, f64)>;

impl Freedom {
    /// Chooses the free axis for the way of a task.
    ///
    /// # Errors
    /// The teeth cannot go along the way.
    pub fn choose(cylinders: &Cylinders, way: &Way, task: &TipTask) -> Result<Self, NoPosture> {
        let runs = way.runs();
        match task.free {
            Some(TipFree::Telescope(position)) => {
                let found = Self::Telescope(position);
                found.expect_free(cylinders, way, &runs).map(|()| found)
            }
            Some(TipFree::Boom(position)) => {
                let found = Self::Boom(runs.iter().map(|run| vec![(run.0, position), (run.1, position)]).collect());
                found.expect_free(cylinders, way, &runs).map(|()| found)
            }
            None => {
                expect_places(cylinders, way, &runs)?;
                let search = Search { cylinders, way, runs, fixed: fixed(cylinders, way, task)? };
                search.best()
            }
        }
    }

    /// Which axis is free at s, m.
    pub fn at(&self, s: f64) -> Free {
        match self {
            Self::Telescope(position) => Free::Telescope(*position),
            Self::Boom(runs) => {
                let i = runs.partition_point(|points| points.last().is_some_and(|end| end.0 <= s)).min(runs.len() - 1);
                Free::Boom(curve(&runs[i], s))
            }
        }
    }

    /// Largest number of points of a run: 2 where the boom moves evenly along all of them; 0 where it follows.
    pub fn points(&self) -> usize {
        match self {
            Self::Telescope(_) => 0,
            Self::Boom(runs) => runs.iter().map(Vec::len).max().unwrap_or_default(),
        }
    }

    /// How often the boom turns round inside runs, where the teeth move.
    pub fn reversals(&self) -> usize {
        let Self::Boom(runs) = self else { return 0 };
        let of_run = |points: &Vec<(f64, f64)>| {
            let moved = points.windows(2).map(|pair| pair[1].1 - pair[0].1).filter(|moved| moved.abs() > STILL);
            let signs: Vec<bool> = moved.map(|moved| moved > 0.0).collect();
            signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
        };
        runs.iter().map(of_run).sum()
    }

    fn expect_free(&self, cylinders: &Cylinders, way: &Way, runs: &[(f64, f64)]) -> Result<(), NoPosture> {
        for s in runs.iter().flat_map(|run| stations(*run)) {
            let found = cylinders.expect_free(&way.place(s), self.at(s));
            found.map_err(|short| NoPosture::Place(s, short))?;
        }
        Ok(())
    }
}

/// Expects that the teeth can be at every place with the boom at one of its choices.
fn expect_places(cylinders: &Cylinders, way: &Way, runs: &[(f64, f64)]) -> Result<(), NoPosture> {
    let all = choices(cylinders.limits[0]);
    // A choice that is free at a place is most likely free at the next one.
    let mut last = all[CHOICES / 2];
    for s in runs.iter().flat_map(|run| stations(*run)) {
        let place = way.place(s);
        let mut nearest: Option<Short> = None;
        let fine = std::iter::once_with(|| fine_choices(cylinders, &place)).flatten();
        for boom in std::iter::once(last).chain(all.iter().copied()).chain(fine) {
            let Err(short) = cylinders.expect_free(&place, Free::Boom(boom)) else {
                (last, nearest) = (boom, None);
                break;
            };
            // The least that is missing.
            if nearest.is_none_or(|nearest| cylinders.missing(&short) < cylinders.missing(&nearest)) {
                nearest = Some(short);
            }
        }
        if let Some(short) = nearest {
            return Err(NoPosture::Place(s, short));
        }
    }
    Ok(())
}

/// Where the boom is by hand: s and position, m.
fn fixed(cylinders: &Cylinders, way: &Way, task: &TipTask) -> Result<Vec<(f64, f64)>, NoPosture> {
    let mut all = Vec::new();
    for (number, piece) in task.pieces.iter().enumerate() {
        let (Some(free), Some(s)) = (piece.free, way.end(number)) else { continue };
        let free = match free {
            TipFree::Boom(position) => Free::Boom(position),
            TipFree::Telescope(position) => Free::Telescope(position),
        };
        let place = way.place(s);
        // The place is that of the piece which ends there, not of the next one.
        let refused = |short| NoPosture::Place(s * (1.0 - f64::EPSILON), short);
        cylinders.expect_free(&place, free).map_err(refused)?;
        all.extend(cylinders.positions(&place, free).map(|positions| (s, positions[0])));
    }
    Ok(all)
}

/// The search for the motion of the boom.
struct Search<'s, 'm> {
    cylinders: &'s Cylinders<'m>,
    way: &'s Way,
    runs: Vec<(f64, f64)>,
    /// Where the boom has to be: s and position, m.
    fixed: Vec<(f64, f64)>,
}

impl Search<'_, '_> {
    fn best(&self) -> Result<Freedom, NoPosture> {
        let even: Vec<Parts> = self.runs.iter().map(|run| self.parts(*run, f64::INFINITY)).collect();
        let stretches = self.stretches(&even);
        if let Some(found) = self.choose(&even, &stretches) {
            return Ok(found);
        }
        let is_even: Vec<bool> = even.iter().zip(&stretches).map(|(parts, run)| self.leads(parts, run)).collect();
        let curved = |longest: f64, keep: bool| -> Vec<Parts> {
            let of = |(i, run): (usize, &(f64, f64))| {
                if keep && is_even[i] { even[i].clone() } else { self.parts(*run, longest) }
            };
            self.runs.iter().enumerate().map(of).collect()
        };
        let mut tried = even.clone();
        for (longest, keep) in [(STRETCHES[0], true), (STRETCHES[0], false), (STRETCHES[1], false)] {
            let parts = curved(longest, keep);
            if parts == tried {
                continue;
            }
            let stretches = self.stretches(&parts);
            if let Some(found) = self.choose(&parts, &stretches) {
                return Ok(found);
            }
            tried = parts;
        }
        Err(self.why(&tried))
    }

    /// What is in the way: the first force or wall along the motion that the soft limits alone would leave.
    fn why(&self, parts: &[Parts]) -> NoPosture {
        let longest = self.runs.iter().max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))).copied().unwrap_or_default();
        let none = NoPosture::Run(longest.0, longest.1);
        let Some(found) = self.cheapest(parts, &self.stretches(parts), Demand::Limits) else { return none };
        match found.expect_free(self.cylinders, self.way, &self.runs) {
            Err(NoPosture::Place(s, short @ (Short::Force(..) | Short::Wall(..)))) => NoPosture::Place(s, short),
            _ => none,
        }
    }

    /// A run in stretches of `longest` m at most, which end where the boom has to be somewhere.
    fn parts(&self, run: (f64, f64), longest: f64) -> Parts {
        let inside = self.fixed.iter().map(|point| point.0).filter(|s| run.0 < *s && *s < run.1);
        let ends: Vec<f64> = std::iter::once(run.0).chain(inside).chain([run.1]).collect();
        let part = |pair: &[f64]| {
            let (begin, end) = (pair[0], pair[1]);
            let parts = ((end - begin) / longest).ceil().max(1.0);
            // The last part ends where the run does, not a rounding error beside it.
            let at = move |k: f64| if k < parts { begin + (end - begin) * k / parts } else { end };
            (0..parts as usize).map(move |k| (at(k as f64), at(k as f64 + 1.0)))
        };
        ends.windows(2).flat_map(part).collect()
    }

    fn stretches(&self, runs: &[Parts]) -> Vec<Vec<Stretch>> {
        let of = |parts: &Parts| parts.iter().map(|part| Stretch::new(self.cylinders, self.way, *part)).collect();
        runs.iter().map(of).collect()
    }

    /// Whether the boom can move along a run by itself.
    fn leads(&self, parts: &Parts, run: &[Stretch]) -> bool {
        let choices = self.choices(std::slice::from_ref(parts));
        cheapest(self.cylinders, &[run], &choices, Demand::All, 0.0).is_some()
    }

    /// The best motion that keeps everything, looked at once more at all places.
    fn choose(&self, parts: &[Parts], stretches: &[Vec<Stretch>]) -> Option<Freedom> {
        let free = |found: &Freedom| found.expect_free(self.cylinders, self.way, &self.runs).is_ok();
        let found = self.cheapest(parts, stretches, Demand::All)?;
        if free(&found) {
            return Some(found);
        }
        self.cheapest(parts, stretches, Demand::Reserve).filter(free)
    }

    fn cheapest(&self, parts: &[Parts], stretches: &[Vec<Stretch>], demand: Demand) -> Option<Freedom> {
        let runs: Vec<&[Stretch]> = stretches.iter().map(Vec::as_slice).collect();
        let is_free = self.fixed.is_empty();
        let begin = if is_free { BEGIN } else { 0.0 };
        let moving = cheapest(self.cylinders, &runs, &self.choices(parts), demand, begin);
        let standing = if is_free { standing(self.cylinders, &runs, demand) } else { None };
        let chosen = match (moving, standing) {
            (Some((cost, moving)), Some((least, _))) if cost <= least => moving,
            (_, Some((_, boom))) => vec![boom; parts.iter().map(Vec::len).sum::<usize>() + 1],
            (moving, None) => moving?.1,
        };
        let mut points = self.ends(parts).zip(chosen).peekable();
        let mut all = Vec::new();
        for run in parts {
            let mut of_run: Vec<(f64, f64)> = points.by_ref().take(run.len()).collect();
            of_run.extend(points.peek());
            all.push(of_run);
        }
        Some(Freedom::Boom(all))
    }

    /// s at the ends of all stretches, m.
    fn ends<'a>(&self, parts: &'a [Parts]) -> impl Iterator<Item = f64> + use<'a> {
        let first = parts.iter().flatten().map(|part| part.0).take(1);
        first.chain(parts.iter().flatten().map(|part| part.1))
    }

    /// Positions of the boom that are tried at the ends of all stretches, m.
    fn choices(&self, parts: &[Parts]) -> Vec<Vec<f64>> {
        let of = |s: f64| {
            let by_hand = self.fixed.iter().find(|point| point.0 == s).map(|point| vec![point.1]);
            by_hand.unwrap_or_else(|| choices_at(self.cylinders, &self.way.place(s)))
        };
        self.ends(parts).map(of).collect()
    }
}

/// A smooth curve through points, without an overshoot between them: piecewise cubic Hermite interpolation with the
/// slopes of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984), 0 where the points turn.
fn curve(points: &[(f64, f64)], s: f64) -> f64 {
    let Some(last) = points.len().checked_sub(2) else { return f64::NAN };
    let i = points.partition_point(|point| point.0 <= s).saturating_sub(1).min(last);
    let rise = |i: usize| (points[i + 1].1 - points[i].1) / (points[i + 1].0 - points[i].0);
    let slope = |i: usize| match (i.checked_sub(1), i <= last) {
        (Some(before), true) if rise(before) * rise(i) > 0.0 => 2.0 / (1.0 / rise(before) + 1.0 / rise(i)),
        (Some(_), true) => 0.0,
        (None, _) => rise(0),
        (Some(before), false) => rise(before),
    };
    let length = points[i + 1].0 - points[i].0;
    let r = ((s - points[i].0) / length).clamp(0.0, 1.0);
    let (from, to) = (points[i].1, points[i + 1].1);
    let bend = r * (1.0 - r) * length;
    from + (to - from) * r * r * (3.0 - 2.0 * r) + bend * ((1.0 - r) * slope(i) - r * slope(i + 1))
}

#[cfg(test)]
mod tests;
