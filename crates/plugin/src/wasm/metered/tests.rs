//! Rewritten modules against what wasmtime does to those that are not: the same fuel is left after each call, the
//! same calls have too little, and the same bits come out.

use std::process::Command;
use std::sync::OnceLock;

use wasmtime::{Config, Engine, Instance, Linker, Module, Store, Val};

use super::*;

/// Something of all that clang makes: loops, branches, tables, recursion, bulks, vectors, growth.
const SOURCE: &str = r#"
#include <wasm_simd128.h>
typedef unsigned long long u64;
typedef unsigned u32;
extern double sin(double), atan2(double, double);
static unsigned char room[1 << 16];
static int twice(int x) { return 2 * x; }
static int less(int x) { return x - 1; }
static int (*const table[])(int) = { twice, less, twice };
static u64 of_double(double x) { u64 bits; __builtin_memcpy(&bits, &x, 8); return bits; }
static double double_of(u64 bits) { double x; __builtin_memcpy(&x, &bits, 8); return x; }
static u64 of_float(float x) { u32 bits; __builtin_memcpy(&bits, &x, 4); return bits; }

__attribute__((noinline)) static int deep(int n) { return n < 1 ? 0 : 1 + deep(n - 1) + deep(n - 3); }

u64 work(u32 n, u64 seed)
{
    double sum = 0.5;
    for (u32 k = 0; k < n; k++) {
        switch ((k + seed) % 7) {
        case 0: sum += sin(sum + k); break;
        case 1: sum *= 1.25; if (sum > 8) sum -= 7.5; break;
        case 2: sum = atan2(sum, 1 + k); break;
        case 3: sum += table[(k + seed) % 3](k); break;
        case 4: continue;
        case 5: sum += deep(k % 6); break;
        default: if (sum < -100) return of_double(sum); sum = __builtin_sqrt(sum * sum + 1);
        }
        while (sum > 1000) sum /= 3;
    }
    return of_double(sum);
}

u64 bulk(u32 n, u64 seed)
{
    __builtin_memset(room, (int)seed, n);
    __builtin_memcpy(room + 4096, room, n % 4096);
    __builtin_memset(room + 8192, 3, 96);
    __builtin_memset(room + 9000, 5, 700);
    u64 sum = 0;
    for (u32 k = 0; k < 10000; k += 997) sum += room[k];
    return sum;
}

u64 grow(u32 n, u64 seed)
{
    (void)seed;
    return (u64)__builtin_wasm_memory_grow(0, n) << 32 | __builtin_wasm_memory_size(0);
}

u64 nan(u32 n, u64 seed)
{
    double infinite = 1e308 * 10 * (double)(seed % 2 + 1), x = double_of(0xfff4000000000001ull + seed), y = double_of(0x7ff8000000000000ull + seed);
    float z = (float)(infinite * 0), w = (float)x;
    v128_t a = wasm_f64x2_make(x, infinite), b = wasm_f64x2_make(y, -infinite);
    v128_t c = wasm_f32x4_make(z, (float)infinite, w, 1), d = wasm_f32x4_make(w, -(float)infinite, 2, 3), e;
    switch (n) {
    case 0: return of_double(infinite - infinite);
    case 1: return of_double(infinite * (seed * 0.0));
    case 2: return of_double(-x + y);
    case 3: return of_double(__builtin_sqrt(-infinite));
    case 4: return of_double(__builtin_floor(x) + 0);
    case 5: return of_double(__builtin_wasm_min_f64(x, y));
    case 6: return of_float(w * 2);
    case 7: return of_float(z / z);
    case 8: return of_double((double)(w - z));
    case 9: return of_float((float)(y / x));
    // Of these the bits pass as they are.
    case 10: return of_double(-x);
    case 11: return of_double(__builtin_copysign(x, -1));
    case 12: e = wasm_f64x2_add(a, b); break;
    case 13: e = wasm_f64x2_mul(a, wasm_f64x2_splat(0)); break;
    case 14: e = wasm_f32x4_sub(c, d); break;
    case 15: e = wasm_f32x4_sqrt(d); break;
    case 16: e = wasm_f64x2_max(a, b); break;
    case 17: e = wasm_f64x2_promote_low_f32x4(c); break;
    case 18: e = wasm_f32x4_demote_f64x2_zero(a); break;
    default: e = wasm_f32x4_nearest(c); break;
    }
    return wasm_u64x2_extract_lane(e, 0) * 31 + wasm_u64x2_extract_lane(e, 1);
}

