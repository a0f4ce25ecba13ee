//! What only the source says of the messages: type names, and constants with their documentation.

use std::path::Path;

/// A named number.
pub struct Constant {
    /// In capitals.
    pub name: String,
    pub value: u32,
    pub doc: String,
}

/// The source of the messages.
pub struct Source(String);

impl Source {
    /// Of all files of a folder.
    pub fn read(folder: &Path) -> Self {
        let files = std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read_to_string(entry.unwrap().path()));
        Self(files.map(Result::unwrap).collect())
    }

    /// The type name of a message, with its version.
    pub fn type_name(&self, name: &str) -> String {
        let attribute = format!("#[type_name(\"hydraxis.{name}/");
        let begin = self.0.find(&attribute).unwrap_or_else(|| panic!("no type name of {name}")) + attribute.len();
        let version = self.0[begin..].split('"').next().unwrap();
        format!("hydraxis.{name}/{version}")
    }

    /// The variants of an enumeration.
    pub fn variants(&self, name: &str) -> Vec<Constant> {
        constants(self.block(&format!("pub enum {name} {{")), |line| line.strip_suffix(',')?.split_once(" = "))
    }

    /// The bits of a module of constants.
    pub fn bits(&self, module: &str) -> Vec<Constant> {
        constants(self.block(&format!("pub mod {module} {{")), |line| {
            line.strip_prefix("pub const ")?.strip_suffix(';')?.split_once(": u32 = ")
        })
    }

    /// The lines from a head to the bracket that closes it.
    fn block(&self, head: &str) -> &str {
        let begin = self.0.find(head).unwrap_or_else(|| panic!("no {head}")) + head.len();
        self.0[begin..].split("\n}").next().unwrap()
    }
}

/// The lines that are a name and a number, with the documentation above them.
fn constants<'a>(block: &'a str, part: impl Fn(&'a str) -> Option<(&'a str, &'a str)>) -> Vec<Constant> {
    let (mut found, mut doc) = (Vec::new(), String::new());
    for line in block.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("///") {
            doc += &format!("{text}\n");
            continue;
        }
        let doc = std::mem::take(&mut doc);
        if let Some((name, value)) = part(line)
            && let Ok(value) = value.replace('_', "").parse()
        {
            found.push(Constant { name: capitals(name), value, doc });
        }
    }
    found
}

/// A name in capitals, with a line between words.
pub fn capitals(name: &str) -> String {
    let mut out = String::new();
    let mut last = '_';
    for letter in name.chars() {
        if letter.is_uppercase() && (last.is_lowercase() || last.is_ascii_digit()) {
            out.push('_');
        }
        out.extend(letter.to_uppercase());
        last = letter;
    }
    out
}
