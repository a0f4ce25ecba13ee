//! `hydraxis tip`: a task that is planned and shown without a motion.

use std::{fs, path::Path};

use serde_json::Value;
use tempfile::TempDir;

use crate::harness::cli::{expect_refusal, success};

/// The built-in machine, its level cut replaced by these pieces.
fn folder(pieces: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = pipeline::machine::BUILT_IN.replace("piece = [{ to = [3.7, 0.0] }]", &format!("piece = [{pieces}]"));
    fs::write(folder.path().join("m.toml"), text).unwrap();
    folder
}

fn figures(folder: &Path, more: &[&str]) -> Value {
    let words = [&["tip", "m.toml", "--json", "-"], more].concat();
    serde_json::from_str(&success(folder, &words)).unwrap()
}

#[test]
fn a_plan_is_shown_piece_by_piece_and_adds_up() {
    let folder = folder("{ to = [5.5, 0.0] }, { to = [3.7, 0.0] }, { to = [3.7, 0.8], pitch = -130 }");
    let found = figures(folder.path(), &[]);
    let pieces = found["pieces"].as_array().unwrap();
    assert_eq!(pieces.len(), 3);
    let sum = |key: &str| pieces.iter().map(|piece| piece[key].as_f64().unwrap()).sum::<f64>();
    for (key, all) in [("length", "length"), ("time", "duration")] {
        assert!((sum(key) - found[all].as_f64().unwrap()).abs() < 1e-6, "{key}: {found}");
    }
    for piece in pieces {
        let of = |key: &str| piece[key].as_f64().unwrap();
        assert!(of("speed") <= 0.35 + 1e-9 && of("load") < 1.0 && of("room") > 0.0, "{piece}");
        assert!(of("flow") > 0.0 && of("flow") < found["allowed_flow"].as_f64().unwrap(), "{piece}");
        assert_eq!(piece["reversals"], 0, "{piece}");
    }
    assert_eq!((&pieces[0]["limited_by"], &pieces[0]["piece"]), (&"task".into(), &"tip.piece[0]".into()));
    let text = success(folder.path(), &["tip", "m.toml"]);
    assert!(text.contains("tip.piece[2]") && text.contains("Chosen: axis.boom "), "{text}");
    // A load in the bucket is held.
    let load = |found: &Value| found["pieces"][0]["load"].as_f64().unwrap();
    assert!(load(&figures(folder.path(), &["--payload", "1500"])) > 1.3 * load(&found));
}

#[test]
fn a_boom_that_turns_round_is_counted_and_positions_by_hand_are_told() {
    let folder = folder("{ to = [5.5, 0.0] }, { to = [3.7, 0.0] }");
    let found = figures(folder.path(), &["--set", "tip.telescope=0.6"]);
    let reversals: u64 = found["pieces"].as_array().unwrap().iter().map(|p| p["reversals"].as_u64().unwrap()).sum();
    assert_eq!(reversals, 1, "{found}");
    assert!(found["chosen"].as_str().unwrap().starts_with("By hand: axis.telescope stays at 0.6 m"), "{found}");
    let found = figures(folder.path(), &["--set", "tip.boom=0.85"]);
    assert!(found["chosen"].as_str().unwrap().starts_with("By hand: axis.boom stays at 0.85 m"), "{found}");
    assert_eq!(found["pieces"][0]["axes"][0]["range"], serde_json::json!([0.85, 0.85]));
    let folder = self::folder("{ to = [5.5, 0.0], boom = 0.87 }, { to = [3.7, 0.0] }");
    let found = figures(folder.path(), &[]);
    assert!(found["chosen"].as_str().unwrap().contains("chose at the end of 1 piece"), "{found}");
}

/// Regression: a bucket that turned in place was said to move its teeth by 0.9 m.
#[test]
fn a_turn_in_place_is_shown_in_degrees() {
    let folder = folder("{ to = [6.7, 0.0] }, { to = [6.7, 0.0], pitch = -150 }");
    let found = figures(folder.path(), &[]);
    let of = |key: &str| found["pieces"][1][key].as_f64().unwrap();
    assert_eq!((of("length"), of("speed")), (0.0, 0.0), "{found}");
    assert!((of("turn") + 35.0).abs() < 1e-9 && of("turn_rate") > 5.0, "{found}");
    assert!((found["length"].as_f64().unwrap() - 0.5).abs() < 1e-9, "{found}");
    let text = success(folder.path(), &["tip", "m.toml", "--trajectory", "t.csv"]);
    assert!(text.contains("The teeth: 0.500 m in ") && text.contains(" turn, deg  deg/s "), "{text}");
    let row: Vec<&str> = text.lines().find(|line| line.contains("tip.piece[1]")).unwrap().split_whitespace().collect();
    assert_eq!((row[1], row[3], row[4]), ("0.000", "0.000", "-35.0"), "{text}");
    let csv = fs::read_to_string(folder.path().join("t.csv")).unwrap();
    let way: f64 = csv.lines().last().unwrap().split(',').nth(1).unwrap().parse().unwrap();
    assert!((way - 0.5).abs() < 1e-9, "{way}");
}

