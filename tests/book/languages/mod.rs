//! The definitions of the messages for other languages, written out of the message types: `python/hydraxis/messages.py`
//! and `include/hydraxis.h`.
//!
//! `HYDRAXIS_BOOK=overwrite` writes them anew; without it, a file that differs fails its test. So no definition is
//! typed twice, and none can drift.

mod c;
mod python;
mod shapes;
mod source;

use std::process::Command;

use pipeline::{
    MAX_AXES,
    layout::{Field, Layout, Shape, named, with_name, with_number},
    message::{
        AxisMode, CHANNELS, CoefficientSnapshot, ControlMode, EncoderReading, EncoderSample, MAX_PREVIEW, MEMBERS,
        MachineState, Message, REFUSALS, Reference, Request, StageHealth, ValveCommand, control_flag, model_fault,
        sample_fault,
    },
};

use super::pages::{is_overwriting, root};
use shapes::{Struct, structs};
use source::{Constant, Source};

/// A message with all that a program in another language has to know of it.
struct Described {
    name: &'static str,
    type_name: String,
    shape: Shape,
    layout: u64,
    channel: &'static str,
    publishers: usize,
    buffer: usize,
    is_from_clients: bool,
}

fn describe<M: Message>(source: &Source) -> Described {
    let Shape::Struct(name, _) = M::SHAPE else { panic!("a message is a struct") };
    Described {
        name,
        type_name: source.type_name(name),
        shape: M::SHAPE,
        layout: M::LAYOUT,
        channel: M::CHANNEL,
        publishers: M::MAX_PUBLISHERS,
        buffer: M::BUFFER,
        is_from_clients: M::IS_FROM_CLIENTS,
    }
}

