//! Arbitrary JSON as what a plug-in says of itself: what is accepted keeps the rules.
//!
//! From the root of the repository; the other targets for plug-ins are run in the same way:
//!
//! ```sh
//! cargo +nightly fuzz run -s none --no-default-features descriptor -- -max_total_time=300
//! ```

#![no_main]

use appell_fuzz::{check_descriptor, check_fault};
use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use serde_json::{Value, json};

#[derive(Arbitrary, Debug)]
enum Said<'a> {
    Text(&'a [u8]),
    Fields {
        inputs: Vec<Port<'a>>,
        outputs: Vec<Port<'a>>,
        parameters: Vec<(Port<'a>, f64)>,
        /// So many more inputs, to come near the most that there may be.
        more: u16,
    },
}

#[derive(Arbitrary, Debug)]
struct Port<'a> {
    name: Name<'a>,
    unit: &'a str,
    min: Option<f64>,
    max: Option<f64>,
}

/// Names out of few come twice sometimes.
#[derive(Arbitrary, Debug)]
enum Name<'a> {
    Known(u8),
    Free(&'a str),
}

impl Name<'_> {
    fn text(&self) -> String {
        match self {
            Name::Known(number) => format!("signal.{number}"),
            Name::Free(text) => (*text).to_owned(),
        }
    }
}

impl Port<'_> {
    fn input(&self) -> Value {
        json!({ "name": self.name.text(), "unit": self.unit })
    }

    /// Numbers that JSON lacks become null, which is none.
    fn output(&self) -> Value {
        json!({ "name": self.name.text(), "unit": self.unit, "min": self.min, "max": self.max })
    }

    fn parameter(&self, default: f64) -> Value {
        let mut value = self.output();
        value["default"] = json!(default);
        value
    }
}

fuzz_target!(|said: Said<'_>| {
    let value = match said {
        Said::Text(bytes) => match serde_json::from_slice(bytes) {
            Ok(value) => value,
            Err(_) => return,
        },
        Said::Fields {
            inputs,
            outputs,
            parameters,
            more,
        } => {
            let more = (0..more % 2048).map(|k| json!({ "name": format!("more-{k}"), "unit": "" }));
            let inputs: Vec<Value> = inputs.iter().map(Port::input).chain(more).collect();
            let outputs: Vec<Value> = outputs.iter().map(Port::output).collect();
            let parameters: Vec<Value> = parameters
                .iter()
                .map(|(port, default)| port.parameter(*default))
                .collect();
            json!({
                "protocol": 1,
                "name": "fuzz",
                "inputs": inputs,
                "outputs": outputs,
                "parameters": parameters,
            })
        }
    };
    match appell_plugin::fuzz::descriptor(value) {
        Ok(descriptor) => check_descriptor(&descriptor),
        Err(fault) => check_fault(&fault),
    }
});
