//! Options and files that are refused: the message says where, what was found and what is allowed.

use std::fs;

use pipeline::machine::FOUR_AXES;

use super::{
    cli::{expect_refusal, refusal},
    folder_with,
};

/// Expects a refusal of the built-in machine with a scenario of its own. The message names the last line.
fn expect_bad_scenario(own: &str, expected: &str) {
    let text = format!("{FOUR_AXES}{own}\n");
    let place = format!("m.toml:{}: ", text.matches('\n').count());
    let folder = folder_with("m.toml", &text);
    expect_refusal(folder.path(), &["simulate", "m.toml"], &[&format!("{place}{expected}")]);
}

#[test]
fn an_unknown_scenario_is_refused_with_those_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let expected = "built-in machine: scenario: found lunar (from the command line); allowed: \"nominal\" or \
                    \"cold-start\" or \"payload\" or ";
    for command in ["simulate", "run", "check"] {
        expect_refusal(folder.path(), &[command, "--scenario", "lunar"], &[expected]);
    }
    expect_refusal(folder.path(), &["plant-sim", "--prefix", "x", "--scenario", "lunar"], &[expected]);
}

#[test]
fn scenarios_of_a_file_are_among_those_there_are() {
    let folder = folder_with("m.toml", &format!("{FOUR_AXES}\n[scenarios.own]\n"));
    expect_refusal(folder.path(), &["check", "m.toml", "--scenario", "lunar"], &["\"open-loop\" or \"own\""]);
}

#[test]
fn invalid_changes_are_refused() {
    for (change, expected) in [
        (
            "axis = \"crane\", parameter = \"mass\", factor = 2",
            "axis: found \"crane\"; allowed: one of the axes boom, arm, telescope, bucket",
        ),
        (
            "axis = \"boom\", parameter = \"pump_flow\", factor = 2",
            "axis: found \"boom\"; allowed: no axis: all axes share this parameter",
        ),
        ("parameter = \"mass\", factor = 0.01", "factor: found 0.01; allowed: a number from 0.05 to 20"),
        ("parameter = \"temperature\", value = 200", "value: found 200; allowed: a number from -40 to 120 degrees"),
        ("parameter = \"mass\", value = 2", "value: found an unknown key; allowed: one of axis, end, factor"),
        ("parameter = \"colour\", factor = 2", "parameter: found \"colour\"; allowed: \"flow_gain\" or \"friction\""),
    ] {
        let own = format!("[scenarios.own]\nchanges = [{{ {change}, start = 1, end = 2 }}]");
        expect_bad_scenario(&own, &format!("scenarios.own.changes[0].{expected}"));
    }
}

#[test]
fn a_change_that_ends_before_it_begins_is_refused() {
    let own = "[scenarios.own]\nchanges = [{ parameter = \"mass\", start = 3, end = 2, factor = 2 }]";
    expect_bad_scenario(own, "scenarios.own.changes[0].end: found 2; allowed: a time not before start, 3 s");
}

#[test]
fn run_refuses_an_open_loop_and_says_what_to_type() {
    let folder = tempfile::tempdir().unwrap();
    let expected = ["scenario \"open-loop\"", "type: hydraxis simulate --scenario open-loop"];
    expect_refusal(folder.path(), &["run", "--scenario", "open-loop"], &expected);
}

/// Expects a refusal of these commands for an open loop.
fn expect_bad_commands(text: &str, expected: &str) {
    let folder = folder_with("u.csv", text);
    expect_refusal(folder.path(), &["simulate", "--open-loop", "u.csv"], &[&format!("--open-loop: {expected}")]);
}

#[test]
fn columns_that_are_no_axes_are_refused() {
    let axes = "boom, arm, telescope, bucket";
    expect_bad_commands(
        "t,boom,brm\n0,0,0\n",
        &format!("u.csv:1: found column \"brm\"; allowed: \"t\" and the axes {axes}"),
    );
    expect_bad_commands(
        "t\n0\n",
        &format!("u.csv:1: found no column of an axis; allowed: one column or more of the axes {axes}"),
    );
    expect_bad_commands("boom\n0\n", "u.csv:1: found no column \"t\"; the columns are: boom; allowed: a header with");
    expect_bad_commands("t,boom,boom\n0,0,0\n", "u.csv:1: found column \"boom\" twice; allowed: each name once");
}

