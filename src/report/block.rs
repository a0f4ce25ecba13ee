//! Lines at the lower end of a terminal that are redrawn in place. Other lines scroll above them.
//!
//! A line is cut at the width of the terminal, because a wrapped line takes more rows than are erased before the next
//! drawing. When the terminal has been made narrower since, it has wrapped the lines itself; [`Block`] counts their
//! rows by the width of now.
//!
//! Trap: everything that is written to the terminal while a block stands there must go through it. Otherwise the block
//! erases lines of others.

use console::{Term, measure_text_width, truncate_str};

/// Size of a terminal that does not say how large it is.
const SIZE: (usize, usize) = (24, 80);
/// End of a line that has been cut.
const CUT: &str = ">";

/// Whether the terminal, if there is one, can move its cursor.
pub fn can_move() -> bool {
    std::env::var_os("TERM").is_none_or(|name| name != "dumb")
}

/// The lines of one terminal.
#[derive(Debug)]
pub struct Block {
    term: Term,
    lines: Vec<String>,
    /// Widths of the lines that stand on the terminal.
    drawn: Vec<usize>,
}

impl Block {
    /// A block on standard error; none where standard error is no terminal, or one that cannot move its cursor.
    pub fn on_stderr() -> Option<Self> {
        Self::on(Term::stderr())
    }

    fn on(term: Term) -> Option<Self> {
        (term.is_term() && can_move()).then(|| Self { term, lines: Vec::new(), drawn: Vec::new() })
    }

    /// What to write to the terminal so that these lines stand in the block. Without lines the block is gone.
    pub fn show(&mut self, lines: Vec<String>) -> String {
        self.lines = lines;
        self.above("")
    }

    /// What to write to the terminal so that `text`, which is empty or ends with a line break, stands above the block.
    pub fn above(&mut self, text: &str) -> String {
        let (rows, columns) = self.term.size_checked().map_or(SIZE, |(rows, columns)| (rows.into(), columns.into()));
        let drawing = drawing(&self.drawn, text, &self.lines, (rows, columns));
        self.drawn = drawing.widths;
        drawing.text
    }
}

/// A text for the terminal, and the widths of the lines at its end that belong to the block.
struct Drawing {
    text: String,
    widths: Vec<usize>,
}

/// Erases lines of the widths `drawn`, then writes `above` and `lines` to a terminal of `size`, rows and columns.
fn drawing(drawn: &[usize], above: &str, lines: &[String], (rows, columns): (usize, usize)) -> Drawing {
    let (rows, columns) = (rows.max(2), columns.max(1));
    let used: usize = drawn.iter().map(|width| width.div_ceil(columns).max(1)).sum();
    let mut text = String::new();
    // No row above the screen can be reached.
    if used > 0 {
        text += &format!("\r\x1b[{}A", used.min(rows - 1));
    }
    let (erase_line, erase_rest) = if used > 0 { ("\x1b[K", "\x1b[J") } else { ("", "") };
    if !above.is_empty() {
        text += erase_rest;
        text += above;
    }
    // The row below the block is that of the cursor.
    let fitting = lines.iter().take(rows - 1).map(|line| truncate_str(line, columns, CUT));
    let mut widths = Vec::new();
    for line in fitting {
        widths.push(measure_text_width(&line));
        // Row by row, so that nothing flickers.
        text += erase_line;
        text += &line;
        text.push('\n');
    }
    text += erase_rest;
    Drawing { text, widths }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TERMINAL: (usize, usize) = (24, 80);

    fn lines(texts: &[&str]) -> Vec<String> {
        texts.iter().map(|text| (*text).to_owned()).collect()
    }

    #[test]
    fn a_line_above_takes_the_place_of_the_block_which_is_drawn_again_below() {
        let first = drawing(&[], "", &lines(&["a", ""]), TERMINAL);
        assert_eq!((first.text.as_str(), &first.widths[..]), ("a\n\n", &[1, 0][..]));
        let second = drawing(&first.widths, "log\n", &lines(&["b"]), TERMINAL);
        assert_eq!(second.text, "\r\x1b[2A\x1b[Jlog\n\x1b[Kb\n\x1b[J");
        assert_eq!(drawing(&second.widths, "", &[], TERMINAL).text, "\r\x1b[1A\x1b[J");
        assert_eq!(drawing(&[], "log\n", &[], TERMINAL).text, "log\n");
    }

    #[test]
    fn a_long_line_is_cut_and_never_wrapped() {
        let long = lines(&[&"x".repeat(200)]);
        let drawn = drawing(&[], "", &long, TERMINAL);
        assert_eq!(drawn.text, format!("{}>\n", "x".repeat(79)));
        assert_eq!(drawn.widths, [80]);
        let narrower = drawing(&drawn.widths, "", &long, (24, 30));
        assert!(narrower.text.starts_with("\r\x1b[3A"), "the terminal has wrapped the line into three rows");
    }

    #[test]
    fn a_high_block_is_cut_at_the_height_of_the_terminal() {
        let high: Vec<String> = (0..30).map(|i| i.to_string()).collect();
        let drawn = drawing(&[], "", &high, TERMINAL);
        assert_eq!(drawn.text.lines().count(), 23);
    }
}
