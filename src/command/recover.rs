//! `hydraxis recover`: writes a recording anew that a kill, a loss of power or a full disk has cut.

use std::{collections::BTreeMap, path::PathBuf};

use clap::Args;

use crate::{
    failure::Failure,
    recording::{
        Facts,
        file::{RecordingFile, cause},
        reading::Reading,
    },
    report::output::show,
};

/// `recover`.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  hydraxis recover demo.mcap clean.mcap

Every command of hydraxis reads a damaged recording as far as it goes. Other programs may want a whole file. Exit codes:
0 written, 1 cannot be written, 2 no recording.")]
pub struct RecoverArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// The new file
    #[arg(value_name = "NEW.mcap")]
    pub new: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &RecoverArguments) -> Result<(), Failure> {
    let mut reading = Reading::open(&arguments.file).map_err(Failure::usage)?;
    let first = reading.next().map_err(Failure::usage)?;
    if let (None, Some(damage)) = (&first, reading.damage()) {
        let (file, byte, what) = (arguments.file.display(), damage.byte, &damage.what);
        return Err(Failure::usage(format!(
            "{file}: found no message that can be read (byte {byte}: {what}); allowed: a recording, or a black box"
        )));
    }
    let at_begin = reading.facts().clone();
    let failed = |error| Failure::run(cause(&error)).about(arguments.new.display().to_string());
    let mut file = RecordingFile::create(&arguments.new, &at_begin, &[], 0).map_err(failed)?;
    let mut channels = BTreeMap::new();
    // Hydraxis writes all channels before the first message; another program may not.
    for channel in reading.channels() {
        channels.insert(channel.name.clone(), file.add_read_channel(channel).map_err(failed)?);
    }
    let (mut message, mut count) = (first, 0u64);
    while let Some(read) = message {
        let channel = match channels.get(&read.channel.name) {
            Some(channel) => *channel,
            None => {
                let channel = file.add_read_channel(&read.channel).map_err(failed)?;
                channels.insert(read.channel.name.clone(), channel);
                channel
            }
        };
        file.write_read(channel, &read).map_err(failed)?;
        count += 1;
        message = reading.next().map_err(Failure::usage)?;
    }
    reading.attached().iter().try_for_each(|(name, content)| file.attach(name, content)).map_err(failed)?;
    let at_end: Facts = reading
        .facts()
        .iter()
        .filter(|(name, _)| !at_begin.contains_key(*name))
        .map(|(name, fact)| (name.clone(), fact.clone()))
        .collect();
    file.finish(&at_end).map_err(failed)?;
    let end = match reading.damage() {
        Some(damage) => format!("read up to byte {}: {}", damage.byte, damage.what),
        None => "the recording was whole".to_owned(),
    };
    Ok(show(&format!("{}: {count} messages; {end}\n", arguments.new.display()))?)
}
