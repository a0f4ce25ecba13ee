//! In lock-step a killed stage ends the run, and a stopped stage only delays it.

use std::time::Duration;

use pipeline::stage::StageKind;
use rustix::process::Signal;

use crate::{
    MANY_KILLS, dice,
    group::{Chaos, LONGEST, SHORTEST, Tally},
    harness::{Dice, FOUR_AXES, report, shared, strip_times},
    kills,
};

/// Duration of a run that is delayed. In both build profiles the run lasts until the first stop.
const DURATION: &str = if cfg!(debug_assertions) { "4s" } else { "40s" };
/// One group is delayed for so many groups that are killed.
const DELAYED: u64 = 8;

#[test]
fn in_lock_step_a_kill_ends_the_run_and_a_stop_only_delays_it() {
    run(kills());
}

#[test]
#[ignore = "takes ten minutes"]
fn of_many_runs_in_lock_step_a_kill_ends_each_and_a_stop_only_delays_it() {
    run(MANY_KILLS);
}

fn run(kills: u64) {
    let _cores = shared();
    let mut tally = Tally::default();
    let mut dice = dice("lock-step", kills);
    let undisturbed = report(&["run", FOUR_AXES, "--lockstep", "--duration", DURATION, "--seed", "3"]);
    for i in 0..kills {
        if i % DELAYED == 0 {
            delayed(&mut dice, &mut tally, &undisturbed);
        }
        killed(&mut dice, &mut tally);
    }
    tally.print(dice.elapsed());
}

/// Stops stages of a run and lets them continue. The figures of the run are those of an undisturbed run.
fn delayed(dice: &mut Dice, tally: &mut Tally, undisturbed: &serde_json::Value) {
    let arguments = ["--lockstep", "--duration", DURATION, "--seed", "3", "--json", "-"];
    let mut chaos = Chaos::start("chaos-delay", &arguments, tally);
    for _ in 0..3 {
        stop(&mut chaos, dice, tally);
        chaos.release();
        chaos.visit(dice, tally);
    }
    let said = chaos.await_end(tally);
    let mut report = serde_json::from_str(&said.stdout).unwrap();
    strip_times(&mut report);
    assert_eq!(report, *undisturbed);
}

fn killed(dice: &mut Dice, tally: &mut Tally) {
    let mut chaos = Chaos::start("chaos-lock", &["--lockstep", "--duration", "100000s"], tally);
    chaos.look_for(dice.duration(Duration::from_millis(1), Duration::from_millis(300)));
    if dice.once_in(4) {
        stop(&mut chaos, dice, tally);
        // A stopped stage may be killed next; the other stages wait for it or for a killed one.
        if dice.once_in(2) {
            chaos.release();
        }
    }
    if dice.once_in(4) {
        chaos.visit(dice, tally);
    }
    if dice.once_in(8) {
        chaos.orphan(dice, tally);
        return;
    }
    let kind = dice.stage();
    dice.note(&format!("SIGKILL {}", kind.name()));
    chaos.disturbed = [false; 4];
    tally.kills += u64::from(chaos.signal(kind, Signal::KILL));
    let verdict = chaos.await_failure(tally);
    assert_eq!(verdict, format!("{} killed by SIGKILL", kind.name()));
}

fn stop(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let (kind, time): (StageKind, _) = (dice.stage(), dice.duration(SHORTEST, LONGEST));
    dice.note(&format!("SIGSTOP {} for {time:?}", kind.name()));
    let pid = chaos.watch().pids[kind as usize];
    if chaos.signal(kind, Signal::STOP) {
        tally.stops += 1;
        chaos.stopped.push(pid);
    }
    chaos.look_for(time);
}
