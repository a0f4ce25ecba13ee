//! h-step forecasts of all members, and the scores that their errors give.
//!
//! Every `stride` samples a forecast of each member is launched; h samples later, h horizon, it is compared with the
//! measured output. So a few forecasts of each member are on their way at any time.

use pipeline::hammerstein::Structure;

use super::scores::Scores;
use crate::{quality::Forecasts, sample::SlidingBuffer};

/// Forecasts of each member on their way at any time. Errors of forecasts any closer together are nearly equal.
const FORECASTS: usize = 4;

/// The forecasts and scores of all members. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Competition {
    na: usize,
    scores: Scores,
    /// Lane `member * slots + slot`.
    forecasts: Forecasts,
    /// Samples between two launches.
    stride: usize,
    /// Samples until the next launch.
    until_launch: usize,
    /// Forecasts of each member that fit into the horizon.
    slots: usize,
    /// The slot of the forecasts that were launched longest ago.
    slot: usize,
    /// Forecasts of each member on their way, up to `slots`.
    launched: usize,
}

impl Competition {
    /// For `members` models written out for the row of the structure `row`, and a horizon in samples.
    pub fn new(row: Structure, members: usize, horizon: usize) -> Self {
        let stride = horizon.div_ceil(FORECASTS);
        let slots = horizon.div_ceil(stride);
        Self {
            na: row.na,
            scores: Scores::new(members, stride, horizon),
            forecasts: Forecasts::new(row.na, row.full_len() - row.na, members * slots),
            stride,
            until_launch: 0,
            slots,
            slot: 0,
            launched: 0,
        }
    }

    /// Advances all forecasts to the sample whose row has the commands' features `driven`.
    pub fn advance(&mut self, driven: &[f64]) {
        self.forecasts.advance(driven);
    }

    /// Scores the forecasts that were launched a horizon ago, if there are any, by y(k).
    pub fn score(&mut self, y: f64) {
        if self.until_launch == 0 && self.launched == self.slots {
            let (forecasts, slots, slot) = (&self.forecasts, self.slots, self.slot);
            self.scores.push(|member| y - forecasts.predicted(member * slots + slot));
        }
    }

    /// Whether forecasts are to be launched at this sample.
    pub fn is_due(&self) -> bool {
        self.until_launch == 0
    }

    /// Launches a forecast of every member from `outputs` = y(..k). With fewer than na of them none is launched.
    pub fn launch(&mut self, members: &[Vec<f64>], outputs: &SlidingBuffer) {
        self.until_launch = self.stride;
        if outputs.len() >= self.na {
            for (member, theta) in members.iter().enumerate() {
                self.forecasts.launch(member * self.slots + self.slot, theta, outputs.latest(self.na));
            }
            self.slot = (self.slot + 1) % self.slots;
            self.launched = (self.launched + 1).min(self.slots);
        }
    }

    /// Ends the sample, after [`Self::launch`] if that was due.
    pub fn finish_sample(&mut self) {
        self.until_launch -= 1;
    }

    /// Discards the forecasts on their way, after a gap in the samples. The scores stay.
    pub fn interrupt(&mut self) {
        self.launched = 0;
    }

    /// Begins to score, with the usual travel over the horizon in the unit of the output.
    pub fn start(&mut self, travel: f64) {
        self.scores.start(travel);
    }

    /// The scores of all members.
    pub fn scores(&self) -> &Scores {
        &self.scores
    }
}
