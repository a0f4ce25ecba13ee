//! Predictions over a horizon. Each is launched once and advances by one step per sample, as the commands come in.
//!
//! ```text
//! y^(k+i) = -a_1 y^(k+i-1) - ... - a_na y^(k+i-na) + C' driven(k+i)         y^(k), y^(k-1) .. as measured
//! ```
//!
//! a_i and C coefficients known at k, driven(k+i) the features of the commands in the row (14) of sample k+i, y in the
//! unit of the output. A prediction that is compared h samples later needs the commands between, which are known only
//! then. Advancing all predictions at every sample computes nothing twice, needs no old coefficients, and costs equally
//! much at every sample. The predictions lie in lanes side by side, one array for each coefficient, so that a step of
//! all of them runs in vector instructions.

/// Predictions with models of equal length. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Forecasts {
    lanes: usize,
    /// a_1 of every lane, a_2 of every lane, ..
    a: Vec<f64>,
    /// C_1 of every lane, C_2 of every lane, ..
    driven: Vec<f64>,
    /// The last na outputs of every lane as a ring. Outputs of one sample lie side by side.
    outputs: Vec<f64>,
    newest: usize,
    next: Vec<f64>,
}

impl Forecasts {
    /// Room for `lanes` predictions of models with `na` and `driven` coefficients.
    pub fn new(na: usize, driven: usize, lanes: usize) -> Self {
        Self {
            lanes,
            a: vec![0.0; na * lanes],
            driven: vec![0.0; driven * lanes],
            outputs: vec![0.0; na * lanes],
            newest: 0,
            next: vec![0.0; lanes],
        }
    }

    /// Order of A of the models.
    pub fn na(&self) -> usize {
        self.a.len() / self.lanes
    }

    /// Starts a prediction in `lane` with the coefficients `theta` from `outputs` = y(..k), na or more, oldest first.
    pub fn launch(&mut self, lane: usize, theta: &[f64], outputs: &[f64]) {
        let (na, lanes) = (self.na(), self.lanes);
        let (a, driven) = theta.split_at(na);
        for (i, (a, y)) in a.iter().zip(outputs.iter().rev()).enumerate() {
            self.a[i * lanes + lane] = *a;
            self.outputs[(self.newest + i) % na * lanes + lane] = *y;
        }
        for (all, coefficient) in self.driven.chunks_exact_mut(lanes).zip(driven) {
            all[lane] = *coefficient;
        }
    }

    /// Advances all predictions by one step, to the sample whose row has the commands' features `driven`.
    pub fn advance(&mut self, driven: &[f64]) {
        let (na, lanes) = (self.na(), self.lanes);
        self.next.fill(0.0);
        for (i, a) in self.a.chunks_exact(lanes).enumerate() {
            let at = (self.newest + i) % na * lanes;
            for ((next, a), y) in self.next.iter_mut().zip(a).zip(&self.outputs[at..at + lanes]) {
                *next -= a * y;
            }
        }
        for (coefficients, value) in self.driven.chunks_exact(lanes).zip(driven) {
            // The features of the sign that the command does not have are zero: half of them.
            if *value != 0.0 {
                self.next.iter_mut().zip(coefficients).for_each(|(next, coefficient)| *next += coefficient * value);
            }
        }
        self.newest = (self.newest + na - 1) % na;
        self.outputs[self.newest * lanes..(self.newest + 1) * lanes].copy_from_slice(&self.next);
    }

    /// The prediction in `lane` of the sample that it has advanced to.
    pub fn predicted(&self, lane: usize) -> f64 {
        self.outputs[self.newest * self.lanes + lane]
    }
}
