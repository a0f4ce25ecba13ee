//! The lines of the views.

use std::time::{Duration, UNIX_EPOCH};

use ratatui::{
    style::Style,
    text::{Line, Span, Text},
};

use super::look::{BAD, QUIET, WARN};
use crate::report::{
    events::Event,
    status::{AxisFigures, SILENT_NS, StageFigures, StatusReport},
    table::nanoseconds,
};

/// Above the lines of the axes.
pub const AXIS_HEADER: &str = " axis       mode       by             error    position  command  flags";
/// Above the lines of the stages.
pub const STAGE_HEADER: &str = " stage         state    heard      1/s  lost  late   work p99  end to end p99";

/// One axis in 80 columns; the flags may be cut.
pub fn axis_line(name: &str, axis: &AxisFigures) -> Line<'static> {
    let is_followed = axis.command_by == "model" || axis.command_by == "fallback";
    let error = if is_followed { format!("{:+.1} mm", 1e3 * axis.error) } else { "-".to_owned() };
    let position = axis.position.map_or_else(|| "-".to_owned(), |position| format!("{position:.4} m"));
    let (mode, style) = match axis.is_latched {
        true => ("LATCHED", BAD),
        false => (axis.mode, if axis.command_by == "fallback" { WARN } else { Style::new() }),
    };
    let words: Vec<&str> = axis.flags.iter().chain(&axis.sample_faults).copied().collect();
    let text = format!(
        " {:10} {mode:10} {:10} {error:>9}  {position:>10}  {:+7.3}  {}",
        cut(name, 10),
        cut(axis.command_by, 10),
        axis.command,
        words.join(" ")
    );
    Line::styled(text, style)
}

/// One stage in 80 columns.
pub fn stage_line(name: &str, stage: &StageFigures) -> Line<'static> {
    let is_silent = stage.heartbeat_age_ns > SILENT_NS;
    let (state, style) = match (is_silent, stage.state) {
        (true, _) => ("SILENT", BAD),
        (false, "running") => ("running", if stage.lost > 0 { WARN } else { Style::new() }),
        (false, state) => (state, WARN),
    };
    let end = if stage.end_to_end_ns.count > 0 { nanoseconds(stage.end_to_end_ns.p99) } else { "-".to_owned() };
    let text = format!(
        " {:13} {state:8} {:>8} {:>6.0} {:>5} {:>5} {:>10} {end:>15}",
        cut(name, 13),
        nanoseconds(stage.heartbeat_age_ns),
        stage.rate_hz,
        stage.lost,
        stage.missed_deadlines,
        nanoseconds(stage.work_ns.p99),
    );
    Line::styled(text, style)
}

/// Everything about the axes, a block for each.
pub fn axes(report: &StatusReport) -> Text<'static> {
    let mut lines = Vec::new();
    for (name, axis) in report.axes() {
        lines.push(Line::styled(AXIS_HEADER, QUIET));
        lines.push(axis_line(name, axis));
        let model = match axis.model_age_ns {
            None => "none yet".to_owned(),
            Some(age) => {
                let sigma = axis.h_step_sigma.map(|sigma| format!(", predicts to {:.2} mm", 1e3 * sigma));
                let factor = axis.forgetting_factor.map(|factor| format!(", forgetting factor {factor:.4}"));
                let faults = if axis.model_faults.is_empty() {
                    String::new()
                } else {
                    format!(", {}", axis.model_faults.join(" "))
                };
                format!("{} old{}{}{faults}", nanoseconds(age), sigma.unwrap_or_default(), factor.unwrap_or_default())
            }
        };
        lines.push(Line::raw(format!(
            "   reference {:.4} m, velocity {:+.4} m/s",
            axis.reference,
            axis.velocity.unwrap_or(f64::NAN)
        )));
        lines.push(Line::raw(format!("   model: {model}")));
        lines.extend(axis.why_fallback.iter().map(|why| Line::styled(format!("   by the fallback: {why}"), WARN)));
        lines.push(Line::default());
    }
    Text::from(lines)
}

