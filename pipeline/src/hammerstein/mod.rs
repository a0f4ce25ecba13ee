//! The Hammerstein model of one axis: a static nonlinearity N in front of a linear difference equation.
//!
//! ```text
//! x(k) = N(u(k)) = f_1 u + ... + f_r u^r   for u >= 0,   g_1 u + ... + g_r u^r   for u < 0        (11)
//! y(k) = -a_1 y(k-1) - ... - a_na y(k-na) + b_0 x(k-nk) + ... + b_nb x(k-nk-nb) + c               (12)
//! ```
//!
//! u valve command, x intermediate value, y output, c drift; numbers in brackets are the equations of the paper that
//! the README names. The paper's model has c = 0. Three options go beyond the paper and are off by default: A(z) may
//! hold an integrator, (1 - z^-1) A'(z); a calibrated dead band may be subtracted from the command before N; and N may
//! be made of hinges in the place of powers ([`InputMap`]).
//!
//! | file | what it holds |
//! |---|---|
//! | `structure` | orders and options, before there are coefficients |
//! | `coefficients` | the model itself, and its predictions |
//! | `input`, `nonlinearity` | dead band and basis; N(u) |
//! | `inverse` | the command that gives a value of N |
//! | `play` | the command that acts behind a hysteresis |
//! | `poles` | where the poles of 1/A lie |
//!
//! All of this runs in the loops of identification and control and allocates nothing.
//!
//! Trap: b and N are known only up to a common factor, and f_1 = 1 fixes it, so a model of a valve
//! with a wide dead band can have small or negative f_1 before scaling: judge b N(u), never b alone.

mod coefficients;
mod input;
mod inverse;
mod nonlinearity;
mod play;
mod poles;
mod structure;

pub use coefficients::Coefficients;
pub use input::{Basis, InputMap};
pub use nonlinearity::Nonlinearity;
pub use play::Play;
pub use poles::poles_within;
pub use structure::Structure;

/// Highest order of A that can be identified, and number of coefficients of B that a model can have.
pub const MAX_LINEAR: usize = 5;
/// Highest order of A of a [`Coefficients`]: two more than can be identified, for an integrator and for the step from
/// velocity to position.
pub const MAX_A: usize = MAX_LINEAR + 2;
/// Highest order of the polynomials of N, and number of knots of its hinges.
pub const MAX_ORDER: usize = 5;
/// Longest delay nk, samples: a dead time of 1 s at a period of 1 ms.
pub const MAX_DELAY: usize = 1024;
