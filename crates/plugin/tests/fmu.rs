//! FMUs, compiled and packed by the tests themselves.

#![cfg(unix)]
// The program that serves them is named in the environment.
#![allow(unsafe_code)]

use std::collections::BTreeMap;
use std::f64::consts::LN_2;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Once;

use appell_plugin::{Fault, Limits, Plugin, conformance};
use serde_json::json;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// An FMU to be made.
#[derive(Clone, Copy)]
struct Made<'a> {
    version: u32,
    /// Names that are defined when it is compiled.
    defined: &'a [&'a str],
    /// A part of the description, and what stands there instead.
    instead: (&'a str, &'a str),
    /// Where the binary lies, if not where this platform looks for it.
    platform: Option<&'a str>,
}

const TWO: Made<'static> = Made {
    version: 2,
    defined: &[],
    instead: ("", ""),
    platform: None,
};
const THREE: Made<'static> = Made { version: 3, ..TWO };

const DESCRIPTION_TWO: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Lag" guid="{lag}" version="1.2" description="A lag.">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
  <TypeDefinitions>
    <SimpleType name="Time"><Real unit="s" min="0.001" max="100"/></SimpleType>
  </TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input"><Real start="0" unit="m/s"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="2" causality="output"><Real unit="m/s" min="-50" max="50"/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed" description="How slow."><Real start="1" declaredType="Time"/></ScalarVariable>
    <ScalarVariable name="k" valueReference="4" causality="parameter" variability="fixed"><Real start="1"/></ScalarVariable>
    <ScalarVariable name="start" valueReference="6" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
</fmiModelDescription>
"#;

const DESCRIPTION_THREE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Lag" instantiationToken="{lag}" version="1.2" description="A lag.">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUState="true" canSerializeFMUState="true"/>
  <TypeDefinitions>
    <Float64Type name="Time" unit="s" min="0.001" max="100"/>
  </TypeDefinitions>
  <ModelVariables>
    <Float64 name="u" valueReference="1" causality="input" start="0" unit="m/s"/>
    <Float64 name="y" valueReference="2" causality="output" unit="m/s" min="-50" max="50"/>
    <Float64 name="T" valueReference="3" causality="parameter" variability="fixed" start="1" declaredType="Time" description="How slow."/>
    <Float64 name="k" valueReference="4" causality="parameter" variability="fixed" start="1"/>
    <Float64 name="start" valueReference="6" causality="output"/>
  </ModelVariables>
</fmiModelDescription>
"#;

/// A folder of one test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("fmu")
        .join(name);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

impl Made<'_> {
    fn description(&self) -> String {
        let whole = match self.version {
            2 => DESCRIPTION_TWO,
            _ => DESCRIPTION_THREE,
        };
        let (part, other) = self.instead;
        assert!(whole.contains(part));
        if part.is_empty() {
            return whole.to_owned();
        }
        whole.replace(part, other)
    }

    fn file(&self, name: &str) -> PathBuf {
        let folder = folder(name);
        let file = folder.join(format!("{name}.fmu"));
        let source = match self.version {
            2 => "two.c",
            _ => "three.c",
        };
        let source = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/fmu")
            .join(source);
        let library = folder.join("lag.so");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-ffp-contract=off", "-o"])
            .args([&library, &source])
            .args(self.defined.iter().map(|name| format!("-D{name}")))
            .arg("-lm")
            .status();
        assert!(compiled.expect("a C compiler, cc").success());
        let arch = std::env::consts::ARCH;
        let platform = match (self.version, std::env::consts::OS, arch) {
            (2, "linux", "x86_64") => "linux64".to_owned(),
            (2, "macos", _) => "darwin64".to_owned(),
            (_, "macos", arch) => format!("{arch}-darwin"),
            (_, system, arch) => format!("{arch}-{system}"),
        };
        let platform = self.platform.unwrap_or(&platform);
        let binary = format!("binaries/{platform}/lag{}", std::env::consts::DLL_SUFFIX);
        let bytes = std::fs::read(&library).expect("a library");
        pack(
            &file,
            &[
                ("modelDescription.xml", self.description().as_bytes()),
                (&binary, &bytes),
            ],
        );
        file
    }

    fn open(&self, name: &str) -> Result<Plugin, Fault> {
        open(&self.file(name))
    }

    /// Why it cannot be opened.
    fn refusal(&self, name: &str) -> String {
        self.open(name).expect_err("a refusal").to_string()
    }
}

