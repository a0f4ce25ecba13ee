//! The screen: a head, one of five tabs, and the keys.

use std::time::Duration;

use pipeline::channel::Prefix;
use ratatui::{
    Frame,
    layout::{Constraint, Layout, Rect},
    style::Style,
    text::{Line, Span, Text},
    widgets::{Paragraph, Wrap},
};

use super::{
    look::{BAD, CHOSEN, GOOD, OLD, QUIET, WARN},
    views::{AXIS_HEADER, STAGE_HEADER, axes, axis_line, channels, event, latencies, stage_line},
};
use crate::report::{events::Event, status::StatusReport};

/// A state of the axes that is older than this is no longer the present one. There are ten a second.
const STALE: Duration = Duration::from_millis(700);
/// The keys.
const KEYS: &str = " 1-5 or Tab: view   up, down: scroll   q: end";

/// A view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tab {
    /// Axes, stages and the last events.
    Overview,
    /// Everything about the axes.
    Axes,
    /// Latencies of the stages.
    Latencies,
    /// Channels of the stages.
    Channels,
    /// All events.
    Log,
}

impl Tab {
    /// All views, by their numbers.
    pub const ALL: [Self; 5] = [Self::Overview, Self::Axes, Self::Latencies, Self::Channels, Self::Log];

    fn name(self) -> &'static str {
        ["overview", "axes", "latencies", "channels", "log"][self as usize]
    }

    /// The view so many places further, from the last one on to the first.
    pub fn next(self, places: usize) -> Self {
        Self::ALL[(self as usize + places) % Self::ALL.len()]
    }
}

/// What is shown.
pub struct Shown {
    /// Name of the group.
    pub prefix: Prefix,
    /// Why there is no group; none while there is one.
    pub absent: Option<String>,
    /// The last figures.
    pub report: Option<StatusReport>,
    /// Tick and age of the newest state of the axes.
    pub state: Option<(u64, Duration)>,
    /// Period of the machine, if it is known.
    pub period: Option<Duration>,
    /// Events with their times, ms since 1970, the newest one last.
    pub events: Vec<(u64, Event)>,
    /// Number of all events so far.
    pub told: u64,
    /// The chosen view.
    pub tab: Tab,
    /// First line of the view.
    pub scroll: u16,
}

impl Shown {
    /// Nothing yet.
    pub fn new(prefix: &Prefix) -> Self {
        Self {
            prefix: prefix.clone(),
            absent: None,
            report: None,
            state: None,
            period: None,
            events: Vec::new(),
            told: 0,
            tab: Tab::Overview,
            scroll: 0,
        }
    }

    /// Changes the view.
    pub fn go(&mut self, tab: Tab) {
        (self.tab, self.scroll) = (tab, 0);
    }

    /// Whether the figures are those of now.
    fn is_present(&self) -> bool {
        self.absent.is_none() && self.state.is_none_or(|(_, age)| age <= STALE)
    }
}

/// Draws what is shown.
pub struct Screen<'a>(pub &'a mut Shown);

