//! `hydraxis identify`: records of a known plant and of a simulated servo axis, formats and gaps of recordings, options
//! for columns, period, training and horizon, the search for a structure, the comparison of estimators, the two
//! outputs, and refusals.

mod arguments;
mod compare;
mod many;
mod models;
mod options;
mod pictures;
mod plant;
mod recordings;
mod refusals;
mod select;
mod servo;
mod verdict;
