//! Appell in ROS: a simulation that is commanded by `cmd_vel` and answers with odometry, transforms and sensors.

pub mod drive;
pub mod foxglove;
pub mod node;
pub mod paced;
pub mod ros1;
pub mod service;
pub mod simulator;
pub mod tape;
pub mod type_hash;
#[cfg(feature = "zenoh")]
pub mod zenoh;
