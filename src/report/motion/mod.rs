//! A picture of the motion over time, one colour for each axis. Beside it a machine with a mechanism is drawn in a few
//! poses, with the path of its teeth.
//!
//! | panel | shows |
//! |---|---|
//! | upper | valve commands |
//! | middle | positions, and the references as thin dashed lines above them |
//! | lower | following errors |
//! | bars | who commands each axis; of a single axis the background of the panels says it |
//!
//! Without a controller there are only commands and positions.

mod curve;
pub mod outline;
mod poses;
mod raster;
pub mod side;

use std::{error::Error, path::Path};

use mechanism::Mechanism;
use pipeline::message::ControlMode;
use plotters::{
    chart::ChartBuilder,
    coord::Shift,
    element::{PathElement, Rectangle, Text},
    prelude::{
        BLACK, Color, DashedLineSeries, DrawingArea, DrawingBackend, IntoDrawingArea, IntoFont, RGBColor, SVGBackend,
        WHITE,
    },
    series::LineSeries,
};

use super::{
    chart::{COLOURS, FONT, range, register_font, tick},
    output::{OutputError, is_stdout},
};
use curve::{Curve, Spans, held, stretch};
use poses::Poses;

/// Width of the curves. Coordinates are whole numbers; the picture is larger than on a page, so that lines are smooth.
const WIDTH: u32 = 1600;
/// Height of one panel.
const PANEL: u32 = 480;
/// Width of the poses beside the curves.
const POSES: u32 = 1200;
/// Height of title and legend.
const HEAD: u32 = 110;
/// Height that the legend of who commands adds to it.
const SECOND_ROW: u32 = 46;
/// Height of the bar of one axis.
const BAR: u32 = 34;
/// Height of the label above the bars.
const BARS_HEAD: u32 = 44;
/// Distance from the left edge to the panels.
const LEFT: u32 = 150;
/// Distance from the right edge to the panels.
const RIGHT: u32 = 40;
/// Free space above and below the lines, as a part of their height.
const MARGIN: f64 = 0.05;
/// Length of the strokes and of the gaps of a reference.
const DASH: (u32, u32) = (16, 12);
/// Who commands: number of the [`ControlMode`], name, colour.
const COMMANDERS: [(u32, &str, RGBColor); 3] = [
    (ControlMode::Neutral as u32, "neutral or latched", RGBColor(226, 226, 226)),
    (ControlMode::Fallback as u32, "fallback", RGBColor(255, 224, 178)),
    (ControlMode::Model as u32, "model", RGBColor(200, 230, 201)),
];

type Drawn = Result<(), Box<dyn Error + Send + Sync>>;

/// The format of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Lines and texts, of any size.
    Svg,
    /// Pixels.
    Png,
}

impl Format {
    /// The format by the ending of a file's name; SVG for standard output.
    ///
    /// # Errors
    /// The ending is another one.
    pub fn of(option: &'static str, path: &Path) -> Result<Self, OutputError> {
        if is_stdout(path) {
            return Ok(Self::Svg);
        }
        match path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(OutputError::NoPicture { option, path: path.to_owned() }),
        }
    }
}

/// An axis at one time; SI units. NaN is a gap.
#[derive(Debug, Clone, Copy)]
pub struct AxisPoint {
    /// In [-1, 1].
    pub command: f64,
    /// m.
    pub position: f64,
    /// m.
    pub reference: f64,
    /// Following error, m.
    pub error: f64,
    /// Number of the [`ControlMode`].
    pub mode: u32,
}

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
    error: Curve,
    mode: Spans,
}

/// One line of a panel, without a gap.
struct Line {
    points: Vec<(f64, f64)>,
    colour: RGBColor,
    is_dashed: bool,
}

