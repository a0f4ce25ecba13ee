//! The usual size of a signal, whatever single wild values it has.
//!
//! ```text
//! first 100 values of a driven axis:   s = the 91st of them in the order of their size
//! later ones:                          s^2 <- s^2 + (min(x^2, 25 s^2) - s^2) / n,    n at most the memory
//! ```
//!
//! x value and s size in the unit of the signal, n number of values. Trap: at a short period most increments of a
//! coarse encoder are zero. Zeros do not count among the first values, and s is never below the smallest of these.

/// Values of a driven axis before there is a size.
const FIRST: usize = 100;
/// Which of the first values in the order of their size is s, from 0: nearly a tenth of them may be wild.
const DECILE: usize = 90;
/// Largest square that the size takes in, in squares of the size.
const LARGEST_SQUARE: f64 = 25.0;

/// The usual size of a signal. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Scale {
    /// Magnitudes of the first values.
    first: Vec<f64>,
    /// Smallest of the first values.
    least: f64,
    mean_square: Option<f64>,
    seen: u64,
    memory: u64,
}

impl Scale {
    /// A size with a memory of so many values.
    pub fn new(memory: u64) -> Self {
        Self { first: Vec::with_capacity(FIRST), least: 0.0, mean_square: None, seen: 0, memory }
    }

    /// s; `None` before enough values of a driven axis were seen.
    pub fn size(&self) -> Option<f64> {
        self.mean_square.map(|mean_square| mean_square.sqrt().max(self.least))
    }

    /// Replaces s.
    pub fn set(&mut self, size: f64) {
        self.mean_square = Some(size * size);
    }

    /// Takes in a value. `driven`: a command has opened the valve of late.
    pub fn push(&mut self, value: f64, driven: bool) {
        if let (Some(mean_square), Some(size)) = (self.mean_square, self.size()) {
            self.seen += 1;
            let square = (value * value).min(LARGEST_SQUARE * size * size);
            self.mean_square = Some(mean_square + (square - mean_square) / self.seen.min(self.memory) as f64);
        } else if driven && value != 0.0 {
            self.first.push(value.abs());
            self.seen = self.first.len() as u64;
            if self.first.len() == FIRST {
                self.first.sort_unstable_by(f64::total_cmp);
                self.least = self.first[0];
                self.set(self.first[DECILE]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wild_values_hardly_change_it() {
        let mut scale = Scale::new(100);
        for k in 0..1000 {
            scale.push(if k % 50 == 20 { 1e6 } else { 0.1 }, true);
        }
        let size = scale.size().unwrap();
        assert!((0.1..0.2).contains(&size), "{size}");
    }

    #[test]
    fn it_needs_values_of_a_driven_axis() {
        let mut scale = Scale::new(100);
        (0..10_000).for_each(|_| scale.push(1e-6, false));
        assert_eq!(scale.size(), None);
        (0..FIRST).for_each(|_| scale.push(1.0, true));
        assert_eq!(scale.size(), Some(1.0));
    }
}
