//! The figures of a running group, for the tables and the JSON of `hydraxis status` and for the page of `hydraxis
//! monitor`.

use std::collections::BTreeMap;

use pipeline::{
    MAX_AXES,
    channel::{Member, Prefix, Room},
    latency::Percentiles,
    message::{
        AxisMode, AxisState, ControlMode, MachineState, MissCause, StageHealth, StageState, TeethState, TipState,
        bit_names, control_flag, model_fault, sample_fault,
    },
    stage::StageKind,
};
use serde::Serialize;

use super::{
    table::{nanoseconds, number, table},
    why::why_fallback,
};

/// A stage whose last heartbeat is older than this, ns, is silent: ten heartbeats are missing.
pub const SILENT_NS: u64 = 1_000_000_000;

/// The messages of a group within a short time.
pub struct Collected {
    /// Name of the group.
    pub prefix: Prefix,
    /// First and last heartbeat of each stage.
    pub stages: [Option<(StageHealth, StageHealth)>; 4],
    /// The newest state of the axes.
    pub state: Option<MachineState>,
    /// The processes of the group, without the one that asks.
    pub members: Vec<Member>,
    /// The room for a stage that starts again.
    pub rooms: Vec<Room>,
    /// When they were collected, ns of `CLOCK_MONOTONIC`.
    pub now_ns: u64,
}

/// Where the bucket's teeth are, and what the bucket carries; m, degrees and kg.
#[derive(Debug, Serialize)]
pub struct TeethNow {
    /// `[x, z]`, m.
    at: [f64; 2],
    /// Pitch of the bucket, degrees.
    pitch: f64,
    /// What the controller counts on in the bucket, kg.
    payload: f64,
    /// Distance from the way, m, and error of the pitch, degrees; none while the teeth follow no way.
    error: Option<f64>,
    pitch_error: Option<f64>,
}

impl TeethNow {
    fn new(teeth: &TeethState) -> Option<Self> {
        let follows = teeth.state == TipState::OnTheWay as u32;
        (teeth.state != TipState::Unknown as u32).then(|| Self {
            at: [teeth.x, teeth.z],
            pitch: teeth.pitch.to_degrees(),
            payload: teeth.payload,
            error: follows.then_some(teeth.error),
            pitch_error: follows.then_some(teeth.pitch_error.to_degrees()),
        })
    }

    /// A line for people.
    fn line(&self) -> String {
        let [x, z] = self.at;
        let place = format!(
            "teeth at [{x:.3}, {z:.3}] m, pitch {:.1} degrees, {:.0} kg in the bucket",
            self.pitch, self.payload
        );
        match self.error.zip(self.pitch_error) {
            Some((error, pitch)) => {
                format!("{place}; {:.1} mm from their way, pitch off by {pitch:+.2}\n", 1e3 * error)
            }
            None => place + "\n",
        }
    }
}

/// The figures of a group, as JSON has them.
#[derive(Debug, Serialize)]
pub struct StatusReport {
    group: String,
    stages: BTreeMap<&'static str, StageFigures>,
    axes: BTreeMap<String, AxisFigures>,
    /// Where the bucket's teeth are; none without a mechanism, and while the position of an axis is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    teeth: Option<TeethNow>,
    /// The processes of the group that have sent no heartbeat.
    others: Vec<OtherProcess>,
    /// What keeps a stage that dies from starting again.
    warnings: Vec<String>,
    /// Names of the stages in the order in which the data goes through them.
    #[serde(skip)]
    order: Vec<&'static str>,
    /// Names of the axes in the order of the machine.
    #[serde(skip)]
    names: Vec<String>,
}

#[derive(Debug, Serialize)]
struct OtherProcess {
    name: String,
    pid: u32,
    is_alive: bool,
}

impl OtherProcess {
    /// Whether the process joined the group as a stage.
    fn is_stage(&self) -> bool {
        StageKind::ALL.iter().any(|kind| kind.name() == self.name)
    }
}

/// The figures of one stage.
#[derive(Debug, Serialize)]
pub struct StageFigures {
    pub pid: u32,
    pub state: &'static str,
    pub heartbeat_age_ns: u64,
    /// Time over which the stage has counted, ns.
    pub counted_ns: u64,
    pub tick: u64,
    pub rate_hz: f64,
    pub samples: u64,
    pub implausible: u64,
    pub lost: u64,
    pub missed_deadlines: u64,
    pub missed_by_late_input: u64,
    pub missed_by_late_release: u64,
    pub missed_by_long_work: u64,
    pub last_missed_tick: Option<u64>,
    pub last_missed_cause: &'static str,
    pub channels: BTreeMap<&'static str, ChannelFigures>,
    pub wait_ns: Percentiles,
    pub work_ns: Percentiles,
    pub end_to_end_ns: Percentiles,
    pub release_jitter_ns: Percentiles,
}

