//! The network side: a page, a socket and a small HTTP interface, for this machine alone.
//!
//! Everything lies below a random token. `Host` must name this machine and `Origin`, where there is one, must be
//! the page's own, so that no page of another site reaches it, not even by a name that resolves to loopback.
//! Bodies, messages, rates and connections are bounded; no name of a file in an address reaches the file system.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{DefaultBodyLimit, Path, Query, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Json, Response};
use axum::routing::{get, post};
use futures_util::{SinkExt, StreamExt};
use serde_json::json;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, mpsc, watch};

use crate::driver::Driver;
use crate::panels::Panels;
use crate::player::FRAME;
use crate::studio::{Command, Refusal, is_plain};
use crate::talk::{self, Obstructed, Said, SeriesRequest, Told};

/// Longest body or message, bytes.
const MESSAGE_MAX: usize = 64 << 10;
/// Most connections at once.
const CONNECTIONS_MAX: usize = 96;
/// Most pages at once.
const PAGES_MAX: usize = 16;
/// Longest time for the head of a request.
const PATIENCE: Duration = Duration::from_secs(5);
/// Messages of a page per second, and at once.
const RATE: f64 = 400.0;
const BURST: f64 = 800.0;
/// Longest time in which a page has to take a frame.
const STALLED: Duration = Duration::from_secs(60);

/// How often the folder of panels is looked at.
const LOOK: Duration = Duration::from_millis(500);
/// Where the frame lies that panels of a project run in. It has no token: nothing is in it that could be kept
/// from anybody, and what runs in it is not to know the token.
const FRAME_PATH: &str = "/frame";
/// What names of hosts end with that such frames have, each its own, beside those of the page: they lead to this
/// machine, too, and browsers give each of them a process.
const FRAME_HOSTS: &str = ".localhost";
/// What such a frame may do: run what it is given, and reach nothing.
const FRAME_POLICY: &str = "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; \
     style-src 'unsafe-inline'; img-src data: blob:; font-src data:; worker-src blob:; base-uri 'none'; \
     form-action 'none'; frame-ancestors 'self' http://127.0.0.1:* http://localhost:*";

/// The built page.
#[derive(rust_embed::RustEmbed)]
#[folder = "page/dist"]
#[allow_missing = true]
struct Page;

/// What is shown where the page has not been built.
const UNBUILT: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Appell Studio</title>\
<body style=\"font:16px/1.6 sans-serif;max-width:40em;margin:4em auto;padding:0 1em\">\
<h1>The page has not been built</h1><p>This server was compiled without its page. Building it needs \
<a href=\"https://nodejs.org\">Node</a> 20.19 or later. In the project's folder:</p>\
<pre>cargo xtask studio</pre><p>Then start <code>appell studio</code> again. \
The interface for programs works all the same.</p></body></html>";

struct Server {
    driver: Arc<Driver>,
    panels: Arc<Panels>,
    /// The list of panels, as the socket tells it.
    listed: watch::Receiver<Arc<str>>,
    token: String,
    pages: Arc<Semaphore>,
}

type Shared = State<Arc<Server>>;

/// A random token of 128 bits.
///
/// # Errors
/// The machine gives no random numbers.
pub fn token() -> Result<String, getrandom::Error> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Listens on loopback; port 0 is any.
///
/// # Errors
/// The port is taken.
pub async fn listen(port: u16) -> std::io::Result<TcpListener> {
    TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).await
}

fn listed(panels: &Panels) -> Arc<str> {
    json!({"kind": "panels", "panels": panels.list()})
        .to_string()
        .into()
}

/// Looks at the folder of panels again and again.
async fn look(panels: Arc<Panels>, tell: watch::Sender<Arc<str>>) {
    loop {
        tokio::time::sleep(LOOK).await;
        let folder = panels.clone();
        let Ok(now) = tokio::task::spawn_blocking(move || listed(&folder)).await else {
            return;
        };
        tell.send_if_modified(|told| {
            let is_new = *told != now;
            *told = now;
            is_new
        });
        if tell.is_closed() {
            return;
        }
    }
}