impl Screen<'_> {
    /// Draws all of it.
    pub fn draw(self, frame: &mut Frame<'_>) {
        let area = frame.area();
        let [head, tabs, view, keys] =
            Layout::vertical([Constraint::Length(1), Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)])
                .areas(area);
        frame.render_widget(self.head(), head);
        let tab = |tab: &Tab| {
            let style = if *tab == self.0.tab { CHOSEN } else { Style::new() };
            [Span::styled(format!(" {} {} ", *tab as usize + 1, tab.name()), style), Span::raw(" ")]
        };
        frame.render_widget(Line::from(Tab::ALL.iter().flat_map(tab).collect::<Vec<_>>()), tabs);
        frame.render_widget(Line::styled(KEYS, QUIET), keys);
        let mut text = self.view(view);
        if !self.0.is_present() {
            text = text.patch_style(OLD);
        }
        let most = (text.lines.len() as u16).saturating_sub(view.height);
        self.0.scroll = self.0.scroll.min(most);
        let scroll = self.0.scroll;
        let paragraph = Paragraph::new(text).scroll((scroll, 0));
        let paragraph =
            if matches!(self.0.tab, Tab::Axes | Tab::Log) { paragraph.wrap(Wrap { trim: false }) } else { paragraph };
        frame.render_widget(paragraph, view);
    }

    /// Group, whether the figures are of now, and time.
    fn head(&self) -> Line<'static> {
        let shown = &self.0;
        let (word, style) = match (&shown.absent, shown.state) {
            (Some(why), _) => (format!("NO GROUP: {why}"), BAD),
            (None, None) => ("no controller has sent anything yet".to_owned(), WARN),
            (None, Some((_, age))) if age > STALE => (format!("NO DATA for {:.1} s", age.as_secs_f64()), BAD),
            (None, Some(_)) => ("live".to_owned(), GOOD),
        };
        let mut parts =
            vec![Span::raw(format!(" {}  ", shown.prefix)), Span::styled(word, style), Span::raw("  ".to_owned())];
        if let Some((tick, _)) = shown.state {
            let time = shown.period.map(|period| format!("{:.1} s, ", tick as f64 * period.as_secs_f64()));
            parts.push(Span::raw(format!("{}tick {tick}", time.unwrap_or_default())));
        }
        Line::from(parts)
    }

    fn view(&self, area: Rect) -> Text<'static> {
        let Some(report) = &self.0.report else { return Text::raw("") };
        match self.0.tab {
            Tab::Overview => self.overview(report, area),
            Tab::Axes => axes(report),
            Tab::Latencies => latencies(report),
            Tab::Channels => channels(report),
            Tab::Log => Text::from(self.0.events.iter().rev().map(event).collect::<Vec<_>>()),
        }
    }

    fn overview(&self, report: &StatusReport, area: Rect) -> Text<'static> {
        let mut lines = vec![Line::styled(AXIS_HEADER, QUIET)];
        lines.extend(report.axes().map(|(name, axis)| axis_line(name, axis)));
        lines.push(Line::default());
        lines.push(Line::styled(STAGE_HEADER, QUIET));
        lines.extend(report.stages().map(|(name, stage)| stage_line(name, stage)));
        lines.extend(report.warnings().iter().map(|warning| Line::styled(format!(" warning: {warning}"), WARN)));
        lines.push(Line::default());
        let room = usize::from(area.height).saturating_sub(lines.len()).max(1);
        lines.extend(self.0.events.iter().rev().take(room).map(event));
        Text::from(lines)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::message::{AxisMode, ControlMode, MachineState, StageHealth, StageState, control_flag};
    use ratatui::{Terminal, backend::TestBackend};

    use super::*;
    use crate::report::status::Collected;

    fn report(axes: usize) -> StatusReport {
        let mut state = MachineState::default();
        state.header.axis_count = axes as u32;
        for (i, axis) in state.axes.iter_mut().take(axes).enumerate() {
            axis.set_name(&format!("axis-{i}"));
            axis.sample.position = 0.5;
            axis.command.mode = ControlMode::Fallback as u32;
            axis.command.operation = AxisMode::Track as u32;
            axis.command.error = -0.0123;
        }
        state.axes[1].command.flags = control_flag::STALL;
        let beat = |stage: u32| {
            let mut health = StageHealth { stage, state: StageState::Running as u32, ..StageHealth::default() };
            health.header.sent_ns = 1_000_000_000;
            Some((health, health))
        };
        StatusReport::new(&Collected {
            prefix: "demo".parse().unwrap(),
            stages: [beat(0), beat(1), beat(2), beat(3)],
            state: Some(state),
            members: Vec::new(),
            rooms: Vec::new(),
            now_ns: 1_050_000_000,
        })
    }

    fn shown(axes: usize) -> Shown {
        let event = Event {
            time_s: 1.0,
            axis: Some("axis-1".to_owned()),
            kind: "latch",
            text: "stall: the axis was driven and hardly moved".to_owned(),
            next: "look at why".to_owned(),
            is_fault: true,
            more: 0,
        };
        Shown {
            report: Some(report(axes)),
            state: Some((1234, Duration::from_millis(40))),
            period: Some(Duration::from_millis(10)),
            events: vec![(1_000, event)],
            ..Shown::new(&"demo".parse().unwrap())
        }
    }

    fn drawn(shown: &mut Shown, width: u16, height: u16) -> Vec<String> {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| Screen(shown).draw(frame)).unwrap();
        let buffer = terminal.backend().buffer();
        let row = |y: u16| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned();
        (0..height).map(row).collect()
    }

    #[test]
    fn eight_axes_and_four_stages_fit_into_80_columns_and_24_lines() {
        let lines = drawn(&mut shown(8), 80, 24);
        assert!(lines[0].contains("demo  live  12.3 s, tick 1234"), "{lines:#?}");
        assert!(lines[1].contains(" 1 overview   2 axes   3 latencies   4 channels   5 log"), "{lines:#?}");
        for i in 0..8 {
            assert!(lines[3 + i].starts_with(&format!(" axis-{i}")) && lines[3 + i].contains("-12.3 mm"), "{lines:#?}");
        }
        assert!(lines[4].contains("LATCHED") && lines[4].ends_with("stall"), "{lines:#?}");
        assert!(lines[16].starts_with(" control-proc  running   50.0 ms"), "{lines:#?}");
        assert!(lines[18].contains("axis-1: latch: stall"), "{lines:#?}");
        assert!(lines[23].contains("q: end"), "{lines:#?}");
    }

    #[test]
    fn old_figures_and_an_absent_group_are_named() {
        let mut shown = shown(2);
        shown.state = Some((1234, Duration::from_secs(3)));
        assert!(drawn(&mut shown, 80, 24)[0].contains("NO DATA for 3.0 s"));
        shown.absent = Some("the group has ended".to_owned());
        let lines = drawn(&mut shown, 80, 24);
        assert!(lines[0].contains("NO GROUP: the group has ended") && lines[3].contains("axis-0"), "{lines:#?}");
    }

    #[test]
    fn every_view_is_drawn_in_any_size_and_scrolls_to_its_end_only() {
        let mut shown = shown(8);
        for (width, height) in [(1, 1), (20, 5), (80, 24), (300, 100)] {
            for tab in Tab::ALL {
                shown.go(tab);
                shown.scroll = u16::MAX;
                drawn(&mut shown, width, height);
                assert!(shown.scroll < 100, "{tab:?} {}", shown.scroll);
            }
        }
        shown.go(Tab::Log);
        assert!(drawn(&mut shown, 40, 10).join(" ").contains("look at why"), "a long line is wrapped");
        shown.go(Tab::Log.next(1));
        assert_eq!((shown.tab, Tab::Overview.next(Tab::ALL.len() - 1)), (Tab::Overview, Tab::Log));
    }
}
