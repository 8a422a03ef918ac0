//! A file on a web server, read by ranges.

use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use hlod_compress::{FormatError, HEADER_BYTES_MAX, Header};
use ureq::Agent;
use ureq::http::Response;

use super::disk_cache::DiskCache;

/// Waiting for a server, and for its answers.
const CONNECT: Duration = Duration::from_secs(5);
const ANSWER: Duration = Duration::from_secs(10);
/// A part is at most some hundred KB, in the mean 10: a link that needs longer is as good as gone.
const BODY: Duration = Duration::from_secs(20);
const REDIRECTS_MAX: u32 = 5;
/// Failed reads are tried again so often, each time after twice as long.
const RETRIES: u32 = 3;
/// And no longer than this, since a server that does not answer is asked in vain.
const PATIENCE: Duration = Duration::from_secs(8);
const FIRST_PAUSE: Duration = Duration::from_millis(150);

/// An open file.
pub(super) struct HttpFile {
    agent: Agent,
    address: String,
    header: Header,
    /// What the server calls this version of the file, if it does.
    version: Option<String>,
    cache: Option<DiskCache>,
}

/// Why there are no bytes.
enum Problem {
    /// Asking again may help.
    Passing(String),
    Lasting(String),
}

impl HttpFile {
    /// Opens a file; with it come its first bytes, as many as one question brings.
    pub(super) fn open(
        address: &str,
        cache: Option<&Path>,
    ) -> Result<(HttpFile, Vec<u8>), FormatError> {
        let agent: Agent = Agent::config_builder()
            .timeout_resolve(Some(CONNECT))
            .timeout_connect(Some(CONNECT))
            .timeout_recv_response(Some(ANSWER))
            .timeout_recv_body(Some(BODY))
            .max_redirects(REDIRECTS_MAX)
            .http_status_as_error(false)
            .user_agent(concat!("hlod-render/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        // The first bytes tell everything: how long the file is, and where its root is.
        let start = with_retries(|| fetch(&agent, address, 0, HEADER_BYTES_MAX as u64, None))?;
        let header = Header::parse(&start.bytes)?;
        if start.file_bytes < header.file_bytes {
            let (file_bytes, needed_bytes) = (start.file_bytes, header.file_bytes);
            return Err(FormatError::Truncated { what: "the file", file_bytes, needed_bytes });
        }
        // Without a name for this version nobody knows whether what was kept is still the same.
        let cache = cache.zip(start.version.as_ref()).and_then(|(folder, version)| {
            DiskCache::open(folder, &format!("{address}\n{version}"))
        });
        let address = address.to_owned();
        let file = HttpFile { agent, address, header, version: start.version, cache };
        Ok((file, start.bytes))
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// What is on disk of it.
    pub(super) fn kept(&self, offset: u64, count: u32) -> Option<Vec<u8>> {
        self.cache.as_ref().and_then(|cache| cache.get(offset, count))
    }

    /// Keeps a part on disk.
    pub(super) fn keep(&self, offset: u64, bytes: &[u8]) {
        if let Some(cache) = &self.cache {
            cache.put(offset, bytes);
        }
    }

    /// Asks the server.
    pub(super) fn read_range(
        &self,
        what: &'static str,
        offset: u64,
        count: u32,
    ) -> Result<Vec<u8>, FormatError> {
        self.header.check_range(what, offset, count)?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let version = self.version.as_deref();
        let answer =
            with_retries(|| fetch(&self.agent, &self.address, offset, u64::from(count), version))?;
        if answer.bytes.len() != count as usize {
            let (found, wanted) = (answer.bytes.len(), count);
            return Err(lasting(format!("the server sent {found} of {wanted} bytes")));
        }
        Ok(answer.bytes)
    }

    pub(super) fn forget(&self, offset: u64) {
        if let Some(cache) = &self.cache {
            cache.forget(offset);
        }
    }
}

/// A server's answer.
struct Answer {
    bytes: Vec<u8>,
    /// Of the whole file.
    file_bytes: u64,
    version: Option<String>,
}

/// Asks until there is an answer or no hope.
fn with_retries(ask: impl Fn() -> Result<Answer, Problem>) -> Result<Answer, FormatError> {
    let (mut pause, begin) = (FIRST_PAUSE, Instant::now());
    for attempt in 0.. {
        match ask() {
            Ok(answer) => return Ok(answer),
            Err(Problem::Lasting(why)) => return Err(lasting(why)),
            Err(Problem::Passing(why)) if attempt == RETRIES || begin.elapsed() > PATIENCE => {
                return Err(FormatError::Io(io::Error::new(io::ErrorKind::NotConnected, why)));
            }
            Err(Problem::Passing(_)) => {
                std::thread::sleep(pause);
                pause *= 2;
            }
        }
    }
    unreachable!("the loop ends by itself")
}

/// Neither the link nor patience helps.
fn lasting(why: String) -> FormatError {
    FormatError::Io(io::Error::new(io::ErrorKind::InvalidData, why))
}

/// Asks once for bytes of a file, of a known version if there is one.
fn fetch(
    agent: &Agent,
    address: &str,
    offset: u64,
    count: u64,
    version: Option<&str>,
) -> Result<Answer, Problem> {
    let last = offset + count - 1;
    let request = agent.get(address).header("Range", format!("bytes={offset}-{last}"));
    let mut response = request.call().map_err(|error| match error {
        ureq::Error::TooManyRedirects => {
            Problem::Lasting(format!("the server leads round in circles ({REDIRECTS_MAX} times)"))
        }
        ureq::Error::BadUri(why) => Problem::Lasting(format!("no address: {why}")),
        other => Problem::Passing(format!("no connection to the server: {other}")),
    })?;
    let status = response.status().as_u16();
    match status {
        206 => {}
        200 => {
            return Err(Problem::Lasting(
                "the server sends whole files only; it must answer requests with a Range".into(),
            ));
        }
        404 | 410 => return Err(Problem::Lasting("there is no such file on the server".into())),
        401 | 403 => return Err(Problem::Lasting("the server does not let us read it".into())),
        416 => return Err(Problem::Lasting("the file on the server became shorter".into())),
        408 | 429 | 500..=599 => {
            return Err(Problem::Passing(format!("the server answered {status}")));
        }
        _ => return Err(Problem::Lasting(format!("the server answered {status}"))),
    }
    let found = version_of(&response);
    if version.is_some() && found.as_deref() != version {
        return Err(Problem::Lasting("the file on the server was replaced; open it again".into()));
    }
    let (first, end, file_bytes) = content_range(&response)
        .ok_or_else(|| Problem::Lasting("the server does not say which bytes it sends".into()))?;
    let expected = (last + 1).min(file_bytes);
    if first != offset || end != expected {
        let why =
            format!("the server sent bytes {first} to {end} instead of {offset} to {expected}");
        return Err(Problem::Lasting(why));
    }
    // One more than expected, to see whether there is more.
    let length = expected - offset;
    let body = response.body_mut().with_config().limit(length + 1).read_to_vec();
    let bytes = body.map_err(|error| Problem::Passing(format!("the answer broke off: {error}")))?;
    if bytes.len() as u64 != length {
        let why = format!("the answer has {} bytes instead of {length}", bytes.len());
        return Err(Problem::Passing(why));
    }
    Ok(Answer { bytes, file_bytes, version: found })
}

/// First byte, the one behind the last, and the file's length, of `bytes 0-99/1000`.
fn content_range<T>(response: &Response<T>) -> Option<(u64, u64, u64)> {
    let text = response.headers().get("content-range")?.to_str().ok()?;
    let (range, total) = text.strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = range.split_once('-')?;
    let (first, last): (u64, u64) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
    Some((first, last.checked_add(1)?, total.trim().parse().ok()?))
}

/// What tells versions of a file apart.
fn version_of<T>(response: &Response<T>) -> Option<String> {
    let of = |name| response.headers().get(name)?.to_str().ok().map(str::to_owned);
    of("etag").or_else(|| of("last-modified"))
}
