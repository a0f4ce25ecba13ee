//! control-proc