/// Named numbers: an enumeration, or bits.
struct Names {
    name: &'static str,
    is_bits: bool,
    constants: Vec<Constant>,
    /// Sets of bits, by their names.
    sets: Vec<(&'static str, u32)>,
}

/// Everything that the files say.
struct Definitions {
    structs: Vec<Struct>,
    messages: Vec<Described>,
    names: Vec<Names>,
}

impl Definitions {
    fn new() -> Self {
        let source = Source::read(&root().join("pipeline/src/message"));
        let messages = vec![
            describe::<EncoderReading>(&source),
            describe::<EncoderSample>(&source),
            describe::<ValveCommand>(&source),
            describe::<CoefficientSnapshot>(&source),
            describe::<Reference>(&source),
            describe::<Request>(&source),
            describe::<StageHealth>(&source),
            describe::<MachineState>(&source),
        ];
        assert_eq!(messages.iter().map(|message| message.channel).collect::<Vec<_>>(), CHANNELS);
        let enumeration = |name| Names { name, is_bits: false, constants: source.variants(name), sets: Vec::new() };
        let bits = |name, module, names: &[&str], sets: &[(&'static str, u32)]| {
            let constants = source.bits(module);
            let found: Vec<String> = constants.iter().map(|bit| bit.name.to_lowercase().replace('_', "-")).collect();
            assert_eq!(found, names, "{module}::NAMES");
            assert!(constants.iter().enumerate().all(|(i, bit)| bit.value == 1 << i), "{module}");
            Names { name, is_bits: true, constants, sets: sets.to_vec() }
        };
        let control_sets = [("LATCHED", control_flag::LATCHED), ("CUT_OFF", control_flag::CUT_OFF)];
        let names = vec![
            enumeration("AxisMode"),
            enumeration("ControlMode"),
            enumeration("StageState"),
            enumeration("MissCause"),
            bits("ControlFlag", "control_flag", &control_flag::NAMES, &control_sets),
            bits("SampleFault", "sample_fault", &sample_fault::NAMES, &[("UNUSABLE", sample_fault::UNUSABLE)]),
            bits("ModelFault", "model_fault", &model_fault::NAMES, &[("LASTING", model_fault::LASTING)]),
        ];
        Self { structs: structs(messages.iter().map(|message| message.shape)), messages, names }
    }
}

/// Compares a file with what it should hold, or writes it.
fn check(path: &str, text: &str) {
    let file = root().join(path);
    if is_overwriting() {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    } else {
        let found = std::fs::read_to_string(&file).unwrap_or_default();
        assert!(found == text, "{path} differs: HYDRAXIS_BOOK=overwrite cargo test --test book writes it anew");
    }
}

#[test]
fn messages_in_python_are_those_of_rust() {
    check("python/hydraxis/messages.py", &python::module(&Definitions::new()));
}

#[test]
fn messages_in_c_are_those_of_rust_and_compile() {
    check("include/hydraxis.h", &c::header(&Definitions::new()));
    let folder = tempfile::tempdir().unwrap();
    // The header asserts every size and every offset.
    for (compiler, standard, file) in [("cc", "-std=c11", "it.c"), ("c++", "-std=c++11", "it.cpp")] {
        let program = folder.path().join(file);
        std::fs::write(&program, "#include \"hydraxis.h\"\nint main(void) { return HYDRAXIS_MAX_AXES - 8; }\n")
            .unwrap();
        let mut command = Command::new(compiler);
        command.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", "-I"]);
        match command.arg(root().join("include")).arg(&program).output() {
            Err(error) if compiler == "c++" && error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => panic!("{compiler}: {error}"),
            Ok(out) => assert!(out.status.success(), "{compiler}: {}", String::from_utf8_lossy(&out.stderr)),
        }
    }
}

#[test]
fn offsets_of_the_generator_are_those_of_the_compiler() {
    let definitions = Definitions::new();
    // The fingerprint in Rust is made of the offsets that the compiler chose.
    for message in &definitions.messages {
        assert_eq!(shapes::fingerprint(&message.shape), message.layout, "{}", message.name);
    }
    assert_eq!(shapes::size(&EncoderSample::SHAPE), size_of::<EncoderSample>());
    assert_eq!(shapes::size(&StageHealth::SHAPE), size_of::<StageHealth>());
}

#[test]
fn constants_of_the_source_are_those_of_the_types() {
    let definitions = Definitions::new();
    let values = |name: &str| -> Vec<(String, u32)> {
        let names = definitions.names.iter().find(|names| names.name == name).unwrap();
        names.constants.iter().map(|constant| (constant.name.to_lowercase(), constant.value)).collect()
    };
    for mode in AxisMode::ALL {
        assert_eq!(values("AxisMode")[mode as usize], (mode.name().to_owned(), mode as u32));
    }
    for (name, value) in values("ControlMode") {
        assert_eq!(ControlMode::name(value), name);
    }
}

/// The table of the channels for the book.
pub fn table() -> String {
    let mut table = "| channel | type | bytes | layout | writers | a reader may fall behind by |\n".to_owned();
    table += "|---|---|---|---|---|---|\n";
    for message in Definitions::new().messages {
        let Described { channel, type_name, layout, publishers, buffer, .. } = &message;
        let size = shapes::size(&message.shape);
        table +=
            &format!("| `{channel}` | `{type_name}` | {size} | `{layout:016x}` | {publishers} | {buffer} messages |\n");
    }
    table
}

/// Lines of a documentation, for readers who do not see Rust: without links and code spans.
fn plain(doc: &str) -> Vec<String> {
    let mut text = doc.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    while let Some(begin) = text.find("](") {
        let Some(end) = text[begin..].find(')') else { break };
        text.replace_range(begin + 1..=begin + end, "");
    }
    for (link, name) in [("[`", ""), ("`]", ""), ("`", "")] {
        text = text.replace(link, name);
    }
    text.split("\n\n").map(|part| part.trim().to_owned()).collect()
}

/// Comment lines with this beginning, at most 120 columns wide.
fn comment(doc: &str, beginning: &str) -> String {
    let mut lines = String::new();
    for text in plain(doc) {
        let mut line = String::new();
        for word in text.split_whitespace() {
            if !line.is_empty() && beginning.len() + line.len() + 1 + word.len() > 120 {
                lines += &format!("{beginning}{}\n", std::mem::take(&mut line));
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line += word;
        }
        if !line.is_empty() {
            lines += &format!("{beginning}{line}\n");
        }
    }
    lines
}
