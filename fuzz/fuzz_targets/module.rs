//! Arbitrary modules of WebAssembly as plug-ins.
//!
//! Whatever the module: no panic, no end of the process, no more instructions than the fuel allows; what
//! comes out is finite and within the limits; and the same calls give the same outcomes, in the same words.
//!
//! Its compiler takes minutes to build:
//!
//! ```sh
//! cargo +nightly fuzz run -s none --no-default-features --features module module -- -timeout=20
//! ```

#![no_main]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use appell_fuzz::{check_descriptor, check_fault};
use appell_plugin::wire::Call;
use appell_plugin::{Fault, Limits, Plugin};
use arbitrary::{Arbitrary, Unstructured};
use libfuzzer_sys::{Corpus, fuzz_target};
use serde_json::json;
use wasm_encoder::{CodeSection, DataCountSection, DataSection, RawSection};
use wasm_smith::Config;
use wasmparser::{ExternalKind, Parser, Payload, TypeRef};

/// What modules may import.
const MATHEMATICS: &str = r#"(module
    (import "env" "sin" (func (param f64) (result f64)))
    (import "env" "log" (func (param f64) (result f64)))
    (import "env" "pow" (func (param f64 f64) (result f64)))
    (import "env" "remainder" (func (param f64 f64) (result f64))))"#;

/// Functions without which no other is called, or nothing comes out, and which arbitrary code would hardly
/// ever get right.
const FIRST: [&str; 5] = [
    "appell_abi",
    "appell_describe",
    "appell_room",
    "appell_create",
    "appell_step",
];

fn interface() -> &'static [u8] {
    static INTERFACE: OnceLock<Vec<u8>> = OnceLock::new();
    INTERFACE.get_or_init(|| wat::parse_str(include_str!("interface.wat")).expect("a module"))
}

/// A module with what the host knows only.
fn plain(u: &mut Unstructured<'_>, config: Config) -> arbitrary::Result<Vec<u8>> {
    let config = Config {
        custom_descriptors_enabled: false,
        exceptions_enabled: false,
        gc_enabled: false,
        max_memories: 1,
        memory64_enabled: false,
        // They would need the collector of garbage.
        reference_types_enabled: false,
        threads_enabled: false,
        ..config
    };
    Ok(wasm_smith::Module::new(config, u)?.to_bytes())
}

/// A module that has what the interface asks for; of its first functions, those in `kept` stay arbitrary.
fn formed(u: &mut Unstructured<'_>, kept: u8) -> arbitrary::Result<Vec<u8>> {
    let config = Config {
        allow_start_export: u.ratio(1, 8)?,
        available_imports: Some(wat::parse_str(MATHEMATICS).expect("a module")),
        disallow_traps: u.ratio(3, 4)?,
        exports: Some(interface().to_vec()),
        max_imports: 4,
        max_table_elements: 1000,
        ..Config::default()
    };
    plain(u, config).map(|module| mended(&module, kept))
}

/// The module with the bodies that the interface gives, but for those in `kept`, and its description.
fn mended(module: &[u8], kept: u8) -> Vec<u8> {
    let given = Functions::of(interface());
    let own = Functions::of(module);
    let body = |place: usize| {
        let is_this = |name: &&str| own.places.get(*name) == Some(&place);
        let name = FIRST.iter().position(|name| is_this(&name))?;
        let is_kept = kept >> name & 1 == 1;
        (!is_kept).then(|| given.bodies[given.places[FIRST[name]]])
    };
    let mut code = CodeSection::new();
    for (place, own) in own.bodies.iter().enumerate() {
        code.raw(body(place).unwrap_or(own));
    }
    let mut data = DataSection::new();
    for segment in own.data.iter().chain(&given.data) {
        data.raw(segment);
    }
    let mut made = wasm_encoder::Module::new();
    for payload in Parser::new(0).parse_all(module) {
        match payload.expect("what was made can be read") {
            Payload::CodeSectionStart { .. } => {
                made.section(&code);
                if own.data.is_empty() {
                    made.section(&data);
                }
            }
            Payload::DataCountSection { .. } => {
                let count = data.len();
                made.section(&DataCountSection { count });
            }
            Payload::DataSection(_) if own.data.is_empty() => {}
            Payload::DataSection(_) => {
                made.section(&data);
            }
            payload => {
                if let Some((id, range)) = payload.as_section() {
                    let data = &module[range];
                    made.section(&RawSection { id, data });
                }
            }
        }
    }
    made.finish()
}

/// What can be put into another module.
#[derive(Default)]
struct Functions<'a> {
    bodies: Vec<&'a [u8]>,
    /// Of exported functions, among the bodies.
    places: BTreeMap<&'a str, usize>,
    /// Segments of data.
    data: Vec<&'a [u8]>,
}

