//! Real processes for the tests: a router, bridges, groups of `hydraxis`. Each has names of its own and ends with its
//! test.
#![allow(dead_code, reason = "a test uses a part of it")]

pub mod heard;
pub mod results;

use std::{
    fs,
    io::{BufRead, BufReader},
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use hydraxis_fleet::connection::Connection;
use serde_json::json;

/// Bound of everything that is waited for: a busy computer takes long to start a group.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// The program of this package.
pub fn fleet() -> Command {
    Command::new(env!("CARGO_BIN_EXE_hydraxis-fleet"))
}

/// The program `hydraxis`: that of the variable HYDRAXIS, or the newest one that the workspace has built.
pub fn hydraxis() -> Command {
    let named = std::env::var_os("HYDRAXIS").map(PathBuf::from);
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    let built = ["debug/hydraxis", "release/hydraxis"].map(|program| target.join(program));
    let when = |program: &PathBuf| program.metadata().and_then(|about| about.modified()).ok();
    let found = named.or_else(|| built.into_iter().filter(|program| program.is_file()).max_by_key(when));
    Command::new(found.expect("no hydraxis: type `cargo build` in the workspace, or name one by HYDRAXIS"))
}

/// Waits for something to be there.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < until, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(10));
    }
}

/// A process that ends with its test.
pub struct Running(pub Child);

