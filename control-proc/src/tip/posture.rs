//! The cylinders along the way of the teeth.
//!
//! Place and pitch of the teeth are three coordinates, and four cylinders move them: one is free. The boom moves the
//! teeth most, and each of its millimetres is many at the teeth. So the boom is the one that is chosen: it stands, or
//! moves evenly from one length to another along a run, and telescope, arm and bucket follow from it:
//!
//! ```text
//! b(s)      = b_0 + (b_1 - b_0) (s - s_0)/(s_1 - s_0)
//! telescope = |bucket pin - arm pin(b)| - length of the arm
//! ```
//!
//! b position of the boom's cylinder in m, s length of the way in m, index 0 begin and 1 end of a run. The positions at
//! the ends of all runs are chosen together, out of 81 over the soft limits: those with the least way of the
//! boom, and of these the ones with the most room to the soft limits. Where no even motion of the boom leads along a
//! run, such as along a circle, its positions are chosen every 0.4 m and joined by a smooth curve.

use mechanism::{AXES, Joint, Linkage, Mechanism, Rotation};
use pipeline::machine::Machine;

use super::way::{TipPlace, Way};

/// Lengths of the boom that are tried at each end of a run.
const CHOICES: usize = 81;
/// Length of the way between two places that are tried, m, and the least number of parts of a run.
const STEP: f64 = 0.05;
const LEAST_PARTS: usize = 10;
/// Longest segment of a run along which the boom cannot move evenly, m.
const SEGMENT: f64 = 0.4;
/// Cost of a way of the boom of 1 m along 1 m of the teeth, beside the way itself, m: of equal ways the even one.
const EVENNESS: f64 = 0.5;
/// Way from a soft limit that costs as much as a way of the boom of [`ROOM_COST`], m: near it the soft stop slows the
/// axis.
const ROOM: f64 = 0.05;
/// m.
const ROOM_COST: f64 = 0.02;

/// Why the teeth cannot be at a place.
#[derive(Debug, Clone, PartialEq)]
pub enum Short {
    /// Boom and arm do not reach it, or the bucket's linkage does not close.
    Reach,
    /// An axis would have to be at this position (m), outside its soft limits.
    Axis(usize, f64),
}

/// Cylinders of a machine and their soft limits.
pub struct Cylinders<'m> {
    mechanism: &'m Mechanism,
    linkage: Linkage,
    limits: [(f64, f64); AXES],
}

/// Which axis is free, and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Free {
    /// Position of the boom, m.
    Boom(f64),
    /// Position of the telescope, m.
    Telescope(f64),
}

impl<'m> Cylinders<'m> {
    /// Of the first four axes of a machine.
    pub fn new(machine: &Machine, mechanism: &'m Mechanism) -> Self {
        let limits = std::array::from_fn(|i| machine.axes[i].soft_limits);
        Self { mechanism, linkage: Linkage::new(&mechanism.geometry), limits }
    }

    /// Positions of the cylinders with the teeth at a place, m, whatever the soft limits are.
    pub fn positions(&self, place: &TipPlace, free: Free) -> Option<[f64; AXES]> {
        let geometry = &self.mechanism.geometry;
        let pitch = Rotation::by(place.pitch);
        let telescope = match free {
            Free::Telescope(position) => self.mechanism.retracted[2] + position,
            Free::Boom(position) => {
                let boom = self.linkage.rotation(Joint::Boom, self.mechanism.retracted[0] + position);
                let arm_pin = geometry.boom_foot + geometry.boom_length * boom.axis();
                let bucket_pin = place.at - geometry.bucket_length * pitch.axis();
                (bucket_pin - arm_pin).norm() - geometry.arm_length
            }
        };
        let lengths = geometry.cylinder_lengths(place.at, pitch, telescope).ok()?;
        let mut positions = self.mechanism.positions(&lengths);
        let (axis, position) = match free {
            Free::Boom(position) => (0, position),
            Free::Telescope(position) => (2, position),
        };
        // The elbow is always up: with the boom where it is, the arm may have to be on the other side.
        let is_same = (positions[axis] - position).abs() < 1e-6;
        // An axis that stands has one position: who moves it sees its reference stand, and not its rounding.
        positions[axis] = position;
        (is_same && positions.iter().all(|position| position.is_finite())).then_some(positions)
    }

    /// Whether the teeth can be at a place; the cost of the room that is left, m.
    fn judge(&self, place: &TipPlace, free: Free) -> Result<f64, Short> {
        let positions = self.positions(place, free).ok_or(Short::Reach)?;
        let mut cost: f64 = 0.0;
        let mut worst = (0.0, None);
        for (i, (position, (low, high))) in positions.iter().zip(self.limits).enumerate() {
            let room = (position - low).min(high - position);
            if room < worst.0 {
                worst = (room, Some(Short::Axis(i, *position)));
            }
            cost = cost.max(1.0 - room / ROOM);
        }
        worst.1.map_or(Ok(ROOM_COST * cost.max(0.0)), Err)
    }
}

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

