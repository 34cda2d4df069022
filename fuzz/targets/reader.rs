#![no_main]
//! Every reader of a mesh: `PLIANT_READER` names its target in `pliant::io::FORMATS`, or `any`.
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

static READER: LazyLock<String> = LazyLock::new(|| std::env::var("PLIANT_READER").unwrap_or_else(|_| "any".to_owned()));

fuzz_target!(init: pliant_fuzz::begin(&READER), |bytes: &[u8]| pliant_fuzz::run(&READER, bytes));
