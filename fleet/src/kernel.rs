//! What the kernel is asked for: the quality of the clock, the lowest priority, a limit of memory.
//!
//! The first two have no safe wrapper among the dependencies, so they are system calls here.

use std::{
    io,
    time::{SystemTime, UNIX_EPOCH},
};

use pipeline::stage::monotonic_ns;
use rustix::process::{Resource, Rlimit, setrlimit};

use crate::stamp::NOT_SYNCHRONISED;

/// Present time, ns since 1970.
pub fn utc_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as i64
}

/// What is to be added to `CLOCK_MONOTONIC` for the time since 1970, ns. The date may be set at any time, so this is
/// asked for again and again.
pub fn utc_minus_monotonic_ns() -> i64 {
    utc_ns() - monotonic_ns() as i64
}

/// Largest error of the clock that the kernel knows of, ns; [`NOT_SYNCHRONISED`] where nothing synchronises it.
#[allow(unsafe_code, reason = "adjtimex has no safe wrapper; it fills in a struct that this function owns")]
pub fn clock_error_ns() -> u64 {
    // SAFETY: all bytes zero are a valid timex, and with `modes` 0 the call only reads the clock.
    let mut state: libc::timex = unsafe { std::mem::zeroed() };
    // SAFETY: the pointer is to a timex of this function.
    let answer = unsafe { libc::adjtimex(&mut state) };
    let is_synchronised = answer >= 0 && answer != libc::TIME_ERROR && state.status & libc::STA_UNSYNC == 0;
    if is_synchronised { (state.maxerror as u64).saturating_mul(1000) } else { NOT_SYNCHRONISED }
}

/// Gives this thread, and those that it starts from now on, a core only when no other program wants it.
///
/// # Errors
/// The kernel refuses it.
#[allow(unsafe_code, reason = "sched_setscheduler has no safe wrapper; it reads a struct that this function owns")]
pub fn run_when_idle() -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: the pointer is to a struct of this function; 0 names the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Limits the memory of this process. What it has mapped of a group does not count. A process that wants more ends.
///
/// # Errors
/// The kernel refuses it.
pub fn limit_memory(bytes: u64) -> io::Result<()> {
    Ok(setrlimit(Resource::Data, Rlimit { current: Some(bytes), maximum: Some(bytes) })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_clocks_differ_by_the_offset() {
        let utc = monotonic_ns() as i64 + utc_minus_monotonic_ns();
        assert!((utc_ns() - utc).abs() < 1_000_000_000);
        // After 2020 and before 2200: ns, not another unit.
        assert!((1_577_836_800_000_000_000..7_258_118_400_000_000_000).contains(&utc));
    }

    #[test]
    #[ignore = "ends its process; the test below runs it in one of its own"]
    fn wants_more_memory_than_its_limit() {
        limit_memory(128 << 20).unwrap();
        assert_eq!(vec![1_u8; 64 << 20].len(), 64 << 20);
        println!("within the limit");
        assert_eq!(vec![1_u8; 256 << 20].len(), 256 << 20);
        println!("beyond the limit");
    }

    #[test]
    fn a_process_that_wants_more_memory_than_its_limit_ends() {
        let mut own = std::process::Command::new(std::env::current_exe().unwrap());
        own.args(["--exact", "kernel::tests::wants_more_memory_than_its_limit", "--ignored", "--nocapture"]);
        let ended = own.output().unwrap();
        let said = String::from_utf8_lossy(&ended.stdout).into_owned();
        assert!(!ended.status.success());
        assert!(said.contains("within the limit") && !said.contains("beyond the limit"), "{said}");
    }

    #[test]
    fn a_thread_that_gives_way_says_so_to_the_kernel() {
        let policy = std::thread::spawn(|| {
            run_when_idle().unwrap();
            let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
            // Field 41 of proc_pid_stat(5), of which two stand before the bracket.
            fields[38].parse::<i32>().unwrap()
        });
        assert_eq!(policy.join().unwrap(), libc::SCHED_IDLE);
    }
}
