use tempfile::NamedTempFile;

use super::*;
use crate::{Errors, Lattice, NodeFlags, NormalCone, Representation, SignedAxis, SourceFile, Unit};

fn temp_file(bytes: &[u8]) -> NamedTempFile {
    let mut file = NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    file
}

fn header() -> Header {
    Header {
        unit: Unit::Millimetre,
        up: SignedAxis::PLUS_Y,
        front: SignedAxis::PLUS_Z,
        lattice: Lattice::enclosing([0.0; 3], [100.0; 3], 0.001),
        bounds: [[0; 3], [5; 3]],
        sources: vec![SourceFile { base_name: "a.ply".into(), file_bytes: 12, sha256: [7; 32] }],
        triangles_input: 99,
        points_input: 0,
        primitives: crate::Primitives::Hybrid,
        point_cost: 0.5,
        resolution: 256,
        leaf_triangles: 16_384,
        normal_noise: 2.0,
        attributes: Vec::new(),
        nodes: 0,
        skeleton_bytes: 0,
        root_block: BlockRef { offset: 0, block_bytes: 0, crc32: 0 },
        front_bytes: 0,
        metadata: None,
        file_bytes: 0,
    }
}

fn page_of(cell: CellKey, kind: RepresentationKind) -> Vec<u8> {
    format!("page {cell} {kind:?}").into_bytes()
}

fn node(cell: CellKey, kinds: &[RepresentationKind]) -> NodeRecord {
    let representation = |&kind| Representation {
        kind,
        errors: Errors::NONE,
        vertices: 3,
        triangles: 1,
        points: 0,
        cover_radius: 0.0,
        page: PageRef::of_bytes(&page_of(cell, kind)),
    };
    NodeRecord {
        cell,
        child_mask: 0,
        flags: NodeFlags { closed_oriented: true },
        bounds: [[0; 3], [1; 3]],
        cone: NormalCone::ALL,
        representations: kinds.iter().map(representation).collect(),
        children: Children::None,
    }
}

/// A full octree down to `depth`: 4,681 nodes at depth 4, several blocks.
fn tree(depth: u8) -> Vec<NodeRecord> {
    use RepresentationKind::*;
    let mut out = Vec::new();
    let mut cells = vec![CellKey::ROOT];
    while let Some(cell) = cells.pop() {
        if cell.depth() < depth {
            out.push(node(cell, &[Appearance, Geometric]));
            cells.extend((0..8).map(|o| cell.child(o)));
        } else {
            out.push(node(cell, &[Source]));
        }
    }
    out
}

fn write_tree(depth: u8) -> (NamedTempFile, Header) {
    write_tree_with(depth, None)
}

fn write_tree_with(depth: u8, metadata: Option<&Metadata>) -> (NamedTempFile, Header) {
    let writer = FileWriter::new(header(), tree(depth), metadata).unwrap();
    let mut bytes = Vec::new();
    writer.write::<FormatError>(&mut bytes, |cell, kind| Ok(page_of(cell, kind))).unwrap();
    assert_eq!(bytes.len() as u64, writer.header().file_bytes);
    (temp_file(&bytes), writer.header().clone())
}

#[test]
fn trees_of_several_blocks_survive() {
    for depth in [0, 1, 4] {
        let (temp, header) = write_tree(depth);
        let file = HlodFile::open(temp.path()).unwrap();
        assert_eq!(file.header(), &header);
        let nodes = file.read_skeleton().unwrap();
        assert_eq!(nodes.len(), tree(depth).len());
        for node in &nodes {
            assert_eq!(node.child_mask, if node.cell.depth() < depth { 0xff } else { 0 });
            for r in &node.representations {
                assert_eq!(file.read_page(r.page).unwrap(), page_of(node.cell, r.kind));
            }
        }
    }
}

#[test]
fn the_front_part_holds_the_root() {
    let (temp, header) = write_tree(4);
    let nodes = HlodFile::open(temp.path()).unwrap().read_skeleton().unwrap();
    assert_eq!(nodes[0].cell, CellKey::ROOT);
    for r in &nodes[0].representations {
        assert!(r.page.offset + u64::from(r.page.page_bytes) <= header.front_bytes);
    }
    assert!(header.front_bytes <= 256 * 1024);
}

#[test]
fn broken_trees_are_refused() {
    let orphan = vec![node(CellKey::ROOT.child(1).child(2), &[RepresentationKind::Source])];
    assert!(FileWriter::new(header(), orphan, None).is_err());
    assert!(FileWriter::new(header(), Vec::new(), None).is_err());
    let twice = vec![node(CellKey::ROOT, &[RepresentationKind::Source]); 2];
    assert!(FileWriter::new(header(), twice, None).is_err());
}

