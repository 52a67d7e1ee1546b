//! Services of ROS 2. A request is told apart from others by its sample's identity in the way of Fast DDS, and by
//! 16 bytes before it in that of Cyclone DDS; topics and types are the same. Each service listens in both ways, and
//! answers as it was asked.

use ros2_client::{
    Message, Name, Node, QosProfile, RmwRequestId, Server, ServiceMapping, ServiceTypeName,
    qos::History,
};
use serde::{Deserialize, Serialize};

/// Requests that are looked at in one go.
const LOOK_MAX: usize = 256;
/// Vendor of Cyclone DDS, with which the identities of its participants begin.
const CYCLONE: [u8; 2] = [0x01, 0x10];
/// Ways of telling requests apart; that of Cyclone DDS is the second.
const WAYS: [ServiceMapping; 2] = [ServiceMapping::Enhanced, ServiceMapping::Cyclone];

/// A service.
pub struct Service<Q: Message, A: Message>([Server<Q, A>; 2]);

/// Who asked, and what is to be answered.
pub struct Asker {
    way: usize,
    id: RmwRequestId,
}

impl<Q: Message + Clone + 'static, A: Message + Clone + 'static> Service<Q, A> {
    /// Offers a service of a type of a package.
    ///
    /// # Errors
    /// The network refuses.
    pub fn offer(
        node: &mut Node,
        name: &Name,
        (package, kind): (&str, &str),
    ) -> Result<Self, String> {
        let qos = QosProfile::publisher_default().history(History::KeepLast { depth: 10 });
        let kind = ServiceTypeName::new(package, kind);
        let mut listen = |way| {
            node.create_server(way, name, &kind, qos.clone(), qos.clone())
                .map_err(|error| format!("{name}: cannot be offered: {error:?}"))
        };
        Ok(Service([listen(WAYS[0])?, listen(WAYS[1])?]))
    }

    /// The next request; one that cannot be read is passed over.
    pub fn asked(&self) -> Option<(Asker, Q)> {
        for (way, server) in self.0.iter().enumerate() {
            for _ in 0..LOOK_MAX {
                match server.receive_request() {
                    Ok(None) => break,
                    // Both hear all, and what is meant for the other makes no sense.
                    Ok(Some((id, request))) => {
                        let is_cyclone = id.writer_gid.as_bytes().starts_with(&CYCLONE);
                        if is_cyclone == (way == 1) {
                            return Some((Asker { way, id }, request));
                        }
                    }
                    Err(_) => {}
                }
            }
        }
        None
    }

    /// Answers one who asked.
    pub fn answer(&self, to: &Asker, answer: A) {
        // Who has gone needs no answer.
        let _ = self.0[to.way].send_response(to.id, answer);
    }
}

/// What a request without fields has on the wire.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Nothing {
    structure_needs_at_least_one_member: u8,
}

/// What std_srvs/SetBool asks.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Flag {
    /// On or off.
    pub data: bool,
}

/// What std_srvs/Trigger, std_srvs/SetBool and controller_manager_msgs/SwitchController answer.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Done {
    success: bool,
    message: String,
}

impl From<Result<(), String>> for Done {
    fn from(result: Result<(), String>) -> Done {
        Done {
            success: result.is_ok(),
            message: result.err().unwrap_or_default(),
        }
    }
}

/// What robot_localization/SetPose asks: a geometry_msgs/PoseWithCovarianceStamped.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct SetPose {
    header: appell_sim::ros::message::Header,
    /// Where the robot shall be.
    pub pose: appell_sim::ros::message::PoseWithCovariance,
}

/// What controller_manager_msgs/SwitchController asks.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct SwitchController {
    /// Who shall drive.
    pub activate_controllers: Vec<String>,
    /// Who shall no longer.
    pub deactivate_controllers: Vec<String>,
    strictness: i32,
    activate_asap: bool,
    timeout: appell_sim::ros::message::Time,
}

impl SwitchController {
    /// Who drives from now on: one is switched on, or the commands from outside are by default.
    ///
    /// # Errors
    /// More than one would drive, or none would change.
    pub fn to(&self) -> Result<&str, String> {
        match (
            self.activate_controllers.as_slice(),
            self.deactivate_controllers.as_slice(),
        ) {
            ([one], _) => Ok(one),
            ([], [_, ..]) => Ok("external"),
            (many, _) => Err(format!(
                "activate_controllers: must be one, got {}: one at a time drives a robot",
                many.len()
            )),
        }
    }
}

impl Message for Nothing {}
impl Message for Flag {}
impl Message for Done {}
impl Message for SetPose {}
impl Message for SwitchController {}
