//! How far the coefficients would scatter over repeated records.
//!
//! ```text
//! linear:     sigma_i = s sqrt([(R'R)^-1]_ii)                    s^2 = residual / (N - d)
//! separated:  sigma_i = s sqrt([(J'R'R J)^-1]_ii)                s^2 = (residual + |R theta(p) - z|^2) / (N - d)
//!             J = d theta / d p,   p = (a, b, f_2 .. f_r, g, rest),   theta = (a, f_i b_j, g_i b_j, rest)   (14)
//! ```
//!
//! R, z and residual: triangle of the data; N rows, d number of coefficients that they determine, s standard deviation
//! of the noise in the unit of the output. The inverse of J'R'R J is never formed: R J is reduced to a triangle of its
//! own, and the squares of a row of the inverse of that are summed.
//!
//! Unknowns of the triangle after those of the full form, a constant drift for example, are the `rest`. They are linear
//! and belong to no product.
//!
//! b and N share a factor, which one coefficient of N fixes: f_1 = 1, or the largest where f_1 is nearly zero (see
//! [`crate::separation`]). This coefficient has the deviation 0 by definition, and all others hold for that choice.
//!
//! `None` stands for a coefficient that the data do not determine: one that is held, one of a branch without a command
//! of its sign, f and g where b is zero, several of f that stand in for each other. The deviations of the others assume
//! that these are right.
//!
//! Traps:
//! - The noise must be white (see [`super::whiteness`]). Otherwise the estimates are biased, and not only scattered.
//! - The separated deviations are those of the alternation; (17) scatters more.
//! - Where b is not far greater than its own deviation, f and g are quotients by a number that may be zero; a wide dead
//!   band leaves so little of f_1 b. Then f and g have no standard deviation, and the computed one may be right or a
//!   thousand times too large. Those of a and b hold.
//! - The residual of a triangle made by [`Triangle::add_mapped`] is that of the mapped problem; so [`linear`] asks for
//!   the variance.
//!
//! Source: Ljung, System Identification, 2nd ed. 1999, chapter 9.

use pipeline::hammerstein::{Coefficients, Structure};

use crate::{least_squares::RankGuard, least_squares::Triangle};

/// Part of its column from which on a coefficient belongs to a dependence.
const TAKES_PART: f64 = 1e-6;

/// Standard deviations of a separated model, each in the unit of its coefficient.
#[derive(Debug, Clone, PartialEq)]
pub struct SeparatedDeviations {
    /// Of a_1 .. a_na.
    pub a: Vec<Option<f64>>,
    /// Of b_0 .. b_nb.
    pub b: Vec<Option<f64>>,
    /// Of f_1 .. f_r.
    pub f: Vec<Option<f64>>,
    /// Of g_1 .. g_r.
    pub g: Vec<Option<f64>>,
    /// Of the unknowns after those of the full form.
    pub rest: Vec<Option<f64>>,
    /// s, standard deviation of the noise.
    pub noise: f64,
    /// d, number of coefficients that the data determine.
    pub determined: usize,
}

/// s^2, or `None` when there are not more rows than coefficients.
pub fn noise_variance(residual: f64, rows: u64, coefficients: usize) -> Option<f64> {
    let freedom = rows.saturating_sub(coefficients as u64);
    (freedom > 0).then(|| residual / freedom as f64)
}

/// Deviations of theta of the linear problem `data`, the triangle that theta solves, with the unknowns that are `held`
/// there and the noise variance s^2.
pub fn linear(data: &Triangle, held: &[bool], variance: f64) -> Vec<Option<f64>> {
    let lengths = inverse_rows(data, held);
    let deviation = |(length, held): (&f64, &bool)| {
        let sigma = variance.sqrt() * length;
        (!held && sigma.is_finite()).then_some(sigma)
    };
    lengths.iter().zip(held).map(deviation).collect()
}

