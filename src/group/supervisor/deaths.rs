//! The deaths of processes, in the order in which they died.
//!
//! The kernel holds a descriptor per process that becomes readable at its end, and queues what becomes readable in that
//! order. Nothing is reaped here: until it is, no other process can have its number.
//!
//! Trap: asking each process in turn whether it lives gives them in the order of asking, and threads that wait for one
//! each wake in the order of the scheduler. Either way the cause and its consequence change places. Even so a
//! process has died when its last thread has, milliseconds after a signal: nobody can tell closer deaths apart.

use std::{
    io,
    mem::MaybeUninit,
    os::fd::OwnedFd,
    thread::sleep,
    time::{Duration, Instant},
};

use rustix::{
    event::{Timespec, epoll},
    io::Errno,
    process::{Pid, PidfdFlags, pidfd_open},
};

/// Deaths that are taken at once: more than there are stages.
const AT_ONCE: usize = 8;

/// The processes whose deaths are waited for.
pub struct Deaths {
    queue: OwnedFd,
}

/// A process that is waited for until this is dropped.
pub struct Watched(#[expect(dead_code, reason = "the kernel's queue holds it while it is open")] OwnedFd);

impl Deaths {
    /// Of nobody yet.
    pub fn new() -> io::Result<Self> {
        Ok(Self { queue: epoll::create(epoll::CreateFlags::CLOEXEC)? })
    }

    /// Waits for the death of this child as well.
    pub fn watch(&self, pid: Pid) -> io::Result<Watched> {
        let process = pidfd_open(pid, PidfdFlags::empty())?;
        let data = epoll::EventData::new_u64(u64::from(pid.as_raw_pid().unsigned_abs()));
        epoll::add(&self.queue, &process, data, epoll::EventFlags::IN)?;
        Ok(Watched(process))
    }

    /// Waits for a death, for so long at most or until a signal; those that have died, the first one first. Each comes
    /// again until it is no longer watched.
    pub fn wait(&self, longest: Duration) -> Vec<Pid> {
        let started = Instant::now();
        let mut events = [const { MaybeUninit::uninit() }; AT_ONCE];
        let timeout = Timespec { tv_sec: longest.as_secs() as i64, tv_nsec: i64::from(longest.subsec_nanos()) };
        match epoll::wait(&self.queue, &mut events[..], Some(&timeout)) {
            Ok((died, _)) => {
                let pids = died.iter().filter_map(|event| i32::try_from(event.data.u64()).ok());
                pids.filter_map(Pid::from_raw).collect()
            }
            Err(Errno::INTR) => Vec::new(),
            Err(_) => {
                sleep(longest.saturating_sub(started.elapsed()));
                Vec::new()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn deaths_come_in_their_order_whatever_the_order_of_births() {
        let deaths = Deaths::new().unwrap();
        let mut children: Vec<_> = (0..4).map(|_| Command::new("sleep").arg("1000").spawn().unwrap()).collect();
        let pids: Vec<Pid> = children.iter().map(Pid::from_child).collect();
        let _watched: Vec<Watched> = pids.iter().map(|pid| deaths.watch(*pid).unwrap()).collect();
        assert_eq!(deaths.wait(Duration::from_millis(1)), []);
        let order = [2, 0, 3, 1];
        for i in order {
            children[i].kill().unwrap();
            let stat = || std::fs::read_to_string(format!("/proc/{}/stat", pids[i].as_raw_pid())).unwrap();
            while !stat().contains(") Z ") {
                std::thread::yield_now();
            }
        }
        assert_eq!(deaths.wait(Duration::from_secs(10)), order.map(|i| pids[i]));
        assert!(children.iter_mut().all(|child| !child.wait().unwrap().success()));
    }
}
