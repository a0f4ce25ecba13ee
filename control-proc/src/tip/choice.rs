//! The motion of the boom with the least cost, by dynamic programming from one end of a stretch to the next.
//!
//! ```text
//! cost of a stretch  |m| + E m^2 / l + max over its places of the cost of what is left (`posture`)
//! cost of a joint    V |sign m_1 - sign m_0| / 2
//! ```
//!
//! m way of the boom along a stretch in m, l length of the stretch in m; E and V: [`EVENNESS`], [`REVERSAL`]. Joints
//! are those inside a run, and its begin, before which the boom stands (m_0 = 0): between two runs the teeth stand, and
//! the boom may turn round for nothing. Trap: without a cost of its begin the boom creeps along a run for a few
//! millimetres of room elsewhere, and a valve with a dead band cannot creep.
//!
//! Postures are worked out on a grid: at all places, with the boom at each of its choices. Between two choices all
//! values are taken as even. On the built-in machine they are off by less than 1 mm and 0.1 % of the force, and by more
//! only at a wall. Whoever takes the motion looks at it once more. At the edge of the reach few choices are possible at
//! an end, or none. There the positions of the boom that follow from those of the telescope are choices as well.

use super::{
    posture::{Cylinders, Free, Margins, Posture},
    way::{TipPlace, Way},
};

/// Positions of an axis that are tried, over its soft limits.
pub const CHOICES: usize = 81;
/// Length of the way between two places that are tried, m, and the least number of parts of a stretch.
const STEP: f64 = 0.05;
const LEAST_PARTS: usize = 10;
/// Cost of a way of the boom of 1 m along 1 m of the teeth, beside the way itself, m: of equal ways the even one.
const EVENNESS: f64 = 0.5;
/// What it costs that the boom turns round while the teeth move, m: it crosses its dead band there.
const REVERSAL: f64 = 0.3;
/// What it costs that it stops there, or begins at all, m.
pub const BEGIN: f64 = 0.5 * REVERSAL;

/// A wall may be so much farther away than it seems between two choices, m: another part of the machine comes next to
/// it there.
const KINK: f64 = 0.03;

/// A cylinder may have so much more or less room than it seems between two choices, m.
const UNEVEN: f64 = 5e-3;
/// Positions of a boom that stands all along, between two choices.
const FINER: usize = 8;
/// Number of possible choices at a place below which finer ones are tried as well.
const FEW: usize = 3;

/// What a motion of the boom has to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Demand {
    /// Soft limits, forces and walls.
    All,
    /// Soft limits, forces and walls with a reserve for what is uneven between two choices.
    Reserve,
    /// Soft limits only.
    Limits,
}

impl Demand {
    fn is_met(self, margins: &Margins) -> bool {
        let (room, load) = (margins.room.0, margins.load.0);
        match self {
            Self::All => room >= 0.0 && load <= 1.0 && margins.wall >= 0.0,
            Self::Reserve => room >= 2e-3 && load <= 0.99 && margins.wall >= 5e-3,
            Self::Limits => room >= 0.0,
        }
    }
}

/// Places of a stretch that are tried, s in m.
pub fn stations((begin, end): (f64, f64)) -> impl Iterator<Item = f64> {
    let parts = LEAST_PARTS.max(((end - begin) / STEP).ceil() as usize);
    (0..=parts).map(move |i| begin + (end - begin) * i as f64 / parts as f64)
}

/// The choices of an axis between its soft limits, m.
pub fn choices((low, high): (f64, f64)) -> Vec<f64> {
    (0..CHOICES).map(|choice| low + (high - low) * choice as f64 / (CHOICES - 1) as f64).collect()
}

/// The choices of the boom at a place, and finer ones where few of them are possible.
pub fn choices_at(cylinders: &Cylinders, place: &TipPlace) -> Vec<f64> {
    let mut all = choices(cylinders.limits[0]);
    if all.iter().filter(|boom| cylinders.expect_free(place, Free::Boom(**boom)).is_ok()).count() < FEW {
        all.extend(fine_choices(cylinders, place));
    }
    all
}

/// Positions of the boom within the soft limits, with the telescope at each of its choices, m. At the edge of the reach
/// the boom may have less room than between two of its own choices.
pub fn fine_choices(cylinders: &Cylinders, place: &TipPlace) -> Vec<f64> {
    let boom = |telescope: f64| {
        let posture = cylinders.posture(place, Free::Telescope(telescope))?;
        (cylinders.margins(&posture).room.0 >= 0.0).then_some(posture.positions[0])
    };
    choices(cylinders.limits[2]).into_iter().filter_map(boom).collect()
}

