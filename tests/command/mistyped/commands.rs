//! Mistyped commands and options.

use super::{Row, expect};

const COMMANDS: &[Row] = &[
    ("rum", &["command: found \"rum\"; allowed: one of init, ", "did you mean `run`?", "next: hydraxis --help"]),
    ("Run", &["found \"Run\"", "did you mean `run`?", "next: "]),
    ("chekc four.toml", &["found \"chekc\"", "did you mean `check`?", "next: "]),
    ("simulat", &["found \"simulat\"", "did you mean `simulate`?", "next: "]),
    ("stat", &["found \"stat\"", "did you mean `status`?", "next: "]),
    ("comission", &["found \"comission\"", "did you mean `commission`?", "next: "]),
    ("comissioning", &["found \"comissioning\"", "did you mean `commission`?", "next: "]),
    ("arms --prefix nobody", &["found \"arms\"", "did you mean `arm`?", "next: "]),
    ("identfy record.csv", &["found \"identfy\"", "did you mean `identify`?", "next: "]),
    ("plantsim --prefix nobody", &["found \"plantsim\"", "did you mean `plant-sim`?", "next: "]),
    ("exmaple", &["found \"exmaple\"", "did you mean `example`?", "next: "]),
    ("doctr", &["found \"doctr\"", "did you mean `doctor`?", "next: "]),
    (
        "bench contol",
        &["found \"contol\"; allowed: one of control, identify, tip; did you mean `control`?", "hydraxis bench --help"],
    ),
    ("four.toml", &["found \"four.toml\"; allowed: one of init", "next: hydraxis check four.toml"]),
    ("--machine four.toml", &["--machine: found an option before the command; allowed: first one of init", "next: "]),
];

const OPTIONS: &[Row] = &[
    ("run --duraton 5s", &["--duraton: found an unknown option; allowed: one of", "did you mean `--duration`?"]),
    ("run --lock-step", &["--lock-step: found an unknown", "`--lockstep`?", "next: hydraxis run --help"]),
    ("run -d 5s", &["-d: found an unknown option; allowed: one of --set", "next: hydraxis run --help"]),
    ("run four.toml second.toml", &["second.toml: found one argument too many; allowed: only MACHINE.toml", "next: "]),
    ("simulate four.toml --scenaro payload", &["--scenaro: found an unknown", "`--scenario`?", "next: "]),
    ("check four.toml --explan", &["--explan: found an unknown", "`--explain`?", "next: hydraxis check --help"]),
    (
        "check --json x.json",
        &["--explain: found nothing, and another option here needs it; allowed: --explain", "next"],
    ),
    ("status --prefx demo", &["--prefx: found an unknown", "`--prefix`?", "next: hydraxis status --help"]),
    ("operate --prefix nobody --mode hold --traget 0.3", &["--traget: found an unknown", "`--target`?", "next: "]),
    ("operate --prefix nobody --mode hold --enabel", &["--enabel: found an unknown", "`--enable`?", "next: "]),
    ("operate --prefix nobody", &["--mode: found nothing; allowed: one of off, manual, hold, track", "next: "]),
    (
        "operate --prefix nobody --mode hold --leave --duration 5s",
        &["--leave: found with --duration; allowed: without"],
    ),
    (
        "operate --prefix nobody --mode hold --leave --hold-to-run",
        &["--leave: found with --hold-to-run; allowed: with"],
    ),
    ("arm --prefix nobody --target 0.3", &["--target: found an unknown option; allowed: one of --prefix, --axis"]),
    (
        "commission four.toml --axes boom",
        &["--axes: found an unknown", "`--axis`?", "next: hydraxis commission --help"],
    ),
    ("commission four.toml --model", &["--model: found nothing; allowed: --model MODEL.toml", "next: "]),
    (
        "identify",
        &[
            "DATA: found nothing; allowed: DATA (Recordings: tables with one row per sample",
            "next: hydraxis identify --help",
        ],
    ),
    ("identify record.csv --inputs u", &["--inputs: found an unknown", "`--input`?", "next: "]),
    ("bench control --seed 3", &["--machines: found nothing, and another option here needs it; allowed: --machines N"]),
    ("bench control --seed 3 --scenario payload", &["--seed: found with --scenario; allowed: without it", "next: "]),
    ("bench tip --seed 3", &["--drawn: found nothing, and another option here needs it; allowed: --drawn N", "next: "]),
    ("bench tip --seed 3 --task level", &["--seed: found with --task; allowed: without it", "next: "]),
    ("bench control --only 17", &["--machines: found nothing, and another option here needs it", "next: "]),
    ("bench control --machines 5 --seeds 3", &["--machines: found with --seeds; allowed: without it", "next: "]),
    (
        "plot motion.csv --out x.svg",
        &["--out: found an unknown", "did you mean `--output`?", "next: hydraxis plot --help"],
    ),
    ("plot motion.csv", &["--output: found nothing; allowed: --output FILE", ".svg or .png", "next: "]),
    ("doctor --second 5", &["--second: found an unknown", "`--seconds`?", "next: "]),
    ("clean --force", &["--force: found an unknown option; allowed: one of --prefix, --dry-run", "next: "]),
    ("mechanism --udrf x.urdf", &["--udrf: found an unknown", "`--urdf`?", "next: "]),
    ("init --axis cylinder", &["--axis: found an unknown", "`--axes`?", "next: hydraxis init --help"]),
    ("init --axes cylinder", &["missing: --stroke, --bore, --rod, --valve-hz, --dead-time; allowed: all of them, or"]),
    ("example four-axes.toml --out x.toml", &["--out: found an unknown", "did you mean `--output`?", "next: "]),
    ("example --force", &["NAME: found nothing, and another option here needs it; allowed: NAME", "next: "]),
    ("example watch.py watch.rs", &["watch.rs: found one argument too many; allowed: only NAME", "next: "]),
    ("completions", &["SHELL: found nothing; allowed: one of bash, elvish, fish, powershell, zsh", "next: "]),
    ("completions bash zsh", &["zsh: found one argument too many; allowed: only SHELL", "next: "]),
    ("man --folder four.toml", &["--folder: found an unknown option; allowed: one of --output", "next: "]),
    ("status --watch --json -", &["--watch: found with --json; allowed: without it", "next: "]),
    ("run --no-black-box --black-box x", &["--no-black-box: found with --black-box; allowed: without it", "next: "]),
    ("simulate --open-loop record.csv --duration 3s", &["--open-loop: found with --duration; allowed: without it"]),
];

#[test]
fn a_mistyped_command_is_answered_with_the_nearest_one() {
    expect(COMMANDS);
}

#[test]
fn a_mistyped_option_is_answered_with_the_nearest_one_and_those_there_are() {
    expect(OPTIONS);
}