/// A channel, as counted by the stage that reads it.
#[derive(Debug, Serialize)]
pub struct ChannelFigures {
    pub received: u64,
    /// Messages that the stage has not read.
    pub lost: u64,
    /// Messages about another machine, or that do not say about which: not read.
    pub foreign: u64,
    pub writer_restarts: u64,
    /// Age of the newest message at the heartbeat.
    pub age_ns: Option<u64>,
    pub longest_gap_ns: u64,
}

/// The figures of one axis.
#[derive(Debug, Serialize)]
pub struct AxisFigures {
    pub mode: &'static str,
    pub command_by: &'static str,
    pub command: f64,
    /// None before the first plausible position.
    pub position: Option<f64>,
    pub velocity: Option<f64>,
    /// Pressures of piston side and rod side, Pa, if they are measured.
    pub pressures: Option<(f64, f64)>,
    pub reference: f64,
    pub error: f64,
    pub flags: Vec<&'static str>,
    /// A fault keeps the axis neutral until it is released.
    pub is_latched: bool,
    pub sample_faults: Vec<&'static str>,
    pub model_age_ns: Option<u64>,
    pub model_faults: Vec<&'static str>,
    pub forgetting_factor: Option<f64>,
    pub h_step_sigma: Option<f64>,
    pub rejected_snapshots: u64,
    pub unsolved_plans: u64,
    pub slowed_ticks: u32,
    pub refused_requests: u32,
    /// Gains of the fallback, as a part of those of the machine file, and the least and largest that may be asked for.
    pub gain: f64,
    pub gain_range: [f64; 2],
    /// Why the fallback controls the axis.
    pub why_fallback: Option<String>,
}

impl StatusReport {
    /// The figures of what was collected.
    pub fn new(collected: &Collected) -> Self {
        let stages = StageKind::ALL.into_iter().filter_map(|kind| {
            let (first, last) = collected.stages[kind as usize].as_ref()?;
            Some((kind.name(), StageFigures::new(first, last, collected.now_ns)))
        });
        let stages: Vec<_> = stages.collect();
        let axes =
            collected.state.iter().flat_map(|state| &state.axes[..(state.header.axis_count as usize).min(MAX_AXES)]);
        let axes: Vec<_> = axes.map(|axis| (axis.name().to_owned(), AxisFigures::new(axis))).collect();
        let is_heard = |pid: u32| collected.stages.iter().flatten().any(|(_, last)| last.pid == pid);
        let others = collected.members.iter().filter(|member| !is_heard(member.pid)).map(|member| OtherProcess {
            name: member.name.clone(),
            pid: member.pid,
            is_alive: member.is_alive,
        });
        Self {
            teeth: collected.state.as_ref().and_then(|state| TeethNow::new(&state.teeth)),
            others: others.collect(),
            warnings: collected.rooms.iter().filter(|room| room.is_short()).map(Room::to_string).collect(),
            group: collected.prefix.to_string(),
            order: stages.iter().map(|(name, _)| *name).collect(),
            names: axes.iter().map(|(name, _)| name.clone()).collect(),
            stages: stages.into_iter().collect(),
            axes: axes.into_iter().collect(),
        }
    }

    /// Names of the stages whose heartbeats are missing.
    pub fn silent(&self) -> Vec<&str> {
        let is_silent = |name: &&str| {
            let stage = &self.stages[*name];
            stage.heartbeat_age_ns > SILENT_NS && stage.state != StageState::name(StageState::Stopped as u32)
        };
        let unheard = self.others.iter().filter(|other| other.is_stage()).map(|other| other.name.as_str());
        self.order.iter().copied().filter(is_silent).chain(unheard).collect()
    }

    /// All figures as tables: stages, channels, latencies, other processes, axes.
    pub fn tables(&self) -> String {
        let parts = [
            format!("Group \"{}\"\n", self.group),
            self.stage_table(),
            self.channel_table(),
            self.latency_table(),
            self.others(),
            self.warnings.iter().map(|warning| format!("\nwarning: {warning}\n")).collect(),
            self.axis_table(),
            self.teeth.as_ref().map(TeethNow::line).unwrap_or_default(),
        ];
        parts.concat()
    }

    /// Name of the group.
    pub fn group(&self) -> &str {
        &self.group
    }

