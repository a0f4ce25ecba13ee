//! Quadratic programmes as a constrained predictive controller has them: one axis in closed loop.
//!
//! ```text
//! J = sum (w - y)^2 + weight * sum dx^2        y = free + G dx        dx = D x - e_1 x(k-1)
//! ```
//!
//! The variables are x(k) .. x(k+N-1); bounded are x, then as rows dx, then the predicted y where there are rows left.

use control_proc::{
    model::response::{free_response, step_response},
    predictive::quadratic::Problem,
};
use pipeline::hammerstein::{Coefficients, Structure};
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

/// Uniform from `low` to `high`.
pub fn uniform(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A model, its state, and what it is to follow.
pub struct Axis {
    pub random: Pcg64,
    nominal: Coefficients,
    model: Coefficients,
    /// Of y, the unit of everything here: m, or what Table 2 has.
    reach: f64,
    bounds: (f64, f64),
    rate: f64,
    weight: f64,
    /// y(k), y(k-1), ..
    outputs: [f64; 8],
    /// x(k-1), x(k-2), ..
    inputs: [f64; 8],
    /// Offset, slope, amplitude and frequency of the reference.
    reference: [f64; 4],
    left: u32,
    tick: f64,
}

impl Axis {
    fn new(seed: u64, model: Coefficients, reach: f64, bounds: (f64, f64), rate: f64, weight: f64) -> Self {
        let (outputs, inputs) = ([0.0; 8], [0.0; 8]);
        let random = Pcg64::seed_from_u64(seed);
        let nominal = model;
        let (reference, left, tick) = ([0.0; 4], 0, 0.0);
        Self { random, nominal, model, reach, bounds, rate, weight, outputs, inputs, reference, left, tick }
    }

    /// The model of the paper's Table 2.
    pub fn table_2(seed: u64) -> Self {
        Self::new(seed, Coefficients::TABLE_2, 120.0, (-3.0, 5.0), 0.15, 2.0)
    }

    /// A valve and a cylinder: an integrator behind one or two stable poles, up to 10 mm per sample at full command.
    pub fn integrating(seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut between = |low, high| uniform(&mut random, low, high);
        let (p, q) = (between(0.3, 0.95), if seed.is_multiple_of(2) { 0.0 } else { between(-0.3, 0.7) });
        let (na, nb) = (if q == 0.0 { 2 } else { 3 }, (seed / 2 % 2) as usize);
        let mut model = Coefficients::zero(Structure { na, nb, nk: 1, order: 1, ..Structure::PAPER });
        // (1 - z^-1)(1 - p z^-1)(1 - q z^-1)
        model.a[..3].copy_from_slice(&[-1.0 - p - q, p + q + p * q, -p * q]);
        let speed = between(0.001, 0.01) * (1.0 - p) * (1.0 - q);
        let first = if nb == 1 { between(0.3, 1.0) } else { 1.0 };
        model.b[..2].copy_from_slice(&[first * speed, (1.0 - first) * speed]);
        let weight = 10f64.powf(between(-3.0, 0.0));
        let mut step = [0.0; 20];
        step_response(&model, &mut step);
        let mean_square = step.iter().map(|s| s * s).sum::<f64>() / 20.0;
        Self::new(seed, model, 0.5, (-1.0, 1.0), between(0.02, 0.3), weight * mean_square)
    }

    /// Another model near the nominal one, as an identifier brings every sample.
    pub fn vary(&mut self) {
        let Self { random, nominal, model, .. } = self;
        *model = *nominal;
        // An integrator stays one: it is A' in A = (1 - z^-1) A' that varies.
        let change = uniform(random, -0.002, 0.002);
        model.a[0] += change;
        model.a[1] -= change;
        model.b.iter_mut().for_each(|b| *b *= uniform(random, 0.9, 1.1));
    }

    /// The programme of this sample.
    pub fn problem<const N: usize, const M: usize>(&mut self) -> Problem<N, M> {
        if self.left == 0 {
            self.left = uniform(&mut self.random, 40.0, 120.0) as u32;
            let kind = uniform(&mut self.random, 0.0, 3.0) as usize;
            self.reference = [uniform(&mut self.random, -self.reach, self.reach), 0.0, 0.0, 0.0];
            if kind > 0 {
                self.reference[kind] = uniform(&mut self.random, -0.02, 0.02) * self.reach * [0.0, 1.0, 40.0][kind];
            }
            self.reference[3] = uniform(&mut self.random, 0.02, 0.3);
            self.tick = 0.0;
        }
        self.left -= 1;
        self.tick += 1.0;
        let (mut free, mut step) = ([0.0; N], [0.0; N]);
        free_response(&self.model, &self.outputs, &self.inputs, &[], &mut free);
        step_response(&self.model, &mut step);
        // Of x itself, not of its change.
        let impulse = |p: usize, m: usize| match p.checked_sub(m) {
            None => 0.0,
            Some(0) => step[0],
            Some(ago) => step[ago] - step[ago - 1],
        };
        let last = self.inputs[0];
        let (mut hessian, mut gradient) = ([[0.0; N]; N], [0.0; N]);
        // `free` is with x held; `rest` with x = 0 from now on.
        let rest: [f64; N] = std::array::from_fn(|p| free[p] - step[p] * last);
        let [offset, slope, amplitude, frequency] = self.reference;
        for m in 0..N {
            for (p, rest) in rest.iter().enumerate() {
                let k = self.tick + p as f64;
                gradient[m] -= impulse(p, m) * (offset + slope * k + amplitude * (frequency * k).sin() - rest);
            }
            for (n, h) in hessian[m].iter_mut().enumerate().skip(m) {
                *h = (n..N).map(|p| impulse(p, m) * impulse(p, n)).sum();
            }
            hessian[m][m] += self.weight * if m + 1 < N { 2.0 } else { 1.0 };
            if m + 1 < N {
                hessian[m][m + 1] -= self.weight;
            }
        }
        gradient[0] -= self.weight * last;
        let mut problem = Problem::new(hessian, gradient);
        problem.lower = [self.bounds.0; N];
        problem.upper = [self.bounds.1; N];
        for m in 0..N.min(M) {
            let held = if m == 0 { last } else { 0.0 };
            problem.rows[m][m] = 1.0;
            if m > 0 {
                problem.rows[m][m - 1] = -1.0;
            }
            (problem.row_lower[m], problem.row_upper[m]) = (held - self.rate, held + self.rate);
        }
        for k in N..(2 * N).min(M) {
            let p = k - N;
            (0..=p).for_each(|m| problem.rows[k][m] = impulse(p, m));
            (problem.row_lower[k], problem.row_upper[k]) = (-self.reach - rest[p], self.reach - rest[p]);
        }
        problem
    }

    /// The next sample, after x(k) has been sent.
    pub fn advance(&mut self, x: f64) {
        let (mut free, mut step) = ([0.0], [0.0]);
        free_response(&self.model, &self.outputs, &self.inputs, &[], &mut free);
        step_response(&self.model, &mut step);
        let x = x.clamp(self.bounds.0, self.bounds.1);
        let noise = 1e-4 * self.reach * uniform(&mut self.random, -1.0, 1.0);
        self.outputs.rotate_right(1);
        self.outputs[0] = free[0] + step[0] * (x - self.inputs[0]) + noise;
        self.inputs.rotate_right(1);
        self.inputs[0] = x;
    }
}
