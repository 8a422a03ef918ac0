//! A library's reader on a thread of its own.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use crate::error::{Place, ScanError, Spot};
use crate::report::{ScanReport, Station};
use crate::texture::ColourTaken;
use crate::{Batch, Opened, ReadBatches, VertexBatch};

/// Batches that wait to be taken.
const WAITING: usize = 2;

/// What the thread sends.
pub(super) struct Part {
    pub(super) batch: VertexBatch,
    /// Points passed over since the part before.
    pub(super) invalid: u64,
    /// Scans that begin with the next point after this part.
    pub(super) station: Option<Option<[f64; 3]>>,
    /// What is to be said of the file.
    pub(super) remark: Option<String>,
    /// Which share of the file is read, 0..1.
    pub(super) share: f64,
}

impl Part {
    /// Points alone.
    pub(super) fn new(batch: VertexBatch, share: f64) -> Part {
        Part { batch, invalid: 0, station: None, remark: None, share }
    }
}

/// Where the thread sends to; `false` says that nobody wants more.
pub(super) struct Sender(SyncSender<Result<Part, ScanError>>);

impl Sender {
    pub(super) fn send(&self, part: Part) -> bool {
        self.0.send(Ok(part)).is_ok()
    }
}

struct Threaded {
    path: PathBuf,
    receiver: Receiver<Result<Part, ScanError>>,
    thread: Option<JoinHandle<()>>,
    vertices: u64,
    file_bytes: u64,
    share: f64,
}

/// Runs `read` on a thread and hands out what it sends. `scalars` names all numbers that points have here.
pub(super) fn start(
    path: &Path,
    file_bytes: u64,
    (has_colours, scalars): (bool, Vec<String>),
    report: &mut ScanReport,
    read: impl FnOnce(&Sender) -> Result<(), ScanError> + Send + 'static,
) -> Opened {
    if has_colours {
        report.colours.taken = ColourTaken::Vertex;
    }
    let (sender, receiver) = sync_channel(WAITING);
    let thread = std::thread::spawn(move || {
        let sender = Sender(sender);
        if let Err(error) = read(&sender) {
            // Whoever has gone does not want to know.
            let _ = sender.0.send(Err(error));
        }
    });
    Opened {
        vertices: None,
        faces: None,
        has_normals: false,
        has_colours,
        is_triangle_soup: false,
        is_point_cloud: true,
        scalars,
        body: Box::new(Threaded {
            path: path.to_path_buf(),
            receiver,
            thread: Some(thread),
            vertices: 0,
            file_bytes,
            share: 0.0,
        }),
    }
}

/// Says which numbers of points are not kept.
pub(super) fn report_left_out(names: &[String], keep: &[String], report: &mut ScanReport) {
    let left_out = names.iter().filter(|name| !keep.contains(name)).cloned().collect::<Vec<_>>();
    if !left_out.is_empty() {
        report.skipped.push(format!("of points: {}", left_out.join(", ")));
    }
}

impl ReadBatches for Threaded {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        loop {
            let Ok(part) = self.receiver.recv() else {
                return match self.thread.take().map(JoinHandle::join) {
                    Some(Err(_)) => {
                        let at = Spot::new(&self.path, Place::File);
                        let what =
                            "the library that reads this format gave up; the file is damaged";
                        Err(ScanError::malformed(at, what))
                    }
                    _ => Ok(None),
                };
            };
            let part = part?;
            self.share = part.share;
            report.points_invalid += part.invalid;
            report.warnings.extend(part.remark);
            if let Some(position) = part.station {
                report.stations.push(Station { first_vertex: self.vertices, position });
            }
            self.vertices += part.batch.positions.len() as u64;
            if self.vertices > u64::from(u32::MAX) {
                let at = Spot::new(&self.path, Place::File);
                return Err(ScanError::TooManyVertices { at, vertices: self.vertices });
            }
            if !part.batch.positions.is_empty() {
                return Ok(Some(Batch::Vertices(part.batch)));
            }
        }
    }

    fn bytes_read(&self) -> u64 {
        (self.share * self.file_bytes as f64) as u64
    }
}
