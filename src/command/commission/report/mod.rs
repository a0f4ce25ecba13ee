//! The report of `--report`: one HTML file that needs nothing else, with a section for each axis.

mod pictures;

use std::{
    fmt::Write as _,
    io::{self, Write},
};

use pipeline::machine::Machine;

use super::Found;
use crate::{
    failure::Failure,
    report::{margins::LoopMargins, table::percent},
};

const STYLE: &str = "body{font-family:sans-serif;max-width:1500px;margin:2em auto;padding:0 1em;color:#222}\
                     table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:.3em .8em;\
                     text-align:right}td:first-child,th:first-child{text-align:left}\
                     .pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(520px,1fr));gap:1em}\
                     svg{width:100%;height:auto}";

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
    let title = format!("Commissioning of {}", escaped(&machine.name));
    let mut text = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <style>{STYLE}</style></head>\n<body><h1>{title}</h1>\n"
    );
    let period = machine.timing.period.as_secs_f64();
    for found in found {
        // Writing to a string cannot fail.
        let _ = write!(text, "<h2>{}</h2>\n{}{}", escaped(found.name), model(found), loops(&found.loops));
        text += "<div class=\"pictures\">\n";
        for chart in pictures::all(found, period) {
            let _ = writeln!(text, "{}", chart.svg()?);
        }
        text += "</div>\n";
    }
    Ok(text + "</body></html>\n")
}

/// What was found of the axis.
fn model(Found { model, .. }: &Found) -> String {
    let row = |name: &str, value: String| format!("<tr><td>{name}</td><td>{value}</td></tr>\n");
    let milli = |seconds: f64| format!("{:.0} ms", 1e3 * seconds);
    let mut text = "<table>\n".to_owned();
    text += &row("dead time", milli(model.dead_time));
    text += &row("time constant", milli(model.time_constant));
    text += &row("dead band extending", format!("{:.4}", model.dead_band.extend));
    text += &row("dead band retracting", format!("{:.4}", model.dead_band.retract));
    text += &row("hysteresis", format!("{:.4}", model.hysteresis));
    if model.natural_frequency > 0.0 {
        text += &row("load swings with", format!("{:.2} Hz", model.natural_frequency));
        text += &row("damping of that swing", format!("{:.2}", model.damping));
    }
    text + &row("fit 0.5 s ahead", percent(model.fit_percent)) + "</table>\n"
}

/// The margins of its loops.
fn loops(loops: &[LoopMargins]) -> String {
    if loops.is_empty() {
        return "<p>The model is poor: it has no settings.</p>\n".to_owned();
    }
    let cells = |tag: &str, cells: &[String]| {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let header = LoopMargins::header();
    let rows: String = loops.iter().map(|of| cells("td", &of.row()[1..])).collect();
    format!("<table>\n{}{rows}</table>\n", cells("th", &header[1..]))
}

/// Text in HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
