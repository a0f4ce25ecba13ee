//! Recordings as loggers write them: several files, gaps, formats, units, time stamps.

use std::{fs, path::Path};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{
    harness::cli::{expect_refusal, refusal, success},
    identify::plant::{csv, expect_coefficients, figures, folder_with, number, simulate, timeless},
};

/// The constant plant at this row as fields of another format.
fn rows(count: usize, line: impl Fn(usize, [f64; 3]) -> String) -> String {
    simulate(count, |_| 1.0).iter().enumerate().map(|(k, row)| line(k, *row) + "\n").collect()
}

/// A number with a decimal comma.
fn comma(value: f64) -> String {
    value.to_string().replace('.', ",")
}

/// The report of a file with these bytes, whose rows are those of the constant plant.
fn expect_plant(bytes: &[u8], arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("r.csv"), bytes).unwrap();
    let figures = figures(folder.path(), arguments);
    expect_coefficients(&figures, "classical");
    assert!((number(&figures, "/period_s") - 0.01).abs() < 1e-9, "{}", figures["period_s"]);
    figures
}

fn text_report(folder: &TempDir, arguments: &[&str]) -> String {
    success(folder.path(), &[&["identify", "r.csv"], arguments].concat())
}

fn write(folder: &TempDir, name: &str, record: &[[f64; 3]]) {
    fs::write(folder.path().join(name), csv("t,u,y", record)).unwrap();
}

#[test]
fn a_gap_of_four_seconds_leaves_the_period_as_it_is() {
    let late = |k: usize, [t, u, y]: [f64; 3]| format!("{},{u},{y}", if k < 400 { t } else { t + 4.0 });
    let figures = expect_plant(format!("t,u,y\n{}", rows(600, late)).as_bytes(), &[]);
    assert_eq!(figures["recordings"][0]["gaps"]["missing_rows"], 1);
    assert_eq!(figures["recordings"][0]["gaps"]["places"][0]["line"], 402);
    assert!((number(&figures, "/recordings/0/gaps/places/0/seconds") - 4.01).abs() < 1e-9);
    assert!(number(&figures, "/classical/h_step/max") < 1e-6, "nothing is predicted over the gap");
}

#[test]
fn rows_that_are_missing_or_have_an_empty_field_break_the_history_and_are_told() {
    let broken = |k: usize, [t, u, y]: [f64; 3]| match k {
        100 => format!("{t},,{y}"),
        200 => format!("{t},{u}"),
        300 => format!(",{u},{y}"),
        _ => format!("{t},{u},{y}"),
    };
    let mut lines: Vec<String> = rows(600, broken).lines().map(str::to_owned).collect();
    lines.drain(450..460);
    let text = format!("t,u,y\n{}\n", lines.join("\n"));
    let figures = expect_plant(text.as_bytes(), &[]);
    let gaps = &figures["recordings"][0]["gaps"];
    assert_eq!((&gaps["empty_rows"], &gaps["missing_rows"]), (&json!(3), &json!(1)));
    let places: Vec<_> = gaps["places"].as_array().unwrap().iter().map(|gap| gap["line"].as_u64().unwrap()).collect();
    assert_eq!(places, [102, 202, 302, 452]);
    assert!(number(&figures, "/classical/h_step/max") < 1e-6 && number(&figures, "/classical/free_run/max") < 1e-6);
    let told = text_report(&folder_with(&text), &[]);
    let expected = "r.csv: gaps, over which nothing is combined: 3 rows with an empty field, 1 place with missing \
                    rows: line 102 (\"u\" empty), line 202 (\"y\" empty), line 302 (\"t\" empty), line 452 (0.11000 s \
                    after the row before)\n";
    assert!(told.contains(expected), "{told}");
}

