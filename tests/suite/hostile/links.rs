//! Servers that send what was not asked for, or do not send what was: neither memory nor time without end.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use hlod_render::source::Source;
use hlod_tests::{built, bumpy_ball};

type Answer = fn(&mut TcpStream, &[u8]) -> std::io::Result<()>;

/// A server that answers every request so; its address.
fn server(content: Vec<u8>, answer: Answer) -> PathBuf {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/ball.hlod", listener.local_addr().unwrap()).into();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let content = content.clone();
            // An error means that the client has gone.
            std::thread::spawn(move || -> std::io::Result<()> {
                let mut reader = BufReader::new(stream.try_clone()?);
                loop {
                    let mut line = String::new();
                    while reader.read_line(&mut line)? > 2 {
                        line.clear();
                    }
                    answer(&mut stream, &content)?;
                }
            });
        }
    });
    address
}

/// The first bytes of a file, as a client asks for them.
fn head(content: &[u8], total: u64) -> String {
    format!(
        "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-{}/{total}\r\n",
        content.len().min(65536) - 1
    )
}

const CASES: [(&str, &str, Answer); 9] = [
    ("silence", "no connection", |_, _| {
        std::thread::sleep(Duration::from_secs(60));
        Ok(())
    }),
    ("headers without end", "no connection", |stream, _| {
        stream.write_all(b"HTTP/1.1 206 Partial Content\r\n")?;
        loop {
            stream.write_all(b"X-More: more and more and more and more\r\n")?;
        }
    }),
    ("a line without end", "no connection", |stream, _| {
        loop {
            stream.write_all(&[b'a'; 4096])?;
        }
    }),
    ("a body without end", "broke off", |stream, content| {
        let head = head(content, content.len() as u64);
        stream.write_all(format!("{head}Connection: close\r\n\r\n").as_bytes())?;
        loop {
            stream.write_all(&[7; 65536])?;
        }
    }),
    ("chunks without end", "broke off", |stream, content| {
        let head = head(content, content.len() as u64);
        stream.write_all(format!("{head}Transfer-Encoding: chunked\r\n\r\n").as_bytes())?;
        loop {
            stream.write_all(b"4\r\nabcd\r\n")?;
        }
    }),
    ("a length that is none", "no connection", |stream, content| {
        let head = head(content, content.len() as u64);
        stream.write_all(format!("{head}Content-Length: -5\r\n\r\n").as_bytes())
    }),
    ("a range that overflows", "which bytes", |stream, _| {
        stream.write_all(
            b"HTTP/1.1 206 P\r\nContent-Range: bytes 0-18446744073709551615/9\r\nContent-Length: 0\r\n\r\n",
        )
    }),
    ("another protocol", "round in circles", |stream, _| {
        stream.write_all(
            b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n",
        )
    }),
    ("nothing", "", |stream, _| {
        stream
            .write_all(b"HTTP/1.1 206 P\r\nContent-Range: bytes 0-0/0\r\nContent-Length: 0\r\n\r\n")
    }),
];

fn content() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|name| folder.path().join(name));
    std::fs::write(&ply, bumpy_ball(40)).unwrap();
    built(&ply, &hlod, |o| o.leaf_triangles = 300);
    std::fs::read(hlod).unwrap()
}

#[test]
fn servers_without_measure_are_given_up() {
    let content = content();
    let opened = CASES.map(|(what, says, answer)| {
        let address = server(content.clone(), answer);
        std::thread::spawn(move || {
            let begin = Instant::now();
            let said = Source::open(&address, 1 << 20, None).err().map(|error| error.to_string());
            (what, says, said, begin.elapsed())
        })
    });
    for opened in opened {
        let (what, says, said, took) = opened.join().unwrap();
        let said = said.unwrap_or_else(|| panic!("{what}: it was opened"));
        assert!(said.contains(says), "{what}: {said}");
        // Ten seconds for an answer, twenty for a body; three times that on a busy machine.
        assert!(took < Duration::from_secs(90), "{what}: {took:?}");
    }
}

/// A file that is longer than its header says, by a server's word: nothing more is asked for.
#[test]
fn a_length_that_is_exaggerated_changes_nothing() {
    let address = server(content(), |stream, content| {
        let part = &content[..content.len().min(65536)];
        let head = head(content, u64::MAX);
        let length = format!("Content-Length: {}\r\n\r\n", part.len());
        stream.write_all(format!("{head}{length}").as_bytes())?;
        stream.write_all(part)
    });
    // Its first bytes are all it has: the range asked for is longer, which is no answer to it.
    match Source::open(&address, 1 << 20, None) {
        Ok(source) => assert!(source.header().file_bytes < 1 << 30),
        Err(error) => assert!(error.to_string().contains("instead of"), "{error}"),
    }
}
