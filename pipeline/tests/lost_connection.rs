//! A connection that could not be made at the first try: the library drops it, and nobody is told.

use pipeline::{
    channel::{Group, Prefix, Publisher, remove_leftovers},
    message::{EncoderSample, Message},
};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

fn send(publisher: &Publisher<EncoderSample>, sequence: u64) {
    let mut sample = EncoderSample::default();
    sample.header_mut().sequence = sequence;
    publisher.send(&sample).unwrap();
}

#[test]
fn a_reader_that_was_never_connected_hears_again_once_it_attaches_anew() {
    let prefix: Prefix = format!("t{}-lost", std::process::id()).parse().unwrap();
    let group = Group::join(&prefix, "test").unwrap();
    let publisher = group.publisher::<EncoderSample>().unwrap();
    let mut reader = group.reader::<EncoderSample>().unwrap();
    // The first send makes the connection, for which it may open no file.
    let limit = getrlimit(Resource::Nofile);
    let lowest = Rlimit { current: Some(3), maximum: limit.maximum };
    setrlimit(Resource::Nofile, lowest).unwrap();
    send(&publisher, 1);
    setrlimit(Resource::Nofile, limit).unwrap();

    send(&publisher, 2);
    publisher.greet();
    assert!(reader.read().unwrap().if_new().is_none(), "the library gives such a connection up");
    reader.reattach();
    publisher.greet();
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(2), "the last one");
    send(&publisher, 3);
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(3));
    // One that had read it all does not get the last one twice.
    reader.reattach();
    publisher.greet();
    assert!(reader.read().unwrap().if_new().is_none());
    send(&publisher, 4);
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(4));
    assert_eq!((reader.lost(), reader.restarts()), (0, 0));
    drop((publisher, reader, group));
    remove_leftovers(&prefix).unwrap();
}