/// The latencies of the stages in 80 columns.
pub fn latencies(report: &StatusReport) -> Text<'static> {
    let row = |name: &str, figures: [String; 6]| {
        let [count, p50, p99, p99_9, p99_99, max] = figures;
        format!(" {:27}{count:>9}{p50:>8}{p99:>8}{p99_9:>9}{p99_99:>9}{max:>9}", cut(name, 27))
    };
    let header = row("latency", ["count", "p50", "p99", "p99.9", "p99.99", "max"].map(str::to_owned));
    let mut lines = vec![Line::styled(header, QUIET)];
    for (name, stage) in report.stages() {
        let kinds = [
            ("wait", &stage.wait_ns),
            ("work", &stage.work_ns),
            ("end to end", &stage.end_to_end_ns),
            ("release jitter", &stage.release_jitter_ns),
        ];
        for (kind, p) in kinds.into_iter().filter(|(_, percentiles)| percentiles.count > 0) {
            let [p50, p99, p99_9, p99_99, max] = [p.p50, p.p99, p.p99_9, p.p99_99, p.max].map(short);
            lines.push(Line::raw(row(&format!("{name} {kind}"), [p.count.to_string(), p50, p99, p99_9, p99_99, max])));
        }
    }
    Text::from(lines)
}

/// The channels that the stages read, in 80 columns.
pub fn channels(report: &StatusReport) -> Text<'static> {
    let row = |name: &str, [read, lost, foreign, age, gap]: [String; 5]| {
        format!(" {:36}{read:>11}{lost:>7}{foreign:>8}{age:>8}{gap:>9}", cut(name, 36))
    };
    let header = row("channel", ["read", "lost", "foreign", "age", "gap"].map(str::to_owned));
    let mut lines = vec![Line::styled(header, QUIET)];
    for (name, stage) in report.stages() {
        for (channel, figures) in &stage.channels {
            let age = figures.age_ns.map_or_else(|| "-".to_owned(), short);
            let gap = if figures.received > 1 { short(figures.longest_gap_ns) } else { "-".to_owned() };
            let counts = [figures.received, figures.lost, figures.foreign].map(|count| count.to_string());
            let [read, lost, foreign] = counts;
            let style = if figures.lost > 0 { WARN } else { Style::new() };
            let text = row(&format!("{name} <- {channel}"), [read, lost, foreign, age, gap]);
            lines.push(Line::styled(text, style));
        }
    }
    Text::from(lines)
}

/// A time in ns with its unit, in at most eight letters.
fn short(value: u64) -> String {
    match value {
        0..10_000 => format!("{value}ns"),
        10_000..10_000_000 => format!("{:.0}us", value as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.1}ms", value as f64 / 1e6),
        _ => format!("{:.0}s", value as f64 / 1e9),
    }
}

/// One event, with the time of the day, UTC.
pub fn event((unix_ms, event): &(u64, Event)) -> Line<'static> {
    let time = humantime::format_rfc3339_seconds(UNIX_EPOCH + Duration::from_millis(*unix_ms)).to_string();
    let time = time.get(11..19).unwrap_or_default().to_owned();
    let axis = event.axis.as_deref().unwrap_or("group");
    let more = if event.more > 0 { format!(" (and {} more times before)", event.more) } else { String::new() };
    let next = if event.next.is_empty() { String::new() } else { format!("; {}", event.next) };
    let style = if event.is_fault { BAD } else { Style::new() };
    Line::from(vec![
        Span::styled(format!(" {time} "), QUIET),
        Span::styled(format!("{axis}: {}: {}{more}{next}", event.kind, event.text), style),
    ])
}

/// The first letters of a name.
fn cut(name: &str, letters: usize) -> String {
    name.chars().take(letters).collect()
}
