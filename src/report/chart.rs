//! Charts of lines and points as SVG.

use std::error::Error;

use plotters::{
    chart::ChartBuilder,
    element::{Circle, Cross, PathElement, Polygon, Text},
    prelude::{Color, FontStyle, IntoDrawingArea, IntoFont, RGBAColor, RGBColor, SVGBackend, WHITE},
};

/// Heights of a chart within which its lines end beyond its frame: a picture has no place for 1e30.
const FAR: f64 = 100.0;
/// Name of the font of all pictures. A program that shows an SVG takes a font of its own by this name.
pub const FONT: &str = "sans-serif";
/// Colours that colour-blind readers can tell apart (Okabe and Ito), one for each axis that a machine can have.
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(80, 80, 80),
    RGBColor(160, 120, 60),
];
/// Colour of the ground.
pub const GROUND: RGBColor = RGBColor(140, 110, 70);
/// Width and height of a chart that fills a page.
pub const WIDE: (u32, u32) = (1200, 500);
/// Width and height of a chart that stands beside another one.
pub const HALF: (u32, u32) = (760, 560);
/// Height of the title, and of a row of the legend.
const TITLE: u32 = 54;
const ROW: u32 = 36;
/// Length of the line before a name in the legend, and distance to the next one.
const SAMPLE: i32 = 36;
const BETWEEN: i32 = 34;
/// Size of the letters of the legend.
const LETTERS: i32 = 24;
/// Distance from the left edge to the panel.
const LEFT: u32 = 130;
/// Free space above and below the values, as a part of their height.
const MARGIN: f64 = 0.05;
/// Free space where all values are equal.
const LEAST_HEIGHT: f64 = 1e-12;

/// What is drawn through the points of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line of this width.
    Line(u32),
    /// A dot of this radius at each of them.
    Dot(u32),
    /// A diagonal cross of this radius at each of them.
    Cross(u32),
    /// They are the corners of filled areas.
    Area,
}

/// Points of one kind.
#[derive(Debug, Clone)]
pub struct Series {
    /// In the legend; empty for a series that is not there.
    pub name: String,
    /// (x, y). One whose y is not finite ends a line or an area; the next one begins another.
    pub points: Vec<(f64, f64)>,
    /// Their colour.
    pub colour: RGBAColor,
    /// How they are drawn.
    pub mark: Mark,
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Above the chart.
    pub title: String,
    /// Width and height: [`WIDE`] or [`HALF`].
    pub size: (u32, u32),
    /// Below the chart, and beside it.
    pub labels: [String; 2],
    /// The text of a number on the lower edge.
    pub tick: fn(&f64) -> String,
    /// The text of a number on the left edge; without it, one whose decimals fit the height.
    pub y_tick: Option<fn(&f64) -> String>,
    /// The later ones are drawn over the earlier ones.
    pub series: Vec<Series>,
    /// Texts and where they begin.
    pub notes: Vec<((f64, f64), String)>,
    /// Lowest and highest x, and y, that are shown; without it, those of the points.
    pub frame: Option<[(f64, f64); 2]>,
}

/// Gives the library the font by which it measures texts and draws them on bitmaps. To be called before a picture is
/// drawn.
pub fn register_font() {
    // It fails for bytes that are no font, which these are.
    let _ = plotters::style::register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
}

impl Chart {
    /// Whether there is anything to draw.
    pub fn has_points(&self) -> bool {
        self.series.iter().flat_map(|series| &series.points).any(|point| point.1.is_finite())
    }

