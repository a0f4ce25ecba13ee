//! Runs the console examples of README and book, and compares what they print.
//!
//! | in a page | means |
//! |---|---|
//! | a block of the language `console` | is run; lines after `$ ` are commands, the others what they print |
//! | a line `...` in it | any number of lines |
//! | `[..]` in a line of it | any characters |
//! | `<!-- figures vary -->` before it | numbers may have other values, and other units of time |
//! | `<!-- first: COMMAND -->` before it | runs without being shown |
//! | `&` at the end of a command | runs in the background until the end of the page |
//!
//! All commands of a page run one after another in one shell, in a folder of their own that holds a copy of `examples`
//! and the recording `boom.csv`. The group that pages call `demo` has another name meanwhile, so that several tests can
//! run side by side.
//!
//! `HYDRAXIS_BOOK=overwrite` writes what commands print into the pages; blocks with `...` or `[..]` are left alone.

use std::{
    fs::File,
    os::unix::process::CommandExt,
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use pipeline::channel::{Prefix, remove_leftovers};
use rustix::process::{Pid, Signal, kill_process_group};

use super::{
    harness,
    pages::{Line, Page, is_overwriting, root},
};

/// Longest time that all commands of one page may take.
const PATIENCE: Duration = Duration::from_secs(900);
/// How often the commands of a page with a run in real time are run until they print what the page shows. A computer
/// that gives a stage no time for three periods makes such a run end latched, rightly.
const REAL_TIME_TRIES: usize = 3;
/// What such a run prints of it. After all tries, lines with these words are passed over.
const STALLED: [&str; 2] = ["LATCHED by feedback", "no model yet: a fault latched the axis"];
/// The group's name in the pages.
const GROUP: &str = "demo";
/// A line before the output of every command.
const MARK: &str = "---- next command ----";

/// A command of a page.
#[derive(Debug)]
struct Example {
    /// Number of its line.
    line: usize,
    command: String,
    /// The lines that it prints, by the page.
    expected: Vec<String>,
    /// Its block is marked by `figures vary`.
    varies: bool,
    /// Not shown, so that its output does not matter.
    hidden: bool,
}

/// The commands of a page, in their order.
fn examples(page: &Page) -> Vec<Example> {
    let mut examples: Vec<Example> = Vec::new();
    let (mut in_console, mut varies) = (false, false);
    for (line, kind) in page.lines() {
        let example =
            |command: &str, hidden| Example { line, command: command.to_owned(), expected: Vec::new(), varies, hidden };
        match kind {
            Line::Text("<!-- figures vary -->") => varies = true,
            Line::Text(text) => {
                let hidden = text.strip_prefix("<!-- first: ").and_then(|rest| rest.strip_suffix(" -->"));
                examples.extend(hidden.map(|command| example(command, true)));
            }
            Line::Fence("console") => in_console = true,
            Line::Fence(_) => (in_console, varies) = (false, varies && !in_console),
            Line::Code(code) if in_console => match code.strip_prefix("$ ") {
                Some(command) => examples.push(example(command, false)),
                None => {
                    let last = examples.last_mut().filter(|last| !last.hidden);
                    last.expect("a console block begins with a command").expected.push(code.to_owned());
                }
            },
            Line::Code(_) => {}
        }
    }
    examples
}

/// A line without its figures, their units of time and percent signs, and the spaces that align them.
fn without_figures(line: &str) -> String {
    const NUMBER: &str = "0";
    let mut words: Vec<&str> = Vec::new();
    for word in line.split_whitespace() {
        let is_after_number = words.last() == Some(&NUMBER);
        let digits = word.trim_end_matches(['%', ',', ':', ';', ')']);
        if word == "-" || digits.parse::<f64>().is_ok() {
            words.push(NUMBER);
        } else if !(is_after_number && ["%", "ns", "us", "ms", "s"].contains(&word)) {
            words.push(word);
        }
    }
    words.join(" ")
}

/// Whether a printed line is the expected one, in which `[..]` stands for any characters.
fn is_line(expected: &str, printed: &str) -> bool {
    let mut parts = expected.split("[..]");
    let Some(mut rest) = parts.next().and_then(|first| printed.strip_prefix(first)) else { return false };
    let mut open = false;
    for part in parts {
        let Some(place) = rest.find(part) else { return false };
        rest = &rest[place + part.len()..];
        open = part.is_empty();
    }
    open || rest.is_empty()
}

/// Whether printed lines are the expected ones, among which `...` stands for any lines.
fn are_lines(expected: &[String], printed: &[String]) -> bool {
    match expected.split_first() {
        None => printed.is_empty(),
        Some((first, rest)) if first.trim() == "..." => (0..=printed.len()).any(|n| are_lines(rest, &printed[n..])),
        Some((first, rest)) => {
            printed.split_first().is_some_and(|(line, others)| is_line(first, line) && are_lines(rest, others))
        }
    }
}

impl Example {
    fn is_met_by(&self, printed: &[String]) -> bool {
        if self.hidden || self.command.ends_with('&') {
            return true;
        }
        if !self.varies {
            return are_lines(&self.expected, printed);
        }
        let bare = |lines: &[String]| -> Vec<String> { lines.iter().map(|line| without_figures(line)).collect() };
        are_lines(&bare(&self.expected), &bare(printed))
    }

    /// The command as the shell gets it.
    fn script(&self) -> String {
        let command = self.command.replace("cargo run --release -- ", "hydraxis ");
        match command.strip_suffix('&') {
            Some(background) => format!("{background} > background.txt 2>&1 &\nbackground=\"$background $!\""),
            None => command,
        }
    }
}

/// The folder in which the commands of a page run.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("examples")).unwrap();
    for entry in std::fs::read_dir(root().join("examples")).unwrap().flatten().filter(|entry| entry.path().is_file()) {
        std::fs::copy(entry.path(), folder.path().join("examples").join(entry.file_name())).unwrap();
    }
    std::fs::copy(root().join(RECORDING), folder.path().join("boom.csv")).unwrap();
    folder
}

