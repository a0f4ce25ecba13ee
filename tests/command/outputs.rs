//! No command writes over a file that it reads, or empties one that it cannot fill.

use std::{fs, process::Command};

use crate::harness::{
    cli::{expect_refusal, run},
    records::simulated,
};

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

/// Regression: a model that could not be written emptied the files of the runs before, and the verdict that says why
/// was not printed.
#[test]
fn a_model_that_has_diverged_leaves_the_one_of_before_and_keeps_back_no_other_output() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(simulated().join("servo_warmup.csv")).unwrap();
    let mut rows: Vec<String> = text.lines().map(str::to_owned).collect();
    let row: Vec<&str> = rows[5600].split(',').collect();
    rows[5600] = format!("{},1e6,{}", row[0], row[2]);
    fs::write(folder.path().join("r.csv"), rows.join("\n")).unwrap();
    fs::write(folder.path().join("good.toml"), "a model").unwrap();
    fs::write(folder.path().join("old.json"), "x".repeat(1_000_000)).unwrap();
    let line = ["identify", "r.csv", "--model-out", "good.toml", "--json", "old.json", "--report", "new.html"];
    let output = run(folder.path(), &line);
    let (printed, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("--model-out: found a coefficient that is not finite") && printed.starts_with("not usable"));
    assert_eq!(fs::read_to_string(folder.path().join("good.toml")).unwrap(), "a model");
    assert!(fs::read_to_string(folder.path().join("new.html")).unwrap().ends_with("</html>\n"));
    let json = fs::read_to_string(folder.path().join("old.json")).unwrap();
    assert!(serde_json::from_str::<serde_json::Value>(&json).is_ok(), "{} bytes", json.len());
}
