//! The files in which a Linux system describes itself. A test can put them under another root.

use std::path::PathBuf;

/// A system: `/`, or the folder of a test.
pub struct System {
    root: PathBuf,
}

impl System {
    /// This computer.
    pub fn here() -> Self {
        Self { root: PathBuf::from("/") }
    }

    /// The system whose files are in a folder.
    #[cfg(test)]
    pub fn under(root: &std::path::Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// The place of an absolute path.
    pub fn path(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// The text of a file without white space around it, if it can be read.
    pub fn text(&self, path: &str) -> Option<String> {
        std::fs::read_to_string(self.path(path)).ok().map(|text| text.trim().to_owned())
    }

    /// The number in a file.
    pub fn number(&self, path: &str) -> Option<i64> {
        self.text(path)?.parse().ok()
    }

    /// The cores of a list such as `2-3,5`.
    pub fn cores(&self, path: &str) -> Option<Vec<usize>> {
        cores_of_list(&self.text(path)?)
    }

    /// The names in a folder, sorted; empty where there is no folder.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// The value of a line `NAME: VALUE` of `/proc/self/status`.
    pub fn status(&self, name: &str) -> Option<String> {
        let text = self.text("/proc/self/status")?;
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':').map(str::trim))?;
        Some(line.to_owned())
    }

    /// Whether this process has the capability with this number.
    pub fn is_capable(&self, capability: u32) -> bool {
        let mask = self.status("CapEff").and_then(|mask| u64::from_str_radix(&mask, 16).ok());
        mask.is_some_and(|mask| mask & (1 << capability) != 0)
    }

    /// The soft limit of this process with this name in `/proc/self/limits`; `None` inside is unlimited.
    pub fn limit(&self, name: &str) -> Option<Option<u64>> {
        let text = self.text("/proc/self/limits")?;
        let value = text.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?;
        if value == "unlimited" { Some(None) } else { value.parse().ok().map(Some) }
    }
}

fn cores_of_list(text: &str) -> Option<Vec<usize>> {
    let mut cores = Vec::new();
    // Some kernels write this for an empty list.
    if text == "(null)" {
        return Some(cores);
    }
    for part in text.split(',').filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (usize, usize) = (first.parse().ok()?, last.parse().ok()?);
        cores.extend(first..=last.min(first + MOST_CORES));
    }
    Some(cores)
}

/// Longest range of cores that is read.
const MOST_CORES: usize = 1024;

/// Cores in the form of the lists of the kernel, such as `2-3,5`.
pub fn list_of_cores(cores: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for core in cores {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == *core => *last = *core,
            _ => parts.push((*core, *core)),
        }
    }
    let one = |(first, last): (usize, usize)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    parts.into_iter().map(one).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores_are_read_and_written_alike() {
        for (text, cores) in [("", vec![]), ("3", vec![3]), ("0-2", vec![0, 1, 2]), ("1,3-4,7", vec![1, 3, 4, 7])] {
            assert_eq!(cores_of_list(text), Some(cores.clone()), "{text}");
            assert_eq!(list_of_cores(&cores), text);
        }
        assert_eq!(cores_of_list("(null)"), Some(vec![]));
        for text in ["a", "1-", "(nil)"] {
            assert_eq!(cores_of_list(text), None, "{text}");
        }
    }
}
