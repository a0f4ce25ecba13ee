//! The commissioned model, its speeds and its lag adapted: few parameters, all of which mean something.
//!
//! ```text
//! p_j(k) = p_j(k-1) + (1 - alpha_j) (phi(k-nk) - p_j(k-1))       alpha_j = tau_j/(T + tau_j), one of eight lags
//! dy(k)  = T theta_j' p_j(k) + e(k)                              hence A = (1 - z^-1)(1 - alpha_j z^-1)
//! Y(k)   = rho Y(k-1) + dy(k)        P_j(k) = rho P_j(k-1) + T p_j(k)          rho = exp(-T/W)
//! S_j(k) = S_0 + L (S_j(k-1) - S_0) L + w P_j P_j'               w = (1 - rho) / (s_0^2 + (0.05 Y)^2)
//! theta_j += S_j^-1 (sum of w P_j (Y - theta_j' P_j))            L = diag sqrt(1 - (1 - exp(-T/M)) m)
//! J_j(k) = the recent mean of w (Y - theta_j' P_j)^2
//! theta, alpha/(1 - alpha)   means over the lags, weighted by 1/J_j^4
//! ```
//!
//! y position in m, phi features of the command (hinges beyond the dead band), theta speeds per unit of them in m/s, T
//! period, tau_j lag and W window in s, s_0 in m; m from 0 to 1, how much of a full measure the sample is of either
//! direction of motion; M memory, seconds of motion. What is not excited is kept, however long. S_0 is the inverse of
//! what may be expected of theta beforehand: all speeds of a direction change together, dead bands move, the curve bends a
//! little.
//!
//! Source: identification with a prior, Ljung, System Identification (1999), 7.4 and 16.4; forgetting down to a least
//! information, Kulhavy and Zarrop, Int. J. Control 58 (1993).
//!
//! Traps: a free difference equation fits closed-loop records half a second ahead with any lag from none to twice the
//! true one; noise and feedback decide which, and a controller that inverts it swings. Here the lag is one between a few,
//! and whole motions decide. In a loop that swings every estimate of the speeds is too low, which makes it swing more; so
//! they have a floor: a speed that is thought too high only makes the controller slow.

use pipeline::{
    hammerstein::{Basis, Coefficients, MAX_ORDER, Structure},
    machine::Commissioned,
};

use crate::{adaptation::Learned, dot, regression::write_out, sample::RegressorRow};

/// W, s.
const WINDOW: f64 = 0.2;
/// M, s of motion.
const MEMORY: f64 = 0.7;
/// Memory of J, in parts of M.
const JUDGED: f64 = 1.0 / 3.0;
/// The lags, in parts of the commissioned one, which counts as [`LEAST_LAG`] at least.
const LAGS: [f64; 8] = [0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0];
/// The commissioned one of them: it alone counts until there has been motion to judge by.
const NOMINAL: usize = 3;
/// Least lag, s, whose multiples are tried.
const LEAST_LAG: f64 = 0.02;
/// Part of a full measure of motion from which on the lags are judged.
const JUDGED_FROM: f64 = 0.05;
/// Error of a motion that is expected of a good model, and s_0 in parts of the top speed times W.
const EXPECTED: (f64, f64) = (0.05, 0.005);
/// J below which no lag is better than another.
const EQUAL: f64 = 1e-3;
/// What may change, as standard deviations: all speeds of a direction in parts of them, the dead band in parts of the
/// command, every slope of the curve in parts of the steepest.
const CHANGES: (f64, f64, f64) = (0.3, 0.03, 0.1);
/// Least slope of the curve's first piece, where the dead band may have grown, of its other pieces, and the greatest, in
/// parts of the commissioned ones.
const SLOPES: (f64, f64, f64) = (0.02, 0.7, 5.0);

/// Parameters of both directions.
const MOST: usize = 2 * MAX_ORDER;
type Vector = [f64; MOST];
type Matrix = [Vector; MOST];

/// The estimator of one axis.
#[derive(Debug, Clone)]
pub struct GreyBox {
    structure: Structure,
    period: f64,
    /// theta as commissioned.
    prior: Vector,
    /// S_0.
    floor: Matrix,
    /// s_0^2.
    noise: f64,
    rho: f64,
    forgetting: f64,
    lags: [Lag; LAGS.len()],
    /// The lag whose theta is solved for at this sample.
    turn: usize,
    /// Y.
    travel: f64,
    /// y(k-1), unless there is a gap.
    last: Option<f64>,
    model: Coefficients,
    theta: Vec<f64>,
}

