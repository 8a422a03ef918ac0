//! Binary PLY as a stream: vertices go straight into the file, triangles aside into a second
//! one that is appended at the end, when the counts are known too.
//!
//! The header has a fixed length: whatever the counts leave free is filled with a comment.
//! Everything is written under a temporary name beside the output and renamed when it is
//! complete; on any error both files vanish.

use super::polygonise::Sink;
use crate::system::with_usual_rights;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// Bytes of the header.
const HEADER_BYTES: usize = 512;
/// Bytes of a triangle: a count and three indices.
const TRIANGLE_BYTES: u64 = 13;
/// Bytes of a triangle in the spool: three indices.
const SPOOLED_BYTES: u64 = 12;
const BUFFER_BYTES: usize = 1 << 20;

/// A PLY file in the making.
pub struct PlyWriter {
    file: BufWriter<NamedTempFile>,
    spool: BufWriter<File>,
    comment: String,
    vertices: u64,
    triangles: u64,
    low: [f32; 3],
    high: [f32; 3],
}

/// What was written.
pub struct Written {
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Smallest and largest coordinates.
    pub bounds: [[f32; 3]; 2],
    /// Size of the file.
    pub file_bytes: u64,
    /// Most bytes that file and spool took together.
    pub peak_disk_bytes: u64,
}

impl PlyWriter {
    /// Start a file that will lie in the folder of `out`. The comment must be one line.
    pub fn create(out: &Path, comment: &str) -> io::Result<PlyWriter> {
        let folder = match out.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".synth-").suffix(".part");
        with_usual_rights(&mut builder);
        let mut file = BufWriter::with_capacity(BUFFER_BYTES, builder.tempfile_in(folder)?);
        file.write_all(&[0; HEADER_BYTES])?;
        Ok(PlyWriter {
            file,
            spool: BufWriter::with_capacity(BUFFER_BYTES, tempfile::tempfile_in(folder)?),
            comment: comment.to_owned(),
            vertices: 0,
            triangles: 0,
            low: [f32::MAX; 3],
            high: [f32::MIN; 3],
        })
    }

    /// Triangles so far.
    pub fn triangle_count(&self) -> u64 {
        self.triangles
    }

    fn header(&self) -> Vec<u8> {
        let top = format!("ply\nformat binary_little_endian 1.0\ncomment {}\n", self.comment);
        let rest = format!(
            "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.vertices, self.triangles
        );
        let pad = HEADER_BYTES - top.len() - rest.len() - "comment \n".len();
        format!("{top}comment {}\n{rest}", ".".repeat(pad)).into_bytes()
    }

    /// Append the triangles, write the header, and give the file its name.
    pub fn finish(mut self, out: &Path, force: bool) -> io::Result<Written> {
        let vertex_bytes = 12 * self.vertices;
        let file_bytes = HEADER_BYTES as u64 + vertex_bytes + TRIANGLE_BYTES * self.triangles;
        // Copy the spool in pieces of whole triangles.
        let mut spool = self.spool.into_inner().map_err(|e| e.into_error())?;
        spool.seek(SeekFrom::Start(0))?;
        let mut spool = BufReader::with_capacity(BUFFER_BYTES, spool);
        let mut triangle = [3u8; TRIANGLE_BYTES as usize];
        for _ in 0..self.triangles {
            spool.read_exact(&mut triangle[1..])?;
            self.file.write_all(&triangle)?;
        }
        // Put the header in front.
        self.spool = BufWriter::new(spool.into_inner());
        let header = self.header();
        let mut file = self.file.into_inner().map_err(|e| e.into_error())?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&header)?;
        file.as_file().sync_all()?;
        if force {
            file.persist(out).map_err(|e| e.error)?;
        } else {
            file.persist_noclobber(out).map_err(|e| e.error)?;
        }
        Ok(Written {
            vertices: self.vertices,
            triangles: self.triangles,
            bounds: [self.low, self.high],
            file_bytes,
            peak_disk_bytes: file_bytes + SPOOLED_BYTES * self.triangles,
        })
    }
}

impl Sink for PlyWriter {
    type Error = io::Error;

    fn vertices(&mut self, vertices: &[[f32; 3]]) -> io::Result<()> {
        for v in vertices {
            for (d, value) in v.iter().enumerate() {
                self.low[d] = self.low[d].min(*value);
                self.high[d] = self.high[d].max(*value);
                self.file.write_all(&value.to_le_bytes())?;
            }
        }
        self.vertices += vertices.len() as u64;
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> io::Result<()> {
        for i in triangles.as_flattened() {
            self.spool.write_all(&i.to_le_bytes())?;
        }
        self.triangles += triangles.len() as u64;
        Ok(())
    }
}