fn pack(file: &Path, entries: &[(&str, &[u8])]) {
    let mut writer = ZipWriter::new(File::create(file).expect("a file"));
    for (name, bytes) in entries {
        let options = SimpleFileOptions::default();
        writer.start_file(*name, options).expect("an entry");
        writer.write_all(bytes).expect("bytes");
    }
    writer.finish().expect("an archive");
}

/// Names the program that serves.
fn prepare() {
    static SERVER: Once = Once::new();
    SERVER.call_once(|| {
        let own = std::env::current_exe().expect("a test has a file");
        let built = own
            .parent()
            .and_then(Path::parent)
            .expect("a folder of what is built");
        let server = built.join("examples/serve");
        assert!(
            server.exists(),
            "{} is not built: run `cargo test` without `--test`, or with `--examples`",
            server.display()
        );
        // SAFETY: all that reads the environment in this process does so by the standard library, which locks.
        unsafe { std::env::set_var("APPELL_EXECUTABLE", server) };
    });
}

fn open(file: &Path) -> Result<Plugin, Fault> {
    prepare();
    Plugin::open(file, Limits::default())
}

fn create(plugin: &mut Plugin, values: &[(&str, f64)]) -> u32 {
    let values: BTreeMap<String, f64> = values
        .iter()
        .map(|(name, value)| ((*name).to_owned(), *value))
        .collect();
    plugin.create(&values, &json!({})).expect("a member")
}

/// A step with the input `u`: the output `y`, and when it began.
fn step(plugin: &mut Plugin, member: u32, [t, dt, u]: [f64; 3]) -> Result<[f64; 2], Fault> {
    let mut out = [0.0; 2];
    plugin.step(member, t, dt, &[u], &mut out)?;
    Ok(out)
}

/// Why a first step fails.
fn failure(plugin: &mut Plugin, u: f64) -> String {
    let member = create(plugin, &[]);
    let failed = step(plugin, member, [0.0, 0.1, u]).expect_err("a failure");
    failed.to_string()
}

#[test]
fn known_answer_of_what_it_is() {
    let two = TWO.open("is-two").expect("an FMU");
    let descriptor = serde_json::to_value(two.descriptor()).expect("JSON");
    assert_eq!(
        descriptor,
        json!({
            "protocol": 1,
            "name": "Lag",
            "version": "1.2",
            "about": "A lag.",
            "inputs": [{ "name": "u", "unit": "m/s" }],
            "outputs": [
                { "name": "y", "unit": "m/s", "min": -50.0, "max": 50.0 },
                { "name": "start", "unit": "" },
            ],
            "parameters": [
                { "name": "T", "unit": "s", "default": 1.0, "min": 0.001, "max": 100.0, "about": "How slow." },
                { "name": "k", "unit": "", "default": 1.0, "about": "" },
            ],
        })
    );
    let three = THREE.open("is-three").expect("an FMU");
    assert_eq!(three.descriptor(), two.descriptor());
}

/// With steps of `T ln 2` the way that is left halves each time: `y_n = k (1 − 2^−n)`.
#[test]
fn closed_form_step_response() {
    for (name, made) in [("response-two", TWO), ("response-three", THREE)] {
        let mut plugin = made.open(name).expect("an FMU");
        let slow = create(&mut plugin, &[("T", 2.0), ("k", 3.0)]);
        let plain = create(&mut plugin, &[]);
        let (mut t, dt) = (7.0, 2.0 * LN_2);
        let mut left = 1.0;
        for _ in 0..20 {
            let [y, start] = step(&mut plugin, slow, [t, dt, 1.0]).expect("a step");
            left *= 0.5;
            let exact = 3.0 * (1.0 - left);
            // Each step rounds a few times in the last bit of numbers up to 3.
            assert!((y - exact).abs() < 1e-14, "{name}: {y} is not {exact}");
            assert_eq!(start, 7.0);
            t += dt;
        }
        // The other began later, and knows nothing of the first.
        let [y, start] = step(&mut plugin, plain, [t, LN_2, -8.0]).expect("a step");
        assert!((y + 4.0).abs() < 1e-14 && start == t, "{name}: {y}");
    }
}

