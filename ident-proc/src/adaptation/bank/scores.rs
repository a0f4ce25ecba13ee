//! The recent mean square error of each member of the bank, and the weight that it gives.
//!
//! ```text
//! J(k) = g J(k-1) + (1 - g) e^2(k)          g = exp(-s / tau),  tau = 30 h
//! w_i = (min J / J_i)^8 / sum_j (min J / J_j)^8
//! ```
//!
//! e h-step error of a member in the unit of the output; h horizon and s stride between two errors, in samples. The
//! weights come from h-step errors because a controller uses predictions over the horizon. J is divided by the sum of
//! the weights of its errors, so that it is an average from the first error on.
//!
//! Traps: with a shorter tau a member leads that was lucky for some seconds; with a longer one a member leads that was
//! right before the plant changed. The power of 8 leaves half a weight to a member whose root mean square is 4 % larger
//! than the best, and none to one that is half as large again. On a constant plant a gentler power gives weight to
//! members that only add noise.

/// tau, in horizons.
const TIME_CONSTANT: f64 = 30.0;
/// Largest square that counts, in mean squares of holding still or of the usual travel. Without this limit one forecast
/// that diverged would shut its member out for good.
const LARGEST_RATIO: f64 = 100.0;
/// What the mean square of holding still is multiplied by before it is compared. It is a net below models that are of
/// no use. Next to a good model it looks good in every pause, and would damp the model's prediction of the next motion.
const STILL: f64 = 2.25;
/// Mean square of the best model, in mean squares of holding still, from which on a first model knew too little.
const USELESS: f64 = 4.0;
/// Travel that the scores have to contain before they count, in parts of the usual travel of the training. Where hardly
/// anything moves, every model predicts well.
const PROOF: f64 = 0.3;
/// Members with less than this part of the best member's weight are left out: they are not worth the additions.
const LEAST_WEIGHT: f64 = 0.01;

/// The mean squares of all members. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Scores {
    /// g.
    keep: f64,
    /// Sum of the weights of all errors so far.
    seen: f64,
    sums: Vec<f64>,
    /// Usual travel over the horizon, in the unit of the output.
    travel: f64,
    /// Whether the scores contain motion enough to count.
    proven: bool,
}

impl Scores {
    /// For members whose errors over `horizon` samples come every `stride` samples.
    pub fn new(members: usize, stride: usize, horizon: usize) -> Self {
        let keep = (-(stride as f64) / (TIME_CONSTANT * horizon as f64)).exp();
        Self { keep, seen: 0.0, sums: vec![0.0; members], travel: 0.0, proven: false }
    }

    /// Takes in the errors of all members at one sample; `error(1)` is that of holding still.
    pub fn push(&mut self, error: impl Fn(usize) -> f64) {
        let still = error(1).powi(2);
        let travel = self.travel * self.travel;
        let usual = if self.seen > 0.0 { travel.max(self.sums[1] / self.seen) } else { travel };
        let limit = LARGEST_RATIO * still.max(usual);
        self.seen = self.keep * self.seen + 1.0 - self.keep;
        for (member, sum) in self.sums.iter_mut().enumerate() {
            let square = error(member).powi(2);
            // This comparison makes a square that is not a number count as the limit.
            let square = if square < limit { square } else { limit };
            *sum = self.keep * *sum + (1.0 - self.keep) * square;
        }
        self.prove();
    }

    /// Begins to count, with the usual travel over the horizon in the unit of the output. Scores so far are kept,
    /// unless holding still was far better than every model: then they are those of a first model that knew too little.
    pub fn start(&mut self, travel: f64) {
        let is_useless = |(member, sum): (usize, &f64)| member == 1 || *sum >= USELESS * self.sums[1];
        if self.sums.iter().enumerate().all(is_useless) {
            self.seen = 0.0;
            self.sums.fill(0.0);
        }
        self.travel = travel;
        self.proven = false;
        self.prove();
    }

    fn prove(&mut self) {
        // A classical model that predicts travel that does not come is proven wrong by that.
        let travel = self.sums[0].max(self.sums[1]);
        self.proven |= self.seen > 0.0 && travel >= (PROOF * self.travel).powi(2) * self.seen;
    }

    /// Whether the scores count: there were errors, and motion enough among them.
    pub fn is_proven(&self) -> bool {
        self.proven
    }

