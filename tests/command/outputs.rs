//! No command writes over a file that it reads.

use std::{fs, process::Command};

use crate::harness::{cli::expect_refusal, records::simulated};

/// Each command with an output in the place of an input, or of another output.
const CLASHES: [(&str, [&str; 2]); 12] = [
    ("identify r.csv --csv r.csv", ["--csv", "DATA"]),
    ("identify r.csv --json ./r.csv", ["--json", "DATA"]),
    ("identify r.csv --report linked.csv", ["--report", "DATA"]),
    ("identify r.csv --test m.toml --model-out m.toml", ["--model-out", "--test"]),
    ("identify r.csv --csv new.csv --json new.csv", ["--csv", "--json"]),
    ("predict m.toml r.csv --csv r.csv", ["--csv", "DATA"]),
    ("simulate m.toml --duration 1s --trajectory m.toml", ["--trajectory", "MACHINE.toml"]),
    ("simulate m.toml --duration 1s --json m.toml", ["--json", "MACHINE.toml"]),
    ("plot r.csv --output r.csv", ["--output", "FILE.csv"]),
    ("export x.mcap --csv x.mcap", ["--csv", "FILE.mcap"]),
    ("report x.mcap --output x.mcap", ["--output", "FILE.mcap"]),
    ("replay x.mcap --csv x.mcap", ["--csv", "FILE.mcap"]),
];

#[test]
fn no_output_takes_the_place_of_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let record = fs::read(simulated().join("servo_warmup.csv")).unwrap();
    for name in ["r.csv", "other.csv", "m.toml", "x.mcap"] {
        fs::write(folder.path().join(name), &record).unwrap();
    }
    assert!(Command::new("ln").args(["r.csv", "linked.csv"]).current_dir(folder.path()).status().unwrap().success());
    for (line, expected) in CLASHES {
        let words: Vec<&str> = line.split(' ').collect();
        let [written, other] = expected;
        expect_refusal(folder.path(), &words, &[&format!("{written}: found "), &format!("that {other} ")]);
        for name in ["r.csv", "other.csv", "m.toml", "x.mcap"] {
            assert_eq!(fs::read(folder.path().join(name)).unwrap(), record, "{line}");
        }
        assert!(!folder.path().join("new.csv").exists(), "{line}");
    }
}
