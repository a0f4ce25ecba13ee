use std::sync::atomic::{AtomicBool, Ordering};

use iceoryx2::prelude::ZeroCopySend;

use super::{group::MAX_SUBSCRIBERS, *};
use crate::{
    machine::Machine,
    message::{EncoderSample, Header, Message, Reference, Request, ValveCommand},
};

/// A prefix of its own for each test, with nothing left behind.
struct Own(Prefix);

impl Own {
    fn new(test: &str) -> Self {
        Self(format!("t{}-{test}", std::process::id()).parse().unwrap())
    }

    fn join(&self) -> Group {
        Group::join(&self.0, "test").unwrap()
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        // The members of the group are gone: they were declared after this, so they were dropped before.
        let _ = remove_leftovers(&self.0);
    }
}

fn sample(sequence: u64) -> EncoderSample {
    EncoderSample { header: Header { sequence, ..Header::default() }, ..EncoderSample::default() }
}

/// A sample that was read: whether it is new, its tick, and its number on the channel.
fn told(read: Read<'_, EncoderSample>) -> (&'static str, u64, u64) {
    let of = |sample: &EncoderSample| (sample.header.sequence, sample.header.number);
    match read {
        Read::New(sample) => ("new", of(sample).0, of(sample).1),
        Read::Old(sample) => ("old", of(sample).0, of(sample).1),
        Read::None => ("none", 0, 0),
    }
}

#[test]
fn a_read_is_new_or_old_or_none() {
    let own = Own::new("read");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    assert_eq!(reader.read().unwrap(), Read::None);
    publisher.send(&sample(7)).unwrap();
    assert_eq!(told(reader.read().unwrap()), ("new", 7, 0));
    assert_eq!(told(reader.read().unwrap()), ("old", 7, 0));
    publisher.send(&sample(8)).unwrap();
    publisher.send(&sample(9)).unwrap();
    assert_eq!(told(reader.newest().unwrap()), ("new", 9, 2));
    assert_eq!(told(reader.newest().unwrap()), ("old", 9, 2));
    assert_eq!((reader.lost(), reader.restarts()), (0, 0));
}

#[test]
fn a_reader_that_attaches_anew_keeps_the_messages_that_wait() {
    let own = Own::new("waiting");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    publisher.send(&sample(8)).unwrap();
    publisher.send(&sample(9)).unwrap();
    reader.reattach();
    publisher.greet();
    assert_eq!(told(reader.read().unwrap()), ("new", 8, 0));
    assert_eq!(told(reader.read().unwrap()), ("new", 9, 1));
    assert_eq!((reader.lost(), reader.restarts()), (0, 0));
}

#[test]
fn a_reader_that_sleeps_loses_the_oldest_and_knows_how_many() {
    let own = Own::new("lost");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    publisher.send(&sample(0)).unwrap();
    assert!(reader.read().unwrap().if_new().is_some());
    let sent = 5 * EncoderSample::BUFFER as u64;
    (1..=sent).for_each(|k| publisher.send(&sample(k)).unwrap());
    let mut read = 0;
    while reader.read().unwrap().if_new().is_some() {
        read += 1;
    }
    assert_eq!(read, EncoderSample::BUFFER as u64);
    assert_eq!(reader.lost(), sent - read);
    assert_eq!(reader.last().unwrap().header.sequence, sent);
}

#[test]
fn references_of_half_a_second_wait_for_a_reader_that_gets_no_core() {
    let own = Own::new("burst");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<Reference>().unwrap());
    let reference = |sequence| Reference { header: Header { sequence, ..Header::default() }, ..Reference::default() };
    publisher.send(&reference(0)).unwrap();
    assert!(reader.newest().unwrap().if_new().is_some());
    // Half a second of a program that writes 100 times a second.
    (1..=50).for_each(|k| publisher.send(&reference(k)).unwrap());
    assert_eq!(reader.newest().unwrap().if_new().unwrap().header.sequence, 50);
    assert_eq!((reader.lost(), reader.health(0).received), (0, 51));
}

