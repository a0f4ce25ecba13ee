//! ident-proc
