//! What is to be said of a run in words: what went wrong first, with figures.

use pipeline::{message::StageHealth, stage::StageKind};

use super::story::Story;
use crate::report::events::{Event, LATCH, RESTART};

/// Part of the ticks that may be late. A single late tick is bridged by the command before it.
const MOST_LATE: f64 = 1e-3;

/// What is to be said of a run.
#[derive(Debug)]
pub struct Verdict {
    /// Nothing of what follows is wrong.
    pub is_good: bool,
    pub word: &'static str,
    pub why: String,
    /// One sentence for each thing that went wrong.
    pub wrong: Vec<String>,
}

impl Verdict {
    /// The verdict on a run.
    pub fn new(story: &Story) -> Self {
        let wrong: Vec<String> = [latches(story), stages(story), recording(story)].concat();
        let is_good = wrong.is_empty();
        let word = if is_good { "The run was in order" } else { "Something went wrong" };
        Self { is_good, word, why: summary(story, wrong.len()), wrong }
    }
}

/// What the run did, in two sentences.
fn summary(story: &Story, wrong: usize) -> String {
    let worst = story.axes.iter().filter(|axis| axis.tracking[0].count > 0);
    let worst = worst.max_by(|a, b| a.tracking[0].rmse().total_cmp(&b.tracking[0].rmse()));
    let tracked = worst.map_or_else(
        || "No axis was controlled.".to_owned(),
        |axis| {
            format!(
                "The axes followed their references with errors of at most {:.1} mm rms (the worst one is {}, its \
                 largest error {:.1} mm).",
                1e3 * axis.tracking[0].rmse(),
                axis.name,
                1e3 * axis.tracking[0].max
            )
        },
    );
    let late = if story.end_to_end.count() > 0 {
        format!(
            " 99 % of the commands were sent within {:.2} ms of their sample; the period is {:.2} ms.",
            1e-6 * story.end_to_end.at(0.99) as f64,
            1e3 * story.period
        )
    } else {
        String::new()
    };
    let wrong = match wrong {
        0 => String::new(),
        1 => " One thing is to be looked at:".to_owned(),
        more => format!(" {more} things are to be looked at:"),
    };
    tracked + &late + &wrong
}

/// A sentence for each fault that has latched axes; one fault can latch several of them.
fn latches(story: &Story) -> Vec<String> {
    let mut of_faults: Vec<(&Event, Vec<&str>, usize)> = Vec::new();
    for event in story.found.list.iter().filter(|event| event.kind == LATCH) {
        let axis = event.axis.as_deref().unwrap_or_default();
        match of_faults.iter_mut().find(|(first, ..)| first.text == event.text) {
            Some((_, axes, times)) => {
                *times += usize::from(axes.contains(&axis));
                if !axes.contains(&axis) {
                    axes.push(axis);
                }
            }
            None => of_faults.push((event, vec![axis], 1)),
        }
    }
    let sentence = |(first, axes, times): (&Event, Vec<&str>, usize)| {
        let were = if axes.len() > 1 { "Axes were latched" } else { "An axis was latched" };
        let again = if times > 1 { ", and again later" } else { "" };
        format!("{were} at {:.1} s{again} ({}): {}.", first.time_s, axes.join(", "), first.text)
    };
    of_faults.into_iter().map(sentence).collect()
}

/// Sentences about losses, late ticks and deaths of stages.
fn stages(story: &Story) -> Vec<String> {
    let mut sentences: Vec<String> = story
        .found
        .list
        .iter()
        .filter(|event| event.kind == RESTART)
        .map(|event| format!("At {:.1} s a stage was replaced: {}.", event.time_s, event.text))
        .collect();
    for kind in StageKind::ALL {
        let sum = |of: fn(&StageHealth) -> u64| story.stages.sum(kind, of);
        let lost = sum(StageHealth::lost);
        if lost > 0 {
            sentences.push(format!("{} has lost {lost} messages since its start.", kind.name()));
        }
        let (late, ticks) = (sum(|health| health.missed.total()), sum(|health| health.samples));
        if late as f64 > MOST_LATE * ticks as f64 {
            sentences.push(format!(
                "{} was late in {late} of {ticks} ticks since its start: by late input {}, by late release {}, by long \
                 work {} (hydraxis doctor says what the computer lacks).",
                kind.name(),
                sum(|health| health.missed.late_input),
                sum(|health| health.missed.late_release),
                sum(|health| health.missed.long_work)
            ));
        }
    }
    sentences
}

/// Sentences about what the recording lacks.
fn recording(story: &Story) -> Vec<String> {
    let mut sentences = Vec::new();
    if let Some(cause) = story.facts.get("cause") {
        sentences.push(format!("This is a black box, which a fault has left: {cause}."));
    }
    if let Some(damage) = &story.damage {
        sentences.push(format!("The recording ends at byte {} before its end: {}.", damage.byte, damage.what));
    }
    for (fact, count) in &story.facts {
        if let Some(channel) = fact.strip_suffix(" lost").filter(|_| count != "0") {
            sentences.push(format!("The recorder has missed {count} messages of {channel}."));
        }
    }
    sentences
}
