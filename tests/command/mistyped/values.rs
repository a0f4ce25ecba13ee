//! Mistyped values of options.

use super::{RIG, Row, expect, fault, folder, judge};

const DURATION: &str = "allowed: a duration greater than 0 with its unit, such as 20s or 500ms";
const TRAVEL: &str = "allowed: more than 0 m, as a number in m or with one of the units m, mm, cm, um, in";
const SPEED: &str = "allowed: more than 0 m/s, as a number in m/s or with one of the units m/s, mm/s";
const LENGTH: &str = "allowed: a number in m or with one of the units m, mm, cm, um, in";
const COMMAND: &str = "allowed: a valve command in [-1, 1], such as 0.2 or 20%";
const WHOLE: &str = "allowed: a whole number of 0 or more";

const ROWS: &[Row] = &[
    ("run four.toml --lockstep --duration 20", &["--duration: found \"20\"; ", DURATION, "next: hydraxis run --help"]),
    ("run four.toml --lockstep --duration 5sx", &["--duration: found \"5sx\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration -5s", &["--duration: found \"-5s\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration 0s", &["--duration: found \"0s\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration NaN", &["--duration: found \"NaN\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration inf", &["--duration: found \"inf\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration 99999999999999999999s", &["--duration: found \"999", DURATION, "next: "]),
    ("run four.toml --lockstep --duration ''", &["--duration: found \"\"; ", DURATION, "next: "]),
    ("run four.toml --lockstep --duration 3ms", &["--duration: found 3ms; allowed: 10ms or more, one period"]),
    (
        "simulate four.toml --duration 1s --seed -1",
        &["--seed: found \"-1\"; ", WHOLE, "next: hydraxis simulate --help"],
    ),
    ("simulate four.toml --duration 1s --seed 1.5", &["--seed: found \"1.5\"; ", WHOLE, "next: "]),
    ("simulate four.toml --duration 1s --seed abc", &["--seed: found \"abc\"; ", WHOLE, "next: "]),
    ("simulate four.toml --duration 1s --seed 99999999999999999999", &["--seed: found \"9999", WHOLE, "next: "]),
    ("simulate four.toml --duration 1s --seed ''", &["--seed: found \"\"; ", WHOLE, "next: "]),
    ("commission four.toml --axis bucket --travel -300mm", &["--travel: found \"-300mm\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel 0", &["--travel: found \"0\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel NaN", &["--travel: found \"NaN\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel inf", &["--travel: found \"inf\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel 5kg", &["--travel: found \"5kg\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel '300 mmm'", &["--travel: found \"300 mmm\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel ''", &["--travel: found \"\"; ", TRAVEL, "next: "]),
    ("commission four.toml --axis bucket --travel 300", &["--travel: found 300 m; allowed: up to 1.02 m", "bucket"]),
    ("commission four.toml --axis bucket --travel 3000mm", &["--travel: found 3 m; allowed: up to 1.02 m", "bucket"]),
    ("commission four.toml --axis bucket --speed 50mm", &["--speed: found \"50mm\"; ", SPEED, "next: "]),
    ("commission four.toml --axis bucket --speed 0mm/s", &["--speed: found \"0mm/s\"; ", SPEED, "next: "]),
    ("commission four.toml --axis bucket --speed -1", &["--speed: found \"-1\"; ", SPEED, "next: "]),
    ("commission four.toml --axis bucket --speed fast", &["--speed: found \"fast\"; ", SPEED, "next: "]),
    (
        "commission four.toml --duration 60",
        &["--duration: found \"60\"; ", DURATION, "next: hydraxis commission --help"],
    ),
    ("operate --prefix nobody --mode hold --target 300mmm", &["--target: found \"300mmm\"; ", LENGTH, "next: "]),
    ("operate --prefix nobody --mode hold --target NaN", &["--target: found \"NaN\"; ", LENGTH, "next: "]),
    ("operate --prefix nobody --mode hold --target inf", &["--target: found \"inf\"; ", LENGTH, "next: "]),
    ("operate --prefix nobody --mode hold --target 5kg", &["--target: found \"5kg\"; ", LENGTH, "next: "]),
    ("operate --prefix nobody --mode hold --target ''", &["--target: found \"\"; ", LENGTH, "next: "]),
    ("operate --prefix nobody --mode manual --command 1.5", &["--command: found \"1.5\"; ", COMMAND, "next: "]),
    ("operate --prefix nobody --mode manual --command -2", &["--command: found \"-2\"; ", COMMAND, "next: "]),
    ("operate --prefix nobody --mode manual --command 150%", &["--command: found \"150%\"; ", COMMAND, "next: "]),
    ("operate --prefix nobody --mode manual --command full", &["--command: found \"full\"; ", COMMAND, "next: "]),
    ("operate --prefix nobody --mode manual --command ''", &["--command: found \"\"; ", COMMAND, "next: "]),
    ("operate --prefix nobody --mode hold --duration 5", &["--duration: found \"5\"; ", DURATION, "next: "]),
    ("doctor --seconds 0", &["--seconds: found \"0\"; allowed: a whole number from 1 to 86400", "next: "]),
    ("doctor --seconds 5s", &["--seconds: found \"5s\"; allowed: a whole number from 1 to 86400", "next: "]),
    ("doctor --seconds -5", &["--seconds: found \"-5\"; allowed: a whole number from 1 to 86400", "next: "]),
    ("identify record.csv --period 0ms", &["--period: found \"0ms\"; allowed: seconds from 1e-9", "20ms", "next: "]),
    ("identify record.csv --period -10ms", &["--period: found \"-10ms\"; allowed: seconds from 1e-9", "next: "]),
    ("identify record.csv --train 1.5", &["--train: found \"1.5\"; allowed: a whole number of rows, or a fraction"]),
    ("identify record.csv --train 40%", &["--train: found \"40%\"; allowed: a whole number of rows, or a fraction"]),
    ("identify record.csv --na 99", &["--na: found \"99\"; allowed: a whole number from 1 to 5", "next: "]),
    ("identify record.csv --nk 0", &["--nk: found \"0\"; allowed: a whole number from 1 to 1024", "next: "]),
    ("identify record.csv --order three", &["--order: found \"three\"; allowed: a whole number from 1 to 5", "next: "]),
    ("identify record.csv --estimator papr", &["--estimator: found \"papr\"; allowed: \"auto\"", "`paper`?", "next: "]),
    ("identify record.csv --estimator constant:2", &["--estimator: found \"constant:2\"", "L from 0.5 to 1", "next: "]),
    ("identify record.csv --forgetting 0.99", &["--forgetting: found \"0.99\"; allowed: `--estimator`, its new name"]),
    (
        "identify record.csv --form liner",
        &["--form: found \"liner\"; allowed: one of linear, full", "`linear`?", "next"],
    ),
    ("identify record.csv --split alss", &["--split: found \"alss\"; allowed: one of als, paper", "`als`?", "next: "]),
    ("identify record.csv --horizon 0.5", &["--horizon: found \"0.5\"; allowed: a whole number of samples, or a dur"]),
    (
        "identify record.csv --dead-band -0.1",
        &["--dead-band: found \"-0.1\"; allowed: one number of at least 0", "next"],
    ),
    ("identify record.csv --knots 0.5,0.2", &["--knots: found \"0.5,0.2\"; allowed: 1 to 5 rising numbers", "next: "]),
    ("identify record.csv --integrator=yes", &["--integrator: found \"yes\"; allowed: one of true, false", "next: "]),
    ("identify record.csv --error-universe 0", &["--error-universe: found \"0\"; allowed: a number greater than 0"]),
    ("bench control --dead-time 10", &["--dead-time: found \"10\"; ", DURATION, "next: hydraxis bench control --help"]),
    ("bench control --dead-time 10ms,x", &["--dead-time: found \"x\"; ", DURATION, "next: "]),
    ("bench control --seeds 0", &["--seeds: found \"0\"; allowed: a whole number from 1 to 1000", "next: "]),
    ("bench control --seeds many", &["--seeds: found \"many\"; allowed: a whole number from 1 to 1000", "next: "]),
    ("bench control --machines 0", &["--machines: found \"0\"; allowed: a whole number from 1 to 100000", "next: "]),
    ("bench control --threads 0", &["--threads: found \"0\"; allowed: a whole number from 1 to 65535", "next: "]),
    ("bench control --machines 5 --only 17", &["--only: found 17; allowed: 0 to 4"]),
    ("bench control --controller mpc", &["--controller: found \"mpc\"; allowed: one of pi", "`mpc-held` or", "next: "]),
    ("bench control --machines 3 --half first", &["--half: found \"first\"; allowed: one of design, judge", "next: "]),
    ("bench control --scenario paylod", &["scenario: found paylod", "\"nominal\" or", "did you mean `payload`?"]),
    ("simulate four.toml --duration 1s --scenario paylod", &["four.toml: scenario: found paylod", "`payload`?"]),
    ("example watch", &["example: found \"watch\"; allowed: one of excavator.toml", "did you mean `watch.py`"]),
    ("example wach.py", &["example: found \"wach.py\"; allowed: one of", "did you mean `watch.py`?"]),
    ("completions bsh", &["SHELL: found \"bsh\"; allowed: one of bash, elvish", "did you mean `bash`", "next: "]),
    ("completions nushell", &["SHELL: found \"nushell\"; allowed: one of bash, elvish, fish", "next: "]),
];

/// A flag of `init` with a bad value, and parts of the answer.
const INIT: &[(&str, &str, &[&str])] = &[
    ("--bore", "-63mm", &["allowed: more than 0, 25 mm to 500 mm, as a number in m or with one of the units m, mm"]),
    ("--bore", "0", &["allowed: more than 0, 25 mm to 500 mm"]),
    ("--bore", "63 mmm", &["allowed: 25 mm to 500 mm", "units m, mm, cm, um, in"]),
    ("--bore", "63", &["allowed: 25 mm to 500 mm", "a number in m"]),
    ("--rod", "-5", &["allowed: more than 0, 10 mm to 45 mm"]),
    ("--stroke", "-0.5", &["allowed: more than 0, 50 mm to 10000 mm"]),
    ("--stroke", "5kg", &["allowed: 50 mm to 10000 mm", "units m, mm"]),
    ("--stroke", "NaN", &["allowed: 50 mm to 10000 mm"]),
    ("--stroke", "inf", &["allowed: 50 mm to 10000 mm"]),
    ("--stroke", "0,5", &["allowed: 50 mm to 10000 mm"]),
    ("--stroke", "boom=0.5", &["allowed: one value, or NAME=VALUE for each of the axes cylinder"]),
    ("--valve-hz", "-8", &["allowed: more than 0, 1 Hz to 100 Hz", "units Hz, kHz"]),
    ("--valve-hz", "8 Hertz", &["allowed: 1 Hz to 100 Hz", "units Hz, kHz"]),
    ("--dead-time", "40", &["allowed: 0 ms to 1000 ms", "units s, ms"]),
    ("--dead-time", "-40ms", &["allowed: 0 ms to 1000 ms"]),
    ("--speed", "-1m/s", &["allowed: more than 0, ", "units m/s, mm/s"]),
    ("--mass", "-5kg", &["allowed: more than 0, 41 kg", "units kg, t"]),
    ("--load", "-9e9N", &["allowed: -13 kN to 20 kN"]),
    ("--load", "heavy", &["allowed: -13 kN to 20 kN", "units N, kN"]),
    ("--dead-band", "-10%", &["allowed: 0 % to 60 %"]),
    ("--dead-band", "70%", &["allowed: 0 % to 60 %"]),
    ("--resolution", "-50um", &["allowed: more than 0, 1 um to"]),
    ("--pressure", "-210bar", &["allowed: more than 0, 50 bar to 400 bar"]),
    ("--pressure", "210", &["allowed: 50 bar to 400 bar", "units Pa, bar"]),
    ("--pressure", "210Bar", &["allowed: 50 bar to 400 bar", "units Pa, bar"]),
    ("--period", "-10ms", &["allowed: more than 0, 1 ms to 50 ms"]),
    (
        "--source",
        "externl",
        &["allowed: one of sim, can, external", "did you mean `external`?", "next: hydraxis init --help"],
    ),
    ("--axes", "a b", &["allowed: 1 to 8 different names, with commas"]),
    ("--axes", "boom,boom", &["allowed: 1 to 8 different names"]),
    ("--axes", "", &["allowed: 1 to 8 different names"]),
    ("--name", "", &["allowed: a text that names the machine, or no --name"]),
];

#[test]
fn a_mistyped_value_is_answered_with_what_is_allowed() {
    expect(ROWS);
}

#[test]
fn a_mistyped_flag_of_init_is_answered_with_its_range_and_units() {
    let folder = folder();
    let faults = INIT.iter().filter_map(|(flag, value, expected)| {
        let line = match RIG.split_once(&format!("{flag} ")) {
            Some((before, after)) => {
                let rest = after.split_once(' ').map_or("", |(_, rest)| rest);
                format!("{before}{flag} '{value}' {rest}")
            }
            None => format!("{RIG} {flag} '{value}'"),
        };
        let found = format!("{flag}: found \"{value}\"; ");
        fault(folder.path(), &line, &[&[found.as_str()][..], expected].concat())
    });
    judge(INIT.len(), faults.collect());
}
