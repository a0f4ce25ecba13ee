//! hydraxis
fn main() {}
