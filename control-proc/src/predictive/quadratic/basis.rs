//! The factors of the working set.
//!
//! ```text
//! J^T H J = I        J^T A = | R |        J = (J1 J2), J1 has q columns        U = R^-1
//!                            | 0 |
//! z = J2 J2^T n      direction of x in which n'x grows at least cost while the working set stays where it is
//! r = U J1^T n       what the multipliers of the working set lose meanwhile
//! ```
//!
//! H = L L^T the Hessian, A (N x q) the normals of the working set, n one that is to join it. Source: Goldfarb and
//! Idnani, Math. Programming 27 (1983), section 4. J begins as L^-T; a normal joins by a reflection of J2, which
//! has z already, and leaves by Givens rotations. Of R only its inverse is kept: the column that a normal adds to it is r,
//! which is known by then, and products with it, unlike substitution, do not wait for each other. Trap: rows of J keep
//! their length through all of this, and that length, not the machine's epsilon alone, says what of J^T n is rounding.

use std::ops::Range;

use super::Status;

/// A pivot of the factorisation below this part of its diagonal element per variable is rounding: one epsilon each.
const PIVOT: f64 = f64::EPSILON;
/// Elements that are worked on together; loops begin at a multiple of it.
const BLOCK: usize = 4;

/// J and U, both as columns.
#[derive(Debug, Clone)]
pub(super) struct Basis<const N: usize> {
    j: [[f64; N]; N],
    /// Zero below the diagonal.
    u: [[f64; N]; N],
    /// q, the size of the working set.
    len: usize,
}

impl<const N: usize> Basis<N> {
    pub(super) const fn new() -> Self {
        Self { j: [[0.0; N]; N], u: [[0.0; N]; N], len: 0 }
    }

    /// Begins with no working set, J = L^-T. Of H only its upper triangle is read.
    pub(super) fn factor(&mut self, hessian: &[[f64; N]; N]) -> Result<(), Status> {
        self.len = 0;
        // U is not needed yet: its columns hold those of L meanwhile, each by the root of its pivot, and above the
        // diagonal what means nothing.
        let (l, j) = (&mut self.u, &mut self.j);
        let (mut inverses, mut roots) = ([0.0; N], [0.0; N]);
        for i in 0..N {
            let (known, rest) = l.split_at_mut(i);
            let column = &mut rest[0];
            let (mut of_pivot, mut of_root) = ([0.0; N], [0.0; N]);
            for (k, known) in known.iter().enumerate() {
                (of_pivot[k], of_root[k]) = (-known[i] * inverses[k], -known[i] * roots[k]);
            }
            *column = hessian[i];
            add_all(column, &of_pivot, known, i..N);
            let pivot = column[i];
            if !pivot.is_finite() {
                return Err(Status::NotFinite);
            }
            if pivot <= N as f64 * PIVOT * hessian[i][i] {
                return Err(Status::NotConvex);
            }
            inverses[i] = 1.0 / pivot;
            roots[i] = inverses[i].sqrt();

            // Row i of L^-1, from those above it.
            let (known, rest) = j.split_at_mut(i);
            let column = &mut rest[0];
            *column = [0.0; N];
            add_all(column, &of_root, known, 0..i);
            column[i] = 1.0;
            column.iter_mut().for_each(|j| *j *= roots[i]);
        }
        Ok(())
    }

    /// q, the size of the working set.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Lengths of the rows of J: square roots of the diagonal of H^-1, whatever the working set.
    pub(super) fn lengths(&self) -> [f64; N] {
        let mut squares = [0.0; N];
        for column in &self.j {
            squares.iter_mut().zip(column).for_each(|(square, j)| *square += j * j);
        }
        squares.map(f64::sqrt)
    }

    /// J^T n of a normal that is zero but for `part`, which begins at `start`.
    #[inline]
    pub(super) fn project(&self, start: usize, part: &[f64]) -> [f64; N] {
        let mut d = [0.0; N];
        let columns = d.iter_mut().zip(&self.j);
        match part {
            // A bound or a rate: nothing to sum.
            [one] => columns.for_each(|(d, j)| *d = one * j[start]),
            [one, two] if start + 1 < N => columns.for_each(|(d, j)| *d = one * j[start] + two * j[start + 1]),
            _ => columns.for_each(|(d, j)| *d = dot(part, &j[start..])),
        }
        d
    }

    /// J y.
    #[inline]
    pub(super) fn expand(&self, y: &[f64; N]) -> [f64; N] {
        let mut x = [0.0; N];
        add_all(&mut x, y, &self.j, 0..N);
        x
    }

