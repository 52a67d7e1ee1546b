//! Hashes of types as ROS 2 tells them since Iron (RIHS01): SHA-256 of a type's description, in the one form of JSON
//! that its makers have agreed on.

use appell_sim::ros::message::definition;
use serde_json::Value;
use sha2::{Digest, Sha256};

/// Numbers of the basic types that messages are made of here, and of what is nested.
const BASIC: [(&str, u32); 5] = [
    ("nested", 1),
    ("int32", 6),
    ("uint32", 7),
    ("float64", 11),
    ("string", 17),
];
/// What is added for arrays of a length, and for sequences without one.
const ARRAY: u32 = 48;
const SEQUENCE: u32 = 144;

/// The hash of a type (`nav_msgs/msg/Odometry`), beginning with `RIHS01_`.
///
/// # Panics
/// If the type is none of [`appell_sim::ros::message::kind`].
pub fn type_hash(kind: &str) -> String {
    let text = definition(kind);
    // The type itself, and those that it is made of, each behind its name.
    let border = format!("{}\nMSG: ", "=".repeat(80));
    let mut parts = text.split(&border);
    let own = described(kind, parts.next().unwrap_or_default());
    let mut others: Vec<(String, String)> = parts
        .filter_map(|part| part.split_once('\n'))
        .map(|(name, fields)| (spelled(name), described(&spelled(name), fields)))
        .collect();
    others.sort();
    let others: Vec<String> = others.into_iter().map(|(_, text)| text).collect();
    let json = format!(
        "{{\"type_description\": {own}, \"referenced_type_descriptions\": [{}]}}",
        others.join(", ")
    );
    let digest = Sha256::digest(json.as_bytes());
    let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("RIHS01_{hex}")
}

/// `std_msgs/Header` as `std_msgs/msg/Header`.
fn spelled(name: &str) -> String {
    name.trim().replacen('/', "/msg/", 1)
}

fn described(name: &str, fields: &str) -> String {
    let fields: Vec<String> = fields
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(kind, field)| {
            let (base, length) = match kind.trim_end_matches(']').split_once('[') {
                None => (kind, None),
                Some((base, length)) => (base, Some(length)),
            };
            let basic = BASIC.iter().find(|(known, _)| *known == base);
            let (number, nested) = match basic {
                Some((_, number)) => (*number, String::new()),
                None => (BASIC[0].1, spelled(base)),
            };
            let (number, capacity) = match length {
                None => (number, 0),
                Some("") => (number + SEQUENCE, 0),
                Some(length) => (number + ARRAY, length.parse().unwrap_or(0)),
            };
            format!(
                "{{\"name\": {}, \"type\": {{\"type_id\": {number}, \"capacity\": {capacity}, \
                 \"string_capacity\": 0, \"nested_type_name\": {}}}}}",
                Value::from(field.trim()),
                Value::from(nested)
            )
        })
        .collect();
    format!(
        "{{\"type_name\": {}, \"fields\": [{}]}}",
        Value::from(name),
        fields.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use appell_sim::ros::message::kind;

    /// As `ros2 topic info --verbose` tells them in an installation of ROS 2.
    #[test]
    fn known_answer_hashes_of_ros_2() {
        for (kind, hash) in [
            (
                kind::TWIST,
                "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
            ),
            (
                kind::ODOMETRY,
                "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
            ),
        ] {
            assert_eq!(type_hash(kind), hash, "{kind}");
        }
    }
}
