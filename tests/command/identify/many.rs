//! `--jsonl`: many recordings, each on its own, with kills and resume.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    process::{Command, Stdio},
    time::Duration,
};

use serde_json::Value;

use crate::harness::{
    Dice,
    cli::{expect_refusal, run},
    hydraxis,
};

/// Writes a short recording of an axis whose gain depends on `seed`.
fn write(path: &Path, seed: u64) {
    let (mut y, mut speed, mut text) = (0.5, 0.0, "t,u,y\n".to_owned());
    let gain = 0.2 + 0.01 * (seed % 40) as f64;
    for k in 0..400 {
        let t = f64::from(k) * 0.01;
        let u = 0.6 * (3.0 * t).sin() + 0.3 * (17.0 * t).cos();
        text += &format!("{t:.2},{u:.6},{y:.6}\n");
        speed += 0.1 * (u * gain - speed);
        y += 0.01 * speed;
    }
    fs::write(path, text).unwrap();
}

/// The lines of a file by the names of their recordings. Each is there once.
fn lines(path: &Path) -> BTreeMap<String, Value> {
    let mut lines = BTreeMap::new();
    for line in fs::read_to_string(path).unwrap().lines() {
        let value: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        let file = value["file"].as_str().unwrap().to_owned();
        assert!(lines.insert(file.clone(), value).is_none(), "{file} has two lines");
    }
    lines
}

#[test]
fn every_file_has_its_line_with_hash_options_and_result_or_error_and_one_failure_is_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("in")).unwrap();
    write(&folder.path().join("in/a.csv"), 1);
    write(&folder.path().join("in/b.csv"), 2);
    write(&folder.path().join("c.csv"), 3);
    let arguments = ["identify", "in", "c.csv", "c.csv", "--nk", "2", "--jobs", "2", "--jsonl"];
    let done = run(folder.path(), &[&arguments[..], &["good.jsonl"]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(String::from_utf8(done.stdout).unwrap(), "good.jsonl: 3 files identified, 0 failed, 0 done before\n");
    let good = lines(&folder.path().join("good.jsonl"));
    assert_eq!(good.keys().collect::<Vec<_>>(), ["c.csv", "in/a.csv", "in/b.csv"]);
    let sum = Command::new("sha256sum").arg(folder.path().join("c.csv")).output().unwrap();
    assert!(String::from_utf8(sum.stdout).unwrap().starts_with(good["c.csv"]["sha256"].as_str().unwrap()));
    assert_eq!(good["c.csv"]["options"], serde_json::json!(["--nk", "2"]));
    // The figures are those of the file alone.
    let alone = run(folder.path(), &["identify", "c.csv", "--nk", "2", "--json", "-"]);
    let mut alone: Value = serde_json::from_slice(&alone.stdout).unwrap();
    let mut together = good["c.csv"]["result"].clone();
    for value in [&mut alone, &mut together] {
        value["adaptive"]["ns_per_update"] = Value::Null;
    }
    assert_eq!(alone, together);

    fs::write(folder.path().join("in/bad.csv"), "t,u,y\n0,0,0\n1,x,0\n2,0,0\n").unwrap();
    fs::write(folder.path().join("in/short.csv"), "t,u,y\n0,0,0\n0.01,1,0\n0.02,0,0\n").unwrap();
    let failed = run(folder.path(), &["identify", "in", "missing.csv", "--jsonl", "bad.jsonl"]);
    assert_eq!(failed.status.code(), Some(1));
    let said = String::from_utf8(failed.stderr).unwrap();
    assert!(said.contains("3 of 5 files failed; bad.jsonl says why"), "{said}");
    let bad = lines(&folder.path().join("bad.jsonl"));
    let error = |file: &str| bad[file]["error"].clone();
    assert_eq!((&error("in/bad.csv")["kind"], &error("in/bad.csv")["place"]["line"]), (&"recording".into(), &3.into()));
    assert_eq!(error("in/bad.csv")["place"]["column"], "u");
    assert_eq!(error("in/short.csv")["kind"], "settings");
    assert_eq!((&error("missing.csv")["kind"], &bad["missing.csv"]["sha256"]), (&"unreadable".into(), &Value::Null));
    assert_eq!(error("in/a.csv"), Value::Null);
}

#[test]
fn after_kills_a_resumed_run_has_every_file_once() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = folder.path().join("in");
    fs::create_dir(&recordings).unwrap();
    let names: BTreeSet<String> = (0..120).map(|i| format!("in/{i:03}.csv")).collect();
    names.iter().enumerate().for_each(|(i, name)| write(&folder.path().join(name), i as u64));
    let out = folder.path().join("out.jsonl");
    let arguments = ["identify", "in", "--jsonl", "out.jsonl", "--resume", "--jobs", "2"];
    let mut dice = Dice::new("many", "HYDRAXIS_MANY_SEED", "");
    let mut lengths = vec![0];
    for _ in 0..6 {
        let mut child = hydraxis().args(arguments).current_dir(folder.path()).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(30 + dice.below(150)));
        child.kill().unwrap();
        child.wait().unwrap();
        lengths.push(fs::read(&out).map_or(0, |bytes| bytes.len()));
    }
    assert!(lengths.windows(2).all(|pair| pair[0] <= pair[1] + 20_000) && *lengths.last().unwrap() > 0, "{lengths:?}");
    // A kill within the call that writes a line tears the line.
    let torn = fs::read(&out).unwrap();
    fs::write(&out, &torn[..torn.len() - 10]).unwrap();
    let before = lines_of_whole(&torn[..torn.len() - 10]);
    let done = run(folder.path(), &arguments);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8(done.stdout).unwrap();
    let expected = format!("out.jsonl: {} files identified, 0 failed, {before} done before\n", 120 - before);
    assert_eq!(said, expected);
    assert_eq!(lines(&out).into_keys().collect::<BTreeSet<_>>(), names);

    // A file that has changed, and other options, are another work.
    write(&folder.path().join("in/007.csv"), 900);
    let done = run(folder.path(), &arguments);
    assert!(String::from_utf8(done.stdout).unwrap().contains("1 files identified, 0 failed, 119 done before"));
    let other = run(folder.path(), &[&arguments[..], &["--na", "2"]].concat());
    assert!(String::from_utf8(other.stdout).unwrap().contains("120 files identified, 0 failed, 0 done before"));
}

/// Number of lines that end.
fn lines_of_whole(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte == b'\n').count()
}

#[test]
fn what_would_mix_results_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("a.csv"), 1);
    fs::create_dir(folder.path().join("empty")).unwrap();
    fs::write(folder.path().join("old.jsonl"), "{}\n").unwrap();
    let refuse = |arguments: &[&str], expected: &[&str]| {
        expect_refusal(folder.path(), &[&["identify"], arguments].concat(), expected);
    };
    refuse(&["a.csv", "--jsonl", "old.jsonl"], &["found old.jsonl with lines in it", "--resume"]);
    refuse(&["a.csv", "--jsonl", "old.jsonl", "--resume"], &["line 1: found another JSON"]);
    refuse(&["empty", "--jsonl", "new.jsonl"], &["found no recording", "csv"]);
    refuse(&["empty"], &["empty: found a folder", "--jsonl"]);
    refuse(&["a.csv", "--resume"], &["--jsonl"]);
}
