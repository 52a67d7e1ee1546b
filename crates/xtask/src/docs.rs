//! The book's reference pages, made from the types of the scenario file.

use std::fmt::Write;
use std::path::Path;

use serde_json::Value;

/// Writes `reference/scenario.md` and `reference/robot.md`.
pub fn write(root: &Path) -> std::io::Result<()> {
    for (name, text) in pages() {
        let folder = root.join("docs/book/src/reference");
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join(name), text)?;
    }
    Ok(())
}

/// The pages by file name.
pub fn pages() -> [(&'static str, String); 2] {
    let page = |title: &str, intro: &str, robot: bool| {
        let schema: Value =
            serde_json::from_str(&appell_sim::scenario::schema(robot)).expect("a schema is JSON");
        format!("# {title}\n\n{intro}\n\n{}", tables(&schema))
    };
    [
        (
            "scenario.md",
            page(
                "Scenario files",
                "Made from the types that read the file. Numbers are SI unless the key says otherwise; a key with a default may be left out.",
                false,
            ),
        ),
        (
            "robot.md",
            page(
                "Robot files",
                "What a robot file holds, and what `robot.platform` holds inline.",
                true,
            ),
        ),
    ]
}

fn tables(schema: &Value) -> String {
    let mut text = String::new();
    let title = schema["title"].as_str().unwrap_or("file");
    section(&mut text, title, schema);
    if let Some(definitions) = schema["$defs"].as_object() {
        for (name, definition) in definitions {
            section(&mut text, name, definition);
        }
    }
    text
}

fn section(text: &mut String, name: &str, schema: &Value) {
    let _ = write!(text, "## {name}\n\n{}\n\n", description(schema));
    if schema["properties"].is_object() {
        properties(text, schema);
        return;
    }
    let variants = schema["oneOf"]
        .as_array()
        .or_else(|| schema["anyOf"].as_array());
    if let Some(words) = schema["enum"].as_array() {
        for word in words {
            let _ = writeln!(text, "- `{word}`");
        }
        text.push('\n');
    }
    for variant in variants.into_iter().flatten() {
        if let Some(word) = variant["const"].as_str() {
            let _ = writeln!(text, "- `\"{word}\"`: {}", description(variant));
            continue;
        }
        let kind = variant["properties"]["kind"]["const"]
            .as_str()
            .unwrap_or("other");
        let _ = write!(
            text,
            "### `kind = \"{kind}\"`\n\n{}\n\n",
            description(variant)
        );
        if let Some(reference) = variant["$ref"].as_str() {
            let _ = write!(text, "Its keys are those of {}.\n\n", link(reference));
        }
        properties(text, variant);
    }
    text.push('\n');
}

fn properties(text: &mut String, schema: &Value) {
    let Some(properties) = schema["properties"].as_object() else {
        return;
    };
    let required: Vec<&str> = schema["required"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let shown: Vec<_> = properties
        .iter()
        .filter(|(key, value)| !(key.as_str() == "kind" && value.get("const").is_some()))
        .collect();
    if shown.is_empty() {
        return;
    }
    text.push_str("| key | type | default | meaning |\n| --- | --- | --- | --- |\n");
    for (key, value) in shown {
        let default = match value.get("default") {
            Some(default) => format!("`{default}`"),
            None if required.contains(&key.as_str()) => "required".into(),
            None => "none".into(),
        };
        let _ = writeln!(
            text,
            "| `{key}` | {} | {default} | {} |",
            kind(value),
            description(value).replace('\n', " ")
        );
    }
    text.push('\n');
}

fn description(schema: &Value) -> String {
    schema["description"]
        .as_str()
        .unwrap_or("")
        .replace('|', "\\|")
}

fn link(reference: &str) -> String {
    let name = reference.rsplit('/').next().unwrap_or_default();
    format!("[{name}](#{})", name.to_lowercase())
}

fn kind(schema: &Value) -> String {
    if let Some(reference) = schema["$ref"].as_str() {
        return link(reference);
    }
    for key in ["allOf", "anyOf"] {
        if let Some(all) = schema[key].as_array() {
            let kinds: Vec<String> = all.iter().map(kind).filter(|k| k != "null").collect();
            return kinds.join(" or ");
        }
    }
    match &schema["type"] {
        Value::String(word) if word == "array" => {
            match (&schema["items"], &schema["prefixItems"]) {
                (Value::Null, _) => "list".into(),
                (items, _) => {
                    let length = schema["maxItems"]
                        .as_u64()
                        .filter(|_| schema["minItems"] == schema["maxItems"]);
                    let count = length.map_or(String::new(), |n| format!("{n} × "));
                    format!("list of {count}{}", kind(items))
                }
            }
        }
        Value::String(word) => match word.as_str() {
            "number" => "number".into(),
            "integer" => "whole number".into(),
            other => other.into(),
        },
        Value::Array(words) => words
            .iter()
            .filter_map(Value::as_str)
            .filter(|w| *w != "null")
            .collect::<Vec<_>>()
            .join(" or "),
        _ => "value".into(),
    }
}
