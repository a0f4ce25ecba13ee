//! Which requests are refused.
//!
//! A page from elsewhere, open in the same browser, must neither read the machine's state nor reach this server under a
//! name of its own (DNS rebinding). So the name in a request must be an address, `localhost`, or a name that the user
//! has given; and a request that another page has caused is refused.

use std::net::IpAddr;

use axum::http::{HeaderMap, HeaderName, Method, StatusCode, Uri, header};

/// Begin of the paths that operate axes.
const CONTROL: &str = "/control/";
/// Longest body of a request that operates axes, bytes.
pub const BODY: usize = 1024;

/// What the browser says about the page that has caused a request.
const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// The names under which the server may be asked.
#[derive(Debug, Clone)]
pub struct Guard {
    names: Vec<String>,
    /// Axes may be operated.
    controls: bool,
}

impl Guard {
    /// Besides all addresses and `localhost`, these names. `controls`: axes may be operated.
    pub fn new(names: &[String], controls: bool) -> Self {
        Self { names: names.iter().map(|name| name.to_ascii_lowercase()).collect(), controls }
    }

    /// Why a request is refused, if it is.
    pub fn refusal(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Option<(StatusCode, &'static str)> {
        let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        if self.controls && *method == Method::POST && uri.path().starts_with(CONTROL) {
            return no_command(headers).or_else(|| self.foreign(uri, headers));
        }
        if *method != Method::GET && *method != Method::HEAD {
            return Some((StatusCode::METHOD_NOT_ALLOWED, "found another method; allowed: GET, HEAD\n"));
        }
        let has_body = text(&header::CONTENT_LENGTH).is_some_and(|length| length.trim() != "0");
        if has_body || headers.contains_key(header::TRANSFER_ENCODING) {
            return Some((StatusCode::PAYLOAD_TOO_LARGE, "found a request with a body; allowed: none\n"));
        }
        self.foreign(uri, headers)
    }

    /// Why a request is not one of the server's own pages, if it is not.
    fn foreign(&self, uri: &Uri, headers: &HeaderMap) -> Option<(StatusCode, &'static str)> {
        let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let Some(host) = text(&header::HOST) else {
            return Some((StatusCode::BAD_REQUEST, "found no Host; allowed: the address of the server\n"));
        };
        // A request line may name a server, too (RFC 9112, 3.2.2): that one counts, and must be the one of Host.
        let is_another = uri.authority().is_some_and(|named| !named.as_str().eq_ignore_ascii_case(host));
        if headers.get_all(header::HOST).iter().count() > 1 || is_another || !self.is_own(host) {
            return Some((
                StatusCode::MISDIRECTED_REQUEST,
                "found a name that is not the server's; allowed: its address, localhost, or a name of --host\n",
            ));
        }
        let is_same =
            |origin: &str| origin.split_once("://").is_some_and(|(_, origin)| origin.eq_ignore_ascii_case(host));
        let is_foreign = text(&header::ORIGIN).is_some_and(|origin| !is_same(origin));
        // A link on another page may lead here, so a navigation is no request of that page.
        let is_navigation = text(&HeaderName::from_static("sec-fetch-mode")) == Some("navigate");
        let is_cross = matches!(text(&FETCH_SITE), Some("cross-site" | "same-site")) && !is_navigation;
        (is_foreign || is_cross)
            .then_some((StatusCode::FORBIDDEN, "found a request of another page; allowed: those of this page\n"))
    }

    /// Whether a Host, with or without a port, is this server.
    fn is_own(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
            _ => host,
        };
        let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        let name = name.to_ascii_lowercase();
        address.parse::<IpAddr>().is_ok() || name == "localhost" || self.names.contains(&name)
    }
}