/// Deviations of the separated `model`. `data` is the triangle of the full form with its rows and residual, as
/// [`crate::offline::Batch::collected`] gives it.
///
/// The model must be the one that the separation gave: a later change, to another order of A for example, is not part
/// of this triangle. `None` for a model without a valid structure, for a triangle that is too small for it, or with too
/// few rows.
pub fn separated(data: &Triangle, model: &Coefficients) -> Option<SeparatedDeviations> {
    let layout = Layout::new(model, data.len())?;
    let rows = jacobian_rows(data, &layout);
    let dependent = RankGuard::new(layout.len()).dependent(&rows).to_vec();
    let determined = dependent.iter().filter(|dependent| !**dependent).count();
    let residual = data.residual() + misfit(data, &layout.theta());
    let variance = noise_variance(residual, data.count(), determined)?;

    let mut restricted = Triangle::new(layout.len());
    rows.hold_into(&dependent, &mut restricted);
    let mut deviations = linear(&restricted, &dependent, variance);
    for (deviation, involved) in deviations.iter_mut().zip(involved(&rows, &dependent)) {
        *deviation = deviation.filter(|_| !involved);
    }
    deviations.insert(layout.fixed_at(), Some(0.0));
    let Structure { na, nb, order, .. } = layout.structure;
    let mut deviations = deviations.into_iter();
    let mut take = |count| deviations.by_ref().take(count).collect::<Vec<_>>();
    let (a, b, f, g) = (take(na), take(nb + 1), take(order), take(order));
    Some(SeparatedDeviations { a, b, f, g, rest: take(usize::MAX), noise: variance.sqrt(), determined })
}

/// The positions of the separated model's coefficients among its free parameters.
struct Layout<'a> {
    model: &'a Coefficients,
    structure: Structure,
    /// Index of the coefficient of N, of f and then g, that fixes the scale.
    fixed: usize,
    rest: usize,
}

impl<'a> Layout<'a> {
    fn new(model: &'a Coefficients, unknowns: usize) -> Option<Self> {
        let structure = model.structure()?;
        let Structure { na, nb, order, .. } = structure;
        let rest = unknowns.checked_sub(na + 2 * order * (nb + 1))?;
        let mut layout = Self { model, structure, fixed: 0, rest };
        // The separation makes f_1 exactly 1, or else the largest 1 in magnitude.
        if model.f[0] != 1.0 {
            let size = |power: usize| layout.power(power).abs();
            layout.fixed = (1..2 * order).fold(0, |best, i| if size(i) > size(best) { i } else { best });
        }
        Some(layout)
    }

    /// Number of free parameters; one coefficient of N is not free.
    fn len(&self) -> usize {
        let Structure { na, nb, order, .. } = self.structure;
        na + nb + 2 * order + self.rest
    }

    /// f_1 .. f_r, g_1 .. g_r.
    fn power(&self, index: usize) -> f64 {
        let r = self.structure.order;
        if index < r { self.model.f[index] } else { self.model.g[index - r] }
    }

    /// The position that the fixed coefficient would have among the parameters.
    fn fixed_at(&self) -> usize {
        self.structure.na + self.structure.nb + 1 + self.fixed
    }

    /// theta(p) without the rest.
    fn theta(&self) -> Vec<f64> {
        let products = |power| self.model.b().iter().map(move |b| self.power(power) * b);
        self.model.a().iter().copied().chain((0..2 * self.structure.order).flat_map(products)).collect()
    }

    /// A row of R as a row of R J.
    fn map(&self, row: &[f64], out: &mut [f64]) {
        let Structure { na, nb, order, .. } = self.structure;
        let lags = nb + 1;
        out[..na].copy_from_slice(&row[..na]);
        let mut next = na + lags;
        for power in 0..2 * order {
            let products = &row[na + power * lags..na + (power + 1) * lags];
            for (out, product) in out[na..na + lags].iter_mut().zip(products) {
                *out += self.power(power) * product;
            }
            if power != self.fixed {
                out[next] = products.iter().zip(self.model.b()).map(|(product, b)| product * b).sum();
                next += 1;
            }
        }
        out[next..].copy_from_slice(&row[na + 2 * order * lags..]);
    }
}

/// R J.
fn jacobian_rows(data: &Triangle, layout: &Layout) -> Triangle {
    let mut rows = Triangle::new(layout.len());
    rows.add_mapped(data, |row, target, out| {
        layout.map(row, out);
        target
    });
    rows
}

/// |R theta - z|^2 with the best rest for the `theta` before it.
fn misfit(data: &Triangle, theta: &[f64]) -> f64 {
    let (n, known) = (data.len(), theta.len());
    let mut rest = Triangle::new(n - known);
    for i in 0..n {
        let explained: f64 = (i..known).map(|j| data.entry(i, j) * theta[j]).sum();
        let row: Vec<f64> = (known..n).map(|j| if j >= i { data.entry(i, j) } else { 0.0 }).collect();
        rest.add(&row, data.entry(i, n) - explained);
    }
    rest.residual()
}

