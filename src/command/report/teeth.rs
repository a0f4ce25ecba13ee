//! The bucket's teeth: where they went, how far they were from their way, and the ground that they have cut.
//!
//! ```text
//! ground(x) = lowest z of the teeth at x, where that is below 0
//! ```
//!
//! x forward of the centre of swing and z above the ground that the machine stands on, m. A line from tick to tick is
//! taken between two places of the teeth.

use std::{collections::BTreeMap, error::Error};

use pipeline::{
    message::{TeethState, TipState},
    statistics::ErrorStatistics,
};
use plotters::prelude::Color;

use super::{
    line::{Line, Spread},
    models::{chart, line},
};
use crate::report::{
    chart::{COLOURS, Chart, GROUND, HALF, Mark, Series, WIDE, one_scale},
    page::{Figure, Page},
    table::number,
};

/// Distance of two places at which the ground is known, m.
const STEP: f64 = 0.05;
/// Largest way between two ticks that is one motion, m.
const ONE_MOTION: f64 = 0.5;
/// Most places of the ground: a reach of 100 m.
const MOST_PLACES: f64 = 100.0 / STEP;
/// Free space around the picture from the side, m, and the width of its panel by the height.
const MARGIN: f64 = 0.3;
const ASPECT: f64 = 2.9;

/// What a recording tells of the teeth.
#[derive(Debug)]
pub struct TeethStory {
    /// `[x, z]`, m.
    path: Spread<[f64; 2]>,
    /// Distance from the way, mm, and error of the pitch, degrees, while there is a way.
    errors: [Line; 2],
    /// What the bucket carries, kg.
    payload: Line,
    /// The least and the most of it, kg.
    payloads: (f64, f64),
    /// Distance from the way, m, and error of the pitch, degrees, over all ticks on the way.
    statistics: [ErrorStatistics; 2],
    /// Ground by the number of its place, m.
    ground: BTreeMap<i32, f64>,
    last: Option<[f64; 2]>,
}

impl TeethStory {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            path: Spread::new(),
            errors: [Line::new(), Line::new()],
            payload: Line::new(),
            payloads: (f64::INFINITY, f64::NEG_INFINITY),
            statistics: [ErrorStatistics::default(); 2],
            ground: BTreeMap::new(),
            last: None,
        }
    }

    /// Takes in the teeth at `t` s.
    pub fn look(&mut self, t: f64, teeth: &TeethState) {
        let at = [teeth.x, teeth.z];
        if teeth.state == TipState::Unknown as u32 || !at.iter().all(|value| value.is_finite()) {
            self.cut(t);
            return;
        }
        self.path.push(t, || at);
        self.dig(at);
        self.payload.push(t, teeth.payload);
        self.payloads = (self.payloads.0.min(teeth.payload), self.payloads.1.max(teeth.payload));
        if teeth.state == TipState::OnTheWay as u32 {
            let errors = [teeth.error, teeth.pitch_error.to_degrees()];
            self.statistics.iter_mut().zip(errors).for_each(|(statistics, error)| statistics.push(error));
            self.errors.iter_mut().zip([1e3 * errors[0], errors[1]]).for_each(|(line, error)| line.push(t, error));
        } else {
            self.errors.iter_mut().for_each(|line| line.cut(t));
        }
    }

    /// Nothing is known of the teeth at `t` s.
    pub fn cut(&mut self, t: f64) {
        self.errors.iter_mut().chain([&mut self.payload]).for_each(|line| line.cut(t));
        self.last = None;
    }

    /// The ground between the last place and this one.
    fn dig(&mut self, to: [f64; 2]) {
        let near = |from: &[f64; 2]| (to[0] - from[0]).hypot(to[1] - from[1]) <= ONE_MOTION;
        let from = self.last.replace(to).filter(near).unwrap_or(to);
        let [first, last] = [from[0].min(to[0]), from[0].max(to[0])].map(|x| (x / STEP).round());
        if first.abs().max(last.abs()) > MOST_PLACES {
            return;
        }
        for place in first as i32..=last as i32 {
            let part = (f64::from(place) * STEP - from[0]) / (to[0] - from[0]);
            let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 1.0 };
            let z = from[1] + part * (to[1] - from[1]);
            if z < 0.0 {
                self.ground.entry(place).and_modify(|ground| *ground = ground.min(z)).or_insert(z);
            }
        }
    }

    /// A section of the page; nothing where nothing is known of the teeth.
    ///
    /// # Errors
    /// The library cannot draw a picture.
    pub fn add_to(&self, page: &mut Page, period: f64) -> Result<(), Box<dyn Error + Send + Sync>> {
        if self.path.kept().is_empty() {
            return Ok(());
        }
        page.section("The bucket's teeth");
        page.facts(&self.facts(period));
        let over_time = |title: &str, label: &str, line_of: &Line| {
            chart(title, label, HALF, vec![line("", line_of.points(), COLOURS[0], 2)])
        };
        let mut charts = vec![
            self.side(),
            over_time("Distance of the teeth from their way", "distance, mm", &self.errors[0]),
            over_time("Pitch minus the planned one", "pitch, degrees", &self.errors[1]),
        ];
        if self.payloads.0 < self.payloads.1 {
            charts.push(over_time("What the bucket carries, by the chamber pressures", "payload, kg", &self.payload));
        }
        let captions = ["The ground is taken to be level, at the height on which the machine stands.", "", "", ""];
        let shown = charts.into_iter().zip(captions).filter(|(chart, _)| chart.has_points());
        let figure = |(chart, caption): (Chart, &str)| Figure { chart, caption: caption.to_owned() };
        page.pictures(&shown.map(figure).collect::<Vec<_>>())
    }

    fn facts(&self, period: f64) -> Vec<(&'static str, String)> {
        let [distance, pitch] = &self.statistics;
        let of = |errors: &ErrorStatistics, factor: f64, unit: &str| {
            format!("{} {unit} rms, {} at most", number(factor * errors.rmse()), number(factor * errors.max))
        };
        let mut facts = Vec::new();
        if distance.count > 0 {
            facts.extend([
                ("on their way", format!("{} s", number(distance.count as f64 * period))),
                ("distance from it", of(distance, 1e3, "mm")),
                ("pitch from the planned one", of(pitch, 1.0, "degrees")),
            ]);
        } else {
            facts.push(("on their way", "never: they followed no task".to_owned()));
        }
        let deepest = self.ground.iter().min_by(|a, b| a.1.total_cmp(b.1));
        facts.extend(deepest.map(|(place, z)| {
            let x = STEP * f64::from(*place);
            ("below the ground", format!("{} m at most, {x:.2} m forward of the centre of swing", number(-z)))
        }));
        facts
    }

    /// Path and ground from the side, with one scale for both directions.
    fn side(&self) -> Chart {
        let path: Vec<(f64, f64)> = self.path.kept().iter().map(|(_, [x, z])| (*x, *z)).collect();
        let mut cut: Vec<(f64, f64)> = Vec::new();
        let at = |place: i32, z: f64| (STEP * f64::from(place), z);
        for (place, z) in &self.ground {
            if !self.ground.contains_key(&(place - 1)) {
                cut.push(at(*place, 0.0));
            }
            cut.push(at(*place, *z));
            if !self.ground.contains_key(&(place + 1)) {
                cut.extend([at(*place, 0.0), (0.0, f64::NAN)]);
            }
        }
        let frame = frame(path.iter().chain(cut.iter().filter(|point| point.1.is_finite())));
        let level = vec![(frame[0].0, 0.0), (frame[0].1, 0.0)];
        let area = Series { name: "cut".to_owned(), points: cut, colour: GROUND.mix(0.5), mark: Mark::Area };
        let mut series = vec![line("ground", level, GROUND, 3), line("teeth", path, COLOURS[0], 2)];
        if !self.ground.is_empty() {
            series.insert(0, area);
        }
        let mut chart = chart("The teeth from the side", "above ground, m", WIDE, series);
        chart.labels[0] = "forward, m".to_owned();
        chart.frame = Some(frame);
        chart
    }
}

