//! Names of groups and axes, and what does not go together in the operation of a group.

use super::{Row, expect};

const NOBODY: &str = "no group \"nobody\" runs; start one with: hydraxis run MACHINE.toml --prefix nobody";
const PREFIX: &str = "allowed: 1 to 32 letters, digits, - and _";

const ROWS: &[Row] = &[
    ("status --prefix nobody", &[NOBODY]),
    ("arm --prefix nobody", &[NOBODY]),
    ("reset --prefix nobody", &[NOBODY]),
    ("disarm --prefix nobody", &[NOBODY]),
    ("operate --prefix nobody --mode off", &[NOBODY]),
    ("commission --enable --prefix nobody", &[NOBODY]),
    ("status --prefix demo!", &["--prefix: found \"demo!\"; ", PREFIX, "next: hydraxis status --help"]),
    ("status --prefix 'my group'", &["--prefix: found \"my group\"; ", PREFIX, "next: "]),
    ("run --prefix a/b", &["--prefix: found \"a/b\"; ", PREFIX, "next: hydraxis run --help"]),
    ("run --prefix ''", &["--prefix: found \"\"; ", PREFIX, "next: "]),
    ("run --prefix", &["--prefix: found nothing; allowed: --prefix PREFIX", "next: "]),
    ("run --prefix abcdefghijklmnopqrstuvwxyzabcdefg --lockstep", &["--prefix: found \"abc", PREFIX, "next: "]),
    (
        "control-proc four.toml --prefix a.b",
        &["--prefix: found \"a.b\"; ", PREFIX, "next: hydraxis control-proc --help"],
    ),
    ("plant-sim", &["--prefix: found nothing; allowed: --prefix PREFIX", "next: hydraxis plant-sim --help"]),
    ("disarm --axis boom", &["--prefix: found nothing, and another option here needs it; allowed: --prefix", "next: "]),
    (
        "disarm --emergency --axis boom --prefix nobody",
        &["--emergency: found with --axis; allowed: without it", "next"],
    ),
    (
        "commission four.toml --prefix nobody",
        &["--prefix: found \"nobody\"", "without --enable; allowed: with --enable"],
    ),
    ("commission four.toml --axis bom", &["--axis: found \"bom\"; allowed: one of boom, arm", "did you mean `boom`?"]),
    ("simulate four.toml --duration 1s --axis bom --trajectory -", &["--axis: found \"bom\"", "did you mean `boom`?"]),
    (
        "simulate four.toml --duration 1s --axis boom",
        &["--axis: found nothing to restrict; allowed: with --trajectory"],
    ),
    ("plot motion.csv --output x.svg --axis bom", &["--axis: found \"bom\"; allowed: one of boom", "mean `boom`?"]),
    (
        "operate --prefix nobody --mode hol",
        &["--mode: found \"hol\"; allowed: one of off, manual", "`hold`?", "next: "],
    ),
    ("operate --prefix nobody --mode Hold", &["--mode: found \"Hold\"; allowed: one of off", "`hold`?", "next: "]),
    (
        "operate --prefix nobody --mode fly",
        &["--mode: found \"fly\"; allowed: one of off, manual, hold, track", "next"],
    ),
    ("arm --prefix nobody --mode manual", &["--mode: found \"manual\"; allowed: one of track, hold", "next: "]),
    ("operate --prefix nobody --mode manual", &["--command: found none; allowed: a valve command in [-1, 1], such as"]),
    (
        "operate --prefix nobody --mode hold --command 0.2",
        &["--command: found one with --mode hold; allowed: with man"],
    ),
    (
        "operate --prefix nobody --mode track --target 0.3",
        &["--target: found one with --mode track; allowed: with hold"],
    ),
    ("operate --prefix nobody --mode off --leave", &["--leave: found with --mode off; allowed: with hold and track"]),
];

/// Values that are well typed: the command goes on to the group, which is not there.
const WELL_TYPED: &[Row] = &[
    ("operate --prefix nobody --mode hold --target 300mm", &[NOBODY]),
    ("operate --prefix nobody --mode hold --target 0.3m", &[NOBODY]),
    ("operate --prefix nobody --mode hold --target 0.3", &[NOBODY]),
    ("operate --prefix nobody --mode hold --target '30 cm'", &[NOBODY]),
    ("operate --prefix nobody --mode manual --command 30%", &[NOBODY]),
    ("operate --prefix nobody --mode manual --command -0.3", &[NOBODY]),
    ("commission --enable --prefix nobody --speed 50mm/s --travel 300mm", &[NOBODY]),
    ("commission --enable --prefix nobody --speed 0.05 --travel 0.3", &[NOBODY]),
];

#[test]
fn a_mistyped_group_axis_or_mode_is_answered_with_what_to_type() {
    expect(ROWS);
}

#[test]
fn lengths_speeds_and_commands_may_have_a_unit() {
    expect(WELL_TYPED);
}