#[test]
fn a_row_before_a_gap_is_in_no_regressor_of_a_row_after_it() {
    // Each stretch of 100 rows is a plant of its own with another beginning; only rows over a gap would fit badly.
    let restarted = |k: usize, [t, u, y]: [f64; 3]| format!("{},{u},{y}", t + 7.0 * (k / 100) as f64);
    let shuffled = rows(600, restarted);
    let mut stretches: Vec<Vec<&str>> = shuffled.lines().collect::<Vec<_>>().chunks(100).map(<[_]>::to_vec).collect();
    stretches.reverse();
    let text = format!("t,u,y\n{}\n", stretches.concat().join("\n"));
    let figures = expect_plant(text.as_bytes(), &["--select", "--horizon", "10"]);
    assert_eq!(figures["recordings"][0]["gaps"]["times_not_rising"], 5);
    assert!(number(&figures, "/classical/one_step/max") < 1e-9, "{}", figures["classical"]["one_step"]);
}

#[test]
fn times_that_do_not_rise_are_told() {
    let told = |k: usize, [t, u, y]: [f64; 3]| match k {
        100 => format!("{},{u},{y}", t - 0.01),
        0..200 => format!("{t},{u},{y}"),
        _ => format!("{},{u},{y}", t - 1.5),
    };
    let text = format!("t,u,y\n{}", rows(600, told));
    let figures = expect_plant(text.as_bytes(), &[]);
    assert_eq!(figures["recordings"][0]["gaps"]["times_not_rising"], 2);
    let report = text_report(&folder_with(&text), &[]);
    assert!(report.contains("2 times that do not rise: line 102 (the time of the row before)"), "{report}");
    assert!(report.contains("line 202 (1.4900 s backwards)"), "{report}");
    let coarse = |_: usize, [t, u, y]: [f64; 3]| format!("{},{u},{y}", t.floor());
    let folder = folder_with(&format!("t,u,y\n{}", rows(600, coarse)));
    let expected = ["594 of 599 steps that do not rise in column \"t\"", "--time none", "--period"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
    success(folder.path(), &["identify", "r.csv", "--time", "none", "--period", "10ms"]);
}

#[test]
fn separators_decimal_commas_and_encodings_are_found() {
    let plain = expect_plant(csv("t,u,y", &simulate(600, |_| 1.0)).as_bytes(), &[]);
    let points = |mark: &'static str| move |_: usize, row: [f64; 3]| row.map(|x| x.to_string()).join(mark);
    let commas = |mark: &'static str| move |_: usize, row: [f64; 3]| row.map(comma).join(mark);
    let semicolons = rows(600, commas(";"));
    for (text, expected) in [
        (format!("t;u;y\n{semicolons}"), ["semicolons", "decimal commas"]),
        (format!("t\tu\ty\r\n{}", rows(600, points("\t")).replace('\n', "\r\n")), ["tabs", "decimal points"]),
        (format!("  t   u y\n{}", rows(600, points("   "))), ["blanks", "decimal points"]),
        (format!("t u y\n{}", rows(600, commas(" "))), ["blanks", "decimal commas"]),
        (
            format!("t,u,y\n{}", rows(600, |_, row| row.map(|x| format!("\"{}\"", comma(x))).join(","))),
            ["commas", "decimal commas"],
        ),
    ] {
        let figures = expect_plant(text.as_bytes(), &[]);
        let found = &figures["recordings"][0];
        assert_eq!([&found["separator"], &found["decimal"]], expected.map(|text| json!(text)).each_ref());
        assert_eq!(timeless(figures.clone())["classical"], plain["classical"], "the same bits in every format");
    }
    let marked = [b"\xef\xbb\xbft;u;y\n", semicolons.as_bytes()].concat();
    assert_eq!(expect_plant(&marked, &[])["recordings"][0]["encoding"], "UTF-8 with a byte order mark");
    let latin = [b"t;u;Winkel [\xb0]\n", semicolons.as_bytes()].concat();
    let figures = expect_plant(&latin, &["--output", "Winkel"]);
    assert_eq!((&figures["recordings"][0]["encoding"], &figures["unit"]), (&json!("Latin-1"), &json!("deg")));
}

#[test]
fn columns_are_chosen_by_name_or_number_and_a_header_may_be_missing() {
    let named = rows(600, |k, [t, u, y]| format!("{k};{t};{u};{y}"));
    let text = format!("No.;Time;Valve command;Rod position [mm]\n{named}");
    for (input, output) in [("Valve command", "4"), ("3", "Rod position"), ("3", "Rod position [mm]")] {
        let folder = folder_with(&text);
        let arguments = ["--input", input, "--output", output, "--horizon", "50"];
        let report = text_report(&folder, &arguments);
        let expected = "r.csv: semicolons, decimal points, UTF-8; time \"Time\" in s, input \"Valve command\", output \
                        \"Rod position [mm]\" in mm, read as m\n";
        assert!(report.contains(expected) && report.contains("error, m "), "{report}");
        assert_eq!(figures(folder.path(), &arguments)["unit"], "m");
    }
    expect_plant(named.as_bytes(), &["--time", "2", "--input", "3", "--output", "4"]);
    let folder = folder_with(&named);
    let expected =
        ["r.csv:1: found no header, and no column \"u\"; allowed: a header, or numbers of columns from 1 to 4"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
    let arguments = ["identify", "r.csv", "--input", "3", "--output", "5"];
    expect_refusal(folder.path(), &arguments, &["no column \"5\"", "1 to 4", "--output"]);
}

#[test]
fn units_come_from_a_row_below_the_header_or_from_an_option() {
    let scaled = |_: usize, [t, u, y]: [f64; 3]| format!("{};{};{}", comma(1e3 * t), comma(100.0 * u), comma(1e3 * y));
    let rows = rows(600, scaled);
    let figures = expect_plant(format!("t;u;y\nms;%;[mm]\n{rows}").as_bytes(), &[]);
    let found = &figures["recordings"][0];
    assert_eq!((&found["units_row"], &figures["unit"]), (&json!(true), &json!("m")));
    assert_eq!((&found["time"]["unit"], &found["input"]["becomes"]), (&json!("ms"), &json!("1")));
    let stated = ["--unit", "t=ms", "--unit", "u=%", "--unit", "3=mm"];
    expect_plant(format!("t;u;y\n{rows}").as_bytes(), &stated);
    expect_plant(format!("t;u;y\ns;V;furlong\n{rows}").as_bytes(), &stated);

    let folder = folder_with(&format!("t;u;y\nms;%;furlong\n{rows}"));
    let allowed = "found the unit \"furlong\"; allowed: m, mm, cm, um, in, %, deg, rad";
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv:2: ", "column \"y\"", allowed, "--unit \"y=UNIT\""]);
    let arguments = ["identify", "r.csv", "--unit", "y=furlong"];
    expect_refusal(folder.path(), &arguments, &["--unit with the unit \"furlong\" for column \"y\"", "m, mm, cm"]);
    let arguments = ["identify", "r.csv", "--unit", "z=mm"];
    expect_refusal(folder.path(), &arguments, &["--unit with the column \"z\"", "\"u\", \"y\", \"t\""]);
    expect_refusal(folder.path(), &["identify", "r.csv", "--unit", "mm"], &["--unit", "allowed: COLUMN=UNIT"]);
    // By its name and by its number.
    let arguments = ["identify", "r.csv", "--unit", "y=mm", "--unit", "3=cm"];
    expect_refusal(folder.path(), &arguments, &["--unit twice for one column", "\"3=cm\"", "one unit for each column"]);
}

