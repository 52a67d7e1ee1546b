//! A live view for Foxglove and those that speak like it: its protocol over a WebSocket, messages as CDR with their
//! definitions. It shows what a robot says and takes no commands.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use appell_sim::ros::message::{Message, Time, definition};
use serde::Deserialize;
use serde_json::json;
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::http::HeaderValue;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message as Frame, WebSocket};

/// Longest message that is taken, bytes.
const SIZE_MAX: usize = 64 << 10;
/// How long a viewer may take to say who it is, or to take what it is told.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long a viewer's thread listens before it looks what is to be said.
const GLANCE: Duration = Duration::from_millis(5);
/// Most viewers at a time, subscriptions of each, and frames that wait for it.
const VIEWERS_MAX: usize = 16;
const SUBSCRIPTIONS_MAX: usize = 256;
const WAITING_MAX: usize = 1024;
/// Most complaints that a viewer is told.
const COMPLAINTS_MAX: u32 = 20;
/// Names of the protocol, the preferred one first. What is used of both is the same.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// First bytes of binary frames.
const MESSAGE: u8 = 1;
const TIME: u8 = 2;

/// A topic that is shown.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Name.
    pub name: String,
    /// Type, as ROS 2 names it.
    pub kind: &'static str,
    /// Whether its last message is kept for those who come later.
    pub is_kept: bool,
}

/// What viewers ask.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Wish {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

/// One who looks.
struct Viewer {
    send: SyncSender<Vec<u8>>,
    /// Topic of each subscription.
    subscriptions: BTreeMap<u32, usize>,
}

#[derive(Default)]
struct State {
    viewers: BTreeMap<u64, Viewer>,
    /// Those that have not shaken hands yet count, too.
    connections: usize,
    next: u64,
    /// Time and bytes of what is kept, by topic.
    kept: BTreeMap<usize, (u64, Vec<u8>)>,
}

struct Shared {
    topics: Vec<Shown>,
    state: Mutex<State>,
}

/// A live view.
pub struct View {
    shared: Arc<Shared>,
    address: SocketAddr,
}

fn nanoseconds(time: Time) -> u64 {
    u64::from(time.sec.unsigned_abs()) * 1_000_000_000 + u64::from(time.nanosec)
}

fn message(subscription: u32, time: u64, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![MESSAGE];
    bytes.extend(subscription.to_le_bytes());
    bytes.extend(time.to_le_bytes());
    bytes.extend(payload);
    bytes
}

