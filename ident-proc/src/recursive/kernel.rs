//! The loops of one update. Each runs over blocks of a fixed length, which the compiler turns into vector instructions.
//!
//! Symbols as in [`super`]. Trap: the order of the operations is part of the result; a change of it changes the last
//! bits of every coefficient.

use std::array::from_fn;

use super::{Block, Change, LANES};

/// phi' theta. Copies phi into blocks.
#[inline(always)]
pub(super) fn predict(theta: &[Block], phi: &[f64], copy: &mut [Block]) -> f64 {
    let (whole, rest) = phi.as_chunks::<LANES>();
    let mut parts = [0.0; LANES];
    for ((phi, theta), copy) in whole.iter().zip(theta).zip(copy.iter_mut()) {
        *copy = *phi;
        parts = from_fn(|i| parts[i] + phi[i] * theta[i]);
    }
    if let (Some(theta), Some(copy)) = (theta.get(whole.len()), copy.get_mut(whole.len())) {
        for (i, phi) in rest.iter().enumerate() {
            copy[i] = *phi;
            parts[i] += phi * theta[i];
        }
    }
    sum(parts)
}

/// f = U' phi.
#[inline(always)]
pub(super) fn project(mut tiles: &[[Block; LANES]], phi: &[Block], f: &mut [Block]) {
    for (t, f) in f.iter_mut().enumerate() {
        let (column, right) = tiles.split_at(t + 1);
        tiles = right;
        let mut parts = [[0.0; LANES]; LANES];
        for (u, phi) in column.iter().zip(phi) {
            for j in 0..LANES {
                parts[j] = from_fn(|i| parts[j][i] + u[j][i] * phi[i]);
            }
        }
        *f = parts.map(sum);
    }
}

/// phi' P phi = f' D f.
#[inline(always)]
pub(super) fn leverage(d: &[Block], f: &[Block]) -> f64 {
    sum(d.iter().zip(f).fold([0.0; LANES], |total, (d, f)| from_fn(|i| total[i] + d[i] * f[i] * f[i])))
}

/// v = D f, mu_j = -f_j / beta_(j-1), and the new D between its bounds. beta_j = variance + sum of f_i v_i, i <= j.
///
/// Returns whether D was cut from above, and 1 / beta of the last column. A division takes as long as ten additions, so
/// there is only one per column, and two columns are divided at once.
#[inline(always)]
pub(super) fn divide(
    d: &mut [Block],
    (d_floor, d_limit): (&[Block], &[Block]),
    f: &[Block],
    change: &Change,
    v: &mut [Block],
    mu: &mut [Block],
) -> (bool, f64) {
    let (mut bounded, mut beta, mut per_beta) = (false, change.variance, 1.0 / change.variance);
    let bounds = pairs(d_floor).iter().zip(pairs(d_limit));
    let columns = pairs_mut(d).iter_mut().zip(bounds).zip(pairs(f));
    for (((d, (floor, limit)), f), (v, mu)) in columns.zip(pairs_mut(v).iter_mut().zip(pairs_mut(mu))) {
        *v = [d[0] * f[0], d[1] * f[1]];
        let [first, second] = [f[0] * v[0], f[1] * v[1]];
        let next = [beta + first, beta + (first + second)];
        let per_next = next.map(|beta| 1.0 / beta);
        *mu = [-f[0] * per_beta, -f[1] * per_next[0]];
        let free = [d[0] * beta * (per_next[0] * change.growth), d[1] * next[0] * (per_next[1] * change.growth)];
        bounded |= (free[0] > limit[0]) | (free[1] > limit[1]);
        let below: [f64; 2] = from_fn(|j| if free[j] > limit[j] { limit[j] } else { free[j] });
        *d = from_fn(|j| if below[j] < floor[j] { floor[j] } else { below[j] });
        (beta, per_beta) = (next[1], per_next[1]);
    }
    (bounded, per_beta)
}

/// The new U, u_ij + gain_i mu_j. The gain is zero at first and grows by one entry per column.
#[inline(always)]
pub(super) fn spread(mut tiles: &mut [[Block; LANES]], v: &[Block], mu: &[Block], gain: &mut [Block]) {
    for (t, (&v, &mu)) in v.iter().zip(mu).enumerate() {
        let (column, right) = tiles.split_at_mut(t + 1);
        tiles = right;
        for (u, gain) in column.iter_mut().zip(gain.iter_mut()) {
            let mut g = *gain;
            for j in 0..LANES {
                let old = u[j];
                u[j] = from_fn(|i| old[i] + g[i] * mu[j]);
                g = from_fn(|i| g[i] + old[i] * v[j]);
            }
            *gain = g;
        }
    }
}

fn sum(parts: Block) -> f64 {
    (parts[0] + parts[2]) + (parts[1] + parts[3])
}

fn pairs(blocks: &[Block]) -> &[[f64; 2]] {
    blocks.as_flattened().as_chunks().0
}

fn pairs_mut(blocks: &mut [Block]) -> &mut [[f64; 2]] {
    blocks.as_flattened_mut().as_chunks_mut().0
}