/// The length of each row of R^-1, infinite where R has no inverse. Held unknowns are left out.
fn inverse_rows(data: &Triangle, held: &[bool]) -> Vec<f64> {
    let n = data.len();
    let mut squares = vec![0.0; n];
    let mut column = vec![0.0; n];
    for j in (0..n).filter(|&j| !held[j]) {
        for i in (0..=j).rev() {
            let known: f64 = (i + 1..=j).map(|m| data.entry(i, m) * column[m]).sum();
            let unit = if i == j { 1.0 } else { 0.0 };
            column[i] = if held[i] { 0.0 } else { (unit - known) / data.entry(i, i) };
            squares[i] += column[i] * column[i];
        }
    }
    squares.into_iter().map(|square| if square.is_nan() { f64::INFINITY } else { square.sqrt() }).collect()
}

/// The dependent unknowns and all others that they depend on. Where the data determine only the sum of two unknowns,
/// neither of the two is known.
fn involved(data: &Triangle, dependent: &[bool]) -> Vec<bool> {
    let n = data.len();
    let length = |j: usize| (0..=j).map(|i| data.entry(i, j).powi(2)).sum::<f64>().sqrt();
    let mut involved = dependent.to_vec();
    let (mut problem, mut row, mut share) = (Triangle::new(n), vec![0.0; n], vec![0.0; n]);
    for j in (0..n).filter(|&j| dependent[j] && length(j) > 0.0) {
        // Express column j by the independent columns.
        problem.clear();
        for i in 0..n {
            row.fill(0.0);
            (i..n).filter(|&m| !dependent[m]).for_each(|m| row[m] = data.entry(i, m));
            problem.add(&row, if j >= i { data.entry(i, j) } else { 0.0 });
        }
        problem.solve(&mut share);
        for i in 0..n {
            involved[i] |= share[i].abs() * length(i) > TAKES_PART * length(j);
        }
    }
    involved
}

#[cfg(test)]
mod tests {
    use super::{super::noise::Noise, *};
    use crate::{sample::RegressorRow, sample::SlidingBuffer, separation::OfflineSeparation};
    use nalgebra::{DMatrix, DVector};
    use pipeline::machine::Split;

    const STRUCTURE: Structure = Structure { na: 2, order: 2, ..Structure::PAPER };
    const ROWS: usize = 400;

    fn model(f: [f64; 2], g: [f64; 2]) -> Coefficients {
        let mut model = Coefficients::zero(STRUCTURE);
        model.a[..2].copy_from_slice(&[-1.5, 0.7]);
        model.b[..2].copy_from_slice(&[0.5, 0.3]);
        model.f[..2].copy_from_slice(&f);
        model.g[..2].copy_from_slice(&g);
        model
    }

    /// The triangle of a record of `model` with white noise of the standard deviation 0.05 in (12), `offset` in every
    /// row; with `offset` a constant is its last unknown.
    fn record(model: &Coefficients, input: impl Fn(usize) -> f64, seed: u64, offset: Option<f64>) -> Triangle {
        let mut row = RegressorRow::new(STRUCTURE);
        let n = STRUCTURE.full_len();
        let mut data = Triangle::new(n + usize::from(offset.is_some()));
        let (mut outputs, mut commands) = (SlidingBuffer::new(2, 1), SlidingBuffer::new(2, 2 * STRUCTURE.order));
        (0..2).for_each(|_| outputs.push(0.0));
        let mut phi = vec![1.0; data.len()];
        let mut x = [0.0; 2];
        let mut noise = Noise::new(seed);
        for k in 0..ROWS + 2 {
            if k >= 2 {
                row.fill(&outputs, &commands);
                phi[..n].copy_from_slice(row.values());
                let newest = [outputs.latest(2)[1], outputs.latest(2)[0]];
                let y = model.predict_one(&newest, &x) + offset.unwrap_or(0.0) + 0.05 * noise.normal();
                data.add(&phi, y);
                outputs.push(y);
            }
            x = [model.nonlinearity().evaluate(input(k)), x[0]];
            commands.push_with(|slot| STRUCTURE.input.features(input(k), slot));
        }
        data
    }

