//! The page of all machines, asked as a browser asks.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::Stdio,
};

use serde_json::Value;

use crate::harness::{Bridge, Group, Router, Running, fleet, wait_for};

struct Page {
    address: String,
    _process: Running,
}

impl Page {
    fn new(router: &str) -> Self {
        let mut command = fleet();
        command.args(["page", "--listen", "127.0.0.1:0", "--router", router]);
        let mut process = Running(command.stdout(Stdio::piped()).spawn().unwrap());
        let mut line = String::new();
        BufReader::new(process.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("all machines: http://").unwrap().trim_end_matches('/').to_owned();
        Self { address, _process: process }
    }

    /// Head and body of the answer.
    fn ask(&self, method: &str, path: &str, host: &str) -> (String, String) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let text = format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        stream.write_all(text.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.to_owned(), body.to_owned())
    }

    fn machine(&self) -> Option<Value> {
        let (_, body) = self.ask("GET", "/machines.json", "localhost");
        serde_json::from_str::<Vec<Value>>(&body).unwrap().into_iter().next()
    }
}

#[test]
fn the_page_has_all_machines_and_shows_old_ones_as_old() {
    let router = Router::new();
    let group = Group::run("page", &["--duration", "10min"]);
    let bridge = Bridge::new(&router.address, &group.prefix, "");
    let page = Page::new(&router.address);
    let live = wait_for("a live machine", || page.machine().filter(|row| row["state"] == "live"));
    assert_eq!((live["site"].as_str(), live["machine"].as_str()), (Some("quarry"), Some("ex-07")));
    wait_for("its axes", || page.machine().filter(|row| row["axes"].as_array().is_some_and(|axes| axes.len() == 4)));
    bridge.process.signal("STOP");
    let old = wait_for("its age", || page.machine().filter(|row| row["state"] != "live"));
    assert!(old["age_s"]["telemetry/encoder-sample"].as_f64().is_some_and(|age| age > 1.0), "{old}");

    for (path, part) in [("/", "<title>Hydraxis: machines"), ("/page.js", "machines.json"), ("/style.css", "table")] {
        let (head, body) = page.ask("GET", path, &page.address);
        assert!(head.starts_with("HTTP/1.1 200") && body.contains(part), "{path}: {head}");
        assert!(head.contains("content-security-policy: default-src 'none'"), "{head}");
    }
    for (method, path, host, status) in [
        ("GET", "/machines.json", "evil.example", "403"),
        ("GET", "/machines.json", "10.0.0.1:8090", "403"),
        ("POST", "/machines.json", "localhost", "405"),
        ("GET", "/../Cargo.toml", "localhost", "404"),
    ] {
        let (head, _) = page.ask(method, path, host);
        assert!(head.starts_with(&format!("HTTP/1.1 {status}")), "{method} {path} for {host}: {head}");
    }
}