/// Ranges of x and z that hold the points, with one scale.
fn frame<'a>(points: impl Iterator<Item = &'a (f64, f64)>) -> [(f64, f64); 2] {
    let start = [(f64::INFINITY, f64::NEG_INFINITY), (0.0, 0.0)];
    let [x, z] = points.fold(start, |[x, z], at| [(x.0.min(at.0), x.1.max(at.0)), (z.0.min(at.1), z.1.max(at.1))]);
    one_scale([x, z], MARGIN, ASPECT)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn teeth(x: f64, z: f64, state: TipState) -> TeethState {
        TeethState { x, z, error: 0.004, pitch_error: 0.1, state: state as u32, ..TeethState::default() }
    }

    #[test]
    fn the_ground_is_the_lowest_place_of_the_teeth_and_has_no_holes() {
        let mut story = TeethStory::new();
        // Down at 6 m, back to 5 m 0.2 m below ground, and up; then once more, less deep.
        for (k, (x, z)) in
            [(6.0, 0.3), (6.0, -0.2), (5.8, -0.2), (5.4, -0.2), (5.0, -0.2), (5.0, 0.3)].iter().enumerate()
        {
            story.look(k as f64, &teeth(*x, *z, TipState::OnTheWay));
        }
        story.look(6.0, &teeth(5.0, 0.3, TipState::Known));
        story.look(7.0, &teeth(5.5, -0.1, TipState::Known));
        let places: Vec<i32> = story.ground.keys().copied().collect();
        assert_eq!(places, (100..=120).collect::<Vec<_>>());
        assert!(story.ground.values().all(|z| (*z + 0.2).abs() < 1e-12), "{:?}", story.ground);
        assert_eq!(story.facts(0.5)[0].1, "3.0000 s");
        assert_eq!(story.facts(0.5)[1].1, "4.0000 mm rms, 4.0000 at most");
        assert_eq!(story.facts(0.5).last().unwrap().1, "0.20000 m at most, 5.00 m forward of the centre of swing");
    }

    #[test]
    fn teeth_that_jump_or_are_nowhere_cut_nothing_between() {
        let mut story = TeethStory::new();
        story.look(0.0, &teeth(3.0, -0.1, TipState::Known));
        story.look(1.0, &teeth(6.0, -0.1, TipState::Known));
        story.look(2.0, &TeethState::default());
        story.look(3.0, &teeth(6.4, -0.1, TipState::Known));
        story.look(4.0, &teeth(1e9, -0.1, TipState::Known));
        story.look(5.0, &teeth(f64::NAN, -0.1, TipState::Known));
        assert_eq!(story.ground.keys().copied().collect::<Vec<_>>(), [60, 120, 128]);
        assert_eq!(story.facts(0.01)[0].1, "never: they followed no task");
    }

    #[test]
    fn a_picture_from_the_side_has_one_scale_and_holds_all_points() {
        let [x, z] = frame([(3.0, 0.5), (7.0, -2.0)].iter());
        assert!((x.1 - x.0 - ASPECT * (z.1 - z.0)).abs() < 1e-9);
        assert!(x.0 < 3.0 && x.1 > 7.0 && z.0 < -2.0 && z.1 > 0.5);
    }
}
