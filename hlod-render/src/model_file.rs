//! What a model begins with, which needs no GPU: its file, open, with the root decoded.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hlod_compress::{CellKey, FormatError, Header};

use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::loader::{GpuMesh, Loaded, Part, decode};
use crate::model::ModelLimits;
use crate::skeleton::Skeleton;
use crate::source::{Source, cache_folder};

/// A file, or one on a web server, of which the root can be drawn.
pub struct ModelFile {
    pub(crate) path: PathBuf,
    pub(crate) source: Arc<Source>,
    pub(crate) skeleton: Skeleton,
    /// The root's representations, in the skeleton's order.
    pub(crate) root: Vec<GpuMesh>,
    pub(crate) limits: ModelLimits,
    pub(crate) bytes_read: u64,
}

impl ModelFile {
    /// Opens a file, or one on a web server by its address, and reads its root.
    ///
    /// # Errors
    /// When the file is not an `.hlod` file or its front part is damaged.
    pub fn open(path: &Path, limits: ModelLimits) -> Result<ModelFile, RenderError> {
        let format = RenderError::format(path);
        let cache = limits.keep_on_disk.then(cache_folder).flatten();
        let source = Arc::new(Source::open(path, limits.host_bytes, cache.as_deref())?);
        let root_block = source.read_block(source.header().root_block).map_err(&format)?;
        let skeleton = Skeleton::new(source.header().lattice, &root_block);
        source.reserve(skeleton.bytes());
        let (root, bytes_read) = read_root(&source, &skeleton).map_err(&format)?;
        Ok(ModelFile { path: path.to_owned(), source, skeleton, root, limits, bytes_read })
    }

    /// The same while an adapter is opened, which takes about as long as a server's first answers.
    ///
    /// # Errors
    /// As [`ModelFile::open`], and when there is no adapter.
    pub fn open_beside(
        path: &Path,
        limits: ModelLimits,
        open_gpu: impl FnOnce() -> Result<Gpu, RenderError>,
    ) -> Result<(Gpu, ModelFile), RenderError> {
        std::thread::scope(|scope| {
            let file = scope.spawn(|| ModelFile::open(path, limits));
            let gpu = open_gpu();
            let file = file.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            Ok((gpu?, file))
        })
    }

    /// The file, or its address.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the file says about itself.
    pub fn header(&self) -> &Header {
        self.source.header()
    }
}

/// The root's representations and their bytes; of a server they are asked for at once.
fn read_root(source: &Source, skeleton: &Skeleton) -> Result<(Vec<GpuMesh>, u64), FormatError> {
    let parts = skeleton.nodes()[0].representations.iter();
    let parts: Vec<Part> = parts.map(|r| Part::Page(r.page, CellKey::ROOT, r.kind)).collect();
    let extents: Vec<_> = parts.iter().map(Part::extent).collect();
    let follow = extents.windows(2).all(|two| two[0].end() == two[1].offset);
    let read = match source.is_remote() && follow {
        true => source.read_run(&extents),
        false => extents.iter().map(|e| source.read(e.what, e.offset, e.count)).collect(),
    };
    let (mut meshes, mut bytes_read) = (Vec::new(), 0);
    for (part, read) in parts.iter().zip(read) {
        let (bytes, _) = read?;
        bytes_read += bytes.len() as u64;
        let decoded = decode(part, &bytes, source.header());
        match decoded.inspect_err(|_| source.forget(part.extent().offset))? {
            Loaded::Mesh(mesh) => meshes.push(*mesh),
            Loaded::Block(_) => unreachable!("a page holds a mesh"),
        }
    }
    Ok((meshes, bytes_read))
}
