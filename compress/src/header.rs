//! The first bytes of a file: what it is, where it came from, how it is laid out.

use crate::bytes::{ByteReader, ByteWriter};
use crate::{
    BlockRef, FormatError, Lattice, METADATA_BYTES_MAX, MetadataRef, Primitives, SCALARS_MAX,
    ScalarRange, SignedAxis, Unit,
};

const MAGIC: [u8; 8] = *b"HLOD\r\n\x1a\n";

/// The newest version that this crate writes. Files of every version from 1 on stay readable; files of each are
/// kept as a test. Numbers from 0xffff0000 on, and 0, were forms that were not frozen: those files are refused.
///
/// A file is of the oldest version that can say what is in it ([`Header::format_version`]), so that programs
/// that know no newer one go on reading what they could read.
///
/// | version | since then there are |
/// |---|---|
/// | 1 | triangles, points, normals, colours |
/// | 2 | metadata |
/// | 3 | kept scalars |
pub const FORMAT_VERSION: u32 = 3;

/// No header is longer; a first read of this size always holds all of it.
pub const HEADER_BYTES_MAX: usize = 64 * 1024;

/// magic, version, length, checksum
const PREFIX_BYTES: usize = 8 + 4 + 4 + 4;

/// A file that the model was built from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceFile {
    /// Name without folders.
    pub base_name: String,
    /// Size in bytes.
    pub file_bytes: u64,
    /// SHA-256 of the whole file.
    pub sha256: [u8; 32],
}

/// How an attribute's values are stored.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum AttributeType {
    /// A unit vector, [`crate::OctNormal`].
    OctNormal,
    /// Four bytes: sRGB and alpha; averaged in linear light.
    Srgba8,
    /// A number or none, [`crate::Scalars`]: the first declared is the first of them.
    Scalar(ScalarRange),
}

impl AttributeType {
    fn write(&self, w: &mut ByteWriter) {
        match self {
            AttributeType::OctNormal => w.u8(1),
            AttributeType::Srgba8 => w.u8(2),
            AttributeType::Scalar(_) => w.u8(3),
        }
    }
}

/// What carries an attribute's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[repr(u8)]
pub enum AttributeDomain {
    /// One value a vertex.
    Vertex = 1,
    /// One value a triangle corner.
    Corner = 2,
    /// One value a primitive.
    Primitive = 3,
    /// One value a point.
    Point = 4,
}

/// An attribute that pages carry.
#[derive(Debug, Clone, PartialEq)]
pub struct AttributeDeclaration {
    /// Its name, as in `normal`, `colour`.
    pub name: String,
    /// How values are stored.
    pub kind: AttributeType,
    /// What carries them.
    pub domain: AttributeDomain,
}

/// Where a page's bytes lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageRef {
    /// First byte in the file.
    pub offset: u64,
    /// Length in bytes.
    pub page_bytes: u32,
    /// CRC-32 of those bytes.
    pub crc32: u32,
}

/// Everything that has to be known before the octree is read.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Unit of the source's coordinates.
    pub unit: Unit,
    /// Which source axis points up.
    pub up: SignedAxis,
    /// Which source axis points towards the viewer of the statue's front.
    pub front: SignedAxis,
    /// The lattice of all positions.
    pub lattice: Lattice,
    /// Tight bounds of all geometry in lattice steps.
    pub bounds: [[i32; 3]; 2],
    /// The files the model was built from.
    pub sources: Vec<SourceFile>,
    /// Triangles read from the sources, degenerate ones included.
    pub triangles_input: u64,
    /// Points read from the sources, where they have no triangles.
    pub points_input: u64,
    /// Build option R: a node's error budget is its cell's edge divided by this.
    pub resolution: u32,
    /// Build option T: no leaf holds more triangles, or points.
    pub leaf_triangles: u32,
    /// Build option: differences of normals below this many times the normals' noise in a node did
    /// not count as shading.
    pub normal_noise: f32,
    /// Build option: what levels above the leaves are drawn with.
    pub primitives: Primitives,
    /// Build option: what drawing a point was taken to cost, in triangles.
    pub point_cost: f32,
    /// Attributes that pages carry.
    pub attributes: Vec<AttributeDeclaration>,
    /// Number of octree nodes.
    pub nodes: u64,
    /// Bytes of all skeleton blocks.
    pub skeleton_bytes: u64,
    /// The block that holds the root node.
    pub root_block: BlockRef,
    /// Where the front part ends: one read of this length gives header, root block and the
    /// root's pages.
    pub front_bytes: u64,
    /// What is known of the scan besides its shape, where someone said it; at the end of the file.
    pub metadata: Option<MetadataRef>,
    /// Length of the whole file; a shorter one is truncated.
    pub file_bytes: u64,
}

impl Header {
    /// The version of a file with this header: the oldest that can say what is in it.
    pub fn format_version(&self) -> u32 {
        let scalars = self.scalars().next().map(|_| 3);
        let metadata = self.metadata.as_ref().map(|_| 2);
        scalars.or(metadata).unwrap_or(1)
    }

