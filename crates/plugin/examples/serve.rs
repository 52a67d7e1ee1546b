//! Serves a library or an FMU as `appell plugin serve FILE` does, for the tests of this crate.

fn main() -> std::io::Result<()> {
    let file = std::env::args_os().next_back().expect("a file");
    appell_plugin::serve(std::path::Path::new(&file))
}
