//! The names that a mistyped name may have meant.
//!
//! ```text
//! d(typed, name) <= max(1, n / 3)        0 for a single letter
//! ```
//!
//! d distance of Damerau and Levenshtein: letters that were left out, added, exchanged with another one, or swapped
//! with their neighbour; n number of letters that were typed. Capitals count as small letters, and `-` as `_`.
//!
//! Runs where a file or a command line is refused, never in a loop.

use std::path::Path;

use strsim::damerau_levenshtein;

/// Most names that are proposed.
const MOST: usize = 3;
/// Part of the letters that may be wrong.
const WRONG_PART: usize = 3;

/// The known names that are nearest to a typed one, in their order; none where all of them are too different.
pub fn nearest<'a>(typed: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let plain = |name: &str| name.to_lowercase().replace('-', "_");
    let typed = plain(typed);
    let distances: Vec<(usize, &str)> =
        known.into_iter().map(|name| (damerau_levenshtein(&typed, &plain(name)), name)).collect();
    let Some(least) = distances.iter().map(|(distance, _)| *distance).min() else { return Vec::new() };
    let letters = typed.chars().count();
    if least > if letters > 1 { 1.max(letters / WRONG_PART) } else { 0 } {
        return Vec::new();
    }
    let mut names: Vec<&str> = Vec::new();
    for (_, name) in distances.into_iter().filter(|(distance, _)| *distance == least) {
        if !names.contains(&name) && names.len() < MOST {
            names.push(name);
        }
    }
    names
}

/// The end of a message that refuses a mistyped name: a question with the nearest known names, or nothing.
///
/// ```
/// use pipeline::nearest::did_you_mean;
///
/// assert_eq!(did_you_mean("bom", ["boom", "arm"]), "; did you mean `boom`?");
/// assert_eq!(did_you_mean("swing", ["boom", "arm"]), "");
/// ```
pub fn did_you_mean<'a>(typed: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    question(nearest(typed, known))
}

/// [`did_you_mean`] of the files beside `path`; nothing where `path` exists.
pub fn did_you_mean_file(path: &Path) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (false, Some(name), Ok(entries)) = (path.exists(), path.file_name(), folder.read_dir()) else {
        return String::new();
    };
    let files = entries.flatten().filter(|entry| entry.path().is_file());
    let mut names: Vec<String> = files.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    did_you_mean(&name.to_string_lossy(), names.iter().map(String::as_str))
}

/// The question of [`did_you_mean`] with these names, as many of them as are proposed; nothing without names.
pub fn question<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<String> = names.into_iter().take(MOST).map(|name| format!("`{name}`")).collect();
    if names.is_empty() { String::new() } else { format!("; did you mean {}?", names.join(" or ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_names_are_proposed_and_none_that_is_too_different() {
        let keys = ["max_speed", "stroke", "soft_limits", "columns", "kp", "ki"];
        assert_eq!(nearest("max_sped", keys), ["max_speed"]);
        assert_eq!(nearest("Max-Speed", keys), ["max_speed"]);
        assert_eq!(nearest("sotrke", keys), ["stroke"]);
        assert_eq!(nearest("kd", keys), ["kp", "ki"]);
        assert_eq!(nearest("pressure", keys), Vec::<&str>::new());
        assert_eq!((nearest("x", []), nearest("x", ["y"])), (Vec::new(), Vec::new()));
        assert_eq!(did_you_mean("kd", keys), "; did you mean `kp` or `ki`?");
    }
}
