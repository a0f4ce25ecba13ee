//! The training of one axis: which samples are collected, and when offline identification takes place.

use pipeline::{hammerstein::Structure, machine::Identification};

use super::batch::{Batch, Offline};
use crate::sample::RegressorRow;

/// Part of the training, at its end, in which several estimators are compared before the training is over.
const COMPARED: u64 = 4;

/// The training of one axis. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Training {
    /// Length of the training in samples.
    length: u64,
    /// Fewest rows that offline identification needs.
    needed: u64,
    /// Samples seen, used or not.
    seen: u64,
    /// Samples with a shut valve after which the rest is left out.
    patience: Option<usize>,
    /// Samples since a command last opened the valve.
    shut: usize,
    /// Whether a command has opened the valve at all.
    opened: bool,
    /// Samples after such a command in which the axis still counts as driven.
    horizon: usize,
    /// Samples until the regressor row holds measurements only.
    contaminated: usize,
    batch: Batch,
    offline: Option<Offline>,
}

/// How far the training has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// Rows are being collected.
    Collecting,
    /// The last quarter has begun, and there are rows enough for a first model.
    LastQuarter,
    /// There are samples and rows enough.
    Complete,
}

impl Training {
    /// For rows of the structure `row`.
    pub fn new(settings: &Identification, row: Structure) -> Self {
        Self {
            length: settings.training as u64,
            needed: row.full_len() as u64,
            seen: 0,
            patience: None,
            shut: 0,
            opened: false,
            horizon: settings.horizon,
            contaminated: 0,
            batch: Batch::new(settings.structure, settings.split),
            offline: None,
        }
    }

    /// Leaves out what comes while no command has opened the valve for more than `samples`.
    pub fn wait_for_motion(&mut self, samples: usize) {
        self.patience = Some(samples);
    }

    /// Counts a sample, used or not. `opens`: the command before it opens the valve.
    pub fn count_sample(&mut self, opens: bool) {
        self.opened |= opens;
        self.shut = if opens { 0 } else { self.shut.saturating_add(1) };
        self.seen += u64::from(!self.is_waiting());
    }

    /// Whether the samples are left out until the axis is driven.
    pub fn is_waiting(&self) -> bool {
        self.patience.is_some_and(|samples| self.shut > samples)
    }

    /// Whether a command has opened the valve within the last horizon.
    pub fn is_driven(&self) -> bool {
        self.opened && self.shut <= self.horizon
    }

    /// Notes that the newest output is a prediction: the regressor rows of the next `samples` samples contain it.
    pub fn contaminate(&mut self, samples: usize) {
        self.contaminated = samples;
    }

    /// Takes in y(k) and the row of sample k. False, and the sample is not used, when the row contains a prediction in
    /// the place of a measurement.
    pub fn collect(&mut self, y: f64, row: &RegressorRow) -> bool {
        if self.contaminated > 0 {
            self.contaminated -= 1;
            return false;
        }
        self.batch.add(y, row);
        true
    }

    /// Forgets the rows so far, and returns their number. The samples count on.
    pub fn restart(&mut self) -> u64 {
        let rows = self.batch.rows();
        self.batch.restart();
        rows
    }

    /// How far the training has come.
    pub fn progress(&self) -> Progress {
        if self.seen >= self.length && self.batch.rows() >= self.needed {
            Progress::Complete
        } else if self.seen >= self.length - self.length / COMPARED && self.batch.rows() >= 2 * self.needed {
            Progress::LastQuarter
        } else {
            Progress::Collecting
        }
    }

    /// Identifies offline with the rows so far.
    pub fn solve(&mut self) -> Offline {
        self.batch.solve()
    }

    /// Identifies offline with all rows, and ends the training.
    pub fn finish(&mut self) -> Offline {
        let offline = self.batch.solve();
        self.offline = Some(offline);
        offline
    }

    /// Whether the training has ended.
    pub fn is_over(&self) -> bool {
        self.offline.is_some()
    }

    /// The rows collected, and the problem that offline identification has solved.
    pub fn batch(&self) -> &Batch {
        &self.batch
    }

    /// What offline identification found, after the training.
    pub fn offline(&self) -> Option<&Offline> {
        self.offline.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::SlidingBuffer;
    use pipeline::machine::Machine;

    const STRUCTURE: Structure = Structure { na: 1, nb: 0, nk: 1, order: 1, ..Structure::PAPER };

    #[test]
    fn it_ends_with_samples_and_rows_enough_and_leaves_contaminated_rows_out() {
        let mut settings = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
        (settings.structure, settings.training) = (STRUCTURE, 40);
        let mut training = Training::new(&settings, STRUCTURE);
        let (mut outputs, mut commands) = (SlidingBuffer::new(1, 1), SlidingBuffer::new(1, 2));
        let mut row = RegressorRow::new(STRUCTURE);
        for k in 0..40u32 {
            training.count_sample(true);
            outputs.push(f64::from(k).sin());
            commands.push_with(|slot| STRUCTURE.input.features(f64::from(k).cos(), slot));
            row.fill(&outputs, &commands);
            if k == 10 {
                training.contaminate(3);
            }
            assert_eq!(training.collect(f64::from(k + 1).sin(), &row), !(10..13).contains(&k), "{k}");
            let expected = match k + 1 {
                40 => Progress::Complete,
                30.. => Progress::LastQuarter,
                _ => Progress::Collecting,
            };
            assert_eq!(training.progress(), expected, "{k}");
        }
        assert!(!training.is_over());
        training.finish();
        assert!(training.is_over() && training.batch().rows() == 37);
    }

    #[test]
    fn samples_without_rows_do_not_end_it() {
        let mut settings = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
        (settings.structure, settings.training) = (STRUCTURE, 40);
        let mut training = Training::new(&settings, STRUCTURE);
        (0..1000).for_each(|_| training.count_sample(true));
        assert_eq!(training.progress(), Progress::Collecting);
    }
}
