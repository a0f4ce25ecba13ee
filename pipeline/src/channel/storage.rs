//! Shared memory of a group: private from its first moment, allocated before anybody uses it, and never that of
//! another user.
//!
//! iceoryx2 makes its files with `ftruncate`, which allocates no page. The first write to a page allocates it. In a
//! full `/dev/shm` this write ends the process with SIGBUS. [`Reserved`] is the storage of iceoryx2 with four
//! differences:
//!
//! - All pages of a file are allocated when it is made. Without room for them, making it fails with an error.
//! - No file is for all users. iceoryx2 asks for mode 0666 for the file that counts its nodes; here it gets 0600.
//! - A file that belongs to another user is not opened.
//! - A file without a byte is one whose maker was killed between making it and giving it its length. iceoryx2 waits for
//!   the length without end. Here the wait ends after the time-out, and iceoryx2 then removes the file of a dead process.
//!
//! Names and layout are those of iceoryx2.
//!
//! Trap: iceoryx2 writes to the first page before it calls the initializer, which is the earliest place to allocate
//! from. So one page is allocated and freed again right before. A process that takes the last free page in the
//! microseconds between ends the process that makes the file, and no other.

use std::{
    fmt,
    fs::{File, OpenOptions},
    mem::MaybeUninit,
    os::unix::fs::{MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
    ptr::NonNull,
    thread::sleep,
    time::{Duration, Instant},
};

use iceoryx2::prelude::FileName;
use iceoryx2_bb_elementary_traits::{testing::abandonable::Abandonable, zero_copy_send::ZeroCopySend};
use iceoryx2_bb_memory::bump_allocator::BumpAllocator;
use iceoryx2_bb_posix::access_mode::AccessMode;
use iceoryx2_cal::{
    dynamic_storage::{
        DynamicStorage, DynamicStorageBuilder, DynamicStorageCreateError, DynamicStorageOpenError,
        DynamicStorageOpenOrCreateError, recommended::Ipc,
    },
    named_concept::{
        NamedConcept, NamedConceptBuilder, NamedConceptConfiguration, NamedConceptDoesExistError,
        NamedConceptListError, NamedConceptMgmt, NamedConceptPathHintRemoveError, NamedConceptRemoveError,
    },
};
use rustix::{
    fs::{FallocateFlags, OFlags, fallocate},
    io::Errno,
    process::geteuid,
};

use super::prefix::SHARED_MEMORY;

/// Time between two looks at a file that another process is making.
const LOOK: Duration = Duration::from_millis(1);

/// What is in the storage of iceoryx2 for a value.
pub trait Stored: fmt::Debug + Send + Sync + ZeroCopySend + 'static {}

impl<T: fmt::Debug + Send + Sync + ZeroCopySend + 'static> Stored for T {}

/// A value in shared memory whose pages are all allocated.
#[derive(Debug)]
pub struct Reserved<T: Stored>(Ipc<T>);

/// Fills a new value; false where it cannot.
type Initializer<'b, T> = dyn FnMut(&mut MaybeUninit<T>, &mut BumpAllocator) -> bool + 'b;

/// Makes or opens a [`Reserved`].
pub struct Builder<'b, T: Stored> {
    inner: <Ipc<T> as DynamicStorage<T>>::Builder<'b>,
    name: FileName,
    config: <Ipc<T> as NamedConceptMgmt>::Configuration,
    initializer: Box<Initializer<'b, T>>,
    /// Longest wait for another process that is just making the file.
    timeout: Duration,
}

impl<T: Stored> fmt::Debug for Builder<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "storage \"{}\"", self.name)
    }
}

impl<'b, T: Stored> Builder<'b, T> {
    fn path(&self) -> PathBuf {
        path_of(&self.config, &self.name)
    }

    /// The builder of iceoryx2, whose initializer allocates the file first.
    fn ready(self) -> <Ipc<T> as DynamicStorage<T>>::Builder<'b> {
        let path = self.path();
        let mut initializer = self.initializer;
        let allocating = move |value: &mut MaybeUninit<T>, allocator: &mut BumpAllocator| {
            allocate(&path).is_ok() && initializer(value, allocator)
        };
        self.inner.initializer(allocating)
    }
}

