//! Files on web servers: as good as files on disk, and what happens where servers are not.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hlod_compress::{Children, HEADER_BYTES_MAX};
use hlod_render::framing::Framing;
use hlod_render::picture::{Canvas, PICTURE_FORMAT, take};
use hlod_render::scene::Representation;
use hlod_render::source::Source;
use hlod_render::{Gpu, Model, ModelLimits, RenderError, frame::Renderer};
use hlod_tests::{built, bumpy_ball, gpu};

use crate::pictures::shot;

/// What a server does with requests.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Manner {
    Good,
    WholeFilesOnly,
    NotFound,
    Error,
    /// Breaks off in the middle of the body.
    Drops,
    /// Sends other bytes than were asked for.
    OtherRange,
    /// Half of the body, as if it were all of it.
    ShortBody,
    /// The same, a byte a second.
    Drips,
    RedirectsForEver,
    /// The file as it was replaced by another.
    Replaced,
}

/// A static web server on this machine.
struct Server {
    address: PathBuf,
    manner: Arc<Mutex<Manner>>,
    bytes_sent: Arc<AtomicU64>,
}

impl Server {
    fn of(file: &Path) -> Server {
        let content = Arc::new(std::fs::read(file).unwrap());
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/ball.hlod", listener.local_addr().unwrap()).into();
        let manner = Arc::new(Mutex::new(Manner::Good));
        let bytes_sent = Arc::new(AtomicU64::new(0));
        let server = Server { address, manner: manner.clone(), bytes_sent: bytes_sent.clone() };
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (content, manner, sent) = (content.clone(), manner.clone(), bytes_sent.clone());
                // An error means that the client has gone.
                std::thread::spawn(move || {
                    let _ = serve(stream, &content, &manner, &sent);
                });
            }
        });
        server
    }

    fn is(&self, manner: Manner) {
        *self.manner.lock().unwrap() = manner;
    }

    /// Once nothing is being sent: the server counts what it has sent after its client may have it.
    fn sent_at_rest(&self) -> u64 {
        let mut sent = self.sent();
        loop {
            std::thread::sleep(Duration::from_millis(100));
            let now = self.sent();
            if now == std::mem::replace(&mut sent, now) {
                return sent;
            }
        }
    }

    fn sent(&self) -> u64 {
        self.bytes_sent.load(Ordering::SeqCst)
    }
}

fn serve(
    mut stream: TcpStream,
    content: &[u8],
    manner: &Mutex<Manner>,
    sent: &AtomicU64,
) -> std::io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    loop {
        let (mut line, mut range) = (String::new(), None);
        loop {
            line.clear();
            if reader.read_line(&mut line)? == 0 {
                return Ok(());
            }
            if line.trim().is_empty() {
                break;
            }
            if let Some(value) = line.to_ascii_lowercase().strip_prefix("range: bytes=") {
                let (a, b) = value.trim().split_once('-').unwrap();
                range = Some((a.parse::<usize>().unwrap(), b.parse::<usize>().unwrap()));
            }
        }
        let manner = *manner.lock().unwrap();
        let status = |status: &str| format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\n\r\n");
        match (manner, range) {
            (Manner::NotFound, _) => stream.write_all(status("404 Not Found").as_bytes())?,
            (Manner::Error, _) => stream.write_all(status("500 Oh no").as_bytes())?,
            (Manner::RedirectsForEver, _) => {
                let to = "HTTP/1.1 302 Found\r\nLocation: /round\r\nContent-Length: 0\r\n\r\n";
                stream.write_all(to.as_bytes())?;
            }
            (Manner::WholeFilesOnly, _) | (_, None) => {
                let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n", content.len());
                stream.write_all(head.as_bytes())?;
                stream.write_all(content)?;
            }
            (_, Some((first, last))) => {
                let last = last.min(content.len() - 1);
                let shift = usize::from(manner == Manner::OtherRange);
                let version = if manner == Manner::Replaced { "two" } else { "one" };
                let body = &content[first..=last];
                let length = if manner == Manner::ShortBody { body.len() / 2 } else { body.len() };
                let head = format!(
                    "HTTP/1.1 206 Partial Content\r\nETag: \"{version}\"\r\n\
                     Content-Range: bytes {}-{last}/{}\r\nContent-Length: {}\r\n\r\n",
                    first + shift,
                    content.len(),
                    length
                );
                stream.write_all(head.as_bytes())?;
                match manner {
                    Manner::Drops => {
                        stream.write_all(&body[..body.len() / 2])?;
                        return Ok(());
                    }
                    Manner::ShortBody => stream.write_all(&body[..length])?,
                    Manner::Drips => {
                        for byte in body {
                            stream.write_all(&[*byte])?;
                            std::thread::sleep(Duration::from_secs(1));
                        }
                    }
                    _ => stream.write_all(body)?,
                }
                sent.fetch_add(body.len() as u64, Ordering::SeqCst);
            }
        }
    }
}