/// A simulated servo whose flow gain falls by 40 % while its oil warms up.
const RECORDING: &str = "tests/data/servo_warmup.csv";

/// Runs all commands of a page; the lines that each of them has printed.
fn run(examples: &[Example], group: &str) -> Vec<Vec<String>> {
    let folder = workplace();
    let mut script = String::new();
    for example in examples {
        script += &format!("echo '{MARK}'\n{}\n", example.script());
    }
    script += &format!("echo '{MARK}'\n[ -z \"$background\" ] || kill $background\nwait\n");
    std::fs::write(folder.path().join("script.sh"), script.replace(GROUP, group)).unwrap();
    let output = folder.path().join("output.txt");
    let programs = Path::new(env!("CARGO_BIN_EXE_hydraxis")).parent().unwrap().display().to_string();
    let file = File::create(&output).unwrap();
    let mut shell = Command::new("sh")
        .arg("script.sh")
        .current_dir(folder.path())
        .env("PATH", format!("{programs}:{}", std::env::var("PATH").unwrap_or_default()))
        .env("TMPDIR", folder.path())
        .env("XDG_STATE_HOME", folder.path())
        .env("HYDRAXIS_RECORDINGS", "off")
        .env_remove("STATE_DIRECTORY")
        .stdin(Stdio::null())
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .process_group(0)
        .spawn()
        .unwrap();
    let until = Instant::now() + PATIENCE;
    let ended = loop {
        match shell.try_wait().unwrap() {
            Some(status) => break Some(status),
            None if Instant::now() > until => break None,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let shell_group = Pid::from_raw(i32::try_from(shell.id()).unwrap()).unwrap();
    let _ = kill_process_group(shell_group, Signal::KILL);
    let printed = std::fs::read_to_string(output).unwrap().replace(group, GROUP);
    assert!(ended.is_some(), "not done after {PATIENCE:?}:\n{printed}");
    let mark = format!("{MARK}\n");
    let outputs = printed.split(mark.as_str()).skip(1);
    outputs.take(examples.len()).map(|output| output.lines().map(|line| line.trim_end().to_owned()).collect()).collect()
}

/// The page with what its commands have printed.
fn overwritten(page: &Page, examples: &[Example], printed: &[Vec<String>]) -> String {
    let mut lines: Vec<String> = page.text.lines().map(str::to_owned).collect();
    for (example, printed) in examples.iter().zip(printed).rev() {
        if !example.is_met_by(printed) {
            let lines_now = with_elisions_of(&example.expected, printed);
            lines.splice(example.line..example.line + example.expected.len(), lines_now);
        }
    }
    lines.join("\n") + "\n"
}

/// The lines that were printed, elided like those of the page: its first `...` stands for what is between the lines
/// before it and those after it, and lines of the page with `[..]` stay as they are.
fn with_elisions_of(page: &[String], printed: &[String]) -> Vec<String> {
    let kept = |page: &[String], printed: &[String]| -> Vec<String> {
        let lines = page.iter().zip(printed);
        lines.map(|(old, new)| if old.contains("[..]") { old.clone() } else { new.clone() }).collect()
    };
    let Some(before) = page.iter().position(|line| line.trim() == "...") else {
        let rest = printed.iter().skip(page.len()).cloned();
        return kept(page, printed).into_iter().chain(rest).collect();
    };
    let after = &page[before + 1..];
    let last = &printed[printed.len().saturating_sub(after.len())..];
    let mut lines = kept(&page[..before], printed);
    lines.push(page[before].clone());
    lines.extend(kept(after, last));
    lines
}

/// Runs a page's examples and compares.
fn check(path: &str) {
    let page = Page::read(Path::new(path));
    let examples = examples(&page);
    assert!(!examples.is_empty(), "{path} has no console example");
    let in_real_time = examples.iter().any(|example| example.varies || example.command.ends_with('&'));
    let _cores = if in_real_time { harness::alone() } else { harness::shared() };
    // As long as the name that it replaces, so that tables look alike; another one in every process and on every page.
    let number =
        (std::process::id() as usize * 31 + path.len() * 7 + path.bytes().map(usize::from).sum::<usize>()) % 4096;
    let group = format!("q{number:03x}");
    let run_once = || {
        let printed = run(&examples, &group);
        assert_eq!(printed.len(), examples.len(), "{path}: the shell ended early");
        let prefix: Prefix = group.parse().unwrap();
        let left = remove_leftovers(&prefix).unwrap();
        assert!(left.is_empty(), "{path}: left behind {left:?}");
        printed
    };
    let is_met =
        |printed: &[Vec<String>]| examples.iter().zip(printed).all(|(example, lines)| example.is_met_by(lines));
    let mut printed = run_once();
    if in_real_time {
        for _ in 1..REAL_TIME_TRIES {
            if !is_met(&printed) {
                printed = run_once();
            }
        }
        let is_stalled = |line: &String| STALLED.iter().any(|words| line.contains(words));
        printed.iter_mut().for_each(|lines| lines.retain(|line| !is_stalled(line)));
    }
    if is_overwriting() {
        std::fs::write(root().join(path), overwritten(&page, &examples, &printed)).unwrap();
        return;
    }
    let wrong = examples.iter().zip(&printed).filter(|(example, printed)| !example.is_met_by(printed));
    let wrong: Vec<String> = wrong
        .map(|(example, printed)| {
            let (line, command, expected) = (example.line, &example.command, example.expected.join("\n"));
            format!("{path}:{line}: $ {command}\nexpected:\n{expected}\nprinted:\n{}\n", printed.join("\n"))
        })
        .collect();
    assert!(wrong.is_empty(), "{}\nHYDRAXIS_BOOK=overwrite writes what is printed into the page", wrong.join("\n"));
}

macro_rules! pages {
    ($($test:ident: $path:literal,)*) => {
        $(#[test]
        fn $test() {
            check($path);
        })*

        #[test]
        fn every_page_with_an_example_is_tested() {
            let tested = [$($path),*];
            for page in super::pages::all() {
                let path = page.path.to_str().unwrap();
                assert_eq!(!examples(&page).is_empty(), tested.contains(&path), "{path}");
            }
        }
    };
}

pages! {
    readme: "README.md",
    start: "docs/src/start.md",
    rig: "docs/src/rig.md",
    command_init: "docs/src/commands/init.md",
    command_run: "docs/src/commands/run.md",
    command_simulate: "docs/src/commands/simulate.md",
    command_commission: "docs/src/commands/commission.md",
    command_identify: "docs/src/commands/identify.md",
    command_predict: "docs/src/commands/predict.md",
    command_replay: "docs/src/commands/replay.md",
    command_check: "docs/src/commands/check.md",
    command_mechanism: "docs/src/commands/mechanism.md",
    command_tip: "docs/src/commands/tip.md",
    command_bench: "docs/src/commands/bench.md",
    command_operate: "docs/src/commands/operate.md",
    command_status: "docs/src/commands/status.md",
    command_doctor: "docs/src/commands/doctor.md",
    command_clean: "docs/src/commands/clean.md",
    machine_file: "docs/src/machine.md",
    mechanism: "docs/src/mechanism.md",
    tip: "docs/src/tip.md",
}

#[test]
fn elisions_stand_for_any_lines_and_any_characters() {
    let lines = |text: &str| -> Vec<String> { text.lines().map(str::to_owned).collect() };
    assert!(are_lines(&lines("a\n...\nd"), &lines("a\nb\nc\nd")) && are_lines(&lines("a\n...\nd"), &lines("a\nd")));
    assert!(!are_lines(&lines("a\n...\nd"), &lines("a\nb")) && !are_lines(&lines("a"), &lines("a\nb")));
    assert!(is_line("took [..] s, [..]", "took 3.1 s, well") && is_line("a[..]b", "ab"));
    assert!(!is_line("took [..] s", "took 3.1 ms") && !is_line("a", "ab") && !is_line("ab", "a"));
}

#[test]
fn a_page_is_overwritten_with_its_elisions() {
    let lines = |text: &str| -> Vec<String> { text.lines().map(str::to_owned).collect() };
    let overwritten = |page: &str, printed: &str| with_elisions_of(&lines(page), &lines(printed)).join("\n");
    assert_eq!(overwritten("a 1\n...\nd 1 in [..] s", "a 2\nb\nc\nd 1 in 3 s"), "a 2\n...\nd 1 in [..] s");
    assert_eq!(overwritten("a 1\nb [..]", "a 2\nb 2\nc"), "a 2\nb [..]\nc");
    assert_eq!(overwritten("a 1\nb 1", "a 2"), "a 2");
}

#[test]
fn varying_figures_leave_only_the_words() {
    assert_eq!(without_figures(" boom   23.135  66.85 % 4.2 us -"), without_figures(" boom 1 0.2 % 917 ns  12"));
    assert_ne!(without_figures("boom 1"), without_figures("arm 1"));
    assert_ne!(without_figures("boom 1"), without_figures("boom 1 2"));
}
