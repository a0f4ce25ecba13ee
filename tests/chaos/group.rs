//! Groups that are started, disturbed and ended, one after another. Each ends within a bound and leaves no files.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    process::{Child, Stdio},
    time::{Duration, Instant},
};

use pipeline::{channel::Prefix, stage::StageKind};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    harness::{
        Dice, PATIENCE, files, hydraxis, is_running, processes,
        running::{Running, Said},
        signal, succeed,
    },
    watch::Watch,
};

/// Shortest and longest time for which a stage is stopped, or a client runs.
pub const SHORTEST: Duration = Duration::from_millis(5);
pub const LONGEST: Duration = Duration::from_secs(3);

/// Counts over all groups of a test.
#[derive(Default)]
pub struct Tally {
    pub kills: u64,
    pub stops: u64,
    pub clients: u64,
    pub groups: u64,
    pub restarts: u64,
    pub published: u64,
    pub lost: u64,
    /// Stops of the axes, by a command, a signal or the board.
    pub axis_stops: u64,
    /// Starts of a name that runs already.
    pub other_starts: u64,
    pub foreign_files: u64,
    pub full_memory: u64,
    /// Travel of an axis at rest after a stop, mm, and its speed, mm/s; the largest ones.
    pub drift: (f64, f64),
    /// Number of groups by the way in which they ended.
    pub ends: BTreeMap<String, u64>,
    /// Reaction times by the kind of disturbance, ms.
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
        println!(
            "{} stops of axes, {} other starts of a running name, {} foreign files, memory full {} times; after a \
             stop no axis drifted by more than {:.2} mm, {:.2} mm/s",
            self.axis_stops, self.other_starts, self.foreign_files, self.full_memory, self.drift.0, self.drift.1
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

/// A running group, and the reader of all its channels.
pub struct Chaos {
    running: Running,
    pub watch: Option<Watch>,
    /// Stages that are stopped by SIGSTOP.
    pub stopped: Vec<u32>,
    /// Stages that were disturbed.
    pub disturbed: [bool; 4],
    /// Files that are not of this group, with names that begin like its own.
    pub foreign: Vec<PathBuf>,
}

/// What is in a foreign file.
pub const FOREIGN: &str = "foreign";

impl Chaos {
    pub fn start(test: &str, arguments: &[&str], tally: &mut Tally) -> Self {
        tally.groups += 1;
        let running = Running::start_with(test, arguments);
        let watch = Some(Watch::new(&running.group.prefix, running.pids));
        Self { running, watch, stopped: Vec::new(), disturbed: [false; 4], foreign: Vec::new() }
    }

    pub fn prefix(&self) -> &Prefix {
        &self.running.group.prefix
    }

    pub fn watch(&mut self) -> &mut Watch {
        self.watch.as_mut().unwrap()
    }

    /// Reads all channels for a time.
    pub fn look_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.look();
        }
    }

    /// Reads all channels until `look` returns something. Returns none if the group ends before.
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

    /// Reads all channels until another command has ended. Returns its exit code.
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

    /// Runs `hydraxis status`, and kills it every other time.
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

    /// Sends a signal to a stage. Returns false if the stage does not run.
    pub fn signal(&mut self, kind: StageKind, signal: Signal) -> bool {
        let pid = self.watch().pids[kind as usize];
        if signal != Signal::USR1 {
            self.disturbed[kind as usize] = true;
        }
        is_running(pid) && kill_process(Pid::from_raw(pid as i32).unwrap(), signal).is_ok()
    }

    /// Lets all stopped stages continue.
    pub fn release(&mut self) {
        for pid in self.stopped.drain(..) {
            let _ = kill_process(Pid::from_raw(pid as i32).unwrap(), Signal::CONT);
        }
    }

    /// Leaves the channels, after a check of the message counts.
    fn look_away(&mut self, tally: &mut Tally) {
        crate::stops::allow_motion(self, tally);
        if let Some(mut watch) = self.watch.take() {
            let (published, lost) = watch.check_numbers();
            tally.published += published;
            tally.lost += lost;
            tally.restarts += watch.restarts();
        }
    }

    /// Ends the group by SIGINT. Nothing is left as soon as the supervisor has ended.
    pub fn interrupt(mut self, tally: &mut Tally) -> Said {
        self.release();
        self.look_away(tally);
        let said = self.running.interrupt();
        self.expect_nothing();
        *tally.ends.entry("asked to end".to_owned()).or_default() += 1;
        said
    }

    /// Waits for a group that ends with its last tick.
    pub fn await_end(mut self, tally: &mut Tally) -> Said {
        self.look_away(tally);
        // If this test was still attached when the group ended, the files of the group are still there.
        let was_late = self.has_ended();
        let said = self.running.expect_orderly_end();
        if was_late {
            succeed(&["clean", "--prefix", &self.prefix().to_string()]);
        }
        self.expect_nothing();
        *tally.ends.entry("last tick".to_owned()).or_default() += 1;
        said
    }

    /// Kills the supervisor. All stages end with it, and the next command with this prefix removes the files.
    pub fn orphan(mut self, dice: &mut Dice, tally: &mut Tally) {
        self.release();
        dice.note("SIGKILL supervisor");
        tally.kills += 1;
        let started = Instant::now();
        signal(self.running.supervisor.id(), Signal::KILL);
        self.running.supervisor.wait().unwrap();
        // All processes of the group, also stages that have not sent a heartbeat yet.
        while processes(self.prefix()) != Vec::<String>::new() {
            assert!(started.elapsed() < PATIENCE, "{:?}", processes(self.prefix()));
            self.look();
        }
        let took = started.elapsed();
        let reaction = tally.reactions.entry("stages gone after their supervisor".to_owned()).or_default();
        reaction.push(took.as_secs_f64() * 1e3);
        assert!(took < Duration::from_secs(1), "the stages ended {took:?} after their supervisor");
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

    /// Waits for the end of a group that fails. Returns the cause that the supervisor prints.
    pub fn await_failure(mut self, tally: &mut Tally) -> String {
        // A reader would keep the files of the group.
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

    /// Expects that neither a process nor a file of the group is left, and that foreign files are as they were.
    fn expect_nothing(&mut self) {
        for path in self.foreign.drain(..) {
            assert_eq!(std::fs::read_to_string(&path).unwrap(), FOREIGN, "{}", path.display());
            std::fs::remove_file(path).unwrap();
        }
        assert_eq!(processes(self.prefix()), Vec::<String>::new());
        assert_eq!(files(self.prefix()), Vec::<PathBuf>::new());
    }
}

impl Drop for Chaos {
    fn drop(&mut self) {
        self.release();
        for path in &self.foreign {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Starts another command, whose output is of no interest.
pub fn client(arguments: &[&str]) -> Child {
    hydraxis().args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}
