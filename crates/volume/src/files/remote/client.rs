//! Requests to servers that may be slow, busy or wrong.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use ureq::http::{HeaderMap, StatusCode};
use ureq::tls::{Certificate, PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Proxy};

use super::address::{Address, without_credentials};
use super::{CONNECTIONS, FetchOptions};
use crate::error::{Error, Hint, Result, Subject};
use crate::files::positional::read_exact_at;

/// The fewest bytes per second of an answer on average, once the first wait is over.
const SLOWEST: u64 = 4 << 10;

/// The largest file that is read whole if a server ignores requests of ranges.
const MAX_IGNORED: u64 = 64 << 20;

/// The largest number of registered urls, and of files that are kept while they do not change: a header and its data.
const MAX_URLS: usize = 64;
const MAX_FILES: usize = 2;

/// The part of a file to request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RequestPart {
    All,
    /// The bytes from an offset to the end.
    From(u64),
    /// An offset and a number of bytes.
    At(u64, u64),
    /// The last bytes.
    Last(u64),
}

impl RequestPart {
    fn header(self) -> Option<String> {
        match self {
            Self::All => None,
            Self::From(start) => Some(format!("bytes={start}-")),
            Self::At(start, length) => Some(format!("bytes={start}-{}", start.saturating_add(length) - 1)),
            Self::Last(length) => Some(format!("bytes=-{length}")),
        }
    }
}

/// Bytes of a file from an offset on, and the length of the file.
#[derive(Debug)]
pub(super) struct FilePiece {
    pub(super) start: u64,
    pub(super) bytes: Vec<u8>,
    pub(super) total: u64,
}

/// The head of an answer with content.
struct Head {
    status: StatusCode,
    /// The offset of the first byte.
    start: u64,
    /// The number of bytes, and the length of the file, if they are stated.
    length: Option<u64>,
    total: Option<u64>,
    /// The state of the file, to request it only if it has changed.
    state: Option<String>,
}

/// The failure of a request, and the wait that the server wants if it may be made again.
struct Fault(io::Error, Option<Duration>);

/// A client of one registered url.
pub(super) struct Client {
    address: Address,
    agent: Agent,
    pub(super) options: FetchOptions,
    fetched: AtomicU64,
    /// Whether S3 has denied access to a file, which it also does for missing ones.
    denied: AtomicBool,
}

/// The registered urls, the newest last.
static CLIENTS: Mutex<VecDeque<Arc<Client>>> = Mutex::new(VecDeque::new());

/// Files that were fetched whole, with their urls and their states.
static FILES: Mutex<VecDeque<(String, String, File)>> = Mutex::new(VecDeque::new());

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Registers a url, and returns its path without credentials.
pub(super) fn register(source: &Path, options: &FetchOptions) -> Result<PathBuf> {
    let text = source.to_string_lossy();
    let shown = without_credentials(&text).into_owned();
    let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let address = Address::parse(&text, &variable).map_err(|reason| Path::new(&shown).error(reason))?;
    let path = PathBuf::from(&address.shown);
    let client = Arc::new(Client::new(address, options));
    let mut clients = locked(&CLIENTS);
    clients.retain(|other| other.address.shown != client.address.shown);
    clients.push_back(client);
    if clients.len() > MAX_URLS {
        clients.pop_front();
    }
    Ok(path)
}

/// Returns the client of a path: of its url, of a url that it is in, or of one beside it.
pub(super) fn client(path: &Path) -> io::Result<Arc<Client>> {
    let find = || {
        let clients = locked(&CLIENTS);
        let text = path.to_str()?;
        let near = clients.iter().rev().filter_map(|client| Some((client.address.nearness(text)?, client)));
        near.min_by_key(|(nearness, _)| *nearness).map(|(_, client)| Arc::clone(client))
    };
    let register = || {
        register(path, &FetchOptions::default()).map_err(|e| fault(io::ErrorKind::InvalidInput, e.to_string()))?;
        find().ok_or_else(|| fault(io::ErrorKind::InvalidInput, "is no url"))
    };
    find().map_or_else(register, Ok)
}

fn fault(kind: io::ErrorKind, text: impl Into<String>) -> io::Error {
    io::Error::new(kind, text.into())
}

