//! Arbitrary text as a scenario: reading must refuse or accept it, and never panic or hang.
//!
//! Five minutes, with the shipped scenarios as seeds, from the root of the repository:
//!
//! ```sh
//! cargo install cargo-fuzz --locked
//! mkdir -p fuzz/corpus/scenario && cp scenarios/*.toml fuzz/corpus/scenario/
//! cargo +nightly fuzz run scenario --sanitizer none -- -max_total_time=300 -max_len=4096 -timeout=10
//! ```
//!
//! A text that fails is kept in `fuzz/artifacts/scenario/`; make it a row of
//! `crates/cli/tests/broken_files.rs`. Without a nightly compiler set `RUSTC_BOOTSTRAP=1` and leave
//! out `+nightly`.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Err(diagnostics) = appell_sim::scenario::load_text(text, Path::new("fuzz.toml"), &[]) {
        assert!(!diagnostics.0.is_empty(), "a refusal says why");
        assert!(!diagnostics.to_string().is_empty(), "a refusal has words");
    }
});