#[test]
fn a_file_without_rows_or_without_being_is_refused() {
    expect_bad_commands("t,boom\n", "u.csv:1: found no row below the header; allowed: at least one");
    expect_bad_commands("", "u.csv: found an empty file; allowed: a CSV file with a header");
    let expected = ["--open-loop: v.csv: found a file that cannot be read (No such file", "allowed: a CSV file"];
    expect_refusal(tempfile::tempdir().unwrap().path(), &["simulate", "--open-loop", "v.csv"], &expected);
}

#[test]
fn values_that_are_no_commands_are_refused() {
    for (value, found, allowed) in [
        ("1.01", "1.01", "a command from -1 to 1"),
        ("-2", "-2", "a command from -1 to 1"),
        ("nan", "\"nan\"", "a finite number"),
        ("inf", "\"inf\"", "a finite number"),
        ("", "an empty field", "a finite number"),
        ("half", "\"half\"", "a finite number"),
    ] {
        expect_bad_commands(
            &format!("t,boom\n0,1\n1,{value}\n"),
            &format!("u.csv:3: row 2, column \"boom\": found {found}; allowed: {allowed}"),
        );
    }
}

#[test]
fn of_many_problems_the_first_are_named() {
    let folder = folder_with("u.csv", &format!("t,boom\n{}", (0..100).map(|t| format!("{t},2\n")).collect::<String>()));
    let errors = refusal(folder.path(), &["simulate", "--open-loop", "u.csv"]);
    assert_eq!(errors.lines().count(), 20);
    assert!(errors.contains("u.csv:21: row 20, column \"boom\": found 2; allowed: a command from -1 to 1"), "{errors}");
}

#[test]
fn times_that_do_not_rise_or_rise_too_little_or_too_far_are_refused() {
    for (t, found, allowed) in [
        ("1", "1 after 1", "a time later than the row before"),
        ("0.5", "0.5 after 1", "a time later than the row before"),
        ("1.0000005", "1.0000005 after 1", "a time at least 0.000001 s after the row before"),
        ("1e9", "1000000000", "a time up to 16000000 s after that of the first row"),
    ] {
        expect_bad_commands(
            &format!("t,boom\n0,1\n1,0\n{t},0\n"),
            &format!("u.csv:4: row 3, column \"t\": found {found}; allowed: {allowed}"),
        );
    }
}

#[test]
fn an_unknown_axis_is_refused_with_those_there_are() {
    let expected = ["--axis: found \"crane\"; allowed: one of boom, arm, telescope, bucket"];
    let folder = tempfile::tempdir().unwrap();
    expect_refusal(folder.path(), &["simulate", "--axis", "crane", "--trajectory", "-"], &expected);
}

#[test]
fn options_that_do_not_go_together_are_refused() {
    let folder = folder_with("u.csv", "t,boom\n0,0\n");
    for (arguments, expected) in [
        (&["--open-loop", "u.csv", "--json", "-"][..], "--json: found an open loop, which has no figures; allowed: "),
        (&["--scenario", "open-loop", "--json", "-"], "--json: found an open loop, which has no figures; allowed: "),
        (&["--open-loop", "u.csv", "--duration", "3s"], "--open-loop: found with --duration; allowed: without it"),
        (&["--axis", "boom"], "--axis: found nothing to restrict; allowed: with --trajectory or --plot"),
        (&["--json", "-", "--plot", "-"], "-: found for several of --json, --trajectory and --plot; allowed: one"),
        (&["--plot", "none/y.svg"], "--plot: none/y.svg cannot be written: No such file"),
        (&["--trajectory", "none/y.csv"], "--trajectory: none/y.csv cannot be written: No such file"),
        (&["--trajectory", "none/y.csv"], "; allowed: a file in a folder that exists, and none does not"),
        (&["--duration", "-3s"], "--duration: found \"-3s\"; allowed: a duration greater than 0 with its unit"),
    ] {
        expect_refusal(folder.path(), &[&["simulate"], arguments].concat(), &[expected]);
    }
}

#[test]
fn a_replayed_machine_has_no_plant_to_show() {
    let text = FOUR_AXES.replacen("kind = \"sim\" ", "kind = \"replay\"\nfile = \"r.csv\" ", 1);
    let folder = folder_with("m.toml", &text);
    fs::write(folder.path().join("u.csv"), "t,boom\n0,0\n").unwrap();
    for option in [["--open-loop", "u.csv"], ["--scenario", "open-loop"], ["--trajectory", "-"], ["--plot", "y.svg"]] {
        let expected = ["source.kind: found \"replay\"; allowed: \"sim\""];
        expect_refusal(folder.path(), &[&["simulate", "m.toml"], &option[..]].concat(), &expected);
    }
}
