//! In real time a killed stage is started again until its limit of restarts. The axes stand still meanwhile, and a new
//! controller is disarmed.

use std::{
    thread,
    time::{Duration, Instant},
};

use pipeline::stage::{StageKind, monotonic_ns};
use rustix::process::Signal;

use crate::{
    MANY_KILLS, dice,
    group::{Chaos, LONGEST, SHORTEST, Tally, client},
    harness::{Dice, is_running, place::in_own_place, shared},
    kills, stops,
};

/// Time for which the machine is observed after the controller or the acquisition has failed.
const AFTERMATH: Duration = Duration::from_millis(500);
/// Longest time until standstill. It is ten times the drive's time-out (50 ms) with the dead time and five time
/// constants of the valve (0.1 s), for a computer that is busy with other work.
const STANDS_WITHIN_MS: f64 = 2000.0;

#[test]
fn in_real_time_no_disarmed_axis_moves_and_every_group_ends() {
    run("real_time::in_real_time_no_disarmed_axis_moves_and_every_group_ends", kills());
}

#[test]
#[ignore = "takes twenty minutes"]
fn in_real_time_for_long_no_disarmed_axis_moves_and_every_group_ends() {
    run("real_time::in_real_time_for_long_no_disarmed_axis_moves_and_every_group_ends", MANY_KILLS);
}

fn run(test: &str, kills: u64) {
    let _cores = shared();
    in_own_place(test, |is_private| {
        let mut tally = Tally::default();
        let mut dice = dice("real time", kills);
        while tally.kills < kills {
            group(&mut dice, &mut tally, kills, is_private);
        }
        tally.print(dice.elapsed());
    });
}

fn group(dice: &mut Dice, tally: &mut Tally, kills: u64, is_private: bool) {
    let mut chaos = Chaos::start("chaos-real", &["--duration", "1h"], tally);
    dice.note("a group");
    while tally.kills < kills {
        if dice.below(4) > 0 {
            arm(&mut chaos, dice, tally);
        }
        match dice.below(30) {
            0..8 => kill(&mut chaos, dice, tally),
            8..12 => stop(&mut chaos, dice, tally),
            12..14 => chaos.visit(dice, tally),
            14 => operate(&mut chaos, dice, tally),
            15 => {
                let kind = dice.stage();
                dice.note(&format!("SIGUSR1 {}", kind.name()));
                chaos.signal(kind, Signal::USR1);
            }
            16 => hogs(&mut chaos, dice),
            17..23 => stops::stop(&mut chaos, dice, tally),
            23..26 => stops::stop_with_hung_operator(&mut chaos, dice, tally),
            26 => stops::start_again(&mut chaos, dice, tally),
            27 => stops::plant_foreign_files(&mut chaos, dice, tally),
            28 if is_private => stops::fill_memory(&mut chaos, dice, tally),
            _ => return chaos.orphan(dice, tally),
        }
        if chaos.has_ended() {
            let verdict = chaos.await_failure(tally);
            return dice.note(&format!("end: {verdict}"));
        }
    }
    chaos.interrupt(tally);
}

/// Starts motion where there is none. It may fail where a stage is just ending.
fn arm(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let all_live = |chaos: &mut Chaos| chaos.watch().pids.iter().all(|pid| is_running(*pid)).then_some(());
    if chaos.look_until("all four stages", all_live).is_none() || !chaos.watch().needs_arming() {
        return;
    }
    let prefix = chaos.prefix().to_string();
    dice.note("reset, arm");
    stops::allow_motion(chaos, tally);
    for lever in ["reset", "disarm", "arm"] {
        tally.clients += 1;
        chaos.watch().controller.at_levers = true;
        let lever = client(&[lever, "--prefix", &prefix]);
        chaos.finish(lever);
        chaos.look_for(Duration::from_millis(20));
        chaos.watch().controller.at_levers = false;
    }
    let until = Instant::now() + Duration::from_secs(3);
    while !chaos.watch().is_moving() && Instant::now() < until {
        chaos.look_for(Duration::from_millis(20));
    }
}

