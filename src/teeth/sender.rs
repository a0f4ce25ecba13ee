//! The references of a way of the teeth.
//!
//! ```text
//! c(k + i) = plan(t + i p T)       t(k+1) = t(k) + p T
//! p        rises by T / 1 s and falls by T / 0.2 s to p_0: that of [`TipWatch`](control_proc::tip::watch::TipWatch),
//!          or 0 while an axis does not follow
//! ```
//!
//! c positions of the cylinders m, t time of the plan s, p its pace, T period s. So the teeth wait on their way for an
//! axis that waits. They begin after a second: references that are taken up are followed from a stand.

use control_proc::tip::TipPlan;
use mechanism::AXES;
use pipeline::{
    channel::{ChannelError, Publisher},
    machine::Machine,
    message::{EncoderSample, Header, MAX_PREVIEW, Reference},
    stage::monotonic_ns,
};

use super::ALL;
use crate::{failure::Failure, group::operator::Operator};

/// Time for which the references stand before they move, s: that in which a reference that is taken up gets its pace.
const STANDING: f64 = 1.2;
/// Times in which the pace rises from 0 to 1, and falls, s.
const RISE_TIME: f64 = 1.0;
const FALL_TIME: f64 = 0.2;
/// How far ahead references are sent, s, as far as a message has room, and the least number of them. Feed-forward needs
/// those of the time in which an axis reacts.
const AHEAD: f64 = 1.0;
const LEAST_AHEAD: usize = 3;

/// Sends the references of a way.
pub struct Sender {
    publisher: Publisher<Reference>,
    reference: Reference,
    /// s.
    period: f64,
    /// Time of the plan, periods; below 0 the teeth still stand.
    time: f64,
    pace: f64,
    last: Option<u64>,
}

impl Sender {
    /// Room for the references of a machine whose teeth still stand.
    ///
    /// # Errors
    /// Another program sends references.
    pub fn new(operator: &Operator, machine: &Machine) -> Result<Self, Failure> {
        let period = machine.timing.period.as_secs_f64();
        let preview = ((AHEAD / period).ceil() as usize).clamp(LEAST_AHEAD, MAX_PREVIEW) as u32;
        let header = Header { axis_count: machine.axes.len() as u32, ..Header::default() };
        let reference = Reference { header, preview, ..Reference::default() };
        let publisher = operator.publisher()?;
        Ok(Self { publisher, reference, period, time: -STANDING / period, pace: 0.0, last: None })
    }

    /// Sends the references that belong to a sample; the teeth go on at `pace` at most.
    ///
    /// # Errors
    /// The channel cannot be written.
    pub fn send(&mut self, sample: &EncoderSample, way: &[[f64; AXES]], pace: f64) -> Result<(), Failure> {
        let elapsed = sample.header.sequence.saturating_sub(self.last.unwrap_or(sample.header.sequence)) as f64;
        // While the references stand they are taken up, which shows as waiting.
        let pace = if self.time < 0.0 { 1.0 } else { pace };
        let time = elapsed * self.period;
        self.pace = pace.clamp(self.pace - time / FALL_TIME, self.pace + time / RISE_TIME).max(0.0);
        self.time = (self.time + elapsed * self.pace).min((way.len() - 1) as f64);
        self.last = Some(sample.header.sequence);
        for i in 0..self.reference.preview as usize {
            let at = at(way, self.time + i as f64 * self.pace);
            for axis in ALL {
                self.reference.positions[axis][i] = at[axis];
            }
        }
        self.reference.header.sequence = sample.header.sequence;
        self.reference.header.acquired_ns = sample.header.acquired_ns;
        self.reference.header.sent_ns = monotonic_ns();
        Ok(self.publisher.send(&self.reference).map_err(ChannelError::from)?)
    }

    /// Time of the plan, s.
    pub fn seconds(&self) -> f64 {
        self.time.max(0.0) * self.period
    }

    /// Whether the teeth should be at the end of the way.
    pub fn has_ended(&self, way: &[[f64; AXES]]) -> bool {
        self.time >= (way.len() - 1) as f64
    }
}

/// Positions of the axes at every period of a plan, m.
pub fn way_of(plan: &TipPlan) -> Vec<[f64; AXES]> {
    let points = ALL.map(|axis| plan.points(axis));
    (0..points[0].len()).map(|k| ALL.map(|axis| points[axis][k].1)).collect()
}

/// A way at a time in periods, in straight lines between its points.
fn at(way: &[[f64; AXES]], time: f64) -> [f64; AXES] {
    let time = time.clamp(0.0, (way.len() - 1) as f64);
    let (k, rest) = (time.floor() as usize, time.fract());
    let next = way[(k + 1).min(way.len() - 1)];
    std::array::from_fn(|axis| way[k][axis] + rest * (next[axis] - way[k][axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_straight_between_its_points_and_stands_beyond_its_ends() {
        let way = [[0.0; AXES], [1.0, 2.0, 0.0, -1.0]];
        for (time, expected) in [(-3.0, [0.0; AXES]), (0.5, [0.5, 1.0, 0.0, -0.5]), (7.0, way[1])] {
            assert_eq!(at(&way, time), expected);
        }
    }
}