/// Serves until it is dropped.
pub async fn serve(listener: TcpListener, driver: Arc<Driver>, panels: Panels, token: String) {
    let panels = Arc::new(panels);
    let (tell, list) = watch::channel(listed(&panels));
    tokio::spawn(look(panels.clone(), tell));
    let server = Arc::new(Server {
        driver,
        panels,
        listed: list,
        token,
        pages: Arc::new(Semaphore::new(PAGES_MAX)),
    });
    let app = router(server);
    let connections = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Out of descriptors: those that there are will end.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let Ok(place) = connections.clone().try_acquire_owned() else {
            drop(stream);
            continue;
        };
        let _ = stream.set_nodelay(true);
        let app = app.clone();
        tokio::spawn(async move {
            let service = hyper::service::service_fn(
                move |request: hyper::Request<hyper::body::Incoming>| {
                    let mut app = app.clone();
                    async move { tower_service::Service::call(&mut app, request.map(Body::new)).await }
                },
            );
            // A connection that is refused or breaks off concerns nobody else.
            let _ = hyper::server::conn::http1::Builder::new()
                .timer(hyper_util::rt::TokioTimer::new())
                .header_read_timeout(PATIENCE)
                .max_buf_size(MESSAGE_MAX)
                .serve_connection(hyper_util::rt::TokioIo::new(stream), service)
                .with_upgrades()
                .await;
            drop(place);
        });
    }
}

fn router(server: Arc<Server>) -> Router {
    Router::new()
        .route("/{token}/", get(index))
        .route("/{token}/assets/{name}", get(asset))
        .route("/{token}/panels/{name}", get(panel))
        .route("/{token}/socket", get(socket))
        .route("/{token}/api/state", get(state))
        .route("/{token}/api/batch", get(batch))
        .route("/{token}/api/crossing", get(crossing))
        .route("/{token}/api/openapi.json", get(openapi))
        .route("/{token}/api/command", post(command))
        .route("/{token}/api/series", get(series))
        .route("/{token}/api/lines/{line}/{file}", get(recording))
        .fallback(async || StatusCode::NOT_FOUND)
        .layer(DefaultBodyLimit::max(MESSAGE_MAX))
        .layer(middleware::from_fn_with_state(server.clone(), guard))
        .with_state(server)
}

/// Whether two texts are equal, in a time that tells nothing of where they differ.
fn equals(one: &str, other: &str) -> bool {
    let differ = one
        .bytes()
        .zip(other.bytes())
        .fold(0, |d, (a, b)| d | (a ^ b));
    one.len() == other.len() && differ == 0
}

/// Whether a `Host` is a name that frames of panels have.
fn is_frame_host(host: &str) -> bool {
    let name = host.split(':').next().unwrap_or_default();
    name.strip_suffix(FRAME_HOSTS).is_some_and(is_plain)
}

/// Whether a `Host` is a name of this machine, at whatever port a tunnel has.
fn is_local(host: &str) -> bool {
    let name = match host.strip_prefix("[::1]") {
        Some(rest) => return rest.is_empty() || rest.starts_with(':'),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "127.0.0.1" || name.eq_ignore_ascii_case("localhost")
}

/// Refuses what does not come from the page or with its token, before anything else looks at it.
async fn guard(State(server): Shared, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let text = |name: header::HeaderName| -> Option<Option<String>> {
        let mut values = headers.get_all(name).iter();
        match (values.next(), values.next()) {
            (None, _) => Some(None),
            (Some(value), None) => Some(Some(value.to_str().ok()?.to_owned())),
            (Some(_), Some(_)) => None,
        }
    };
    let is_frame = request.uri().path() == FRAME_PATH;
    let host = text(header::HOST).flatten();
    let host = host.filter(|host| is_local(host) || is_frame && is_frame_host(host));
    let Some(host) = host else {
        return (
            StatusCode::MISDIRECTED_REQUEST,
            "Host must be this machine\n",
        )
            .into_response();
    };
    let is_own = match text(header::ORIGIN) {
        Some(None) => true,
        Some(Some(origin)) => origin == format!("http://{host}"),
        None => false,
    };
    if !is_own {
        return (StatusCode::FORBIDDEN, "Origin must be the page's own\n").into_response();
    }
    if is_frame {
        return frame();
    }
    let given = request.uri().path().split('/').nth(1).unwrap_or_default();
    if !equals(given, &server.token) {
        return (
            StatusCode::FORBIDDEN,
            "the address must have the token that the studio printed\n",
        )
            .into_response();
    }
    let mut response = next.run(request).await;
    let set = [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (
            header::CONTENT_SECURITY_POLICY,
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; \
             font-src 'self'; connect-src 'self'; frame-src 'self' http://*.localhost:*; base-uri 'none'; form-action 'none'; \
             frame-ancestors 'none'",
        ),
    ];
    for (name, value) in set {
        response
            .headers_mut()
            .insert(name, HeaderValue::from_static(value));
    }
    let cached = header::CACHE_CONTROL;
    if !response.headers().contains_key(&cached) {
        let value = HeaderValue::from_static("no-store");
        response.headers_mut().insert(cached, value);
    }
    response
}

/// The frame that a panel of a project runs in.
fn frame() -> Response {
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, FRAME_POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, include_str!("frame.html")).into_response()
}

