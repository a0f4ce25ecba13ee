//! What learns online: one recursive estimator, a bank of them, or the grey box.

pub mod bank;
pub mod grey_box;
pub mod single;

pub use bank::Bank;
pub use grey_box::GreyBox;
pub use single::{Learned, Single};
