//! quick
use appell_sim::{record::*, run::*, scenario};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let t0 = std::time::Instant::now();
    let set: Vec<(String, String)> = args[2..]
        .iter()
        .filter_map(|a| a.split_once('='))
        .map(|(a, b)| (a.into(), b.into()))
        .collect();
    let loaded = match scenario::load(std::path::Path::new(&args[1]), &set) {
        Ok(l) => l,
        Err(e) => {
            println!("{e}");
            return;
        }
    };
    println!("load {:?}", t0.elapsed());
    let mut run = match Run::new(&loaded, 0) {
        Ok(r) => r,
        Err(e) => {
            println!("{e}");
            return;
        }
    };
    println!("build {:?}", t0.elapsed());
    let mut memory = Memory::new();
    let t1 = std::time::Instant::now();
    let summary = run.execute(&mut memory, &mut |_| {}).unwrap();
    println!("run {:?} for {} s", t1.elapsed(), summary.duration);
    println!("{}", serde_json::to_string_pretty(&summary).unwrap());
}