/// The lines of one panel.
struct Panel {
    label: &'static str,
    lines: Vec<Line>,
    /// Space above and below a flat line.
    least: f64,
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
        let line = || Curve::new(stretch(duration));
        let curves = |(index, name)| AxisCurves {
            index,
            name,
            command: line(),
            position: line(),
            reference: line(),
            error: line(),
            mode: Spans::default(),
        };
        let poses = mechanism.map(|mechanism| Poses::new(mechanism, stretch(duration)));
        Self { title, is_controlled, axes: axes.into_iter().map(curves).collect(), poses }
    }

    /// Adds the axes, by index, at `t` s. Their commands are held from then on.
    pub fn row(&mut self, t: f64, axis_at: impl Fn(usize) -> AxisPoint) {
        if let Some(poses) = &mut self.poses {
            poses.row(t, std::array::from_fn(|i| axis_at(i).position));
        }
        for axis in &mut self.axes {
            let point = axis_at(axis.index);
            axis.command.push(t, point.command);
            axis.position.push(t, 1e3 * point.position);
            if self.is_controlled {
                axis.reference.push(t, 1e3 * point.reference);
                axis.error.push(t, 1e3 * point.error);
                axis.mode.push(t, point.mode);
            }
        }
    }

    /// The picture as a file of this format.
    ///
    /// # Errors
    /// The library cannot draw it.
    pub fn file(self, format: Format) -> Result<Vec<u8>, Box<dyn Error + Send + Sync>> {
        register_font();
        let height = self.head() + PANEL * if self.is_controlled { 3 } else { 2 } + self.bars();
        let size = (WIDTH + if self.poses.is_some() { POSES } else { 0 }, height);
        match format {
            Format::Svg => {
                let mut text = String::new();
                self.draw(&SVGBackend::with_string(&mut text, size).into_drawing_area())?;
                Ok(text.into_bytes())
            }
            Format::Png => raster::png(size, |area| self.draw(area)),
        }
    }

    /// Height of title and legend.
    fn head(&self) -> u32 {
        HEAD + if self.is_controlled { SECOND_ROW } else { 0 }
    }

    /// Whether there is a bar for each axis. Of a single axis the background of the panels says the same.
    fn has_bars(&self) -> bool {
        self.is_controlled && self.axes.len() > 1
    }

    /// Height of the bars.
    fn bars(&self) -> u32 {
        if self.has_bars() { BARS_HEAD + BAR * self.axes.len() as u32 + 10 } else { 0 }
    }

    fn draw<B: DrawingBackend>(self, area: &DrawingArea<B, Shift>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        area.fill(&WHITE)?;
        let (curves, beside) = area.split_horizontally(WIDTH);
        let (head, panels) = curves.split_vertically(self.head());
        self.draw_head(&head)?;
        if let Some(poses) = &self.poses {
            poses.draw(&beside.split_vertically(HEAD).1)?;
        }
        let (names, modes): (Vec<_>, Vec<_>) =
            (self.axes.iter()).map(|axis| (axis.name.clone(), axis.mode.all().to_vec())).unzip();
        // Several axes would have to share the background.
        let shades = if modes.len() == 1 { modes[0].clone() } else { Vec::new() };
        let has_bars = self.has_bars();
        let drawn = self.panels();
        let all = || drawn.iter().flat_map(|panel| &panel.lines).flat_map(|line| &line.points);
        let (begin, end) = range(all().map(|point| point.0), 0.0, 0.0);
        // A single row has no duration; with one second its point is still visible.
        let time = (begin, if end > begin { end } else { begin + 1.0 });
        let mut rest = panels;
        for panel in &drawn {
            let (upper, lower) = rest.split_vertically(PANEL);
            panel.draw(&upper, time, &shades)?;
            rest = lower;
        }
        if has_bars { draw_bars(&rest, time, &names, &modes) } else { Ok(()) }
    }

    /// The panels from the upper one to the lower one.
    fn panels(self) -> Vec<Panel> {
        let (mut commands, mut positions, mut references, mut errors) = (vec![], vec![], vec![], vec![]);
        for axis in self.axes {
            let colour = COLOURS[axis.index % COLOURS.len()];
            let line = |points| Line { points, colour, is_dashed: false };
            commands.extend(axis.command.pieces().iter().map(|piece| line(held(piece))));
            positions.extend(axis.position.pieces().into_iter().map(line));
            // Above the position, so that both are seen where they coincide.
            let reference = |points| Line { points, colour: BLACK, is_dashed: true };
            references.extend(axis.reference.pieces().into_iter().map(reference));
            errors.extend(axis.error.pieces().into_iter().map(line));
        }
        positions.extend(references);
        let mut panels = vec![
            Panel { label: "valve command", lines: commands, least: 0.01 },
            Panel { label: "position, mm", lines: positions, least: 1.0 },
        ];
        if self.is_controlled {
            panels.push(Panel { label: "following error, mm", lines: errors, least: 0.1 });
        }
        panels
    }

    /// Draws the title; below it a stroke and a name for every axis; and below these the colours of who commands.
    fn draw_head<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        area.draw(&Text::new(self.title.clone(), (LEFT as i32, 18), (FONT, 34).into_font()))?;
        let entries = self.axes.len() + usize::from(self.is_controlled);
        let width = ((WIDTH - LEFT) as usize / entries.max(6)) as i32;
        let place = |i: usize| LEFT as i32 + i as i32 * width;
        for (i, axis) in self.axes.iter().enumerate() {
            let (x, colour) = (place(i), COLOURS[axis.index % COLOURS.len()]);
            area.draw(&PathElement::new([(x, 84), (x + 44, 84)], colour.stroke_width(5)))?;
            area.draw(&Text::new(axis.name.clone(), (x + 56, 68), (FONT, 28).into_font()))?;
        }
        if !self.is_controlled {
            return Ok(());
        }
        let x = place(self.axes.len());
        for begin in [x, x + 28] {
            area.draw(&PathElement::new([(begin, 84), (begin + 16, 84)], BLACK.stroke_width(2)))?;
        }
        area.draw(&Text::new("reference".to_owned(), (x + 56, 68), (FONT, 28).into_font()))?;
        area.draw(&Text::new("commanded by".to_owned(), (LEFT as i32, 114), (FONT, 28).into_font()))?;
        for (i, (_, name, colour)) in COMMANDERS.iter().enumerate() {
            let x = LEFT as i32 + 230 + 350 * i as i32;
            area.draw(&Rectangle::new([(x, 114), (x + 44, 142)], colour.filled()))?;
            area.draw(&Text::new((*name).to_owned(), (x + 56, 114), (FONT, 28).into_font()))?;
        }
        Ok(())
    }
}

