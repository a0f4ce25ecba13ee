//! The orders and options of a model, before it has coefficients.
//!
//! ```text
//! (1 - z^-1)^i A'(z) y(k) = B(z) x(k-nk) + c        A' of order na, B of order nb, i = 1 with `integrator`
//! ```
//!
//! With the integrator the equation is one between increments dy(k) = y(k) - y(k-1), and the coefficients are estimated
//! on the increments. The pole of the integrator is then exactly 1; without this option it would be estimated a little
//! off 1. Trap: the increments of a coarse encoder are mostly its steps.

use serde::{Serialize, Serializer, ser::SerializeStruct};

use super::{Basis, InputMap};

/// The orders and options of a model.
///
/// ```
/// use pipeline::hammerstein::{Coefficients, Structure};
///
/// let structure = Structure { nk: 3, drift: true, ..Structure::PAPER };
/// assert_eq!((structure.linear_len(), structure.full_len()), (3 + 2 + 1, 3 + 2 * 3 * 2 + 1));
/// assert_eq!(Coefficients::zero(structure).structure(), Some(structure));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// Order of A without the integrator, 1 to 5; up to 7 in [`Structure::published`].
    pub na: usize,
    /// Order of B, 0 to 4: B has `nb` + 1 coefficients.
    pub nb: usize,
    /// Delay from command to output, samples, 1 to 64: 1 means that y(k) answers u(k-1).
    pub nk: usize,
    /// Number r of coefficients of N for each sign of u, 1 to 5: order of the polynomials, or number of knots.
    pub order: usize,
    /// Whether A(z) = (1 - z^-1) A'(z), with A' of order `na`.
    pub integrator: bool,
    /// Whether the difference equation has a constant c (gravity, leakage).
    pub drift: bool,
    /// The dead band and the basis of N.
    pub input: InputMap,
}

impl Structure {
    /// The paper's choice for the boom: na = 3, nb = 1, nk = 1, r = 3.
    pub const PAPER: Self =
        Self { na: 3, nb: 1, nk: 1, order: 3, integrator: false, drift: false, input: InputMap::PAPER };

    /// Number of linear coefficients, na + nb + 1, and one for the drift.
    pub const fn linear_len(&self) -> usize {
        self.na + self.nb + 1 + self.drift as usize
    }

    /// Number of coefficients of the over-parametrised form (14), both branches: na + 2 r (nb + 1), and one for the
    /// drift.
    pub const fn full_len(&self) -> usize {
        self.na + 2 * self.order * (self.nb + 1) + self.drift as usize
    }

    /// Number of past outputs that a prediction needs: na, and one more with the integrator.
    pub const fn past_outputs(&self) -> usize {
        self.na + self.integrator as usize
    }

    /// Number of past samples that a prediction needs.
    pub const fn memory(&self) -> usize {
        let (outputs, commands) = (self.past_outputs(), self.nk + self.nb);
        if outputs > commands { outputs } else { commands }
    }

    /// Structure of the published coefficients: the integrator is multiplied into A.
    pub const fn published(&self) -> Self {
        Self { na: self.past_outputs(), integrator: false, ..*self }
    }
}

impl Serialize for Structure {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let knots = match &self.input.basis {
            Basis::Powers => None,
            Basis::Hinges(knots) => Some(&knots[..self.order]),
        };
        let mut fields = serializer.serialize_struct("Structure", 8)?;
        fields.serialize_field("na", &self.na)?;
        fields.serialize_field("nb", &self.nb)?;
        fields.serialize_field("nk", &self.nk)?;
        fields.serialize_field("order", &self.order)?;
        fields.serialize_field("integrator", &self.integrator)?;
        fields.serialize_field("drift", &self.drift)?;
        fields.serialize_field("dead_band", &self.input.dead_band)?;
        fields.serialize_field("knots", &knots)?;
        fields.end()
    }
}