#[test]
fn a_payload_may_have_its_unit() {
    let folder = folder("{ to = [3.7, 0.0] }");
    let [plain, tonnes] = ["1500", "1.5t"].map(|payload| figures(folder.path(), &["--payload", payload]));
    assert_eq!((&plain, &plain["payload"]), (&tonnes, &1500.0.into()));
}

/// Regression: reading this took 19 s.
#[test]
fn far_too_many_pieces_are_refused_at_once() {
    let many = folder(&"{ to = [5.5, 0.0] },\n".repeat(20_000));
    let started = std::time::Instant::now();
    let expected = "tip.piece: found 20000 pieces; allowed: 1 to 100 tables [[tip.piece]], or a file";
    expect_refusal(many.path(), &["tip", "m.toml"], &[expected]);
    assert!(started.elapsed().as_secs_f64() < 5.0, "{:?}", started.elapsed());
}

#[test]
fn picture_and_trajectory_are_written_and_the_trajectory_is_the_plan() {
    let folder = folder("{ to = [3.7, 0.0] }");
    let words = ["tip", "m.toml", "--plot", "p.svg", "--trajectory", "t.csv"];
    success(folder.path(), &words);
    let svg = fs::read_to_string(folder.path().join("p.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    assert!(["axis.boom, m", "axis.telescope, m", "3.50 m in"].iter().all(|text| svg.contains(text)), "{svg}");
    let csv = fs::read_to_string(folder.path().join("t.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        csv.lines().skip(1).map(|row| row.split(',').map(|field| field.parse().unwrap()).collect()).collect();
    assert_eq!(csv.lines().next(), Some("t,way,x,z,pitch,boom,arm,telescope,bucket"));
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    assert_eq!(first[..4], [0.0, 0.0, 7.2, 0.0]);
    assert!((last[1] - 3.5).abs() < 1e-9 && (last[2] - 3.7).abs() < 1e-9, "{last:?}");
    // The file is a trajectory that an axis can follow by itself.
    let set = ["reference.kind=trajectory", "reference.file=t.csv"].map(|key| format!("axis.arm.{key}"));
    success(folder.path(), &["check", "m.toml", "--set", &set[0], "--set", &set[1]]);
}

#[test]
fn a_task_that_cannot_be_done_is_refused_with_what_is_in_the_way() {
    let folder = folder("{ to = [3.7, 0.0] }");
    let refuse = |more: &[&str], expected: &[&str]| {
        expect_refusal(folder.path(), &[&["tip", "m.toml"], more].concat(), expected);
    };
    refuse(
        &["--payload", "9000"],
        &["tip.piece[0]: found [", "axis.boom would have to hold", "allowed: -340 to 689 kN"],
    );
    refuse(&["--set", "tip.boom=0.6"], &["tip.piece[0]: found [", "where axis.telescope would have to be at"]);
    refuse(&["--set", "tip.boom=1.3"], &["where axis.boom would have to be at 1.300 m; allowed: 0.05 to 1.284 m"]);
    refuse(&["--set", "tip.boom=200"], &["tip.boom: found 200", "allowed: a number from 0 to 100 m"]);
    refuse(&["--set", "tip.boom=0.8", "--set", "tip.telescope=0.6"], &["tip.boom", "one of boom and telescope"]);
    refuse(&["--plot", "p.png"], &["--plot: found \"p.png\"; allowed: a file that ends with .svg"]);
    refuse(&["--json", "-", "--trajectory", "-"], &["--json: found -, as for --trajectory", "allowed: one of them"]);
    let four = pipeline::machine::FOUR_AXES;
    fs::write(folder.path().join("four.toml"), four).unwrap();
    expect_refusal(folder.path(), &["tip", "four.toml"], &["four.toml: tip: found nothing; allowed: a table [tip]"]);
    let by_piece = self::folder("{ to = [5.5, 0.0], boom = 0.87 }, { to = [3.7, 0.0] }");
    expect_refusal(
        by_piece.path(),
        &["tip", "m.toml", "--set", "tip.boom=0.85"],
        &["tip.piece[0]: found a position of its own beside tip.telescope or tip.boom; allowed: one"],
    );
    let both = self::folder("{ to = [5.5, 0.0], boom = 0.87, telescope = 0.5 }");
    expect_refusal(
        both.path(),
        &["tip", "m.toml"],
        &["tip.piece[0].boom: found 0.87 m beside telescope; allowed: one"],
    );
}