impl<T: Stored> NamedConceptBuilder<Reserved<T>> for Builder<'_, T> {
    fn new(name: &FileName) -> Self {
        let config = <Ipc<T> as NamedConceptMgmt>::Configuration::default();
        Self {
            inner: NamedConceptBuilder::new(name),
            name: *name,
            config,
            initializer: Box::new(|_, _| false),
            timeout: Duration::ZERO,
        }
    }

    fn config(mut self, config: &<Ipc<T> as NamedConceptMgmt>::Configuration) -> Self {
        self.inner = self.inner.config(config);
        self.config = config.clone();
        self
    }
}

impl<'b, T: Stored> DynamicStorageBuilder<'b, T, Reserved<T>> for Builder<'b, T> {
    fn has_ownership(mut self, value: bool) -> Self {
        self.inner = self.inner.has_ownership(value);
        self
    }

    fn enable_global_access(self, _: bool) -> Self {
        self
    }

    fn supplementary_size(mut self, value: usize) -> Self {
        self.inner = self.inner.supplementary_size(value);
        self
    }

    fn timeout(mut self, value: Duration) -> Self {
        self.inner = self.inner.timeout(value);
        self.timeout = value;
        self
    }

    fn initializer<F: FnMut(&mut MaybeUninit<T>, &mut BumpAllocator) -> bool + 'b>(mut self, value: F) -> Self {
        self.initializer = Box::new(value);
        self
    }

    fn create(self) -> Result<Reserved<T>, DynamicStorageCreateError> {
        probe().map_err(|_| DynamicStorageCreateError::InitializationFailed)?;
        self.ready().create().map(Reserved)
    }

    fn open(self, access_mode: AccessMode) -> Result<Reserved<T>, DynamicStorageOpenError> {
        let path = self.path();
        if is_foreign(&path) {
            return Err(DynamicStorageOpenError::InternalError);
        }
        await_length(&path, self.timeout)?;
        let opened = self.ready().open(access_mode)?;
        if is_foreign(&path) { Err(DynamicStorageOpenError::InternalError) } else { Ok(Reserved(opened)) }
    }

    fn open_or_create(self) -> Result<Reserved<T>, DynamicStorageOpenOrCreateError> {
        let path = self.path();
        let refused = || DynamicStorageOpenError::InternalError.into();
        if is_foreign(&path) {
            return Err(refused());
        }
        await_length(&path, self.timeout)?;
        if !path.exists() {
            probe().map_err(|_| DynamicStorageCreateError::InitializationFailed)?;
        }
        let opened = self.ready().open_or_create()?;
        if is_foreign(&path) { Err(refused()) } else { Ok(Reserved(opened)) }
    }
}

#[allow(unsafe_code, reason = "the trait is unsafe to implement")]
impl<T: Stored> Abandonable for Reserved<T> {
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: the caller promises that `this` is valid and not used again; so is its only field.
        unsafe { Ipc::abandon_in_place(NonNull::from(&mut this.as_mut().0)) }
    }
}

impl<T: Stored> NamedConcept for Reserved<T> {
    fn name(&self) -> &FileName {
        self.0.name()
    }
}

#[allow(unsafe_code, reason = "the trait has an unsafe function")]
impl<T: Stored> NamedConceptMgmt for Reserved<T> {
    type Configuration = <Ipc<T> as NamedConceptMgmt>::Configuration;

    unsafe fn remove_cfg(name: &FileName, config: &Self::Configuration) -> Result<bool, NamedConceptRemoveError> {
        // SAFETY: the promises of the caller are those that the storage of iceoryx2 asks for.
        unsafe { Ipc::<T>::remove_cfg(name, config) }
    }

    fn does_exist_cfg(name: &FileName, config: &Self::Configuration) -> Result<bool, NamedConceptDoesExistError> {
        Ipc::<T>::does_exist_cfg(name, config)
    }

    fn list_cfg(config: &Self::Configuration) -> Result<Vec<FileName>, NamedConceptListError> {
        Ipc::<T>::list_cfg(config)
    }

