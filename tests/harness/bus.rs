//! Devices of a CAN bus on a pseudo terminal: those of `hydraxis can simulate`.

use std::{
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, Stdio},
    sync::mpsc::{Receiver, channel},
    thread::spawn,
};

use rustix::process::Signal;

use super::{FOUR_AXES, hydraxis, signal, wait_for};

/// Those of [`settings`] that are for a busy computer.
pub const TIMES: [&str; 2] = ["can.heartbeat", "timing.drive_timeout"];

/// Settings that put the axes of [`FOUR_AXES`] on the bus at this link. The times are those of a busy computer.
pub fn settings(at: &Path) -> Vec<(String, String)> {
    let pair = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let mut settings = vec![pair("source.kind", "can"), pair("can.interface", &format!("\"{}\"", at.display()))];
    settings.push(pair("can.heartbeat", "1s"));
    settings.push(pair("timing.drive_timeout", "200ms"));
    for (i, axis) in ["boom", "arm", "telescope", "bucket"].iter().enumerate() {
        settings.push(pair(&format!("axis.{axis}.can.encoder"), &(11 + i).to_string()));
        settings.push(pair(&format!("axis.{axis}.can.valve"), &(21 + i).to_string()));
    }
    settings
}

/// Tables that put the axes of [`FOUR_AXES`] on messages of a machine of its own. The times are those of a busy
/// computer.
pub fn messages(at: &Path) -> String {
    let axes = ["boom", "arm", "telescope", "bucket"];
    let mut tables = format!("[can]\ninterface = \"{}\"\n", at.display());
    tables += "emergency_stop = \"State.Stop\"\npilot = \"State.Pilot\"\n";
    for (i, axis) in axes.iter().enumerate() {
        tables += &format!("[[can.message]]\nname = \"Of-{axis}\"\nid = {}\nlength = 8\n", 0x101 + i);
        tables += "signals = [\"Place 0|16@1- (1e-4,0) m\", \"Alive 16|8@1+\"]\n";
        tables += "counter = \"Alive\"\nchecksum = 7\ntimeout = \"200ms\"\n";
    }
    tables += "[[can.message]]\nname = \"State\"\nid = 0x110\nlength = 1\ntimeout = \"200ms\"\n";
    tables += "signals = [\"Lock 0|1@1+\", \"Pilot 1|1@1+\", \"Stop 2|1@1+\"]\n";
    tables +=
        "[[can.message]]\nname = \"Levers\"\nid = 0x120\nlength = 8\nsignals = [\"Mode 48|2@1+\", \"Alive 50|4@1+\"";
    for (i, axis) in axes.iter().enumerate() {
        tables += &format!(", \"{axis} {}|12@1- (0.0005,0)\"", 12 * i);
    }
    tables +=
        "]\ncounter = \"Alive\"\nchecksum = 7\nactive = [\"Mode=1\"]\nneutral = [\"Mode=0\"]\noff = [\"Mode=2\"]\n";
    for axis in axes {
        tables += &format!("[axis.{axis}.can]\nposition = \"Of-{axis}.Place\"\ncommand = \"Levers.{axis}\"\n");
        tables += "active = \"State.Lock\"\n";
    }
    tables
}

/// Settings as arguments of the command.
pub fn arguments(settings: &[(String, String)]) -> Vec<String> {
    settings.iter().flat_map(|(key, value)| ["--set".to_owned(), format!("{key}={value}")]).collect()
}

/// The devices, which end with this value.
pub struct Devices(Child);

/// Devices that take faults, and say when valves open and close.
pub struct Spoiled {
    devices: Devices,
    said: Receiver<String>,
}

impl Spoiled {
    /// Starts those of a machine file with more arguments; they are at the link then.
    pub fn start(machine: &str, at: &Path, more: &[String]) -> Self {
        let mut command = hydraxis();
        command.args(["can", "simulate", machine, "--faults", "--at"]).arg(at).args(more);
        let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let (sender, said) = channel();
        spawn(move || lines.map_while(Result::ok).try_for_each(|line| sender.send(line)));
        wait_for("devices", || at.exists().then_some(()));
        Self { devices: Devices(child), said }
    }

    /// Injects a fault.
    pub fn spoil(&mut self, fault: &str) {
        writeln!(self.devices.0.stdin.as_mut().unwrap(), "{fault}").unwrap();
        self.await_line(fault);
    }

    /// Waits until the devices have said a line with this text; returns it.
    pub fn await_line(&self, text: &str) -> String {
        wait_for(text, || self.said.try_iter().find(|line| line.contains(text)))
    }

    /// The lines that have come since.
    pub fn lines(&self) -> Vec<String> {
        self.said.try_iter().collect()
    }
}

impl Devices {
    /// Starts them; they are at the link then.
    pub fn start(at: &Path) -> Self {
        Self::start_with(at, &[])
    }

    /// Starts those of a machine with more settings.
    pub fn start_with(at: &Path, more: &[(&str, &str)]) -> Self {
        let mut settings = settings(at);
        settings.extend(more.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
        let mut command = hydraxis();
        command.args(["can", "simulate", FOUR_AXES, "--at"]).arg(at).args(arguments(&settings));
        let child = command.stderr(Stdio::null()).spawn().unwrap();
        wait_for("devices", || at.exists().then_some(()));
        Self(child)
    }

    /// Ends them, and waits for their end.
    pub fn end(mut self) {
        signal(self.0.id(), Signal::INT);
        assert!(self.0.wait().unwrap().success());
    }
}

impl Drop for Devices {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
