//! Programs that are stopped, killed and thawed: nothing old counts as new, every loss is counted, and data is back.

use std::{
    thread::sleep,
    time::{Duration, Instant},
};

use hydraxis_fleet::{connection::Connection, fleet::Verdict, kernel::utc_ns, top};
use zenoh::Wait;

use crate::harness::{Bridge, Group, Router, fleet, heard::Heard, wait_for};

const SAMPLES: &str = "telemetry/encoder-sample";
const SECOND: i64 = 1_000_000_000;
/// Time in which data has to be back, and what a busy computer adds to it.
const BACK: Duration = Duration::from_secs(2);
const BUSY: Duration = Duration::from_secs(2);

fn newest_ns(heard: &Heard) -> i64 {
    heard.all().of(SAMPLES).last().map_or(0, |message| message.stamp.utc_ns)
}

/// Waits for a sample that was acquired after this time; the time that it took.
fn await_data(heard: &Heard, since_ns: i64) -> Duration {
    let begun = Instant::now();
    wait_for("data", || (newest_ns(heard) > since_ns).then_some(()));
    begun.elapsed()
}

fn state(heard: &Heard) -> top::State {
    top::rows(&heard.all().fleet, utc_ns())[0].state
}

/// The clock of the test and that of the machine are one. So a message that counts as fresh has to be of a sample that
/// was acquired in the second before it came.
fn expect_nothing_old_as_fresh(heard: &Heard) {
    for (key, messages) in &heard.all().messages {
        for message in messages {
            let age_ns = message.at_ns - message.stamp.utc_ns;
            assert!((message.verdict == Verdict::Fresh) == (age_ns <= SECOND), "{key}: {message:?}");
        }
    }
}

/// Every number that was given is one that came or one that counts as lost.
fn expect_every_loss_counted(heard: &Heard) {
    let all = heard.all();
    let gaps = |messages: &[crate::harness::heard::Message]| {
        let numbers: Vec<u64> = messages.iter().map(|message| message.stamp.number).collect();
        numbers.last().map_or(0, |last| last - numbers[0] + 1 - numbers.len() as u64)
    };
    let missing: u64 = all.messages.values().map(|messages| gaps(messages)).sum();
    assert_eq!(all.counts().lost, missing);
}

struct Setting {
    router: Router,
    heard: Heard,
    group: Group,
    bridge: Bridge,
}

impl Setting {
    fn new(name: &str) -> Self {
        let router = Router::new();
        let heard = Heard::new(&router.connection());
        let group = Group::run(name, &["--duration", "10min"]);
        let bridge = Bridge::new(&router.address, &group.prefix, "");
        wait_for("data", || (heard.all().of(SAMPLES).len() > 20).then_some(()));
        Self { router, heard, group, bridge }
    }
}

#[test]
fn a_bridge_that_is_suspended_for_four_seconds_sends_nothing_old_as_new() {
    let mut setting = Setting::new("frozen");
    let heard = &setting.heard;
    let unread = || -> u64 {
        let all = heard.all();
        let of =
            all.machine().unwrap().newest.status.as_ref().unwrap()["bridge"]["unread"].as_object().unwrap().clone();
        of.values().filter_map(serde_json::Value::as_u64).sum()
    };
    wait_for("a status", || heard.all().machine()?.newest.status.clone());
    let before = unread();
    setting.bridge.process.signal("STOP");
    wait_for("staleness", || (state(heard) == top::State::Stale).then_some(()));
    // A token goes with the lease of the link, 2 s later: it is no dead man.
    wait_for("the end of the token", || (state(heard) == top::State::Gone).then_some(()));
    sleep(Duration::from_secs(4));
    let thawed_ns = utc_ns();
    setting.bridge.process.signal("CONT");
    let back = await_data(heard, thawed_ns);
    println!("data is back {back:?} after the bridge was thawed");
    assert!(back < BACK + BUSY, "{back:?}");
    // The group has sent more than its channels keep for a reader.
    wait_for("the count of what was not read", || (unread() > before + 100).then_some(()));
    wait_for("life", || (state(heard) == top::State::Live).then_some(()));
    expect_nothing_old_as_fresh(heard);
    expect_every_loss_counted(heard);
    assert!(setting.bridge.process.is_running(), "the watchdog does not count the time of a suspension");
}

#[test]
fn a_bridge_that_was_killed_is_missed_and_comes_back_as_another_run() {
    let mut setting = Setting::new("dead");
    let heard = &setting.heard;
    setting.bridge.process.signal("KILL");
    // The router sees the end of the connection at once.
    wait_for("the end of the token", || (state(heard) == top::State::Gone).then_some(()));
    let killed_ns = utc_ns();
    setting.bridge = Bridge::new(&setting.router.address, &setting.group.prefix, "");
    wait_for("life", || (state(heard) == top::State::Live).then_some(()));
    assert!(newest_ns(heard) > killed_ns);
    assert_eq!(heard.all().counts().restarts, 1);
    expect_nothing_old_as_fresh(heard);
    assert!(setting.group.is_running(), "the group goes on without its bridge");
}

