//! The adaptive model over time: its coefficients, and what it forgets or which estimators it is made of.

use pipeline::hammerstein::Coefficients;

use super::{
    super::{course::Moment, report::BankMember},
    Picture, Shown,
    style::line,
};
use crate::report::{
    chart::{COLOURS, Chart, HALF, Series, WIDE, tick},
    figures::CoefficientLists,
};

/// Models that are kept.
const POINTS: usize = 1200;
/// A member is shown if its weight was as large as this once.
const LEAST_WEIGHT: f64 = 0.1;

/// The models at some rows.
#[derive(Debug)]
pub struct History {
    /// Rows from one to the next.
    every: usize,
    points: Vec<Point>,
    /// Names of the members.
    members: Vec<String>,
}

#[derive(Debug)]
struct Point {
    row: usize,
    model: Coefficients,
    forgetting_factor: f64,
    weights: Vec<f64>,
}

impl History {
    /// For a record of so many rows.
    pub fn new(rows: usize) -> Self {
        Self { every: rows.div_ceil(POINTS).max(1), points: Vec::new(), members: Vec::new() }
    }

    /// Keeps the model of this row, if it is its turn.
    pub fn see(&mut self, moment: &Moment<'_>) {
        if !moment.is_trained() || !moment.row.is_multiple_of(self.every) {
            return;
        }
        let members: Vec<_> = moment.identifier.bank().map_or_else(Vec::new, |bank| bank.members().collect());
        if self.members.is_empty() {
            self.members = members.iter().map(|member| BankMember::from(*member).name()).collect();
        }
        self.points.push(Point {
            row: moment.row,
            model: moment.snapshot.adaptive,
            forgetting_factor: moment.snapshot.forgetting_factor,
            weights: members.iter().map(|(_, _, weight)| *weight).collect(),
        });
    }

    /// The pictures: weights or forgetting factor, then a, b, f and g.
    pub(super) fn pictures(&self, shown: &Shown<'_>) -> Vec<Picture> {
        if self.points.is_empty() {
            return Vec::new();
        }
        let mut pictures = vec![if self.members.is_empty() { self.factor(shown) } else { self.weights(shown) }];
        let lists = |of: fn(CoefficientLists) -> Vec<f64>| {
            let rows: Vec<Vec<f64>> = self.points.iter().map(|point| of(CoefficientLists::new(&point.model))).collect();
            rows
        };
        let held = CoefficientLists::new(&shown.identifier.snapshot().classical);
        for (name, first, rows, held, what) in [
            ("a", 1, lists(|of| of.a), held.a, "the effect of past outputs"),
            ("b", 0, lists(|of| of.b), held.b, "the effect of the commands behind N"),
            ("f", 1, lists(|of| of.f), held.f, "the shape of N(u) for u >= 0"),
            ("g", 1, lists(|of| of.g), held.g, "the shape of N(u) for u < 0"),
        ] {
            let chart = self.coefficients(shown, (name, first), &rows, &held);
            pictures.push(Picture { chart, caption: format!("{name} is {what}. Thin lines: the held model.") });
        }
        pictures
    }

    /// The line through one value of each point, broken at gaps.
    fn line(&self, shown: &Shown<'_>, value: impl Fn(&Point, usize) -> f64) -> Vec<(f64, f64)> {
        let mut line = Vec::new();
        let mut before = None;
        for (i, point) in self.points.iter().enumerate() {
            let gap = before.is_some_and(|before| shown.record.begins[before + 1..=point.row].contains(&true));
            if gap {
                line.push((shown.axis.times[point.row], f64::NAN));
            }
            line.push((shown.axis.times[point.row], value(point, i)));
            before = Some(point.row);
        }
        line
    }

    fn chart(title: &str, label: &str, size: (u32, u32), series: Vec<Series>) -> Chart {
        Chart {
            title: title.to_owned(),
            size,
            labels: ["time, s".to_owned(), label.to_owned()],
            tick,
            y_tick: None,
            series,
            notes: Vec::new(),
            frame: None,
        }
    }

    fn factor(&self, shown: &Shown<'_>) -> Picture {
        let points = self.line(shown, |point, _| point.forgetting_factor);
        let chart = Self::chart("Forgetting factor", "factor", WIDE, vec![line("", points, COLOURS[0], 2)]);
        let caption = "1 remembers everything; at 0.99 a sample counts e times less after 100 samples.".to_owned();
        Picture { chart, caption }
    }

    fn weights(&self, shown: &Shown<'_>) -> Picture {
        let largest = |i: usize| self.points.iter().map(|point| weight(point, i)).fold(0.0, f64::max);
        let mut shown_members: Vec<usize> = (0..self.members.len()).filter(|i| largest(*i) >= LEAST_WEIGHT).collect();
        let mean = |i: &usize| self.points.iter().map(|point| weight(point, *i)).sum::<f64>();
        shown_members.sort_by(|a, b| mean(b).total_cmp(&mean(a)));
        shown_members.truncate(COLOURS.len());
        let series = shown_members.iter().zip(COLOURS).map(|(i, colour)| {
            line(&self.members[*i], self.line(shown, |point, _| 100.0 * weight(point, *i)), colour, 3)
        });
        let chart = Self::chart("Weights of the estimators in auto", "weight, %", WIDE, series.collect());
        let caption =
            "The adaptive model is the weighted mean of several estimators; those whose weight was 10 % once \
                       are shown. Each name has the form and the forgetting factor."
                .to_owned();
        Picture { chart, caption }
    }

    fn coefficients(&self, shown: &Shown<'_>, (name, first): (&str, usize), rows: &[Vec<f64>], held: &[f64]) -> Chart {
        let count = rows.iter().map(Vec::len).max().unwrap_or_default();
        let mut series = Vec::new();
        let (begin, end) = (self.points[0].row, self.points[self.points.len() - 1].row);
        for (i, colour) in (0..count).zip(COLOURS) {
            let points = self.line(shown, |_, point| rows[point].get(i).copied().unwrap_or(f64::NAN));
            series.push(line(&format!("{name}_{}", i + first), points, colour, 3));
            if let Some(value) = held.get(i) {
                let ends = [begin, end].map(|row| (shown.axis.times[row], *value));
                series.push(line("", ends.to_vec(), colour, 1));
            }
        }
        Self::chart(&format!("{name} over time"), "coefficient", HALF, series)
    }
}

fn weight(point: &Point, member: usize) -> f64 {
    point.weights.get(member).copied().unwrap_or_default()
}
