//! A bus in memory with two ends, for tests of devices and masters in one process. Unlike the other buses it locks.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use super::{Bus, BusError};
use crate::{Counters, Frame, Received};

/// Frames that one end may have unread.
const ROOM: usize = 1024;

type Queue = Arc<Mutex<VecDeque<Frame>>>;

/// One end.
#[derive(Debug)]
pub struct MemoryBus {
    inward: Queue,
    outward: Queue,
    opened: Instant,
    counters: Counters,
}

/// Two ends: what one sends the other receives.
pub fn pair() -> (MemoryBus, MemoryBus) {
    let queue = || Arc::new(Mutex::new(VecDeque::with_capacity(ROOM)));
    let (one, two): (Queue, Queue) = (queue(), queue());
    let opened = Instant::now();
    let end = |inward: &Queue, outward: &Queue| MemoryBus {
        inward: Arc::clone(inward),
        outward: Arc::clone(outward),
        opened,
        counters: Counters::default(),
    };
    (end(&one, &two), end(&two, &one))
}

impl Bus for MemoryBus {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        let frame = self.inward.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
        Ok(frame.map(|frame| {
            self.counters.count_received(&frame);
            Received { frame, time_ns: self.opened.elapsed().as_nanos() as u64 }
        }))
    }

    fn send(&mut self, frame: &Frame) -> Result<bool, BusError> {
        let mut queue = self.outward.lock().unwrap_or_else(PoisonError::into_inner);
        if queue.len() >= ROOM {
            self.counters.unsent += 1;
            return Ok(false);
        }
        queue.push_back(*frame);
        self.counters.count_sent(frame);
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn wait(&mut self, longest: Duration) -> Result<(), BusError> {
        let until = Instant::now() + longest;
        while self.inward.lock().unwrap_or_else(PoisonError::into_inner).is_empty() && Instant::now() < until {
            std::thread::yield_now();
        }
        Ok(())
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}