impl<'a> Functions<'a> {
    fn of(module: &'a [u8]) -> Self {
        let mut functions = Functions::default();
        let mut imported = 0;
        for payload in Parser::new(0).parse_all(module) {
            match payload.expect("what was made can be read") {
                Payload::ImportSection(imports) => {
                    let is_function = |kind: TypeRef| matches!(kind, TypeRef::Func(_));
                    for import in imports.into_imports() {
                        let import = import.expect("what was made can be read");
                        imported += usize::from(is_function(import.ty));
                    }
                }
                Payload::ExportSection(exports) => {
                    for export in exports {
                        let export = export.expect("what was made can be read");
                        let place = (export.index as usize).checked_sub(imported);
                        if let (ExternalKind::Func, Some(place)) = (export.kind, place) {
                            functions.places.insert(export.name, place);
                        }
                    }
                }
                Payload::CodeSectionEntry(body) => functions.bodies.push(body.as_bytes()),
                Payload::DataSection(segments) => {
                    for segment in segments {
                        let segment = segment.expect("what was made can be read");
                        functions.data.push(&module[segment.range]);
                    }
                }
                _ => {}
            }
        }
        functions
    }
}

/// Where modules are written to.
fn file() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let name = format!("appell-fuzz-{}.wasm", std::process::id());
        std::env::temp_dir().join(name)
    })
}

/// What a module gives, call by call.
fn outcomes(numbers: &[f64; 4]) -> Vec<String> {
    let limits = Limits {
        memory: 16,
        fuel_of_start: 100_000,
        fuel: 100_000,
        ..Limits::default()
    };
    let mut told = Vec::new();
    let mut plugin = match Plugin::open(file(), limits) {
        Ok(plugin) => plugin,
        Err(fault) => {
            check_fault(&fault);
            return vec![fault.to_string()];
        }
    };
    let descriptor = plugin.descriptor().clone();
    check_descriptor(&descriptor);
    let tell = |result: Result<String, Fault>| {
        result.unwrap_or_else(|fault| {
            check_fault(&fault);
            fault.to_string()
        })
    };
    let (read, width) = (descriptor.inputs.len(), descriptor.outputs.len());
    let input: Vec<f64> = (0..read).map(|k| numbers[k % 4]).collect();
    let mut members = Vec::new();
    for _ in 0..2 {
        let made = plugin.create(&BTreeMap::new(), &json!({ "arena": null }));
        members.extend(made.as_ref().ok());
        told.push(tell(made.map(|member| member.to_string())));
    }
    let mut step = |plugin: &mut Plugin, members: &[u32]| {
        let dt = numbers[3];
        let call = |&member| Call {
            member,
            t: numbers[2],
            dt,
            input: &input,
        };
        let calls: Vec<Call<'_>> = members.iter().map(call).collect();
        let mut output = vec![0.0; calls.len() * width];
        let stepped = plugin.step_many(&calls, &mut output);
        for values in output.chunks_exact(width).filter(|_| stepped.is_ok()) {
            for (port, value) in descriptor.outputs.iter().zip(values) {
                assert!(value.is_finite());
                assert!(port.min.is_none_or(|min| *value >= min));
                assert!(port.max.is_none_or(|max| *value <= max));
            }
        }
        let bits: Vec<u64> = output.iter().map(|value| value.to_bits()).collect();
        let stepped = stepped.map(|()| format!("{bits:?}"));
        told.push(tell(stepped.map_err(|(_, fault)| fault)));
    };
    for &member in &members {
        step(&mut plugin, &[member]);
        step(&mut plugin, &[member]);
    }
    step(&mut plugin, &members);
    let mut more = Vec::new();
    for &member in &members {
        let saved = plugin.save(member);
        if let Ok(bytes) = &saved {
            let restored = plugin.restore(member, bytes);
            more.push(tell(restored.map(|()| "restored".into())));
        }
        more.push(tell(saved.map(|bytes| appell_plugin::digest(&bytes))));
        let taken = plugin.take_over(member, &vec![0.5; width]);
        more.push(tell(taken.map(|()| "taken over".into())));
    }
    step(&mut plugin, &members);
    for member in members {
        plugin.destroy(member);
        let mut output = vec![0.0; width];
        plugin
            .step(member, 0.0, 0.1, &input, &mut output)
            .expect_err("what was ended cannot be stepped");
    }
    told.extend(more);
    told
}

fn module(bytes: &[u8]) -> arbitrary::Result<(Vec<u8>, [f64; 4])> {
    let mut u = Unstructured::new(bytes);
    let way: u8 = u.arbitrary()?;
    // One in four of the first functions stays arbitrary, but three in four steps do.
    let kept = (u8::arbitrary(&mut u)? & u8::arbitrary(&mut u)?) ^ 0b1_0000;
    let numbers = u.arbitrary()?;
    let module = match way % 16 {
        0 => [b"\0asm\x01\0\0\0", u.take_rest()].concat(),
        1 => {
            let config = Config::arbitrary(&mut u)?;
            plain(&mut u, config)?
        }
        _ => formed(&mut u, kept)?,
    };
    Ok((module, numbers))
}

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Ok((module, numbers)) = module(bytes) else {
        return Corpus::Reject;
    };
    std::fs::write(file(), module).expect("it can be written");
    let first = outcomes(&numbers);
    assert_eq!(first, outcomes(&numbers));
    Corpus::Keep
});