struct Setting {
    folder: tempfile::TempDir,
    hlod: PathBuf,
    server: Server,
    gpu: Gpu,
}

fn setting() -> Setting {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&ply, bumpy_ball(100)).unwrap();
    built(&ply, &hlod, |o| o.leaf_triangles = 1500);
    let server = Server::of(&hlod);
    Setting { folder, hlod, server, gpu: gpu() }
}

/// Nothing of the machine's own cache.
fn limits() -> ModelLimits {
    ModelLimits { keep_on_disk: false, ..ModelLimits::default() }
}

/// A picture at the finest, as bytes.
fn picture(gpu: &Gpu, model: Model) -> Vec<u8> {
    let shot = shot(&Framing::of(&model), Representation::Full);
    take(gpu, &mut [model], &shot, 200, 200, 1).unwrap().0.rgba
}

#[test]
fn a_server_shows_the_same_as_a_disk() {
    let s = setting();
    let of_disk = picture(&s.gpu, Model::open(&s.gpu, &s.hlod, limits()).unwrap());
    let of_server = picture(&s.gpu, Model::open(&s.gpu, &s.server.address, limits()).unwrap());
    assert!(of_disk == of_server, "the pictures differ");
    // Each part was sent once, and the first bytes with the header again at most.
    let bytes = std::fs::metadata(&s.hlod).unwrap().len();
    assert!(s.server.sent() <= bytes + (64 << 10), "{} of {bytes} bytes", s.server.sent());
}

#[test]
fn bad_servers_are_named_within_seconds() {
    let s = setting();
    for (manner, says) in [
        (Manner::WholeFilesOnly, "whole files only"),
        (Manner::NotFound, "no such file"),
        (Manner::RedirectsForEver, "circles"),
        (Manner::OtherRange, "instead of"),
        (Manner::Error, "answered 500"),
        (Manner::Drops, "broke off"),
        (Manner::ShortBody, "bytes instead of"),
    ] {
        s.server.is(manner);
        let begin = Instant::now();
        let error = Model::open(&s.gpu, &s.server.address, limits()).err().unwrap();
        assert!(error.to_string().contains(says), "{manner:?}: {error}");
        assert!(begin.elapsed() < Duration::from_secs(8), "{manner:?}: {:?}", begin.elapsed());
    }
    let nobody: PathBuf = "http://127.0.0.1:9/ball.hlod".into();
    let error = Model::open(&s.gpu, &nobody, limits()).err().unwrap();
    assert!(error.to_string().contains("no connection"), "{error}");
    let needs = hlod_render::source::open_local(&nobody).err().unwrap();
    assert!(matches!(needs, RenderError::Usage(_)), "{needs}");
}

