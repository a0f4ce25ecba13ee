//! `hydraxis identify` as a user runs it: the figures of records whose plant the test knows, the choice of columns,
//! period, training and horizon, the search of a structure, the estimators side by side, the two outputs, every refusal, and the public records where they are present.

mod arguments;
mod compare;
mod models;
mod options;
mod plant;
mod refusals;
mod select;
mod servo;
