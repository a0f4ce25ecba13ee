//! The page: verdict, what ran, events, axes, models, latencies.

use std::{
    error::Error,
    time::{Duration, UNIX_EPOCH},
};

use pipeline::{
    message::{AxisSnapshot, ControlMode, StageHealth},
    stage::StageKind,
    statistics::ErrorStatistics,
};

use super::{
    latency,
    models::{chart, line},
    story::{AxisStory, Story},
    timeline,
    verdict::Verdict,
};
use crate::report::{
    chart::{COLOURS, HALF, WIDE},
    figures::Reduction,
    page::{Figure, Page},
    table::{nanoseconds, number, percent},
};

/// Events of the list.
const MOST_EVENTS: usize = 100;
/// Facts about the recording that are shown, and their names.
const FACTS: [(&str, &str); 4] =
    [("machine", "machine"), ("group", "group"), ("version", "version of Hydraxis"), ("cause", "black box")];

type Drawn<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// The whole page as HTML.
///
/// # Errors
/// The library cannot draw a picture.
pub fn html(story: &Story, file: &str) -> Drawn<String> {
    let name = story.facts.get("machine").map_or("a machine", String::as_str);
    let mut page = Page::new(&format!("Run of {name}"));
    let verdict = Verdict::new(story);
    page.verdict(verdict.is_good, verdict.word, &verdict.why);
    page.list(&verdict.wrong);
    tracking(&mut page, story);
    page.section("What ran");
    page.facts(&facts(story, file));
    page.section("Who commanded, and what happened");
    page.svg(&timeline::svg(story), "The numbers of faults are those of the list below.");
    events(&mut page, story);
    story.teeth.add_to(&mut page, story.period)?;
    for axis in &story.axes {
        page.section(&format!("Axis {}", axis.name));
        page.pictures(&axis_figures(axis))?;
        let models = axis.models.figures();
        if models.is_empty() {
            page.paragraph("No model of this axis was recorded after its training.");
        }
        page.pictures(&models)?;
    }
    page.section("Latencies");
    latencies(&mut page, story)?;
    Ok(page.finish())
}

/// Table of the following errors, and of the errors of the models.
fn tracking(page: &mut Page, story: &Story) {
    let row = |axis: &AxisStory| {
        let [all, model] = &axis.tracking;
        let time = |mode: ControlMode| {
            let commanded: f64 = axis.commanders.all().iter().map(|span| span.1 - span.0).sum();
            percent(100.0 * axis.commanders.time(mode as u32) / commanded.max(1e-9))
        };
        let snapshot = axis.models.last.as_deref();
        let sigma =
            |of: fn(&AxisSnapshot) -> f64| snapshot.map_or("-".to_owned(), |snapshot| number(1e3 * of(snapshot)));
        let reduction = snapshot
            .map_or(f64::NAN, |snapshot| Reduction::new(&snapshot.classical_errors, &snapshot.adaptive_errors).h_step);
        vec![
            axis.name.clone(),
            millimetres(all, ErrorStatistics::rmse),
            millimetres(all, |errors| errors.max),
            millimetres(model, ErrorStatistics::rmse),
            time(ControlMode::Model),
            time(ControlMode::Fallback),
            sigma(|snapshot| snapshot.classical_errors.h_step.sigma()),
            sigma(|snapshot| snapshot.adaptive_errors.h_step.sigma()),
            percent(reduction),
        ]
    };
    let header = [
        "axis",
        "following error rms, mm",
        "largest, mm",
        "rms by model, mm",
        "by model",
        "by fallback",
        "prediction, held, mm",
        "adaptive, mm",
        "reduction",
    ];
    let rows: Vec<Vec<String>> = story.axes.iter().map(row).collect();
    page.table(&header.map(str::to_owned), &rows);
    page.paragraph(
        "Following error: reference - position while a controller commanded. Prediction: standard deviation of the \
         error of the held and of the adaptive model over their horizon, since the start of the identifier; the \
         reduction is 1 - adaptive / held.",
    );
}

fn millimetres(errors: &ErrorStatistics, of: impl Fn(&ErrorStatistics) -> f64) -> String {
    if errors.count == 0 { "-".to_owned() } else { number(1e3 * of(errors)) }
}