#[test]
fn a_page_that_is_not_the_declared_one_is_refused() {
    let writer = FileWriter::new(header(), tree(1), None).unwrap();
    let result = writer.write::<FormatError>(&mut Vec::new(), |_, _| Ok(b"other".to_vec()));
    assert!(matches!(result, Err(FormatError::Malformed { .. })), "{result:?}");
}

#[test]
fn every_truncation_and_every_damaged_front_byte_is_an_error() {
    let (temp, header) = write_tree(1);
    let good = std::fs::read(temp.path()).unwrap();
    let read = |bytes: &[u8]| -> Result<(), FormatError> {
        let temp = temp_file(bytes);
        let file = HlodFile::open(temp.path())?;
        for node in file.read_skeleton()? {
            for r in &node.representations {
                file.read_page(r.page)?;
            }
        }
        file.read_metadata().map(drop)
    };
    read(&good).unwrap();
    for length in 0..good.len() {
        assert!(read(&good[..length]).is_err(), "cut to {length} of {} bytes", good.len());
    }
    for at in 0..header.front_bytes as usize {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        assert!(read(&bytes).is_err(), "bit flipped in byte {at}");
    }
}

/// Metadata come last and are all that version 2 adds: what a reader of version 1 knows lies where it did.
#[test]
fn metadata_survive_and_make_a_file_of_version_2() {
    let metadata = Metadata::parse(crate::METADATA_EXAMPLE.as_bytes()).unwrap();
    let (with, header) = write_tree_with(2, Some(&metadata));
    assert_eq!(header.format_version(), 2);
    let file = HlodFile::open(with.path()).unwrap();
    assert_eq!(file.read_metadata().unwrap().as_ref(), Some(&metadata));
    let range = header.metadata.unwrap();
    assert_eq!(range.offset + u64::from(range.text_bytes), header.file_bytes);

    let (without, plain) = write_tree_with(2, None);
    assert_eq!((plain.format_version(), plain.metadata), (1, None));
    assert_eq!(HlodFile::open(without.path()).unwrap().read_metadata().unwrap(), None);
    let bytes = std::fs::read(with.path()).unwrap();
    let of_version_1 = std::fs::read(without.path()).unwrap();
    assert_eq!(of_version_1[8..12], 1u32.to_le_bytes());
    assert_eq!(bytes[8..12], 2u32.to_le_bytes());
    assert_eq!(&bytes[range.offset as usize..], crate::METADATA_EXAMPLE.as_bytes());

    // Each damaged byte of them is found; the rest stays readable.
    for at in range.offset as usize..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        let temp = temp_file(&damaged);
        let file = HlodFile::open(temp.path()).unwrap();
        assert!(matches!(file.read_metadata(), Err(FormatError::Checksum { .. })));
        assert!(file.read_skeleton().is_ok());
    }
}

#[test]
fn ranges_of_metadata_outside_the_file_are_refused() {
    let reference = crate::MetadataRef { offset: 500, text_bytes: 20, crc32: 0 };
    let with = |change: &dyn Fn(&mut crate::MetadataRef)| {
        let mut metadata = reference;
        change(&mut metadata);
        let root_block = BlockRef { offset: 0, block_bytes: 10, crc32: 0 };
        let (front_bytes, file_bytes) = (400, 520);
        let metadata = Some(metadata);
        let header = Header { root_block, front_bytes, file_bytes, metadata, ..header() };
        Header::parse(&header.to_bytes())
    };
    assert_eq!(with(&|_| {}).unwrap().metadata, Some(reference));
    assert!(with(&|m| m.offset = 399).is_err());
    assert!(with(&|m| m.offset = u64::MAX).is_err());
    assert!(with(&|m| m.text_bytes = 21).is_err());
    // A version that nothing needs is none.
    let body = &header().to_bytes()[20..];
    assert!(Header::parse(&Header::with_prefix(1, body)).is_ok());
    assert!(Header::parse(&Header::with_prefix(2, &[body, &[0]].concat())).is_err());
    assert!(Header::parse(&Header::with_prefix(2, body)).is_err());
}

#[test]
fn other_versions_are_named() {
    let mut bytes = header().to_bytes();
    bytes[8..12].copy_from_slice(&9u32.to_le_bytes());
    assert!(matches!(Header::parse(&bytes), Err(FormatError::Version { found: 9, .. })));
    assert!(matches!(Header::parse(b"ply\nformat"), Err(FormatError::NotHlod)));
    assert!(matches!(Header::parse(b""), Err(FormatError::NotHlod)));
}