#[test]
fn milliseconds_without_a_unit_are_questioned() {
    let folder = folder_with(&format!("t,u,y\n{}", rows(600, |k, [_, u, y]| format!("{},{u},{y}", 10 * k))));
    let warning = "warning: r.csv: the times are taken as seconds, a second or more apart; otherwise state their unit: \
                   --unit \"t=ms\" for milliseconds";
    let is_warned = |options: &[&str]| {
        let told = success(folder.path(), &[&["identify", "r.csv"], options].concat());
        let doubtful = figures(folder.path(), options)["recordings"][0]["is_time_doubtful"] == true;
        assert_eq!(told.contains(warning), doubtful, "{told}");
        doubtful
    };
    assert!(is_warned(&[]) && !is_warned(&["--unit", "t=s"]) && !is_warned(&["--period", "10ms"]));
    assert_eq!(number(&figures(folder.path(), &[]), "/period_s"), 10.0);
    assert!((number(&figures(folder.path(), &["--unit", "t=ms"]), "/period_s") - 0.01).abs() < 1e-12);
    assert_eq!(number(&figures(folder.path(), &["--unit", "t=s"]), "/period_s"), 10.0);
    assert_eq!(number(&figures(folder.path(), &["--period", "10ms"]), "/period_s"), 0.01);
    for header in ["t [ms],u,y", "t_ms,u,y", "Time (ms),u,y", "Timestamp [ms],u,y"] {
        expect_plant(format!("{header}\n{}", rows(600, |k, [_, u, y]| format!("{},{u},{y}", 10 * k))).as_bytes(), &[]);
    }
    expect_plant(format!("t,u,y\nus,1,-\n{}", rows(600, |k, [_, u, y]| format!("{}0000,{u},{y}", k))).as_bytes(), &[]);
}