#[test]
fn peer_both_versions_have_the_same_bits() {
    let mut plugins = [TWO, THREE].map(|made| {
        let name = format!("peer-{}", made.version);
        made.open(&name).expect("an FMU")
    });
    let members = plugins
        .each_mut()
        .map(|plugin| create(plugin, &[("T", 0.3)]));
    for k in 0..100 {
        let t = f64::from(k) * 0.01;
        let u = f64::from(k % 7) - 3.0;
        let [two, three] = [0, 1].map(|i| {
            let out = step(&mut plugins[i], members[i], [t, 0.01, u]);
            out.expect("a step").map(f64::to_bits)
        });
        assert_eq!(two, three);
    }
}

#[test]
fn invariant_it_does_what_every_plug_in_has_to() {
    prepare();
    for (name, made) in [("conforms-two", TWO), ("conforms-three", THREE)] {
        let findings = conformance(&made.file(name), &Limits::default(), 50).expect("findings");
        for finding in &findings {
            assert!(finding.result.is_ok(), "{name}: {finding:?}");
        }
        assert!(findings.len() >= 6);
    }
}

#[test]
fn invariant_a_trusted_one_is_served_by_a_child_all_the_same() {
    prepare();
    let file = Made {
        defined: &["CRASHES"],
        ..TWO
    }
    .file("trusted");
    let limits = Limits {
        is_trusted: true,
        ..Limits::default()
    };
    let mut plugin = Plugin::open(&file, limits).expect("an FMU");
    let told = failure(&mut plugin, 1.0);
    assert!(told.contains("signal: 11"), "{told}");
    assert!(!plugin.is_alive());
}

#[test]
fn invariant_a_state_is_brought_back() {
    for (name, made) in [("state-two", TWO), ("state-three", THREE)] {
        let mut plugin = made.open(name).expect("an FMU");
        let member = create(&mut plugin, &[("k", 2.0)]);
        let fresh = plugin.save(member).expect("bytes");
        let first = step(&mut plugin, member, [0.0, 0.1, 1.0]).expect("a step");
        let later = plugin.save(member).expect("bytes");
        let second = step(&mut plugin, member, [0.1, 0.1, 5.0]).expect("a step");
        // Back in time, in the same member and in another.
        plugin.restore(member, &later).expect("taken");
        assert_eq!(step(&mut plugin, member, [0.1, 0.1, 5.0]), Ok(second));
        let other = create(&mut plugin, &[("k", 2.0)]);
        plugin.restore(other, &later).expect("taken");
        assert_eq!(step(&mut plugin, other, [0.1, 0.1, 5.0]), Ok(second));
        // Back to before the first step, and so its parameters are to be set once more.
        plugin.restore(member, &fresh).expect("taken");
        assert_eq!(step(&mut plugin, member, [0.0, 0.1, 1.0]), Ok(first));
        let told = plugin.restore(member, &later[..20]).expect_err("a refusal");
        assert!(told.problem.contains("gave error (3)"), "{told}");
        // It failed, and can be begun anew.
        let told = step(&mut plugin, member, [0.1, 0.1, 1.0]).expect_err("a failure");
        assert_eq!(told.to_string(), "step: it failed before");
        plugin.restore(member, &later).expect("taken");
        assert_eq!(step(&mut plugin, member, [0.1, 0.1, 5.0]), Ok(second));
    }
}

#[test]
fn invariant_one_that_takes_over_again_begins_anew() {
    let mut plugin = TWO.open("takes-over").expect("an FMU");
    let member = create(&mut plugin, &[("k", 4.0)]);
    plugin.take_over(member, &[0.0, 0.0]).expect("taken");
    let first = step(&mut plugin, member, [1.0, LN_2, 1.0]).expect("a step");
    let told = step(&mut plugin, member, [5.0, LN_2, 1.0]).expect_err("a gap");
    assert!(
        told.to_string()
            .contains("keeps its own time, which is 1.69"),
        "{told}"
    );
    plugin.take_over(member, &[0.0, 0.0]).expect("taken");
    let again = step(&mut plugin, member, [5.0, LN_2, 1.0]).expect("a step");
    assert_eq!((first[0], again), (again[0], [again[0], 5.0]));
}

