//! Files that are missing, of the wrong kind, or no files.

use super::{Row, expect};

const MACHINE: &str = "allowed: a machine file in TOML, such as `hydraxis init` writes";
const MODEL: &str = "allowed: a model file in TOML, as `hydraxis commission --out FILE` writes it";
const CSV: &str = "allowed: a CSV file with a header, then one row per sample";
const UNREADABLE: &str = ": found a file that cannot be read (";
const NO_FOLDER: &str = "allowed: a file in a folder that exists, and no does not";
const PICTURE: &str = "allowed: a file that ends with .svg or .png, or -";
const NO_TOML: &str =
    "found a file that is no TOML: most of its lines are like \"t,u,y\"; allowed: a file in TOML, such";

const ROWS: &[Row] = &[
    ("check missing.toml", &["missing.toml", UNREADABLE, "No such file", MACHINE]),
    ("check four.tml", &["four.tml", UNREADABLE, MACHINE, "did you mean `four.toml`?"]),
    ("run excavater.toml", &["excavater.toml", UNREADABLE, MACHINE, "did you mean `excavator.toml`?"]),
    ("simulate missing.toml", &["missing.toml", UNREADABLE, MACHINE]),
    ("commission missing.toml", &["missing.toml", UNREADABLE, MACHINE]),
    ("doctor missing.toml", &["missing.toml", UNREADABLE, MACHINE]),
    ("mechanism missing.toml", &["missing.toml", UNREADABLE, MACHINE]),
    ("bench control missing.toml", &["missing.toml", UNREADABLE, MACHINE]),
    ("check folder", &["folder", UNREADABLE, "Is a directory", MACHINE]),
    ("check binary.toml", &["binary.toml", UNREADABLE, "UTF-8", MACHINE]),
    ("check empty.toml", &["empty.toml: found a file without a key; allowed: a machine file with name"]),
    ("check record.csv", &["record.csv: ", NO_TOML, "`hydraxis init`"]),
    ("check model.toml", &["model.toml: found a model file", "allowed: a machine file, and this file with --model"]),
    (
        "commission model.toml",
        &["model.toml: found a model file", "allowed: a machine file, and this file with --model"],
    ),
    ("check excavator.toml --model missing.toml", &["missing.toml", UNREADABLE, MODEL]),
    ("check excavator.toml --model modle.toml", &["modle.toml", UNREADABLE, MODEL, "did you mean `model.toml`?"]),
    ("check excavator.toml --model folder", &["folder", UNREADABLE, "Is a directory", MODEL]),
    ("check excavator.toml --model binary.toml", &["binary.toml", UNREADABLE, "UTF-8", MODEL]),
    (
        "check excavator.toml --model empty.toml",
        &["empty.toml: axis.NAME.commissioned: found nothing", "`hydraxis com"],
    ),
    (
        "check excavator.toml --model excavator.toml",
        &["excavator.toml: found a machine file", "this file as MACHINE.t"],
    ),
    ("check excavator.toml --model record.csv", &["record.csv: ", NO_TOML, "`hydraxis commission`"]),
    (
        "check rig.toml --model model.toml",
        &["model.toml: found a model of axis arm", "\"cylinder\", which has cylinder"],
    ),
    ("simulate --open-loop missing.csv", &["--open-loop: missing.csv", UNREADABLE, CSV]),
    ("simulate --open-loop folder", &["--open-loop: folder", UNREADABLE, CSV]),
    ("simulate --open-loop empty.csv", &["--open-loop: empty.csv: found an empty file; ", CSV]),
    ("simulate --open-loop four.toml", &["--open-loop: four.toml:1: found column \"# Four", "\"t\" and the axes boom"]),
    ("simulate --open-loop record.csv", &["record.csv:1: found column \"u\"; allowed: \"t\" and the axes boom, arm"]),
    ("simulate --open-loop binary.csv", &["--open-loop: binary.csv", UNREADABLE, CSV]),
    ("simulate four.toml --duration 1s --plot x.pdf", &["--plot: found \"x.pdf\"; ", PICTURE]),
    (
        "simulate four.toml --duration 1s --trajectory no/x.csv",
        &["--trajectory: no/x.csv cannot be written", NO_FOLDER],
    ),
    (
        "simulate four.toml --duration 1s --json folder",
        &["--json: folder cannot be written: Is a directory", "allowed: "],
    ),
    (
        "simulate four.toml --duration 1s --json - --trajectory -",
        &["-: found for several of --json", "allowed: one on"],
    ),
    ("plot missing.csv --output x.svg", &["missing.csv", UNREADABLE, CSV]),
    ("plot moton.csv --output x.svg", &["moton.csv", UNREADABLE, CSV, "did you mean `motion.csv`?"]),
    ("plot folder --output x.svg", &["folder", UNREADABLE, CSV]),
    ("plot empty.csv --output x.svg", &["empty.csv: found an empty file; ", CSV]),
    (
        "plot four.toml --output x.svg",
        &["four.toml: found no column AXIS.position; allowed: a file that `hydraxis sim"],
    ),
    ("plot record.csv --output x.svg", &["record.csv: found no column AXIS.position; allowed: a file that `hydraxis"]),
    ("plot binary.csv --output x.svg", &["binary.csv", UNREADABLE, CSV]),
    ("plot motion.csv --output x.jpg", &["--output: found \"x.jpg\"; ", PICTURE]),
    ("plot motion.csv --output no/x.svg", &["--output: no/x.svg cannot be written", NO_FOLDER]),
    ("identify missing.csv", &["missing.csv", UNREADABLE, CSV]),
    ("identify recrd.csv", &["recrd.csv", UNREADABLE, CSV, "did you mean `record.csv`?"]),
    ("identify folder", &["folder: found a folder; allowed: files, or a folder with --jsonl OUT"]),
    ("identify empty.csv", &["empty.csv: found an empty file; ", CSV]),
    (
        "identify four.toml",
        &["four.toml:1: found no column \"u\"", "allowed: a header with \"u\"", "--input and --output"],
    ),
    ("identify words.csv", &["words.csv:3: row 2, column \"u\": found \"zero\"; allowed: a finite number"]),
    (
        "identify record.csv --input uu",
        &["record.csv:1: found no column \"uu\"; the columns are: t, u, y", "mean `u`?"],
    ),
    ("identify record.csv --output position", &["found no column \"position\"; the columns are: t, u, y", "--output"]),
    (
        "identify record.csv --fuzzy missing.toml",
        &["missing.toml", UNREADABLE, "allowed: a TOML file with the keys of"],
    ),
    ("commission four.toml --out folder", &["--out: found folder, which is a folder; allowed: a file"]),
    ("commission four.toml --out folder --force", &["--out: found folder, which is a folder; allowed: a file"]),
    ("commission four.toml --out no/model.toml", &["--out: found no/model.toml; ", NO_FOLDER]),
    (
        "commission four.toml --out four.toml",
        &["--out: found four.toml, the file that MACHINE.toml reads; allowed: a file of its own"],
    ),
    ("commission four.toml --out new.toml --report no/r.html", &["--report: no/r.html cannot be written", NO_FOLDER]),
    ("bench control --json no/x.json", &["--json: no/x.json cannot be written", NO_FOLDER]),
    ("example four-axes.toml --output no/x.toml", &["--output: no/x.toml cannot be written", "allowed: a folder that"]),
    (
        "example watch.py --output four.toml",
        &["--output: found four.toml, which is there already; allowed: a new file"],
    ),
    ("mechanism four.toml", &["four.toml: mechanism: found nothing; allowed: the tables", "examples/excavator.toml"]),
    (
        "mechanism --states missing.json",
        &["--states: missing.json: found a file that", "allowed: a JSON file with states"],
    ),
    (
        "mechanism --states states.json",
        &["--states: states.json: states: found 3; allowed: a list of one or more states"],
    ),
    ("mechanism --states record.csv", &["--states: record.csv: found no JSON: ", "line 1 column 2; allowed: JSON"]),
    ("mechanism --urdf no/x.urdf", &["--urdf: no/x.urdf cannot be written", NO_FOLDER]),
    ("mechanism --urdf - --json -", &["-: found for --json and --urdf; allowed: one on standard output"]),
    (
        "init --output four.toml",
        &["--output: found four.toml, which is there already; allowed: a new file, or --force"],
    ),
    ("init --output no/x.toml", &["--output: found no/x.toml; ", NO_FOLDER]),
    ("init --output folder --force", &["--output: found folder, which is a folder; allowed: a file"]),
];

#[test]
fn a_file_of_the_wrong_kind_is_answered_with_the_kind_that_is_wanted() {
    expect(ROWS);
}