/// What is known if this is the lag.
#[derive(Debug, Clone)]
struct Lag {
    alpha: f64,
    /// p and P.
    lagged: Vector,
    window: Vector,
    /// S, of which the lower half counts, and what theta has not yet been solved for.
    information: Matrix,
    gathered: Vector,
    theta: Vector,
    /// J times its weight.
    squares: f64,
    weight: f64,
}

impl GreyBox {
    /// Starts from `commissioned`; `structure` is what it says of the structure to identify, `period` in s.
    pub fn new(structure: Structure, commissioned: &Commissioned, period: f64) -> Self {
        let order = structure.order;
        let n = 2 * order;
        let knots = match structure.input.basis {
            Basis::Hinges(knots) => knots,
            Basis::Powers => [0.0; MAX_ORDER],
        };
        let (low, high) = structure.input.dead_band;
        let last = commissioned.openings.last().copied().unwrap_or(1.0);
        let mut prior = [0.0; MOST];
        let mut covariance = [[0.0; MOST]; MOST];
        for (first, sign, edge) in [(0, 1.0, high), (order, -1.0, low)] {
            let speed = |opening: f64| sign * commissioned.speed(sign * (edge + opening));
            let here = slopes(&knots[..order], last, speed);
            let shifted = slopes(&knots[..order], last, |opening| speed(opening - CHANGES.1));
            for i in 0..order {
                prior[first + i] = here[i];
                for j in 0..order {
                    covariance[first + i][first + j] = CHANGES.0 * CHANGES.0 * here[i] * here[j]
                        + (shifted[i] - here[i]) * (shifted[j] - here[j])
                        + if i == j { (CHANGES.2 * here.iter().sum::<f64>()).powi(2) } else { 0.0 };
                }
            }
        }
        let floor = inverse(&covariance, n);
        let top = commissioned.speed(commissioned.tested().1).max(-commissioned.speed(commissioned.tested().0));
        // Whole samples of the delay that the dead time does not fill.
        let early = (structure.nk as f64 - 1.0) * period - commissioned.dead_time;
        let lags = LAGS.map(|part| {
            let lag = (part * commissioned.time_constant.max(LEAST_LAG) - early).max(0.0);
            Lag {
                alpha: lag / (period + lag),
                lagged: [0.0; MOST],
                window: [0.0; MOST],
                information: floor,
                gathered: [0.0; MOST],
                theta: prior,
                squares: 0.0,
                weight: 0.0,
            }
        });
        let published = structure.published();
        let mut this = Self {
            structure: published,
            period,
            prior,
            floor,
            noise: (EXPECTED.1 * top * WINDOW).powi(2),
            rho: (-period / WINDOW).exp(),
            forgetting: (-period / MEMORY).exp(),
            lags,
            turn: 0,
            travel: 0.0,
            last: None,
            model: Coefficients::zero(published),
            theta: vec![0.0; published.full_len()],
        };
        this.publish();
        this
    }

    /// After a gap in the samples, or one that is not to be used.
    pub fn interrupt(&mut self) {
        (self.last, self.travel) = (None, 0.0);
    }

