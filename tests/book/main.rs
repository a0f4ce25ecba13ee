//! README and book are right: their console examples run, their links lead somewhere, and the files and functions that
//! they name exist. The definitions of the messages for other languages are those of the message types.

mod console;
mod generated;
#[path = "../harness/mod.rs"]
mod harness;
mod languages;
mod links;
mod names;
mod pages;
