//! Embeds the page anew when it was built anew. Nothing is fetched or built here: `cargo xtask studio` does.

fn main() {
    println!("cargo:rerun-if-changed=page/dist");
}