impl Freedom {
    /// Chooses the free axis for a way; `telescope` is where the telescope has to stay, m.
    ///
    /// # Errors
    /// The teeth cannot go along the way.
    pub fn choose(cylinders: &Cylinders, way: &Way, telescope: Option<f64>) -> Result<Self, NoPosture> {
        let runs = way.runs();
        if let Some(position) = telescope {
            let places = runs.iter().flat_map(|run| stations(*run));
            for s in places {
                let judged = cylinders.judge(&way.place(s), Free::Telescope(position));
                judged.map_err(|short| NoPosture::Place(s, short))?;
            }
            return Ok(Self::Telescope(position));
        }
        for s in runs.iter().flat_map(|run| stations(*run)) {
            let short = (0..CHOICES).map(|choice| {
                let boom = of_choice(choice, cylinders.limits[0]);
                cylinders.judge(&way.place(s), Free::Boom(boom)).err()
            });
            // The least that is missing.
            let nearest = short.reduce(|a, b| if excess(&b, cylinders) < excess(&a, cylinders) { b } else { a });
            if let Some(Some(short)) = nearest {
                return Err(NoPosture::Place(s, short));
            }
        }
        // Straight from end to end of every run, or else with points between them.
        for longest in [f64::INFINITY, SEGMENT] {
            let parts = |(begin, end): (f64, f64)| ((end - begin) / longest).ceil().max(1.0);
            let segments: Vec<(f64, f64)> = runs
                .iter()
                .flat_map(|run| {
                    let parts = parts(*run);
                    // The last part ends where the run does, not a rounding error beside it.
                    let at = move |k: f64| if k < parts { run.0 + (run.1 - run.0) * k / parts } else { run.1 };
                    (0..parts as usize).map(move |k| (at(k as f64), at(k as f64 + 1.0)))
                })
                .collect();
            let Some(chosen) = choose_boom(cylinders, way, &segments) else { continue };
            let points: Vec<(f64, f64)> =
                std::iter::once(0.0).chain(segments.iter().map(|segment| segment.1)).zip(chosen).collect();
            let of_run = |run: &(f64, f64)| {
                let inside = |point: &&(f64, f64)| (run.0..=run.1).contains(&point.0);
                points.iter().filter(inside).copied().collect()
            };
            let found = Self::Boom(runs.iter().map(of_run).collect());
            let is_possible = |s: f64| cylinders.judge(&way.place(s), found.at(s)).is_ok();
            if runs.iter().flat_map(|run| stations(*run)).all(is_possible) {
                return Ok(found);
            }
        }
        let longest = runs.iter().max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))).copied().unwrap_or_default();
        Err(NoPosture::Run(longest.0, longest.1))
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
}

/// By how much a place is missed, m: 0 where it is not.
fn excess(short: &Option<Short>, cylinders: &Cylinders) -> f64 {
    match short {
        None => 0.0,
        Some(Short::Axis(i, position)) => {
            let (low, high) = cylinders.limits[*i];
            (low - position).max(position - high)
        }
        Some(Short::Reach) => f64::INFINITY,
    }
}

fn of_choice(choice: usize, (low, high): (f64, f64)) -> f64 {
    low + (high - low) * choice as f64 / (CHOICES - 1) as f64
}

/// Places of a run that are tried, s in m.
fn stations((begin, end): (f64, f64)) -> impl Iterator<Item = f64> {
    let parts = LEAST_PARTS.max(((end - begin) / STEP).ceil() as usize);
    (0..=parts).map(move |i| begin + (end - begin) * i as f64 / parts as f64)
}

/// The positions of the boom at the ends of all segments with the least cost, by dynamic programming from one to the
/// next; none where there is no way through. Between its ends the boom of a segment moves evenly.
fn choose_boom(cylinders: &Cylinders, way: &Way, segments: &[(f64, f64)]) -> Option<Vec<f64>> {
    let boom = |choice| of_choice(choice, cylinders.limits[0]);
    let mut costs = [0.0f64; CHOICES];
    let mut before: Vec<[usize; CHOICES]> = Vec::new();
    for (begin, end) in segments {
        let places: Vec<(f64, TipPlace)> =
            stations((*begin, *end)).map(|s| ((s - begin) / (end - begin), way.place(s))).collect();
        let (mut next, mut from) = ([f64::INFINITY; CHOICES], [0; CHOICES]);
        for (a, cost) in costs.iter().enumerate().filter(|(_, cost)| **cost < f64::INFINITY) {
            for b in 0..CHOICES {
                let moved = boom(b) - boom(a);
                let least = cost + moved.abs() + EVENNESS * moved * moved / (end - begin);
                if least >= next[b] {
                    continue;
                }
                let room = places.iter().try_fold(0.0f64, |room, (part, place)| {
                    cylinders.judge(place, Free::Boom(boom(a) + moved * part)).map(|cost| room.max(cost))
                });
                if let Ok(room) = room
                    && least + room < next[b]
                {
                    (next[b], from[b]) = (least + room, a);
                }
            }
        }
        costs = next;
        before.push(from);
    }
    let mut last = (0..CHOICES).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
    if costs[last] == f64::INFINITY {
        return None;
    }
    let mut chosen = vec![boom(last)];
    for from in before.iter().rev() {
        last = from[last];
        chosen.push(boom(last));
    }
    chosen.reverse();
    Some(chosen)
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
mod tests {
    use super::*;

    #[test]
    fn the_curve_goes_through_its_points_without_an_overshoot_or_a_kink() {
        let points = [(0.0, 0.2), (1.0, 0.5), (1.5, 0.5), (3.0, 0.1), (4.0, 0.9)];
        for (s, position) in points {
            assert!((curve(&points, s) - position).abs() < 1e-12);
        }
        assert!((curve(&[(1.0, 0.2), (3.0, 0.6)], 2.5) - 0.5).abs() < 1e-12, "a straight line between two points");
        let all: Vec<f64> = (0..=4000).map(|k| curve(&points, 1e-3 * f64::from(k))).collect();
        assert!(all[..1000].windows(2).all(|pair| pair[1] > pair[0]), "rises");
        assert!(all[1000..=1500].iter().all(|position| (position - 0.5).abs() < 1e-12), "stays");
        let slopes: Vec<f64> = all.windows(2).map(|pair| (pair[1] - pair[0]) / 1e-3).collect();
        assert!(slopes.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.01));
    }
}
