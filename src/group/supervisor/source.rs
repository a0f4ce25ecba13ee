//! Says what is wrong with the readings of an external program, and when it is well again: one line each time.
//!
//! | fault | when |
//! |---|---|
//! | none | no reading has come for [`FIRST_PATIENCE`] after the start |
//! | silent | no reading for the feedback time-out |
//! | rate | fewer than [`LEAST_RATE`] readings for a period, over [`WINDOW`] |
//! | age | a reading was acquired more than half of the feedback time-out before it was sent |
//! | axes | a reading has another number of axes than the machine |
//! | foreign | readings are about another machine |
//! | device | a device of a CAN bus is at fault: the error word of its axis says why |
//!
//! Runs in the supervisor, beside the loop. What the readings may do to the axes is decided by sensor-proc and
//! control-proc.

use std::time::{Duration, Instant};

use humantime::format_duration;
use pipeline::{
    channel::Prefix,
    machine::{Machine, Source, StageKind},
    message::{ChannelHealth, EncoderReading, EncoderValue},
};

/// Time for the first reading to come.
const FIRST_PATIENCE: Duration = Duration::from_secs(3);
/// Time over which the rate is measured; at least 20 periods.
const WINDOW: Duration = Duration::from_secs(1);
const WINDOW_PERIODS: u32 = 20;
/// Least number of readings for each period. Below it, samples have no new reading.
const LEAST_RATE: f64 = 0.9;

/// What is wrong with the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    Silent,
    Rate,
    Age,
    Axes,
    Foreign,
}

/// Watches the readings of an external program.
pub struct SourceWatch {
    group: String,
    program: String,
    period: Duration,
    timeout: Duration,
    axes: u32,
    started: Instant,
    /// When the last reading was seen.
    heard: Option<Instant>,
    window: Instant,
    /// Counts at the begin of the window.
    before: ChannelHealth,
    received: u64,
    /// Oldest reading of the window, ns.
    age_ns: u64,
    fault: Option<Fault>,
    /// Names of the axes, and the error words that were told of them; only of a CAN bus.
    devices: Vec<(String, u32)>,
}

impl SourceWatch {
    /// Of a group that runs `machine`; none where it is simulated or replayed.
    pub fn new(machine: &Machine, group: &Prefix) -> Option<Self> {
        let now = Instant::now();
        let program = machine.stage(StageKind::PlantSim).command.as_ref().map(|words| words.join(" "));
        let bus = machine.can.as_ref().filter(|_| machine.source == Source::Can);
        let program = program.or_else(|| bus.map(|bus| format!("CAN bus {}", bus.interface)));
        let devices = machine.axes.iter().filter(|_| bus.is_some()).map(|axis| (axis.name.clone(), 0));
        machine.source.is_real().then(|| Self {
            group: group.to_string(),
            program: program.unwrap_or_else(|| "a program that is started by hand".to_owned()),
            devices: devices.collect(),
            period: machine.timing.period,
            timeout: machine.timing.feedback_timeout,
            axes: machine.axes.len() as u32,
            started: now,
            heard: None,
            window: now,
            before: ChannelHealth::default(),
            received: 0,
            age_ns: 0,
            fault: None,
        })
    }