#[test]
fn a_look_ends_while_writers_never_cease_to_send() {
    let own = Own::new("flood");
    let group = own.join();
    let mut reader = group.reader::<Request>().unwrap();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..Request::MAX_PUBLISHERS {
            scope.spawn(|| {
                let group = own.join();
                let publisher = group.publisher().unwrap();
                while !is_over.load(Ordering::Relaxed) {
                    publisher.send(&Request::default()).unwrap();
                }
            });
        }
        let mut most = 0;
        while reader.health(0).received < 100_000 {
            let before = reader.health(0).received;
            reader.newest().unwrap();
            most = most.max(reader.health(0).received - before);
        }
        is_over.store(true, Ordering::Relaxed);
        assert!(most <= (Request::MAX_PUBLISHERS * Request::BUFFER) as u64, "{most} messages in one look");
    });
}

#[test]
fn a_tick_that_nobody_worked_is_not_a_lost_message() {
    let own = Own::new("gap");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    for tick in [5, 9] {
        publisher.send(&sample(tick)).unwrap();
        assert_eq!(reader.read().unwrap().if_new().unwrap().header.sequence, tick);
    }
    assert_eq!(reader.lost(), 0);
}

#[test]
fn a_writer_that_starts_again_is_counted() {
    let own = Own::new("restart");
    let group = own.join();
    let mut reader = group.reader::<ValveCommand>().unwrap();
    for _ in 0..2 {
        let publisher = group.publisher::<ValveCommand>().unwrap();
        publisher.send(&ValveCommand::default()).unwrap();
        assert!(reader.read().unwrap().if_new().is_some());
    }
    assert_eq!((reader.lost(), reader.restarts()), (0, 1));
}

#[test]
fn a_late_reader_gets_the_newest_message() {
    let own = Own::new("late");
    let group = own.join();
    let publisher = group.publisher().unwrap();
    publisher.send(&sample(3)).unwrap();
    publisher.send(&sample(4)).unwrap();
    let mut late = group.reader::<EncoderSample>().unwrap();
    publisher.greet();
    assert_eq!(told(late.read().unwrap()), ("new", 4, 1));
    // Greeting again repeats nothing.
    publisher.greet();
    assert_eq!(told(late.read().unwrap()), ("old", 4, 1));
}

#[test]
fn reading_up_to_a_tick_leaves_the_later_ones() {
    let own = Own::new("reach");
    let group = own.join();
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    assert!(!reader.reach(2).unwrap());
    (0..5).for_each(|k| publisher.send(&sample(k)).unwrap());
    assert!(reader.reach(2).unwrap() && reader.reach(1).unwrap());
    assert_eq!(reader.last().unwrap().header.sequence, 2);
    assert_eq!(told(reader.read().unwrap()), ("new", 3, 3));
}

#[test]
fn a_message_about_another_machine_is_not_read_and_counted() {
    let own = Own::new("foreign");
    let group = own.join();
    // These know no machine, since the group has none yet.
    let (samples, requests) = (group.publisher::<EncoderSample>().unwrap(), group.publisher::<Request>().unwrap());
    let machine = Machine::load(None, &[]).unwrap();
    let board = Board::of(&own.0, &machine).unwrap();
    let number = board.machine().fingerprint as u32;
    let (mut read, mut asked) = (group.reader::<EncoderSample>().unwrap(), group.reader::<Request>().unwrap());
    let mut found = Vec::new();
    for machine in [0, number, number ^ 2] {
        let header = Header { machine, ..Header::default() };
        samples.send(&EncoderSample { header, ..EncoderSample::default() }).unwrap();
        requests.send(&Request { header, ..Request::default() }).unwrap();
        found.push((read.read().unwrap().if_new().is_some(), asked.read().unwrap().if_new().is_some()));
    }
    assert_eq!(found, [(true, false), (true, true), (false, false)]);
    assert_eq!((read.health(0).foreign, asked.health(0).foreign), (1, 2));
    // A program that comes later names the machine of the group by itself.
    drop(requests);
    let later = group.publisher::<Request>().unwrap();
    later.send(&Request::default()).unwrap();
    assert!(asked.read().unwrap().if_new().is_some());
}

#[test]
fn groups_share_nothing() {
    let (one, two) = (Own::new("one"), Own::new("two"));
    let (group_one, group_two) = (one.join(), two.join());
    let publisher = group_one.publisher().unwrap();
    let mut stranger = group_two.reader::<EncoderSample>().unwrap();
    publisher.send(&sample(1)).unwrap();
    publisher.greet();
    assert_eq!(stranger.read().unwrap(), Read::None);
}

