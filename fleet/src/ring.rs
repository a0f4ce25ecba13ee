//! Messages on their way from the group to the network: bounded, the oldest one overwritten.

use std::{
    collections::VecDeque,
    sync::{
        Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

/// A queue between two threads. Whoever adds never waits for whoever takes.
pub struct Ring<T> {
    room: usize,
    items: Mutex<VecDeque<T>>,
    filled: Condvar,
    overwritten: AtomicU64,
}

impl<T> Ring<T> {
    /// With room for so many items, at least one.
    pub fn new(room: usize) -> Self {
        let room = room.max(1);
        Self {
            room,
            items: Mutex::new(VecDeque::with_capacity(room)),
            filled: Condvar::new(),
            overwritten: AtomicU64::new(0),
        }
    }

    /// Adds an item; without room in the place of the oldest one, which is counted.
    pub fn push(&self, item: T) {
        let mut items = self.items();
        if items.len() == self.room {
            items.pop_front();
            self.overwritten.fetch_add(1, Ordering::Relaxed);
        }
        items.push_back(item);
        drop(items);
        self.filled.notify_one();
    }

    /// Takes the oldest item; none where none comes in this time.
    pub fn take(&self, patience: Duration) -> Option<T> {
        let waited = self.filled.wait_timeout_while(self.items(), patience, |items| items.is_empty());
        waited.unwrap_or_else(PoisonError::into_inner).0.pop_front()
    }

    /// Number of items that were overwritten before anybody took them.
    pub fn overwritten(&self) -> u64 {
        self.overwritten.load(Ordering::Relaxed)
    }

    fn items(&self) -> MutexGuard<'_, VecDeque<T>> {
        // A thread that has panicked leaves a queue that is whole: every change is one call.
        self.items.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_items_are_overwritten_and_counted() {
        let ring = Ring::new(3);
        (0..5).for_each(|i| ring.push(i));
        let taken: Vec<i32> = std::iter::from_fn(|| ring.take(Duration::ZERO)).collect();
        assert_eq!((taken, ring.overwritten()), (vec![2, 3, 4], 2));
    }

    #[test]
    fn whoever_takes_is_woken_by_an_item() {
        let ring = Ring::new(1);
        std::thread::scope(|scope| {
            let taker = scope.spawn(|| ring.take(Duration::from_secs(60)));
            ring.push(7);
            assert_eq!(taker.join().unwrap(), Some(7));
        });
    }
}