/// A link that fails for a while: what is there is drawn, the reason is told once, and it goes on by
/// itself.
#[test]
fn pictures_stay_while_a_server_fails_and_go_on_after() {
    let s = setting();
    let expected = picture(&s.gpu, Model::open(&s.gpu, &s.hlod, limits()).unwrap());
    for manner in [Manner::Error, Manner::Drops] {
        s.server.is(Manner::Good);
        let mut models = [Model::open(&s.gpu, &s.server.address, limits()).unwrap()];
        s.server.is(manner);
        let shot = shot(&Framing::of(&models[0]), Representation::Full);
        let canvas = Canvas::new(&s.gpu, 200, 200).unwrap();
        let mut renderer = Renderer::new(&s.gpu, PICTURE_FORMAT);
        let mut problems = Vec::new();
        let begin = Instant::now();
        while models[0].link_problem().is_none() {
            let stats = renderer.render(&s.gpu, &mut models, &shot, &canvas.targets).unwrap();
            assert!(stats.nodes > 0, "{manner:?}: nothing is drawn");
            assert!(begin.elapsed() < Duration::from_secs(30), "{manner:?}: nothing is said");
            std::thread::sleep(Duration::from_millis(10));
        }
        for _ in 0..50 {
            renderer.render(&s.gpu, &mut models, &shot, &canvas.targets).unwrap();
            problems.extend(models[0].take_problems());
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_eq!(problems.len(), 1, "{manner:?}: {problems:?}");
        s.server.is(Manner::Good);
        let begin = Instant::now();
        loop {
            let stats = renderer.render(&s.gpu, &mut models, &shot, &canvas.targets).unwrap();
            if stats.missing_parts == 0 {
                break;
            }
            assert!(begin.elapsed() < Duration::from_secs(60), "{manner:?}: it does not go on");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(models[0].link_problem().is_none());
        let [model] = models;
        assert!(picture(&s.gpu, model) == expected, "{manner:?}: another picture");
    }
}

/// A file that becomes another one: what was loaded stays, the reason is told.
#[test]
fn replaced_files_are_noticed() {
    let s = setting();
    let mut models = [Model::open(&s.gpu, &s.server.address, limits()).unwrap()];
    s.server.is(Manner::Replaced);
    let shot = shot(&Framing::of(&models[0]), Representation::Full);
    let (_, stats) = take(&s.gpu, &mut models, &shot, 200, 200, 1).unwrap();
    assert!(stats.nodes > 0 && stats.missing_parts > 0);
    let problems = models[0].take_problems();
    assert!(problems.iter().all(|p| p.contains("was replaced")), "{problems:?}");
    assert!(!problems.is_empty());
}

/// In memory, on disk, and only as long as it is the same.
#[test]
fn what_was_kept_is_not_asked_for_again() {
    let s = setting();
    let cache = s.folder.path().join("cache");
    let open = |keep_bytes| Source::open(&s.server.address, keep_bytes, Some(&cache)).unwrap();
    // Two pages that do not come with the header.
    let all = |source: &Source| {
        let mut pages = Vec::new();
        let mut blocks = vec![source.header().root_block];
        while let Some(block) = blocks.pop() {
            for node in &source.read_block(block).unwrap().nodes {
                pages.extend(node.representations.iter().map(|r| r.page));
                if let Children::Block(block) = node.children {
                    blocks.push(block);
                }
            }
        }
        pages.sort_unstable_by_key(|page| page.offset);
        let last = &pages[pages.len() - 2..];
        assert!(last[0].offset > HEADER_BYTES_MAX as u64);
        last.iter().for_each(|page| drop(source.read_page(*page).unwrap()));
        last[0]
    };
    let first = open(1 << 20);
    let before = s.server.sent_at_rest();
    all(&first);
    let once = s.server.sent_at_rest() - before;
    assert!(once > 0);
    // In memory.
    all(&first);
    assert_eq!(s.server.sent_at_rest() - before, once);
    // On disk: only the header is read.
    drop(first);
    let second = open(0);
    let before = s.server.sent_at_rest();
    let page = all(&second);
    assert_eq!(s.server.sent_at_rest(), before);
    // Damaged on disk: asked for again.
    let files = walk(&cache);
    assert!(files.len() >= 2, "{files:?}");
    for file in &files {
        let mut bytes = std::fs::read(file).unwrap();
        bytes[0] ^= 1;
        std::fs::write(file, bytes).unwrap();
    }
    assert!(second.read_page(page).is_ok());
    assert!(s.server.sent_at_rest() > before);
    // Another version has a folder of its own.
    s.server.is(Manner::Replaced);
    let before = s.server.sent_at_rest();
    all(&open(0));
    assert!(s.server.sent_at_rest() > before + once / 2);
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.flat_map(|p| if p.is_dir() { walk(&p) } else { vec![p] }).collect()
}

/// A drip: nothing waits for it but its own reader.
#[test]
fn a_drip_stalls_no_frame() {
    let s = setting();
    let mut models = [Model::open(&s.gpu, &s.server.address, limits()).unwrap()];
    s.server.is(Manner::Drips);
    let shot = shot(&Framing::of(&models[0]), Representation::Full);
    let canvas = Canvas::new(&s.gpu, 200, 200).unwrap();
    let mut renderer = Renderer::new(&s.gpu, PICTURE_FORMAT);
    let begin = Instant::now();
    for _ in 0..20 {
        let stats = renderer.render(&s.gpu, &mut models, &shot, &canvas.targets).unwrap();
        assert!(stats.nodes > 0 && stats.missing_parts > 0);
    }
    // A frame that waited for the drip would wait until it is given up.
    assert!(begin.elapsed() < Duration::from_secs(15), "{:?}", begin.elapsed());
}
