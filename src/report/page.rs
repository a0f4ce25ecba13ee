//! Reports with pictures: one HTML file that needs no other, and no network. It has no script and prints on A4.

use std::{error::Error, fmt::Write as _};

use super::chart::{Chart, WIDE};

const STYLE: &str = "\
body{font-family:sans-serif;max-width:1160px;margin:2em auto;padding:0 1em;color:#222;line-height:1.4}\
h1{font-size:1.6em}h2{font-size:1.25em;margin-top:1.6em}\
.verdict{font-size:1.15em;padding:.6em 1em;border-left:.5em solid #b3261e;background:#fbeceb}\
.verdict.good{border-color:#1b7f3b;background:#eaf6ed}\
table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:.25em .7em;text-align:right}\
td:first-child,th:first-child{text-align:left}.facts td,.facts th{text-align:left}.texts{width:100%;font-size:.85em}\
.pictures{display:grid;grid-template-columns:1fr 1fr;gap:1.2em}figure{margin:0}.wide{grid-column:1/-1}\
figcaption{font-size:.9em;color:#444;margin:.2em 1em}svg{width:100%;height:auto;display:block}\
@media screen and (max-width:760px){.pictures{grid-template-columns:1fr}}\
@page{size:A4;margin:14mm}\
@media print{body{max-width:none;margin:0;padding:0;font-size:9.5pt;-webkit-print-color-adjust:exact;\
print-color-adjust:exact}figure,tr,.verdict{break-inside:avoid}h2{break-after:avoid}.pictures{gap:.6em}}";

/// A page in the making.
#[derive(Debug)]
pub struct Page {
    text: String,
}

/// A chart, and what it shows.
#[derive(Debug, Clone)]
pub struct Figure {
    /// The chart.
    pub chart: Chart,
    /// Below it; may be empty.
    pub caption: String,
}

impl Page {
    /// A page with this title.
    pub fn new(title: &str) -> Self {
        let title = escaped(title);
        let head = format!(
            "<meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
             <title>{title}</title><style>{STYLE}</style>"
        );
        Self { text: format!("<!DOCTYPE html>\n<html lang=\"en\"><head>{head}</head>\n<body><h1>{title}</h1>\n") }
    }

    /// Begins a section.
    pub fn section(&mut self, title: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "<h2>{}</h2>", escaped(title));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.text, "<p>{}</p>", escaped(text));
    }

    /// The result in words: what was found, and why.
    pub fn verdict(&mut self, is_good: bool, word: &str, why: &str) {
        let class = if is_good { "verdict good" } else { "verdict" };
        let _ = writeln!(self.text, "<p class=\"{class}\"><strong>{}:</strong> {}</p>", escaped(word), escaped(why));
    }

    /// A table of names and values.
    pub fn facts(&mut self, rows: &[(&str, String)]) {
        self.text += "<table class=\"facts\">\n";
        for (name, value) in rows {
            let _ = writeln!(self.text, "<tr><td>{}</td><td>{}</td></tr>", escaped(name), escaped(value));
        }
        self.text += "</table>\n";
    }

    /// A table of numbers, whose first column names them.
    pub fn table(&mut self, header: &[String], rows: &[Vec<String>]) {
        self.rows("<table>", header, rows);
    }

    fn rows(&mut self, table: &str, header: &[String], rows: &[Vec<String>]) {
        let row = |tag: &str, cells: &[String]| {
            let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let rows: String = rows.iter().map(|cells| row("td", cells)).collect();
        let _ = write!(self.text, "{table}\n{}{rows}</table>\n", row("th", header));
    }

    /// A list of sentences; nothing without any.
    pub fn list(&mut self, sentences: &[String]) {
        if sentences.is_empty() {
            return;
        }
        let items: String = sentences.iter().map(|sentence| format!("<li>{}</li>\n", escaped(sentence))).collect();
        let _ = write!(self.text, "<ul>\n{items}</ul>\n");
    }

    /// A table of texts over the whole width.
    pub fn wide_table(&mut self, header: &[String], rows: &[Vec<String>]) {
        self.rows("<table class=\"facts texts\">", header, rows);
    }

    /// A picture that is SVG already, over the whole width.
    pub fn svg(&mut self, svg: &str, caption: &str) {
        let _ = writeln!(self.text, "<figure>{svg}<figcaption>{}</figcaption></figure>", escaped(caption));
    }

    /// Pictures, two beside each other where they are narrow.
    ///
    /// # Errors
    /// The library cannot draw one.
    pub fn pictures(&mut self, figures: &[Figure]) -> Result<(), Box<dyn Error + Send + Sync>> {
        self.text += "<div class=\"pictures\">\n";
        for Figure { chart, caption } in figures {
            let class = if chart.size == WIDE { " class=\"wide\"" } else { "" };
            let _ = writeln!(self.text, "<figure{class}>{}", fitted(&chart.svg()?, chart.size));
            if !caption.is_empty() {
                let _ = writeln!(self.text, "<figcaption>{}</figcaption>", escaped(caption));
            }
            self.text += "</figure>\n";
        }
        self.text += "</div>\n";
        Ok(())
    }

    /// The text of the file.
    pub fn finish(self) -> String {
        self.text + "</body></html>\n"
    }
}

/// The picture in the width of its place: without a size in pixels, and with that size as its view box.
fn fitted(svg: &str, (width, height): (u32, u32)) -> String {
    svg.replacen(&format!("width=\"{width}\" height=\"{height}\" "), "", 1)
}

/// Text in HTML, SVG and XML, and as the value of an attribute.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_escaped_and_nothing_is_loaded() {
        let mut page = Page::new("a < b & c");
        page.verdict(false, "not <usable>", "outliers");
        page.facts(&[("file", "<x>.csv".to_owned())]);
        page.table(&["<".to_owned()], &[vec!["&".to_owned()]]);
        let text = page.finish();
        for expected in ["a &lt; b &amp; c", "not &lt;usable&gt;", "&lt;x&gt;.csv", "<th>&lt;</th>", "<td>&amp;</td>"] {
            assert!(text.contains(expected), "{expected}\n{text}");
        }
        assert!(!["<script", "http:", "https:", "src=", "url("].iter().any(|part| text.contains(part)), "{text}");
    }
}
