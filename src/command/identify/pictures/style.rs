//! Colours and marks that all pictures of this report share.

use plotters::prelude::{Color, RGBAColor, RGBColor};

use crate::report::chart::{COLOURS, Mark, Series};

/// What was measured.
pub const MEASURED: RGBColor = RGBColor(60, 60, 60);
/// The held model.
pub const HELD: RGBColor = COLOURS[1];
/// The adaptive model.
pub const ADAPTIVE: RGBColor = COLOURS[0];
/// Samples that were left out.
pub const OUTLIER: RGBColor = RGBColor(200, 0, 0);
/// Zero, bounds and marks.
pub const GREY: RGBColor = RGBColor(130, 130, 130);

/// A line.
pub fn line(name: &str, points: Vec<(f64, f64)>, colour: impl Into<RGBAColor>, width: u32) -> Series {
    Series { name: name.to_owned(), points, colour: colour.into(), mark: Mark::Line(width) }
}

/// Filled areas.
pub fn area(name: &str, points: Vec<(f64, f64)>, colour: RGBAColor) -> Series {
    Series { name: name.to_owned(), points, colour, mark: Mark::Area }
}

/// A line upwards at x.
pub fn upright(x: f64, (low, high): (f64, f64), width: u32) -> Series {
    line("", vec![(x, low), (x, high)], GREY.mix(0.7), width)
}
