//! Work that every update contains: one pass P -= g g' s over a triangle, in two layouts.

use std::array::from_fn;

use crate::Row;

/// Factor s of the k-th pass. After 1024 passes its sign changes, so that the rows cancel and P stays bounded.
fn sign(k: usize) -> f64 {
    if (k / 1024).is_multiple_of(2) { 1e-3 } else { -1e-3 }
}

/// n (n + 1)/2 numbers of a triangle, row after row.
pub struct Packed {
    pub p: Vec<f64>,
    passes: usize,
}

impl Packed {
    pub fn new(n: usize) -> Self {
        Self { p: vec![1.0; n * (n + 1) / 2], passes: 0 }
    }

    pub fn update<const N: usize>(&mut self, row: &Row<N>) {
        let g = row.phi.as_slice();
        let scale = sign(self.passes);
        self.passes += 1;
        let mut rest = self.p.as_mut_slice();
        for i in 0..g.len() {
            let (row, below) = rest.split_at_mut(g.len() - i);
            let factor = g[i] * scale;
            row.iter_mut().zip(&g[i..]).for_each(|(p, g)| *p -= g * factor);
            rest = below;
        }
    }
}

/// A triangle of tiles of 4 x 4: more numbers, but no incomplete SIMD vectors.
pub struct Tiles {
    p: Vec<[[f64; 4]; 4]>,
    passes: usize,
}

impl Tiles {
    pub fn new(n: usize) -> Self {
        let blocks = n.div_ceil(4);
        Self { p: vec![[[1.0; 4]; 4]; blocks * (blocks + 1) / 2], passes: 0 }
    }

    pub fn update<const N: usize>(&mut self, row: &Row<N>) {
        let scale = sign(self.passes);
        self.passes += 1;
        let mut rest = self.p.as_mut_slice();
        for (t, right) in row.blocks.iter().enumerate() {
            let (column, others) = rest.split_at_mut(t + 1);
            let factor = right.map(|g| g * scale);
            for (p, left) in column.iter_mut().zip(&row.blocks) {
                (0..4).for_each(|j| p[j] = from_fn(|i| p[j][i] - left[i] * factor[j]));
            }
            rest = others;
        }
    }

    pub fn all(&self) -> Vec<f64> {
        self.p.as_flattened().as_flattened().to_vec()
    }
}
