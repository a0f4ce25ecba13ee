//! `hydraxis man`: the help as manual pages, one for each subcommand.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use clap::{Args, Command, CommandFactory};
use clap_mangen::{
    Man,
    roff::{Roff, roman},
};

use crate::{failure::Failure, report::output::show};

/// `man`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis man | man -l -                         reads the page of hydraxis
  hydraxis man --output ~/.local/share/man/man1   writes all pages; then: man hydraxis-run

The Debian package has all pages where man looks for them.")]
pub struct ManualArguments {
    /// Folder to write one page for each subcommand to; it is made where it is missing [default: the page of hydraxis
    /// to standard output]
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

/// Writes one page, or all of them.
pub fn run(arguments: &ManualArguments) -> Result<(), Failure> {
    let mut command = super::Arguments::command().disable_help_subcommand(true);
    command.build();
    let Some(folder) = &arguments.output else {
        let page = page(&command).map_err(Failure::run)?;
        return Ok(show(&String::from_utf8_lossy(&page))?);
    };
    let written = fs::create_dir_all(folder).and_then(|()| write(&command, folder));
    let number = written.map_err(|error| Failure::usage(error).about(format!("--output {}", folder.display())))?;
    Ok(show(&format!("written: {number} pages in {}\n", folder.display()))?)
}

/// Writes the pages of a command and of its subcommands; their number.
fn write(command: &Command, folder: &Path) -> io::Result<usize> {
    fs::write(folder.join(Man::new(command.clone()).get_filename()), page(command)?)?;
    let mut number = 1;
    for subcommand in command.get_subcommands() {
        number += write(subcommand, folder)?;
    }
    Ok(number)
}

/// The page of one command. What its help says after the options keeps its lines: these are examples and tables.
fn page(command: &Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    let man = Man::new(command.clone()).manual("Hydraxis").source(concat!("hydraxis ", env!("CARGO_PKG_VERSION")));
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    if command.get_arguments().next().is_some() {
        man.render_options_section(&mut page)?;
    }
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    if let Some(text) = command.get_after_help() {
        let mut notes = Roff::default();
        notes.control("SH", ["NOTES"]).control("nf", []);
        for line in text.to_string().lines() {
            notes.text([roman(line)]);
        }
        notes.control("fi", []).to_writer(&mut page)?;
    }
    page.flush()?;
    Ok(page)
}