#[test]
fn invariant_nothing_is_left_behind() {
    let left = |process: u32| {
        let begin = format!("appell-fmu-{process}-");
        let all = std::fs::read_dir(std::env::temp_dir()).expect("a folder");
        let names = all.flatten().map(|entry| entry.file_name());
        names
            .filter(|name| name.to_string_lossy().starts_with(&begin))
            .count()
    };
    // Tests run side by side: this one counts in a process of its own.
    let file = TWO.file("left");
    let crashes = Made {
        defined: &["CRASHES"],
        ..TWO
    }
    .file("left-crashes");
    if std::env::var_os("APPELL_TEST_ALONE").is_none() {
        let alone = Command::new(std::env::current_exe().expect("a test has a file"))
            .args(["--exact", "invariant_nothing_is_left_behind"])
            .env("APPELL_TEST_ALONE", "1")
            .status();
        assert!(alone.expect("a process").success());
        return;
    }
    let own = std::process::id();
    let mut plugin = open(&file).expect("an FMU");
    assert_eq!(left(own), 1);
    create(&mut plugin, &[]);
    drop(plugin);
    assert_eq!(left(own), 0);
    let mut plugin = open(&crashes).expect("an FMU");
    failure(&mut plugin, 1.0);
    drop(plugin);
    assert_eq!(left(own), 0);
}

const PYTHON: &str = r#"
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Lag(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.0
        self.y = 0.0
        self.k = 2.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Real("k", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, t, dt):
        print("a lag in Python steps")
        if self.u > 1.0:
            raise ValueError("u is too large")
        self.y += dt * (self.k * self.u - self.y)
        return True
"#;

/// An FMU that pythonfmu makes of a Python class. Where that is not installed this says so, and is no test.
#[test]
fn peer_an_fmu_by_pythonfmu() {
    let name = "peer_an_fmu_by_pythonfmu";
    let python = std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into());
    if std::env::var_os("APPELL_TEST_PRELOADED").is_none() {
        let code = "import os, sysconfig as s, pythonfmu\nprint(os.path.join(s.get_config_var('LIBDIR'), s.get_config_var('INSTSONAME')))";
        let found = Command::new(&python)
            .args(["-c", code])
            .output()
            .expect("Python");
        let library = String::from_utf8_lossy(&found.stdout).trim().to_owned();
        let missing = match (found.status.success(), Path::new(&library)) {
            (false, _) => "it lacks the module pythonfmu",
            (true, library) if !library.to_string_lossy().contains(".so") => {
                "it has no shared library"
            }
            (true, library) if !library.is_file() => "its shared library is not there",
            _ => "",
        };
        if !missing.is_empty() {
            // What is printed otherwise is not shown of a test that passes.
            let told = format!(
                "{name} tests nothing with {}: {missing}\n",
                python.display()
            );
            std::io::stderr()
                .write_all(told.as_bytes())
                .expect("written");
            return;
        }
        // Such an FMU takes for granted that Python is in the process.
        let preloaded = Command::new(std::env::current_exe().expect("a test has a file"))
            .args(["--exact", name])
            .env("LD_PRELOAD", library)
            .env("APPELL_TEST_PRELOADED", "1")
            .status();
        assert!(preloaded.expect("a process").success());
        return;
    }
    let folder = folder("python");
    std::fs::write(folder.join("lag.py"), PYTHON).expect("a file");
    let made = Command::new(&python)
        .args(["-m", "pythonfmu", "build", "-f", "lag.py"])
        .current_dir(&folder)
        .status();
    assert!(made.expect("Python").success());
    let mut plugin = open(&folder.join("Lag.fmu")).expect("an FMU");
    assert_eq!(plugin.descriptor().parameters[0].default, 2.0);
    let values = BTreeMap::from([("k".to_owned(), 3.0)]);
    let member = plugin.create(&values, &json!({})).expect("a member");
    let (mut y, mut out) = (0.0, [0.0]);
    for k in 0..50 {
        let u = f64::from(k % 5) / 5.0;
        let t = f64::from(k) * 0.01;
        plugin
            .step(member, t, 0.01, &[u], &mut out)
            .expect("a step");
        // What Python computes has the same bits.
        y += 0.01 * (3.0 * u - y);
        assert_eq!(out, [y]);
    }
    let told = plugin.step(member, 0.5, 0.01, &[2.0], &mut out);
    let told = told.expect_err("a failure").to_string();
    assert!(told.contains("u is too large"), "{told}");
}