    /// The line to say now; most often none. `health` and `last` are counts and last message of the channel.
    pub fn look(&mut self, now: Instant, health: &ChannelHealth, last: Option<&EncoderReading>) -> Option<String> {
        self.hear(now, health, last);
        if let Some(line) = last.and_then(|last| self.tell_devices(last)) {
            return Some(line);
        }
        let Some(heard) = self.heard else { return self.before_first(now, health) };
        if now.saturating_duration_since(heard) > self.timeout {
            (self.window, self.before, self.age_ns) = (now, *health, 0);
            return self.tell(Some(Fault::Silent), || {
                "no reading for the feedback time-out: axes that were armed are latched".to_owned()
            });
        }
        let passed = now.saturating_duration_since(self.window);
        if passed < WINDOW.max(self.period * WINDOW_PERIODS) {
            return None;
        }
        let new = (health.received - self.before.received) as f64;
        let foreign = health.foreign - self.before.foreign;
        let (rate, wanted) = (new / passed.as_secs_f64(), 1.0 / self.period.as_secs_f64());
        let (axes, found, age_ns) = (self.axes, last.map_or(0, |last| last.header.axis_count), self.age_ns);
        let timeout = self.timeout;
        (self.window, self.before, self.age_ns) = (now, *health, 0);
        if found != axes {
            return self.tell(Some(Fault::Axes), || {
                format!("found a reading with {}; the machine has {axes}: no such reading is used", count(found))
            });
        }
        if foreign > 0 {
            return self.tell(Some(Fault::Foreign), || {
                format!(
                    "{foreign} readings not read, because they are about another machine: copy the number `machine` of \
                     a message of this group, or leave it 0"
                )
            });
        }
        if rate < LEAST_RATE * wanted {
            return self.tell(Some(Fault::Rate), || {
                format!(
                    "found {rate:.1} readings/s; timing.period asks for {wanted:.1} or more: a sample without a new \
                     reading counts as stale"
                )
            });
        }
        if u128::from(age_ns) > timeout.as_nanos() / 2 {
            let age = format_duration(Duration::from_nanos(age_ns / 1000 * 1000));
            return self.tell(Some(Fault::Age), || {
                format!(
                    "found readings that are {age} old when they are sent; timing.feedback_timeout is {}: one that is \
                     older latches the axes",
                    format_duration(timeout)
                )
            });
        }
        self.tell(None, || format!("well: {rate:.1} readings/s"))
    }

    /// Notes when a reading has come, and how old it was.
    fn hear(&mut self, now: Instant, health: &ChannelHealth, last: Option<&EncoderReading>) {
        if health.received > self.received {
            self.received = health.received;
            if self.heard.replace(now).is_none() {
                (self.window, self.before) = (now, *health);
            }
            let age_ns = last.map_or(0, |last| last.header.sent_ns.saturating_sub(last.header.acquired_ns));
            self.age_ns = self.age_ns.max(age_ns);
        }
    }

    /// The line about devices whose fault is new or over.
    fn tell_devices(&mut self, last: &EncoderReading) -> Option<String> {
        let (mut told, mut is_fault) = (Vec::new(), false);
        for ((name, word), value) in self.devices.iter_mut().zip(&last.encoders) {
            // A position that does not come once is counted on the bus; that none comes is told.
            if value.error == *word || value.error == EncoderValue::NOT_READ {
                continue;
            }
            *word = value.error;
            let fault = can::device::Fault::of(value.error);
            is_fault |= fault.is_some();
            told.push(fault.map_or_else(|| format!("axis.{name}: well"), |fault| format!("axis.{name}: {fault}")));
        }
        let weight = if is_fault { "warning: " } else { "" };
        (!told.is_empty()).then(|| format!("{weight}source ({}): {}", self.program, told.join("; ")))
    }

    fn before_first(&mut self, now: Instant, health: &ChannelHealth) -> Option<String> {
        if now.saturating_duration_since(self.started) < FIRST_PATIENCE {
            return None;
        }
        let (group, period, axes) = (self.group.clone(), format_duration(self.period), self.axes);
        let foreign = match health.foreign {
            0 => String::new(),
            count => format!("; {count} readings about another machine were not read"),
        };
        self.tell(Some(Fault::None), || {
            format!(
                "no reading yet{foreign}: it has to write channel encoder-reading of group \"{group}\" at least every \
                 {period}, with {}",
                count(axes)
            )
        })
    }