    /// z of d = J^T n.
    #[inline]
    pub(super) fn direction(&self, d: &[f64; N]) -> [f64; N] {
        let mut z = [0.0; N];
        add_all(&mut z, &d[self.len..], &self.j[self.len..], 0..N);
        z
    }

    /// U d of the first q elements of d; the others are zero.
    #[inline]
    pub(super) fn solve(&self, d: &[f64; N]) -> [f64; N] {
        let mut r = [0.0; N];
        add_all(&mut r, &d[..self.len], &self.u, 0..self.len);
        r
    }

    /// U^T d of the first q elements of d, in their place.
    pub(super) fn solve_transposed(&self, d: &mut [f64; N]) {
        for k in (0..self.len).rev() {
            d[k] = dot(&self.u[k][..=k], &d[..=k]);
        }
    }

    /// The normal with J^T n = d joins the working set. `z` is its direction, `r` what the multipliers lose, `length` that
    /// of the rest of d, not 0.
    #[inline]
    pub(super) fn append(&mut self, d: &[f64; N], z: &[f64; N], r: &[f64; N], length: f64) {
        let q = self.len;
        // v = d2 - alpha e1 turns d2 into alpha e1; alpha has the sign that does not cancel.
        let alpha = if d[q] > 0.0 { -length } else { length };
        let mut jv = *z;
        add(&mut jv, -alpha, &self.j[q]);
        let scale = 1.0 / (alpha * (d[q] - alpha));
        add(&mut self.j[q], scale * (d[q] - alpha), &jv);
        self.j[q + 1..].iter_mut().zip(&d[q + 1..]).for_each(|(column, d)| add(column, scale * d, &jv));
        let inverse = 1.0 / alpha;
        self.u[q] = r.map(|r| -r * inverse);
        self.u[q][q] = inverse;
        self.len += 1;
    }

    /// The normal in place `k` of the working set leaves it.
    pub(super) fn remove(&mut self, k: usize) {
        // Rotations that leave nothing of row k of U but its last element: without both, the rest is an inverse again.
        let mut carried = self.u[k][k];
        self.u[k][k] = 0.0;
        for i in k + 1..self.len {
            let element = self.u[i][k];
            self.u[i].copy_within(k + 1..=i, k);
            self.u[i][i] = 0.0;
            let length = (carried * carried + element * element).sqrt();
            let (cos, sin) = if length > 0.0 { (element / length, carried / length) } else { (0.0, 1.0) };
            carried = length;
            for columns in [&mut self.u, &mut self.j] {
                let (left, right) = columns.split_at_mut(i);
                for (a, b) in left[i - 1].iter_mut().zip(&mut right[0]) {
                    (*a, *b) = (cos * *a - sin * *b, cos * *b + sin * *a);
                }
            }
        }
        self.len -= 1;
    }
}

/// `sum` + factor * `other`, as far as the shorter of them reaches.
#[inline(always)]
pub(super) fn add(sum: &mut [f64], factor: f64, other: &[f64]) {
    sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += factor * other);
}

/// `sum` + every column by its factor, at least in the given places: blocks of them, each in registers until its sum is
/// complete.
#[inline(always)]
fn add_all<const N: usize>(sum: &mut [f64; N], factors: &[f64], columns: &[[f64; N]], places: Range<usize>) {
    let mut at = places.start / BLOCK * BLOCK;
    while at < places.end && at + 2 * BLOCK <= N {
        add_block::<{ 2 * BLOCK }, N>(sum, factors, columns, at);
        at += 2 * BLOCK;
    }
    while at < places.end && at + BLOCK <= N {
        add_block::<BLOCK, N>(sum, factors, columns, at);
        at += BLOCK;
    }
    for at in at..places.end {
        add_block::<1, N>(sum, factors, columns, at);
    }
}

#[inline(always)]
fn add_block<const W: usize, const N: usize>(sum: &mut [f64; N], factors: &[f64], columns: &[[f64; N]], at: usize) {
    let mut block = [0.0; W];
    block.copy_from_slice(&sum[at..at + W]);
    for (column, factor) in columns.iter().zip(factors) {
        (0..W).for_each(|k| block[k] += factor * column[at + k]);
    }
    sum[at..at + W].copy_from_slice(&block);
}

/// The scalar product, as far as the shorter of them reaches; four sums, so that none waits for the other.
#[inline(always)]
pub(super) fn dot(one: &[f64], two: &[f64]) -> f64 {
    let common = one.len().min(two.len());
    let (one, one_rest) = one[..common].as_chunks::<4>();
    let (two, two_rest) = two[..common].as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (one, two) in one.iter().zip(two) {
        (0..4).for_each(|k| sums[k] += one[k] * two[k]);
    }
    let rest: f64 = one_rest.iter().zip(two_rest).map(|(one, two)| one * two).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}