impl Running {
    /// Sends it a signal by its name.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").arg(format!("-{name}")).arg(self.0.id().to_string()).status();
        assert!(sent.is_ok_and(|status| status.success()), "kill -{name}");
    }

    /// Ends it in order, so that it removes the files of its group.
    pub fn end(&mut self) {
        let until = Instant::now() + PATIENCE;
        if self.is_running() {
            self.signal("CONT");
            self.signal("TERM");
        }
        while self.is_running() && Instant::now() < until {
            sleep(Duration::from_millis(10));
        }
    }

    /// Whether it has not ended.
    pub fn is_running(&mut self) -> bool {
        self.0.try_wait().is_ok_and(|status| status.is_none())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A router of Zenoh on this computer.
pub struct Router {
    pub address: String,
    pub process: Running,
    file: PathBuf,
    _folder: tempfile::TempDir,
}

impl Router {
    /// A router without rules of access, on a port of its own.
    pub fn new() -> Self {
        let address = format!("tcp/127.0.0.1:{}", free_port());
        let config = json!({
            "mode": "router",
            "listen": { "endpoints": [address] },
            "scouting": { "multicast": { "enabled": false } },
            "transport": { "link": { "tx": { "lease": 2000 } } },
        });
        Self::of(&config.to_string(), &address)
    }

    /// A router of this configuration, which clients reach at this address.
    pub fn of(config: &str, address: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("router.json5");
        fs::write(&file, config).unwrap();
        Self { address: address.to_owned(), process: router_process(&file), file, _folder: folder }
    }

    /// Kills it.
    pub fn kill(&mut self) {
        self.process.0.kill().unwrap();
        self.process.0.wait().unwrap();
    }

    /// Starts it again at the same address.
    pub fn restart(&mut self) {
        self.process = router_process(&self.file);
    }

    /// How a client on this computer reaches it without TLS.
    pub fn connection(&self) -> Connection {
        Connection { router: vec![self.address.clone()], tls: None }
    }
}

fn router_process(file: &Path) -> Running {
    let mut process =
        Running(fleet().arg("router").arg(file).env("RUST_LOG", "off").stdout(Stdio::piped()).spawn().unwrap());
    let mut line = String::new();
    BufReader::new(process.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.contains("runs"), "the router does not start");
    process
}

/// A port of this computer that nobody has at the moment.
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// A bridge of the machine `quarry/ex-07`.
pub struct Bridge {
    pub process: Running,
    pub folder: tempfile::TempDir,
}

impl Bridge {
    /// A bridge for this group.
    pub fn new(router: &str, group: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let settings = folder.path().join("fleet.toml");
        fs::create_dir(folder.path().join("recordings")).unwrap();
        let text = format!(
            "site = \"quarry\"\nmachine = \"ex-07\"\ngroup = \"{group}\"\nrouter = [\"{router}\"]\n\
             recordings = \"recordings\"\n{more}"
        );
        fs::write(&settings, text).unwrap();
        let process = Running(fleet().arg("bridge").arg(&settings).stderr(Stdio::null()).spawn().unwrap());
        Self { process, folder }
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.process.end();
    }
}

/// A plant of the machine `quarry/ex-07` with seed 7.
pub struct Plant {
    pub process: Running,
    /// Its settings, which are those of the stage as well.
    pub settings: PathBuf,
    said: PathBuf,
    arguments: Vec<String>,
    _folder: tempfile::TempDir,
}

impl Plant {
    /// A plant with these arguments. It is ready when this returns.
    pub fn new(router: &str, more: &str, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let settings = folder.path().join("fleet.toml");
        fs::write(&settings, format!("site = \"quarry\"\nmachine = \"ex-07\"\nrouter = [\"{router}\"]\n{more}"))
            .unwrap();
        let said = folder.path().join("said");
        let arguments: Vec<String> = arguments.iter().map(|argument| (*argument).to_owned()).collect();
        let process = plant_process(&settings, &arguments, &said);
        Self { process, settings, said, arguments, _folder: folder }
    }

    /// Kills it, and starts it again.
    pub fn restart(&mut self) {
        self.process.0.kill().unwrap();
        self.process.0.wait().unwrap();
        self.process = plant_process(&self.settings, &self.arguments, &self.said);
    }

    /// The value of `--set` by which a group takes the plant for its own, with further words for the stage.
    pub fn stage(&self, words: &[&str]) -> String {
        let program = env!("CARGO_BIN_EXE_hydraxis-fleet");
        let command = [&[program, "stage", self.settings.to_str().unwrap()], words].concat();
        format!("stage.plant-sim.command={}", json!(command))
    }

    /// What it has said since its start.
    pub fn said(&self) -> String {
        fs::read_to_string(&self.said).unwrap()
    }
}

fn plant_process(settings: &Path, arguments: &[String], said: &Path) -> Running {
    let mut command = fleet();
    command.arg("plant").arg(settings).args(["--seed", "7"]).args(arguments).env("RUST_LOG", "off");
    let process = Running(command.stdout(fs::File::create(said).unwrap()).spawn().unwrap());
    wait_for("the plant", || fs::read_to_string(said).unwrap().contains("waits at").then_some(()));
    process
}

/// A group of `hydraxis` on this computer, by a name of its own.
pub struct Group {
    pub prefix: String,
    process: Running,
    said: PathBuf,
    _state: tempfile::TempDir,
}

impl Group {
    /// Runs with these arguments.
    pub fn run(name: &str, arguments: &[&str]) -> Self {
        let prefix = format!("fleet{}-{name}", std::process::id());
        let state = tempfile::tempdir().unwrap();
        let mut command = hydraxis();
        command.args(["run", "--prefix", &prefix]).args(arguments);
        command.env("HYDRAXIS_RECORDINGS", "off").env("XDG_STATE_HOME", state.path());
        let said = state.path().join("said");
        let process = command.stdout(Stdio::null()).stderr(fs::File::create(&said).unwrap()).spawn().unwrap();
        Self { prefix, process: Running(process), said, _state: state }
    }

    /// Waits until the run has ended by itself: in lock-step a busy computer takes minutes. Whether it has succeeded.
    pub fn wait(&mut self) -> bool {
        self.process.0.wait().unwrap().success()
    }

    /// What it has said so far.
    pub fn said(&self) -> String {
        fs::read_to_string(&self.said).unwrap()
    }

    /// Whether the run has not ended.
    pub fn is_running(&mut self) -> bool {
        self.process.is_running()
    }

    /// A command about this group.
    pub fn command(&self, arguments: &[&str]) {
        let done = hydraxis().args(arguments).args(["--prefix", &self.prefix]).output().unwrap();
        assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.process.end();
    }
}