/// Returns a number of bytes in a unit of two digits or three.
pub(crate) fn in_bytes(bytes: u64) -> String {
    let (mut number, mut units) = (bytes as f64, ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"].iter());
    let mut unit = units.next();
    while number >= 1000.0 && units.len() > 0 {
        (number, unit) = (number / 1024.0, units.next());
    }
    let digits = usize::from(number < 10.0 && bytes >= 1000);
    format!("{number:.digits$} {}", unit.unwrap_or(&""))
}

/// Refuses to fetch more bytes for a source than its limit.
pub(crate) fn check_limit(path: &Path, bytes: u64, about: &str) -> Result<()> {
    let limit = client(path).map_err(Error::read(path))?.options.limit;
    if bytes <= limit {
        return Ok(());
    }
    let reason = format!("{about}{} to fetch, over the limit of {}", in_bytes(bytes), in_bytes(limit));
    Err(path.error(reason).hinted(Hint::RaiseFetchLimit))
}

/// Reports the fraction that is done of fetching for a path.
pub(crate) fn report(path: &Path, fraction: f64) {
    if let Ok(client) = client(path) {
        client.report(fraction);
    }
}

/// Returns whether S3 has denied access to a file of the url of a path.
pub(crate) fn is_denied(path: &Path) -> bool {
    client(path).is_ok_and(|client| client.denied.load(Relaxed))
}

/// Returns the length of a file, 0 if there is none; `None` if the server does not tell.
pub(crate) fn size(path: &Path) -> io::Result<Option<u64>> {
    let client = client(path)?;
    let url = client.address.url(&path.to_string_lossy());
    let total =
        client.again(|| Ok(client.open("HEAD", &url, RequestPart::All, None)?.map_or(Some(0), |(head, _)| head.total)));
    match total {
        // A signature may be for reading alone, and S3 denies to tell of missing files without a reason.
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => Ok(None),
        total => total,
    }
}

/// Fetches a whole file to a file without a name, and returns its length. A file that has not changed since it was last
/// fetched is not fetched again.
pub(crate) fn download(path: &Path) -> Result<(File, u64)> {
    let read = Error::read(path);
    let client = client(path).map_err(&read)?;
    let url = client.address.url(&path.to_string_lossy());
    let kept = locked(&FILES).iter().find(|(of, ..)| *of == url).map(|(_, state, ..)| state.clone());
    let mut file = tempfile::tempfile().map_err(&read)?;
    let (mut written, mut state, mut excess) = (0_u64, None::<String>, None);
    let status = client.again(|| {
        // What is there already is kept if the rest must be of the same file.
        let resumed = state.clone().filter(|_| written > 0);
        let part = if resumed.is_some() { RequestPart::From(written) } else { RequestPart::All };
        let condition = resumed.map(|state| ("if-range", state)).or(kept.clone().map(|state| ("if-none-match", state)));
        let Some((head, body)) = client.open("GET", &url, part, condition)? else {
            let denied = client.denied.load(Relaxed);
            return Ok(if denied { StatusCode::FORBIDDEN } else { StatusCode::NOT_FOUND });
        };
        if head.status == StatusCode::NOT_MODIFIED {
            return Ok(head.status);
        }
        (written, state) = (head.start, head.state.clone());
        let limit = client.options.limit;
        if let Some(total) = head.total.filter(|total| *total > limit) {
            excess = Some(total);
            return Ok(head.status);
        }
        let start = file.set_len(written).and_then(|()| file.seek(SeekFrom::Start(written)));
        start.map_err(|error| Fault(error, None))?;
        client.copy(&head, body, limit.saturating_add(1).saturating_sub(written), |bytes| {
            file.write_all(bytes)?;
            written += bytes.len() as u64;
            excess = (written > limit).then_some(written);
            client.report(head.total.map_or(0.0, |total| written as f64 / total.max(1) as f64));
            Ok(())
        })?;
        Ok(head.status)
    });
    client.report(1.0);
    let status = status.map_err(&read)?;
    if let Some(bytes) = excess {
        check_limit(path, bytes, "")?;
    }
    if status == StatusCode::NOT_MODIFIED {
        written = copied(&url, &mut file).map_err(&read)?;
    } else if !status.is_success() {
        return Err(read(fault(io::ErrorKind::NotFound, in_words(status))));
    } else if let (Some(state), Ok(file)) = (state, file.try_clone()) {
        let mut files = locked(&FILES);
        files.retain(|(of, ..)| *of != url);
        files.push_back((url, state, file));
        if files.len() > MAX_FILES {
            files.pop_front();
        }
    }
    file.rewind().map_err(&read)?;
    Ok((file, written))
}

/// Copies the kept file of a url. Its place to read at is another reader's.
fn copied(url: &str, to: &mut File) -> io::Result<u64> {
    let files = locked(&FILES);
    let Some((_, _, from)) = files.iter().find(|(of, ..)| of == url) else {
        return Err(fault(io::ErrorKind::ConnectionAborted, "the server sends no content"));
    };
    let (length, mut at) = (from.metadata()?.len(), 0);
    let mut buffer = vec![0; 1 << 20];
    while at < length {
        let part = &mut buffer[..(length - at).min(1 << 20) as usize];
        read_exact_at(from, part, at)?;
        to.write_all(part)?;
        at += part.len() as u64;
    }
    Ok(length)
}

/// Returns a status in words.
fn in_words(status: StatusCode) -> String {
    let reason = status.canonical_reason().unwrap_or("unknown status");
    format!("HTTP {} {reason}", status.as_u16())
}

/// Returns the wait before a request is made again.
fn pause(attempt: u32, wanted: Duration, first: Duration) -> Duration {
    first.saturating_mul(1 << (attempt - 1).min(6)).max(wanted).min(first.saturating_mul(64))
}

/// Returns the certificates of the file that `SSL_CERT_FILE` names, as of a proxy that opens connections.
fn certificates() -> Option<Vec<Certificate<'static>>> {
    let bytes = std::fs::read(std::env::var_os("SSL_CERT_FILE")?).ok()?;
    let certificate = |item| if let Ok(PemItem::Certificate(certificate)) = item { Some(certificate) } else { None };
    let all: Vec<Certificate<'static>> = parse_pem(&bytes).filter_map(certificate).collect();
    (!all.is_empty()).then_some(all)
}