    /// Takes in y(k) and the row of sample k.
    pub fn learn(&mut self, y: f64, row: &RegressorRow) -> Learned {
        let n = 2 * self.structure.order;
        for (i, feature) in row.driven().iter().step_by(self.structure.nb + 1).take(n).enumerate() {
            for lag in &mut self.lags {
                lag.lagged[i] += (feature - lag.lagged[i]) * (1.0 - lag.alpha);
                lag.window[i] = self.rho * lag.window[i] + self.period * lag.lagged[i];
            }
        }
        let Some(last) = self.last.replace(y) else {
            // The way to this sample is not known: what follows begins here.
            self.lags.iter_mut().for_each(|lag| lag.window = [0.0; MOST]);
            return Learned { factor: 1.0, bounded: false };
        };
        self.travel = self.rho * self.travel + y - last;
        let expected = EXPECTED.0 * self.travel;
        let weight = (1.0 - self.rho) / (self.noise + expected * expected);
        // How much of a full measure a sample says of either direction.
        let order = self.structure.order;
        let most = (1.0 - self.rho) / (EXPECTED.0 * EXPECTED.0);
        let mut factor = 1.0f64;
        for lag in &mut self.lags {
            let said = |part: std::ops::Range<usize>| {
                // By the speeds of commissioning: an axis that is held would else say nothing of its own coming free.
                let motion = dot(&self.prior[part.clone()], &lag.window[part]);
                (weight * motion * motion / most).min(1.0)
            };
            let keep = [said(0..order), said(order..n)].map(|said| 1.0 - (1.0 - self.forgetting) * said);
            let of = |i: usize| keep[usize::from(i >= order)].sqrt();
            factor = factor.min(keep[0]).min(keep[1]);
            let error = self.travel - dot(&lag.theta[..n], &lag.window[..n]);
            for i in 0..n {
                for j in 0..=i {
                    let floor = self.floor[i][j];
                    lag.information[i][j] = floor
                        + of(i) * of(j) * (lag.information[i][j] - floor)
                        + weight * lag.window[i] * lag.window[j];
                }
                lag.gathered[i] = of(i) * lag.gathered[i] + weight * lag.window[i] * error;
            }
            let kept = (keep[0] * keep[1]).powf(1.0 / JUDGED);
            lag.squares = kept * lag.squares + (1.0 - kept) * weight * error * error;
            lag.weight = kept * lag.weight + (1.0 - kept);
        }
        self.turn = (self.turn + 1) % LAGS.len();
        for lag in &mut self.lags {
            lag.solve(n);
        }
        self.publish();
        Learned { factor, bounded: false }
    }

    fn publish(&mut self) {
        let order = self.structure.order;
        let (mut theta, mut lag, mut sum) = ([0.0; MOST], 0.0, 0.0);
        let least = self.lags.iter().map(Lag::mean).fold(f64::INFINITY, f64::min);
        for (j, this) in self.lags.iter().enumerate() {
            let weight = if this.weight < JUDGED_FROM {
                f64::from(u8::from(j == NOMINAL))
            } else {
                ((least + EQUAL) / (this.mean() + EQUAL)).powi(4)
            };
            sum += weight;
            lag += weight * this.alpha / (1.0 - this.alpha);
            theta.iter_mut().zip(&this.theta).for_each(|(mean, theta)| *mean += weight * theta);
        }
        let (lag, theta) = (lag / sum, theta.map(|theta| theta / sum));
        let alpha = lag / (1.0 + lag);
        let model = &mut self.model;
        (model.a[0], model.a[1]) = (-1.0 - alpha, alpha);
        model.b[0] = self.period * (1.0 - alpha);
        for (first, branch) in [(0, &mut model.f), (order, &mut model.g)] {
            let (mut slope, mut before, mut usual) = (0.0, 0.0, 0.0);
            for i in 0..order {
                slope += theta[first + i];
                usual += self.prior[first + i];
                let floor = if i == 0 { SLOPES.0 } else { SLOPES.1 };
                let bounded = slope.clamp(floor * usual, SLOPES.2 * usual);
                branch[i] = bounded - before;
                before = bounded;
            }
        }
        write_out(model, &self.structure, &mut self.theta);
    }

    /// The model, written out for the row.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// Trace of the covariance of theta for the lag that explains most, in units of what a good model leaves.
    pub fn covariance_trace(&self) -> f64 {
        let best = self.lags.iter().min_by(|a, b| a.mean().total_cmp(&b.mean()));
        let n = 2 * self.structure.order;
        best.map_or(0.0, |lag| inverse(&lag.information, n).iter().enumerate().map(|(i, row)| row[i]).sum())
    }

    /// The model as a, b, f, g.
    pub fn model(&self) -> Coefficients {
        self.model
    }
}

impl Lag {
    /// J.
    fn mean(&self) -> f64 {
        self.squares / self.weight.max(f64::MIN_POSITIVE)
    }

    /// theta from all that was gathered since it was last solved for.
    fn solve(&mut self, n: usize) {
        if let Some(factor) = cholesky(&self.information, n) {
            let change = solved(&factor, &self.gathered, n);
            self.theta.iter_mut().zip(&change[..n]).for_each(|(theta, change)| *theta += change);
            self.gathered = [0.0; MOST];
        }
    }
}

