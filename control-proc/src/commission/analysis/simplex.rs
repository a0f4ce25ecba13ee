//! Nelder, Mead 1965: the lowest point of a function of N numbers, without derivatives.
//!
//! The worst corner of a simplex is reflected at the middle of the others, twice as far where that is the best, half as
//! far where it is bad; where that is no better, all corners move half-way to the best. Trap: it finds the valley it
//! starts in.

/// The lowest point found after `steps` from `start` with first steps of `size`, and the function there.
pub fn minimum<const N: usize>(
    f: impl Fn(&[f64; N]) -> f64,
    start: [f64; N],
    size: [f64; N],
    steps: usize,
) -> ([f64; N], f64) {
    let mut corners = vec![(start, f(&start))];
    for i in 0..N {
        let mut corner = start;
        corner[i] += size[i];
        corners.push((corner, f(&corner)));
    }
    for _ in 0..steps {
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        let middle: [f64; N] =
            std::array::from_fn(|i| corners[..N].iter().map(|(corner, _)| corner[i]).sum::<f64>() / N as f64);
        let (worst, best) = (corners[N], corners[0]);
        let at = |part: f64| {
            let point = std::array::from_fn(|i| middle[i] + part * (middle[i] - worst.0[i]));
            (point, f(&point))
        };
        let reflected = at(1.0);
        let better = if reflected.1 < best.1 {
            let further = at(2.0);
            if further.1 < reflected.1 { further } else { reflected }
        } else if reflected.1 < corners[N - 1].1 {
            reflected
        } else {
            at(if reflected.1 < worst.1 { 0.5 } else { -0.5 })
        };
        if better.1 < worst.1.min(reflected.1.max(best.1)) || better.1 < corners[N - 1].1 {
            corners[N] = better;
        } else {
            for corner in &mut corners[1..] {
                let point = std::array::from_fn(|i| 0.5 * (corner.0[i] + best.0[i]));
                *corner = (point, f(&point));
            }
        }
    }
    corners.sort_by(|a, b| a.1.total_cmp(&b.1));
    corners[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_banana_is_followed_to_its_end() {
        let banana = |p: &[f64; 2]| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2);
        let (point, value) = minimum(banana, [-1.2, 1.0], [0.1, 0.1], 200);
        assert!(value < 1e-10 && (point[0] - 1.0).abs() < 1e-4 && (point[1] - 1.0).abs() < 1e-4, "{point:?} {value}");
    }
}