impl Client {
    fn new(address: Address, options: &FetchOptions) -> Self {
        let timeout = Some(options.timeout);
        let tls = TlsConfig::builder().root_certs(certificates().map_or(RootCerts::WebPki, RootCerts::from)).build();
        let is_signed = address.signer.is_some();
        let agent = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_resolve(timeout)
            .timeout_connect(timeout)
            .timeout_recv_response(timeout)
            .timeout_per_read(timeout)
            .max_idle_connections(CONNECTIONS)
            .max_idle_connections_per_host(CONNECTIONS)
            // A signature is for one host.
            .max_redirects(if is_signed { 0 } else { 10 })
            .max_redirects_will_error(false)
            .tls_config(tls)
            .proxy(Proxy::try_from_env().filter(|_| !address.is_local()))
            .user_agent(concat!("voxsplat/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        Self { address, agent, options: *options, fetched: AtomicU64::new(0), denied: AtomicBool::new(false) }
    }

    fn report(&self, fraction: f64) {
        if let Some(progress) = self.options.progress {
            progress.0(self.fetched.load(Relaxed), fraction);
        }
    }

    /// Makes a request until it succeeds, or may not be made again.
    fn again<T>(&self, mut request: impl FnMut() -> Result<T, Fault>) -> io::Result<T> {
        let mut attempt = 1;
        loop {
            let Fault(error, after) = match request() {
                Ok(answer) => return Ok(answer),
                Err(fault) => fault,
            };
            let Some(after) = after else { return Err(error) };
            if attempt >= self.options.attempts {
                return Err(fault(error.kind(), format!("{error}, after {attempt} attempts")));
            }
            std::thread::sleep(pause(attempt, after, self.options.wait));
            attempt += 1;
        }
    }

    /// Fetches a part of a file, of at most `most` bytes; `None` if there is no such file. A server that ignores
    /// requests of ranges sends the whole file.
    pub(super) fn get(&self, path: &Path, part: RequestPart, most: u64) -> io::Result<Option<FilePiece>> {
        let url = self.address.url(&path.to_string_lossy());
        self.again(|| {
            let Some((head, body)) = self.open("GET", &url, part, None)? else { return Ok(None) };
            let ignored = part != RequestPart::All && head.status == StatusCode::OK;
            let most = if ignored { MAX_IGNORED } else { most };
            if head.length.is_some_and(|length| length > most) {
                let length = in_bytes(head.length.unwrap_or_default());
                let text = match ignored {
                    true => format!("the server ignores requests of ranges, and the file has {length}"),
                    false => format!("the server sends {length}, expected at most {}", in_bytes(most)),
                };
                return Err(Fault(fault(io::ErrorKind::Unsupported, text), None));
            }
            let mut bytes = Vec::new();
            self.copy(&head, body, most, |part| {
                bytes.extend_from_slice(part);
                Ok(())
            })?;
            let (start, end) = (head.start, head.start + bytes.len() as u64);
            let total = head.total.unwrap_or(end);
            let is_part = match part {
                RequestPart::All | RequestPart::From(_) => true,
                RequestPart::At(at, length) => start == at && end - start <= length,
                RequestPart::Last(length) => end == total && end - start <= length,
            };
            if !is_part && !ignored {
                return Err(Fault(fault(io::ErrorKind::Unsupported, "the server sends another range"), None));
            }
            Ok(Some(FilePiece { start, bytes, total }))
        })
    }

    /// Makes one request; `None` if there is no such file.
    fn open(
        &self,
        method: &str,
        url: &str,
        part: RequestPart,
        condition: Option<(&str, String)>,
    ) -> Result<Option<(Head, impl Read + use<>)>, Fault> {
        let mut request = if method == "HEAD" { self.agent.head(url) } else { self.agent.get(url) };
        let range = part.header();
        for (name, value) in range.iter().map(|range| ("range", range.clone())).chain(condition) {
            request = request.header(name, value);
        }
        if let Some(authorization) = &self.address.authorization {
            request = request.header("authorization", authorization);
        }
        let signed = self.address.signer.as_ref();
        for (name, value) in
            signed.map(|signer| signer.headers(method, url, range.as_deref(), SystemTime::now())).unwrap_or_default()
        {
            request = request.header(name, value);
        }
        let mut response = request.call().map_err(|error| self.fault(error))?;
        let (status, headers) = (response.status(), response.headers().clone());
        match status.as_u16() {
            200 | 206 | 304 => {}
            404 | 410 => return Ok(None),
            // A server that may be asked again states it by these.
            408 | 425 | 429 | 500 | 502 | 503 | 504 => {
                let after = text(&headers, "retry-after").and_then(|seconds| seconds.parse().ok()).unwrap_or(0);
                let error = fault(io::ErrorKind::ConnectionAborted, in_words(status));
                return Err(Fault(error, Some(Duration::from_secs(after))));
            }
            403 if is_access_denied(response.body_mut().as_reader()) => {
                self.denied.store(true, Relaxed);
                return Ok(None);
            }
            _ => {
                let region = text(&headers, "x-amz-bucket-region").filter(|_| status != StatusCode::FORBIDDEN);
                let tip = region.map_or(String::new(), |region| format!(": the bucket is in AWS_REGION={region}"));
                let kind = io::ErrorKind::PermissionDenied;
                return Err(Fault(fault(kind, in_words(status) + &tip), None));
            }
        }
        let stated = text(&headers, "content-length").and_then(|length| length.parse::<u64>().ok());
        let range = text(&headers, "content-range").and_then(|range| parsed(&range));
        let (start, length, total) = match range.filter(|_| status == StatusCode::PARTIAL_CONTENT) {
            Some((start, end, total)) => (start, Some(end - start), total),
            None => (0, stated, stated),
        };
        if let (Some(stated), Some(length)) = (stated, length.filter(|_| method == "GET"))
            && stated != length
        {
            return Err(broken(format!("the server states {stated} bytes and {length} bytes")));
        }
        let state = text(&headers, "etag").filter(|tag| !tag.starts_with("W/"));
        Ok(Some((Head { status, start, length, total, state }, response.into_body().into_reader())))
    }

    /// Passes the bytes of an answer on. Fails if they are more than `most`, fewer than announced, or too slow.
    fn copy(
        &self,
        head: &Head,
        mut body: impl Read,
        most: u64,
        mut sink: impl FnMut(&[u8]) -> io::Result<()>,
    ) -> Result<(), Fault> {
        let (begun, mut done) = (Instant::now(), 0);
        let mut buffer = vec![0; 1 << 16];
        loop {
            let read = match body.read(&mut buffer) {
                Ok(0) => break,
                Ok(read) => read,
                Err(error) => return Err(self.fault(error.into())),
            };
            done += read as u64;
            self.fetched.fetch_add(read as u64, Relaxed);
            sink(&buffer[..read]).map_err(|error| Fault(error, None))?;
            if done > most {
                let text = format!("the server sends over {}", in_bytes(most));
                return Err(Fault(fault(io::ErrorKind::Unsupported, text), None));
            }
            let late = begun.elapsed().saturating_sub(self.options.timeout);
            if late.as_secs_f64() * SLOWEST as f64 > done as f64 {
                return Err(self.late());
            }
        }
        match head.length {
            Some(length) if length != done => Err(broken(format!("{done} of {length} bytes were sent"))),
            _ => Ok(()),
        }
    }

    /// Returns the fault of a server that is too slow.
    fn late(&self) -> Fault {
        let text = format!("the server is silent or slow for over {:?}", self.options.timeout);
        Fault(fault(io::ErrorKind::TimedOut, text), Some(Duration::ZERO))
    }

    /// Returns the fault of a request without an answer.
    fn fault(&self, error: ureq::Error) -> Fault {
        let last = |kind, text: &str| Fault(fault(kind, text), None);
        match error {
            ureq::Error::Timeout(_) => self.late(),
            ureq::Error::Io(error) => match error.kind() {
                io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => self.late(),
                io::ErrorKind::ConnectionRefused => last(error.kind(), "the server refuses connections"),
                io::ErrorKind::ConnectionReset
                | io::ErrorKind::ConnectionAborted
                | io::ErrorKind::BrokenPipe
                | io::ErrorKind::UnexpectedEof
                | io::ErrorKind::Interrupted => broken(format!("the connection ends early: {error}")),
                // An unknown host, or no TLS with its server: another attempt has the same end.
                _ => last(io::ErrorKind::NotConnected, &format!("there is no connection: {error}")),
            },
            ureq::Error::Protocol(error) => broken(format!("the answer is no HTTP: {error}")),
            ureq::Error::HostNotFound => last(io::ErrorKind::HostUnreachable, "there is no such host"),
            ureq::Error::BadUri(_) | ureq::Error::Http(_) => last(io::ErrorKind::Unsupported, "the url is malformed"),
            other => last(io::ErrorKind::ConnectionAborted, &without_credentials(&other.to_string())),
        }
    }
}

/// Returns the fault of a connection or an answer that may succeed the next time.
fn broken(text: String) -> Fault {
    Fault(fault(io::ErrorKind::ConnectionAborted, text), Some(Duration::ZERO))
}

/// Returns whether S3 says with a status of 403 that the reader may not know whether there is such a file. Wrong keys
/// and signatures have other codes.
fn is_access_denied(body: impl Read) -> bool {
    let mut text = Vec::new();
    drop(body.take(1 << 16).read_to_end(&mut text));
    String::from_utf8_lossy(&text).contains("<Code>AccessDenied</Code>")
}

/// Returns the value of a header.
fn text(headers: &HeaderMap, name: &str) -> Option<String> {
    Some(headers.get(name)?.to_str().ok()?.trim().to_owned())
}

/// Returns the start, the end and the length of the file of `bytes FIRST-LAST/LENGTH`.
fn parsed(range: &str) -> Option<(u64, u64, Option<u64>)> {
    let (range, total) = range.strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = range.split_once('-')?;
    let (first, end) = (first.parse::<u64>().ok()?, last.parse::<u64>().ok()?.checked_add(1)?);
    (first <= end).then_some((first, end, total.parse().ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_a_bound() {
        let [first, none, long] = [500, 0, 5000].map(Duration::from_millis);
        assert_eq!([1, 2, 6, 99].map(|n| pause(n, none, first).as_millis()), [500, 1000, 16_000, 32_000]);
        assert_eq!(pause(1, long, first), long);
        assert_eq!(pause(1, Duration::from_secs(3600), first).as_secs(), 32);
    }

    #[test]
    fn ranges_and_bytes_in_words() {
        assert_eq!(parsed("bytes 5-9/100"), Some((5, 10, Some(100))));
        assert_eq!(parsed("bytes 0-0/*"), Some((0, 1, None)));
        for bad in ["bytes 9-5/10", "5-9/10", "bytes */10", "bytes 0-18446744073709551615/1"] {
            assert_eq!(parsed(bad), None, "{bad}");
        }
        let sizes = [5, 1000, 3 << 20, 1_500_000_000, u64::MAX].map(in_bytes);
        assert_eq!(sizes, ["5 bytes", "1.0 KiB", "3.0 MiB", "1.4 GiB", "16 EiB"]);
    }
}