/// Coefficients of hinges at `knots` that meet `speed` at the knots after the first, and at `last`.
fn slopes(knots: &[f64], last: f64, speed: impl Fn(f64) -> f64) -> [f64; MAX_ORDER] {
    let mut coefficients = [0.0; MAX_ORDER];
    let (mut x, mut v, mut slope) = (knots[0], speed(knots[0]).max(0.0), 0.0);
    for i in 0..knots.len() {
        let next = knots.get(i + 1).copied().unwrap_or(last.max(knots[i] + 1e-3));
        let there = speed(next).max(0.0);
        let here = (there - v) / (next - x);
        coefficients[i] = here - slope;
        (x, v, slope) = (next, there, here);
    }
    coefficients
}

/// The lower factor of the leading n by n of a symmetric matrix, of which the lower half is read.
fn cholesky(matrix: &Matrix, n: usize) -> Option<Matrix> {
    let mut factor = [[0.0; MOST]; MOST];
    for i in 0..n {
        for j in 0..=i {
            let rest = matrix[i][j] - dot(&factor[i][..j], &factor[j][..j]);
            factor[i][j] = match i == j {
                true if rest > 0.0 => rest.sqrt(),
                true => return None,
                false => rest / factor[j][j],
            };
        }
    }
    Some(factor)
}

fn solved(factor: &Matrix, right: &Vector, n: usize) -> Vector {
    let mut x = *right;
    for i in 0..n {
        x[i] = (x[i] - dot(&factor[i][..i], &x[..i])) / factor[i][i];
    }
    for i in (0..n).rev() {
        let below: f64 = (i + 1..n).map(|j| factor[j][i] * x[j]).sum();
        x[i] = (x[i] - below) / factor[i][i];
    }
    x
}