    /// Names and figures of the stages, in the order in which the data goes through them.
    pub fn stages(&self) -> impl Iterator<Item = (&'static str, &StageFigures)> {
        self.order.iter().map(|name| (*name, &self.stages[name]))
    }

    /// Names and figures of the axes, in the order of the machine.
    pub fn axes(&self) -> impl Iterator<Item = (&str, &AxisFigures)> {
        self.names.iter().map(|name| (name.as_str(), &self.axes[name]))
    }

    /// Where the bucket's teeth are; none without a mechanism, and while the position of an axis is not known.
    pub fn teeth(&self) -> Option<&TeethNow> {
        self.teeth.as_ref()
    }

    /// What keeps a stage that dies from starting again.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn stage_table(&self) -> String {
        let rows = self.stages().map(|(name, stage)| stage_row(name, stage));
        let header = [
            "stage",
            "pid",
            "state",
            "heard",
            "tick",
            "1/s",
            "lost",
            "late input",
            "release",
            "work",
            "last late tick",
            "counted",
        ];
        format!("{}\n\n", table(&header, rows.collect()))
    }

    fn channel_table(&self) -> String {
        let rows = self.stages().flat_map(|(name, stage)| {
            stage.channels.iter().map(move |(channel, figures)| {
                vec![
                    format!("{name} <- {channel}"),
                    figures.received.to_string(),
                    figures.lost.to_string(),
                    figures.foreign.to_string(),
                    figures.writer_restarts.to_string(),
                    figures.age_ns.map_or_else(|| "-".to_owned(), nanoseconds),
                    if figures.received > 1 { nanoseconds(figures.longest_gap_ns) } else { "-".to_owned() },
                ]
            })
        });
        let header = ["channel", "read", "lost", "foreign", "writer restarts", "age", "longest gap"];
        format!("{}\n\n", table(&header, rows.collect()))
    }

    fn latency_table(&self) -> String {
        let rows = self.stages().flat_map(|(name, stage)| {
            let kinds = [
                ("wait", &stage.wait_ns),
                ("work", &stage.work_ns),
                ("end to end", &stage.end_to_end_ns),
                ("release jitter", &stage.release_jitter_ns),
            ];
            kinds.into_iter().filter(|(_, p)| p.count > 0).map(move |(kind, p)| {
                let mut row = vec![format!("{name} {kind}"), p.count.to_string()];
                row.extend([p.p50, p.p99, p.p99_9, p.p99_99, p.max].map(nanoseconds));
                row.push(p.beyond.to_string());
                row
            })
        });
        let header = ["latency", "count", "p50", "p99", "p99.9", "p99.99", "max", "beyond"];
        format!("{}\n", table(&header, rows.collect()))
    }

    /// A line for each process without heartbeats.
    fn others(&self) -> String {
        let line = |other: &OtherProcess| {
            let state = match (other.is_alive, other.is_stage()) {
                (false, _) => "killed",
                (true, true) => "nothing heard",
                (true, false) => "alive",
            };
            format!("\nalso there: {}, process {}, {state}", other.name, other.pid)
        };
        let lines: String = self.others.iter().map(line).collect();
        if lines.is_empty() { lines } else { lines + "\n" }
    }

    fn axis_table(&self) -> String {
        if self.names.is_empty() {
            return String::new();
        }
        let rows = self.names.iter().map(|name| axis_row(name, &self.axes[name]));
        let header = ["axis", "mode", "command", "by", "position", "error", "model age", "sigma", "flags"];
        let whys = self.names.iter().filter_map(|name| {
            let why = self.axes[name].why_fallback.as_ref()?;
            Some(format!("{name}: by the fallback: {why}\n"))
        });
        format!("\n{}\n{}", table(&header, rows.collect()), whys.collect::<String>())
    }
}

fn stage_row(name: &str, stage: &StageFigures) -> Vec<String> {
    let last = stage.last_missed_tick.map(|tick| format!("{tick}, {}", stage.last_missed_cause));
    vec![
        name.to_owned(),
        stage.pid.to_string(),
        stage.state.to_owned(),
        nanoseconds(stage.heartbeat_age_ns),
        stage.tick.to_string(),
        number(stage.rate_hz),
        stage.lost.to_string(),
        stage.missed_by_late_input.to_string(),
        stage.missed_by_late_release.to_string(),
        stage.missed_by_long_work.to_string(),
        last.unwrap_or_else(|| "-".to_owned()),
        nanoseconds(stage.counted_ns),
    ]
}