/// The colour of who commands; white for anybody else.
fn colour_of(mode: u32) -> RGBColor {
    COMMANDERS.iter().find(|(number, ..)| *number == mode).map_or(WHITE, |(.., colour)| *colour)
}

impl Panel {
    /// Draws the lines over `time`, begin and end, above the spans of `shades`.
    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        time: (f64, f64),
        shades: &[(f64, f64, u32)],
    ) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let values = self.lines.iter().flat_map(|line| &line.points).map(|point| point.1);
        let (low, high) = range(values, MARGIN, self.least);
        let mut chart = ChartBuilder::on(area)
            .margin_left(20)
            .margin_right(RIGHT)
            .margin_bottom(10)
            .x_label_area_size(80)
            .y_label_area_size(LEFT - 20)
            .build_cartesian_2d(time.0..time.1, low..high)?;
        let shade = |(begin, end, mode): &(f64, f64, u32)| {
            Rectangle::new([(*begin, low), (*end, high)], colour_of(*mode).filled())
        };
        chart.draw_series(shades.iter().map(shade))?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc(self.label)
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .label_style((FONT, 26))
            .axis_desc_style((FONT, 30))
            .bold_line_style(BLACK.mix(0.16))
            .light_line_style(WHITE.mix(0.0))
            .draw()?;
        for Line { points, colour, is_dashed } in &self.lines {
            let points = points.iter().copied();
            if *is_dashed {
                let (stroke, gap) = DASH;
                chart.draw_series(DashedLineSeries::new(points, stroke, gap, colour.stroke_width(2)))?;
            } else {
                chart.draw_series(LineSeries::new(points, colour.stroke_width(3)))?;
            }
        }
        Ok(())
    }
}

/// Draws a bar for each axis, in the colours of who commands it over `time`.
fn draw_bars<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    time: (f64, f64),
    names: &[String],
    modes: &[Vec<(f64, f64, u32)>],
) -> Drawn
where
    B::ErrorType: 'static,
{
    area.draw(&Text::new("commanded by".to_owned(), (LEFT as i32, 6), (FONT, 28).into_font()))?;
    let scale = f64::from(WIDTH - LEFT - RIGHT) / (time.1 - time.0);
    let x = |t: f64| LEFT as i32 + ((t - time.0) * scale).round() as i32;
    for (i, (name, spans)) in names.iter().zip(modes).enumerate() {
        let y = (BARS_HEAD + BAR * i as u32) as i32;
        for (begin, end, mode) in spans {
            area.draw(&Rectangle::new([(x(*begin), y + 3), (x(*end), y + BAR as i32 - 3)], colour_of(*mode).filled()))?;
        }
        area.draw(&Text::new(name.clone(), (20, y + 3), (FONT, 26).into_font()))?;
    }
    Ok(())
}
