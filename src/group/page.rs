//! The process that shows a running group as a page: `hydraxis monitor`, started by `hydraxis run --monitor`.
//!
//! It is no stage. Its death changes nothing for the group, and it ends with the supervisor.

use std::{
    io::{self, BufRead, BufReader},
    net::{SocketAddr, TcpListener},
    os::unix::process::CommandExt,
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::channel::Prefix;

/// Where the page is when the user says nothing: on this computer only.
pub const LISTEN: &str = "127.0.0.1:8787";
/// Time in which the process must end.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks whether it has ended.
const LOOK: Duration = Duration::from_millis(5);

/// The process. It is ended when this is dropped.
pub struct Page {
    process: Child,
}

/// Checks that the page can be at this address.
///
/// # Errors
/// What the system says.
pub fn check(address: SocketAddr) -> io::Result<()> {
    TcpListener::bind(address).map(drop)
}

/// Why a page at this address may not operate axes, if it may not.
pub fn refuse_control(address: SocketAddr) -> Option<String> {
    (!address.ip().is_loopback()).then(|| {
        format!(
            "--allow-control: found the address {address}, where the token could be read on the way; allowed: an \
             address of this computer only, such as {LISTEN}; from elsewhere come through ssh or a proxy with TLS"
        )
    })
}

impl Page {
    /// Starts the process for a group. With `allow_control` the page may operate axes. Returns the process, and the
    /// line in which it says where the page is.
    ///
    /// # Errors
    /// It cannot be started, or it has ended at once, for the reason that it has written to standard error.
    pub fn start(prefix: &Prefix, address: SocketAddr, allow_control: bool) -> io::Result<(Self, String)> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["monitor", "--parent", &std::process::id().to_string(), "--prefix", &prefix.to_string()]);
        command.args(["--listen", &address.to_string()]);
        if allow_control {
            command.arg("--allow-control");
        }
        // In a process group of its own, Ctrl-C reaches the supervisor only.
        let process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).process_group(0).spawn()?;
        let mut page = Self { process };
        let mut line = String::new();
        if let Some(stdout) = page.process.stdout.take() {
            BufReader::new(stdout).read_line(&mut line)?;
        }
        if line.is_empty() {
            return Err(io::Error::other("the process of the page has ended at once"));
        }
        Ok((page, line.trim_end().to_owned()))
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // The end of its standard input asks it to end.
        drop(self.process.stdin.take());
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if !matches!(self.process.try_wait(), Ok(None)) {
                return;
            }
            sleep(LOOK);
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
