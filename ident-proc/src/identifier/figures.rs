//! What the identifier keeps for its snapshot: models, figures and fault bits. Estimators, outlier gate and training
//! keep their own state. Only the examination of the models reads from here.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    message::AxisSnapshot,
    statistics::ErrorStatistics,
};

/// The models after the last sample.
#[derive(Debug, Clone)]
pub struct Models {
    pub adaptive: Coefficients,
    pub classical: Coefficients,
    /// Part of the products' weighted norm that the separation of the adaptive model does not explain.
    pub separation_residual: f64,
    /// As it was when the models were last examined.
    pub covariance_trace: f64,
}

impl Models {
    /// Models of `structure` that say nothing.
    pub fn new(structure: Structure) -> Self {
        let zero = Coefficients::zero(structure);
        Self { adaptive: zero, classical: zero, separation_residual: 0.0, covariance_trace: 0.0 }
    }
}

/// Counters, and figures of the last updates.
#[derive(Debug, Clone)]
pub struct Figures {
    /// 1 - forgetting factor, over all updates.
    forgetting: ErrorStatistics,
    forgetting_factor: f64,
    innovation: f64,
    pub innovation_ratio: f64,
    /// y(k) minus its prediction by the adaptive and by the classical model, if sample k was learned from.
    pub innovations: Option<[f64; 2]>,
    command_low: f64,
    command_high: f64,
    updates: u64,
    pub skipped: u64,
    pub outliers: u64,
    since_update: u64,
}

impl Default for Figures {
    fn default() -> Self {
        Self {
            forgetting: ErrorStatistics::default(),
            forgetting_factor: 1.0,
            innovation: 0.0,
            innovation_ratio: 0.0,
            innovations: None,
            command_low: 0.0,
            command_high: 0.0,
            updates: 0,
            skipped: 0,
            outliers: 0,
            since_update: 0,
        }
    }
}

impl Figures {
    /// To be called first at every sample.
    pub fn begin_sample(&mut self) {
        self.since_update += 1;
        self.innovations = None;
    }

    /// A command that f and g learn from.
    pub fn take_command(&mut self, u: f64) {
        self.command_low = self.command_low.min(u);
        self.command_high = self.command_high.max(u);
    }

    /// The innovations of a sample that is learned from.
    pub fn innovate(&mut self, adaptive: f64, classical: f64) {
        self.innovation = adaptive;
        self.innovations = Some([adaptive, classical]);
    }

    /// The forgetting factor of a sample that is learned from.
    pub fn forget(&mut self, factor: f64) {
        self.forgetting_factor = factor;
        self.forgetting.push(1.0 - factor);
    }

    /// The coefficients were updated.
    pub fn count_update(&mut self) {
        self.updates += 1;
        self.since_update = 0;
    }

    /// Writes the fields of the snapshot that are kept here.
    pub fn write_to(&self, snapshot: &mut AxisSnapshot) {
        snapshot.forgetting = self.forgetting;
        snapshot.forgetting_factor = self.forgetting_factor;
        snapshot.innovation = self.innovation;
        snapshot.innovation_ratio = self.innovation_ratio;
        snapshot.command_low = self.command_low;
        snapshot.command_high = self.command_high;
        snapshot.updates = self.updates;
        snapshot.skipped = self.skipped;
        snapshot.outliers = self.outliers;
        snapshot.since_update = self.since_update;
    }
}

/// [`model_fault`](pipeline::message::model_fault) bits: those that last, and those of the sample.
#[derive(Debug, Clone)]
pub struct Faults {
    lasting: u32,
    bits: u32,
}

impl Faults {
    /// With `lasting` bits from the first sample on.
    pub fn new(lasting: u32) -> Self {
        Self { lasting, bits: lasting }
    }

    /// Clears the bits of the last sample. To be called first at every sample.
    pub fn begin_sample(&mut self) {
        self.bits = self.lasting;
    }

    /// Raises bits of this sample.
    pub fn raise(&mut self, bits: u32) {
        self.bits |= bits;
    }

    /// Puts other bits in the place of those that last.
    pub fn replace_lasting(&mut self, lasting: u32) {
        self.bits = self.bits & !self.lasting | lasting;
        self.lasting = lasting;
    }

    /// All bits after the last sample.
    pub fn bits(&self) -> u32 {
        self.bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lasting_faults_last_and_others_belong_to_one_sample() {
        let mut faults = Faults::new(1);
        faults.raise(16);
        assert_eq!(faults.bits(), 17);
        faults.replace_lasting(2);
        assert_eq!(faults.bits(), 18);
        faults.begin_sample();
        assert_eq!(faults.bits(), 2);
    }
}
