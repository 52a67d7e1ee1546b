#!/usr/bin/env bash
# Builds the plug-ins of this folder: modules of WebAssembly and libraries for this machine.
#
# It needs Rust with the target wasm32-unknown-unknown, a C compiler, and clang with lld.
set -euo pipefail
cd "$(dirname "$0")"
for name in homing pursuit; do
    cargo build --release --quiet --manifest-path "$name/Cargo.toml"
    cargo build --release --quiet --manifest-path "$name/Cargo.toml" --target wasm32-unknown-unknown
done
for name in gate eight wheel_legged; do
    cc -shared -fPIC -O2 -ffp-contract=off -I ../../sdk/c -o "$name.so" "$name.c" -lm
done
for name in eight wheel_legged; do
    clang --target=wasm32 -mbulk-memory -nostdlib -Wl,--no-entry,--export-dynamic -O2 -ffp-contract=off \
        -I ../../sdk/c -o "$name.wasm" "$name.c"
done
