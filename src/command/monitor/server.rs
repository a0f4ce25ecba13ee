//! Connections, their limits, and what is at which path.
//!
//! One thread serves all connections. A connection carries one request, or those of one page that operates axes, so
//! that its place is not lost while a button is held. It is closed when its request does not come within
//! [`PATIENCE`], when its answer is not taken within [`PATIENCE`], or when a browser that watches reads nothing for
//! [`PATIENCE`]. So no client holds memory or a place for longer than that by doing nothing.

use std::{
    convert::Infallible,
    net::TcpListener,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use axum::{
    Extension, Router,
    extract::{DefaultBodyLimit, Request, State},
    http::{HeaderValue, Method, StatusCode, header},
    middleware::{Next, from_fn_with_state},
    response::{
        IntoResponse, Response,
        sse::{Event, Sse},
    },
    routing::get,
};
use futures_util::stream::{self, Stream};
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    net::TcpStream,
    sync::{Semaphore, watch},
};

use super::{
    control::{self, Control, StaysOpen},
    guard::{BODY, Guard},
    metrics,
    published::{Kind, Part, Parts, Published},
};

/// Connections at the same time; further ones are closed at once.
const MOST: usize = 64;
/// Longest time without progress of a connection.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time in which a request that operates axes must be answered.
const COMMAND_PATIENCE: Duration = Duration::from_secs(8);
/// Time between two looks at the progress of a connection.
const LOOK: Duration = Duration::from_millis(500);
/// Longest head of a request, bytes; also what is kept for a browser that reads slowly.
const HEAD: usize = 16 * 1024;
/// Headers of a request.
const MOST_HEADERS: usize = 64;
/// Pause after a connection that cannot be accepted, as when the process has no file left.
const PAUSE: Duration = Duration::from_millis(100);
/// The page may load nothing from elsewhere, and no page may show it in a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HTML: (&str, &str) = ("text/html; charset=utf-8", include_str!("page/index.html"));
const STYLE: (&str, &str) = ("text/css; charset=utf-8", include_str!("page/style.css"));
const SCRIPT: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/page.js"));
const MACHINE: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/machine.js"));
const TRENDS: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/trends.js"));
const DETAILS: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/details.js"));
const CONTROL: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/control.js"));
const PLOT: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page/uPlot.iife.min.js"));
const PLOT_STYLE: (&str, &str) = ("text/css; charset=utf-8", include_str!("page/uPlot.min.css"));
const ICON: (&str, &str) = ("image/svg+xml", include_str!("page/icon.svg"));

/// Whether a connection goes on.
#[derive(Debug)]
struct Progress {
    begin: Instant,
    /// ms from the begin to the last step.
    last_ms: AtomicU64,
}

impl Progress {
    fn new() -> Self {
        Self { begin: Instant::now(), last_ms: AtomicU64::new(0) }
    }

    fn step(&self) {
        self.last_ms.store(self.begin.elapsed().as_millis() as u64, Ordering::Relaxed);
    }

    /// Returns when there has been no step for [`PATIENCE`].
    async fn stalled(&self) {
        loop {
            tokio::time::sleep(LOOK).await;
            let last = Duration::from_millis(self.last_ms.load(Ordering::Relaxed));
            if self.begin.elapsed().saturating_sub(last) > PATIENCE {
                return;
            }
        }
    }
}

/// Serves on a thread of its own until the process ends.
///
/// # Errors
/// The system gives no thread, or no means to wait for connections.
pub fn start(
    listener: TcpListener,
    guard: Guard,
    published: Arc<Published>,
    control: Option<&Arc<Control>>,
) -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
    let listener = {
        let _inside = runtime.enter();
        tokio::net::TcpListener::from_std(listener)?
    };
    let router = routes(guard, published, control);
    let serve = move || runtime.block_on(accept(&listener, &router));
    thread::Builder::new().name("server".to_owned()).spawn(serve).map(|_| ())
}

/// Accepts connections, each with a task of its own.
async fn accept(listener: &tokio::net::TcpListener, router: &Router) {
    let places = Arc::new(Semaphore::new(MOST));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        // Without a place the connection is closed here.
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        let router = router.clone();
        tokio::spawn(async move {
            serve(stream, router).await;
            drop(place);
        });
    }
}

/// Serves one connection, until it ends or stalls.
async fn serve(stream: TcpStream, router: Router) {
    let progress = Arc::new(Progress::new());
    let service = TowerToHyperService::new(router.layer(Extension(Arc::clone(&progress))));
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .keep_alive(true)
        .max_buf_size(HEAD)
        .max_headers(MOST_HEADERS)
        .serve_connection(TokioIo::new(stream), service);
    tokio::select! {
        // Errors are those of the client.
        _ = connection => {}
        () = progress.stalled() => {}
    }
}

