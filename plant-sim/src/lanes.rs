//! Four axes side by side in SIMD lanes. Nothing in this module allocates.
//!
//! All axes have the same equations, so one instruction works on four axes at once: every quantity of the dynamics is
//! four numbers, one per axis. Where an axis has to choose between two results, both are computed and one is selected;
//! there is no branch per axis.
//!
//! Trap: a step uses only operations that IEEE 754 rounds exactly (+ - * / and the square root), and none of the
//! platform's mathematical functions. Therefore the lane of an axis does not change the bits of its motion.

/// One number for each of four axes.
pub type Lanes = wide::f64x4;

/// Number of axes side by side.
pub const LANES: usize = 4;

/// The number that `field` takes from each of four axes.
pub fn lanes<P>(axes: &[P; LANES], field: impl Fn(&P) -> f64) -> Lanes {
    Lanes::new(std::array::from_fn(|axis| field(&axes[axis])))
}

/// max(0, `x`) in each lane.
#[inline]
pub fn positive(x: Lanes) -> Lanes {
    x.fast_max(Lanes::ZERO)
}
