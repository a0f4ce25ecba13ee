//! Who commanded each axis and what happened, on one axis of time, as SVG.

use std::fmt::Write as _;

use pipeline::message::ControlMode;

use crate::report::{chart::tick, page::escaped};

use super::story::Story;

/// Width of the picture, and the place of its bars.
const WIDTH: f64 = 1200.0;
const LEFT: f64 = 150.0;
const RIGHT: f64 = 1170.0;
/// Height of the legend, of a row, and of the bar in it.
const HEAD: f64 = 50.0;
const ROW: f64 = 44.0;
const BAR: f64 = 26.0;
/// Height of the axis of time.
const FOOT: f64 = 60.0;
/// Most marks of events.
const MOST_MARKS: usize = 300;
/// Most numbers below the picture.
const TICKS: f64 = 10.0;
/// Least distance between two numbers of events.
const APART: f64 = 22.0;

/// Who commands: number of the [`ControlMode`], name, colour.
const COMMANDERS: [(u32, &str, &str); 6] = [
    (ControlMode::Neutral as u32, "neutral", "#d9d9d9"),
    (ControlMode::Fallback as u32, "fallback", "#f2c14e"),
    (ControlMode::Model as u32, "model", "#6dbf8b"),
    (ControlMode::Manual as u32, "manual", "#8ab6e8"),
    (ControlMode::Commission as u32, "commissioning", "#c79fd6"),
    (ControlMode::Replay as u32, "replay", "#b8b8b8"),
];

/// Distance of the numbers below an axis of time: 1, 2 or 5 times a power of ten.
fn step(duration: f64) -> f64 {
    let least = (duration / TICKS).max(1e-6);
    let decade = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade).into_iter().find(|step| *step >= least).unwrap_or(decade)
}

/// The picture. Faults have the numbers of the list of events.
pub fn svg(story: &Story) -> String {
    let rows = story.axes.len() + 1;
    let height = HEAD + ROW * rows as f64 + FOOT;
    let x = |t: f64| LEFT + (RIGHT - LEFT) * (t / story.duration.max(1e-9)).clamp(0.0, 1.0);
    let mut text = format!(
        "<svg viewBox=\"0 0 {WIDTH} {height}\" xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" \
         font-size=\"20\" role=\"img\" aria-label=\"Who commanded each axis, and faults, over time\">\n"
    );
    legend(&mut text, story);
    let bottom = HEAD + ROW * rows as f64;
    let step = step(story.duration);
    for i in 0..=(story.duration / step) as usize {
        let (at, t) = (x(i as f64 * step), i as f64 * step);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "<line x1=\"{at:.1}\" y1=\"{HEAD}\" x2=\"{at:.1}\" y2=\"{bottom}\" stroke=\"#d2d2d2\"/>\
             <text x=\"{at:.1}\" y=\"{:.0}\" text-anchor=\"middle\">{}</text>",
            bottom + 26.0,
            tick(&t)
        );
    }
    let middle = 0.5 * (LEFT + RIGHT);
    let _ = writeln!(text, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">time, s</text>", bottom + 52.0);
    for (row, axis) in story.axes.iter().enumerate() {
        let top = HEAD + ROW * row as f64 + (ROW - BAR) / 2.0;
        name(&mut text, &axis.name, row);
        for (begin, end, number) in axis.commanders.all() {
            let colour = COMMANDERS.iter().find(|known| known.0 == *number).map_or("#000", |known| known.2);
            let width = (x(*end) - x(*begin)).max(0.5);
            let _ = writeln!(
                text,
                "<rect x=\"{:.1}\" y=\"{top}\" width=\"{width:.1}\" height=\"{BAR}\" fill=\"{colour}\"/>",
                x(*begin)
            );
        }
    }
    name(&mut text, "group", story.axes.len());
    marks(&mut text, story, x);
    text + "</svg>"
}

fn name(text: &mut String, name: &str, row: usize) {
    let y = HEAD + ROW * row as f64 + 29.0;
    let _ = writeln!(text, "<text x=\"{}\" y=\"{y}\" text-anchor=\"end\">{}</text>", LEFT - 12.0, escaped(name));
}

/// The colours that occur.
fn legend(text: &mut String, story: &Story) {
    let occurs = |number: u32| story.axes.iter().any(|axis| axis.commanders.all().iter().any(|span| span.2 == number));
    let mut x = LEFT;
    for (_, name, colour) in COMMANDERS.into_iter().filter(|known| occurs(known.0)) {
        let _ = writeln!(
            text,
            "<rect x=\"{x}\" y=\"12\" width=\"24\" height=\"20\" fill=\"{colour}\"/>\
             <text x=\"{}\" y=\"29\">{name}</text>",
            x + 32.0
        );
        x += 60.0 + 11.0 * name.len() as f64;
    }
    let _ = writeln!(
        text,
        "<path d=\"M{x} 12v20\" stroke=\"#b3261e\" stroke-width=\"5\"/><text x=\"{}\" y=\"29\">fault</text>",
        x + 12.0
    );
}

/// A mark for each fault, with its number where there is room.
fn marks(text: &mut String, story: &Story, x: impl Fn(f64) -> f64) {
    let faults = story.found.list.iter().enumerate().filter(|(_, event)| event.is_fault);
    let mut last = vec![f64::NEG_INFINITY; story.axes.len() + 1];
    for (index, event) in faults.take(MOST_MARKS) {
        let of_axis = |name: &String| story.axes.iter().position(|axis| axis.name == *name);
        let row = event.axis.as_ref().and_then(of_axis).unwrap_or(story.axes.len());
        let (at, top) = (x(event.time_s), HEAD + ROW * row as f64);
        let _ = writeln!(
            text,
            "<path d=\"M{at:.1} {:.0}v{:.0}\" stroke=\"#b3261e\" stroke-width=\"4\"/>",
            top + 12.0,
            ROW - 14.0
        );
        if at - last[row] > APART {
            last[row] = at;
            let _ = writeln!(
                text,
                "<text x=\"{at:.1}\" y=\"{:.0}\" font-size=\"15\" fill=\"#b3261e\" text-anchor=\"middle\">{}</text>",
                top + 10.0,
                index + 1
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_below_the_axis_are_round() {
        assert_eq!([60.0, 20.0, 3600.0, 0.7].map(step), [10.0, 2.0, 500.0, 0.1]);
    }
}
