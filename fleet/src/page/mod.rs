//! `hydraxis-fleet page`: all machines in a browser of this computer, as `top` has them.
//!
//! | path | is |
//! |---|---|
//! | `/` | the page, with `/page.js` and `/style.css` |
//! | `/machines.json` | the rows of `top`; the page asks once a second |
//!
//! It only reads. It listens on an address of this computer, and answers under the names of this computer alone: a page
//! from elsewhere, whose name leads here, gets nothing.

use std::{
    io,
    net::{IpAddr, SocketAddr, TcpListener},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use axum::{
    Router,
    extract::{Request, State},
    http::{HeaderValue, StatusCode, header},
    middleware::{Next, from_fn},
    response::{IntoResponse, Response},
    routing::get,
};
use thiserror::Error;

use crate::{kernel::utc_ns, listen::Listener, top};

/// Time between two looks for the end.
const LOOK: Duration = Duration::from_millis(50);
/// The page may load nothing from elsewhere, and no page may show it in a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";
const HTML: (&str, &str) = ("text/html; charset=utf-8", include_str!("index.html"));
const SCRIPT: (&str, &str) = ("text/javascript; charset=utf-8", include_str!("page.js"));
const STYLE: (&str, &str) = ("text/css; charset=utf-8", include_str!("style.css"));

/// Why there is no page.
#[derive(Debug, Error)]
pub enum PageError {
    /// Other computers could reach it.
    #[error("--listen: found {0}; allowed: an address of this computer alone, as 127.0.0.1:8090 or [::1]:8090")]
    Address(SocketAddr),
    /// The address cannot be had.
    #[error("--listen {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The server has failed.
    #[error("the page: {0}")]
    Serve(#[from] io::Error),
}

/// Takes the address of the page.
///
/// # Errors
/// It is one that other computers reach, or it is taken.
pub fn bind(address: SocketAddr) -> Result<TcpListener, PageError> {
    if !address.ip().is_loopback() {
        return Err(PageError::Address(address));
    }
    TcpListener::bind(address).map_err(|source| PageError::Listen { address, source })
}

/// Serves the page until `stop` is set.
///
/// # Errors
/// The system gives no sockets or threads.
pub fn serve(listener: TcpListener, fleet: Listener, stop: Arc<AtomicBool>) -> Result<(), PageError> {
    listener.set_nonblocking(true)?;
    let file = |(kind, text): (&'static str, &'static str)| get(move || async move { with_type(kind, text) });
    let pages = Router::new()
        .route("/", file(HTML))
        .route("/page.js", file(SCRIPT))
        .route("/style.css", file(STYLE))
        .route("/machines.json", get(machines))
        .with_state(Arc::new(fleet))
        .layer(from_fn(guard));
    // One thread is enough for the browsers of one computer.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    Ok(runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        tokio::select! {
            served = axum::serve(listener, pages) => served,
            () = until(&stop) => Ok(()),
        }
    })?)
}

async fn until(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        tokio::time::sleep(LOOK).await;
    }
}

fn with_type(kind: &'static str, text: impl IntoResponse) -> Response {
    ([(header::CONTENT_TYPE, kind)], text).into_response()
}

async fn machines(State(fleet): State<Arc<Listener>>) -> Response {
    let rows = top::rows(&fleet.fleet(), utc_ns());
    match serde_json::to_string(&rows) {
        Ok(text) => with_type("application/json", text),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

/// Answers only under the names of this computer.
async fn guard(request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    if !host.is_some_and(is_own_name) {
        return (StatusCode::FORBIDDEN, "allowed: localhost, or an address of this computer\n").into_response();
    }
    let mut response = next.run(request).await;
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// Whether a Host header names this computer, with any port: a tunnel has another one.
fn is_own_name(host: &str) -> bool {
    let name = host.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map_or(host, |(name, _)| name);
    let address = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || address.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_computer_are_answered() {
        for own in ["localhost", "LocalHost:8090", "127.0.0.1:8090", "127.0.0.1", "[::1]:8090", "[::1]"] {
            assert!(is_own_name(own), "{own}");
        }
        for other in ["", "evil.example", "evil.example:8090", "10.0.0.1:8090", "localhost.evil.example", "::2", "0"] {
            assert!(!is_own_name(other), "{other}");
        }
    }

    #[test]
    fn other_computers_cannot_reach_the_page() {
        for address in ["0.0.0.0:0", "[::]:0", "10.0.0.1:0"] {
            let error = bind(address.parse().unwrap()).unwrap_err().to_string();
            assert!(error.contains("allowed: an address of this computer alone"), "{error}");
        }
        assert!(bind("127.0.0.1:0".parse().unwrap()).is_ok());
    }
}
