//! A picture of the motion: commands and positions over time, one colour per axis; and beside them a machine with a
//! mechanism in a few poses, with the path of its teeth.

mod poses;

use std::error::Error;

use mechanism::Mechanism;
use pipeline::message::ValveCommand;
use plant_sim::TrueState;
use plotters::{
    chart::ChartBuilder,
    coord::Shift,
    element::{PathElement, Text},
    prelude::{Color, DrawingArea, IntoDrawingArea, IntoFont, RGBAColor, RGBColor, SVGBackend, WHITE},
    series::LineSeries,
};

/// Width and height. Coordinates are whole numbers; the picture is larger than on a page, so that lines are smooth.
const SIZE: (u32, u32) = (1600, 1200);
/// Width of the poses beside the curves.
const POSES: u32 = 1200;
/// Height of title and legend.
const HEAD: u32 = 110;
/// Distance from the left edge to the panels.
const LEFT: u32 = 140;
/// Stretches that the time is divided into. Each is drawn by its lowest and its highest point.
const STRETCHES: f64 = 1000.0;
/// Free space above and below the lines, as a part of their height.
const MARGIN: f64 = 0.05;

use poses::Poses;

use crate::report::chart::{COLOURS, FONT, range, tick};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The lines of the picture, collected row by row.
pub struct Plot {
    title: String,
    is_controlled: bool,
    axes: Vec<AxisCurves>,
    poses: Option<Poses>,
}

struct AxisCurves {
    index: usize,
    name: String,
    command: Curve,
    position: Curve,
    reference: Curve,
}

/// A curve through points (s, value), thinned so that no extreme is lost.
struct Curve {
    points: Vec<(f64, f64)>,
    /// Length of a stretch, s.
    stretch: f64,
    /// Begin, lowest and highest point of the stretch that is not closed yet.
    open: Option<[(f64, f64); 3]>,
}

impl Plot {
    /// An empty picture for `axes`, index and name, over `duration` s. Controlled axes have a reference.
    pub fn new(
        title: String,
        axes: Vec<(usize, String)>,
        is_controlled: bool,
        duration: f64,
        mechanism: Option<&Mechanism>,
    ) -> Self {
        let line = || Curve { points: Vec::new(), stretch: duration / STRETCHES, open: None };
        let lines = |(index, name)| AxisCurves { index, name, command: line(), position: line(), reference: line() };
        let poses = mechanism.map(|mechanism| Poses::new(mechanism, duration / STRETCHES));
        Self { title, is_controlled, axes: axes.into_iter().map(lines).collect(), poses }
    }

    /// Adds the states at `t` s, and the command that is held from then on.
    pub fn row(&mut self, t: f64, states: &[TrueState], command: &ValveCommand) {
        if let Some(poses) = &mut self.poses {
            poses.row(t, std::array::from_fn(|i| states[i].position));
        }
        for axis in &mut self.axes {
            let control = &command.axes[axis.index];
            axis.command.push(t, control.command);
            axis.position.push(t, 1e3 * states[axis.index].position);
            if self.is_controlled {
                axis.reference.push(t, 1e3 * control.reference);
            }
        }
    }

    /// The picture as SVG.
    ///
    /// # Errors
    /// The library cannot draw it.
    pub fn svg(mut self) -> Result<String, Box<dyn Error + Send + Sync>> {
        for axis in &mut self.axes {
            for line in [&mut axis.command, &mut axis.position, &mut axis.reference] {
                line.close();
            }
        }
        let mut text = String::new();
        let width = SIZE.0 + if self.poses.is_some() { POSES } else { 0 };
        let area = SVGBackend::with_string(&mut text, (width, SIZE.1)).into_drawing_area();
        area.fill(&WHITE)?;
        let (curves, poses) = area.split_horizontally(SIZE.0);
        self.draw(&curves)?;
        if let Some(drawn) = &self.poses {
            drawn.draw(&poses.split_vertically(HEAD).1)?;
        }
        drop((area, curves, poses));
        Ok(text)
    }

    fn draw(&self, area: &Area) -> Result<(), Box<dyn Error + Send + Sync>> {
        let (head, panels) = area.split_vertically(HEAD);
        let (upper, lower) = panels.split_vertically((SIZE.1 - HEAD) / 2);
        self.draw_head(&head)?;
        let commands: Vec<_> = (self.axes.iter())
            .map(|axis| (axis.command.held(), COLOURS[axis.index % COLOURS.len()].to_rgba()))
            .collect();
        let positions: Vec<_> = (self.axes.iter())
            .flat_map(|axis| {
                let colour = COLOURS[axis.index % COLOURS.len()];
                [(axis.reference.points.clone(), light(colour)), (axis.position.points.clone(), colour.to_rgba())]
            })
            .collect();
        panel(&upper, "valve command", &commands, 0.01)?;
        panel(&lower, "position, mm", &positions, 1.0)
    }

