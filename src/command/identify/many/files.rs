//! The files that are meant: those that were named, and the recordings of the folders that were named.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use crate::failure::Failure;

/// Endings of recordings, by which they are found in a folder.
const ENDINGS: [&str; 6] = ["csv", "tsv", "txt", "dat", "log", "mcap"];
/// Deepest folder within a folder. A link could lead back to where it is.
const DEEPEST: usize = 16;

/// All files, each once: in the order of the command line, those of a folder by their names.
///
/// # Errors
/// A folder cannot be read, or there is no file.
pub(super) fn list(named: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for path in named {
        if path.is_dir() {
            walk(path, DEEPEST, &mut found)?;
        } else {
            found.push(path.clone());
        }
    }
    if found.is_empty() {
        let endings = ENDINGS.join(", ");
        return Err(Failure::usage(format!(
            "found no recording in the folders; allowed: files that end with {endings}"
        )));
    }
    let mut known = BTreeSet::new();
    found.retain(|path| known.insert(path.clone()));
    Ok(found)
}

fn walk(folder: &Path, deepest: usize, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|error| Failure::usage(error).about(folder.display().to_string()))?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        if path.is_dir() && deepest > 0 {
            walk(&path, deepest - 1, found)?;
        } else if ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str())) && path.is_file() {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_gives_its_recordings_by_name_and_no_file_comes_twice() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        fs::create_dir(place("deep")).unwrap();
        for name in ["b.csv", "a.CSV", "notes.md", "deep/c.txt"] {
            fs::write(place(name), "").unwrap();
        }
        let named = [place("b.csv"), folder.path().to_owned(), place("missing.csv")];
        let expected = ["b.csv", "a.CSV", "deep/c.txt", "missing.csv"].map(place);
        assert_eq!(list(&named).unwrap(), expected);
        assert!(list(&[place("deep")]).is_ok());
        fs::remove_file(place("deep/c.txt")).unwrap();
        assert!(list(&[place("deep")]).unwrap_err().to_string().contains("found no recording"));
    }
}