fn file(name: &str) -> Option<Response> {
    let found = Page::get(name)?;
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("woff2") => "font/woff2",
        _ => "application/octet-stream",
    };
    Some(([(header::CONTENT_TYPE, kind)], found.data.into_owned()).into_response())
}

async fn index() -> Response {
    file("index.html").unwrap_or_else(|| {
        (
            [(header::CONTENT_TYPE, "text/html; charset=utf-8")],
            UNBUILT,
        )
            .into_response()
    })
}

/// Files are embedded: a name finds one of them, or nothing.
async fn asset(Path((_, name)): Path<(String, String)>) -> Response {
    file(&format!("assets/{name}")).unwrap_or_else(|| StatusCode::NOT_FOUND.into_response())
}

/// The text of a panel of the project.
async fn panel(State(server): Shared, Path((_, name)): Path<(String, String)>) -> Response {
    let panels = server.panels.clone();
    let text = tokio::task::spawn_blocking(move || panels.read(name.strip_suffix(".js")?)).await;
    match text {
        Ok(Some(text)) => (
            [(header::CONTENT_TYPE, "text/javascript; charset=utf-8")],
            text,
        )
            .into_response(),
        _ => StatusCode::NOT_FOUND.into_response(),
    }
}

async fn state(State(server): Shared) -> Response {
    let view = server.driver.view();
    (
        [(header::CONTENT_TYPE, "application/json")],
        view.state.to_string(),
    )
        .into_response()
}