#[test]
fn a_bridge_has_the_limit_of_memory_of_its_settings() {
    let router = Router::new();
    let bridge = Bridge::new(&router.address, "no-group", "[limits]\nmemory-mb = 100\n");
    let limits = || std::fs::read_to_string(format!("/proc/{}/limits", bridge.process.0.id())).unwrap();
    let limit = wait_for("the limit", || {
        let text = limits();
        let line = text.lines().find(|line| line.starts_with("Max data size")).unwrap().to_owned();
        (!line.contains("unlimited")).then_some(line)
    });
    assert_eq!(limit.split_whitespace().nth(3), Some("104857600"), "{limit}");
}

#[test]
fn data_is_back_two_seconds_after_a_router_that_was_killed() {
    let mut setting = Setting::new("killed");
    setting.router.kill();
    let heard = &setting.heard;
    wait_for("staleness", || (state(heard) != top::State::Live).then_some(()));
    sleep(Duration::from_secs(3));
    setting.router.restart();
    let back = await_data(heard, utc_ns());
    println!("data is back {back:?} after the router");
    assert!(back < BACK + BUSY, "{back:?}");
    wait_for("a second of data", || (heard.all().of(SAMPLES).len() > 60).then_some(()));
    expect_nothing_old_as_fresh(heard);
    expect_every_loss_counted(heard);
    // About 20 samples and 20 commands a second were sent to nobody for 3 s and more.
    assert!(heard.all().counts().lost > 60, "{:?}", heard.all().counts());
    assert!(setting.bridge.process.is_running());
}

#[test]
fn a_router_that_is_suspended_for_three_seconds_delivers_nothing_old_as_new() {
    let mut setting = Setting::new("stopped");
    let heard = &setting.heard;
    setting.router.process.signal("STOP");
    wait_for("staleness", || (state(heard) != top::State::Live).then_some(()));
    sleep(Duration::from_secs(3));
    let thawed_ns = utc_ns();
    setting.router.process.signal("CONT");
    let back = await_data(heard, thawed_ns);
    println!("data is back {back:?} after the router was thawed");
    assert!(back < BACK + BUSY, "{back:?}");
    wait_for("a second of data", || (newest_ns(heard) > thawed_ns + SECOND).then_some(()));
    expect_nothing_old_as_fresh(heard);
    expect_every_loss_counted(heard);
    assert!(setting.bridge.process.is_running());
}

#[test]
fn a_reader_that_is_suspended_stops_nobody_else() {
    let mut setting = Setting::new("reader");
    let mut top = fleet();
    top.args(["top", "--json", "--router", &setting.router.address]).stdout(std::process::Stdio::null());
    let other = crate::harness::Running(top.spawn().unwrap());
    sleep(Duration::from_secs(1));
    other.signal("STOP");
    let begun_ns = utc_ns();
    // Longer than the 5 s for which a put that blocks would wait for it.
    sleep(Duration::from_secs(8));
    let all = setting.heard.all();
    let came: Vec<i64> =
        all.of(SAMPLES).iter().map(|message| message.at_ns).filter(|at_ns| *at_ns > begun_ns).collect();
    let longest = came.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(i64::MAX);
    println!("the longest gap of the other reader was {:.0} ms", longest as f64 * 1e-6);
    assert!(longest < 2 * SECOND, "{longest}");
    assert!(came.len() > 60, "{}", came.len());
    drop(all);
    other.signal("CONT");
    assert!(setting.bridge.process.is_running());
}

/// A port that takes connections and says nothing, as a computer that hangs.
fn silent_port() -> (std::net::TcpListener, String) {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp/{}", port.local_addr().unwrap());
    (port, address)
}

#[test]
fn of_several_routers_the_first_one_that_answers_is_taken_also_later() {
    let (mut first, second) = (Router::new(), Router::new());
    let (_port, silent) = silent_port();
    let closed = "tcp/127.0.0.1:1".to_owned();
    let session = |router: &[&String]| {
        let router = router.iter().map(|router| (*router).clone()).collect();
        Connection { router, tls: None }.open().unwrap()
    };
    let reader = session(&[&second.address]);
    let heard = reader.declare_subscriber("test").wait().unwrap();
    for dead in [&closed, &silent] {
        let begun = Instant::now();
        let sender = session(&[dead, &second.address]);
        wait_for("the second router", || {
            sender.put("test", "").wait().unwrap();
            heard.try_recv().unwrap()
        });
        println!("{dead}: reached after {:?}", begun.elapsed());
    }
    let sender = session(&[&first.address, &second.address]);
    sleep(Duration::from_secs(1));
    while heard.try_recv().unwrap().is_some() {}
    sender.put("test", "").wait().unwrap();
    sleep(Duration::from_secs(1));
    assert!(heard.try_recv().unwrap().is_none(), "it is at the first one");
    first.kill();
    let begun = Instant::now();
    wait_for("the second router", || {
        sender.put("test", "").wait().unwrap();
        heard.try_recv().unwrap()
    });
    println!("the second router is reached {:?} after the first was killed", begun.elapsed());
}