impl View {
    /// Listens at an address for those who want to see these topics.
    ///
    /// # Errors
    /// The address is not free, or not of this machine.
    pub fn open(address: SocketAddr, topics: Vec<Shown>) -> Result<View, String> {
        let told = |error: std::io::Error| format!("--foxglove {address}: {error}");
        let listener = TcpListener::bind(address).map_err(told)?;
        let address = listener.local_addr().map_err(told)?;
        let shared = Arc::new(Shared {
            topics,
            state: Mutex::default(),
        });
        let own = shared.clone();
        std::thread::spawn(move || accept(&listener, &own));
        Ok(View { shared, address })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Says a message of a topic, by its place, at the time of its header or `now`.
    pub fn say(&self, topic: usize, now: Time, said: &Message) {
        let is_kept = self.shared.topics[topic].is_kept;
        let mut state = self.shared.state();
        let wanted = |viewer: &Viewer| viewer.subscriptions.values().any(|of| *of == topic);
        if !is_kept && !state.viewers.values().any(wanted) {
            return;
        }
        let time = nanoseconds(said.stamp().unwrap_or(now));
        let payload = said.to_cdr();
        for viewer in state.viewers.values() {
            for (id, _) in viewer.subscriptions.iter().filter(|(_, of)| **of == topic) {
                // Who does not keep up loses messages, and holds nobody up.
                let _ = viewer.send.try_send(message(*id, time, &payload));
            }
        }
        if is_kept {
            state.kept.insert(topic, (time, payload));
        }
    }

    /// Says what time it is in the simulation.
    pub fn tell(&self, now: Time) {
        let mut bytes = vec![TIME];
        bytes.extend(nanoseconds(now).to_le_bytes());
        for viewer in self.shared.state().viewers.values() {
            let _ = viewer.send.try_send(bytes.clone());
        }
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("nothing panics with it")
    }

    /// What every viewer is told first: who this is, and what is shown.
    fn greeting(&self) -> [String; 2] {
        let channels = self.topics.iter().enumerate().map(|(id, topic)| {
            json!({
                "id": id,
                "topic": topic.name,
                "encoding": "cdr",
                "schemaName": topic.kind,
                "schema": definition(topic.kind),
                "schemaEncoding": "ros2msg",
            })
        });
        let channels: Vec<_> = channels.collect();
        let server = json!({
            "op": "serverInfo",
            "name": concat!("appell ", env!("CARGO_PKG_VERSION")),
            "capabilities": ["time"],
            "supportedEncodings": [],
            "metadata": {},
        });
        [
            server.to_string(),
            json!({ "op": "advertise", "channels": channels }).to_string(),
        ]
    }

    /// Does what a viewer asks; what is wrong with it.
    fn grant(&self, viewer: u64, text: &str) -> Result<(), String> {
        let wish: Wish = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let mut state = self.state();
        let State { viewers, kept, .. } = &mut *state;
        let Some(viewer) = viewers.get_mut(&viewer) else {
            return Ok(());
        };
        match wish {
            Wish::Subscribe { subscriptions } => {
                for Subscription { id, channel_id } in subscriptions {
                    if channel_id >= self.topics.len() {
                        return Err(format!(
                            "channelId: must be below {}, got {channel_id}",
                            self.topics.len()
                        ));
                    }
                    if viewer.subscriptions.len() >= SUBSCRIPTIONS_MAX {
                        return Err(format!("must be at most {SUBSCRIPTIONS_MAX} subscriptions"));
                    }
                    viewer.subscriptions.insert(id, channel_id);
                    if let Some((time, payload)) = kept.get(&channel_id) {
                        let _ = viewer.send.try_send(message(id, *time, payload));
                    }
                }
                Ok(())
            }
            Wish::Unsubscribe { subscription_ids } => {
                for id in subscription_ids {
                    viewer.subscriptions.remove(&id);
                }
                Ok(())
            }
            Wish::Other => Err("op: must be subscribe or unsubscribe: this is a view".to_owned()),
        }
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming().flatten() {
        let mut state = shared.state();
        if state.connections >= VIEWERS_MAX {
            continue;
        }
        state.connections += 1;
        drop(state);
        let shared = shared.clone();
        std::thread::spawn(move || {
            // Whatever goes wrong with a viewer is its own affair.
            let _ = serve(&shared, stream);
            shared.state().connections -= 1;
        });
    }
}

/// Chooses the protocol that both speak.
#[allow(clippy::result_large_err)] // The library's own type.
fn choose(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    const HEADER: &str = "sec-websocket-protocol";
    let offered = request.headers().get_all(HEADER).iter();
    let offered: Vec<&str> = offered
        .flat_map(|value| value.to_str().unwrap_or_default().split(','))
        .map(str::trim)
        .collect();
    let Some(protocol) = PROTOCOLS.iter().find(|own| offered.contains(own)) else {
        let mut refused =
            ErrorResponse::new(Some(format!("must speak {}", PROTOCOLS.join(" or "))));
        *refused.status_mut() = tungstenite::http::StatusCode::BAD_REQUEST;
        return Err(refused);
    };
    response
        .headers_mut()
        .insert(HEADER, HeaderValue::from_static(protocol));
    Ok(response)
}

fn serve(shared: &Shared, stream: TcpStream) -> Result<(), Error> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.set_nodelay(true)?;
    let config = WebSocketConfig::default()
        .max_message_size(Some(SIZE_MAX))
        .max_frame_size(Some(SIZE_MAX));
    let Ok(mut socket) = tungstenite::accept_hdr_with_config(stream, choose, Some(config)) else {
        return Ok(());
    };
    socket.get_ref().set_read_timeout(Some(GLANCE))?;
    for text in shared.greeting() {
        socket.send(Frame::text(text))?;
    }
    let (send, said) = sync_channel(WAITING_MAX);
    let id = {
        let mut state = shared.state();
        state.next += 1;
        let id = state.next;
        let subscriptions = BTreeMap::new();
        state.viewers.insert(
            id,
            Viewer {
                send,
                subscriptions,
            },
        );
        id
    };
    let ended = attend(shared, id, &mut socket, &said);
    shared.state().viewers.remove(&id);
    ended
}

/// Listens to a viewer and tells it what it wants, until it goes.
fn attend(
    shared: &Shared,
    id: u64,
    socket: &mut WebSocket<TcpStream>,
    said: &Receiver<Vec<u8>>,
) -> Result<(), Error> {
    let mut complaints = 0;
    loop {
        match socket.read() {
            Ok(Frame::Text(text)) => {
                if let Err(problem) = shared.grant(id, &text)
                    && complaints < COMPLAINTS_MAX
                {
                    complaints += 1;
                    let status = json!({ "op": "status", "level": 2, "message": problem });
                    socket.write(Frame::text(status.to_string()))?;
                }
            }
            Ok(_) => {}
            Err(Error::Io(error))
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => return Err(error),
        }
        for frame in said.try_iter().take(WAITING_MAX) {
            socket.write(Frame::binary(frame))?;
        }
        socket.flush()?;
    }
}