/// The figures of the batch that is open.
async fn batch(State(server): Shared) -> Response {
    match server.driver.view().batch {
        Some(text) => (
            [(header::CONTENT_TYPE, "application/json")],
            text.to_string(),
        )
            .into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

/// What a wheel-legged robot does about an obstacle, instant by instant.
async fn crossing(Query(asked): Query<Obstructed>) -> Response {
    match tokio::task::spawn_blocking(move || asked.crossed()).await {
        Ok(Ok(data)) => Json(data).into_response(),
        Ok(Err(refusal)) => (StatusCode::UNPROCESSABLE_ENTITY, Json(refusal)).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

async fn openapi() -> Response {
    (
        [(header::CONTENT_TYPE, "application/json")],
        include_str!("openapi.json"),
    )
        .into_response()
}

async fn command(State(server): Shared, body: axum::body::Bytes) -> Response {
    let command = match serde_json::from_slice::<Command>(&body) {
        Ok(command) => command,
        Err(error) => {
            let refusal = Refusal::new(error.to_string(), "the book lists the commands");
            return (StatusCode::BAD_REQUEST, Json(refusal)).into_response();
        }
    };
    match server.driver.command(command).await {
        Ok(value) => Json(value).into_response(),
        Err(refusal) => (StatusCode::UNPROCESSABLE_ENTITY, Json(refusal)).into_response(),
    }
}

/// Series as CSV, in full where points are enough.
async fn series(State(server): Shared, Query(asked): Query<SeriesRequest>) -> Response {
    match asked.table(&server.driver.view()) {
        Ok(text) => ([(header::CONTENT_TYPE, "text/csv; charset=utf-8")], text).into_response(),
        Err(refusal) => (StatusCode::UNPROCESSABLE_ENTITY, Json(refusal)).into_response(),
    }
}

/// The recording of a line, in the format that the name of the file says.
async fn recording(
    State(server): Shared,
    Path((_, line, name)): Path<(String, u32, String)>,
) -> Response {
    let format = name.strip_prefix("recording.");
    let Some(format) = format.filter(|format| ["mcap", "csv", "parquet"].contains(format)) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let Ok(own) = token() else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let file = std::env::temp_dir().join(format!("appell-{own}.{format}"));
    let written = server.driver.recording(line, file.clone()).await;
    let bytes = std::fs::read(&file);
    let _ = std::fs::remove_file(&file);
    match (written, bytes) {
        (Ok(_), Ok(bytes)) => (
            [
                (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
                (
                    header::CONTENT_DISPOSITION,
                    format!("attachment; filename=\"{name}\""),
                ),
            ],
            bytes,
        )
            .into_response(),
        (Err(refusal), _) => (StatusCode::NOT_FOUND, Json(refusal)).into_response(),
        (_, Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

async fn socket(State(server): Shared, upgrade: WebSocketUpgrade) -> Response {
    // A program without a page says no Origin, and has the token.
    let Ok(place) = server.pages.clone().try_acquire_owned() else {
        return (
            StatusCode::SERVICE_UNAVAILABLE,
            "too many pages are open; close one\n",
        )
            .into_response();
    };
    upgrade
        .max_message_size(MESSAGE_MAX)
        .max_frame_size(MESSAGE_MAX)
        .on_upgrade(move |socket| async move {
            page(socket, &server.driver, server.listed.clone()).await;
            drop(place);
        })
}

/// Allows so many messages a second.
struct Bucket {
    left: f64,
    since: std::time::Instant,
}

impl Bucket {
    fn takes(&mut self) -> bool {
        let now = std::time::Instant::now();
        self.left = (self.left + RATE * (now - self.since).as_secs_f64()).min(BURST);
        self.since = now;
        self.left -= 1.0;
        self.left >= 0.0
    }
}

/// Serves one page: what it asks for in one task, what it sees in another, so that neither waits for the
/// other. What is sent waits for the page; what comes meanwhile is sent together afterwards.
async fn page(socket: WebSocket, driver: &Arc<Driver>, mut listed: watch::Receiver<Arc<str>>) {
    let (mut out, mut into) = socket.split();
    // Answers are few: a page waits for them, and asks for no more than the bucket lets it.
    let (answer, mut answers) = mpsc::channel::<Message>(64);
    let listening = {
        let driver = driver.clone();
        async move {
            let mut bucket = Bucket {
                left: BURST,
                since: std::time::Instant::now(),
            };
            while let Some(Ok(message)) = into.next().await {
                if !bucket.takes() {
                    let reason = "too many messages".into();
                    let frame = CloseFrame {
                        code: close_code::POLICY,
                        reason,
                    };
                    let _ = answer.try_send(Message::Close(Some(frame)));
                    return;
                }
                let text = match message {
                    Message::Text(text) => text,
                    Message::Binary(_) | Message::Close(_) => return,
                    Message::Ping(_) | Message::Pong(_) => continue,
                };
                let reply = reply(&driver, &text).await;
                if answer.send(reply).await.is_err() {
                    return;
                }
            }
        }
    };
    let showing = async move {
        let mut pulse = driver.pulse();
        let mut told = Told::default();
        pulse.mark_changed();
        listed.mark_changed();
        loop {
            tokio::select! {
                biased;
                reply = answers.recv() => {
                    let Some(reply) = reply else { return };
                    let is_last = matches!(reply, Message::Close(_));
                    if !send(&mut out, reply).await || is_last { return; }
                }
                changed = pulse.changed() => {
                    if changed.is_err() { return; }
                    for message in told.news(&driver.view()) {
                        if !send(&mut out, carried(message)).await { return; }
                    }
                    tokio::time::sleep(FRAME).await;
                }
                changed = listed.changed() => {
                    if changed.is_err() { return; }
                    let list = listed.borrow_and_update().to_string();
                    if !send(&mut out, Message::text(list)).await { return; }
                }
            }
        }
    };
    tokio::select! {
        () = listening => {}
        () = showing => {}
    }
}

/// Sends, unless the page has stopped taking anything.
async fn send(out: &mut (impl SinkExt<Message> + Unpin), message: Message) -> bool {
    let sent = tokio::time::timeout(STALLED, out.send(message)).await;
    matches!(sent, Ok(Ok(())))
}

async fn reply(driver: &Arc<Driver>, text: &str) -> Message {
    carried(match Said::read(text) {
        Ok(Said::Series { series, asked }) => talk::series(series, &asked, &driver.view()),
        Ok(Said::Command { id, command }) => talk::answer(id, driver.command(*command).await),
        Err(refusal) => refusal,
    })
}

/// A message as the socket carries it.
fn carried(message: talk::Message) -> Message {
    match message {
        talk::Message::Text(text) => Message::text(text),
        talk::Message::Binary(bytes) => Message::Binary(bytes.into()),
    }
}