fn facts(story: &Story, file: &str) -> Vec<(&'static str, String)> {
    let begin = humantime::format_rfc3339_millis(UNIX_EPOCH + Duration::from_nanos(story.begin_ns));
    let duration = humantime::format_duration(Duration::from_millis((1e3 * story.duration) as u64));
    let mut rows: Vec<(&str, String)> =
        FACTS.iter().filter_map(|(fact, name)| Some((*name, story.facts.get(*fact)?.clone()))).collect();
    let names: Vec<&str> = story.axes.iter().map(|axis| axis.name.as_str()).collect();
    let ticks = story.axes.iter().map(|axis| axis.ticks).max().unwrap_or_default();
    rows.extend([
        ("axes", names.join(", ")),
        ("begin, UTC", begin.to_string()),
        ("length", duration.to_string()),
        ("period", nanoseconds((1e9 * story.period) as u64)),
        ("commands", ticks.to_string()),
        ("recording", file.to_owned()),
    ]);
    if let Some(machine) = &story.machine {
        rows.push(("source of samples", machine.source.kind().to_owned()));
        rows.push(("scenario", machine.scenario.name.clone()));
    }
    rows
}

fn events(page: &mut Page, story: &Story) {
    if story.found.list.is_empty() {
        page.paragraph("No fault, no change of mode and no change of the controller was recorded.");
        return;
    }
    // Faults first: a long run has many changes of the controller.
    let faults = story.found.list.iter().enumerate().filter(|(_, event)| event.is_fault);
    let others = story.found.list.iter().enumerate().filter(|(_, event)| !event.is_fault);
    let mut shown: Vec<_> = faults.chain(others).take(MOST_EVENTS).collect();
    shown.sort_by_key(|(index, _)| *index);
    let rows: Vec<Vec<String>> = shown
        .iter()
        .map(|(index, event)| {
            let next = if event.next.is_empty() { String::new() } else { format!("; {}", event.next) };
            let more = if event.more > 0 { format!(" (and {} more times before)", event.more) } else { String::new() };
            vec![
                (index + 1).to_string(),
                format!("{:.3}", event.time_s),
                event.axis.clone().unwrap_or_default(),
                event.kind.to_owned(),
                format!("{}{more}{next}", event.text),
            ]
        })
        .collect();
    page.wide_table(&["number", "time, s", "axis", "what", "why, and what to do"].map(str::to_owned), &rows);
    let left_out = (story.found.list.len() - shown.len()) as u64 + story.found.left_out;
    if left_out > 0 {
        page.paragraph(&format!(
            "{left_out} more events are not listed; hydraxis info --events lists changes of modes."
        ));
    }
}

fn axis_figures(axis: &AxisStory) -> Vec<Figure> {
    let position = chart(
        "Reference and position",
        "position, m",
        WIDE,
        vec![
            line("position", axis.position.points(), COLOURS[0], 4),
            line("reference", axis.reference.points(), COLOURS[1], 2),
        ],
    );
    let error = chart("Following error", "error, mm", HALF, vec![line("", axis.error.points(), COLOURS[0], 2)]);
    let command = chart("Valve command", "command", HALF, vec![line("", axis.command.points(), COLOURS[0], 2)]);
    let caption = "The reference is drawn while a controller commands the axis.".to_owned();
    let none = String::new();
    [(position, caption), (error, none.clone()), (command, none)]
        .map(|(chart, caption)| Figure { chart, caption })
        .into_iter()
        .filter(|figure| figure.chart.has_points())
        .collect()
}

fn latencies(page: &mut Page, story: &Story) -> Drawn<()> {
    let all = [&story.end_to_end, &story.jitter];
    if let Some(chart) = latency::chart(&all, story.period) {
        let caption =
            "End to end: from the acquisition of a sample to sending its command. Release jitter: how much the \
                       time between two samples differs from the period."
                .to_owned();
        page.pictures(&[Figure { chart, caption }])?;
    }
    page.table(&latency::header(), &all.map(latency::Latency::row));
    let row = |kind: StageKind| {
        let sum = |of: fn(&StageHealth) -> u64| story.stages.sum(kind, of).to_string();
        let last = story.stages.last[kind as usize].as_ref()?;
        Some(vec![
            kind.name().to_owned(),
            sum(|health| health.samples),
            sum(|health| health.missed.late_input),
            sum(|health| health.missed.late_release),
            sum(|health| health.missed.long_work),
            sum(StageHealth::lost),
            nanoseconds(last.wait.p99),
            nanoseconds(last.work.p99),
            nanoseconds(last.work.max),
        ])
    };
    let rows: Vec<Vec<String>> = StageKind::ALL.into_iter().filter_map(row).collect();
    if rows.is_empty() {
        page.paragraph("No heartbeat of a stage was recorded.");
    } else {
        let header =
            ["stage", "ticks", "late by input", "by release", "by work", "lost", "wait p99", "work p99", "work max"];
        page.table(&header.map(str::to_owned), &rows);
        page.paragraph(
            "Late: the output came later than one period after its sample was due. Counted by the stages since their \
             start.",
        );
    }
    Ok(())
}