fn axis_row(name: &str, axis: &AxisFigures) -> Vec<String> {
    let words = axis.flags.iter().chain(&axis.sample_faults).chain(&axis.model_faults);
    let words: Vec<&str> = words.copied().collect();
    vec![
        name.to_owned(),
        axis.mode.to_owned(),
        format!("{:+.4}", axis.command),
        axis.command_by.to_owned(),
        axis.position.map_or_else(|| "-".to_owned(), |position| format!("{position:.4} m")),
        format!("{:+.2} mm", 1e3 * axis.error),
        axis.model_age_ns.map_or_else(|| "-".to_owned(), nanoseconds),
        axis.h_step_sigma.map_or_else(|| "-".to_owned(), |sigma| format!("{} mm", number(1e3 * sigma))),
        if words.is_empty() { "-".to_owned() } else { words.join(", ") },
    ]
}

impl StageFigures {
    fn new(first: &StageHealth, last: &StageHealth, now_ns: u64) -> Self {
        let seconds = last.header.sent_ns.saturating_sub(first.header.sent_ns) as f64 / 1e9;
        let ticks = last.samples.saturating_sub(first.samples) as f64;
        let missed = &last.missed;
        Self {
            pid: last.pid,
            state: StageState::name(last.state),
            heartbeat_age_ns: now_ns.saturating_sub(last.header.sent_ns),
            counted_ns: now_ns.saturating_sub(last.since_ns),
            tick: last.header.sequence,
            rate_hz: if seconds > 0.0 { ticks / seconds } else { f64::NAN },
            samples: last.samples,
            implausible: last.implausible,
            lost: last.lost(),
            missed_deadlines: missed.total(),
            missed_by_late_input: missed.late_input,
            missed_by_late_release: missed.late_release,
            missed_by_long_work: missed.long_work,
            last_missed_tick: (missed.total() > 0).then_some(missed.last_tick),
            last_missed_cause: MissCause::name(missed.last_cause),
            channels: last
                .channels()
                .iter()
                .map(|channel| {
                    let figures = ChannelFigures {
                        received: channel.received,
                        lost: channel.lost,
                        foreign: channel.foreign,
                        writer_restarts: channel.restarts,
                        age_ns: (channel.any != 0).then_some(channel.age_ns),
                        longest_gap_ns: channel.longest_gap_ns,
                    };
                    (channel.name(), figures)
                })
                .collect(),
            wait_ns: last.wait,
            work_ns: last.work,
            end_to_end_ns: last.end_to_end,
            release_jitter_ns: last.release_jitter,
        }
    }
}

impl AxisFigures {
    fn new(axis: &AxisState) -> Self {
        let (command, sample) = (&axis.command, &axis.sample);
        let has_model = axis.has_model != 0;
        Self {
            mode: AxisMode::from_number(command.operation).map_or("unknown", AxisMode::name),
            command_by: ControlMode::name(command.mode),
            command: command.command,
            position: sample.last_plausible(),
            velocity: sample.last_plausible().map(|_| sample.velocity),
            pressures: sample.pressures(),
            reference: command.reference,
            error: command.error,
            flags: bit_names(command.flags, &control_flag::NAMES).collect(),
            is_latched: command.flags & control_flag::LATCHED != 0,
            sample_faults: bit_names(sample.faults, &sample_fault::NAMES).collect(),
            model_age_ns: has_model.then_some(axis.model_age_ns),
            model_faults: bit_names(axis.model_faults, &model_fault::NAMES).collect(),
            forgetting_factor: has_model.then_some(axis.forgetting_factor),
            h_step_sigma: has_model.then_some(axis.h_step_sigma).filter(|sigma| sigma.is_finite()),
            rejected_snapshots: command.rejected_snapshots.iter().sum(),
            unsolved_plans: command.unsolved_plans,
            slowed_ticks: command.slowed_ticks,
            refused_requests: command.refused_requests,
            gain: command.gain,
            gain_range: axis.gain_range,
            why_fallback: why_fallback(axis.name(), None, command, axis.model_faults),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_has_no_position_yet_shows_none() {
        let mut axis = AxisState::default();
        axis.sample.faults = sample_fault::STALE;
        let figures = AxisFigures::new(&axis);
        assert_eq!(axis_row("boom", &figures)[4], "-");
        assert!(serde_json::to_value(&figures).unwrap()["position"].is_null());
        axis.sample.position = 0.65;
        assert_eq!(axis_row("boom", &AxisFigures::new(&axis))[4], "0.6500 m", "the last plausible one");
        (axis.sample.position, axis.sample.faults) = (0.0, 0);
        assert_eq!(axis_row("boom", &AxisFigures::new(&axis))[4], "0.0000 m", "a position of 0 is one");
    }
}
