//! The output of the stages, line by line: to standard error and to a file. The last lines are kept for error messages.
//!
//! Two threads for each stage read its pipes; one thread writes all lines. A queue of bounded length connects them.
//! When the reader of standard error or the disk is slow, lines are left out and counted, and no stage waits.
//!
//! On a terminal, lines that are redrawn in place stand below all others. The same thread writes them.
//!
//! Trap: a stage that writes into a full pipe stops and leaves the valves as they are. So the reading threads must
//! never stop.

use std::{
    collections::VecDeque,
    fs::File,
    io::{BufRead, BufReader, Read, Write, stderr},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread::{JoinHandle, sleep},
    time::{Duration, Instant, SystemTime},
};

use pipeline::{channel::Prefix, stage::StageKind};

use super::SupervisorError;
use crate::report::block::Block;

/// Lines that the queue between readers and writer holds.
const QUEUE: usize = 1024;
/// Longest line, bytes. A longer one is divided into several.
const LONGEST_LINE: u64 = 4096;
/// Lines of each stage that are kept for error messages.
const KEPT: usize = 8;
/// Time in which the writer must write the remaining lines at the end.
const CLOSING: Duration = Duration::from_millis(500);

/// Who writes a line of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The supervisor itself.
    Supervisor,
    /// A stage.
    Stage(StageKind),
    /// The process that records the channels.
    Recorder,
}

impl Origin {
    /// Its name in the file of the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Supervisor => "hydraxis",
            Self::Stage(kind) => kind.name(),
            Self::Recorder => "record",
        }
    }
}

/// One line of the log.
struct LogLine {
    from: Origin,
    at: SystemTime,
    text: String,
}

/// What goes through the queue.
enum Entry {
    Line(LogLine),
    /// The lines of the block on a terminal; none erase it.
    Block(Vec<String>),
}

/// Where lines enter the log. Clones share one queue.
#[derive(Clone)]
struct Entrance {
    queue: SyncSender<Entry>,
    left_out: Arc<AtomicU64>,
    kept: Arc<[Mutex<VecDeque<String>>; 4]>,
}

/// The log of one run.
pub struct Log {
    entrance: Option<Entrance>,
    writer: JoinHandle<()>,
}

/// The file of a run in `folder`, named by its group and the time of its start.
pub fn file_name(folder: &Path, prefix: &Prefix, start: SystemTime) -> PathBuf {
    let start = humantime::format_rfc3339_seconds(start).to_string().replace(':', "-");
    folder.join(format!("{prefix}-{start}.log"))
}

impl Log {
    /// Starts the writer, to standard error and to `file` if there is one.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn start(file: Option<&Path>) -> Result<Self, SupervisorError> {
        let file = file.map(create).transpose()?;
        let (queue, lines) = sync_channel(QUEUE);
        let left_out = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&left_out);
        let writer = std::thread::spawn(move || write(&lines, file, &counted));
        let kept = Arc::new(std::array::from_fn(|_| Mutex::default()));
        Ok(Self { entrance: Some(Entrance { queue, left_out, kept }), writer })
    }

    /// Logs a line of the supervisor's own.
    pub fn say(&self, text: impl Into<String>) {
        if let Some(entrance) = &self.entrance {
            entrance.take(Origin::Supervisor, text.into());
        }
    }

    /// Shows these lines below all others on a terminal, in place of those that stand there. A log that is not written
    /// to a terminal passes over them.
    pub fn show(&self, lines: Vec<String>) {
        if let Some(entrance) = &self.entrance {
            // The next second brings new lines.
            let _ = entrance.queue.try_send(Entry::Block(lines));
        }
    }

    /// The work of a thread that reads one pipe of a process until the pipe ends.
    pub fn drain(&self, from: Origin, pipe: impl Read + Send + 'static) -> impl FnOnce() + Send + 'static {
        let entrance = self.entrance.clone();
        move || {
            let (mut pipe, mut line) = (BufReader::new(pipe), Vec::new());
            while let Ok(1..) = (&mut pipe).take(LONGEST_LINE).read_until(b'\n', &mut line) {
                if let Some(entrance) = &entrance {
                    let text = String::from_utf8_lossy(&line);
                    entrance.take(from, text.trim_end_matches(['\n', '\r']).to_owned());
                }
                line.clear();
            }
        }
    }

    /// The last lines of a stage, as they stand in the log, to be appended to an error message.
    pub fn last_lines(&self, kind: StageKind) -> String {
        let Some(entrance) = &self.entrance else { return String::new() };
        let kept = entrance.kept[kind as usize].lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().map(|line| format!("\n  {} | {line}", kind.name())).collect()
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        self.entrance = None;
        let until = Instant::now() + CLOSING;
        while !self.writer.is_finished() && Instant::now() < until {
            sleep(Duration::from_millis(1));
        }
    }
}