fn kill(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let kind = match dice.below(10) {
        0..4 => StageKind::ControlProc,
        4..7 => StageKind::SensorProc,
        7..9 => StageKind::IdentProc,
        _ => StageKind::PlantSim,
    };
    let was_moving = chaos.watch().is_moving();
    dice.note(&format!("SIGKILL {}{}", kind.name(), if was_moving { ", in motion" } else { "" }));
    let (at_ns, before) = (monotonic_ns(), chaos.watch().pids[kind as usize]);
    if !chaos.signal(kind, Signal::KILL) {
        return;
    }
    tally.kills += 1;
    chaos.look_for(AFTERMATH);
    if was_moving {
        measure(chaos, dice, tally, kind, "killed", at_ns);
    }
    // Once in four times the next fault comes before the stage has been started again.
    if kind == StageKind::PlantSim || !dice.once_in(4) {
        chaos.look_until("the next life", |chaos| (chaos.watch().pids[kind as usize] != before).then_some(()));
    }
}

fn stop(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let (kind, time) = (dice.stage(), dice.duration(SHORTEST, LONGEST));
    let was_moving = chaos.watch().is_moving();
    dice.note(&format!("SIGSTOP {} for {time:?}{}", kind.name(), if was_moving { ", in motion" } else { "" }));
    let (at_ns, pid) = (monotonic_ns(), chaos.watch().pids[kind as usize]);
    if !chaos.signal(kind, Signal::STOP) {
        return;
    }
    chaos.stopped.push(pid);
    tally.stops += 1;
    chaos.look_for(time);
    if was_moving && time > AFTERMATH {
        measure(chaos, dice, tally, kind, "stopped", at_ns);
    }
    chaos.release();
}

/// Measures the time to standstill after the controller or the acquisition has failed.
fn measure(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally, kind: StageKind, how: &str, at_ns: u64) {
    if !matches!(kind, StageKind::ControlProc | StageKind::SensorProc) {
        return;
    }
    let (name, watch) = (kind.name(), chaos.watch());
    // A killed controller sends nothing more. A controller without samples sends neutral commands.
    let last_ns = if kind == StageKind::ControlProc { watch.last_moving_ns } else { watch.neutral_ns };
    assert!(kind == StageKind::ControlProc || last_ns > watch.last_moving_ns, "{name} {how}: not neutral");
    let what = if kind == StageKind::ControlProc { "last command" } else { "neutral command" };
    let command = tally.react(&format!("{what}, {name} {how}"), at_ns, last_ns);
    let motion_ns = watch.last_motion(at_ns).unwrap_or(at_ns);
    let motion = tally.react(&format!("standstill, {name} {how}"), at_ns, motion_ns);
    dice.note(&format!("moved on for {motion:.0} ms, commanded to for {command:.0} ms"));
    assert!(command < STANDS_WITHIN_MS && motion < STANDS_WITHIN_MS, "{name} {how}: {command} ms, {motion} ms");
}

/// Kills a program while it moves an axis in manual mode.
fn operate(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    dice.note("operate by hand, killed");
    stops::allow_motion(chaos, tally);
    tally.clients += 1;
    let prefix = chaos.prefix().to_string();
    chaos.watch().controller.at_levers = true;
    let operator = ["operate", "--prefix", &prefix, "--mode", "manual", "--command", "0.2", "--enable"];
    let mut operator = client(&operator);
    chaos.look_for(dice.duration(SHORTEST, LONGEST));
    let _ = operator.kill();
    chaos.finish(operator);
    let killed_ns = monotonic_ns();
    chaos.look_for(AFTERMATH);
    chaos.watch().controller.at_levers = false;
    let last_ns = chaos.watch().last_moving_ns;
    if chaos.watch().last.iter().all(|axis| axis.operation != pipeline::message::AxisMode::Track as u32) {
        let longest = tally.react("last command, operator killed", killed_ns, last_ns);
        assert!(longest < AFTERMATH.as_secs_f64() * 1e3, "{longest} ms");
    }
}

/// Keeps two cores busy for a second.
fn hogs(chaos: &mut Chaos, dice: &mut Dice) {
    dice.note("two hogs");
    let until = Instant::now() + Duration::from_secs(1);
    let hog = || {
        thread::spawn(move || {
            while Instant::now() < until {
                std::hint::spin_loop();
            }
        })
    };
    let hogs = [hog(), hog()];
    chaos.look_for(Duration::from_secs(1));
    hogs.into_iter().for_each(|hog| hog.join().unwrap());
}
