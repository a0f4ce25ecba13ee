//! A connection that iceoryx2 could not make at the first try: iceoryx2 drops it and reports this to nobody.

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
fn a_reader_that_was_never_connected_receives_after_it_has_attached_anew() {
    let prefix: Prefix = format!("t{}-lost", std::process::id()).parse().unwrap();
    let group = Group::join(&prefix, "test").unwrap();
    let publisher = group.publisher::<EncoderSample>().unwrap();
    let mut reader = group.reader::<EncoderSample>().unwrap();
    // The first send makes the connection; with this limit it cannot open the file that it needs.
    let limit = getrlimit(Resource::Nofile);
    let lowest = Rlimit { current: Some(3), maximum: limit.maximum };
    setrlimit(Resource::Nofile, lowest).unwrap();
    send(&publisher, 1);
    setrlimit(Resource::Nofile, limit).unwrap();

    send(&publisher, 2);
    publisher.greet();
    assert!(reader.read().unwrap().if_new().is_none(), "iceoryx2 gives up such a connection");
    reader.reattach();
    publisher.greet();
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(2), "the last message comes");
    send(&publisher, 3);
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(3));
    // A reader that has read the last message does not get it twice.
    reader.reattach();
    publisher.greet();
    assert!(reader.read().unwrap().if_new().is_none());
    send(&publisher, 4);
    assert_eq!(reader.read().unwrap().if_new().map(|sample| sample.header.sequence), Some(4));
    assert_eq!((reader.lost(), reader.restarts()), (0, 0));
    drop((publisher, reader, group));
    remove_leftovers(&prefix).unwrap();
}
