//! An output that stands while the command would move it.
//!
//! ```text
//! row k counts  <=>  y has stood for more than max(h, 20, 10 m) rows  and  |u(k)| >= U
//! ```
//!
//! y output, u command, h horizon in rows. Over the rows in which y changes: m the median number of rows between two of
//! them, U the median of |u|. A stuck sensor, a cable that has slipped off its drum and an axis at its end stop look
//! like this. The predictions of such rows are perfect, and make a bad model look good. Trap: a coarse sensor stands
//! for many rows between two counts; hence m.

/// Fewest rows for which an output stands.
const LEAST: usize = 20;
/// The same in parts of m.
const USUAL: usize = 10;

/// Part of the rows in which the output stands though it is driven. `begins` says before which rows a gap is.
pub fn part(outputs: &[f64], inputs: &[f64], begins: &[bool], horizon: usize) -> f64 {
    let changes: Vec<usize> = (1..outputs.len()).filter(|&k| !begins[k] && outputs[k] != outputs[k - 1]).collect();
    let apart = median(changes.windows(2).map(|pair| (pair[1] - pair[0]) as f64));
    let (Some(apart), Some(usual)) = (apart, median(changes.iter().map(|&k| inputs[k].abs()))) else { return 0.0 };
    let longest = horizon.max(LEAST).max(USUAL * apart as usize);
    let (mut since, mut standing) = (0, 0);
    for k in 1..outputs.len() {
        since = if begins[k] || outputs[k] != outputs[k - 1] { 0 } else { since + 1 };
        standing += usize::from(since > longest && inputs[k].abs() >= usual);
    }
    standing as f64 / outputs.len() as f64
}

/// The median of the finite values; none without any.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Part of a record of 4000 rows in which the axis goes by `speed` u and is read in counts; `read` is the position
    /// that is read at row k for the true one.
    fn part_of(count: f64, dead_band: f64, read: impl Fn(usize, f64, f64) -> f64) -> f64 {
        let (mut outputs, mut inputs, mut y, mut frozen) = (Vec::new(), Vec::new(), 0.5, 0.5);
        for k in 0..4000 {
            let t = k as f64 * 0.01;
            let u = 0.5 * (1.3 * t).sin() + 0.3 * (3.1 * t).sin();
            if u.abs() > dead_band {
                y += 0.002 * (u - dead_band.copysign(u));
            }
            frozen = read(k, y, frozen);
            outputs.push((frozen / count).round() * count);
            inputs.push(u);
        }
        let begins: Vec<bool> = (0..4000).map(|k| k == 0).collect();
        part(&outputs, &inputs, &begins, 50)
    }

    #[test]
    fn an_output_that_is_frozen_is_found() {
        // Half of the record, and ten seconds of it.
        assert!(part_of(1e-4, 0.0, |k, y, before| if k < 2000 { y } else { before }) > 0.2);
        assert!(part_of(1e-4, 0.1, |k, y, before| if (1000..2000).contains(&k) { before } else { y }) > 0.08);
        // A stop at half of the stroke.
        assert!(part_of(1e-4, 0.0, |_, y, _| y.min(0.55)) > 0.1);
    }

    #[test]
    fn dead_bands_rests_coarse_counts_and_outputs_that_never_move_are_no_frozen_output() {
        for (count, dead_band) in [(1e-5, 0.0), (1e-4, 0.4), (1e-3, 0.3), (0.02, 0.0)] {
            assert_eq!(part_of(count, dead_band, |_, y, _| y), 0.0, "{count} {dead_band}");
        }
        assert_eq!(part_of(1e-4, 0.0, |_, _, _| 0.5), 0.0);
        assert_eq!(part(&[], &[], &[], 1), 0.0);
    }
}