    /// The kept scalars, by name, in the order of [`crate::Scalars`].
    pub fn scalars(&self) -> impl Iterator<Item = (&str, &ScalarRange)> {
        self.attributes.iter().filter_map(|attribute| match &attribute.kind {
            AttributeType::Scalar(range) => Some((attribute.name.as_str(), range)),
            _ => None,
        })
    }

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u8(self.unit as u8);
        for axis in [self.up, self.front] {
            w.u8(axis.axis);
            w.u8(u8::from(axis.negative));
        }
        for value in self.lattice.origin {
            w.f64(value);
        }
        w.f64(self.lattice.step);
        w.u32(self.lattice.root_units);
        w.u8(self.lattice.depth_max);
        w.vec3_i32(self.bounds[0]);
        w.vec3_i32(self.bounds[1]);
        w.u64(self.triangles_input);
        w.u64(self.points_input);
        w.u32(self.resolution);
        w.u32(self.leaf_triangles);
        w.f32(self.normal_noise);
        w.u8(self.primitives as u8);
        w.f32(self.point_cost);
        w.u64(self.nodes);
        w.u64(self.skeleton_bytes);
        self.root_block.write(&mut w);
        w.u64(self.front_bytes);
        w.u64(self.file_bytes);
        w.u16(self.attributes.len() as u16);
        for attribute in &self.attributes {
            w.string(&attribute.name);
            attribute.kind.write(&mut w);
            w.u8(attribute.domain as u8);
            if let AttributeType::Scalar(range) = &attribute.kind {
                range.write(&mut w);
            }
        }
        w.u16(self.sources.len() as u16);
        for source in &self.sources {
            w.string(&source.base_name);
            w.u64(source.file_bytes);
            w.put(&source.sha256);
        }
        let version = self.format_version();
        if version >= 2 {
            w.u8(u8::from(self.metadata.is_some()));
            if let Some(MetadataRef { offset, text_bytes, crc32 }) = self.metadata {
                w.u64(offset);
                w.u32(text_bytes);
                w.u32(crc32);
            }
        }
        Header::with_prefix(version, &w.bytes)
    }

    /// That bytes lie within the file.
    ///
    /// # Errors
    /// When they do not.
    pub fn check_range(
        &self,
        what: &'static str,
        offset: u64,
        count: u32,
    ) -> Result<(), FormatError> {
        let needed_bytes = offset.saturating_add(u64::from(count));
        if needed_bytes > self.file_bytes {
            let file_bytes = self.file_bytes;
            return Err(FormatError::Truncated { what, file_bytes, needed_bytes });
        }
        Ok(())
    }

    /// Signature, version, length and checksum in front of a header's body. For fuzzing, too, which
    /// would never guess a checksum.
    #[doc(hidden)]
    pub fn with_prefix(version: u32, body: &[u8]) -> Vec<u8> {
        let mut prefix = ByteWriter::default();
        prefix.put(&MAGIC);
        prefix.u32(version);
        prefix.u32(body.len() as u32);
        prefix.u32(crc32fast::hash(body));
        prefix.put(body);
        prefix.bytes
    }

    /// Reads a header from the first bytes of a file: all of it, or [`HEADER_BYTES_MAX`].
    ///
    /// # Errors
    /// When the bytes are no header, are one of a version later than [`FORMAT_VERSION`], are damaged, or
    /// contradict themselves.
    pub fn parse(file_start: &[u8]) -> Result<Header, FormatError> {
        // The signature and the version come before anything that depends on them.
        let mut r = ByteReader::new("header", file_start);
        if r.remaining() < MAGIC.len() || r.take(MAGIC.len())? != MAGIC {
            return Err(FormatError::NotHlod);
        }
        let version = r.u32()?;
        if !(1..=FORMAT_VERSION).contains(&version) {
            return Err(FormatError::Version { found: version, expected: FORMAT_VERSION });
        }
        let body_bytes = r.u32()? as usize;
        let expected = r.u32()?;
        if body_bytes > HEADER_BYTES_MAX - PREFIX_BYTES {
            return Err(FormatError::malformed("header", format!("{body_bytes} bytes long")));
        }
        if r.remaining() < body_bytes {
            return Err(FormatError::Truncated {
                what: "header",
                file_bytes: file_start.len() as u64,
                needed_bytes: (PREFIX_BYTES + body_bytes) as u64,
            });
        }
        let body = r.take(body_bytes)?;
        let found = crc32fast::hash(body);
        if found != expected {
            let offset = PREFIX_BYTES as u64;
            return Err(FormatError::Checksum { what: "header", offset, found, expected });
        }
        Self::parse_body(version, body)
    }

    fn parse_body(version: u32, body: &[u8]) -> Result<Header, FormatError> {
        let bad = |why: &str| FormatError::malformed("header", why);
        let mut r = ByteReader::new("header", body);
        let unit = r.u8()?;
        let unit = Unit::ALL.get(usize::from(unit)).ok_or_else(|| bad("unknown unit"))?.0;
        let mut axis = || -> Result<SignedAxis, FormatError> {
            let (axis, negative) = (r.u8()?, r.u8()?);
            if axis > 2 || negative > 1 {
                return Err(bad("not an axis"));
            }
            Ok(SignedAxis { axis, negative: negative == 1 })
        };
        let (up, front) = (axis()?, axis()?);
        let lattice = Lattice {
            origin: [r.f64()?, r.f64()?, r.f64()?],
            step: r.f64()?,
            root_units: r.u32()?,
            depth_max: r.u8()?,
        };
        lattice.validate()?;
        let bounds = [r.vec3_i32()?, r.vec3_i32()?];
        let inside = |p: [i32; 3]| p.iter().all(|&c| c >= 0 && c as u32 <= lattice.root_units);
        if !inside(bounds[0]) || !inside(bounds[1]) || (0..3).any(|i| bounds[0][i] > bounds[1][i]) {
            return Err(bad("bounds outside the root cube"));
        }
        let (triangles_input, points_input) = (r.u64()?, r.u64()?);
        let (resolution, leaf_triangles) = (r.u32()?, r.u32()?);
        let normal_noise = r.f32()?;
        if !(normal_noise >= 0.0 && normal_noise.is_finite()) {
            return Err(bad("no share of noise"));
        }
        let primitives = usize::from(r.u8()?);
        let primitives =
            Primitives::ALL.get(primitives).ok_or_else(|| bad("unknown kind of primitives"))?.0;
        let point_cost = r.f32()?;
        if !(point_cost > 0.0 && point_cost.is_finite()) {
            return Err(bad("points cost nothing"));
        }
        let (nodes, skeleton_bytes) = (r.u64()?, r.u64()?);
        let root_block = BlockRef::read(&mut r)?;
        let (front_bytes, file_bytes) = (r.u64()?, r.u64()?);
        if front_bytes > file_bytes || root_block.end() > front_bytes {
            return Err(bad("the front part lies outside the file"));
        }
        let mut attributes = Vec::new();
        for _ in 0..r.u16()? {
            attributes.push(attribute(&mut r, version)?);
        }
        let is_scalar = |a: &&AttributeDeclaration| matches!(a.kind, AttributeType::Scalar(_));
        if attributes.iter().filter(is_scalar).count() > SCALARS_MAX {
            return Err(bad("more scalars than there can be"));
        }
        let mut sources = Vec::new();
        for _ in 0..r.u16()? {
            let (base_name, file_bytes) = (r.string()?, r.u64()?);
            let mut sha256 = [0; 32];
            sha256.copy_from_slice(r.take(32)?);
            sources.push(SourceFile { base_name, file_bytes, sha256 });
        }
        let metadata = if version >= 2 { metadata(&mut r, front_bytes, file_bytes)? } else { None };
        r.finish()?;
        let header = Header {
            unit,
            up,
            front,
            lattice,
            bounds,
            sources,
            triangles_input,
            points_input,
            resolution,
            leaf_triangles,
            normal_noise,
            primitives,
            point_cost,
            attributes,
            nodes,
            skeleton_bytes,
            root_block,
            front_bytes,
            metadata,
            file_bytes,
        };
        // One content, one encoding: what is not used is not declared.
        if header.format_version() != version {
            return Err(bad("an older version would have done"));
        }
        Ok(header)
    }

    /// Whether pages carry vertex colours.
    pub fn has_colours(&self) -> bool {
        self.attributes.iter().any(|a| a.kind == AttributeType::Srgba8)
    }
}