/// A part of a run along which the boom moves evenly.
pub struct Stretch {
    length: f64,
    stations: Vec<Station>,
}

/// A place of a stretch.
struct Station {
    /// From 0 at the begin of the stretch to 1 at its end.
    part: f64,
    place: TipPlace,
    /// With the boom at each choice.
    postures: Vec<Option<Posture>>,
}

impl Stretch {
    /// From s to s, m.
    pub fn new(cylinders: &Cylinders, way: &Way, (begin, end): (f64, f64)) -> Self {
        let choices = choices(cylinders.limits[0]);
        let station = |s: f64| {
            let place = way.place(s);
            let postures = choices.iter().map(|boom| cylinders.posture(&place, Free::Boom(*boom))).collect();
            Station { part: (s - begin) / (end - begin), place, postures }
        };
        Self { length: end - begin, stations: stations((begin, end)).map(station).collect() }
    }

    /// Cost of the way of the boom alone, m.
    fn way_cost(&self, moved: f64) -> f64 {
        moved.abs() + EVENNESS * moved * moved / self.length
    }

    /// Largest cost of what is left while the boom moves evenly between two positions, m; none where it cannot.
    fn left_cost(&self, cylinders: &Cylinders, (from, to): (f64, f64), demand: Demand) -> Option<f64> {
        let (low, high) = cylinders.limits[0];
        let scale = (CHOICES - 1) as f64 / (high - low);
        self.stations.iter().try_fold(0.0f64, |cost, Station { part, place: teeth, postures }| {
            let boom = from + (to - from) * part;
            let place = (boom - low) * scale;
            let nearest = place.round();
            let posture = if (place - nearest).abs() < 1e-9 {
                *postures.get(nearest as usize)?.as_ref()?
            } else {
                let choice = place as usize;
                match (&postures[choice], postures.get(choice + 1)?) {
                    (Some(one), Some(other)) => one.towards(other, place - place.floor()),
                    _ => cylinders.posture(teeth, Free::Boom(boom))?,
                }
            };
            let mut margins = cylinders.margins(&posture);
            let is_near_wall = demand != Demand::Limits && (-KINK..0.0).contains(&margins.wall);
            if is_near_wall || (-UNEVEN..UNEVEN).contains(&margins.room.0) {
                margins = cylinders.margins(&cylinders.posture(teeth, Free::Boom(boom))?);
            }
            demand.is_met(&margins).then(|| cost.max(margins.cost()))
        })
    }
}

/// Cost of a joint of two stretches along which the boom moves by `before` and `after`, m.
fn joint_cost(before: f64, after: f64) -> f64 {
    let sign = |moved: f64| if moved == 0.0 { 0.0 } else { moved.signum() };
    BEGIN * (sign(after) - sign(before)).abs()
}

/// The way back through one run: from the choice at its end to those at the ends of all its stretches.
struct Trace {
    /// By choices at begin and end of a stretch: the choice at the begin of the one before.
    before: Vec<Vec<Vec<usize>>>,
    /// By the choice at the end of the run: the one at the begin of its last stretch.
    last: Vec<usize>,
}

impl Trace {
    /// The choices at all ends of the run, the last one first, without the last one.
    fn back(&self, end: usize) -> Vec<usize> {
        let (mut to, mut from) = (end, self.last[end]);
        let mut all = vec![from];
        for before in self.before.iter().rev() {
            (from, to) = (before[from][to], from);
            all.push(from);
        }
        all
    }
}

