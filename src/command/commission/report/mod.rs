//! The report of `--report`: one HTML file that needs nothing else, with a section for each axis.

mod pictures;

use std::io::{self, Write};

use pipeline::machine::Machine;

use super::Found;
use crate::{
    failure::Failure,
    report::{
        margins::LoopMargins,
        page::{Figure, Page},
        table::percent,
    },
};

/// Writes the report on these axes.
///
/// # Errors
/// The file cannot be written, or a picture cannot be drawn.
pub fn write(file: &mut dyn Write, machine: &Machine, found: &[Found]) -> Result<(), Failure> {
    let text = html(machine, found).map_err(|error| Failure::run(error).about("--report"))?;
    let refused = |error: io::Error| Failure::usage(error).about("--report: the file cannot be written");
    file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(refused)
}

fn html(machine: &Machine, found: &[Found]) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let mut page = Page::new(&format!("Commissioning of {}", machine.name));
    let period = machine.timing.period.as_secs_f64();
    for found in found {
        page.section(found.name);
        page.facts(&model(found));
        loops(&mut page, &found.loops);
        let figures: Vec<Figure> =
            (pictures::all(found, period).into_iter()).map(|chart| Figure { chart, caption: String::new() }).collect();
        page.pictures(&figures)?;
    }
    Ok(page.finish())
}

/// What was found of the axis.
fn model(Found { model, .. }: &Found) -> Vec<(&'static str, String)> {
    let milli = |seconds: f64| format!("{:.0} ms", 1e3 * seconds);
    let mut rows = vec![
        ("dead time", milli(model.dead_time)),
        ("time constant", milli(model.time_constant)),
        ("dead band extending", format!("{:.4}", model.dead_band.extend)),
        ("dead band retracting", format!("{:.4}", model.dead_band.retract)),
        ("hysteresis", format!("{:.4}", model.hysteresis)),
    ];
    if model.natural_frequency > 0.0 {
        rows.push(("load swings with", format!("{:.2} Hz", model.natural_frequency)));
        rows.push(("damping of that swing", format!("{:.2}", model.damping)));
    }
    rows.push(("fit 0.5 s ahead", percent(model.fit_percent)));
    rows
}

/// The margins of its loops.
fn loops(page: &mut Page, loops: &[LoopMargins]) {
    if loops.is_empty() {
        page.paragraph("The model is poor: it has no settings.");
        return;
    }
    let header = LoopMargins::header();
    let rows: Vec<Vec<String>> = loops.iter().map(|of| of.row()[1..].to_vec()).collect();
    page.table(&header[1..], &rows);
}
