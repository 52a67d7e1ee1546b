//! The network side: who is let in, what is bounded, and that no page holds up or changes a run.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use appell_studio::driver::Driver;
use appell_studio::panels::Panels;
use appell_studio::studio::{Native, Studio};
use appell_studio::web;
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

const TOKEN: &str = "0123456789abcdef0123456789abcdef";

struct Served {
    port: u16,
    _driver: Arc<Driver>,
}

async fn serve() -> Served {
    serve_with(Panels::of(Path::new("no-such-folder"))).await
}

async fn serve_with(panels: Panels) -> Served {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/slalom.toml");
    let studio =
        Studio::open(&file, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"));
    let driver = Arc::new(Driver::start(studio));
    let listener = web::listen(0).await.expect("a port");
    let port = listener.local_addr().expect("an address").port();
    tokio::spawn(web::serve(
        listener,
        driver.clone(),
        panels,
        TOKEN.to_owned(),
    ));
    Served {
        port,
        _driver: driver,
    }
}

impl Served {
    /// Sends bytes, and gives what comes back until the end, or until nothing comes for a while.
    async fn raw(&self, bytes: &[u8]) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))
            .await
            .expect("connects");
        // The server may hang up before it has read all of it.
        let _ = stream.write_all(bytes).await;
        let mut answer = Vec::new();
        let reading = stream.read_to_end(&mut answer);
        let _ = tokio::time::timeout(Duration::from_secs(8), reading).await;
        String::from_utf8_lossy(&answer).into_owned()
    }

    async fn get(&self, path: &str, headers: &str) -> String {
        let request = format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n");
        self.raw(request.as_bytes()).await
    }

    fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}\r\n", self.port)
    }

    async fn post(&self, body: &Value) -> String {
        let body = body.to_string();
        let host = self.host();
        let request = format!(
            "POST /{TOKEN}/api/command HTTP/1.1\r\n{host}Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        self.raw(request.as_bytes()).await
    }

    async fn state(&self) -> Value {
        let answer = self.get(&format!("/{TOKEN}/api/state"), &self.host()).await;
        let body = answer.split("\r\n\r\n").nth(1).expect("a body");
        serde_json::from_str(body).expect("JSON")
    }

    async fn page(
        &self,
    ) -> tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<TcpStream>> {
        let address = format!("ws://127.0.0.1:{}/{TOKEN}/socket", self.port);
        let mut request = address.into_client_request().expect("a request");
        let origin = format!("http://127.0.0.1:{}", self.port);
        request
            .headers_mut()
            .insert("Origin", origin.parse().expect("a header"));
        tokio_tungstenite::connect_async(request)
            .await
            .expect("joins")
            .0
    }
}

/// Memory of this process, KiB, where the system tells.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().trim_end_matches(" kB").trim().parse().ok()
}

