#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hydraxis_fuzz::sdo(data));
