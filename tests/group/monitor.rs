//! The page of a running group: what it shows, what it refuses, and that neither clients nor groups disturb it.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Read, Write},
    net::{Shutdown, SocketAddr, TcpStream},
    process::{Child, Stdio},
    time::{Duration, Instant},
};

use pipeline::{channel::Reader, message::MachineState};
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::{
    FOUR_AXES, TestGroup, hydraxis, is_running, processes, running::Running, shared, signal, wait_for,
};

/// Longest answer of the server to a single request.
const PATIENCE: Duration = Duration::from_secs(20);
/// Most memory of the server, kB.
const MOST_MEMORY: u64 = 150_000;

/// `hydraxis monitor` on a free port.
struct Monitor {
    child: Child,
    address: SocketAddr,
}

impl Monitor {
    fn start(group: &TestGroup, arguments: &[&str]) -> Self {
        let mut command = hydraxis();
        command.args(["monitor", "--listen", "127.0.0.1:0", "--prefix", &group.prefix.to_string()]).args(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = address(&line).unwrap_or_else(|| panic!("{line:?}"));
        Self { child, address }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// The whole answer to these bytes; nothing where the server only closes the connection.
    fn answer(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        // The server may refuse a request before it has read all of it.
        let _ = stream.write_all(request);
        if !request.ends_with(b"\r\n\r\n") && !request.ends_with(b"abc") {
            // Nothing more comes: the server need not wait for the rest.
            let _ = stream.shutdown(Shutdown::Write);
        }
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Status, head and body of a page.
    fn get(&self, path: &str) -> (u32, String, String) {
        let answer = self.answer(format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.address).as_bytes());
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{path}: {answer:?}"));
        (status(&answer), head.to_lowercase(), body.to_owned())
    }

    fn json(&self, path: &str) -> Value {
        let body = self.get(path).2;
        serde_json::from_str(&body).unwrap_or_else(|error| panic!("{path}: {error}: {body}"))
    }

    fn await_health(&self, expected: u32) {
        wait_for("the health of the group", || (self.get("/health").0 == expected).then_some(()));
    }

    /// Memory of the process, kB.
    fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    }

    /// Ends it as Ctrl-C does.
    fn end(mut self) {
        signal(self.child.id(), Signal::INT);
        let status = wait_for("the monitor to end", || self.child.try_wait().unwrap());
        assert!(status.success(), "{status}");
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The address in the line in which a monitor says where its page is.
fn address(line: &str) -> Option<SocketAddr> {
    line.split_once("monitor: http://")?.1.trim_end().strip_suffix('/')?.parse().ok()
}

/// The status of an answer; 0 where there is none.
fn status(answer: &str) -> u32 {
    answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default()
}

/// Events of a browser that watches.
struct Events(BufReader<TcpStream>);

impl Events {
    fn open(monitor: &Monitor) -> Self {
        let mut stream = monitor.connect();
        write!(stream, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", monitor.address).unwrap();
        Self(BufReader::new(stream))
    }

    /// The next event with this name.
    fn next(&mut self, name: &str) -> Value {
        let until = Instant::now() + PATIENCE;
        let mut is_it = false;
        while Instant::now() < until {
            let mut line = String::new();
            self.0.read_line(&mut line).unwrap();
            match line.trim_end().split_once(": ") {
                Some(("event", event)) => is_it = event == name,
                Some(("data", data)) if is_it => return serde_json::from_str(data).unwrap(),
                _ => {}
            }
        }
        panic!("no event {name}");
    }
}

fn start(test: &str) -> Running {
    Running::start_with(test, &["--duration", "600s"])
}

#[test]
fn the_page_has_the_values_of_the_channel_and_loads_nothing_from_elsewhere() {
    let _cores = shared();
    let running = start("monitor");
    let monitor = Monitor::start(&running.group, &[]);
    monitor.await_health(200);
    let (code, head, page) = monitor.get("/");
    assert_eq!(code, 200);
    assert!(head.contains("content-security-policy: default-src 'none'; script-src 'self'"), "{head}");
    assert!(head.contains("x-content-type-options: nosniff") && head.contains("cache-control: no-store"), "{head}");
    let files: Vec<&str> =
        page.split(['"', '\'']).filter(|part| part.ends_with(".js") || part.ends_with(".css")).collect();
    assert!(files.len() >= 6, "{files:?}");
    for file in files {
        let (code, _, text) = monitor.get(&format!("/{file}"));
        assert!(code == 200 && text.len() > 100, "{file}: {code}");
    }
    assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("//"), "{page}");

    let channels = running.group.join();
    let mut states: Reader<MachineState> = channels.reader().unwrap();
    let mut events = Events::open(&monitor);
    let hello = events.next("hello");
    assert_eq!(hello["group"], running.group.prefix.to_string());
    assert_eq!(hello["axes"][2]["name"], "telescope");
    let stages = events.next("stages");
    assert_eq!(stages["stages"].as_array().unwrap().len(), 4);
    let mut sent = BTreeMap::new();
    let mut compared = 0;
    while compared < 10 {
        let frame = events.next("axes");
        while let Some(state) = states.read().unwrap().if_new() {
            sent.insert(state.header.sequence, *state);
        }
        let Some(state) = frame["tick"].as_u64().and_then(|tick| sent.get(&tick)) else { continue };
        for (shown, axis) in frame["axes"].as_array().unwrap().iter().zip(&state.axes) {
            assert_eq!(shown["name"], axis.name());
            assert_eq!(shown["position"].as_f64(), axis.sample.last_plausible());
            assert_eq!(shown["command"].as_f64(), Some(axis.command.command));
            assert_eq!(shown["error"].as_f64(), Some(axis.command.error));
        }
        compared += 1;
    }
    let history = monitor.json("/history");
    let rows = history["t"].as_array().unwrap().len();
    assert!(rows >= 10 && history["bucket"]["error"].as_array().unwrap().len() == rows, "{rows}");
}

#[test]
fn programs_get_figures_and_health() {
    let _cores = shared();
    let running = start("monitor-figures");
    let monitor = Monitor::start(&running.group, &[]);
    monitor.await_health(200);
    assert_eq!(monitor.json("/health")["status"], "ok");
    let (code, head, text) = wait_for("axes", || {
        let answer = monitor.get("/metrics");
        answer.2.contains("hydraxis_axis_position_metres{axis=\"boom\"}").then_some(answer)
    });
    assert!(code == 200 && head.contains("content-type: text/plain; version=0.0.4"), "{head}");
    for part in [
        "hydraxis_up 1\n",
        "hydraxis_stage_up{stage=\"control-proc\"} 1\n",
        "hydraxis_stage_missed_deadlines_total{stage=\"sensor-proc\",cause=\"late release\"} ",
        "hydraxis_latency_seconds{stage=\"control-proc\",kind=\"end to end\",quantile=\"0.99\"} 0.",
        "hydraxis_axis_mode{axis=\"arm\",mode=\"track\",by=",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let state = monitor.json("/state");
    assert_eq!(state["hello"]["group"], running.group.prefix.to_string());
    assert!(state["axes"]["axes"][0]["position"].as_f64().is_some_and(|position| position > 0.1));
    assert_eq!(monitor.get("/nothing").0, 404);
    assert_eq!(monitor.get("/../Cargo.toml").0, 404);
}

#[test]
fn wrong_requests_are_refused_and_the_server_goes_on() {
    let _cores = shared();
    let group = TestGroup::new("monitor-wrong");
    let monitor = Monitor::start(&group, &["--host", "cab.local"]);
    let with = |lines: &str| {
        let host = monitor.address;
        status(&monitor.answer(lines.replace("HOST", &host.to_string()).replace('\n', "\r\n").as_bytes()))
    };
    assert_eq!(with("GET / HTTP/1.1\nHost: HOST\n\n"), 200);
    assert_eq!(with("HEAD / HTTP/1.1\nHost: HOST\n\n"), 200);
    assert_eq!(with("GET / HTTP/1.1\nHost: cab.local\n\n"), 200);
    assert_eq!(with("GET http://HOST/ HTTP/1.1\nHost: HOST\n\n"), 200);
    for (expected, request) in [
        (421, "GET /state HTTP/1.1\nHost: evil.example\n\n"),
        (421, "GET http://evil.example/state HTTP/1.1\nHost: HOST\n\n"),
        (421, "GET http://evil.example/events HTTP/1.1\nHost: HOST\n\n"),
        (421, "HEAD https://evil.example/ HTTP/1.1\nHost: HOST\n\n"),
        (400, "GET /state HTTP/1.1\n\n"),
        (403, "GET /state HTTP/1.1\nHost: HOST\nOrigin: http://evil.example\n\n"),
        (403, "GET /events HTTP/1.1\nHost: HOST\nSec-Fetch-Site: cross-site\n\n"),
        (405, "POST /state HTTP/1.1\nHost: HOST\nContent-Length: 3\n\nabc"),
        (405, "DELETE / HTTP/1.1\nHost: HOST\n\n"),
        (413, "GET / HTTP/1.1\nHost: HOST\nContent-Length: 3\n\nabc"),
        (413, "GET / HTTP/1.1\nHost: HOST\nTransfer-Encoding: chunked\n\n0\n\n"),
        (400, "GET / HTTP/9.9\nHost: HOST\n\n"),
        (400, "no request at all\n\n"),
    ] {
        assert_eq!(with(request), expected, "{request}");
    }
    let long = format!("GET /{} HTTP/1.1\nHost: HOST\n\n", "a".repeat(100_000));
    let many = format!("GET / HTTP/1.1\nHost: HOST\n{}\n", "X-Y: z\n".repeat(5000));
    for request in [long, many] {
        assert!(!(200..300).contains(&with(&request)), "{}", with(&request));
    }
    // Bytes that are no HTTP, of all kinds.
    let mut dice = 7u64;
    for _ in 0..200 {
        let mut bytes: Vec<u8> = Vec::new();
        for _ in 0..300 {
            dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            bytes.push((dice >> 56) as u8);
        }
        let answer = monitor.answer(&bytes);
        assert!(answer.is_empty() || status(&answer) == 400, "{answer}");
    }
    assert_eq!(monitor.get("/health").0, 503, "no such group runs");
    assert_eq!(monitor.json("/health")["status"], "absent");
    let mut events = Events::open(&monitor);
    assert!(events.next("hello")["group"].is_null());
    (0..2).for_each(|_| drop(events.next("alive")));
    monitor.end();
}

#[test]
fn clients_that_stall_are_dropped_and_others_are_served() {
    let _cores = shared();
    let running = start("monitor-stall");
    let monitor = Monitor::start(&running.group, &[]);
    monitor.await_health(200);
    let begin = Instant::now();
    let stalled: Vec<TcpStream> = (0..40)
        .map(|i| {
            let mut stream = monitor.connect();
            // Some ask and never read, some never finish asking.
            let end = if i % 2 == 0 { "\r\n" } else { "" };
            write!(stream, "GET /events HTTP/1.1\r\nHost: {}\r\n{end}", monitor.address).unwrap();
            stream
        })
        .collect();
    let mut events = Events::open(&monitor);
    let mut last = 0;
    let is_closed = |stream: &TcpStream| {
        // The server has closed a connection when the system says so; what it sent before is still there.
        let inode = stream.local_addr().unwrap().port();
        let table = std::fs::read_to_string("/proc/net/tcp").unwrap();
        let own = format!(":{inode:04X} ");
        !table.lines().any(|line| {
            line.split_whitespace().nth(2).is_some_and(|remote| format!("{remote} ").ends_with(&own))
                && line.split_whitespace().nth(3) == Some("01")
        })
    };
    while !stalled.iter().all(is_closed) {
        assert!(begin.elapsed() < Duration::from_secs(60), "connections stay open that nobody reads");
        let tick = events.next("axes")["tick"].as_u64().unwrap();
        assert!(tick >= last);
        last = tick;
        assert!(monitor.memory() < MOST_MEMORY, "{} kB", monitor.memory());
    }
    assert_eq!(monitor.get("/health").0, 200);
    drop(stalled);
}

#[test]
fn more_connections_than_there_are_places_are_closed_at_once() {
    let _cores = shared();
    let group = TestGroup::new("monitor-many");
    let monitor = Monitor::start(&group, &[]);
    let mut open: Vec<TcpStream> = (0..300).map(|_| monitor.connect()).collect();
    assert_eq!(monitor.answer(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"), "");
    // The places are free again when those who had them have gone.
    open.clear();
    wait_for("a free place", || {
        (status(&monitor.answer(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")) == 200).then_some(())
    });
    assert!(monitor.memory() < MOST_MEMORY);
}

#[test]
fn the_page_follows_a_group_that_ends_and_comes_back_and_leaves_nothing() {
    let _cores = shared();
    let mut running = start("monitor-back");
    let monitor = Monitor::start(&running.group, &[]);
    monitor.await_health(200);
    let mut events = Events::open(&monitor);
    assert_eq!(events.next("hello")["attachment"], 1);
    running.interrupt();
    let absent =
        wait_for("the end of the group", || Some(events.next("hello")).filter(|hello| hello["group"].is_null()));
    assert!(absent["why"].as_str().is_some_and(|why| !why.is_empty()), "{absent}");
    monitor.await_health(503);
    drop(running);

    // The monitor waits for the group while its supervisor starts, and must not be in its way.
    let mut running = start("monitor-back");
    let hello = wait_for("the next group", || Some(events.next("hello")).filter(|hello| !hello["group"].is_null()));
    assert_eq!(hello["attachment"], 2);
    monitor.await_health(200);
    let tick = wait_for("a state of the axes", || events.next("axes")["tick"].as_u64());
    assert!(events.next("axes")["tick"].as_u64().unwrap() >= tick);
    // After a kill of all of it, the monitor leaves so soon that the group can be started again.
    running.supervisor.kill().unwrap();
    running.supervisor.wait().unwrap();
    wait_for("the stages to die with their supervisor", || running.none_runs().then_some(()));
    wait_for("the monitor to leave", || events.next("hello")["group"].is_null().then_some(()));
    // The harness waits for files that the dead group has left.
    drop(running);
    let again = start("monitor-back");
    monitor.await_health(200);
    let pid = monitor.child.id();
    monitor.end();
    assert!(!is_running(pid));
    drop(again);
    assert_eq!(TestGroup::new("monitor-back").files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_run_shows_its_own_page_which_ends_with_it() {
    let _cores = shared();
    let group = TestGroup::new("monitor-run");
    let mut command = hydraxis();
    command.args(["run", FOUR_AXES, "--duration", "600s", "--prefix", &group.prefix.to_string()]);
    let mut child = command.arg("--monitor=127.0.0.1:0").stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let address = lines.by_ref().find_map(|line| address(&line.unwrap())).unwrap();
    let rest = std::thread::spawn(move || lines.map_while(Result::ok).count());
    let get = || -> Option<u32> {
        let mut stream = TcpStream::connect(address).ok()?;
        write!(stream, "GET /health HTTP/1.1\r\nHost: {address}\r\n\r\n").ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        Some(status(&answer))
    };
    wait_for("the page of the run", || (get() == Some(200)).then_some(()));
    signal(child.id(), Signal::INT);
    wait_for("the end of the run", || child.try_wait().unwrap());
    rest.join().unwrap();
    assert_eq!((get(), processes(&group.prefix)), (None, Vec::new()));
    assert_eq!(group.files(), Vec::<std::path::PathBuf>::new());

    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let option = format!("--monitor={}", taken.local_addr().unwrap());
    let refused = hydraxis().args(["run", FOUR_AXES, "--duration", "1s", &option]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("--monitor: the address cannot be used") && said.contains("127.0.0.1:0"), "{said}");
}
