//! Ages of samples as histograms, in the interval log of HdrHistogram, which its tools in Java, Python and JavaScript
//! read.
//!
//! ```text
//! age = message sent - sample acquired, ns        one line for each channel and interval
//! ```
//!
//! | tag | age of the sample when |
//! |---|---|
//! | `encoder-sample` | sensor-proc has sent it |
//! | `coefficient-snapshot` | ident-proc has sent the model that it made of it |
//! | `valve-command` | control-proc has sent the command that it made of it: the latency of the loop |

use std::time::{Duration, UNIX_EPOCH};

use hdrhistogram::{
    Histogram,
    serialization::{
        V2DeflateSerializer,
        interval_log::{IntervalLogWriterBuilder, Tag},
    },
};
use pipeline::message::{CoefficientSnapshot, EncoderSample, Message, ValveCommand};

use super::file::Encoded;

/// Length of an interval, ns: a file of hours has few lines, and a slow change is seen.
const INTERVAL_NS: u64 = 60_000_000_000;
/// Upper end of the range, ns: far above any latency of a loop that still runs.
const LONGEST_NS: u64 = 100_000_000_000;
/// Significant digits.
const DIGITS: u8 = 3;
/// Channels whose messages answer a sample.
const CHANNELS: [&str; 3] = [EncoderSample::CHANNEL, CoefficientSnapshot::CHANNEL, ValveCommand::CHANNEL];

/// The ages of all samples of a file.
pub struct LatencyLog {
    text: Vec<u8>,
    /// Begin of the interval, ns since 1970; none before the first message.
    begin_ns: Option<u64>,
    /// Time of the last message, ns since 1970.
    last_ns: u64,
    histograms: [Option<Histogram<u64>>; CHANNELS.len()],
}

impl LatencyLog {
    /// Without any message.
    pub fn new() -> Self {
        let histograms = CHANNELS.map(|_| Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).ok());
        Self { text: Vec::new(), begin_ns: None, last_ns: 0, histograms }
    }

    /// Takes a message in that was read at `log_ns` since 1970.
    pub fn take(&mut self, message: &Encoded, log_ns: u64) {
        let Some(index) = CHANNELS.iter().position(|name| *name == message.channel) else { return };
        // A message that no sample has caused.
        if message.header.acquired_ns == 0 {
            return;
        }
        let begin_ns = *self.begin_ns.get_or_insert(log_ns);
        if log_ns.saturating_sub(begin_ns) >= INTERVAL_NS {
            self.end_interval();
            self.begin_ns = Some(log_ns);
        }
        self.last_ns = log_ns;
        let age_ns = message.header.sent_ns.saturating_sub(message.header.acquired_ns);
        if let Some(histogram) = &mut self.histograms[index] {
            histogram.saturating_record(age_ns);
        }
    }

    /// The log as text; none without a message.
    pub fn finish(mut self) -> Option<Vec<u8>> {
        self.begin_ns?;
        self.end_interval();
        Some(self.text)
    }

    /// Adds the lines of the interval, and begins the next one.
    fn end_interval(&mut self) {
        let Some(begin_ns) = self.begin_ns.take() else { return };
        let begin = Duration::from_nanos(begin_ns);
        let length = Duration::from_nanos(self.last_ns.saturating_sub(begin_ns));
        let mut builder = IntervalLogWriterBuilder::new();
        if self.text.is_empty() {
            builder.add_comment("age of the sample at the time of sending, ns").with_start_time(UNIX_EPOCH + begin);
        }
        let mut serializer = V2DeflateSerializer::new();
        // Writing to memory does not fail, and the format takes every histogram of these bounds.
        let Ok(mut writer) = builder.begin_log_with(&mut self.text, &mut serializer) else { return };
        for (name, histogram) in CHANNELS.iter().zip(&mut self.histograms) {
            if let Some(histogram) = histogram.as_mut().filter(|histogram| !histogram.is_empty()) {
                let _ = writer.write_histogram(histogram, begin, length, Tag::new(name));
                histogram.reset();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hdrhistogram::serialization::{
        Deserializer,
        interval_log::{IntervalLogIterator, LogEntry},
    };
    use pipeline::message::StageHealth;

    #[test]
    fn every_interval_has_a_line_for_each_channel_with_the_ages_of_its_samples() {
        let mut log = LatencyLog::new();
        for i in 0..100 {
            let mut command = ValveCommand::default();
            (command.header.acquired_ns, command.header.sent_ns) = (1000, 1000 + 10 * (i + 1));
            log.take(&Encoded::new(0, &command), 1_000_000_000 * i);
            log.take(&Encoded::new(0, &StageHealth::default()), 0);
        }
        let text = log.finish().unwrap();
        let mut intervals = Vec::new();
        for entry in IntervalLogIterator::new(&text) {
            let LogEntry::Interval(interval) = entry.unwrap() else { continue };
            assert_eq!(interval.tag().unwrap().as_str(), "valve-command");
            let bytes =
                base64::Engine::decode(&base64::engine::general_purpose::STANDARD, interval.encoded_histogram());
            let histogram: Histogram<u64> = Deserializer::new().deserialize(&mut &*bytes.unwrap()).unwrap();
            intervals.push((interval.start_timestamp().as_secs(), histogram.len(), histogram.min(), histogram.max()));
        }
        assert_eq!(intervals, [(0, 60, 10, 600), (60, 40, 610, 1000)]);
        assert!(LatencyLog::new().finish().is_none());
    }
}
