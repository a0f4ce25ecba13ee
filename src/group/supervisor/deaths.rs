//! The ends of processes, in the order in which they ended.
//!
//! The kernel has a descriptor for each process, which becomes readable when the process ends, and it queues
//! descriptors in the order in which they become readable. Processes are not reaped here. Until a process is reaped, no
//! other process gets its number.
//!
//! Trap: a loop that asks each process in turn finds them in the order of the loop, and threads that wait for one
//! process each wake in the order of the scheduler. In both cases a cause and its consequence may change places. A
//! process ends with its last thread, some milliseconds after a signal. The order of ends that lie closer together is
//! not known.

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

/// Ends that are read at once: more than there are stages.
const AT_ONCE: usize = 8;

/// The processes whose ends are watched.
pub struct Deaths {
    queue: OwnedFd,
}

/// A watched process. Dropping this value ends the watch.
pub struct Watched(#[expect(dead_code, reason = "the kernel's queue holds it while it is open")] OwnedFd);

impl Deaths {
    /// Watches no process yet.
    ///
    /// # Errors
    /// The kernel gives no queue.
    pub fn new() -> io::Result<Self> {
        Ok(Self { queue: epoll::create(epoll::CreateFlags::CLOEXEC)? })
    }

    /// Watches this child as well.
    ///
    /// # Errors
    /// The kernel gives no descriptor for it.
    pub fn watch(&self, pid: Pid) -> io::Result<Watched> {
        let process = pidfd_open(pid, PidfdFlags::empty())?;
        let data = epoll::EventData::new_u64(u64::from(pid.as_raw_pid().unsigned_abs()));
        epoll::add(&self.queue, &process, data, epoll::EventFlags::IN)?;
        Ok(Watched(process))
    }

    /// Waits until a watched process ends, at most for `longest` or until a signal. Returns the processes that have
    /// ended, the first one first. Each call returns them again until they are no longer watched.
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
    fn processes_are_reported_in_the_order_in_which_they_ended() {
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
