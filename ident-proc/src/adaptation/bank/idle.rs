//! Signs of the command that are out of use. What only they contribute to is not forgotten meanwhile.

/// Horizons without a command of one sign after which the sign is idle.
const IDLE: u64 = 40;

/// Watches both signs of the command.
#[derive(Debug, Clone)]
pub struct IdleSigns {
    /// Samples since a positive, and since a negative command was in the row.
    unused: [u64; 2],
    /// Samples after which a sign is idle.
    limit: u64,
}

impl IdleSigns {
    /// For a horizon in samples.
    pub fn new(horizon: usize) -> Self {
        Self { unused: [0; 2], limit: IDLE * horizon as u64 }
    }

    /// Takes in whether the row of a sample has positive, and whether it has negative commands. Returns which of the
    /// signs are idle.
    pub fn update(&mut self, signs: [bool; 2]) -> [bool; 2] {
        for (unused, used) in self.unused.iter_mut().zip(signs) {
            *unused = if used { 0 } else { *unused + 1 };
        }
        self.unused.map(|samples| samples > self.limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sign_is_idle_after_forty_horizons_and_not_when_it_comes_back() {
        let mut idle = IdleSigns::new(2);
        for k in 1..100 {
            assert_eq!(idle.update([true, false]), [false, k > 80], "{k}");
        }
        assert_eq!(idle.update([true, true]), [false, false]);
    }
}