fn status(answer: &str) -> u16 {
    let code = answer.split(' ').nth(1).and_then(|code| code.parse().ok());
    code.unwrap_or_else(|| panic!("no answer: {answer:?}"))
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn refusal_of_strangers() {
    let served = serve().await;
    let own = served.host();
    let index = format!("/{TOKEN}/");
    let port = served.port;
    for (path, headers, code) in [
        (index.clone(), own.clone(), 200),
        (index.clone(), "Host: localhost:8123\r\n".to_owned(), 200),
        (index.clone(), "Host: [::1]:8123\r\n".to_owned(), 200),
        (
            index.clone(),
            format!("{own}Origin: http://127.0.0.1:{port}\r\n"),
            200,
        ),
        // A name that resolves to loopback, as in rebinding.
        (index.clone(), "Host: evil.example\r\n".to_owned(), 421),
        (
            index.clone(),
            "Host: 127.0.0.1.evil.example\r\n".to_owned(),
            421,
        ),
        (
            index.clone(),
            format!("{own}Origin: http://evil.example\r\n"),
            403,
        ),
        (index.clone(), format!("{own}Origin: null\r\n"), 403),
        (
            index.clone(),
            format!("{own}Origin: http://127.0.0.1:{}\r\n", port ^ 1),
            403,
        ),
        ("/".to_owned(), own.clone(), 403),
        (
            "/0123456789abcdef0123456789abcdee/".to_owned(),
            own.clone(),
            403,
        ),
        (format!("/{}/", &TOKEN[..31]), own.clone(), 403),
        (format!("/{TOKEN}0/"), own.clone(), 403),
        ("/x/api/state".to_owned(), own.clone(), 403),
        (format!("/{TOKEN}/nothing"), own.clone(), 404),
        (
            format!("/{TOKEN}/assets/..%2f..%2fsrc%2fmain.rs"),
            own.clone(),
            404,
        ),
        (
            format!("/{TOKEN}/assets/%2e%2e/index.html"),
            own.clone(),
            404,
        ),
        (
            format!("/{TOKEN}/assets/../../../../etc/passwd"),
            own.clone(),
            404,
        ),
        (
            format!("/{TOKEN}/api/lines/99/recording.mcap"),
            own.clone(),
            404,
        ),
        (format!("/{TOKEN}/api/batch"), own.clone(), 404),
        (
            format!("/{TOKEN}/api/crossing?height=0.2"),
            own.clone(),
            200,
        ),
        (
            format!("/{TOKEN}/api/crossing?height=nan"),
            own.clone(),
            422,
        ),
        (
            format!("/{TOKEN}/api/crossing?height=0.2&width=1e9"),
            own.clone(),
            422,
        ),
        (
            format!("/{TOKEN}/api/series?line=1&signals=a&from=nan&to=1&points=9"),
            own.clone(),
            422,
        ),
        (
            format!("/{TOKEN}/api/series?line=1&signals=a&from=0&to=1&points=999999999"),
            own.clone(),
            422,
        ),
    ] {
        let answer = served.get(&path, &headers).await;
        assert_eq!(status(&answer), code, "{path} {headers}{answer}");
    }
    let answer = served.get(&index, &own).await;
    for header in [
        "content-security-policy: default-src 'none'",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
    ] {
        assert!(answer.contains(header), "{header}");
    }
    // Nor does a socket open for a page of another site.
    let upgrade = format!(
        "{own}Origin: http://evil.example\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    );
    let answer = served.get(&format!("/{TOKEN}/socket"), &upgrade).await;
    assert_eq!(status(&answer), 403);
}

/// Panels of a project are told and read as they are now; nothing else of the disk is.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn refusal_of_what_is_no_panel() {
    let home = std::env::temp_dir().join(format!("appell-panels-{}", std::process::id()));
    let folder = home.join("panels");
    std::fs::create_dir_all(&folder).expect("a folder");
    let write = |name: &str, text: &[u8]| std::fs::write(folder.join(name), text).expect("writes");
    write("mine.js", b"export const title = 'mine';");
    write("long.js", &vec![b' '; (1 << 20) + 1]);
    write("not-text.js", &[0xff, 0xfe]);
    write("two words.js", b"");
    std::fs::create_dir_all(folder.join("folder.js")).expect("a folder");
    std::fs::write(home.join("secret.js"), "secret").expect("writes");
    #[cfg(unix)]
    std::os::unix::fs::symlink(home.join("secret.js"), folder.join("link.js")).expect("links");
    let served = serve_with(Panels::of(&folder)).await;
    let own = served.host();
    for (path, code) in [
        (format!("/{TOKEN}/panels/mine.js"), 200),
        (format!("/{TOKEN}/panels/mine"), 404),
        (format!("/{TOKEN}/panels/long.js"), 404),
        (format!("/{TOKEN}/panels/not-text.js"), 404),
        (format!("/{TOKEN}/panels/two%20words.js"), 404),
        (format!("/{TOKEN}/panels/folder.js"), 404),
        (format!("/{TOKEN}/panels/link.js"), 404),
        (format!("/{TOKEN}/panels/..%2fsecret.js"), 404),
        (format!("/{TOKEN}/panels/%2e%2e%2fsecret.js"), 404),
        (format!("/{TOKEN}/panels/..%5csecret.js"), 404),
        (format!("/{TOKEN}/panels/../secret.js"), 404),
        (format!("/{TOKEN}/panels/mine.js%00"), 404),
        ("/panels/mine.js".to_owned(), 403),
        (
            "/0123456789abcdef0123456789abcdee/panels/mine.js".to_owned(),
            403,
        ),
    ] {
        let answer = served.get(&path, &own).await;
        assert_eq!(status(&answer), code, "{path} {answer}");
        assert!(!answer.contains("secret"), "{path} {answer}");
    }
    // The frame that they run in needs no token, and may reach nothing.
    let frame = served.get("/frame", &own).await;
    assert_eq!(status(&frame), 200);
    assert!(frame.contains("content-security-policy: sandbox allow-scripts; default-src 'none'"));
    assert!(!frame.contains(TOKEN));
    // It has names of its own, under which nothing else is served.
    for (path, host, code) in [
        ("/frame", "p1.localhost:8123", 200),
        ("/frame", "evil.example", 421),
        ("/frame", "a.b.localhost", 421),
        ("/frame", ".localhost", 421),
        (&*format!("/{TOKEN}/"), "p1.localhost:8123", 421),
        (
            &*format!("/{TOKEN}/panels/mine.js"),
            "p1.localhost:8123",
            421,
        ),
    ] {
        let answer = served.get(path, &format!("Host: {host}\r\n")).await;
        assert_eq!(status(&answer), code, "{path} {host}");
    }
    // A page hears of them when it joins, and when one was added, written anew or removed.
    let mut page = served.page().await;
    let mut hear = async |holds: &dyn Fn(&Value) -> bool| {
        let hears = async {
            loop {
                let message = page.next().await.expect("goes on").expect("is read");
                let Message::Text(text) = message else {
                    continue;
                };
                let said: Value = serde_json::from_str(&text).expect("JSON");
                if said["kind"] == "panels" && holds(&said["panels"]) {
                    return said["panels"].clone();
                }
            }
        };
        let heard = tokio::time::timeout(Duration::from_secs(5), hears);
        heard.await.expect("is told")
    };
    let list = hear(&|_| true).await;
    let names: Vec<&str> = list
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|one| one["name"].as_str())
        .collect();
    // One that is no text is listed and cannot be read.
    assert_eq!(names, ["mine", "not-text"]);
    let version = list[0]["version"].clone();
    write("another.js", b"");
    hear(&|list| list[0]["name"] == "another").await;
    write("mine.js", b"export const title = 'ours';");
    hear(&|list| list[1]["version"] != version).await;
    std::fs::remove_file(folder.join("another.js")).expect("removes");
    hear(&|list| list[0]["name"] == "mine").await;
    drop(page);
    std::fs::remove_dir_all(&home).expect("removes");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn refusal_of_too_much() {
    let served = serve().await;
    // A gigabyte is announced, and not read.
    let begun = Instant::now();
    let head = format!(
        "POST /{TOKEN}/api/command HTTP/1.1\r\n{}Content-Length: 1073741824\r\n\r\n",
        served.host()
    );
    let answer = served
        .raw(&[head.as_bytes(), &vec![b' '; 1 << 20]].concat())
        .await;
    assert!(answer.is_empty() || status(&answer) == 413, "{answer}");
    assert!(begun.elapsed() < Duration::from_secs(8));
    for body in [
        json!({"do": "change"}),
        json!([]),
        json!({"do": "format-disk"}),
    ] {
        assert_eq!(status(&served.post(&body).await), 400);
    }
    let much = json!({"do": "speed", "factor": 1000});
    assert_eq!(status(&served.post(&much).await), 422);
    // Ten thousand sockets that say nothing: most are dropped at once, the others soon, and memory stays.
    let before = resident();
    let mut slow = Vec::new();
    for _ in 0..10_000 {
        if let Ok(stream) = TcpStream::connect(("127.0.0.1", served.port)).await {
            slow.push(stream);
        }
    }
    assert!(slow.len() > 5_000, "{} were opened", slow.len());
    tokio::time::sleep(Duration::from_secs(6)).await;
    let answer = served.get(&format!("/{TOKEN}/"), &served.host()).await;
    assert_eq!(
        status(&answer),
        200,
        "it is there again while they are open"
    );
    if let (Some(before), Some(after)) = (before, resident()) {
        let growth = after.saturating_sub(before);
        println!(
            "{} slow sockets: {growth} KiB more, of both ends",
            slow.len()
        );
        assert!(growth < 64 << 10, "{growth} KiB more");
    }
    drop(slow);
    // A flood of messages ends the page that sends it, not the run.
    let mut page = served.page().await;
    let mut is_closed = false;
    for _ in 0..5000 {
        if page.send(Message::text("{}")).await.is_err() {
            is_closed = true;
            break;
        }
    }
    // What was sent and not read resets the connection: that ends it as well as a message that says so.
    while !is_closed {
        let next = tokio::time::timeout(Duration::from_secs(5), page.next()).await;
        is_closed = match next.expect("an answer or an end") {
            Some(Ok(message)) => message.is_close(),
            Some(Err(_)) | None => true,
        };
    }
    assert!(is_closed, "the flood ends");
    drop(page);
    let mut page = served.page().await;
    let long = "x".repeat(1 << 17);
    let _ = page.send(Message::text(long)).await;
    while let Ok(Some(Ok(_))) = tokio::time::timeout(Duration::from_secs(2), page.next()).await {}
    assert_eq!(served.state().await["kind"], "state");
}

/// Pages that come, go, sleep and read slowly: the run is the same as alone.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn invariant_pages_do_not_touch_the_run() {
    let mut ends = Vec::new();
    for disturbed in [false, true] {
        let served = serve().await;
        assert_eq!(
            status(&served.post(&json!({"do": "speed", "factor": 10.0})).await),
            200
        );
        // One joins, and never reads.
        let _asleep = if disturbed {
            Some(served.page().await)
        } else {
            None
        };
        assert_eq!(status(&served.post(&json!({"do": "play"})).await), 200);
        if disturbed {
            for _ in 0..100 {
                let mut page = served.page().await;
                let _ = page.next().await;
                // Cut, not closed.
                drop(page);
            }
        }
        let begun = Instant::now();
        while served.state().await["lines"][0]["over"] != true {
            assert!(begun.elapsed() < Duration::from_secs(20), "it goes on");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let state = served.state().await;
        assert_eq!(state["lines"][0]["verdict"], "passed");
        let query = "line=1&from=0&to=99&points=8000&signals=robot.tri.pose.x,robot.tri.pose.yaw";
        let series = served
            .get(&format!("/{TOKEN}/api/series?{query}"), &served.host())
            .await;
        ends.push(series.split("\r\n\r\n").nth(1).map(str::to_owned));
    }
    assert!(ends[0].as_ref().is_some_and(|text| text.len() > 10_000));
    assert_eq!(ends[0], ends[1]);
}

/// A page sees every row's neighborhood: scene, state, then rows up to the last.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn known_answer_of_a_page() {
    let served = serve().await;
    let mut page = served.page().await;
    let mut texts = Vec::new();
    let mut rows = Vec::new();
    while rows.is_empty() {
        match page.next().await.expect("goes on").expect("is read") {
            Message::Text(text) => texts.push(serde_json::from_str::<Value>(&text).expect("JSON")),
            Message::Binary(bytes) => rows.push(bytes),
            _ => {}
        }
    }
    assert_eq!(texts[0]["kind"], "line");
    assert_eq!(texts[1]["kind"], "state");
    assert_eq!(rows[0][..4], [1, 0, 0, 0]);
    page.send(Message::text(r#"{"id": 5, "do": "step"}"#))
        .await
        .expect("sends");
    let mut last = 0;
    let mut is_done = false;
    while last < 2 || !is_done {
        match page.next().await.expect("goes on").expect("is read") {
            Message::Text(text) => is_done |= text.contains("\"re\":5"),
            Message::Binary(bytes) => {
                last = u32::from_le_bytes(bytes[20..24].try_into().expect("four"))
            }
            _ => {}
        }
    }
    page.send(Message::text(r#"{"id": 6, "do": "fly"}"#))
        .await
        .expect("sends");
    loop {
        if let Message::Text(text) = page.next().await.expect("goes on").expect("is read")
            && text.contains("refused")
        {
            assert!(text.contains("\"re\":6"), "{text}");
            break;
        }
    }
}
