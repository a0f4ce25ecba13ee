//! Sizes and offsets of `repr(C)` structs, computed from their shapes.

use super::{Field, Shape, named, with_name, with_number};

/// A struct and the places of its fields.
pub struct Struct {
    pub name: &'static str,
    pub fields: Vec<(Field, usize)>,
    pub size: usize,
}

/// All structs in these shapes, each once, the inner ones first.
pub fn structs(shapes: impl Iterator<Item = Shape>) -> Vec<Struct> {
    let mut found = Vec::new();
    shapes.for_each(|shape| find(&shape, &mut found));
    found
}

fn find(shape: &Shape, found: &mut Vec<Struct>) {
    match shape {
        Shape::Number(_) => {}
        Shape::Array(of, _) => find(of, found),
        Shape::Struct(name, fields) => {
            fields.iter().for_each(|field| find(&field.shape, found));
            if !found.iter().any(|known| known.name == *name) {
                found.push(Struct { name, fields: offsets(fields), size: size(shape) });
            }
        }
    }
}

fn offsets(fields: &[Field]) -> Vec<(Field, usize)> {
    let mut end: usize = 0;
    let place = |field: &Field| {
        let offset = end.next_multiple_of(alignment(&field.shape));
        end = offset + size(&field.shape);
        (*field, offset)
    };
    fields.iter().map(place).collect()
}

fn alignment(shape: &Shape) -> usize {
    match shape {
        Shape::Number(_) => size(shape),
        Shape::Array(of, _) => alignment(of),
        Shape::Struct(_, fields) => fields.iter().map(|field| alignment(&field.shape)).max().unwrap_or(1),
    }
}

/// Bytes of a value.
pub fn size(shape: &Shape) -> usize {
    match shape {
        Shape::Number("u8") => 1,
        Shape::Number("u32") => 4,
        Shape::Number("u64" | "i64" | "f64") => 8,
        Shape::Number(name) => panic!("a number of unknown size: {name}"),
        Shape::Array(of, count) => size(of) * count,
        Shape::Struct(_, fields) => {
            let end = offsets(fields).last().map_or(0, |(field, offset)| offset + size(&field.shape));
            end.next_multiple_of(alignment(shape))
        }
    }
}

/// The fingerprint, with the offsets of this file.
pub fn fingerprint(shape: &Shape) -> u64 {
    match shape {
        Shape::Number(name) => named(name),
        Shape::Array(of, count) => with_number(with_name(fingerprint(of), "array"), *count as u64),
        Shape::Struct(name, fields) => offsets(fields).iter().fold(named(name), |hash, (field, offset)| {
            let hash = with_number(with_name(hash, field.name), fingerprint(&field.shape));
            with_number(hash, *offset as u64)
        }),
    }
}
