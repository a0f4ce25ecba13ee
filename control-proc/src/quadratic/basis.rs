//! The factors of the working set.
//!
//! ```text
//! J^T H J = I        J^T A = | R |        J = (J1 J2), J1 has q columns
//!                            | 0 |
//! z = J2 J2^T n      direction of x in which n'x grows at least cost while the working set stays where it is
//! r = R^-1 J1^T n    what the multipliers of the working set lose meanwhile
//! ```
//!
//! H = L L^T the Hessian, A (N x q) the normals of the working set, n one that is to join it. Source: Goldfarb and
//! Idnani, Math. Programming 27 (1983), section 4. J begins as L^-T; a normal joins by a reflection of J2, which
//! has z already, and leaves by Givens rotations. Trap: rows of J keep their length through all of this, and that
//! length, not the machine's epsilon alone, says what of J^T n is rounding.

use std::array::from_fn;

use super::Status;

/// A pivot of the factorisation below this part of its diagonal element per variable is rounding: one epsilon each.
const PIVOT: f64 = f64::EPSILON;

/// J and R, both as columns.
#[derive(Debug, Clone)]
pub(super) struct Basis<const N: usize> {
    j: [[f64; N]; N],
    r: [[f64; N]; N],
    /// q, the size of the working set.
    len: usize,
}

impl<const N: usize> Basis<N> {
    pub(super) const fn new() -> Self {
        Self { j: [[0.0; N]; N], r: [[0.0; N]; N], len: 0 }
    }

    /// Begins with no working set, J = L^-T. Of H only its upper triangle is read.
    pub(super) fn factor(&mut self, hessian: &[[f64; N]; N]) -> Result<(), Status> {
        self.len = 0;
        // R is not needed yet: its columns hold those of L meanwhile.
        let (l, j) = (&mut self.r, &mut self.j);
        let mut factors = [0.0; N];
        for i in 0..N {
            let (known, rest) = l.split_at_mut(i);
            let column = &mut rest[0][i..];
            column.copy_from_slice(&hessian[i][i..]);
            factors.iter_mut().zip(&*known).for_each(|(factor, known)| *factor = -known[i]);
            add_all(column, &factors, known, i);
            let pivot = column[0];
            if !pivot.is_finite() {
                return Err(Status::NotFinite);
            }
            if pivot <= N as f64 * PIVOT * hessian[i][i] {
                return Err(Status::NotConvex);
            }
            let inverse = 1.0 / pivot.sqrt();
            column.iter_mut().for_each(|l| *l *= inverse);

            // Row i of L^-1, from those above it.
            let (known, rest) = j.split_at_mut(i);
            let column = &mut rest[0];
            *column = [0.0; N];
            add_all(&mut column[..i], &factors, known, 0);
            column[..i].iter_mut().for_each(|j| *j *= inverse);
            column[i] = inverse;
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
    pub(super) fn project(&self, start: usize, part: &[f64]) -> [f64; N] {
        match part {
            // A bound or a rate: nothing to sum.
            [one] => from_fn(|k| one * self.j[k][start]),
            [one, two] => from_fn(|k| one * self.j[k][start] + two * self.j[k][start + 1]),
            _ => from_fn(|k| dot(part, &self.j[k][start..])),
        }
    }

    /// J y.
    pub(super) fn expand(&self, y: &[f64; N]) -> [f64; N] {
        let mut x = [0.0; N];
        add_all(&mut x, y, &self.j, 0);
        x
    }

    /// z of d = J^T n.
    pub(super) fn direction(&self, d: &[f64; N]) -> [f64; N] {
        let mut z = [0.0; N];
        add_all(&mut z, &d[self.len..], &self.j[self.len..], 0);
        z
    }

    /// R^-1 d of the first q elements of d, in their place.
    pub(super) fn solve(&self, d: &mut [f64; N]) {
        for k in (0..self.len).rev() {
            d[k] /= self.r[k][k];
            let known = d[k];
            add(&mut d[..k], -known, &self.r[k][..k]);
        }
    }

    /// R^-T d of the first q elements of d, in their place.
    pub(super) fn solve_transposed(&self, d: &mut [f64; N]) {
        for k in 0..self.len {
            d[k] = (d[k] - dot(&self.r[k][..k], &d[..k])) / self.r[k][k];
        }
    }

    /// The normal with J^T n = d joins the working set. `z` is its direction, `length` that of the rest of d, not 0.
    pub(super) fn append(&mut self, d: &[f64; N], z: &[f64; N], length: f64) {
        let q = self.len;
        // v = d2 - alpha e1 turns d2 into alpha e1; alpha has the sign that does not cancel.
        let alpha = if d[q] > 0.0 { -length } else { length };
        let mut jv = *z;
        add(&mut jv, -alpha, &self.j[q]);
        let scale = 1.0 / (alpha * (d[q] - alpha));
        add(&mut self.j[q], scale * (d[q] - alpha), &jv);
        self.j[q + 1..].iter_mut().zip(&d[q + 1..]).for_each(|(column, d)| add(column, scale * d, &jv));
        self.r[q][..q].copy_from_slice(&d[..q]);
        self.r[q][q] = alpha;
        self.len += 1;
    }

    /// The normal in place `k` of the working set leaves it.
    pub(super) fn remove(&mut self, k: usize) {
        self.r.copy_within(k + 1..self.len, k);
        self.len -= 1;
        for i in k..self.len {
            let (a, b) = (self.r[i][i], self.r[i][i + 1]);
            let length = (a * a + b * b).sqrt();
            if length == 0.0 {
                continue;
            }
            let (cos, sin) = (a / length, b / length);
            for column in &mut self.r[i..self.len] {
                (column[i], column[i + 1]) =
                    (cos * column[i] + sin * column[i + 1], cos * column[i + 1] - sin * column[i]);
            }
            let (left, right) = self.j.split_at_mut(i + 1);
            for (a, b) in left[i].iter_mut().zip(&mut right[0]) {
                (*a, *b) = (cos * *a + sin * *b, cos * *b - sin * *a);
            }
        }
    }
}

/// `sum` + factor * `other`, as far as the shorter of them reaches.
#[inline(always)]
pub(super) fn add(sum: &mut [f64], factor: f64, other: &[f64]) {
    sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += factor * other);
}

/// `sum` + every column from `start` on by its factor; four at a time, so that `sum` is not stored in between.
#[inline(always)]
fn add_all<const N: usize>(sum: &mut [f64], factors: &[f64], columns: &[[f64; N]], start: usize) {
    let common = factors.len().min(columns.len());
    let part = start..start + sum.len();
    let (fours, rest) = columns[..common].as_chunks::<4>();
    let (factors, factors_rest) = factors[..common].as_chunks::<4>();
    for (columns, factors) in fours.iter().zip(factors) {
        let [a, b, c, d] = columns.each_ref().map(|column| &column[part.clone()]);
        for ((((sum, a), b), c), d) in sum.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *sum += (factors[0] * a + factors[1] * b) + (factors[2] * c + factors[3] * d);
        }
    }
    rest.iter().zip(factors_rest).for_each(|(column, factor)| add(sum, *factor, &column[part.clone()]));
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
