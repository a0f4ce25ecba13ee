//! The screen of `status --watch` in a terminal of tmux: its sizes, without colours, and with a group that goes and
//! comes back.

use std::process::Command;

use crate::harness::{FOUR_AXES, TestGroup, running::Running, shared, wait_for};

/// A terminal in which the screen runs.
struct Terminal {
    socket: String,
}

impl Terminal {
    /// Opens a terminal of this size. Without tmux there is none.
    fn open(group: &TestGroup, (width, height): (u32, u32), environment: &str) -> Option<Self> {
        let terminal = Self { socket: format!("{}", group.prefix) };
        let screen =
            format!("{environment} exec {} status --watch --prefix {}", env!("CARGO_BIN_EXE_hydraxis"), group.prefix);
        let size = ["-x".to_owned(), width.to_string(), "-y".to_owned(), height.to_string()];
        let mut command = terminal.tmux(&["-f", "/dev/null", "new-session", "-d"]);
        let output = command.args(size).args(["sh", "-c", &screen]).output();
        match output {
            Err(_) => {
                eprintln!("not tested: this computer has no tmux");
                None
            }
            Ok(output) => {
                assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
                Some(terminal)
            }
        }
    }

    fn tmux(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new("tmux");
        command.args(["-L", &self.socket]).args(arguments).env_remove("TMUX").env("TERM", "xterm-256color");
        command
    }

    /// What is on the screen; with `-e` also its colours.
    fn text(&self, options: &[&str]) -> String {
        let mut command = self.tmux(&["capture-pane", "-p"]);
        String::from_utf8(command.args(options).output().unwrap().stdout).unwrap()
    }

    /// Waits until all these are on the screen.
    fn await_all(&self, parts: &[&str]) -> String {
        wait_for(&parts.join(", "), || {
            let text = self.text(&[]);
            std::thread::sleep(std::time::Duration::from_millis(50));
            parts.iter().all(|part| text.contains(part)).then_some(text)
        })
    }

    fn keys(&self, keys: &str) {
        assert!(self.tmux(&["send-keys", keys]).status().unwrap().success());
    }

    fn resize(&self, width: u32, height: u32) {
        let (width, height) = (width.to_string(), height.to_string());
        assert!(self.tmux(&["resize-window", "-x", &width, "-y", &height]).status().unwrap().success());
    }

    /// Whether the program has ended, and its terminal with it.
    fn is_over(&self) -> bool {
        !self.tmux(&["has-session"]).output().unwrap().status.success()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.tmux(&["kill-server"]).output();
    }
}

fn start(test: &str) -> Running {
    Running::start_with(test, &[FOUR_AXES, "--duration", "600s"])
}

/// No line is wider than the terminal, and all axes are there.
fn expect_first_look(text: &str, width: usize) {
    for axis in ["boom", "arm", "telescope", "bucket"] {
        assert!(text.contains(axis), "{axis}\n{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= width), "{text}");
}

#[test]
fn the_screen_fits_its_terminal_and_comes_back_with_the_group() {
    let _cores = shared();
    let mut running = start("screen");
    let Some(terminal) = Terminal::open(&running.group, (80, 24), "") else { return };
    let stages = ["live", "sensor-proc", "ident-proc", "control-proc", "bucket"];
    expect_first_look(&terminal.await_all(&stages), 80);
    assert!(terminal.text(&["-e"]).contains("\x1b[3"), "colours");
    terminal.resize(120, 40);
    expect_first_look(&terminal.await_all(&stages), 120);
    for (key, part) in [("2", "reference"), ("3", "p99"), ("4", "encoder-sample"), ("1", "sensor-proc")] {
        terminal.keys(key);
        terminal.await_all(&["live", part]);
    }
    terminal.resize(80, 24);
    expect_first_look(&terminal.await_all(&stages), 80);
    // Too small for anything: it says so, and does not end.
    terminal.resize(30, 6);
    wait_for("a small screen", || (terminal.text(&[]).lines().count() <= 6).then_some(()));
    terminal.resize(80, 24);
    terminal.await_all(&stages);

    running.interrupt();
    let gone = terminal.await_all(&["NO GROUP"]);
    assert!(!gone.contains("live"), "{gone}");
    drop(running);
    let running = start("screen");
    terminal.await_all(&stages);
    terminal.keys("q");
    wait_for("the end of the screen", || terminal.is_over().then_some(()));
    drop(running);
}

#[test]
fn without_colours_the_screen_says_the_same_in_words() {
    let _cores = shared();
    let running = start("screen-plain");
    let Some(terminal) = Terminal::open(&running.group, (80, 24), "NO_COLOR=1") else { return };
    expect_first_look(&terminal.await_all(&["live", "control-proc", "bucket"]), 80);
    let text = terminal.text(&["-e"]);
    for colour in 30..38 {
        assert!(!text.contains(&format!("\x1b[{colour}m")), "colour {colour}\n{text}");
    }
    terminal.keys("C-c");
    wait_for("the end of the screen", || terminal.is_over().then_some(()));
}