    /// The chart as SVG.
    ///
    /// # Errors
    /// The library cannot draw it.
    pub fn svg(&self) -> Result<String, Box<dyn Error + Send + Sync>> {
        register_font();
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, self.size).into_drawing_area();
        area.fill(&WHITE)?;
        let legend = self.legend();
        let rows = legend.last().map_or(0, |(.., row)| row + 1);
        let (head, panel) = area.split_vertically(TITLE + ROW * rows + ROW / 4);
        head.draw(&Text::new(self.title.clone(), (LEFT as i32, 14), (FONT, 30).into_font()))?;
        for (series, x, row) in legend {
            let top = (TITLE + ROW * row) as i32;
            let middle = top + LETTERS / 2 + 2;
            head.draw(&PathElement::new([(x, middle), (x + SAMPLE, middle)], series.colour.stroke_width(6)))?;
            head.draw(&Text::new(series.name.clone(), (x + SAMPLE + 10, top), (FONT, LETTERS).into_font()))?;
        }
        self.draw(&panel)?;
        drop((area, head, panel));
        Ok(text)
    }

    /// The series that have a name, each with its place in the legend and the row of it.
    fn legend(&self) -> Vec<(&Series, i32, u32)> {
        let (left, right) = (LEFT as i32, self.size.0 as i32);
        let (mut x, mut row) = (left, 0);
        let mut places = Vec::new();
        for series in self.series.iter().filter(|series| !series.name.is_empty()) {
            let letters = (FONT, LETTERS).into_font().box_size(&series.name).map_or(0, |(width, _)| width as i32);
            let width = SAMPLE + 10 + letters;
            if x > left && x + width > right {
                (x, row) = (left, row + 1);
            }
            places.push((series, x, row));
            x += width + BETWEEN;
        }
        places
    }

    fn draw(
        &self,
        area: &plotters::drawing::DrawingArea<SVGBackend, plotters::coord::Shift>,
    ) -> Result<(), Box<dyn Error + Send + Sync>> {
        let points = || self.series.iter().flat_map(|series| &series.points).filter(|point| point.1.is_finite());
        let [(begin, end), (low, high)] = self.frame.unwrap_or_else(|| {
            let x = range(points().map(|point| point.0), 0.0, 1e-9);
            let y = range(points().map(|point| point.1), MARGIN, LEAST_HEIGHT);
            // Without a point there is no range.
            if self.has_points() { [x, y] } else { [(0.0, 1.0); 2] }
        });
        let mut chart = ChartBuilder::on(area)
            .margin_left(10)
            .margin_right(40)
            .margin_bottom(10)
            .x_label_area_size(70)
            .y_label_area_size(LEFT - 10)
            .build_cartesian_2d(begin..end, low..high)?;
        chart
            .configure_mesh()
            .x_desc(self.labels[0].as_str())
            .y_desc(self.labels[1].as_str())
            .x_label_formatter(&self.tick)
            .y_label_formatter(&|y| self.y_tick.map_or_else(|| value(*y, high - low), |text| text(y)))
            .label_style((FONT, 22))
            .axis_desc_style((FONT, 26))
            .bold_line_style(RGBColor(210, 210, 210))
            .max_light_lines(0)
            .draw()?;
        let far = FAR * (high - low);
        let near = |&(x, y): &(f64, f64)| (x, if y.is_finite() { y.clamp(low - far, high + far) } else { y });
        for Series { points, colour, mark, .. } in &self.series {
            let points: Vec<(f64, f64)> = points.iter().map(near).collect();
            let parts = points.split(|point| !point.1.is_finite()).filter(|part| !part.is_empty());
            let all = points.iter().copied().filter(|point| point.1.is_finite());
            match mark {
                Mark::Line(width) => {
                    let lines = parts.map(|part| PathElement::new(part.to_vec(), colour.stroke_width(*width)));
                    chart.draw_series(lines)?;
                }
                Mark::Dot(radius) => {
                    chart.draw_series(all.map(|point| Circle::new(point, *radius, colour.filled())))?;
                }
                Mark::Cross(radius) => {
                    chart.draw_series(all.map(|point| Cross::new(point, *radius, colour.stroke_width(4))))?;
                }
                Mark::Area => drop(chart.draw_series(parts.map(|part| Polygon::new(part.to_vec(), *colour)))?),
            }
        }
        let note = |(at, text): &((f64, f64), String)| Text::new(text.clone(), *at, (FONT, 22).into_font());
        chart.draw_series(self.notes.iter().map(note))?;
        Ok(())
    }
}