/// Why a request cannot be one that operates axes, if it cannot. A browser sends Origin with each of them, and asks
/// before it sends JSON to another server.
fn no_command(headers: &HeaderMap) -> Option<(StatusCode, &'static str)> {
    let one = |name: HeaderName| {
        let mut all = headers.get_all(name).iter();
        let first = all.next().and_then(|value| value.to_str().ok());
        first.filter(|_| all.next().is_none())
    };
    let length = one(header::CONTENT_LENGTH).and_then(|length| length.parse::<usize>().ok());
    if one(header::ORIGIN).is_none() {
        return Some((StatusCode::FORBIDDEN, "found no Origin; allowed: requests of the page\n"));
    }
    if one(header::CONTENT_TYPE) != Some("application/json") {
        return Some((StatusCode::UNSUPPORTED_MEDIA_TYPE, "found another type; allowed: application/json\n"));
    }
    if length.is_none_or(|length| length > BODY) || headers.contains_key(header::TRANSFER_ENCODING) {
        return Some((StatusCode::PAYLOAD_TOO_LARGE, "found no length, or a long body; allowed: 1 kB\n"));
    }
    None
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn status(method: Method, headers: &[(&'static str, &'static str)]) -> u16 {
        refusal(false, method, "/state", headers)
    }

    fn refusal(controls: bool, method: Method, uri: &str, headers: &[(&'static str, &'static str)]) -> u16 {
        let guard = Guard::new(&["Cab.local".to_owned()], controls);
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_static(value));
        }
        guard.refusal(&method, &uri.parse().unwrap(), &map).map_or(200, |(status, _)| status.as_u16())
    }

    #[test]
    fn addresses_and_names_of_the_server_are_taken() {
        for host in ["127.0.0.1:8787", "localhost", "LOCALHOST:80", "[::1]:8787", "192.168.0.7", "cab.local:8787"] {
            assert_eq!(status(Method::GET, &[("host", host)]), 200, "{host}");
        }
        for host in ["evil.example", "evil.example:8787", "127.0.0.1.evil.example", "", ":", "localhost.evil"] {
            assert_eq!(status(Method::GET, &[("host", host)]), 421, "{host}");
        }
        assert_eq!(status(Method::GET, &[]), 400);
        assert_eq!(status(Method::GET, &[("host", "localhost"), ("host", "evil.example")]), 421);
    }

    #[test]
    fn requests_of_other_pages_are_refused() {
        let host = ("host", "127.0.0.1:8787");
        assert_eq!(status(Method::GET, &[host, ("origin", "http://127.0.0.1:8787")]), 200);
        for origin in ["http://evil.example", "null", "http://127.0.0.1:9999", "http://127.0.0.1:8787.evil.example"] {
            assert_eq!(status(Method::GET, &[host, ("origin", origin)]), 403, "{origin}");
        }
        assert_eq!(status(Method::GET, &[host, ("sec-fetch-site", "cross-site")]), 403);
        assert_eq!(status(Method::GET, &[host, ("sec-fetch-site", "same-origin")]), 200);
        let navigation = [host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
        assert_eq!(status(Method::GET, &navigation), 200);
    }

    #[test]
    fn a_request_line_may_name_no_other_server() {
        let host = [("host", "127.0.0.1:8787")];
        let get = |uri, headers: &[_]| refusal(false, Method::GET, uri, headers);
        for uri in ["http://127.0.0.1:8787/state", "HTTP://127.0.0.1:8787/state"] {
            assert_eq!(get(uri, &host), 200, "{uri}");
        }
        assert_eq!(get("http://CAB.local/state", &[("host", "cab.local")]), 200);
        for uri in [
            "http://evil.example/state",
            "https://evil.example:8787/state",
            "http://127.0.0.1:9999/state",
            "http://127.0.0.1:8787@evil.example/state",
            "http://evil.example@127.0.0.1:8787/state",
            "http://localhost:8787/state",
        ] {
            assert_eq!(get(uri, &host), 421, "{uri}");
        }
        assert_eq!(get("http://evil.example/state", &[("host", "evil.example")]), 421);
        assert_eq!(get("http://127.0.0.1:8787/state", &[]), 400);
    }

    #[test]
    fn axes_are_operated_by_the_own_page_only() {
        const OWN: [(&str, &str); 4] = [
            ("host", "127.0.0.1:8787"),
            ("origin", "http://127.0.0.1:8787"),
            ("content-type", "application/json"),
            ("content-length", "2"),
        ];
        let post = |controls, uri: &str, headers: &[_]| refusal(controls, Method::POST, uri, headers);
        assert_eq!(post(true, "/control/off", &OWN), 200);
        assert_eq!((post(false, "/control/off", &OWN), post(true, "/state", &OWN)), (405, 405));
        for (without, expected) in [(0, 400), (1, 403), (2, 415), (3, 413)] {
            let headers: Vec<_> = (0..4).filter(|i| *i != without).map(|i| OWN[i]).collect();
            assert_eq!(post(true, "/control/off", &headers), expected, "without {:?}", OWN[without]);
        }
        for (i, value, expected) in [
            (0, "evil.example", 421),
            (1, "http://evil.example", 403),
            (1, "null", 403),
            (2, "text/plain", 415),
            (3, "1025", 413),
            (3, "-1", 413),
        ] {
            let mut headers = OWN;
            headers[i].1 = value;
            assert_eq!(post(true, "/control/off", &headers), expected, "{value}");
        }
        assert_eq!(post(true, "http://127.0.0.1:8787/control/off", &OWN), 200);
        for path in ["off", "press", "beat", "release", "reset", "hello"] {
            assert_eq!(post(true, &format!("http://evil.example/control/{path}"), &OWN), 421, "{path}");
        }
        let with = |header| [&OWN[..], &[header]].concat();
        assert_eq!(post(true, "/control/off", &with(("sec-fetch-site", "cross-site"))), 403);
        assert_eq!(post(true, "/control/off", &with(("transfer-encoding", "chunked"))), 413);
        assert_eq!(post(true, "/control/off", &with(("origin", "http://evil.example"))), 403);
    }

    #[test]
    fn only_requests_without_a_body_are_taken() {
        let host = ("host", "127.0.0.1:8787");
        for method in [Method::POST, Method::PUT, Method::DELETE, Method::OPTIONS, Method::TRACE, Method::CONNECT] {
            assert_eq!(status(method, &[host]), 405);
        }
        assert_eq!(status(Method::HEAD, &[host]), 200);
        assert_eq!(status(Method::GET, &[host, ("content-length", "5")]), 413);
        assert_eq!(status(Method::GET, &[host, ("content-length", "0")]), 200);
        assert_eq!(status(Method::GET, &[host, ("transfer-encoding", "chunked")]), 413);
    }
}