/// The least cost of a boom that stands all along, m, and its position, m; none where it cannot.
pub fn standing(cylinders: &Cylinders, runs: &[&[Stretch]], demand: Demand) -> Option<(f64, f64)> {
    let (low, high) = cylinders.limits[0];
    let last = FINER * (CHOICES - 1);
    let cost = |boom: f64| {
        let mut stretches = runs.iter().copied().flatten();
        stretches.try_fold(0.0, |cost, of| Some(cost + of.left_cost(cylinders, (boom, boom), demand)?))
    };
    let all = (0..=last).map(|i| low + (high - low) * i as f64 / last as f64);
    all.filter_map(|boom| Some((cost(boom)?, boom))).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The least cost, m, and the positions of the boom at the ends of all stretches that have it; none where there is no
/// way through. `choices` has those that are tried at each end; `begin` is what it costs that the boom moves at the
/// begin of a run, m.
pub fn cheapest(
    cylinders: &Cylinders,
    runs: &[&[Stretch]],
    choices: &[Vec<f64>],
    demand: Demand,
    begin: f64,
) -> Option<(f64, Vec<f64>)> {
    let mut costs = vec![0.0; choices[0].len()];
    let (mut first, mut traces) = (0, Vec::new());
    for run in runs {
        let (ends, trace) = through(cylinders, run, &choices[first..=first + run.len()], (&costs, begin), demand);
        (costs, first) = (ends, first + run.len());
        traces.push(trace);
    }
    let mut end = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
    let cost = costs[end];
    if cost == f64::INFINITY {
        return None;
    }
    let mut chosen = vec![end];
    for trace in traces.iter().rev() {
        chosen.extend(trace.back(end));
        end = *chosen.last()?;
    }
    Some((cost, chosen.iter().rev().zip(choices).map(|(choice, of)| of[*choice]).collect()))
}

/// The costs at the end of a run by those at its begin.
fn through(
    cylinders: &Cylinders,
    run: &[Stretch],
    choices: &[Vec<f64>],
    (costs, begin): (&[f64], f64),
    demand: Demand,
) -> (Vec<f64>, Trace) {
    let first = (choices[0].as_slice(), choices[1].as_slice());
    let mut pairs = stretch_costs(cylinders, &run[0], first, demand, |a| costs[a], Some((run.len(), begin)));
    let mut before = Vec::new();
    for (k, next) in run.iter().enumerate().skip(1) {
        let (one, two, three) = (&choices[k - 1], &choices[k], &choices[k + 1]);
        let begin = |b: usize| pairs.iter().map(|of| of[b]).fold(f64::INFINITY, f64::min);
        let begins: Vec<f64> = (0..two.len()).map(begin).collect();
        // What a stretch costs by itself: only where its begin can be reached.
        let reached = |b: usize| if begins[b] < f64::INFINITY { 0.0 } else { f64::INFINITY };
        let mut alone = stretch_costs(cylinders, next, (two, three), demand, reached, None);
        let mut from = vec![vec![0; three.len()]; two.len()];
        for (b, of) in alone.iter_mut().enumerate() {
            for (c, cost) in of.iter_mut().enumerate().filter(|(_, cost)| **cost < f64::INFINITY) {
                let after = three[c] - two[b];
                let cheapest = (0..one.len())
                    .filter(|a| pairs[*a][b] < f64::INFINITY)
                    .map(|a| (a, pairs[a][b] + joint_cost(two[b] - one[a], after)))
                    .fold((0, f64::INFINITY), |least, now| if now.1 < least.1 { now } else { least });
                (from[b][c], *cost) = (cheapest.0, *cost + cheapest.1);
            }
        }
        before.push(from);
        pairs = alone;
    }
    let ends = choices[run.len()].len();
    let least = |c: usize| (0..pairs.len()).min_by(|a, b| pairs[*a][c].total_cmp(&pairs[*b][c])).unwrap_or_default();
    let last: Vec<usize> = (0..ends).map(least).collect();
    ((0..ends).map(|c| pairs[last[c]][c]).collect(), Trace { before, last })
}

/// Costs of a stretch by the choices at its begin, which cost `begin`, and at its end; infinite where the boom cannot
/// move so. `first` is the number of stretches of a run that begins with this one, and what it costs to begin; of a run
/// of one stretch only the least cost for each end is worked out.
fn stretch_costs(
    cylinders: &Cylinders,
    stretch: &Stretch,
    (from, to): (&[f64], &[f64]),
    demand: Demand,
    begin: impl Fn(usize) -> f64,
    first: Option<(usize, f64)>,
) -> Vec<Vec<f64>> {
    let mut costs = vec![vec![f64::INFINITY; to.len()]; from.len()];
    let mut least = vec![f64::INFINITY; to.len()];
    for a in (0..from.len()).filter(|a| begin(*a) < f64::INFINITY) {
        for b in 0..to.len() {
            let moved = to[b] - from[a];
            let start = first.filter(|_| moved != 0.0).map_or(0.0, |(_, start)| start);
            let cost = begin(a) + stretch.way_cost(moved) + start;
            if first.is_some_and(|(stretches, _)| stretches == 1) && cost >= least[b] {
                continue;
            }
            if let Some(left) = stretch.left_cost(cylinders, (from[a], to[b]), demand) {
                costs[a][b] = cost + left;
                least[b] = least[b].min(cost + left);
            }
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_costs_what_the_boom_does_there() {
        assert_eq!((joint_cost(0.2, 0.1), joint_cost(0.0, 0.0)), (0.0, 0.0));
        assert_eq!((joint_cost(0.1, -0.1), joint_cost(-0.1, 0.2)), (REVERSAL, REVERSAL));
        assert_eq!((joint_cost(0.1, 0.0), joint_cost(0.0, -0.1)), (0.5 * REVERSAL, 0.5 * REVERSAL));
    }
}