    /// The line about a fault that is new, or about its end.
    fn tell(&mut self, fault: Option<Fault>, what: impl FnOnce() -> String) -> Option<String> {
        let before = std::mem::replace(&mut self.fault, fault);
        let weight = if fault.is_some() { "warning: " } else { "" };
        (before != fault).then(|| format!("{weight}source ({}): {}", self.program, what()))
    }
}

fn count(axes: u32) -> String {
    if axes == 1 { "1 axis".to_owned() } else { format!("{axes} axes") }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(10);

    struct Bench {
        watch: SourceWatch,
        now: Instant,
        health: ChannelHealth,
        reading: EncoderReading,
    }

    impl Bench {
        fn new() -> Self {
            let settings = [("source.kind".to_owned(), "external".to_owned())];
            let machine = Machine::four_axes(&settings).unwrap();
            let watch = SourceWatch::new(&machine, &"rig".parse().unwrap()).unwrap();
            let mut reading = EncoderReading::default();
            reading.header.axis_count = 4;
            Self { now: watch.started, watch, health: ChannelHealth::default(), reading }
        }

        /// Lines over so many periods, with so many readings in each.
        fn lines(&mut self, periods: u32, readings: impl Fn(u32) -> u64) -> Vec<String> {
            (0..periods)
                .filter_map(|i| {
                    self.now += PERIOD;
                    self.health.received += readings(i);
                    self.watch.look(self.now, &self.health, Some(&self.reading))
                })
                .collect()
        }

        fn line(&mut self, periods: u32, readings: impl Fn(u32) -> u64) -> String {
            let lines = self.lines(periods, readings);
            assert_eq!(lines.len(), 1, "{lines:?}");
            lines[0].clone()
        }
    }

    #[test]
    fn a_simulated_machine_is_not_watched() {
        let machine = Machine::four_axes(&[]).unwrap();
        assert!(SourceWatch::new(&machine, &"rig".parse().unwrap()).is_none());
    }

    #[test]
    fn a_program_that_never_writes_is_named_once_with_what_is_expected_of_it() {
        let mut bench = Bench::new();
        assert!(bench.lines(299, |_| 0).is_empty());
        bench.health.foreign = 7;
        let line = bench.line(1000, |_| 0);
        for part in ["started by hand", "7 readings about another", "\"rig\" at least every 10ms, with 4 axes"] {
            assert!(line.contains(part), "{line}");
        }
        assert_eq!(bench.line(200, |_| 1), "source (a program that is started by hand): well: 100.0 readings/s");
    }

    #[test]
    fn silence_and_its_end_are_told() {
        let mut bench = Bench::new();
        assert!(bench.lines(300, |_| 1).is_empty());
        assert!(bench.line(200, |_| 0).contains("no reading for the feedback time-out"));
        assert!(bench.line(200, |_| 1).contains("well"));
    }

    #[test]
    fn a_slow_program_is_told_and_a_fast_one_is_not() {
        let mut bench = Bench::new();
        assert!(bench.lines(300, |i| u64::from(i % 20 != 0)).is_empty());
        assert!(bench.line(300, |i| u64::from(i % 2 == 0)).contains("found 50.0 readings/s"));
        assert!(bench.line(300, |_| 10).contains("well: 1000.0"));
    }

    #[test]
    fn old_readings_foreign_ones_and_those_with_other_axes_are_told() {
        let mut bench = Bench::new();
        bench.reading.header.sent_ns = 100_000_000;
        bench.reading.header.acquired_ns = 80_000_000;
        assert!(bench.line(300, |_| 1).contains("20ms old when they are sent; timing.feedback_timeout is 30ms"));
        bench.reading.header.acquired_ns = 90_000_000;
        bench.reading.header.axis_count = 3;
        assert!(bench.line(110, |_| 1).contains("found a reading with 3 axes; the machine has 4"));
        bench.reading.header.axis_count = 4;
        bench.health.foreign = 5;
        assert!(bench.line(110, |_| 1).contains("5 readings not read"));
        assert!(bench.line(110, |_| 1).contains("well"));
    }
}
