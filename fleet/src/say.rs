//! Lines for whoever operates.

use std::io::{Write, stderr};

/// Says something on standard error. A program goes on when nobody reads it, as after the end of its terminal.
pub fn say(text: &str) {
    let _ = writeln!(stderr(), "{text}");
}