#[test]
fn a_second_writer_is_refused() {
    let own = Own::new("second");
    let group = own.join();
    let _first = group.publisher::<EncoderSample>().unwrap();
    let error = group.publisher::<EncoderSample>().map(|_| ()).unwrap_err();
    assert!(matches!(error, PublisherError::TooManyPublishers { most: 1, .. }), "{error:?}");
    let source = std::error::Error::source(&error).unwrap().to_string();
    assert!(source.contains("ExceedsMaxSupportedPublishers"), "{source}");
    let text = error.to_string();
    assert!(
        text.starts_with(&format!("channel \"encoder-sample\" of group \"{}\": found 1 publisher", own.0)),
        "{text}"
    );
}

mod foreign {
    use super::*;

    crate::layout::shared_struct! {
        /// A reference as another version might lay it out: same name, same size, fields swapped.
        #[type_name("hydraxis.Reference/2")]
        pub struct Reference {
            /// Swapped with `positions`.
            pub preview: u32,
            /// Swapped too.
            pub reserved: u32,
            /// The header last.
            pub positions: [[f64; crate::message::MAX_PREVIEW]; crate::MAX_AXES],
            /// Moved to the end.
            pub header: Header,
        }
    }

    impl Message for Reference {
        const CHANNEL: &'static str = "reference";
        const MAX_PUBLISHERS: usize = 1;
        const IS_FROM_CLIENTS: bool = true;
        const BUFFER: usize = 4;
        fn header(&self) -> &Header {
            &self.header
        }
        fn header_mut(&mut self) -> &mut Header {
            &mut self.header
        }
    }
}

mod limits {
    use super::*;

    crate::layout::shared_struct! {
        /// A reference with the layout of the real one; only the limits of its channel differ.
        #[type_name("hydraxis.Reference/2")]
        pub struct Reference {
            /// As in the real one.
            pub header: Header,
            /// As in the real one.
            pub positions: [[f64; crate::message::MAX_PREVIEW]; crate::MAX_AXES],
            /// As in the real one.
            pub preview: u32,
            /// As in the real one.
            pub reserved: u32,
        }
    }

    impl Message for Reference {
        const CHANNEL: &'static str = "reference";
        const MAX_PUBLISHERS: usize = 7;
        const IS_FROM_CLIENTS: bool = true;
        const BUFFER: usize = 4;
        fn header(&self) -> &Header {
            &self.header
        }
        fn header_mut(&mut self) -> &mut Header {
            &mut self.header
        }
    }
}

#[test]
fn a_foreign_layout_of_the_same_name_and_size_is_refused() {
    assert_eq!(size_of::<Reference>(), size_of::<foreign::Reference>());
    let own = Own::new("foreign");
    let group = own.join();
    let _ours = group.reader::<Reference>().unwrap();
    let error = group.publisher::<foreign::Reference>().map(|_| ()).unwrap_err();
    let PublisherError::Open(open) = &error else { panic!("{error:?}") };
    assert_eq!((open.channel.channel, open.reason), ("reference", OpenReason::ForeignLayout));
    assert!(error.to_string().contains("another layout"), "{error}");
    let source = std::error::Error::source(open).unwrap().to_string();
    assert!(source.contains("IncompatibleAttributes"), "{source}");
}

#[test]
fn a_notification_wakes_a_listener_that_waits_later() {
    let own = Own::new("event");
    let group = own.join();
    let (notifier, listener) = (group.notifier::<EncoderSample>().unwrap(), group.listener::<EncoderSample>().unwrap());
    // A notification before the wait ends the wait at once, long before its bound.
    notifier.notify().unwrap();
    let started = std::time::Instant::now();
    listener.wait(std::time::Duration::from_secs(30)).unwrap();
    assert!(started.elapsed() < std::time::Duration::from_secs(20));
    // A listener that never waits holds up no notifier, however often it notifies.
    (0..100_000).for_each(|_| notifier.notify().unwrap());
    // Without a notification the wait ends at its bound.
    listener.wait(std::time::Duration::ZERO).unwrap();
    listener.wait(std::time::Duration::from_millis(1)).unwrap();
}