#[test]
fn refusal_of_archives() {
    let folder = folder("archives");
    let file = folder.join("some.fmu");
    let refusal = |entries: &[(&str, &[u8])]| {
        pack(&file, entries);
        let fault = open(&file).expect_err("a refusal");
        assert!(
            fault.hint.starts_with("it must be an FMU"),
            "{}",
            fault.hint
        );
        fault.to_string()
    };
    assert_eq!(
        refusal(&[("../../evil", b"!")]),
        "describe: file: \"../../evil\": must stay in the archive: neither \"..\" nor a root may be in its path"
    );
    assert_eq!(
        refusal(&[("readme.txt", b"!")]),
        "describe: file: must have a file modelDescription.xml, has none"
    );
    assert_eq!(
        refusal(&[("bomb", &vec![0; (1 << 28) + 1])]),
        "describe: file: must unpack to at most 256 MiB, is larger"
    );
}

#[test]
fn refusal_of_descriptions() {
    let two = |part, other| Made {
        instead: (part, other),
        ..TWO
    };
    assert_eq!(
        two("fmiVersion=\"2.0\"", "fmiVersion=\"4.0\"").refusal("future"),
        "describe: modelDescription.xml.fmiVersion: must be 2.x or 3.x, the versions of FMI that are known, got \"4.0\""
    );
    assert_eq!(
        two("<CoSimulation ", "<ModelExchange ").refusal("exchange"),
        "describe: modelDescription.xml.CoSimulation: must be there, the FMU has ModelExchange only"
    );
    let elsewhere = Made {
        platform: Some("vax-vms"),
        ..THREE
    };
    let told = elsewhere.refusal("elsewhere");
    assert!(
        told.starts_with("describe: file: must have a binary for this platform, binaries/")
            && told.ends_with(", has those for vax-vms"),
        "{told}"
    );
    let lacking = Made {
        defined: &["LACKS_STEP"],
        ..TWO
    };
    assert_eq!(
        lacking.refusal("lacking"),
        "describe: start: must have the function fmi2DoStep, has none"
    );
    let needy = Made {
        defined: &["NEEDS_ANOTHER"],
        ..TWO
    };
    let told = needy.refusal("needy");
    assert!(
        told.starts_with("describe: start: cannot be loaded: binaries/")
            && told.contains("other_function"),
        "{told}"
    );
}

#[test]
fn refusal_of_members() {
    for (made, expected) in [
        (TWO, "create: made no instance: the token is wrong: %s %g"),
        (THREE, "create: made no instance: the token is wrong"),
    ] {
        let made = Made {
            instead: ("\"{lag}\"", "\"{lug}\""),
            ..made
        };
        let mut plugin = made
            .open(&format!("token-{}", made.version))
            .expect("an FMU");
        let fault = plugin.create(&BTreeMap::new(), &json!({}));
        assert_eq!(fault.expect_err("a refusal").to_string(), expected);
        let made = Made {
            defined: &["EXITS"],
            instead: ("", ""),
            ..made
        };
        let mut plugin = made
            .open(&format!("exits-{}", made.version))
            .expect("an FMU");
        let fault = plugin.create(&BTreeMap::new(), &json!({}));
        assert_eq!(
            fault.expect_err("a refusal").to_string(),
            "create: ended without an answer (exit status: 3)"
        );
    }
    let single = Made {
        defined: &["SINGLE"],
        instead: (
            "modelIdentifier",
            "canBeInstantiatedOnlyOncePerProcess=\"true\" modelIdentifier",
        ),
        ..TWO
    };
    let mut plugin = single.open("single").expect("an FMU");
    let first = create(&mut plugin, &[]);
    let fault = plugin.create(&BTreeMap::new(), &json!({}));
    assert_eq!(
        fault.expect_err("a refusal").to_string(),
        "create: it can be instantiated only once in a process (canBeInstantiatedOnlyOncePerProcess), and has a member already"
    );
    plugin.destroy(first);
    create(&mut plugin, &[]);
}

