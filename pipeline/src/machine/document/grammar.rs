//! Where a text is no TOML, as few problems as mistakes.

use toml::de::Error;

use super::Problem;

/// Most broken lines that are shown one by one where most lines of a file are broken.
const MOST_BROKEN: usize = 2;
/// What the parser says about a key, or a table, that stands twice.
const TWICE: &str = "duplicate key";

/// The problems of `text`, in which the parser has found these errors.
pub(super) fn problems(text: &str, errors: &[Error]) -> Vec<Problem> {
    let lines: Vec<&str> = text.lines().collect();
    let line_of = |error: &Error| error.span().map(|span| text[..span.start.min(text.len())].matches('\n').count());
    let is_filled = |line: &&&str| !line.trim().is_empty();
    if errors.len() > MOST_BROKEN && 2 * errors.len() > lines.iter().filter(is_filled).count() {
        let first = lines.iter().find(is_filled).map_or("", |line| line.trim());
        let found = format!("a file that is no TOML: most of its lines are like \"{first}\"");
        let allowed = "a file in TOML, such as `hydraxis init` and `hydraxis commission` write";
        return vec![Problem { file: None, line: None, key: String::new(), found, allowed: allowed.to_owned() }];
    }
    // The keys of a table that stands twice may stand twice as well.
    let header_of = |line: usize| (0..=line).rev().find(|at| lines.get(*at).is_some_and(|line| is_header(line)));
    let is_twice = |line: usize| errors.iter().any(|error| error.message() == TWICE && line_of(error) == Some(line));
    let follows = |error: &&Error| {
        let header =
            line_of(error).filter(|_| error.message() == TWICE).and_then(|line| Some((line, header_of(line)?)));
        header.is_some_and(|(line, header)| line != header && is_twice(header))
    };
    let problem = |error: &Error| {
        let line = line_of(error);
        let shown = line.and_then(|line| lines.get(line)).map_or("", |line| line.trim());
        let at = if line.is_some() { format!(" in \"{shown}\"") } else { String::new() };
        Problem {
            file: None,
            line: line.map(|line| line + 1),
            key: String::new(),
            found: format!("{}{at}", error.message()),
            allowed: format!("valid TOML{}", comma_hint(shown)),
        }
    };
    errors.iter().filter(|error| !follows(error)).map(problem).collect()
}

/// Whether a line begins a table.
fn is_header(line: &str) -> bool {
    line.trim_start().starts_with('[')
}

/// What is added for a broken line with a comma between two digits, as some languages write a number.
fn comma_hint(line: &str) -> &'static str {
    let value = line.split('#').next().unwrap_or_default().as_bytes();
    let has = value.windows(3).any(|part| part[1] == b',' && part[0].is_ascii_digit() && part[2].is_ascii_digit());
    if has { ", in which a number has a decimal point, such as 0.5" } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use toml::de::DeTable;

    fn found(text: &str) -> Vec<(Option<usize>, String)> {
        let problems = problems(text, &DeTable::parse_recoverable(text).1);
        problems.into_iter().map(|problem| (problem.line, problem.found + "; " + &problem.allowed)).collect()
    }

    #[test]
    fn every_broken_line_is_named_and_another_kind_of_file_once() {
        let two = found("a = 1\nb = 0,5\nc = 2\nd = x\n");
        assert_eq!((two[0].0, two[1].0, two.len()), (Some(2), Some(4), 2), "{two:?}");
        assert!(two[0].1.ends_with("decimal point, such as 0.5") && two[1].1.ends_with("valid TOML"), "{two:?}");
        let csv = found("\nt,u\n0,1\n1,2\n2,3\n");
        assert_eq!((csv[0].0, csv.len()), (None, 1), "{csv:?}");
        assert!(csv[0].1.contains("most of its lines are like \"t,u\""), "{csv:?}");
        assert_eq!(found("[a]\nb = 1\n"), []);
    }

    #[test]
    fn a_table_that_stands_twice_is_one_problem_and_a_key_another() {
        let twice = found("[a]\nb = 1\nc = 2\n[a]\nb = 1\nc = 2\n[d]\ne = 1\ne = 1\n");
        assert_eq!(twice.iter().map(|(line, _)| *line).collect::<Vec<_>>(), [Some(4), Some(9)], "{twice:?}");
    }
}