#[test]
fn prefixes_that_cannot_name_files_are_refused() {
    for text in ["", "a/b", "a b", "..", "a.b", "x".repeat(33).as_str()] {
        assert!(text.parse::<Prefix>().is_err(), "{text}");
    }
    assert!("boom-1_x".parse::<Prefix>().is_ok());
}

#[test]
fn the_files_of_a_living_group_are_not_touched() {
    let own = Own::new("alive");
    let group = own.join();
    assert!(matches!(remove_leftovers(&own.0), Err(RemoveError::Alive { .. })));
    let (publisher, mut reader) = (group.publisher().unwrap(), group.reader::<EncoderSample>().unwrap());
    publisher.send(&sample(1)).unwrap();
    assert!(reader.read().unwrap().if_new().is_some());
}

#[test]
fn a_file_in_the_place_of_the_folder_is_no_running_group_and_stays() {
    let own = Own::new("file");
    std::fs::write(own.0.folder(), "foreign").unwrap();
    assert_eq!(remove_leftovers(&own.0).unwrap(), Vec::<std::path::PathBuf>::new());
    let error = Group::join(&own.0, "test").map(|_| ()).unwrap_err();
    assert!(matches!(error, JoinError::Folder { source: UnusableFolder::Foreign(_), .. }), "{error:?}");
    let error = error.to_string();
    let left = std::fs::read_to_string(own.0.folder()).unwrap();
    std::fs::remove_file(own.0.folder()).unwrap();
    assert_eq!(left, "foreign");
    assert!(error.contains("no folder") && error.contains("take another --prefix"), "{error}");
}

#[test]
fn nothing_is_left_behind() {
    let own = Own::new("left");
    {
        let group = own.join();
        let publisher = group.publisher().unwrap();
        let mut reader = group.reader::<EncoderSample>().unwrap();
        publisher.send(&sample(1)).unwrap();
        assert!(reader.read().unwrap().if_new().is_some());
    }
    remove_leftovers(&own.0).unwrap();
    assert!(!own.0.folder().exists());
    let start = format!("{}.", own.0);
    let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let left: Vec<_> = left.filter(|entry| entry.file_name().to_string_lossy().starts_with(&start)).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn too_many_readers_and_listeners_are_told_from_other_failures() {
    let own = Own::new("many");
    let group = own.join();
    let readers: Vec<_> = (0..MAX_SUBSCRIBERS).map(|_| group.reader::<EncoderSample>().unwrap()).collect();
    let error = group.reader::<EncoderSample>().map(|_| ()).unwrap_err();
    assert!(matches!(error, ReaderError::TooManyReaders { most: MAX_SUBSCRIBERS, .. }), "{error:?}");
    drop(readers);
    assert!(group.reader::<EncoderSample>().is_ok());

    let _listeners: Vec<_> = (0..MAX_SUBSCRIBERS).map(|_| group.listener::<EncoderSample>().unwrap()).collect();
    let error = group.listener::<EncoderSample>().map(|_| ()).unwrap_err();
    assert!(matches!(error, ListenerError::TooManyListeners { most: MAX_SUBSCRIBERS, .. }), "{error:?}");
    let _notifier = group.notifier::<EncoderSample>().unwrap();
    let error = group.notifier::<EncoderSample>().map(|_| ()).unwrap_err();
    assert!(matches!(error, NotifierError::TooManyNotifiers { most: 1, .. }), "{error:?}");
}

#[test]
fn a_channel_with_other_limits_is_refused_as_of_another_version() {
    let own = Own::new("limits");
    let group = own.join();
    let _ours = group.publisher::<Reference>().unwrap();
    let error = group.reader::<limits::Reference>().map(|_| ()).unwrap_err();
    let ReaderError::Open(open) = &error else { panic!("{error:?}") };
    assert_eq!(open.reason, OpenReason::OtherLimits, "{error:?}");
    assert!(error.to_string().contains("other limits"), "{error}");
}

#[test]
fn a_name_that_is_too_long_for_a_member_is_refused() {
    let own = Own::new("name");
    let error = Group::join(&own.0, &"x".repeat(1000)).map(|_| ()).unwrap_err();
    assert!(matches!(error, JoinError::Name { .. }), "{error:?}");
}
