//! Axes that are operated from the page: each way in which the page can be lost stops them, and no request without the
//! token reaches the group.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::{Shutdown, SocketAddr, TcpListener, TcpStream},
    process::{Child, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Board, Group, Reader},
    message::{AxisMode, Request, ValveCommand, control_flag},
};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::{Dice, hydraxis, is_strict, running::Running, shared, signal, variable, wait_for};

/// Time in which an axis is off after its page is lost; and what is asserted on a busy machine, as in `tests/faults`.
const BOUND: Duration = Duration::from_millis(300);
const BUSY: Duration = Duration::from_millis(4 * 300 + 150);
/// The axes that move the teeth.
const AXES: [&str; 4] = ["boom", "arm", "telescope", "bucket"];
/// Time between two beats of a page.
const BEAT: Duration = Duration::from_millis(50);

/// A group with all axes off, its commands, and a monitor that may operate it.
pub struct Operated {
    commands: Reader<ValveCommand>,
    requests: Reader<Request>,
    _channels: Group,
    pub running: Running,
    monitor: Child,
    pub address: SocketAddr,
    token: String,
    /// What the server has told last.
    stamp: u64,
}

impl Operated {
    fn start(test: &str) -> Self {
        Self::start_with(test, &[])
    }

    /// With more arguments of the run.
    pub fn start_with(test: &str, arguments: &[&str]) -> Self {
        let options = ["--off", "--duration", "600s", "--set", "timing.feedback_timeout=1s"];
        let running = Running::start_with(test, &[arguments, &options].concat());
        let prefix = running.group.prefix.to_string();
        let mut command = hydraxis();
        command.args(["monitor", "--allow-control", "--listen", "127.0.0.1:0", "--prefix", &prefix]);
        let mut monitor = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(monitor.stderr.take().unwrap()).lines();
        let line = lines.find_map(|line| Some(line.unwrap().strip_prefix("control: http://")?.to_owned())).unwrap();
        let (address, rest) = line.split_once("/#").unwrap();
        let token = rest.split(' ').next().unwrap().to_owned();
        let channels = running.group.join();
        let (commands, requests) = (channels.reader().unwrap(), channels.reader().unwrap());
        let address = address.parse().unwrap();
        let operated = Self { commands, requests, _channels: channels, running, monitor, address, token, stamp: 0 };
        wait_for("the group on the page", || {
            let (status, _) = operated.ask(operated.address, "press", &json!({}), Some(&operated.token));
            let (_, said) = operated.ask(operated.address, "off", &json!({}), None);
            (status == 400 && said["phase"] == "off").then_some(())
        });
        operated
    }

    /// Status and JSON of the answer to a request of the own page; 0 where there is none.
    pub fn ask(&self, to: SocketAddr, path: &str, body: &Value, token: Option<&str>) -> (u32, Value) {
        let body = body.to_string();
        let token = token.map(|token| format!("X-Hydraxis-Token: {token}\r\n")).unwrap_or_default();
        let host = self.address;
        let text = format!(
            "POST /control/{path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nConnection: close\r\n\
             Content-Type: application/json\r\n{token}Content-Length: {}\r\n\r\n{body}",
            body.len()
        );
        let answer = exchange(to, text.as_bytes());
        let json = answer.split_once("\r\n\r\n").and_then(|(_, body)| serde_json::from_str(body).ok());
        (status(&answer), json.unwrap_or_default())
    }

    /// Asks with the token over this address, and takes over the stamp of the answer.
    pub fn say(&mut self, to: SocketAddr, path: &str, body: &Value) -> (u32, Value) {
        let (status, said) = self.ask(to, path, body, Some(&self.token));
        self.stamp = said["stamp"].as_u64().unwrap_or(self.stamp);
        (status, said)
    }

    /// Holds the button of the boom over this address until its valve opens. Returns the number of the button.
    pub fn hold(&mut self, to: SocketAddr) -> u64 {
        let mut id = 0;
        wait_for("a press that arms the boom", || {
            id += 1;
            self.say(to, "hello", &json!({}));
            let stamp = self.stamp;
            let body = json!({"hold": id, "stamp": stamp, "axes": ["boom"], "mode": "manual", "command": 0.2});
            self.say(to, "press", &body);
            loop {
                let last = self.newest();
                if last.axes[0].operation == AxisMode::Manual as u32 && last.axes[0].command > 0.05 {
                    return Some(());
                }
                let body = json!({"hold": id, "stamp": self.stamp, "command": 0.2});
                // On a busy machine a beat may come too late: then the button is pressed again.
                let (status, said) = self.say(to, "beat", &body);
                if status != 200 || said["phase"] == "ended" {
                    return None;
                }
                thread::sleep(BEAT);
            }
        });
        id
    }

