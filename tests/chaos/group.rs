//! One group after another: their starts, faults and ends, each within a bound and without leavings.

use std::{
    collections::BTreeMap,
    process::{Child, Stdio},
    time::{Duration, Instant},
};

use pipeline::{channel::Prefix, stage::StageKind};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    dice::Dice,
    harness::{
        PATIENCE, files, hydraxis, is_running, processes,
        running::{Running, Said},
        signal, succeed,
    },
    watch::Watch,
};

/// Bounds of a time that a stage is stopped for, or that a client gets.
pub const SHORTEST: Duration = Duration::from_millis(5);
pub const LONGEST: Duration = Duration::from_secs(3);

/// What has happened over all groups.
#[derive(Default)]
pub struct Tally {
    pub kills: u64,
    pub stops: u64,
    pub clients: u64,
    pub groups: u64,
    pub restarts: u64,
    pub published: u64,
    pub lost: u64,
    /// How groups ended, and how often.
    pub ends: BTreeMap<String, u64>,
    /// Reaction times by what was done, ms.
    pub reactions: BTreeMap<String, Vec<f64>>,
}

impl Tally {
    pub fn react(&mut self, what: &str, from_ns: u64, to_ns: u64) -> f64 {
        let milliseconds = to_ns.saturating_sub(from_ns) as f64 * 1e-6;
        self.reactions.entry(what.to_owned()).or_default().push(milliseconds);
        milliseconds
    }

    pub fn print(&mut self, wall: Duration) {
        let Self { kills, stops, clients, groups, restarts, published, lost, .. } = self;
        println!(
            "{kills} kills, {stops} stops, {clients} clients in {groups} groups; {restarts} restarts seen; {published} \
             messages, of which this reader has lost {lost}; {:.0} s",
            wall.as_secs_f64()
        );
        for (end, count) in &self.ends {
            println!("{count:5} x {end}");
        }
        for (what, times) in &mut self.reactions {
            times.sort_unstable_by(f64::total_cmp);
            let (median, longest) = (times[times.len() / 2], times[times.len() - 1]);
            println!("{what}: p50 {median:.1} ms, longest {longest:.1} ms, {} times", times.len());
        }
    }
}

/// A group that runs, and whoever looks at it.
pub struct Chaos {
    running: Running,
    pub watch: Option<Watch>,
    /// Stages that were stopped and not let go.
    pub stopped: Vec<u32>,
    /// Stages that something was done to.
    pub disturbed: [bool; 4],
}

impl Chaos {
    pub fn start(test: &str, arguments: &[&str], tally: &mut Tally) -> Self {
        tally.groups += 1;
        let running = Running::start_with(test, arguments);
        let watch = Some(Watch::new(&running.group.prefix, running.pids));
        Self { running, watch, stopped: Vec::new(), disturbed: [false; 4] }
    }

    pub fn prefix(&self) -> &Prefix {
        &self.running.group.prefix
    }

    pub fn watch(&mut self) -> &mut Watch {
        self.watch.as_mut().unwrap()
    }

