//! A server of HTTP on this machine, for tests: it answers as it is told, also wrongly, and keeps a log.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex};

/// A request, and the number of bytes of content that were sent for it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Request {
    pub(crate) method: String,
    /// The path with the query, as requested.
    pub(crate) target: String,
    /// The lines of headers, in lower case up to their values.
    pub(crate) headers: Vec<(String, String)>,
    /// How often the same was requested before.
    pub(crate) before: usize,
    pub(crate) sent: u64,
}

impl Request {
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(of, _)| of == name).map(|(_, value)| value.as_str())
    }

    /// The path without the query.
    pub(crate) fn path(&self) -> &str {
        self.target.split('?').next().unwrap()
    }
}

/// An answer.
#[derive(Debug, Clone)]
pub(crate) enum Answer {
    /// A file, or the requested range of it. Its tag changes with its length.
    File(Vec<u8>),
    /// A file, whatever range is requested.
    Whole(Vec<u8>),
    /// A status with lines of headers and a body.
    Status(u16, &'static str, &'static str),
    /// A file with headers that announce this many bytes more than are sent.
    Short(Vec<u8>, usize),
    /// The end of the connection without an answer.
    Nothing,
    /// Headers of a long file and then nothing, until the client has gone.
    Silent,
    /// Headers of a long file and then a byte each millisecond, until the client has gone.
    Slow,
}

impl Answer {
    /// The answer of a server of a folder.
    pub(crate) fn of_folder(folder: &str, request: &Request) -> Self {
        let path = PathBuf::from(format!("{folder}{}", request.path()));
        std::fs::read(path).map_or(Self::Status(404, "", "not here"), Self::File)
    }
}

type Answers = dyn Fn(&Request) -> Answer + Send + Sync;

/// A server that answers until it is dropped.
pub(crate) struct Server {
    /// The url of the server, without a slash at its end.
    pub(crate) url: String,
    log: Arc<Mutex<Vec<Request>>>,
    ended: Arc<AtomicBool>,
}

impl Server {
    pub(crate) fn new(answers: impl Fn(&Request) -> Answer + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let (log, ended) = (Arc::<Mutex<Vec<Request>>>::default(), Arc::<AtomicBool>::default());
        let (kept, is_over) = (Arc::clone(&log), Arc::clone(&ended));
        let answers: Arc<Answers> = Arc::new(answers);
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok).take_while(|_| !is_over.load(SeqCst)) {
                let (log, answers) = (Arc::clone(&kept), Arc::clone(&answers));
                // A client may go at any time.
                std::thread::spawn(move || drop(serve(&stream, &log, &*answers)));
            }
        });
        Self { url, log, ended }
    }

    /// A server of a folder.
    pub(crate) fn of(folder: impl Into<String>) -> Self {
        let folder = folder.into();
        Self::new(move |request| Answer::of_folder(&folder, request))
    }

    /// The requests since this was last called.
    pub(crate) fn requests(&self) -> Vec<Request> {
        std::mem::take(&mut *self.log.lock().unwrap())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ended.store(true, SeqCst);
        drop(TcpStream::connect(self.url.trim_start_matches("http://")));
    }
}

/// Answers the requests of a connection.
fn serve(mut stream: &TcpStream, log: &Mutex<Vec<Request>>, answers: &Answers) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream).lines();
    while let Some(first) = lines.next().transpose()? {
        let mut words = first.split_whitespace().map(str::to_owned);
        let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let mut headers = Vec::new();
        while let Some(line) = lines.next().transpose()?.filter(|line| !line.is_empty()) {
            let (name, value) = line.split_once(':').unwrap_or_default();
            headers.push((name.to_lowercase(), value.trim().to_owned()));
        }
        let (request, number) = {
            let mut log = log.lock().unwrap();
            let range = |of: &Request| of.header("range").map(str::to_owned);
            let mut request = Request { method, target, headers, ..Request::default() };
            let same = |of: &&Request| of.target == request.target && range(of) == range(&request);
            request.before = log.iter().filter(same).count();
            log.push(request.clone());
            (request, log.len() - 1)
        };
        let is_head = request.method == "HEAD";
        let mut send = |status: u16, more: &str, length: usize, body: &[u8]| {
            let body = if is_head { &[] } else { body };
            // It is logged before the client can ask for the log.
            if let Some(logged) = log.lock().unwrap().get_mut(number) {
                logged.sent = body.len() as u64;
            }
            let head = format!("HTTP/1.1 {status} Status\r\nContent-Length: {length}\r\n{more}\r\n");
            stream.write_all(&[head.as_bytes(), body].concat())
        };
        match answers(&request) {
            Answer::File(bytes) => {
                let tag = format!("\"{}\"", bytes.len());
                let range = request.header("range").filter(|_| request.header("if-range").is_none_or(|of| of == tag));
                let range = range.and_then(|range| ends(range.strip_prefix("bytes=")?, bytes.len()));
                match range {
                    _ if request.header("if-none-match") == Some(&tag) => send(304, "", 0, &[])?,
                    None => send(200, &format!("ETag: {tag}\r\n"), bytes.len(), &bytes)?,
                    Some((from, end)) if from < end => {
                        let line = format!("bytes {from}-{}/{}", end - 1, bytes.len());
                        let more = format!("Content-Range: {line}\r\nETag: {tag}\r\n");
                        send(206, &more, end - from, &bytes[from..end])?;
                    }
                    Some(_) => send(416, "", 0, &[])?,
                }
            }
            Answer::Whole(bytes) => send(200, "", bytes.len(), &bytes)?,
            Answer::Status(status, more, body) => send(status, more, body.len(), body.as_bytes())?,
            Answer::Short(bytes, missing) => {
                let tag = format!("ETag: \"{}\"\r\n", bytes.len() + missing);
                return send(200, &tag, bytes.len() + missing, &bytes);
            }
            Answer::Nothing => return Ok(()),
            Answer::Silent => {
                send(200, "", 1000, &[1])?;
                return stream.read_to_end(&mut Vec::new()).map(drop);
            }
            Answer::Slow => {
                send(200, "", 1000, &[1])?;
                loop {
                    stream.write_all(&[1])?;
                    std::thread::sleep(std::time::Duration::from_millis(1));
                }
            }
        }
    }
    Ok(())
}

/// The first byte of a range and the byte behind it.
fn ends(range: &str, length: usize) -> Option<(usize, usize)> {
    let (first, last) = range.split_once('-')?;
    Some(match (first.parse().ok(), last.parse::<usize>().ok()) {
        (Some(first), last) => (first, last.map_or(length, |last| (last + 1).min(length))),
        (None, Some(last)) => (length.saturating_sub(last), length),
        (None, None) => return None,
    })
}