/// The text of a number beside an axis that is `height` high.
fn value(value: f64, height: f64) -> String {
    // About ten numbers stand on an axis.
    let step = height / 10.0;
    if value.abs() < 1e-6 * step {
        "0".to_owned()
    } else if step < 1e-5 || value.abs() >= 1e6 {
        format!("{value:.1e}")
    } else {
        let decimals = (1.0 - step.log10().floor()).clamp(0.0, 7.0) as usize;
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

/// The text of a number beside an axis of a chart.
pub fn tick(value: &f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// The range of the values, extended to both sides by the part `margin` of it, but at least by `least`.
pub fn range(values: impl Iterator<Item = f64>, margin: f64, least: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let space = (margin * (high - low)).max(least);
    (low - space, high + space)
}

/// Ranges around those of x and y, and `margin` beyond them, that have one scale in a panel that is `aspect` times as
/// wide as it is high.
pub fn one_scale([x, y]: [(f64, f64); 2], margin: f64, aspect: f64) -> [(f64, f64); 2] {
    let span = |range: (f64, f64)| range.1 - range.0 + 2.0 * margin;
    let height = span(y).max(span(x) / aspect);
    let around = |range: (f64, f64), span: f64| {
        let middle = 0.5 * (range.0 + range.1);
        (middle - 0.5 * span, middle + 0.5 * span)
    };
    [around(x, aspect * height), around(y, height)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_beside_an_axis_are_short() {
        assert_eq!([650.0, 0.05, -0.0, -1e-17, 1234.5].map(|value| tick(&value)), ["650", "0.05", "0", "0", "1234.5"]);
    }

    #[test]
    fn numbers_beside_an_axis_have_the_decimals_of_its_height() {
        let texts = [(0.0002, 0.001), (1e-19, 0.001), (-0.25, 1.0), (2e-6, 1e-5), (1500.0, 4000.0), (100.0, 2000.0)]
            .map(|(y, height)| value(y, height));
        assert_eq!(texts, ["0.0002", "0", "-0.25", "2.0e-6", "1500", "100"]);
    }

    #[test]
    fn a_line_is_broken_where_a_point_is_not_finite() {
        let line =
            |points: Vec<(f64, f64)>, mark| Series { name: String::new(), points, colour: COLOURS[0].to_rgba(), mark };
        let broken = vec![(0.0, 1.0), (1.0, 2.0), (1.5, f64::NAN), (2.0, 1.0), (3.0, 2.0)];
        let chart = |series| Chart {
            title: String::new(),
            size: HALF,
            labels: [String::new(), String::new()],
            tick,
            y_tick: None,
            series,
            notes: Vec::new(),
            frame: Some([(0.0, 3.0), (0.0, 3.0)]),
        };
        let count = |svg: &str, what: &str| svg.matches(what).count();
        let empty = chart(Vec::new()).svg().unwrap();
        let lines = chart(vec![line(broken.clone(), Mark::Line(2))]).svg().unwrap();
        assert_eq!(count(&lines, "<polyline") - count(&empty, "<polyline"), 2);
        let areas = chart(vec![line(broken, Mark::Area)]).svg().unwrap();
        assert_eq!(count(&areas, "<polygon") - count(&empty, "<polygon"), 2);
    }

    #[test]
    fn a_chart_has_title_legend_points_and_notes() {
        let line = Series {
            name: "measured".to_owned(),
            points: vec![(0.0, 1.0), (2.0, 3.0)],
            colour: COLOURS[0].to_rgba(),
            mark: Mark::Line(3),
        };
        let dots = Series { name: String::new(), mark: Mark::Dot(4), ..line.clone() };
        let chart = Chart {
            title: "speed".to_owned(),
            size: HALF,
            labels: ["time, s", "speed, m/s"].map(String::from),
            tick,
            y_tick: None,
            series: vec![line, dots],
            notes: vec![((1.0, 2.0), "gain margin".to_owned())],
            frame: None,
        };
        let svg = chart.svg().unwrap();
        assert!(["speed", "measured", "time, s", "gain margin"].iter().all(|text| svg.contains(text)), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2);
    }
}