    /// Writes the weights of all members. A member that is not `allowed` gets none. Before the scores count, the first
    /// member gets all of the weight, or the second one where the first is not allowed. When no member is allowed, the
    /// second one gets it.
    pub fn weigh(&self, allowed: impl Fn(usize) -> bool, weights: &mut [f64]) {
        weights.fill(0.0);
        let members = (0..weights.len()).filter(|member| allowed(*member));
        let score = |member: usize| if member == 1 { STILL * self.sums[1] } else { self.sums[member] };
        let best = members.clone().map(score).fold(f64::INFINITY, f64::min);
        if !self.proven || !best.is_finite() {
            weights[usize::from(!allowed(0))] = 1.0;
            return;
        }
        for member in members {
            // Members without any error, as on a plant without noise, get equal weights.
            let score = score(member);
            let ratio = if score > best { best / score } else { 1.0 };
            let weight = ratio.powi(8);
            // Left out before the weights are scaled: they must sum to 1, or the mixture would scale a and the output.
            weights[member] = if weight >= LEAST_WEIGHT { weight } else { 0.0 };
        }
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= total);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(scores: &Scores, allowed: impl Fn(usize) -> bool) -> Vec<f64> {
        let mut weights = vec![0.0; 3];
        scores.weigh(allowed, &mut weights);
        weights
    }

    #[test]
    fn the_classical_model_leads_until_there_is_an_error() {
        assert_eq!(weights(&Scores::new(3, 5, 20), |_| true), [1.0, 0.0, 0.0]);
        assert_eq!(weights(&Scores::new(3, 5, 20), |member| member > 0), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn the_best_leads_and_the_others_count_by_how_much_worse_they_are() {
        let mut scores = Scores::new(3, 5, 20);
        (0..1000).for_each(|_| scores.push(|member| [1.0, 1.5, 1.1f64.powf(0.5)][member]));
        let found = weights(&scores, |_| true);
        // Holding still counts as half as bad again as it is, and has less than a hundredth of the best weight.
        let shares = [1.0, 0.0, 1.1f64.powi(-8)];
        let total: f64 = shares.iter().sum();
        for (found, share) in found.iter().zip(shares) {
            assert!((found - share / total).abs() < 1e-12);
        }
        assert_eq!(weights(&scores, |member| member == 2), [0.0, 0.0, 1.0]);
        assert_eq!(weights(&scores, |_| false), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn scores_without_motion_do_not_count() {
        let mut scores = Scores::new(3, 5, 20);
        scores.start(1.0);
        (0..100).for_each(|_| scores.push(|member| [1e-3, 1e-5, 1e-3][member]));
        assert_eq!(weights(&scores, |_| true), [1.0, 0.0, 0.0]);
        // A first model that knew too little: its scores are forgotten when the next one starts.
        scores.start(0.0);
        assert_eq!(weights(&scores, |_| true), [1.0, 0.0, 0.0]);
        (0..100).for_each(|_| scores.push(|member| [1.0, 2.0, 0.1][member]));
        scores.start(1.0);
        assert_eq!(weights(&scores, |_| true), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn travel_that_was_predicted_and_does_not_come_counts() {
        // An axis at its end stop: the classical model predicts motion, and nothing moves.
        let mut scores = Scores::new(3, 5, 20);
        scores.start(1.0);
        (0..100).for_each(|_| scores.push(|member| [0.5, 1e-4, 0.5][member]));
        assert!(weights(&scores, |_| true)[1] > 0.99);
    }

    #[test]
    fn one_divergence_is_forgotten_in_time_and_lasting_divergence_is_not() {
        let weights = |scores: &Scores| {
            let mut weights = vec![0.0; 4];
            scores.weigh(|_| true, &mut weights);
            weights
        };
        let mut scores = Scores::new(4, 5, 20);
        (0..100).for_each(|_| scores.push(|member| [1.0, 2.0, 0.1, 0.1][member]));
        scores.push(|member| [1.0, 2.0, f64::INFINITY, f64::NAN][member]);
        assert!(weights(&scores)[0] > 0.99);
        (0..20_000).for_each(|_| scores.push(|member| [1.0, 2.0, 0.1, f64::NAN][member]));
        assert!(weights(&scores)[2] > 0.99);
    }
}
