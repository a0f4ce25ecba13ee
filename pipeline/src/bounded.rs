//! Files that are read as a whole, up to a bound: a device or a recording in the place of a text would take all memory.
//!
//! Runs before a loop, never in one.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

/// Longest file of settings: machine files, model files, `[fuzzy]`; bytes.
pub const SETTINGS: u64 = 16 << 20;
/// Longest table or recording of a logger, bytes.
pub const TABLE: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// It cannot be read, or has more than `largest` bytes.
pub fn read(file: &Path, largest: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(file)?.take(largest + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > largest {
        let said = format!("it has more than {} MiB", largest >> 20);
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, said));
    }
    Ok(bytes)
}

/// The text of a file.
///
/// # Errors
/// As [`read`], or it is not UTF-8.
pub fn read_text(file: &Path, largest: u64) -> io::Result<String> {
    let no_text = |_| io::Error::new(io::ErrorKind::InvalidData, "it is no text in UTF-8");
    String::from_utf8(read(file, largest)?).map_err(no_text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("text");
        std::fs::write(&file, "12345678").unwrap();
        assert_eq!(read_text(&file, 8).unwrap(), "12345678");
        assert_eq!(read(&file, 7).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(read(Path::new("/dev/zero"), 1 << 20).unwrap_err().to_string(), "it has more than 1 MiB");
    }
}