u64 wrong(u32 n, u64 seed)
{
    volatile u32 zero = 0;
    if (n == 0) __builtin_trap();
    if (n == 1) return seed / zero;
    return *(volatile u64 *)(0xfffffff0u);
}
"#;

/// The module, compiled once for all tests.
fn compiled() -> &'static [u8] {
    static MODULE: OnceLock<Vec<u8>> = OnceLock::new();
    MODULE.get_or_init(compile)
}

fn compile() -> Vec<u8> {
    let folder = std::env::temp_dir().join(format!("appell-metered-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let [source, module] = ["c", "wasm"].map(|end| folder.join(format!("metered.{end}")));
    std::fs::write(&source, SOURCE).expect("a file");
    let status = Command::new("clang")
        .args([
            "--target=wasm32",
            "-mbulk-memory",
            "-msimd128",
            "-mmutable-globals",
        ])
        .args(["-nostdlib", "-ffreestanding", "-fno-builtin-memset", "-O1"])
        .args(["-Wl,--no-entry,--export-dynamic,--allow-undefined"])
        .args(["-fvisibility=default", "-o"])
        .args([&module, &source])
        .status();
    assert!(status.expect("clang compiles the tests").success());
    let bytes = std::fs::read(&module).expect("a module");
    std::fs::remove_dir_all(&folder).expect("a folder");
    bytes
}

/// A module with what counts its fuel: wasmtime, or itself.
struct Side {
    store: Store<()>,
    instance: Instance,
    counts: bool,
}

impl Side {
    fn new(bytes: &[u8], counts: bool) -> Side {
        let mut config = Config::new();
        config
            .consume_fuel(!counts)
            .cranelift_nan_canonicalization(!counts);
        let engine = Engine::new(&config).expect("an engine");
        let module = Module::new(&engine, bytes).expect("a module");
        let mut store = Store::new(&engine, ());
        if !counts {
            store.set_fuel(1 << 30).expect("fuel");
        }
        let mut linker = Linker::new(&engine);
        for &(name, function) in OF_ONE {
            let of = move |x: f64| function(x);
            linker.func_wrap("env", name, of).expect("a function");
        }
        for &(name, function) in OF_TWO {
            let of = move |x: f64, y: f64| function(x, y);
            linker.func_wrap("env", name, of).expect("a function");
        }
        let instance = linker.instantiate(&mut store, &module);
        Side {
            instance: instance.expect("an instance"),
            store,
            counts,
        }
    }

    /// What a call gives, and the fuel that is left; none where it trapped.
    fn call(&mut self, name: &str, n: i32, seed: i64, fuel: u64) -> Option<(i64, u64)> {
        let function = self
            .instance
            .get_typed_func::<(i32, i64), i64>(&mut self.store, name)
            .expect("a function");
        let tank = self.instance.get_global(&mut self.store, FUEL);
        match &tank {
            Some(tank) => tank.set(&mut self.store, Val::I64(fuel as i64)),
            None => self.store.set_fuel(fuel),
        }
        .expect("fuel");
        let given = function.call(&mut self.store, (n, seed)).ok()?;
        let left = match &tank {
            Some(tank) => tank.get(&mut self.store).unwrap_i64() as u64,
            None => self.store.get_fuel().expect("fuel"),
        };
        assert_eq!(tank.is_some(), self.counts);
        Some((given, left))
    }
}

fn sides() -> (Side, Side) {
    let bytes = compiled();
    let rewritten = metered(bytes, 16, 1 << 30).expect("it is rewritten");
    (Side::new(bytes, false), Side::new(&rewritten.bytes, true))
}

#[test]
fn peer_fuel_and_bits_are_those_of_wasmtime() {
    let (mut peer, mut own) = sides();
    for seed in 0..5 {
        for n in 0..60 {
            for name in ["work", "bulk", "nan"] {
                let [a, b] = [&mut peer, &mut own].map(|side| side.call(name, n, seed, 1 << 30));
                assert!(
                    a.is_some_and(|(_, left)| left < 1 << 30),
                    "{name} {n} {seed}"
                );
                assert_eq!(a, b, "{name} {n} {seed}");
            }
        }
    }
    let [a, b] = [&mut peer, &mut own].map(|side| side.call("bulk", 60_000, 1, 1 << 30));
    assert_eq!(a, b);
    for n in [1, 3] {
        let [a, b] = [&mut peer, &mut own].map(|side| side.call("grow", n, 0, 1 << 30));
        assert_eq!(a, b, "{n} pages");
    }
    for n in 0..3 {
        let [a, b] = [&mut peer, &mut own].map(|side| side.call("wrong", n, 9, 1 << 30));
        assert_eq!([a, b], [None, None], "{n}");
    }
}

#[test]
fn invariant_what_is_no_number_has_one_pattern_of_bits() {
    let (mut peer, mut own) = sides();
    for n in 0..10 {
        let (bits, _) = own.call("nan", n, 3, 1 << 30).expect("it returns");
        let same = [0x7ff8_0000_0000_0000, 0x7fc0_0000];
        assert!(same.contains(&bits), "{n}: {bits:x}");
        assert_eq!(
            peer.call("nan", n, 3, 1 << 30).map(|(bits, _)| bits),
            Some(bits)
        );
    }
}

#[test]
fn peer_the_same_calls_have_too_little_fuel() {
    let (mut peer, mut own) = sides();
    for (name, n) in [("work", 9), ("bulk", 300)] {
        let whole = 1 << 20;
        let (_, left) = peer.call(name, n, 2, whole).expect("it returns");
        let used = whole - left;
        assert!((10..20_000).contains(&used), "{name} uses {used}");
        let mut too_little = 0;
        for fuel in 1..used + 3 {
            let [a, b] = [&mut peer, &mut own].map(|side| side.call(name, n, 2, fuel));
            // What is left is below zero, which wasmtime does not tell.
            assert_eq!(
                a.map(|(given, _)| given),
                b.map(|(given, _)| given),
                "{name}, fuel {fuel}"
            );
            too_little += u64::from(a.is_none());
        }
        assert!(too_little > used / 2, "{name}: {too_little} of {used}");
    }
}

#[test]
fn refusal_of_what_has_no_room_or_is_no_module() {
    let bytes = compiled();
    let (_, mut own) = sides();
    // 16 MiB are 256 pages.
    assert_eq!(own.call("grow", 300, 0, 1 << 30), None);
    let tank = own
        .instance
        .get_global(&mut own.store, FUEL)
        .expect("it is exported");
    assert_eq!(tank.get(&mut own.store).unwrap_i64(), OUT_OF_MEMORY);
    let refused = metered(bytes, 0, 1).err().expect("it has memory at first");
    assert!(refused.problem.contains("more memory"), "{refused}");
    let refused = metered(&bytes[..bytes.len() - 3], 16, 1)
        .err()
        .expect("it is cut off");
    assert!(refused.problem.contains("cannot be compiled"), "{refused}");
    let mut other = bytes.to_vec();
    let place = other
        .windows(5)
        .position(|one| one == b"atan2")
        .expect("an import");
    other[place] = b'A';
    let refused = metered(&other, 16, 1)
        .err()
        .expect("it imports what is not there");
    assert!(refused.problem.contains("env.Atan2"), "{refused}");
}
