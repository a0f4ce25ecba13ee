//! sensor-proc