#[test]
fn refusal_of_what_steps_give() {
    for (status, name) in [("2", "discard"), ("3", "error"), ("4", "fatal")] {
        for made in [TWO, THREE] {
            let version = made.version;
            let defined = format!("STATUS={status}");
            let made = Made {
                defined: &[&defined],
                ..made
            };
            let mut plugin = made
                .open(&format!("status-{status}-{version}"))
                .expect("an FMU");
            let other = create(&mut plugin, &[]);
            let told = failure(&mut plugin, 2.0);
            let function = format!("fmi{version}DoStep");
            assert_eq!(
                told,
                format!("step: {function} gave {name} ({status}): u is too large")
            );
            // What is fatal is so for all instances.
            let goes_on = step(&mut plugin, other, [0.0, 0.1, 1.0]).is_ok();
            assert_eq!(goes_on, status != "4");
            assert!(plugin.is_alive());
        }
    }
    let warns = Made {
        defined: &["STATUS=1"],
        ..TWO
    };
    let mut plugin = warns.open("warns").expect("an FMU");
    let member = create(&mut plugin, &[]);
    step(&mut plugin, member, [0.0, 0.1, 2.0]).expect("a step");
    for (defined, expected) in [
        ("ENDS", "step: the FMU asked to end the simulation at 0.1 s"),
        (
            "EARLY",
            "step: the FMU stopped at 0.05 s, within a step from 0 s to 0.1 s, which it was not allowed to",
        ),
    ] {
        let made = Made {
            defined: &[defined],
            ..THREE
        };
        let mut plugin = made.open(defined).expect("an FMU");
        assert_eq!(failure(&mut plugin, 1.0), expected);
    }
    // Its own limits hold.
    let mut plugin = TWO.open("limits").expect("an FMU");
    let member = create(&mut plugin, &[]);
    let told = step(&mut plugin, member, [0.0, 100.0, 60.0]).expect_err("a refusal");
    assert_eq!(
        told.to_string(),
        "outputs.y: must be at most 50 m/s, got 60"
    );
}

#[test]
fn refusal_of_steps_that_it_cannot_make() {
    let fixed = Made {
        instead: ("canHandleVariableCommunicationStepSize=\"true\"", ""),
        ..TWO
    };
    let mut plugin = fixed.open("fixed").expect("an FMU");
    let member = create(&mut plugin, &[]);
    let mut told = |of: [f64; 3]| step(&mut plugin, member, of).map_err(|fault| fault.to_string());
    let short = told([0.0, 0.0, 1.0]);
    assert_eq!(
        short,
        Err("step: needs steps longer than 0 s, got 0".to_owned())
    );
    assert!(told([0.0, 0.1, 1.0]).is_ok());
    let other = told([0.1, 0.2, 1.0]);
    assert_eq!(
        other,
        Err("step: needs steps of one length (canHandleVariableCommunicationStepSize is not true): began with 0.1 s, got 0.2 s".to_owned())
    );
    // Such a refusal does no harm.
    assert!(told([0.1, 0.1, 1.0]).is_ok());
    let mut plugin = TWO.open("free").expect("an FMU");
    let member = create(&mut plugin, &[]);
    step(&mut plugin, member, [0.0, 0.1, 1.0]).expect("a step");
    step(&mut plugin, member, [0.1, 0.2, 1.0]).expect("a step");
}

#[test]
fn refusal_to_save_what_offers_no_state() {
    for made in [TWO, THREE] {
        let (part, other) = match made.version {
            2 => ("canSerializeFMUstate=\"true\"", ""),
            _ => ("canGetAndSetFMUState=\"true\"", ""),
        };
        let made = Made {
            instead: (part, other),
            ..made
        };
        let mut plugin = made
            .open(&format!("stateless-{}", made.version))
            .expect("an FMU");
        let member = create(&mut plugin, &[]);
        let fault = plugin.save(member).expect_err("a refusal").to_string();
        assert!(
            fault.starts_with("save: cannot be saved: the FMU does not offer its state"),
            "{fault}"
        );
        step(&mut plugin, member, [0.0, 0.1, 1.0]).expect("a step");
    }
}
