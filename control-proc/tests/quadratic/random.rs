//! Quadratic programmes of no machine: any condition, degenerate, infeasible.

use control_proc::predictive::quadratic::Problem;
use rand_pcg::Pcg64;

use super::axis::uniform;

fn vector<const N: usize>(random: &mut Pcg64) -> [f64; N] {
    std::array::from_fn(|_| uniform(random, -1.0, 1.0))
}

pub fn dot<const N: usize>(one: &[f64; N], two: &[f64; N]) -> f64 {
    one.iter().zip(two).map(|(one, two)| one * two).sum()
}

/// Symmetric, with eigenvalues from 1 to 1 / condition: a diagonal between reflections.
pub fn hessian<const N: usize>(random: &mut Pcg64, condition: f64) -> [[f64; N]; N] {
    let mut h = [[0.0; N]; N];
    for (i, row) in h.iter_mut().enumerate() {
        row[i] = condition.powf(-(i as f64) / (N.max(2) - 1) as f64);
    }
    for _ in 0..3 {
        let v: [f64; N] = vector(random);
        let scale = 2.0 / dot(&v, &v);
        // H - v w' - w v' with w = scale Hv - scale^2 (v'Hv) v / 2.
        let hv: [f64; N] = std::array::from_fn(|i| scale * dot(&h[i], &v));
        let half = scale * dot(&hv, &v) / 2.0;
        let w: [f64; N] = std::array::from_fn(|i| hv[i] - half * v[i]);
        for i in 0..N {
            for k in 0..N {
                h[i][k] -= v[i] * w[k] + w[i] * v[k];
            }
        }
    }
    h
}

/// Dense, of a condition from 1 to 1e10, with dense rows and a minimum up to a million times out of bounds.
pub fn dense<const N: usize, const M: usize>(random: &mut Pcg64) -> Problem<N, M> {
    let condition = 10f64.powf(uniform(random, 0.0, 10.0));
    let far = 10f64.powf(uniform(random, -1.0, 6.0));
    let mut problem = Problem::new(hessian(random, condition), vector::<N>(random).map(|g| far * g));
    let inside: [f64; N] = vector(random);
    for (i, inside) in inside.iter().enumerate() {
        let (below, above) = (uniform(random, -1.0, 1.0), uniform(random, -1.0, 1.0));
        // A third of the sides without a limit.
        problem.lower[i] = if below < -0.33 { f64::NEG_INFINITY } else { inside - below.max(0.0) };
        problem.upper[i] = if above < -0.33 { f64::INFINITY } else { inside + above.max(0.0) };
    }
    for k in 0..M {
        problem.rows[k] = vector(random);
        let value = dot(&problem.rows[k], &inside);
        problem.row_lower[k] = value - uniform(random, 0.0, 1.0);
        problem.row_upper[k] = if k % 3 == 0 { f64::INFINITY } else { value + uniform(random, 0.0, 1.0) };
    }
    problem
}

/// Rows that repeat, add up, say nothing or are equalities, and bounds that leave no room: all met at one point at
/// least, at which many of them are met with equality.
pub fn degenerate<const N: usize, const M: usize>(random: &mut Pcg64) -> Problem<N, M> {
    let mut problem = dense::<N, M>(random);
    let whole = |random: &mut Pcg64| uniform(random, -3.0, 4.0).floor();
    let point: [f64; N] = std::array::from_fn(|_| whole(random));
    for (i, point) in point.iter().enumerate() {
        let kind = uniform(random, 0.0, 4.0) as usize;
        problem.lower[i] = point - [0.0, 0.0, 1.0, f64::INFINITY][kind];
        problem.upper[i] = point + [0.0, 1.0, 0.0, 1.0][kind];
    }
    for k in 0..M {
        let (one, two) = if k < 2 { (0, 0) } else { (whole(random).abs() as usize % k, k - 1) };
        problem.rows[k] = match uniform(random, 0.0, 6.0) as usize {
            0 if k > 0 => problem.rows[one],
            1 if k > 0 => std::array::from_fn(|i| problem.rows[one][i] - 2.0 * problem.rows[two][i]),
            2 => [0.0; N],
            3 => std::array::from_fn(|i| if i == k % N { -1.0 } else { 0.0 }),
            _ => std::array::from_fn(|_| whole(random)),
        };
        let value = dot(&problem.rows[k], &point);
        let kind = uniform(random, 0.0, 3.0) as usize;
        problem.row_lower[k] = value - [0.0, 0.0, 1.0][kind];
        problem.row_upper[k] = value + [0.0, 2.0, 0.0][kind];
    }
    problem
}

/// The last row asks for more than the others leave, by a tenth or more of it. Needs three rows.
pub fn infeasible<const N: usize, const M: usize>(random: &mut Pcg64) -> Problem<N, M> {
    let mut problem = dense::<N, M>(random);
    let (one, two) = (uniform(random, 0.1, 2.0), uniform(random, 0.1, 2.0));
    let [first, second] = [problem.rows[0], problem.rows[1]];
    let last = M - 1;
    problem.rows[last] = std::array::from_fn(|i| one * first[i] + two * second[i]);
    let least = one * problem.row_lower[0] + two * problem.row_lower[1];
    let size = (one * problem.row_lower[0]).abs() + (two * problem.row_lower[1]).abs();
    problem.row_lower[last] = f64::NEG_INFINITY;
    problem.row_upper[last] = least - size * uniform(random, 0.1, 2.0);
    problem
}