    fn input(seed: u64) -> impl Fn(usize) -> f64 {
        let mut noise = Noise::new(seed);
        let values: Vec<f64> = (0..ROWS + 2).map(|_| 2.0 * noise.uniform() - 1.0).collect();
        move |k| values[k]
    }

    /// theta, the held unknowns, and the triangle with those held.
    fn solved(collected: &Triangle) -> (Vec<f64>, Vec<bool>, Triangle) {
        let mut data = Triangle::new(collected.len());
        let held = RankGuard::new(collected.len()).dependent(collected).to_vec();
        collected.hold_into(&held, &mut data);
        let mut theta = vec![0.0; data.len()];
        data.solve(&mut theta);
        (theta, held, data)
    }

    fn flat(model: &Coefficients) -> Vec<f64> {
        [model.a(), model.b(), &model.f[..2], &model.g[..2]].concat()
    }

    fn flat_deviations(found: &SeparatedDeviations) -> Vec<Option<f64>> {
        [&found.a[..], &found.b, &found.f, &found.g].concat()
    }

    /// Estimates over many records and the variances that were predicted of each.
    #[derive(Default)]
    struct Spread {
        estimates: Vec<Vec<f64>>,
        variances: Vec<Vec<f64>>,
    }

    impl Spread {
        fn add(&mut self, estimate: Vec<f64>, deviations: &[Option<f64>]) {
            self.estimates.push(estimate);
            self.variances.push(deviations.iter().map(|d| d.unwrap().powi(2)).collect());
        }

        /// Found and predicted deviation of each coefficient.
        fn compare(&self) -> Vec<(f64, f64)> {
            let trials = self.estimates.len() as f64;
            let mean = |of: &dyn Fn(usize) -> f64| (0..self.estimates.len()).map(of).sum::<f64>() / trials;
            let compare = |i: usize| {
                let center = mean(&|trial| self.estimates[trial][i]);
                let found = mean(&|trial| (self.estimates[trial][i] - center).powi(2)) * trials / (trials - 1.0);
                (found.sqrt(), mean(&|trial| self.variances[trial][i]).sqrt())
            };
            (0..self.estimates[0].len()).map(compare).collect()
        }
    }

    #[test]
    fn the_estimates_of_400_records_scatter_as_predicted() {
        let model = model([1.0, 0.6], [0.8, -0.5]);
        let (mut full, mut separated_ones) = (Spread::default(), Spread::default());
        let mut separation = OfflineSeparation::new(STRUCTURE);
        let mut noise = 0.0;
        for seed in 0..400 {
            let collected = record(&model, input(seed + 1000), seed, None);
            let (theta, held, data) = solved(&collected);
            let variance = noise_variance(data.residual(), data.count(), theta.len()).unwrap();
            full.add(theta.clone(), &linear(&data, &held, variance));
            let estimate = separation.separate(&theta, &collected, Split::Als);
            let found = separated(&collected, &estimate).unwrap();
            noise += found.noise / 400.0;
            assert_eq!(found.determined, 7);
            separated_ones.add(flat(&estimate), &flat_deviations(&found));
        }
        assert!((noise / 0.05 - 1.0).abs() < 0.01, "{noise}");
        for (i, (found, predicted)) in full.compare().into_iter().enumerate() {
            assert!((found / predicted - 1.0).abs() < 0.15, "theta {i}: {found} {predicted}");
        }
        for (i, (found, predicted)) in separated_ones.compare().into_iter().enumerate() {
            if i == 4 {
                assert_eq!((found, predicted), (0.0, 0.0), "f_1 is 1 by definition");
            } else {
                assert!((found / predicted - 1.0).abs() < 0.15, "{i}: {found} {predicted}");
            }
        }
    }

