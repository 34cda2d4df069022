#![no_main]
use libfuzzer_sys::fuzz_target;
fuzz_target!(init: pliant_fuzz::begin("opensim"), |bytes: &[u8]| pliant_fuzz::run("opensim", bytes));
