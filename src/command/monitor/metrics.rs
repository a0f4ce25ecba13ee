//! The figures of a group in the text format of Prometheus, version 0.0.4, and its health in one word.
//!
//! Units are those that Prometheus asks for: seconds and metres. A figure that is not known is left out.

use std::fmt::{Display, Write as _};

use pipeline::latency::Percentiles;
use serde_json::json;

use crate::report::status::{AxisFigures, SILENT_NS, StageFigures, StatusReport};

/// Quantiles of a latency, ns.
fn quantiles(percentiles: &Percentiles) -> [(&'static str, u64); 4] {
    let Percentiles { p50, p99, p99_9, p99_99, .. } = *percentiles;
    [("0.5", p50), ("0.99", p99), ("0.999", p99_9), ("0.9999", p99_99)]
}

/// The text in the making.
#[derive(Default)]
struct Text(String);

impl Text {
    /// Begins a metric. Name, `gauge`, `counter` or `summary`, and what it is.
    fn metric(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string cannot fail.
        let _ = write!(self.0, "# HELP hydraxis_{name} {help}\n# TYPE hydraxis_{name} {kind}\n");
    }

    /// A value with its labels.
    fn value(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        let labels: Vec<String> = labels.iter().map(|(label, text)| format!("{label}=\"{}\"", escaped(text))).collect();
        let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        let _ = writeln!(self.0, "hydraxis_{name}{labels} {value}");
    }

    /// A metric with a value for each stage.
    fn stages<V: Display>(
        &mut self,
        report: &StatusReport,
        (name, kind, help): (&str, &str, &str),
        of: impl Fn(&StageFigures) -> Option<V>,
    ) {
        self.metric(name, kind, help);
        for (stage, figures) in report.stages() {
            if let Some(value) = of(figures) {
                self.value(name, &[("stage", stage)], value);
            }
        }
    }

    /// A metric with a value for each axis.
    fn axes<V: Display>(
        &mut self,
        report: &StatusReport,
        (name, kind, help): (&str, &str, &str),
        of: impl Fn(&AxisFigures) -> Option<V>,
    ) {
        self.metric(name, kind, help);
        for (axis, figures) in report.axes() {
            if let Some(value) = of(figures) {
                self.value(name, &[("axis", axis)], value);
            }
        }
    }
}

/// A text within quotation marks.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}

/// All metrics; `watching` browsers look at the page.
pub fn text(report: Option<&StatusReport>, watching: usize) -> String {
    let mut text = Text::default();
    text.metric("up", "gauge", "1 while a group is there whose stages are all heard, else 0.");
    text.value("up", &[], u8::from(health(report).0));
    text.metric("monitor_browsers", "gauge", "Browsers that watch the page.");
    text.value("monitor_browsers", &[], watching);
    if let Some(report) = report {
        text.metric("group_info", "gauge", "Always 1; the label names the group.");
        text.value("group_info", &[("group", report.group())], 1);
        stages(&mut text, report);
        latencies(&mut text, report);
        axes(&mut text, report);
    }
    text.0
}

fn stages(text: &mut Text, report: &StatusReport) {
    let heard = ("stage_heartbeat_age_seconds", "gauge", "Age of the last heartbeat.");
    text.stages(report, heard, |stage| Some(seconds(stage.heartbeat_age_ns)));
    text.stages(report, ("stage_up", "gauge", "1 while the stage runs and is heard, else 0."), |stage| {
        Some(u8::from(stage.state == "running" && stage.heartbeat_age_ns <= SILENT_NS))
    });
    text.stages(report, ("stage_samples_total", "counter", "Ticks worked."), |stage| Some(stage.samples));
    let rate = ("stage_rate_hertz", "gauge", "Ticks per second over the last heartbeats.");
    text.stages(report, rate, |stage| Some(stage.rate_hz).filter(|rate| rate.is_finite()));
    let implausible = ("stage_implausible_samples_total", "counter", "Samples with a fault bit.");
    text.stages(report, implausible, |stage| Some(stage.implausible));
    text.metric("stage_missed_deadlines_total", "counter", "Ticks whose output came late or not at all, by cause.");
    for (name, stage) in report.stages() {
        for (cause, count) in [
            ("late input", stage.missed_by_late_input),
            ("late release", stage.missed_by_late_release),
            ("long work", stage.missed_by_long_work),
        ] {
            text.value("stage_missed_deadlines_total", &[("stage", name), ("cause", cause)], count);
        }
    }
    text.metric("channel_lost_messages_total", "counter", "Messages that a stage has not read.");
    for (name, stage) in report.stages() {
        for (channel, figures) in &stage.channels {
            text.value("channel_lost_messages_total", &[("stage", name), ("channel", channel)], figures.lost);
        }
    }
    text.metric("channel_age_seconds", "gauge", "Age of the newest message of a channel at the last heartbeat.");
    for (name, stage) in report.stages() {
        for (channel, age) in stage.channels.iter().filter_map(|(channel, figures)| Some((channel, figures.age_ns?))) {
            text.value("channel_age_seconds", &[("stage", name), ("channel", channel)], seconds(age));
        }
    }
}

fn latencies(text: &mut Text, report: &StatusReport) {
    let kinds = |stage: &StageFigures| {
        [
            ("wait", stage.wait_ns),
            ("work", stage.work_ns),
            ("end to end", stage.end_to_end_ns),
            ("release jitter", stage.release_jitter_ns),
        ]
        .into_iter()
        .filter(|(_, percentiles)| percentiles.count > 0)
    };
    text.metric("latency_seconds", "gauge", "Quantiles of latencies since the start of the stage.");
    for (name, stage) in report.stages() {
        for (kind, percentiles) in kinds(stage) {
            for (quantile, nanoseconds) in quantiles(&percentiles) {
                let labels = [("stage", name), ("kind", kind), ("quantile", quantile)];
                text.value("latency_seconds", &labels, seconds(nanoseconds));
            }
        }
    }
    text.metric("latency_max_seconds", "gauge", "Largest latency since the start of the stage.");
    for (name, stage) in report.stages() {
        for (kind, percentiles) in kinds(stage) {
            text.value("latency_max_seconds", &[("stage", name), ("kind", kind)], seconds(percentiles.max));
        }
    }
}

fn axes(text: &mut Text, report: &StatusReport) {
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    text.axes(report, ("axis_position_metres", "gauge", "Last plausible position."), |axis| axis.position);
    text.axes(report, ("axis_reference_metres", "gauge", "Reference."), |axis| finite(axis.reference));
    text.axes(report, ("axis_error_metres", "gauge", "Following error."), |axis| finite(axis.error));
    text.axes(report, ("axis_command", "gauge", "Valve command, -1 to 1."), |axis| finite(axis.command));
    let age = ("axis_model_age_seconds", "gauge", "Age of the sample of the newest model.");
    text.axes(report, age, |axis| axis.model_age_ns.map(seconds));
    let factor = ("axis_forgetting_factor", "gauge", "Forgetting factor of the newest model.");
    text.axes(report, factor, |axis| axis.forgetting_factor);
    let sigma = ("axis_prediction_sigma", "gauge", "Standard deviation of the prediction, in the unit of the output.");
    text.axes(report, sigma, |axis| axis.h_step_sigma);
    let slowed = ("axis_slowed_ticks", "gauge", "Ticks with a slowed reference since the axis was armed.");
    text.axes(report, slowed, |axis| Some(axis.slowed_ticks));
    text.metric("axis_mode", "gauge", "Always 1; labels: mode of operation, and who commands.");
    for (name, axis) in report.axes() {
        text.value("axis_mode", &[("axis", name), ("mode", axis.mode), ("by", axis.command_by)], 1);
    }
    text.metric("axis_latched", "gauge", "1 while a fault has latched the axis, else 0.");
    for (name, axis) in report.axes() {
        text.value("axis_latched", &[("axis", name)], u8::from(axis.is_latched));
    }
    text.metric("axis_flag", "gauge", "1 for each flag that is set.");
    for (name, axis) in report.axes() {
        for flag in &axis.flags {
            text.value("axis_flag", &[("axis", name), ("flag", flag)], 1);
        }
    }
}

/// Whether the group is there with all its stages heard; and that as JSON, with the reasons.
pub fn health(report: Option<&StatusReport>) -> (bool, String) {
    let Some(report) = report else {
        return (false, json!({"status": "absent", "why": "no group is there"}).to_string());
    };
    let silent = report.silent();
    let latched: Vec<&str> = report.axes().filter(|(_, axis)| axis.is_latched).map(|(name, _)| name).collect();
    let has_stages = report.stages().next().is_some();
    let is_well = silent.is_empty() && has_stages;
    let status = if is_well { "ok" } else { "silent" };
    (is_well, json!({"status": status, "group": report.group(), "silent": silent, "latched": latched}).to_string())
}

#[cfg(test)]
mod tests {
    use pipeline::message::{MachineState, StageHealth, StageState, control_flag};

    use super::*;
    use crate::report::status::Collected;

    fn report(age_ns: u64) -> StatusReport {
        let mut health = StageHealth { stage: 3, state: StageState::Running as u32, ..StageHealth::default() };
        health.header.sent_ns = 5_000_000_000;
        (health.missed.long_work, health.work.count, health.work.p99) = (4, 10, 2_000_000);
        let mut state = MachineState::default();
        state.header.axis_count = 1;
        state.axes[0].set_name("a\"b\\");
        state.axes[0].sample.position = 0.5;
        state.axes[0].command.error = f64::NAN;
        state.axes[0].command.flags = control_flag::STALL;
        StatusReport::new(&Collected {
            prefix: "demo".parse().unwrap(),
            stages: [None, None, None, Some((health, health))],
            state: Some(state),
            members: Vec::new(),
            rooms: Vec::new(),
            now_ns: 5_000_000_000 + age_ns,
        })
    }

    #[test]
    fn every_line_is_a_comment_or_a_value_of_a_metric_that_was_begun() {
        let text = text(Some(&report(100_000_000)), 2);
        let mut begun = "";
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# TYPE ") {
                begun = rest.split(' ').next().unwrap();
            } else if !line.starts_with('#') {
                let (name, value) = line.rsplit_once(' ').unwrap();
                assert_eq!(name.split('{').next().unwrap(), begun, "{line}");
                assert!(value.parse::<f64>().is_ok_and(f64::is_finite), "{line}");
            }
        }
        for line in [
            "hydraxis_up 1",
            "hydraxis_monitor_browsers 2",
            "hydraxis_axis_position_metres{axis=\"a\\\"b\\\\\"} 0.5",
            "hydraxis_axis_latched{axis=\"a\\\"b\\\\\"} 1",
            "hydraxis_axis_flag{axis=\"a\\\"b\\\\\",flag=\"stall\"} 1",
            "hydraxis_stage_missed_deadlines_total{stage=\"control-proc\",cause=\"long work\"} 4",
            "hydraxis_latency_seconds{stage=\"control-proc\",kind=\"work\",quantile=\"0.99\"} 0.002",
            "hydraxis_stage_heartbeat_age_seconds{stage=\"control-proc\"} 0.1",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        assert!(!text.contains("axis_error_metres{"), "an unknown figure is left out");
    }

    #[test]
    fn the_dashboard_shows_metrics_that_there_are() {
        let text = text(Some(&report(0)), 0);
        let dashboard = include_str!("../../../examples/grafana.json");
        let names: Vec<&str> = dashboard
            .split(|c: char| !c.is_ascii_alphanumeric() && c != '_')
            .filter(|word| word.starts_with("hydraxis_"))
            .collect();
        assert!(names.len() > 12, "{names:?}");
        assert!(names.iter().all(|name| text.contains(&format!("# TYPE {name} "))), "{names:?}");
    }

    #[test]
    fn a_silent_or_absent_group_is_not_well() {
        assert!(health(Some(&report(100_000_000))).0);
        let (is_well, text) = health(Some(&report(1_500_000_000)));
        assert!(!is_well && text.contains("control-proc") && text.contains("silent"), "{text}");
        assert!(!health(None).0 && text_of_nothing().contains("hydraxis_up 0"));
    }

    fn text_of_nothing() -> String {
        text(None, 0)
    }
}
