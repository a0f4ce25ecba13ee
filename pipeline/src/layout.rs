//! What a message is made of: the fingerprint of its memory layout, its fields, and their values.
//!
//! iceoryx2 compares only type name, size and alignment, so it does not notice two fields of one size that have swapped
//! places. The fingerprint folds the name, type and offset of every field into one number. The number is an attribute
//! of the channel and is checked on opening.
//!
//! Names and types of the fields, and a walk over their values, let a message be written in another format, and read
//! from it, without a second list of its fields.

/// A type whose memory layout is known.
pub trait Layout {
    /// FNV-1a hash over name, type and offset of every field, nested types included.
    const LAYOUT: u64;
    /// What it is made of.
    const SHAPE: Shape;

    /// Gives all its numbers to `sink`, in the order of the fields.
    fn walk(&self, sink: &mut impl Sink);

    /// Takes all its numbers from `numbers`, in the order of the fields. None where they end before the fields do.
    fn fill(&mut self, numbers: &mut impl Numbers) -> Option<()>;
}

/// What a type is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A number, with the name of its type.
    Number(&'static str),
    /// So many of one shape.
    Array(&'static Shape, usize),
    /// A struct with its name and its fields.
    Struct(&'static str, &'static [Field]),
}

/// A field of a struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Its documentation, one line of the source after the other.
    pub doc: &'static str,
    /// What it is made of.
    pub shape: Shape,
}

/// Takes numbers.
pub trait Sink {
    /// Takes one number as little-endian bytes.
    fn number<const N: usize>(&mut self, bytes: [u8; N]);
}

/// Gives numbers.
pub trait Numbers {
    /// The next number as little-endian bytes; none at the end.
    fn number<const N: usize>(&mut self) -> Option<[u8; N]>;
}

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// Starts a fingerprint from a type's name.
pub const fn named(name: &str) -> u64 {
    with_name(FNV_OFFSET, name)
}

/// Folds a name into a fingerprint.
pub const fn with_name(mut hash: u64, name: &str) -> u64 {
    let bytes = name.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

/// Folds a number into a fingerprint.
pub const fn with_number(mut hash: u64, number: u64) -> u64 {
    let bytes = number.to_le_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

macro_rules! primitive {
    ($($ty:ident),*) => {
        $(impl Layout for $ty {
            const LAYOUT: u64 = named(stringify!($ty));
            const SHAPE: Shape = Shape::Number(stringify!($ty));

            fn walk(&self, sink: &mut impl Sink) {
                sink.number(self.to_le_bytes());
            }

            fn fill(&mut self, numbers: &mut impl Numbers) -> Option<()> {
                *self = $ty::from_le_bytes(numbers.number()?);
                Some(())
            }
        })*
    };
}
primitive!(u8, u32, u64, i64, f64);

impl<T: Layout, const N: usize> Layout for [T; N] {
    const LAYOUT: u64 = with_number(with_name(T::LAYOUT, "array"), N as u64);
    const SHAPE: Shape = Shape::Array(&T::SHAPE, N);

    fn walk(&self, sink: &mut impl Sink) {
        self.iter().for_each(|item| item.walk(sink));
    }

    fn fill(&mut self, numbers: &mut impl Numbers) -> Option<()> {
        self.iter_mut().try_for_each(|item| item.fill(numbers))
    }
}

/// Declares a struct for shared memory: `repr(C)`, `Copy`, with a [`Layout`] that is derived from the listed fields.
/// `ZeroCopySend` must be in scope, as for its derive.
macro_rules! shared_struct {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[doc = $doc:literal])* pub $field:ident: $ty:ty,)* }) => {
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
        $(#[$meta])*
        pub struct $name { $($(#[doc = $doc])* pub $field: $ty,)* }

        impl $crate::layout::Layout for $name {
            const LAYOUT: u64 = {
                let hash = $crate::layout::named(stringify!($name));
                $(
                    let hash = $crate::layout::with_name(hash, stringify!($field));
                    let hash = $crate::layout::with_number(hash, <$ty as $crate::layout::Layout>::LAYOUT);
                    let hash = $crate::layout::with_number(hash, std::mem::offset_of!($name, $field) as u64);
                )*
                hash
            };
            const SHAPE: $crate::layout::Shape = $crate::layout::Shape::Struct(stringify!($name), &[$(
                $crate::layout::Field {
                    name: stringify!($field),
                    doc: concat!($($doc, "\n",)*),
                    shape: <$ty as $crate::layout::Layout>::SHAPE,
                },
            )*]);

            fn walk(&self, sink: &mut impl $crate::layout::Sink) {
                $($crate::layout::Layout::walk(&self.$field, sink);)*
            }

            fn fill(&mut self, numbers: &mut impl $crate::layout::Numbers) -> Option<()> {
                $($crate::layout::Layout::fill(&mut self.$field, numbers)?;)*
                Some(())
            }
        }
    };
}
pub(crate) use shared_struct;

#[cfg(test)]
mod tests {
    use super::{Field, Layout, Numbers, Shape, Sink};

    mod one {
        use iceoryx2::prelude::ZeroCopySend;

        crate::layout::shared_struct! {
            /// A pair.
            pub struct Pair {
                /// Where, m.
                pub position: f64,
                pub speed: f64,
            }
        }
    }
    mod swapped {
        use iceoryx2::prelude::ZeroCopySend;

        crate::layout::shared_struct! {
            /// A pair with the fields in the other order: equal size and alignment.
            pub struct Pair { pub speed: f64, pub position: f64, }
        }
    }

    #[test]
    fn swapped_fields_of_equal_size_differ() {
        assert_eq!(size_of::<one::Pair>(), size_of::<swapped::Pair>());
        assert_ne!(one::Pair::LAYOUT, swapped::Pair::LAYOUT);
        assert_ne!(<[f64; 4]>::LAYOUT, <[f64; 5]>::LAYOUT);
    }

    #[test]
    fn fields_and_values_come_in_order() {
        struct Bytes(Vec<u8>);
        impl Sink for Bytes {
            fn number<const N: usize>(&mut self, bytes: [u8; N]) {
                self.0.extend(bytes);
            }
        }
        const NUMBER: Shape = Shape::Number("f64");
        const FIELDS: [Field; 2] = [
            Field { name: "position", doc: " Where, m.\n", shape: NUMBER },
            Field { name: "speed", doc: "", shape: NUMBER },
        ];
        assert_eq!(one::Pair::SHAPE, Shape::Struct("Pair", &FIELDS));
        assert_eq!(<[u32; 3]>::SHAPE, Shape::Array(&Shape::Number("u32"), 3));
        let mut bytes = Bytes(Vec::new());
        [one::Pair { position: 1.0, speed: 2.0 }].walk(&mut bytes);
        assert_eq!(bytes.0, [1.0f64.to_le_bytes(), 2.0f64.to_le_bytes()].concat());

        struct Given(Vec<u8>);
        impl Numbers for Given {
            fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
                (self.0.len() >= N).then(|| self.0.drain(..N).collect::<Vec<_>>().try_into().unwrap())
            }
        }
        let mut pairs = [one::Pair::default(); 1];
        assert_eq!(pairs.fill(&mut Given(bytes.0.clone())), Some(()));
        assert_eq!(pairs, [one::Pair { position: 1.0, speed: 2.0 }]);
        assert_eq!(pairs.fill(&mut Given(bytes.0[..15].to_vec())), None);
    }
}
