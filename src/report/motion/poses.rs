//! The machine in a few poses, seen from the side, with the path of its teeth.
//!
//! Lengths have the same scale in both directions.

use std::error::Error;

use mechanism::{AXES, Mechanism, Vector};
use plotters::{
    chart::ChartBuilder,
    coord::Shift,
    element::{Circle, PathElement, Polygon, Text},
    prelude::{Color, DrawingArea, DrawingBackend, IntoFont, RGBColor},
};

use super::{
    FONT, WHITE,
    side::{Drawn, Side},
    tick,
};
use crate::report::chart::{GROUND, one_scale};

/// Number of poses, evenly spread over time from the first row to the last.
const DRAWN: usize = 4;
/// Free space around everything that is drawn, m.
const MARGIN: f64 = 0.7;
const STRUCTURE: RGBColor = RGBColor(40, 40, 40);
const CYLINDER: RGBColor = RGBColor(0, 114, 178);
const PATH: RGBColor = RGBColor(213, 94, 0);
/// How much of its colour the first pose has; the last one has all of it.
const FAINTEST: f64 = 0.3;
/// How much of their colour the surfaces of bodies have.
const SURFACE: f64 = 0.12;
/// Distances of the times from the teeth, m: on one side and on the other in turn, as poses can be close together.
const BESIDE: [f64; 2] = [0.12, -0.75];

/// Positions of the pistons over time, from which poses and path are drawn.
pub struct Poses {
    side: Side,
    /// Least time between two rows that are kept, s.
    stretch: f64,
    /// s, m.
    rows: Vec<(f64, [f64; AXES])>,
    /// The last row, whether it is kept or not.
    last: Option<(f64, [f64; AXES])>,
}

impl Poses {
    /// No rows yet.
    pub fn new(mechanism: &Mechanism, stretch: f64) -> Self {
        Self { side: Side::new(mechanism), stretch, rows: Vec::new(), last: None }
    }

    /// Adds the positions of the pistons at `t` s.
    pub fn row(&mut self, t: f64, positions: [f64; AXES]) {
        if self.rows.last().is_none_or(|(kept, _)| t - kept >= self.stretch) {
            self.rows.push((t, positions));
        }
        self.last = Some((t, positions));
    }

    /// Draws poses and path.
    pub fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<(), Box<dyn Error + Send + Sync>>
    where
        B::ErrorType: 'static,
    {
        let rows: Vec<_> = self.rows.iter().chain(&self.last).copied().collect();
        let Some(end) = rows.len().checked_sub(1) else { return Ok(()) };
        let path: Vec<Vector> = rows.iter().map(|(_, positions)| self.side.tip(positions)).collect();
        let (begin, last) = (rows[0].0, rows[end].0);
        let shown = (0..DRAWN).map(|i| {
            let time = begin + (last - begin) * i as f64 / (DRAWN - 1) as f64;
            rows[rows.partition_point(|(t, _)| *t < time).min(end)]
        });
        let poses: Vec<(f64, Drawn)> = shown.map(|(t, positions)| (t, self.side.drawn(&positions))).collect();
        let all = || poses.iter().flat_map(|(_, drawn)| drawn.points()).chain(&path);

        let [x, z] = Self::ranges(area.dim_in_pixel(), all());
        let mut chart = ChartBuilder::on(area)
            .margin_right(40)
            .margin_bottom(10)
            .x_label_area_size(80)
            .y_label_area_size(90)
            .build_cartesian_2d(x.0..x.1, z.0..z.1)?;
        chart
            .configure_mesh()
            .x_desc("forward, m")
            .y_desc("above ground, m")
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .label_style((FONT, 26))
            .axis_desc_style((FONT, 30))
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(WHITE)
            .draw()?;
        let ground = PathElement::new([(x.0, 0.0), (x.1, 0.0)], GROUND.stroke_width(4));
        chart.draw_series([ground])?;
        let pairs = |points: &[Vector]| points.iter().map(|at| (at.x, at.z)).collect::<Vec<_>>();
        for (i, (_, Drawn { bodies, cylinders, links, .. })) in poses.iter().enumerate() {
            let part = FAINTEST + (1.0 - FAINTEST) * i as f64 / (DRAWN - 1) as f64;
            let surface = |points: &Vec<Vector>| Polygon::new(pairs(points), STRUCTURE.mix(SURFACE * part).filled());
            chart.draw_series(bodies.iter().map(surface))?;
            let edge = |points: &Vec<Vector>| {
                let closed = [&points[..], &points[..1]].concat();
                PathElement::new(pairs(&closed), STRUCTURE.mix(part).stroke_width(4))
            };
            chart.draw_series(bodies.iter().map(edge))?;
            let line = |points: &Vec<Vector>, colour: RGBColor| {
                PathElement::new(pairs(points), colour.mix(part).stroke_width(5))
            };
            chart.draw_series(cylinders.iter().map(|points| line(points, CYLINDER)))?;
            chart.draw_series([line(links, STRUCTURE)])?;
        }
        chart.draw_series([PathElement::new(pairs(&path), PATH.stroke_width(4))])?;
        let dots = poses.iter().map(|(_, drawn)| Circle::new((drawn.tip.x, drawn.tip.z), 7, PATH.filled()));
        chart.draw_series(dots)?;
        let times = poses.iter().zip(BESIDE.iter().cycle()).map(|((t, Drawn { tip, .. }), beside)| {
            Text::new(format!("{t:.1} s"), (tip.x + beside, tip.z), (FONT, 26).into_font())
        });
        chart.draw_series(times)?;
        Ok(())
    }

    /// Ranges of x and z that hold all points and the ground at the centre of swing, with one scale for both.
    fn ranges<'a>((width, height): (u32, u32), points: impl Iterator<Item = &'a Vector>) -> [(f64, f64); 2] {
        let start = [(0.0f64, 0.0f64); 2];
        let edges = points.fold(start, |[x, z], at| [(x.0.min(at.x), x.1.max(at.x)), (z.0.min(at.z), z.1.max(at.z))]);
        // The labels take about as much on both sides.
        let (width, height) = (f64::from(width.saturating_sub(130)), f64::from(height.saturating_sub(90)));
        one_scale(edges, MARGIN, width / height)
    }
}