impl Entrance {
    fn take(&self, from: Origin, text: String) {
        if let Origin::Stage(kind) = from {
            let mut kept = self.kept[kind as usize].lock().unwrap_or_else(PoisonError::into_inner);
            if kept.len() == KEPT {
                kept.pop_front();
            }
            kept.push_back(text.clone());
        }
        if self.queue.try_send(Entry::Line(LogLine { from, at: SystemTime::now(), text })).is_err() {
            self.left_out.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn create(path: &Path) -> Result<File, SupervisorError> {
    let folder = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    folder.and_then(|()| File::create(path)).map_err(|source| SupervisorError::Log { path: path.to_owned(), source })
}

/// Writes lines until all entrances are dropped. The block is gone by then.
fn write(entries: &Receiver<Entry>, mut file: Option<File>, left_out: &AtomicU64) {
    let mut block = Block::on_stderr();
    for entry in entries {
        let line = match (entry, &mut block) {
            (Entry::Line(line), _) => line,
            (Entry::Block(lines), Some(block)) => {
                let _ = stderr().write_all(block.show(lines).as_bytes());
                continue;
            }
            (Entry::Block(_), None) => continue,
        };
        let missing = left_out.swap(0, Ordering::Relaxed);
        let missing = (missing > 0).then(|| LogLine {
            from: Origin::Supervisor,
            at: line.at,
            text: format!("{missing} lines left out: they came faster than they can be written"),
        });
        for LogLine { from, at, text } in missing.into_iter().chain([line]) {
            let shown = match from {
                Origin::Supervisor => format!("{text}\n"),
                from => format!("{} | {text}\n", from.name()),
            };
            print(&shown, &mut block);
            let Some(open) = &mut file else { continue };
            let (at, from) = (humantime::format_rfc3339_millis(at), from.name());
            if let Err(error) = open.write_all(format!("{at} {from} | {text}\n").as_bytes()) {
                print(&format!("warning: the log file takes no more lines: {error}\n"), &mut block);
                file = None;
            }
        }
    }
    if let Some(block) = &mut block {
        let _ = stderr().write_all(block.show(Vec::new()).as_bytes());
    }
}

/// Writes text to standard error, above the block if there is one.
fn print(text: &str, block: &mut Option<Block>) {
    let shown = block.as_mut().map_or_else(|| text.to_owned(), |block| block.above(text));
    // The reader of standard error may have ended; the file is written all the same.
    let _ = stderr().write_all(shown.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_named_by_group_and_start() {
        let start = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let name = file_name(Path::new("/var/log"), &"press-1".parse().unwrap(), start);
        assert_eq!(name, Path::new("/var/log/press-1-2001-09-09T01-46-40Z.log"));
    }

    #[test]
    fn lines_are_whole_and_the_last_ones_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new").join("run.log");
        let log = Log::start(Some(&file)).unwrap();
        let said: String = (0..20).map(|i| format!("line {i}\r\n")).collect();
        log.drain(Origin::Stage(StageKind::SensorProc), std::io::Cursor::new(said + "no end"))();
        let long = "x".repeat(LONGEST_LINE as usize + 1);
        log.drain(Origin::Stage(StageKind::IdentProc), std::io::Cursor::new([long.as_bytes(), b"\n\xff"].concat()))();
        let last = log.last_lines(StageKind::SensorProc);
        assert!(last.starts_with("\n  sensor-proc | line 13\n") && last.ends_with(" | no end"), "{last}");
        drop(log);
        let text = std::fs::read_to_string(&file).unwrap();
        assert_eq!(text.lines().filter(|line| line.contains(" sensor-proc | line ")).count(), 20);
        let parts: Vec<usize> = text.lines().filter(|line| line.contains("ident-proc")).map(str::len).collect();
        assert_eq!(parts.len(), 3, "a line that is too long becomes several");
    }
}
