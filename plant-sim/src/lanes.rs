//! Four axes side by side.
//!
//! Axes are alike, so the same operation is done on four of them at once: every quantity of the dynamics is four
//! numbers, one per axis. A choice between two results takes both and selects; there is no branch per axis.
//!
//! The trap: only operations that IEEE 754 rounds exactly (+ - * / and the root) are used between two steps, none of
//! the platform's mathematical functions; so the lane in which an axis stands does not change its bits.

/// One number for each of four axes.
pub type Lanes = wide::f64x4;

/// Axes side by side.
pub const LANES: usize = 4;

/// `field` of each of four axes.
pub fn lanes<P>(axes: &[P; LANES], field: impl Fn(&P) -> f64) -> Lanes {
    Lanes::new(std::array::from_fn(|axis| field(&axes[axis])))
}

/// What is above zero of `x`, else zero.
#[inline]
pub fn positive(x: Lanes) -> Lanes {
    x.fast_max(Lanes::ZERO)
}
