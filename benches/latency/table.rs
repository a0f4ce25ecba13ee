//! The table of one section.

use pipeline::latency::Percentiles;
use serde_json::{Value, json};

/// Prints the percentiles of all sides and their ratios under `title`, and returns them.
pub fn show(title: &str, sides: &[(&str, Percentiles)], ratios: &[(&str, f64)]) -> Value {
    println!("{title}");
    println!("  {:34} {:>9} {:>9} {:>9} {:>9} {:>10}", "us", "count", "p50", "p99", "p99.9", "max");
    for (name, p) in sides {
        let [p50, p99, p99_9, max] = [p.p50, p.p99, p.p99_9, p.max].map(|ns| ns as f64 / 1e3);
        println!("  {name:34} {:>9} {p50:>9.1} {p99:>9.1} {p99_9:>9.1} {max:>10.1}", p.count);
    }
    for (name, ratio) in ratios {
        println!("  {name}: {ratio:.3}");
    }
    println!();
    let sides: Vec<Value> = sides.iter().map(|(name, p)| json!({ "side": name, "ns": p })).collect();
    let ratios: Vec<Value> = ratios.iter().map(|(name, ratio)| json!({ "ratio": name, "is": ratio })).collect();
    json!({ "title": title, "sides": sides, "ratios": ratios })
}

pub fn ratio(one: u64, other: u64) -> f64 {
    one as f64 / other.max(1) as f64
}