    /// Reads along for a time.
    pub fn look_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.look();
        }
    }

    /// Reads along until something is there; none when the group has ended before.
    pub fn look_until<T>(&mut self, what: &str, mut look: impl FnMut(&mut Self) -> Option<T>) -> Option<T> {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(seen) = look(self) {
                return Some(seen);
            }
            if self.has_ended() {
                return None;
            }
            assert!(Instant::now() < until, "waited {PATIENCE:?} for {what}");
            self.look();
        }
    }

    fn look(&mut self) {
        self.watch().poll();
        self.running.pids = self.watch().pids;
        std::thread::sleep(Duration::from_micros(500));
    }

    pub fn has_ended(&mut self) -> bool {
        self.running.supervisor.try_wait().unwrap().is_some()
    }

    /// Runs another command to its end, reading along; its exit code.
    pub fn finish(&mut self, mut client: Child) -> Option<i32> {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = client.try_wait().unwrap() {
                return status.code();
            }
            assert!(Instant::now() < until, "waited {PATIENCE:?} for {client:?}");
            self.look();
        }
    }

    /// A client reads along, and may be killed while it does.
    pub fn visit(&mut self, dice: &mut Dice, tally: &mut Tally) {
        let is_killed = dice.once_in(2);
        dice.note(if is_killed { "status, killed" } else { "status" });
        tally.clients += 1;
        let mut status = client(&["status", "--prefix", &self.prefix().to_string()]);
        if is_killed {
            self.look_for(dice.duration(SHORTEST, Duration::from_millis(300)));
            let _ = status.kill();
        }
        self.finish(status);
    }

    /// Sends a signal to a stage, if it lives; false when it does not.
    pub fn signal(&mut self, kind: StageKind, signal: Signal) -> bool {
        let pid = self.watch().pids[kind as usize];
        if signal != Signal::USR1 {
            self.disturbed[kind as usize] = true;
        }
        is_running(pid) && kill_process(Pid::from_raw(pid as i32).unwrap(), signal).is_ok()
    }

    /// Lets go of all stages that are stopped.
    pub fn release(&mut self) {
        for pid in self.stopped.drain(..) {
            let _ = kill_process(Pid::from_raw(pid as i32).unwrap(), Signal::CONT);
        }
    }

    /// Stops looking, with the sums checked.
    fn look_away(&mut self, tally: &mut Tally) {
        if let Some(mut watch) = self.watch.take() {
            let (published, lost) = watch.check_numbers();
            tally.published += published;
            tally.lost += lost;
            tally.restarts += watch.restarts();
        }
    }

    /// Ends the group in order: nothing is left at once.
    pub fn interrupt(mut self, tally: &mut Tally) -> Said {
        self.release();
        self.look_away(tally);
        let said = self.running.interrupt();
        self.expect_nothing();
        *tally.ends.entry("asked to end".to_owned()).or_default() += 1;
        said
    }

    /// Waits for the end that the group comes to by itself.
    pub fn await_end(mut self, tally: &mut Tally) -> Said {
        self.look_away(tally);
        // Whoever was attached at its end has kept its files.
        let was_late = self.has_ended();
        let said = self.running.expect_end(0);
        if was_late {
            succeed(&["clean", "--prefix", &self.prefix().to_string()]);
        }
        self.expect_nothing();
        *tally.ends.entry("last tick".to_owned()).or_default() += 1;
        said
    }

    /// Kills the supervisor: no stage outlives it, and the next command of this name cleans up.
    pub fn orphan(mut self, dice: &mut Dice, tally: &mut Tally) {
        self.release();
        dice.note("SIGKILL supervisor");
        tally.kills += 1;
        let started = Instant::now();
        signal(self.running.supervisor.id(), Signal::KILL);
        self.running.supervisor.wait().unwrap();
        // Also those whose first word has not come yet.
        while processes(self.prefix()) != Vec::<String>::new() {
            assert!(started.elapsed() < PATIENCE, "{:?}", processes(self.prefix()));
            self.look();
        }
        let took = started.elapsed();
        let reaction = tally.reactions.entry("stages gone after their supervisor".to_owned()).or_default();
        reaction.push(took.as_secs_f64() * 1e3);
        assert!(took < Duration::from_secs(1), "the stages have outlived their supervisor by {took:?}");
        self.look_away(tally);
        let prefix = self.prefix().to_string();
        if dice.once_in(2) {
            succeed(&["clean", "--prefix", &prefix]);
        } else {
            succeed(&["run", "--prefix", &prefix, "--lockstep", "--duration", "0.2s"]);
        }
        self.expect_nothing();
        *tally.ends.entry("supervisor killed".to_owned()).or_default() += 1;
    }

    /// Waits for the end of a group that something has ended; what it gives as the cause.
    pub fn await_failure(mut self, tally: &mut Tally) -> String {
        // Whoever reads along keeps the group's files.
        let pids = self.watch().pids;
        self.look_away(tally);
        self.running.pids = pids;
        let said = self.running.expect_end(1);
        self.release();
        let verdict = said.stderr.lines().rev().find(|line| !line.starts_with("  ")).unwrap_or_default().to_owned();
        let disturbed = StageKind::ALL.into_iter().filter(|kind| self.disturbed[*kind as usize]);
        let is_named = disturbed.into_iter().any(|kind| verdict.starts_with(&format!("{} killed", kind.name())));
        assert!(is_named, "{}", said.stderr);
        succeed(&["clean", "--prefix", &self.prefix().to_string()]);
        self.expect_nothing();
        *tally.ends.entry(verdict.clone()).or_default() += 1;
        verdict
    }

    /// Neither a process nor a file.
    fn expect_nothing(&self) {
        assert_eq!(processes(self.prefix()), Vec::<String>::new());
        assert_eq!(files(self.prefix()), Vec::<std::path::PathBuf>::new());
    }
}

impl Drop for Chaos {
    fn drop(&mut self) {
        self.release();
    }
}

/// Another command on the group.
pub fn client(arguments: &[&str]) -> Child {
    hydraxis().args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}