/// The inverse of a covariance.
fn inverse(covariance: &Matrix, n: usize) -> Matrix {
    let mut inverse = [[0.0; MOST]; MOST];
    if let Some(factor) = cholesky(covariance, n) {
        for i in 0..n {
            let mut unit = [0.0; MOST];
            unit[i] = 1.0;
            inverse[i] = solved(&factor, &unit, n);
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::sample::SlidingBuffer;
    use pipeline::machine::DeadBand;

    const PERIOD: f64 = 0.01;

    fn commissioned() -> Commissioned {
        Commissioned {
            dead_time: 0.05,
            time_constant: 0.05,
            dead_band: DeadBand { extend: 0.1, retract: 0.08 },
            // Where the hinges are.
            openings: vec![0.05, 0.175, 0.5],
            speeds_extend: vec![0.02, 0.12, 0.4],
            speeds_retract: vec![0.03, 0.14, 0.5],
            fit_percent: 99.0,
        }
    }

    /// An axis that is as commissioned but for its speeds, its lag and its dead band.
    struct Axis {
        grey_box: GreyBox,
        row: RegressorRow,
        outputs: SlidingBuffer,
        commands: SlidingBuffer,
        structure: Structure,
        underway: Vec<f64>,
        spool: f64,
        y: f64,
        k: u64,
    }

    impl Axis {
        fn new() -> Self {
            let structure = commissioned().structure(Structure::PAPER, Duration::from_millis(10));
            let Structure { na, nb, nk, order, .. } = structure;
            Self {
                grey_box: GreyBox::new(structure, &commissioned(), PERIOD),
                row: RegressorRow::new(structure),
                outputs: SlidingBuffer::new(na, 1),
                commands: SlidingBuffer::new(nk + nb, 2 * order),
                structure,
                underway: vec![0.0; 5],
                spool: 0.0,
                y: 0.5,
                k: 0,
            }
        }

        /// Goes on for `seconds` with commands of this size, speeds and lag by these factors, a dead band wider by this.
        fn drive(&mut self, seconds: f64, size: f64, (speeds, slower, wider): (f64, f64, f64)) {
            for _ in 0..(seconds / PERIOD) as usize {
                let t = self.k as f64 * PERIOD;
                let u = size * ((2.0 * t).sin() + 0.7 * (5.3 * t + 1.0).sin());
                self.commands.push_with(|slot| self.structure.input.features(u, slot));
                self.underway.insert(0, u);
                let acting = self.underway.pop().unwrap();
                let lag = 0.05 * slower;
                for _ in 0..10 {
                    self.spool += (acting - self.spool) * PERIOD / 10.0 / lag;
                    let open = self.spool - self.spool.signum() * wider.min(self.spool.abs());
                    self.y += speeds * commissioned().speed(open) * PERIOD / 10.0;
                }
                self.k += 1;
                let encoder = (1e4 * self.y).round() / 1e4;
                if self.outputs.len() == self.structure.na
                    && self.commands.len() == self.structure.nk + self.structure.nb
                {
                    self.row.fill(&self.outputs, &self.commands);
                    self.grey_box.learn(encoder, &self.row);
                }
                self.outputs.push(encoder);
            }
        }

        /// Speed of the model at a command, m/s, and its lag in s.
        fn speed(&self, u: f64) -> f64 {
            self.grey_box.model().nonlinearity().evaluate(u)
        }

        fn lag(&self) -> f64 {
            let alpha = self.grey_box.model().a[1];
            PERIOD * alpha / (1.0 - alpha)
        }
    }

    fn near(found: f64, expected: f64, part: f64) -> bool {
        (found / expected - 1.0).abs() < part
    }

    #[test]
    fn it_starts_from_what_was_commissioned() {
        let axis = Axis::new();
        for u in [0.3, 0.5, -0.3, -0.5] {
            assert!(near(axis.speed(u), commissioned().speed(u), 0.06), "{u}: {}", axis.speed(u));
        }
        // One period of the delay is the one in which the command is sent: the lag makes up for nothing else.
        assert!(near(axis.lag(), 0.05, 1e-9), "{}", axis.lag());
    }

    #[test]
    fn speeds_lag_and_dead_band_are_followed() {
        for (speeds, slower, wider) in
            [(1.0, 1.0, 0.0), (1.4, 1.0, 0.0), (0.75, 1.0, 0.0), (1.0, 2.5, 0.0), (0.75, 2.5, 0.0), (1.0, 1.0, 0.04)]
        {
            let mut axis = Axis::new();
            axis.drive(6.0, 0.35, (speeds, slower, wider));
            for u in [0.35, 0.5, -0.35, -0.5] {
                let expected = speeds * commissioned().speed(u - f64::signum(u) * wider);
                // The plant's lag is before its curve, the model's behind it: that shows the more the longer it is.
                let part = if slower > 1.0 { 0.2 } else { 0.1 };
                assert!(near(axis.speed(u), expected, part), "{speeds} {slower} {wider}, {u}: {}", axis.speed(u));
            }
            assert!(near(axis.lag(), 0.05 * slower, 0.3), "{speeds} {slower} {wider}: {} s", axis.lag());
        }
    }

    #[test]
    fn what_was_learned_is_kept_at_rest_and_in_the_other_direction() {
        let mut axis = Axis::new();
        axis.drive(6.0, 0.35, (1.4, 1.0, 0.0));
        let before = (axis.speed(0.4), axis.speed(-0.4), axis.lag());
        // Inside the dead band.
        axis.drive(600.0, 0.03, (1.4, 1.0, 0.0));
        let after = (axis.speed(0.4), axis.speed(-0.4), axis.lag());
        assert!(
            near(after.0, before.0, 0.02) && near(after.1, before.1, 0.02) && near(after.2, before.2, 0.05),
            "{after:?}"
        );
    }

    #[test]
    fn whatever_comes_it_stays_finite_monotone_and_within_its_bounds() {
        let mut axis = Axis::new();
        // Nothing moves, then everything four times as fast, then a leap.
        axis.drive(5.0, 0.5, (0.0, 1.0, 0.0));
        let stuck = axis.speed(0.5);
        assert!(stuck >= 0.5 * commissioned().speed(0.5), "{stuck}: the floor of what is believed");
        axis.drive(5.0, 0.5, (4.0, 0.2, 0.0));
        axis.y += 0.3;
        axis.drive(1.0, 0.5, (1.0, 1.0, 0.0));
        axis.grey_box.interrupt();
        axis.drive(10.0, 0.5, (1.0, 1.0, 0.0));
        assert!(near(axis.speed(0.5), commissioned().speed(0.5), 0.1), "{}", axis.speed(0.5));
        let mut before = f64::NEG_INFINITY;
        for i in -20..=20 {
            let speed = axis.speed(f64::from(i) * 0.05);
            assert!(speed.is_finite() && speed >= before);
            before = speed;
        }
    }
}