    fn remove_path_hint(value: &iceoryx2::prelude::Path) -> Result<(), NamedConceptPathHintRemoveError> {
        Ipc::<T>::remove_path_hint(value)
    }
}

#[allow(unsafe_code, reason = "the trait has an unsafe function")]
impl<T: Stored> DynamicStorage<T> for Reserved<T> {
    type Builder<'b> = Builder<'b, T>;

    fn does_support_persistency() -> bool {
        Ipc::<T>::does_support_persistency()
    }

    fn has_ownership(&self) -> bool {
        self.0.has_ownership()
    }

    fn release_ownership(&self) {
        self.0.release_ownership();
    }

    fn acquire_ownership(&self) {
        self.0.acquire_ownership();
    }

    fn get(&self) -> &T {
        self.0.get()
    }

    unsafe fn __internal_set_type_name_in_config(config: &mut Self::Configuration, type_name: &str) {
        // SAFETY: the promises of the caller are those that the storage of iceoryx2 asks for.
        unsafe { Ipc::<T>::__internal_set_type_name_in_config(config, type_name) }
    }
}

fn path_of(config: &impl NamedConceptConfiguration, name: &FileName) -> PathBuf {
    Path::new(SHARED_MEMORY).join(config.path_for(name).file_name().to_string())
}

/// Whether there is such a file, and it belongs to another user.
fn is_foreign(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.uid() != geteuid().as_raw())
}

/// Waits until a file that another process is making has its length. A file that is not there is nothing to wait for.
fn await_length(path: &Path, timeout: Duration) -> Result<(), DynamicStorageOpenError> {
    let began = Instant::now();
    while path.symlink_metadata().is_ok_and(|found| found.len() == 0) {
        if began.elapsed() >= timeout {
            return Err(DynamicStorageOpenError::InitializationNotYetFinalized);
        }
        sleep(LOOK);
    }
    Ok(())
}

/// Allocates all pages of a file. Pages that are there keep what is in them.
fn allocate(path: &Path) -> std::io::Result<()> {
    let file = OpenOptions::new().write(true).custom_flags(OFlags::NOFOLLOW.bits() as i32).open(path)?;
    reserve(&file, file.metadata()?.len())?;
    Ok(())
}

/// Fails where shared memory has no room for one page.
fn probe() -> std::io::Result<()> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).mode(0o600).custom_flags(OFlags::TMPFILE.bits() as i32);
    reserve(&options.open(SHARED_MEMORY)?, 1)?;
    Ok(())
}

fn reserve(file: &File, length: u64) -> Result<(), Errno> {
    loop {
        match fallocate(file, FallocateFlags::empty(), 0, length) {
            Err(Errno::INTR) => {}
            done => return done,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{sync::mpsc::channel, thread::spawn};

    use iceoryx2::prelude::SemanticString;

    use super::*;

    /// What opening a storage says whose maker was killed before the file had a length; none while it waits.
    fn of_dead_maker<E: Send + 'static>(
        name: &str,
        open: impl FnOnce(Builder<'_, u64>) -> Result<Reserved<u64>, E> + Send + 'static,
    ) -> Option<Result<(), E>> {
        let name = FileName::new(format!("{name}-{}", std::process::id()).as_bytes()).unwrap();
        let builder = Builder::<u64>::new(&name);
        let path = builder.path();
        OpenOptions::new().create_new(true).write(true).mode(0o200).open(&path).unwrap();
        let (said, saying) = channel();
        spawn(move || said.send(open(Builder::new(&name).timeout(Duration::from_millis(50))).map(|_| ())));
        let said = saying.recv_timeout(Duration::from_secs(5)).ok();
        std::fs::remove_file(path).unwrap();
        said
    }

    #[test]
    fn a_file_whose_maker_was_killed_keeps_nobody_waiting() {
        let opened = of_dead_maker("t-no-length-open", |builder| builder.open(AccessMode::ReadWrite));
        assert_eq!(opened, Some(Err(DynamicStorageOpenError::InitializationNotYetFinalized)));
        let made = of_dead_maker("t-no-length-make", |builder| builder.open_or_create());
        assert_eq!(made, Some(Err(DynamicStorageOpenError::InitializationNotYetFinalized.into())));
    }
}
