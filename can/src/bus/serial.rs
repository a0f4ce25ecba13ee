//! Serial ports in raw mode, and pseudo terminals in their place.

use std::{
    ffi::CString,
    io,
    os::fd::{AsFd, BorrowedFd, OwnedFd},
    path::Path,
    time::Duration,
};

use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::{FlockOperation, Mode, OFlags, fcntl_getfl, fcntl_setfl, flock, open},
    io::{Errno, read, write},
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, QueueSelector, Termios, tcflush, tcgetattr, tcsetattr},
};

/// Speed of the port where the adapter has one, bit/s. Adapters with USB take any.
const SPEED: u32 = 115_200;

/// An open port that never makes its reader or writer wait.
#[derive(Debug)]
pub(super) struct Port(OwnedFd);

fn raw(port: BorrowedFd<'_>) -> io::Result<()> {
    let mut termios: Termios = tcgetattr(port)?;
    termios.make_raw();
    termios.set_speed(SPEED)?;
    tcsetattr(port, OptionalActions::Now, &termios)?;
    Ok(())
}

impl Port {
    /// Opens a serial port or a pseudo terminal, and locks it: two programs that read one port would each get a part of
    /// the text. A port that another program has locked is [`io::ErrorKind::WouldBlock`]. Text that waits in the port
    /// is dropped: set points of a time before must not reach a valve now.
    pub fn open(path: &Path) -> io::Result<Self> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = open(path, flags, Mode::empty())?;
        flock(&port, FlockOperation::NonBlockingLockExclusive)?;
        raw(port.as_fd())?;
        tcflush(&port, QueueSelector::IOFlush)?;
        Ok(Self(port))
    }

    /// Uses an open port.
    pub fn of(port: OwnedFd) -> io::Result<Self> {
        fcntl_setfl(&port, fcntl_getfl(&port)? | OFlags::NONBLOCK)?;
        Ok(Self(port))
    }

    /// Number of bytes that were read into `buffer`, 0 where there are none.
    pub fn read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        match read(&self.0, &mut *buffer) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }

    /// Number of bytes of `bytes` that the port has taken.
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        match write(&self.0, bytes) {
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }

    pub fn wait(&self, longest: Duration) -> io::Result<()> {
        wait_for(self.0.as_fd(), longest)
    }
}

/// Waits until `file` can be read, for `longest` at most. A signal ends the wait.
pub(super) fn wait_for(file: BorrowedFd<'_>, longest: Duration) -> io::Result<()> {
    let timeout = Timespec { tv_sec: longest.as_secs().min(1) as i64, tv_nsec: i64::from(longest.subsec_nanos()) };
    match poll(&mut [PollFd::new(&file, PollFlags::IN)], Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// A new pseudo terminal: the end of the adapter, and the path at which the other end is opened.
///
/// # Errors
/// The computer has no pseudo terminal left.
pub fn pseudo_terminal() -> io::Result<(OwnedFd, String)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    raw(master.as_fd())?;
    let name: CString = ptsname(&master, Vec::new())?;
    let name = name.into_string().map_err(|_| io::Error::from(io::ErrorKind::InvalidData))?;
    Ok((master, name))
}
