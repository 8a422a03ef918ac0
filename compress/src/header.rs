//! The first bytes of a file: what it is, where it came from, how it is laid out.

use crate::bytes::{ByteReader, ByteWriter};
use crate::{BlockRef, FormatError, Lattice};

const MAGIC: [u8; 8] = *b"HLOD\r\n\x1a\n";

/// The version this crate writes. Files of every version from 1 on stay readable; a file of each is kept as a
/// test. Numbers from 0xffff0000 on, and 0, were forms that were not frozen: those files are refused.
pub const FORMAT_VERSION: u32 = 1;

/// No header is longer; a first read of this size always holds all of it.
pub const HEADER_BYTES_MAX: usize = 64 * 1024;

/// magic, version, length, checksum
const PREFIX_BYTES: usize = 8 + 4 + 4 + 4;

/// The unit of the source's coordinates, as declared by whoever built the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Unit {
    /// Nobody said.
    #[default]
    Unknown,
    /// Micrometres.
    Micrometre,
    /// Millimetres.
    Millimetre,
    /// Centimetres.
    Centimetre,
    /// Metres.
    Metre,
    /// Inches.
    Inch,
}

impl Unit {
    const ALL: [(Unit, &'static str); 6] = [
        (Unit::Unknown, "unknown"),
        (Unit::Micrometre, "um"),
        (Unit::Millimetre, "mm"),
        (Unit::Centimetre, "cm"),
        (Unit::Metre, "m"),
        (Unit::Inch, "in"),
    ];

    /// The usual abbreviation, or `unknown`.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

impl std::str::FromStr for Unit {
    type Err = String;
    fn from_str(text: &str) -> Result<Unit, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(unit, _)| *unit).ok_or_else(|| "expected mm, cm, m, um, in or unknown".into())
    }
}

/// What levels above the leaves are drawn with, where the scan has triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
#[non_exhaustive]
#[repr(u8)]
pub enum Primitives {
    /// Triangles.
    #[default]
    Triangles = 0,
    /// Triangles, and points where triangles are smaller than a pixel and points cost less.
    Hybrid = 1,
    /// Points.
    Points = 2,
}

impl Primitives {
    const ALL: [(Primitives, &'static str); 3] = [
        (Primitives::Triangles, "triangles"),
        (Primitives::Hybrid, "hybrid"),
        (Primitives::Points, "points"),
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

impl std::str::FromStr for Primitives {
    type Err = String;
    fn from_str(text: &str) -> Result<Primitives, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(primitives, _)| *primitives)
            .ok_or_else(|| "expected triangles, hybrid or points".into())
    }
}

/// A coordinate axis with a sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignedAxis {
    /// 0, 1 or 2 for x, y or z.
    pub axis: u8,
    /// Whether it points towards negative coordinates.
    pub negative: bool,
}

impl SignedAxis {
    /// +y, the most common up direction of scans.
    pub const PLUS_Y: SignedAxis = SignedAxis { axis: 1, negative: false };
    /// +z.
    pub const PLUS_Z: SignedAxis = SignedAxis { axis: 2, negative: false };

    /// As a unit vector.
    pub fn direction(self) -> [f64; 3] {
        let mut v = [0.0; 3];
        v[usize::from(self.axis)] = if self.negative { -1.0 } else { 1.0 };
        v
    }
}

impl std::str::FromStr for SignedAxis {
    type Err = String;
    fn from_str(text: &str) -> Result<SignedAxis, String> {
        let (negative, letter) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let axis = ["x", "y", "z"].iter().position(|l| *l == letter);
        axis.map(|axis| SignedAxis { axis: axis as u8, negative })
            .ok_or_else(|| "expected +x, -x, +y, -y, +z or -z".into())
    }
}

impl std::fmt::Display for SignedAxis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sign = if self.negative { '-' } else { '+' };
        write!(f, "{sign}{}", ["x", "y", "z"][usize::from(self.axis)])
    }
}

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[repr(u8)]
pub enum AttributeType {
    /// A unit vector, [`crate::OctNormal`].
    OctNormal = 1,
    /// Four bytes: sRGB and alpha; averaged in linear light.
    Srgba8 = 2,
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
#[derive(Debug, Clone, PartialEq, Eq)]
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
    /// Length of the whole file; a shorter one is truncated.
    pub file_bytes: u64,
}

impl Header {
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
            w.u8(attribute.kind as u8);
            w.u8(attribute.domain as u8);
        }
        w.u16(self.sources.len() as u16);
        for source in &self.sources {
            w.string(&source.base_name);
            w.u64(source.file_bytes);
            w.put(&source.sha256);
        }

        Header::with_prefix(&w.bytes)
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
    pub fn with_prefix(body: &[u8]) -> Vec<u8> {
        let mut prefix = ByteWriter::default();
        prefix.put(&MAGIC);
        prefix.u32(FORMAT_VERSION);
        prefix.u32(body.len() as u32);
        prefix.u32(crc32fast::hash(body));
        prefix.put(body);
        prefix.bytes
    }

    /// Reads a header from the first bytes of a file: all of it, or [`HEADER_BYTES_MAX`].
    ///
    /// # Errors
    /// When the bytes are not a header of [`FORMAT_VERSION`], are damaged, or contradict
    /// themselves.
    pub fn parse(file_start: &[u8]) -> Result<Header, FormatError> {
        // The signature and the version come before anything that depends on them.
        let mut r = ByteReader::new("header", file_start);
        if r.remaining() < MAGIC.len() || r.take(MAGIC.len())? != MAGIC {
            return Err(FormatError::NotHlod);
        }
        let found = r.u32()?;
        if found != FORMAT_VERSION {
            return Err(FormatError::Version { found, expected: FORMAT_VERSION });
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
        Self::parse_body(body)
    }

    fn parse_body(body: &[u8]) -> Result<Header, FormatError> {
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
            attributes.push(AttributeDeclaration {
                name: r.string()?,
                kind: match r.u8()? {
                    1 => AttributeType::OctNormal,
                    2 => AttributeType::Srgba8,
                    _ => return Err(bad("unknown attribute type")),
                },
                domain: match r.u8()? {
                    1 => AttributeDomain::Vertex,
                    2 => AttributeDomain::Corner,
                    3 => AttributeDomain::Primitive,
                    4 => AttributeDomain::Point,
                    _ => return Err(bad("unknown attribute domain")),
                },
            });
        }
        let mut sources = Vec::new();
        for _ in 0..r.u16()? {
            let (base_name, file_bytes) = (r.string()?, r.u64()?);
            let mut sha256 = [0; 32];
            sha256.copy_from_slice(r.take(32)?);
            sources.push(SourceFile { base_name, file_bytes, sha256 });
        }
        r.finish()?;
        Ok(Header {
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
            file_bytes,
        })
    }

    /// Whether pages carry vertex colours.
    pub fn has_colours(&self) -> bool {
        self.attributes.iter().any(|a| a.kind == AttributeType::Srgba8)
    }
}
