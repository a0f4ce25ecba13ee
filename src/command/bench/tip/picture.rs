//! The picture of one task of `hydraxis bench tip`: the machine seen from the side, the way of its teeth, and how far
//! they were from it.
//!
//! The band about the way is the distance of the teeth times [`LARGER`], on the side on which they were. Below it the
//! same distance over the length of the way, in mm.

use std::fmt::Write as _;

use mechanism::{Mechanism, Vector};

use super::case::Row;
use crate::report::{
    motion::{
        outline::{GROUND, View, line, listed},
        side::Side,
    },
    page::escaped,
    teeth::TracePoint,
};

/// How much larger than the machine errors are drawn.
const LARGER: f64 = 20.0;
/// Where the machine is on the picture.
const VIEW: View = View { origin: (110.0, 470.0), scale: 78.0 };
/// Size of the picture.
const SIZE: (f64, f64) = (1000.0, 860.0);
/// Lower panel: left, top, width, height.
const PANEL: (f64, f64, f64, f64) = (90.0, 670.0, 860.0, 140.0);
/// Poses of the machine that are drawn.
const POSES: usize = 3;
/// Least range of the lower panel, m.
const LEAST_RANGE: f64 = 5e-3;
const COLOURS: [&str; MOST_RUNS] = ["#d55e00", "#0072b2", "#009e73", "#cc79a7"];
/// Runs that one picture shows.
pub const MOST_RUNS: usize = 4;
/// Runs that are named beside each other, and the height of their line.
const NAMES: usize = 2;
const NAME_HEIGHT: f64 = 22.0;

/// Draws the runs of one task, by the names of their controllers and with their figures.
pub fn picture(mechanism: &Mechanism, title: &str, rows: &[Row]) -> String {
    let (width, height) = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"16\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"20\" y=\"30\" font-size=\"20\">{}</text>\n",
        escaped(title)
    );
    let ground = VIEW.origin.1;
    line(&mut svg, &[(0.0, ground), (width, ground)], GROUND, 2.0, "");
    if let Some(Row { trace: first, .. }) = rows.first() {
        poses(&mut svg, &Side::new(mechanism), first);
        let way: Vec<_> = first.iter().map(|point| VIEW.at(point.planned)).collect();
        line(&mut svg, &way, "#202020", 1.5, " stroke-dasharray=\"6 4\"");
    }
    for (number, (row, colour)) in rows.iter().zip(COLOURS).enumerate() {
        band(&mut svg, &row.trace, colour);
        let x = 20.0 + 480.0 * (number % NAMES) as f64;
        let y = 56.0 + NAME_HEIGHT * (number / NAMES) as f64;
        let [rms, most] = [row.rms, row.max].map(|error| 1e3 * error.unwrap_or_default());
        let text = format!("{}: {rms:.1} mm rms, at most {most:.1} mm", row.controller);
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" fill=\"{colour}\">{text}</text>");
    }
    let y = 58.0 + NAME_HEIGHT * rows.len().div_ceil(NAMES) as f64;
    let _ = writeln!(svg, "<text x=\"20\" y=\"{y}\" fill=\"#606060\">band: error times {LARGER}</text>");
    panel(&mut svg, rows);
    svg + "</svg>\n"
}

fn poses(svg: &mut String, side: &Side, run: &[TracePoint]) {
    let last = run.len().saturating_sub(1);
    for k in 0..POSES {
        let Some(point) = run.get(last * k / (POSES - 1)) else { continue };
        VIEW.machine(svg, &side.drawn(&point.positions), 0.35 + 0.65 * k as f64 / (POSES - 1) as f64);
    }
}

/// The area between the way and the teeth.
fn band(svg: &mut String, run: &[TracePoint], colour: &str) {
    let mut outer = Vec::new();
    for (k, point) in run.iter().enumerate() {
        let (before, after) = (run[k.saturating_sub(1)].planned, run[(k + 1).min(run.len() - 1)].planned);
        let way = after - before;
        let normal = if way.norm() > 0.0 { (1.0 / way.norm()) * way.normal() } else { Vector::default() };
        outer.push(VIEW.at(point.planned + (LARGER * point.error) * normal));
    }
    let back = run.iter().rev().map(|point| VIEW.at(point.planned));
    let points: Vec<_> = outer.into_iter().chain(back).collect();
    let _ = writeln!(
        svg,
        "<polygon points=\"{}\" fill=\"{colour}\" fill-opacity=\"0.35\" stroke=\"{colour}\" stroke-width=\"1\"/>",
        listed(&points)
    );
}

/// Errors over the length of the way.
fn panel(svg: &mut String, rows: &[Row]) {
    let (left, top, width, height) = PANEL;
    let all = || rows.iter().flat_map(|row| &row.trace);
    let most = all().map(|point| point.error.abs()).fold(LEAST_RANGE, f64::max);
    let length = all().map(|point| point.s).fold(f64::MIN_POSITIVE, f64::max);
    let at = |s: f64, error: f64| (left + width * s / length, top + 0.5 * height * (1.0 - error / most));
    for error in [-most, 0.0, most] {
        line(svg, &[at(0.0, error), at(length, error)], "#d0d0d0", 1.0, "");
        let (_, y) = at(0.0, error);
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{:.1}</text>",
            left - 8.0,
            y + 5.0,
            1e3 * error
        );
    }
    for (row, colour) in rows.iter().zip(COLOURS) {
        let points: Vec<_> = row.trace.iter().map(|point| at(point.s, point.error)).collect();
        line(svg, &points, colour, 1.5, "");
    }
    let _ = writeln!(
        svg,
        "<text x=\"{left}\" y=\"{:.1}\">distance of the teeth from their way, mm, over its {length:.2} m</text>",
        top + height + 30.0
    );
}
