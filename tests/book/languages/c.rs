//! The messages as structs of C.

use super::{Definitions, MAX_AXES, MAX_PREVIEW, Names, Shape, Struct, comment, source::capitals};

const HEAD: &str = "\
/* Messages, channels, flags and modes of Hydraxis, for programs in C and C++.

   This file is written out of the message types in pipeline/src/message/. Changes are lost: change the types, and type
   HYDRAXIS_BOOK=overwrite cargo test --test book

   A channel is a publish-subscribe service of iceoryx2 0.10 with the name HYDRAXIS_.._SERVICE and the type name
   HYDRAXIS_.._TYPE, below the prefix and the root path of its group. Compare the attribute HYDRAXIS_LAYOUT_ATTRIBUTE
   of the service with HYDRAXIS_.._LAYOUT before the first message: another value is another version. */

#ifndef HYDRAXIS_H
#define HYDRAXIS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define HYDRAXIS_ASSERT(condition, text) static_assert(condition, text)
#else
#define HYDRAXIS_ASSERT(condition, text) _Static_assert(condition, text)
#endif

#define HYDRAXIS_LAYOUT_ATTRIBUTE \"hydraxis.layout\"
";

/// Fields whose names are words of the language C++; they get a line at the end.
const KEYWORDS: [&str; 1] = ["operator"];

/// The text of the header.
pub fn header(definitions: &Definitions) -> String {
    let mut text = HEAD.to_owned();
    text += &format!("#define HYDRAXIS_MAX_AXES {MAX_AXES}\n#define HYDRAXIS_MAX_PREVIEW {MAX_PREVIEW}\n");
    for message in &definitions.messages {
        let name = format!("HYDRAXIS_{}", capitals(message.name));
        text += &format!("\n#define {name}_SERVICE \"hydraxis/{}\"\n", message.channel);
        text += &format!("#define {name}_TYPE \"{}\"\n", message.type_name);
        text += &format!("#define {name}_LAYOUT \"{:016x}\"\n", message.layout);
        text += &format!("#define {name}_BUFFER {}\n", message.buffer);
    }
    definitions.names.iter().for_each(|names| text += &enumeration(names));
    definitions.structs.iter().for_each(|one| text += &structure(one));
    text + "\n#endif\n"
}

fn enumeration(names: &Names) -> String {
    let name = format!("HYDRAXIS_{}", capitals(names.name));
    let constants = names.constants.iter().map(|constant| {
        format!("{}    {name}_{} = {}", comment(&constant.doc, "    // "), constant.name, constant.value)
    });
    let sets = names.sets.iter().map(|(set, value)| format!("    {name}_{set} = {value}"));
    let members: Vec<String> = constants.chain(sets).collect();
    format!("\nenum Hydraxis{} {{\n{}\n}};\n", names.name, members.join(",\n"))
}

fn structure(one: &Struct) -> String {
    let name = format!("Hydraxis{}", one.name);
    let mut text = format!("\ntypedef struct {name} {{\n");
    for (field, _) in &one.fields {
        text += &comment(field.doc, "    // ");
        text += &format!("    {};\n", member(&field.shape, &spelled(field.name)));
    }
    text += &format!("}} {name};\n");
    for (field, offset) in &one.fields {
        let place = format!("offsetof({name}, {}) == {offset}", spelled(field.name));
        text += &format!("HYDRAXIS_ASSERT({place}, \"{name}.{}\");\n", field.name);
    }
    text + &format!("HYDRAXIS_ASSERT(sizeof({name}) == {}, \"{name}\");\n", one.size)
}

fn spelled(name: &str) -> String {
    if KEYWORDS.contains(&name) { format!("{name}_") } else { name.to_owned() }
}

/// The declaration of a member: the kind of an element, the name, and the lengths from the outer to the inner one.
fn member(shape: &Shape, name: &str) -> String {
    let (mut element, mut lengths) = (shape, String::new());
    while let Shape::Array(of, count) = element {
        (element, lengths) = (of, format!("{lengths}[{count}]"));
    }
    let kind = match element {
        Shape::Number("f64") => "double".to_owned(),
        Shape::Number("i64") => "int64_t".to_owned(),
        Shape::Number(unsigned) => format!("uint{}_t", &unsigned[1..]),
        Shape::Struct(name, _) => format!("Hydraxis{name}"),
        Shape::Array(..) => unreachable!("arrays have been taken off"),
    };
    format!("{kind} {name}{lengths}")
}