#[test]
fn a_period_that_the_times_contradict_is_told() {
    let folder = folder_with(&format!("t,u,y\n{}", rows(600, |_, [t, u, y]| format!("{t},{u},{y}"))));
    let of_the_times = number(&figures(folder.path(), &[]), "/period_s");
    let told = |factor: f64| {
        let period = format!("{}", factor * of_the_times);
        let options = ["--period", period.as_str()];
        let told = success(folder.path(), &[&["identify", "r.csv"], &options[..]].concat());
        let found = figures(folder.path(), &options)["recordings"][0]["contradicting_period_s"].as_f64();
        assert_eq!(told.contains("warning: r.csv: --period is used, though the times are"), found.is_some(), "{told}");
        found
    };
    assert_eq!((told(1.0), told(1.05), told(2.0)), (None, None, Some(of_the_times)));
}

#[test]
fn date_times_and_clock_times_are_found() {
    let clock = |k: usize| format!("{:02}:{:02}:{:02}.{:02}0", k / 360_000 % 24, k / 6000 % 60, k / 100 % 60, k % 100);
    let date = |k: usize, [_, u, y]: [f64; 3]| format!("2026-11-23T{}+01:00,{u},{y}", clock(7_200_000 + k));
    let figures = expect_plant(format!("t,u,y\n{}", rows(600, date)).as_bytes(), &[]);
    assert_eq!(figures["recordings"][0]["time_form"], "date-times");
    // Over midnight.
    let night = |k: usize, [_, u, y]: [f64; 3]| format!("{}\t{u}\t{y}", clock(8_639_900 + k));
    let figures = expect_plant(format!("Time stamp\tu\ty\n{}", rows(600, night)).as_bytes(), &[]);
    assert_eq!(figures["recordings"][0]["time_form"], "clock times");
    assert_eq!(figures["recordings"][0]["gaps"]["places"], json!([]));
    let folder = folder_with("t,u,y\n10:00:00.00,1,2\n10:00:0x.01,1,2\n");
    let expected = ["r.csv:3: row 2, column \"t\": found \"10:00:0x.01\"; allowed: a number, a date-time such as"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
}

#[test]
fn files_that_are_no_recordings_are_refused_with_the_place() {
    for (bytes, expected) in [
        (
            &b"t,u,y\n0,01,0,5,1,5\n"[..],
            "r.csv:2: found 6 fields; allowed: 3 fields, as in the first row (a decimal comma",
        ),
        (b"t;u;y\n0,1;0.5;1\n", "r.csv:2: row 1, column \"u\": found \"0.5\"; allowed: decimal commas"),
        (b"t,u,y\n0,\"1,2\n1,2,3\n", "r.csv:2: found the quoted field \"1,2..\" over several lines"),
        (b"\xff\xfet\0", "found text in UTF-16; allowed: a CSV file with a header"),
        (b"t,u,y\0", "found a file that is no text"),
        (b"t,u,u,y\n0,1,2,3\n", "r.csv:1: found column \"u\" twice; allowed: each name once, or the number"),
        (b"t,u,y\n0,1,1\n1,,2\n2,1,3\n", "found a gap between all rows, so no period in column \"t\""),
        (b"t,u,y\n0,,1\n1,,2\n2,,3\n", "found 0 rows; allowed: at least 2 rows without an empty field"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("r.csv"), bytes).unwrap();
        expect_refusal(folder.path(), &["identify", "r.csv"], &[expected]);
    }
}

#[test]
fn several_recordings_are_trained_on_and_others_are_for_the_test() {
    let record = simulate(900, |_| 1.0);
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "a.csv", &record[..300]);
    write(&folder, "b.csv", &record[500..700]);
    write(&folder, "c.csv", &record[700..]);
    let report = |arguments: &[&str]| -> Value {
        serde_json::from_str(&success(folder.path(), &[&["identify"], arguments, &["--json", "-"]].concat())).unwrap()
    };
    let both = report(&["a.csv", "b.csv", "--test", "c.csv"]);
    assert_eq!((&both["rows"], &both["train"]), (&json!(700), &json!(500)));
    expect_coefficients(&both, "classical");
    assert!(number(&both, "/classical/one_step/max") < 1e-9 && number(&both, "/classical/h_step/max") < 1e-6);
    let tests: Vec<bool> =
        both["recordings"].as_array().unwrap().iter().map(|r| r["test"].as_bool().unwrap()).collect();
    assert_eq!(tests, [false, false, true]);
    let split = report(&["a.csv", "b.csv"]);
    assert_eq!((&split["rows"], &split["train"]), (&json!(500), &json!(250)));
    let two = report(&["a.csv", "--test", "b.csv", "--test", "c.csv", "--select", "--horizon", "10"]);
    assert_eq!((&two["rows"], &two["train"]), (&json!(700), &json!(300)));

    let refused = "--test: found a.csv, which is a recording for training as well";
    expect_refusal(folder.path(), &["identify", "a.csv", "b.csv", "--test", "./a.csv"], &[refused]);
    // A copy of it is the same recording, and twice the same is no more than once.
    fs::copy(folder.path().join("a.csv"), folder.path().join("copy.csv")).unwrap();
    expect_refusal(folder.path(), &["identify", "a.csv", "b.csv", "--test", "copy.csv"], &[refused]);
    let twice = "found copy.csv, which is a.csv once more; allowed: each recording once";
    expect_refusal(folder.path(), &["identify", "a.csv", "copy.csv"], &[twice]);
    let told = success(folder.path(), &["identify", "a.csv", "b.csv", "--test", "c.csv"]);
    assert!(told.contains("\na.csv .. c.csv (3 recordings): commas, decimal points, UTF-8; time \"t\" in s"), "{told}");
    assert!(told.contains("a.csv .. b.csv (2 recordings), tested on c.csv: 700 rows of 0.010000 s, 500"), "{told}");
    expect_refusal(folder.path(), &["identify", "a.csv", "--test", "c.csv", "--train", "9"], &["--train", "--test"]);
}