fn attribute(r: &mut ByteReader<'_>, version: u32) -> Result<AttributeDeclaration, FormatError> {
    let bad = |why: &str| FormatError::malformed("header", why);
    let (name, kind) = (r.string()?, r.u8()?);
    let domain = match r.u8()? {
        1 => AttributeDomain::Vertex,
        2 => AttributeDomain::Corner,
        3 => AttributeDomain::Primitive,
        4 => AttributeDomain::Point,
        _ => return Err(bad("unknown attribute domain")),
    };
    let kind = match kind {
        1 => AttributeType::OctNormal,
        2 => AttributeType::Srgba8,
        3 if version >= 3 => AttributeType::Scalar(ScalarRange::read(r)?),
        _ => return Err(bad("unknown attribute type")),
    };
    Ok(AttributeDeclaration { name, kind, domain })
}

/// Where metadata lie, if there are any.
fn metadata(
    r: &mut ByteReader<'_>,
    front_bytes: u64,
    file_bytes: u64,
) -> Result<Option<MetadataRef>, FormatError> {
    let bad = |why: &str| FormatError::malformed("header", why);
    match r.u8()? {
        0 => return Ok(None),
        1 => {}
        _ => return Err(bad("neither metadata nor none")),
    }
    let metadata = MetadataRef { offset: r.u64()?, text_bytes: r.u32()?, crc32: r.u32()? };
    let end = metadata.offset.saturating_add(metadata.text_bytes.into());
    if metadata.text_bytes as usize > METADATA_BYTES_MAX {
        return Err(bad("its metadata are too long"));
    }
    if metadata.offset < front_bytes || end > file_bytes {
        return Err(bad("its metadata lie outside the file"));
    }
    Ok(Some(metadata))
}