    /// J by differences and the inverse of J'R'R J, for any model, the rest among the unknowns.
    #[test]
    fn they_are_the_diagonal_of_the_inverse() {
        let at = model([1e-8, 2.0], [0.8, -0.5]);
        let data = record(&at, input(1), 1, Some(0.3));
        let n = data.len();
        let found = separated(&data, &at).unwrap();
        assert_eq!(found.f[1], Some(0.0), "the largest fixes the scale");
        let theta = |p: &[f64]| {
            let mut theta = p[..2].to_vec();
            for c in [p[4], 2.0, p[5], p[6]] {
                theta.extend([c * p[2], c * p[3]]);
            }
            theta.push(p[7]);
            DVector::from_vec(theta)
        };
        let p = [-1.5, 0.7, 0.5, 0.3, 1e-8, 0.8, -0.5, 0.3];
        let r = DMatrix::from_fn(n, n, |i, j| if j >= i { data.entry(i, j) } else { 0.0 });
        let z = DVector::from_fn(n, |i, _| data.entry(i, n));
        let mut jacobian = DMatrix::zeros(n, p.len());
        for j in 0..p.len() {
            let (mut up, mut down) = (p, p);
            (up[j], down[j]) = (p[j] + 0.5, p[j] - 0.5);
            jacobian.set_column(j, &(theta(&up) - theta(&down)));
        }
        let rj = &r * jacobian;
        let inverse = (rj.transpose() * &rj).try_inverse().unwrap();
        let expected = |i: usize| (inverse[(i, i)] * found.noise.powi(2)).sqrt();
        let order = [found.a[0], found.a[1], found.b[0], found.b[1], found.f[0], found.g[0], found.g[1], found.rest[0]];
        for (i, deviation) in order.into_iter().enumerate() {
            assert!((deviation.unwrap() / expected(i) - 1.0).abs() < 1e-8, "{i} {deviation:?} {}", expected(i));
        }
        // The constant that is best for this model is near its 0.3, so the misfit is near that of the true one.
        let residual = data.residual() + (&r * theta(&p) - z).norm_squared();
        let (low, high) = (found.noise.powi(2) * (ROWS as f64 - 8.0), residual);
        assert!(low <= high && low > 0.97 * high, "{low} {high}");
    }

    #[test]
    fn a_branch_without_commands_is_not_determined() {
        let model = model([1.0, 0.6], [0.8, -0.5]);
        let values = input(3);
        let collected = record(&model, |k| values(k).abs(), 3, None);
        let (theta, held, data) = solved(&collected);
        let estimate = OfflineSeparation::new(STRUCTURE).separate(&theta, &collected, Split::Als);
        let found = separated(&collected, &estimate).unwrap();
        assert_eq!(found.g, [None, None]);
        assert!(found.a.iter().chain(&found.b).chain(&found.f).all(|d| d.is_some_and(|d| d.is_finite())));
        assert_eq!(found.f[0], Some(0.0));
        assert_eq!(found.determined, 5);
        let variance = noise_variance(data.residual(), data.count(), 6).unwrap();
        let of_theta = linear(&data, &held, variance);
        assert!(of_theta[..6].iter().all(Option::is_some) && of_theta[6..].iter().all(Option::is_none));
    }

    #[test]
    fn a_command_that_never_moves_determines_a_alone() {
        let model = model([1.0, 0.6], [0.8, -0.5]);
        let collected = record(&model, |_| 0.0, 4, None);
        let (theta, ..) = solved(&collected);
        let estimate = OfflineSeparation::new(STRUCTURE).separate(&theta, &collected, Split::Als);
        let found = separated(&collected, &estimate).unwrap();
        assert!(found.a.iter().all(Option::is_some));
        assert_eq!((found.b, found.g, found.determined), (vec![None; 2], vec![None; 2], 2));
    }

    #[test]
    fn where_the_data_determine_only_the_sum_of_two_neither_is_known() {
        let noise = Noise::new(8).normals(100);
        let mut data = Triangle::new(3);
        noise.windows(2).for_each(|w| data.add(&[w[0], 2.0 * w[0], w[1]], w[0] - w[1]));
        let dependent = RankGuard::new(3).dependent(&data).to_vec();
        assert_eq!(involved(&data, &dependent), [true, true, false]);
    }

    #[test]
    fn too_few_rows_and_foreign_models_are_refused() {
        assert_eq!(noise_variance(1.0, 7, 7), None);
        assert_eq!(noise_variance(1.0, 9, 7), Some(0.5));
        assert_eq!(separated(&Triangle::new(10), &Coefficients::default()), None);
        let model = model([1.0, 0.6], [0.8, -0.5]);
        assert_eq!(separated(&Triangle::new(9), &model), None);
        assert_eq!(separated(&Triangle::new(10), &model), None, "no rows");
    }
}
