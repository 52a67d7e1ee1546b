//! `appell uneven`: the pose error under forces of uneven ground, wave by wave.

use appell_model::pose_error::excitation::Waveform;
use appell_sim::report::{self, Press};
use appell_sim::uneven::{self, Alike, COLUMNS, Order, PHASES, Scan, Series, Study, WAVES};
use serde_json::{Map, Value, json};

use crate::arguments::UnevenOptions;
use crate::{exit, terminal};

/// Samples of a run that is drawn: 20 ms apart at 12 s.
const SAMPLES: usize = 600;

/// Deviations of each wave's run, and the orders found elsewhere.
struct Findings {
    study: Study,
    runs: [Series; 4],
    deviations: [[f64; 6]; 3],
    scans: [Scan; 2],
    variants: Vec<(&'static str, [Order; 6])>,
}

/// Compares the waves.
pub fn uneven(options: &UnevenOptions) -> u8 {
    let found = match study(options).and_then(|study| find(&study)) {
        Ok(found) => found,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    if options.json {
        terminal::print(&format!("{:#}", data(&found)));
    } else {
        terminal::print(&text(&found));
    }
    let mut figures = uneven::figures(&found.runs);
    figures["title"] = match found.study.alike {
        Alike::Amplitude => "Pose error on uneven ground: waves of equal amplitude and period",
        Alike::Effective => {
            "Pose error on uneven ground: waves of equal effective value and period"
        }
    }
    .into();
    let mut maps = uneven::maps(&found.scans);
    maps["title"] = "Which wave moves the pose error most".into();
    let drawn = Press::new().and_then(|press| {
        let mut files = Vec::new();
        for (name, svg) in [
            ("figures", press.figures(&figures)?),
            ("orders", press.orders(&maps)?),
        ] {
            files.push((format!("{name}.png"), report::png(&svg, 2.0)?));
            files.push((format!("{name}.svg"), svg.into_bytes()));
        }
        Ok(files)
    });
    match drawn {
        Ok(files) => terminal::write_folder(&options.out, &files, options.json),
        Err(error) => {
            terminal::error(&error.to_string());
            exit::INTERNAL
        }
    }
}

fn study(options: &UnevenOptions) -> Result<Study, String> {
    let within = |option: &str, value: f64, low: f64, high: f64| {
        if value >= low && value <= high {
            Ok(value)
        } else {
            Err(format!(
                "--{option}: must be in [{low}, {high}], got {value}"
            ))
        }
    };
    let duration = within("duration", options.duration, 1e-3, 1e5)?;
    let sampling = match options.sampling {
        0.0 => 0.0,
        value => within("sampling", value, 1e-4 * duration, duration)
            .map_err(|problem| format!("{problem}\n  hint: 0 is for continuous forces"))?,
    };
    let mut start = [0.0; 3];
    for (start, value) in start.iter_mut().zip(&options.start) {
        *start = within("start", *value, -1e4, 1e4)?;
    }
    Ok(Study {
        mass: within("mass", options.mass, 1e-3, 1e6)?,
        inertia: within("inertia", options.inertia, 1e-6, 1e6)?,
        lever: within("lever", options.lever, -100.0, 100.0)?,
        speed: within("speed", options.speed, -100.0, 100.0)?,
        yaw_rate: within("yaw-rate", options.yaw_rate, -100.0, 100.0)?,
        start,
        along: within("along", options.along, 0.0, 1e6)?,
        across: within("across", options.across, 0.0, 1e6)?,
        period: within("period", options.period, 1e-3 * duration, 1e3 * duration).map_err(
            |problem| {
                format!(
                    "{problem}\n  hint: between a thousand periods in a run and a thousandth of one"
                )
            },
        )?,
        phase: within("phase-deg", options.phase_deg, -3600.0, 3600.0)?.to_radians(),
        friction: within("friction", options.friction, 0.0, 1.0)?,
        sampling,
        alike: options.alike.into(),
        duration,
    })
}

fn find(study: &Study) -> Result<Findings, String> {
    let stalled = |stalled| {
        format!(
            "the pose error cannot be followed: {stalled:?}\n  hint: smaller forces or a larger mass and inertia"
        )
    };
    let run = |wave| uneven::run(study, wave, SAMPLES).map_err(stalled);
    let runs = [
        run(Waveform::None)?,
        run(WAVES[0])?,
        run(WAVES[1])?,
        run(WAVES[2])?,
    ];
    let deviations = [1, 2, 3].map(|k| uneven::deviations(&runs[k], &runs[0]));
    let crest = core::f64::consts::FRAC_PI_2;
    let effective = Study {
        alike: Alike::Effective,
        ..*study
    };
    let sawtooth = [Waveform::Sine, Waveform::Sawtooth, Waveform::Square];
    let at = |study: &Study, phase: f64, waves| {
        uneven::orders(&Study { phase, ..*study }, waves).map_err(stalled)
    };
    let variants = vec![
        (
            "effective values equal, phase 0°",
            at(&effective, 0.0, WAVES)?,
        ),
        (
            "effective values equal, phase 90°",
            at(&effective, crest, WAVES)?,
        ),
        (
            "sawtooth for the triangle, phase 0°",
            at(study, 0.0, sawtooth)?,
        ),
        (
            "sawtooth for the triangle, phase 90°",
            at(study, crest, sawtooth)?,
        ),
    ];
    Ok(Findings {
        study: *study,
        runs,
        deviations,
        scans: uneven::scans(study).map_err(stalled)?,
        variants,
    })
}

fn order(found: &Findings, column: usize) -> Order {
    Order::of([0, 1, 2].map(|wave| found.deviations[wave][column]))
}

fn data(found: &Findings) -> Value {
    let mut waves = Map::new();
    for (wave, deviations) in ["sine", "triangle", "square"].iter().zip(found.deviations) {
        let named = COLUMNS.iter().zip(deviations);
        let named: Map<String, Value> = named
            .map(|(column, deviation)| (column.name.to_owned(), deviation.into()))
            .collect();
        waves.insert((*wave).to_owned(), named.into());
    }
    let orders: Map<String, Value> = COLUMNS
        .iter()
        .enumerate()
        .map(|(k, column)| (column.name.to_owned(), json!(order(found, k))))
        .collect();
    let scans: Vec<Value> = found
        .scans
        .iter()
        .map(|scan| json!({"over": scan.name, "values": scan.values, "phases": PHASES, "orders": scan.orders}))
        .collect();
    let variants: Vec<Value> = found
        .variants
        .iter()
        .map(|(name, orders)| json!({"condition": name, "orders": orders}))
        .collect();
    json!({"study": found.study, "deviations": waves, "orders": orders, "scans": scans, "variants": variants})
}

/// An order in a few letters: what comes first, first.
fn short(order: Order) -> &'static str {
    match order {
        Order::Impulses => "sq>sin>tri",
        Order::TriangleFirst => "tri first",
        Order::SineLast => "sq>tri>sin",
        Order::Other => "other",
        Order::Equal => "equal",
    }
}

fn text(found: &Findings) -> String {
    let row = |name: &str, cells: Vec<String>| {
        let cells: String = cells.iter().map(|cell| format!(" {cell:>20}")).collect();
        format!("{name:36}{cells}\n")
    };
    let head = COLUMNS.iter().map(|c| format!("{}, {}", c.name, c.unit));
    let mut text = row(
        &format!("largest deviation within {} s", found.study.duration),
        head.collect(),
    );
    for (wave, deviations) in ["sine", "triangle", "square"].iter().zip(found.deviations) {
        let cells = deviations.iter().map(|d| terminal::number(*d));
        text.push_str(&row(wave, cells.collect()));
    }
    let orders = (0..6).map(|k| short(order(found, k)).to_owned());
    text.push_str(&row("order", orders.collect()));

    text.push_str("\nwhere the published order comes out: the triangle first, or the sine last\n");
    let published = [
        (Order::TriangleFirst, "triangle first"),
        (Order::SineLast, "sine last"),
    ];
    for (wanted, name) in published {
        let cells = (0..6).map(|k| {
            let spans = found.scans[0].spans(0, k, wanted);
            let spans: Vec<String> = spans
                .iter()
                .map(|[a, b]| {
                    if a == b {
                        format!("{a}°")
                    } else {
                        format!("{a}–{b}°")
                    }
                })
                .collect();
            if spans.is_empty() {
                "never".to_owned()
            } else {
                spans.join(",")
            }
        });
        text.push_str(&row(&format!("by phase alone: {name} at"), cells.collect()));
    }
    for scan in &found.scans {
        let cells = scan.orders.len() * PHASES;
        for (wanted, name) in published {
            let shares = (0..6).map(|k| match scan.count(k, wanted) {
                0 => "never".to_owned(),
                count => format!("{:.1} %", 100.0 * count as f64 / cells as f64),
            });
            text.push_str(&row(&format!("{}: {name}", scan.deed), shares.collect()));
        }
    }
    let above = |order: &Order| matches!(order, Order::TriangleFirst | Order::SineLast);
    let held = &found.scans[0];
    let first = (0..6).map(|k| {
        let row = held.orders.iter().position(|phases| above(&phases[0][k]));
        row.map_or("never".to_owned(), |row| format!("{} T", held.values[row]))
    });
    text.push_str(&row("held, phase 0°: either, from", first.collect()));
    for (name, orders) in &found.variants {
        let cells = orders.iter().map(|order| short(*order).to_owned());
        text.push_str(&row(name, cells.collect()));
    }
    text
}