    pub fn newest(&mut self) -> ValveCommand {
        while self.commands.read().unwrap().if_new().is_some() {}
        self.commands.last().copied().unwrap_or_default()
    }

    /// Waits until the boom is off, and judges how long it took.
    fn expect_off(&mut self, way: &str, lost: Instant) {
        wait_for("the boom to be off", || {
            let boom = self.newest().axes[0];
            (boom.flags & control_flag::DISARMED != 0 && boom.command == 0.0).then_some(())
        });
        let (took, allowed) = (lost.elapsed(), if is_strict() { BOUND } else { BUSY });
        eprintln!("{way}: off after {took:.1?}; bound {BOUND:?}, asserted {allowed:?}");
        assert!(took <= allowed, "{way}: off after {took:?}, allowed {allowed:?}");
    }
}

impl Drop for Operated {
    fn drop(&mut self) {
        let _ = self.monitor.kill();
        let _ = self.monitor.wait();
    }
}

/// The whole answer to these bytes; nothing where there is none.
fn exchange(to: SocketAddr, request: &[u8]) -> String {
    let mut bytes = Vec::new();
    if let Ok(mut stream) = TcpStream::connect(to) {
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let _ = stream.write_all(request);
        let _ = stream.read_to_end(&mut bytes);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn status(answer: &str) -> u32 {
    answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default()
}

/// A network between page and server that can be cut: then it takes bytes and delivers none, and closes nothing.
struct Network {
    address: SocketAddr,
    is_cut: Arc<AtomicBool>,
}

impl Network {
    fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (address, is_cut) = (listener.local_addr().unwrap(), Arc::new(AtomicBool::new(false)));
        let cut = Arc::clone(&is_cut);
        thread::spawn(move || {
            for page in listener.incoming().flatten() {
                let Ok(server) = TcpStream::connect(server) else { continue };
                for (from, to) in [(&page, &server), (&server, &page)] {
                    let (from, to, cut) = (from.try_clone().unwrap(), to.try_clone().unwrap(), Arc::clone(&cut));
                    thread::spawn(move || carry(from, to, &cut));
                }
            }
        });
        Self { address, is_cut }
    }
}

fn carry(mut from: TcpStream, mut to: TcpStream, is_cut: &AtomicBool) {
    let mut bytes = [0; 4096];
    while let Ok(length) = from.read(&mut bytes) {
        if is_cut.load(Ordering::Acquire) {
            thread::sleep(Duration::from_secs(5));
            return;
        }
        if length == 0 || to.write_all(&bytes[..length]).is_err() {
            let _ = to.shutdown(Shutdown::Write);
            return;
        }
    }
}

#[test]
fn an_axis_is_off_after_each_way_to_lose_its_page() {
    let _cores = shared();
    let mut operated = Operated::start("control-lost");
    let server = operated.address;

    let id = operated.hold(server);
    let lost = Instant::now();
    assert_eq!(operated.say(server, "release", &json!({"hold": id})).0, 200);
    operated.expect_off("the button is released", lost);

    operated.hold(server);
    operated.expect_off("the page is frozen or hidden: no beat comes", Instant::now());

    let id = operated.hold(server);
    let (stale, lost) = (operated.stamp, Instant::now());
    // A network that keeps requests back delivers the beats of then, which have the stamp of then.
    while operated.newest().axes[0].flags & control_flag::DISARMED == 0 && lost.elapsed() < BUSY {
        operated.ask(server, "beat", &json!({"hold": id, "stamp": stale, "command": 0.2}), Some(&operated.token));
        thread::sleep(BEAT / 5);
    }
    operated.expect_off("beats come late", lost);

    let network = Network::to(server);
    operated.hold(network.address);
    network.is_cut.store(true, Ordering::Release);
    operated.expect_off("the network is cut", Instant::now());

    operated.hold(server);
    let lost = Instant::now();
    assert_eq!(operated.ask(server, "off", &json!({}), None).0, 200, "off needs no token");
    operated.expect_off("off", lost);

    let id = operated.hold(server);
    operated.say(server, "hello", &json!({}));
    let body = json!({"hold": id, "stamp": operated.stamp, "command": 0.9});
    assert_ne!(operated.say(server, "beat", &body).0, 200, "more than a page may command");
    operated.expect_off("the command is refused", Instant::now());

    operated.hold(server);
    signal(operated.monitor.id(), Signal::STOP);
    operated.expect_off("the server hangs", Instant::now());
    signal(operated.monitor.id(), Signal::CONT);

    operated.hold(server);
    let lost = Instant::now();
    operated.monitor.kill().unwrap();
    operated.expect_off("the server is killed", lost);
    operated.monitor.wait().unwrap();
    let last = operated.newest();
    assert!(last.axes[1..4].iter().all(|axis| axis.flags & control_flag::DISARMED != 0), "only the boom was asked");
}

#[test]
fn a_request_of_another_origin_or_that_never_ends_is_refused() {
    let _cores = shared();
    let operated = Operated::start("control-origins");
    let server = operated.address;
    let request_to = |uri: &str, origin: &str, length: usize, body: &str| {
        let token = &operated.token;
        let text = format!(
            "POST {uri} HTTP/1.1\r\nHost: {server}\r\nOrigin: {origin}\r\nContent-Type: application/json\r\n\
             X-Hydraxis-Token: {token}\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        status(&exchange(server, text.as_bytes()))
    };
    let request = |origin: &str, length, body: &str| request_to("/control/press", origin, length, body);
    for path in ["hello", "press", "beat", "release", "reset", "off"] {
        let uri = format!("http://evil.example/control/{path}");
        assert_eq!(request_to(&uri, &format!("http://{server}"), 2, "{}"), 421, "{uri}");
    }
    assert_eq!(request_to(&format!("http://{server}/control/hello"), &format!("http://{server}"), 2, "{}"), 200);
    assert_eq!(request("http://evil.example", 2, "{}"), 403);
    assert_eq!(request(&format!("http://{server}"), 5000, &" ".repeat(5000)), 413);
    let begin = Instant::now();
    assert!(matches!(request(&format!("http://{server}"), 2, "{"), 408 | 0), "the rest of the body never comes");
    assert!(begin.elapsed() < Duration::from_secs(20));
}

/// A body with one field more.
fn with(mut body: Value, key: &str, value: f64) -> Value {
    body[key] = value.into();
    body
}

/// A press that moves the teeth.
fn teeth(axes: &[&str], mode: &str, x: f64, speed: f64) -> Value {
    json!({"hold": 9, "stamp": "now", "axes": axes, "mode": mode, "teeth": {"x": x, "z": -0.5, "speed": speed}})
}

#[test]
fn the_page_moves_the_teeth_for_as_long_as_the_button_is_held() {
    let _cores = shared();
    let files = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator");
    let (machine, model) = (format!("{files}.toml"), format!("{files}-model.toml"));
    let settings = AXES.map(|axis| format!("axis.{axis}.reference.kind=channel"));
    let mut arguments = vec![machine.as_str(), "--model", &model];
    arguments.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let mut operated = Operated::start_with("control-teeth", &arguments);
    let server = operated.address;
    let start = wait_for("the teeth", || Some(operated.newest().teeth).filter(|teeth| teeth.state != 0));
    // How far the teeth have to go at first and in the end, m, and why the button is over, if not by its release there.
    let mut press = |id: u64, x: f64| {
        operated.say(server, "hello", &json!({}));
        let mut body = teeth(&AXES, "track", x, 0.2);
        (body["hold"], body["stamp"], body["teeth"]["z"]) = (id.into(), operated.stamp.into(), start.z.into());
        operated.say(server, "press", &body);
        let mut to_go: Vec<f64> = Vec::new();
        loop {
            let (status, said) = operated.say(server, "beat", &json!({"hold": id, "stamp": operated.stamp}));
            let told: Option<f64> =
                said["told"].as_str().and_then(|told| told.split_once("degrees: ")?.1.split(' ').next()?.parse().ok());
            to_go.extend(told);
            let has_arrived = to_go.last().is_some_and(|to_go| *to_go < 0.02);
            if has_arrived {
                operated.say(server, "release", &json!({"hold": id}));
            }
            if status != 200 || said["phase"] == "ended" || has_arrived {
                eprintln!("{status} {said}");
                return (to_go.first().copied(), has_arrived, said["why"].as_str().unwrap_or_default().to_owned());
            }
            thread::sleep(BEAT);
        }
    };
    let mut id = 10;
    let begun = wait_for("the teeth at their place", || {
        // On a busy machine a beat may come too late: then the button is pressed again.
        id += 1;
        let (begun, has_arrived, _) = press(id, start.x - 0.4);
        begun.filter(|_| has_arrived)
    });
    assert!(begun > 0.02, "{begun}");
    wait_for("a place out of reach to be refused", || {
        id += 1;
        press(id, 14.0).2.contains("soft limits").then_some(())
    });
    operated.expect_off("the button is released", Instant::now());
    let newest = operated.newest();
    assert!(newest.axes[..4].iter().all(|axis| axis.flags & control_flag::DISARMED != 0));
}

#[test]
fn an_expired_button_cannot_be_held_again_and_wrong_values_are_refused() {
    let _cores = shared();
    let mut operated = Operated::start("control-values");
    let server = operated.address;
    let id = operated.hold(server);
    operated.expect_off("no beat comes", Instant::now());
    operated.say(server, "hello", &json!({}));
    let body = json!({"hold": id, "stamp": operated.stamp, "command": 0.2});
    wait_for("the end of the button", || (operated.say(server, "beat", &body).1["phase"] != "held").then_some(()));
    let stamp = |operated: &mut Operated| {
        operated.say(server, "hello", &json!({}));
        operated.stamp
    };
    for (expected, body) in [
        (409, json!({"hold": 9, "stamp": 0, "axes": ["boom"], "mode": "hold"})),
        (409, json!({"hold": 9, "stamp": u64::MAX, "axes": ["boom"], "mode": "hold"})),
        (422, json!({"hold": 9, "stamp": "now", "axes": [], "mode": "hold"})),
        (422, json!({"hold": 9, "stamp": "now", "axes": ["nose"], "mode": "hold"})),
        (422, json!({"hold": 9, "stamp": "now", "axes": ["boom"], "mode": "commission"})),
        (422, json!({"hold": 9, "stamp": "now", "axes": ["boom"], "mode": "hold", "target": 99.0})),
        (422, json!({"hold": 9, "stamp": "now", "axes": ["boom"], "mode": "manual", "command": 1.5})),
        (422, json!({"hold": 9, "stamp": "now", "axes": ["boom"], "mode": "manual", "command": -0.301})),
        (422, teeth(&["boom"], "track", 6.2, 0.1)),
        (422, teeth(&AXES, "hold", 6.2, 0.1)),
        (422, teeth(&AXES, "track", 200.0, 0.1)),
        (422, teeth(&AXES, "track", 6.2, 0.3)),
        (422, teeth(&AXES, "track", 6.2, 0.0)),
        (422, with(teeth(&AXES, "track", 6.2, 0.1), "command", 0.2)),
        (400, json!({"hold": 9, "stamp": "now", "axes": AXES, "mode": "track", "teeth": {"x": 6.2, "speed": 0.1}})),
        (400, json!({"hold": 9, "stamp": "now", "axes": ["boom"], "mode": "hold", "force": 1})),
        (400, json!({"hold": 9})),
    ] {
        wait_for("this refusal", || {
            let mut body = body.clone();
            if body["stamp"] == "now" {
                body["stamp"] = stamp(&mut operated).into();
            }
            let (status, said) = operated.say(server, "press", &body);
            // A stamp that got old on a busy machine is tried again.
            (status == expected).then_some(()).or_else(|| {
                assert!(status == 409, "{body}: {status} {said}, expected {expected}");
                None
            })
        });
    }
    let newest = operated.newest();
    assert!(newest.axes[..4].iter().all(|axis| axis.flags & control_flag::DISARMED != 0));
}

/// A random request without the token. Its parts are those of right requests, of wrong ones, and noise.
fn request(dice: &mut Dice, host: SocketAddr) -> Vec<u8> {
    const PATHS: [&str; 17] = [
        "/control/gain",
        "/control/press",
        "/control/press",
        "/control/beat",
        "/control/release",
        "/control/reset",
        "/control/hello",
        "/control/",
        "/control/../control/press",
        "//control/press",
        "/control/press?token=",
        "/state",
        "/",
        "/control/Press",
        "/control/press/",
        "http://HOST/control/press",
        "http://evil.example/control/press",
    ];
    const BODIES: [&str; 7] = [
        r#"{"axis":"boom","gain":0.5}"#,
        r#"{"hold":1,"stamp":STAMP,"axes":["boom"],"mode":"manual","command":0.5}"#,
        r#"{"hold":1,"stamp":STAMP,"command":0.5}"#,
        r#"{"axes":["boom"]}"#,
        r#"{"hold":1}"#,
        "{}",
        "[[[[",
    ];
    let method = dice.one_of(&["POST", "POST", "POST", "POST", "GET", "PUT", "OPTIONS", "post", "HEAD"]);
    let body = dice.one_of(&BODIES).replace("STAMP", &dice.below(20_000).to_string());
    let token = match dice.below(6) {
        0 => String::new(),
        1 => "X-Hydraxis-Token: \r\n".to_owned(),
        2 => format!("X-Hydraxis-Token: {}\r\n", "0".repeat(64)),
        3 => format!("Authorization: Basic {}\r\n", dice.below(u64::MAX)),
        4 => format!("Cookie: token={:064x}\r\n", dice.below(u64::MAX)),
        _ => format!("X-Hydraxis-Token: {:016x}{:048x}\r\n", dice.below(u64::MAX), dice.below(u64::MAX)),
    };
    let origin = match dice.below(4) {
        0 => "Origin: http://evil.example\r\n".to_owned(),
        _ => format!("Origin: http://{host}\r\n"),
    };
    let kind = dice.one_of(&["application/json", "application/json", "text/plain", "application/json; x=1"]);
    let length = if dice.once_in(10) { dice.below(5000) as usize } else { body.len() };
    let path = dice.one_of(&PATHS).replace("HOST", &host.to_string());
    let text = format!(
        "{method} {path} HTTP/1.1\r\nHost: {host}\r\n{origin}Content-Type: {kind}\r\n{token}Connection: close\r\n\
         Content-Length: {length}\r\n\r\n{body}"
    );
    let mut bytes = text.into_bytes();
    if dice.once_in(8) {
        for _ in 0..=dice.below(8) {
            let at = dice.below(bytes.len() as u64) as usize;
            bytes[at] = dice.below(256) as u8;
        }
    }
    bytes
}

#[test]
fn no_request_without_the_token_reaches_the_group() {
    let _cores = shared();
    let mut operated = Operated::start("control-fuzz");
    let prefix = operated.running.group.prefix.clone();
    let board = Board::find(&prefix).unwrap().unwrap();
    let asked = board.asked();
    let tries = variable("HYDRAXIS_CONTROL_TRIES", 10_000);
    let mut dice = Dice::new("control", "HYDRAXIS_CONTROL_SEED", &format!("HYDRAXIS_CONTROL_TRIES={tries}"));
    let mut answers = std::collections::BTreeMap::new();
    for _ in 0..tries {
        let bytes = request(&mut dice, operated.address);
        let mut stream = TcpStream::connect(operated.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        *answers.entry(status(&answer)).or_insert(0u32) += 1;
        let is_read = answer.contains("text/html") || answer.contains("\"hello\"") || answer.is_empty();
        assert!(status(&answer) >= 400 || is_read || status(&answer) == 0 || bytes.starts_with(b"HEAD"), "{answer}");
        assert!(operated.requests.read().unwrap().if_new().is_none(), "{}", String::from_utf8_lossy(&bytes));
    }
    eprintln!("{tries} requests, by status: {answers:?}");
    assert!(answers[&403] > 100 && answers[&429] > 100 && answers[&400] > 100, "{answers:?}");
    assert_eq!(board.asked(), asked, "no stop either");
    let newest = operated.newest();
    assert!(newest.axes[..4].iter().all(|axis| axis.flags & control_flag::DISARMED != 0 && axis.command == 0.0));
    // So many wrong tokens keep the right one out for a minute; off works all the time.
    assert_eq!(operated.ask(operated.address, "hello", &json!({}), Some(&operated.token)).0, 429);
    assert_eq!(operated.ask(operated.address, "off", &json!({}), None).0, 200);
    assert_ne!(board.asked(), asked);
}