#[test]
fn recordings_that_do_not_belong_together_are_refused() {
    let record = simulate(600, |_| 1.0);
    let slower: Vec<[f64; 3]> = record.iter().map(|[t, u, y]| [2.0 * t, *u, *y]).collect();
    let folder = folder_with(&csv("t,u,y", &record));
    write(&folder, "slower.csv", &slower);
    fs::write(folder.path().join("mm.csv"), csv("t,u,y [mm]", &record)).unwrap();
    let expected = ["slower.csv: found a period of 0.020000 s; allowed: 0.010000 s, as before it (r.csv)"];
    expect_refusal(folder.path(), &["identify", "r.csv", "slower.csv"], &expected);
    let expected = ["mm.csv: found the unit m for column \"y [mm]\"; allowed: no unit, as in r.csv", "--unit"];
    expect_refusal(folder.path(), &["identify", "r.csv", "mm.csv"], &expected);
    let errors = refusal(folder.path(), &["identify", "r.csv", "absent.csv"]);
    assert!(errors.contains("absent.csv: found a file that cannot be read"), "{errors}");
}

#[test]
fn gaps_that_leave_too_few_rows_are_refused() {
    let torn = |k: usize, [t, u, y]: [f64; 3]| format!("{},{u},{y}", t + (k / 3) as f64);
    let folder = folder_with(&format!("t,u,y\n{}", rows(600, torn)));
    let expected = ["r.csv: found", "rows for training with", "that have no gap; allowed: at least 15"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
    let tail = |k: usize, [t, u, y]: [f64; 3]| format!("{},{u},{y}", t + (k.saturating_sub(290) / 10) as f64);
    let folder = folder_with(&format!("t,u,y\n{}", rows(600, tail)));
    expect_refusal(folder.path(), &["identify", "r.csv"], &["rows for the test without a gap; allowed: at least 51"]);
}

/// Command of the `number`-th step test at `k` x 10 ms: one amplitude each for extension and retraction.
fn step_test(number: usize, k: usize) -> f64 {
    let up = 0.25 + 0.65 * (7 * number % 28) as f64 / 28.0;
    // The boom sinks as well; so all tests in a row stay between the end stops.
    let down = 0.85 * (0.25 + 0.65 * (11 * number % 28) as f64 / 28.0);
    match k % 600 {
        100..140 => up,
        250..290 => -down,
        400..430 => 0.7 * up,
        500..530 => -0.7 * down,
        _ => 0.0,
    }
}

/// Position of the boom under these commands, from rest, as a recording.
fn recorded(folder: &Path, name: &str, commands: impl Iterator<Item = f64>) {
    let rows: String = commands.enumerate().map(|(k, u)| format!("{},{u}\n", k as f64 / 100.0)).collect();
    fs::write(folder.join("u.csv"), format!("t,boom\n{rows}")).unwrap();
    fs::copy("examples/four-axes.toml", folder.join("machine.toml")).unwrap();
    let arguments = [
        "simulate",
        "machine.toml",
        "--open-loop",
        "u.csv",
        "--scenario",
        "nominal",
        "--axis",
        "boom",
        "--trajectory",
        name,
    ];
    crate::harness::cli::run(folder, &arguments);
    assert!(folder.join(name).exists(), "{name}");
}

#[test]
fn merged_step_tests_give_a_model_as_good_as_that_of_a_continuous_record() {
    const ROWS: usize = 1200;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let names: Vec<String> = (0..28).map(|number| format!("step{number:02}.csv")).collect();
    for (number, name) in names.iter().enumerate() {
        recorded(folder, name, (0..ROWS).map(|k| step_test(number, k)));
    }
    recorded(folder, "continuous.csv", (0..28 * ROWS).map(|k| step_test(k / ROWS, k % ROWS)));
    // Amplitudes between those of the training.
    recorded(folder, "unseen.csv", (0..ROWS).map(|k| 0.97 * step_test(13, k)));
    let h_step = |training: &[&str]| {
        let columns = ["--input", "boom.command", "--output", "boom.position", "--test", "unseen.csv", "--json", "-"];
        let text = success(folder, &[&["identify"], training, &columns].concat());
        let figures: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(figures["train"], 28 * ROWS);
        ["classical", "adaptive"].map(|model| number(&figures, &format!("/{model}/h_step/rmse")))
    };
    let merged = h_step(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let continuous = h_step(&["continuous.csv"]);
    println!("h-step rmse, classical and adaptive: merged {merged:?}, continuous {continuous:?}");
    for (merged, continuous) in merged.iter().zip(continuous) {
        assert!((merged / continuous - 1.0).abs() < 0.1, "{merged} for {continuous}");
    }
}

#[test]
fn dropouts_of_the_sensor_are_left_out_and_told() {
    let dropped = |k: usize, [t, u, y]: [f64; 3]| {
        let y = if (100..140).contains(&k) || (220..223).contains(&k) { -40.0 } else { y };
        format!("{t},{u},{y}")
    };
    let text = format!("t,u,y\n{}", rows(600, dropped));
    let figures = expect_plant(text.as_bytes(), &[]);
    let expected = json!({ "count": 2, "rows": 43, "times_s": [1.0, 2.2] });
    assert_eq!(figures["recordings"][0]["dropouts"], expected);
    assert_eq!((&figures["recordings"][0]["rows"], &figures["outliers"]), (&json!(557), &json!(0)));
    assert!(number(&figures, "/classical/h_step/max") < 1e-6, "nothing is predicted over a dropout");
    let said = text_report(&folder_with(&text), &[]);
    let warning = "warning: r.csv: 43 rows left out, 2 dropouts of the sensor, in which the output stands and to or \
                   from which it jumps: after 1.0000 s, 2.2000 s\n";
    assert!(said.contains(warning), "{said}");
}
