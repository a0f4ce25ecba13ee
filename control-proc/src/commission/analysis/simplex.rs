//! Nelder and Mead (1965): the lowest point of a function of N numbers, without derivatives.
//!
//! The worst corner of a simplex is reflected at the middle of the others: twice as far where the reflected corner is
//! the best, half as far where it is bad. Where that is no better, all corners move half-way to the best one. Trap: the
//! search stays in the valley that it starts in.

/// The lowest point found after `steps` from `start` with first steps of `size`, and the function there. A number whose
/// first step is 0 stays as it is, and the simplex has no corner for it.
pub fn minimum<const N: usize>(
    f: impl Fn(&[f64; N]) -> f64,
    start: [f64; N],
    size: [f64; N],
    steps: usize,
) -> ([f64; N], f64) {
    let mut corners = vec![(start, f(&start))];
    for i in (0..N).filter(|i| size[*i] != 0.0) {
        let mut corner = start;
        corner[i] += size[i];
        corners.push((corner, f(&corner)));
    }
    let last = corners.len() - 1;
    if last == 0 {
        return corners[0];
    }
    for _ in 0..steps {
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        let middle: [f64; N] =
            std::array::from_fn(|i| corners[..last].iter().map(|(corner, _)| corner[i]).sum::<f64>() / last as f64);
        let (worst, best) = (corners[last], corners[0]);
        let at = |part: f64| {
            let point = std::array::from_fn(|i| middle[i] + part * (middle[i] - worst.0[i]));
            (point, f(&point))
        };
        let reflected = at(1.0);
        let better = if reflected.1 < best.1 {
            let further = at(2.0);
            if further.1 < reflected.1 { further } else { reflected }
        } else if reflected.1 < corners[last - 1].1 {
            reflected
        } else {
            at(if reflected.1 < worst.1 { 0.5 } else { -0.5 })
        };
        if better.1 < worst.1.min(reflected.1.max(best.1)) || better.1 < corners[last - 1].1 {
            corners[last] = better;
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
    fn numbers_without_a_step_stay_and_do_not_slow_the_search() {
        let bowl = |p: &[f64; 4]| (p[0] - 1.0).powi(2) + 3.0 * (p[2] + 2.0).powi(2) + p[1] * p[1] + p[3] * p[3];
        let (point, value) = minimum(bowl, [0.0, 5.0, 0.0, -7.0], [0.1, 0.0, 0.1, 0.0], 100);
        assert_eq!((point[1], point[3]), (5.0, -7.0));
        assert!((value - 74.0).abs() < 1e-9 && (point[2] + 2.0).abs() < 1e-4, "{point:?} {value}");
        let (plane, _) = minimum(|p: &[f64; 2]| bowl(&[p[0], 5.0, p[1], -7.0]), [0.0; 2], [0.1; 2], 100);
        assert_eq!([point[0], point[2]], plane, "the same search as without them");
        assert_eq!(minimum(bowl, [1.0; 4], [0.0; 4], 100).0, [1.0; 4]);
    }

    #[test]
    fn the_minimum_of_the_rosenbrock_function_is_found() {
        let rosenbrock = |p: &[f64; 2]| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2);
        let (point, value) = minimum(rosenbrock, [-1.2, 1.0], [0.1, 0.1], 200);
        assert!(value < 1e-10 && (point[0] - 1.0).abs() < 1e-4 && (point[1] - 1.0).abs() < 1e-4, "{point:?} {value}");
    }
}