fn routes(guard: Guard, published: Arc<Published>, control: Option<&Arc<Control>>) -> Router {
    let file = |(kind, text): (&'static str, &'static str)| get(move || async move { (with_kind(kind), text) });
    Router::new()
        .route("/", file(HTML))
        .route("/style.css", file(STYLE))
        .route("/page.js", file(SCRIPT))
        .route("/machine.js", file(MACHINE))
        .route("/trends.js", file(TRENDS))
        .route("/details.js", file(DETAILS))
        .route("/control.js", file(CONTROL))
        .route("/uPlot.js", file(PLOT))
        .route("/uPlot.css", file(PLOT_STYLE))
        .route("/icon.svg", file(ICON))
        .route("/events", get(events))
        .route("/state", get(state))
        .route("/history", get(history))
        .route("/details", get(details))
        .route("/metrics", get(figures))
        .route("/health", get(health))
        .fallback(|| async {
            (StatusCode::NOT_FOUND, "found no such path; allowed: /, /state, /history, /metrics, /health\n")
        })
        .with_state(published)
        .merge(control.map(control::routes).unwrap_or_default())
        .layer(DefaultBodyLimit::max(BODY))
        .layer(from_fn_with_state(guard, guarded))
}

fn with_kind(kind: &'static str) -> [(header::HeaderName, HeaderValue); 1] {
    [(header::CONTENT_TYPE, HeaderValue::from_static(kind))]
}

/// Refuses requests, and adds the headers that all answers have.
async fn guarded(
    State(guard): State<Guard>,
    Extension(progress): Extension<Arc<Progress>>,
    request: Request,
    next: Next,
) -> Response {
    progress.step();
    let mut response = match guard.refusal(request.method(), request.uri(), request.headers()) {
        Some(refusal) => refusal.into_response(),
        None if request.method() == Method::POST => {
            let answer = tokio::time::timeout(COMMAND_PATIENCE, next.run(request)).await;
            answer.unwrap_or_else(|_| StatusCode::REQUEST_TIMEOUT.into_response())
        }
        None => next.run(request).await,
    };
    if response.extensions().get::<StaysOpen>().is_none() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// What a browser that watches has got.
struct Watching {
    parts: watch::Receiver<Parts>,
    /// Versions that it has got.
    got: [u64; Kind::ALL.len()],
    progress: Arc<Progress>,
}

impl Watching {
    /// The next part that it has not got.
    fn next(&mut self) -> Option<(Kind, Part)> {
        let parts = self.parts.borrow_and_update();
        let kind = Kind::ALL.into_iter().find(|kind| parts[*kind as usize].version != self.got[*kind as usize])?;
        let part = parts[kind as usize].clone();
        drop(parts);
        self.got[kind as usize] = part.version;
        Some((kind, part))
    }
}

/// The newest parts, again and again. A browser that reads slowly misses those that were replaced meanwhile.
async fn events(
    State(published): State<Arc<Published>>,
    Extension(progress): Extension<Arc<Progress>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let watching = Watching { parts: published.subscribe(), got: [0; Kind::ALL.len()], progress };
    Sse::new(stream::unfold(watching, |mut watching| async move {
        loop {
            // The stream is asked for more only when the browser has taken what was before.
            watching.progress.step();
            if let Some((kind, part)) = watching.next() {
                return Some((Ok(Event::default().event(kind.name()).data(&*part.text)), watching));
            }
            // Without a group there is nothing new for long. A page does not see comments, so this is an event.
            match tokio::time::timeout(Duration::from_secs(1), watching.parts.changed()).await {
                Ok(Ok(())) => {}
                Ok(Err(_)) => return None,
                Err(_) => return Some((Ok(Event::default().event("alive").data("{}")), watching)),
            }
        }
    }))
}

fn json(text: String) -> impl IntoResponse {
    (with_kind("application/json"), text)
}

/// The newest parts, once.
async fn state(State(published): State<Arc<Published>>) -> impl IntoResponse {
    let receiver = published.subscribe();
    let parts = receiver.borrow();
    let of = |kind: Kind| format!("\"{}\":{}", kind.name(), parts[kind as usize].text);
    json(format!("{{{}}}\n", Kind::ALL.map(of).join(",")))
}

async fn history(State(published): State<Arc<Published>>) -> impl IntoResponse {
    json(published.history().json())
}

/// Models and hops. They are listened to while somebody asks, so the first answer may be empty.
async fn details(State(published): State<Arc<Published>>) -> impl IntoResponse {
    *published.details_asked() = Some(Instant::now());
    json(published.details().clone())
}

async fn figures(State(published): State<Arc<Published>>) -> impl IntoResponse {
    let watching = published.readers();
    let text = metrics::text(published.report().as_ref(), watching);
    (with_kind("text/plain; version=0.0.4; charset=utf-8"), text)
}

/// 200 while the group is there and all its stages are heard, else 503.
async fn health(State(published): State<Arc<Published>>) -> impl IntoResponse {
    let (is_well, text) = metrics::health(published.report().as_ref());
    let status = if is_well { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    (status, json(text))
}