    /// Draws the title, and below it a stroke and a name for every axis.
    fn draw_head(&self, area: &Area) -> Result<(), Box<dyn Error + Send + Sync>> {
        area.draw(&Text::new(self.title.clone(), (LEFT as i32, 18), (FONT, 34).into_font()))?;
        let mut entries: Vec<_> =
            self.axes.iter().map(|axis| (axis.name.clone(), COLOURS[axis.index % COLOURS.len()].to_rgba())).collect();
        if self.is_controlled {
            entries.push(("reference".to_owned(), light(RGBColor(0, 0, 0))));
        }
        let width = ((SIZE.0 - LEFT) as usize / entries.len().max(6)) as i32;
        for (i, (name, colour)) in entries.into_iter().enumerate() {
            let x = LEFT as i32 + i as i32 * width;
            area.draw(&PathElement::new([(x, 84), (x + 44, 84)], colour.stroke_width(5)))?;
            area.draw(&Text::new(name, (x + 56, 68), (FONT, 28).into_font()))?;
        }
        Ok(())
    }
}

/// The colour of a reference, beside its position.
fn light(colour: RGBColor) -> RGBAColor {
    colour.mix(0.4)
}

/// Draws one panel: lines over time. A flat line gets the space `least` above and below.
fn panel(
    area: &Area,
    label: &str,
    lines: &[(Vec<(f64, f64)>, RGBAColor)],
    least: f64,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let points = || lines.iter().flat_map(|(points, _)| points);
    let (begin, end) = range(points().map(|point| point.0), 0.0, 0.0);
    let (low, high) = range(points().map(|point| point.1), MARGIN, least);
    // A single row has no duration; with one second its point is still visible.
    let end = if end > begin { end } else { begin + 1.0 };
    let mut chart = ChartBuilder::on(area)
        .margin_left(20)
        .margin_right(40)
        .margin_bottom(10)
        .x_label_area_size(80)
        .y_label_area_size(LEFT - 20)
        .build_cartesian_2d(begin..end, low..high)?;
    chart
        .configure_mesh()
        .x_desc("time, s")
        .y_desc(label)
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .label_style((FONT, 26))
        .axis_desc_style((FONT, 30))
        .bold_line_style(RGBColor(210, 210, 210))
        .light_line_style(WHITE)
        .draw()?;
    for (points, colour) in lines {
        chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(3)))?;
    }
    Ok(())
}

impl Curve {
    fn push(&mut self, t: f64, value: f64) {
        let point = (t, value);
        match &mut self.open {
            Some([begin, low, high]) if t - begin.0 < self.stretch => {
                if value < low.1 {
                    *low = point;
                }
                if value > high.1 {
                    *high = point;
                }
            }
            _ => {
                self.close();
                self.open = Some([point; 3]);
            }
        }
    }

    /// Closes the present stretch.
    fn close(&mut self) {
        let Some([_, low, high]) = self.open.take() else { return };
        let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        self.points.push(first);
        if second != first {
            self.points.push(second);
        }
    }

    /// The points as steps: each value is held until the next one.
    fn held(&self) -> Vec<(f64, f64)> {
        let first = self.points.first().copied();
        let steps = self.points.windows(2).flat_map(|pair| [(pair[1].0, pair[0].1), pair[1]]);
        first.into_iter().chain(steps).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_thinned_and_keeps_its_extremes() {
        let mut line = Curve { points: Vec::new(), stretch: 100.0 / STRETCHES, open: None };
        for i in 0..100_000 {
            let spike = if i == 34_567 { 5.0 } else { 0.0 };
            line.push(f64::from(i) * 1e-3, f64::from(i).sin() + spike);
        }
        line.close();
        assert!((1000..=2002).contains(&line.points.len()), "{}", line.points.len());
        assert!(line.points.contains(&(34.567, f64::from(34_567).sin() + 5.0)));
        assert!(line.points.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }

    #[test]
    fn a_short_line_is_drawn_whole() {
        let mut line = Curve { points: Vec::new(), stretch: 4.0 / STRETCHES, open: None };
        let points = [(1.0, 0.5), (2.0, -0.5), (2.1, 0.25), (5.0, 0.0)];
        points.iter().for_each(|(t, value)| line.push(*t, *value));
        line.close();
        assert_eq!(line.points, points);
        assert_eq!(line.held()[..3], [(1.0, 0.5), (2.0, 0.5), (2.0, -0.5)]);
    }
}
