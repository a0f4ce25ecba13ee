//! README and book are right: their console examples run, their links lead somewhere, and the files and functions that
//! they name exist.

mod console;
mod generated;
#[path = "../harness/mod.rs"]
mod harness;
mod links;
mod names;
mod pages;
