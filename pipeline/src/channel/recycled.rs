//! A reference-counted value, as `Rc` is, whose memory is used again instead of going back to the allocator.
//!
//! When the last owner is dropped, the thread keeps the block, and the next value of this size takes it. So a loop that
//! makes and drops a few values allocates only in its first round.

use std::{
    alloc::{Layout, alloc, dealloc, handle_alloc_error},
    cell::{Cell, RefCell},
    fmt,
    marker::PhantomData,
    ops::Deref,
    ptr::NonNull,
};

use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::arc_sync_policy::{ArcSyncPolicy, ArcSyncPolicyCreationError, LockGuard};

/// Number of blocks that a thread keeps; a stage sends on one or two channels, one message at a time.
const SPARE_BLOCKS: usize = 8;

/// A value that several owners in one thread share.
pub struct Recycled<T> {
    block: NonNull<Block<T>>,
    _owns: PhantomData<Block<T>>,
}

struct Block<T> {
    owners: Cell<usize>,
    value: T,
}

/// Free blocks of one thread, each with the layout it was allocated with.
struct Spare([Option<(Layout, NonNull<u8>)>; SPARE_BLOCKS]);

thread_local! {
    static SPARE: RefCell<Spare> = const { RefCell::new(Spare([None; SPARE_BLOCKS])) };
}

impl Spare {
    fn take(&mut self, layout: Layout) -> Option<NonNull<u8>> {
        let slot = self.0.iter_mut().find(|slot| slot.is_some_and(|(of, _)| of == layout))?;
        slot.take().map(|(_, memory)| memory)
    }

    /// Keeps a block; false when there is no room for it.
    fn keep(&mut self, layout: Layout, memory: NonNull<u8>) -> bool {
        let slot = self.0.iter_mut().find(|slot| slot.is_none());
        slot.is_some_and(|slot| slot.replace((layout, memory)).is_none())
    }
}

#[allow(unsafe_code, reason = "memory that outlives its value")]
impl Drop for Spare {
    fn drop(&mut self) {
        for (layout, memory) in self.0.iter_mut().filter_map(Option::take) {
            // SAFETY: every block kept was allocated with the layout it is kept with, and is kept once.
            unsafe { dealloc(memory.as_ptr(), layout) };
        }
    }
}

#[allow(unsafe_code, reason = "memory that outlives its value")]
impl<T> Recycled<T> {
    const LAYOUT: Layout = Layout::new::<Block<T>>();

    fn with(value: T) -> Self {
        // A thread that is ending has no spare blocks.
        let spare = SPARE.try_with(|spare| spare.borrow_mut().take(Self::LAYOUT)).ok().flatten();
        let memory = spare.unwrap_or_else(|| {
            // SAFETY: a block holds a counter, so its layout is not of size zero.
            NonNull::new(unsafe { alloc(Self::LAYOUT) }).unwrap_or_else(|| handle_alloc_error(Self::LAYOUT))
        });
        let block = memory.cast::<Block<T>>();
        // SAFETY: the memory has the layout of a block and belongs to nobody else.
        unsafe { block.write(Block { owners: Cell::new(1), value }) };
        Self { block, _owns: PhantomData }
    }

    fn block(&self) -> &Block<T> {
        // SAFETY: the block lives as long as it has an owner, and this is one.
        unsafe { self.block.as_ref() }
    }
}

impl<T> Clone for Recycled<T> {
    fn clone(&self) -> Self {
        let owners = &self.block().owners;
        owners.set(owners.get() + 1);
        Self { block: self.block, _owns: PhantomData }
    }
}

#[allow(unsafe_code, reason = "memory that outlives its value")]
impl<T> Drop for Recycled<T> {
    fn drop(&mut self) {
        let owners = self.block().owners.get() - 1;
        self.block().owners.set(owners);
        if owners > 0 {
            return;
        }
        // SAFETY: this was the last owner, so nobody looks at the block any more; its memory was allocated with the
        // layout of a block, and goes to the thread or back to the allocator, once.
        unsafe {
            self.block.drop_in_place();
            let memory = self.block.cast::<u8>();
            let kept = SPARE.try_with(|spare| spare.borrow_mut().keep(Self::LAYOUT, memory)).unwrap_or(false);
            if !kept {
                dealloc(memory.as_ptr(), Self::LAYOUT);
            }
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for Recycled<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.block().value.fmt(f)
    }
}

#[allow(unsafe_code, reason = "the trait is unsafe to implement")]
impl<T: Send + fmt::Debug + Abandonable> Abandonable for Recycled<T> {
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: the caller hands over a valid value that it does not use again. An only owner abandons the value in
        // its place and leaks the memory, as abandoning means; another one only ceases to be an owner.
        unsafe {
            let this = this.as_mut();
            if this.block().owners.get() == 1 {
                T::abandon_in_place(NonNull::from_mut(&mut this.block.as_mut().value));
            } else {
                std::ptr::drop_in_place(this);
            }
        }
    }
}

impl<T: Send + fmt::Debug + Abandonable> ArcSyncPolicy<T> for Recycled<T> {
    type LockGuard<'parent>
        = Guard<'parent, T>
    where
        Self: 'parent,
        T: 'parent;

    fn new(value: T) -> Result<Self, ArcSyncPolicyCreationError> {
        Ok(Self::with(value))
    }

    fn lock(&self) -> Guard<'_, T> {
        Guard(&self.block().value)
    }
}

/// Access to the value; one thread needs no lock.
pub struct Guard<'parent, T>(&'parent T);

impl<T> Deref for Guard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.0
    }
}

impl<'parent, T: Send + Abandonable> LockGuard<'parent, T> for Guard<'parent, T> {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Rc;

    #[test]
    fn the_last_owner_drops_the_value_once() {
        let witness = Rc::new(());
        let one = Recycled::with(Rc::clone(&witness));
        let two = one.clone();
        assert!(Rc::ptr_eq(&two.block().value, &witness));
        drop(one);
        assert_eq!(Rc::strong_count(&witness), 2);
        drop(two);
        assert_eq!(Rc::strong_count(&witness), 1);
    }

    #[test]
    fn the_next_value_of_the_same_size_takes_the_memory() {
        let first = Recycled::with([1u64; 9]);
        let place = first.block;
        drop(first);
        let second = Recycled::with([2u64; 9]);
        assert_eq!(second.block, place);
        assert_eq!(second.block().value, [2; 9]);
        // Another size does not.
        assert_ne!(Recycled::with([3u64; 8]).block.cast::<u8>(), place.cast());
    }

    #[test]
    fn more_blocks_than_are_kept_and_threads_that_end_work() {
        std::thread::spawn(|| {
            let many: Vec<_> = (0..3 * SPARE_BLOCKS).map(|i| Recycled::with([i; 5])).collect();
            assert!(many.iter().enumerate().all(|(i, value)| value.block().value == [i; 5]));
        })
        .join()
        .unwrap();
    }
}
