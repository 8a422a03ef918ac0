//! Which parts of a glTF document are drawn, and where: the node tree made flat.

use std::ops::Range;

use ::gltf::json;
use glam::{DMat4, DQuat, DVec3};
use json::accessor::Type;
use json::mesh::{Mode, Semantic};
use json::validation::Checked;

use super::accessor::{Accessor, Scale};
use super::buffers::Buffers;
use crate::error::ScanError;
use crate::report::ScanReport;

/// How corners become triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    List,
    Strip,
    Fan,
}

/// A primitive made of triangles.
pub(super) struct Part {
    pub(super) shape: Shape,
    /// Its mesh, and which of that one's primitives it is.
    pub(super) primitive: (usize, usize),
    pub(super) positions: Accessor,
    pub(super) normals: Option<Accessor>,
    pub(super) colours: Option<Accessor>,
    /// `None`: the vertices are the corners, in their order.
    pub(super) indices: Option<Accessor>,
}

impl Part {
    pub(super) fn corner_count(&self) -> u64 {
        self.indices.as_ref().unwrap_or(&self.positions).count
    }
}

/// A mesh at a place; the same mesh may stand at several.
pub(super) struct Instance {
    /// Its primitives among the scene's parts.
    pub(super) parts: Range<usize>,
    pub(super) world_from_mesh: DMat4,
}

/// What is drawn.
pub(super) struct Scene {
    pub(super) parts: Vec<Part>,
    pub(super) instances: Vec<Instance>,
}

/// Walks the default scene, or every root node if the document has no default scene.
pub(super) fn flatten(
    root: &json::Root,
    buffers: &mut Buffers,
    report: &mut ScanReport,
) -> Result<Scene, ScanError> {
    let mut scene = Scene { parts: Vec::new(), instances: Vec::new() };
    // Parts of each mesh, once it has been met.
    let mut parts_of_mesh: Vec<Option<Range<usize>>> = vec![None; root.meshes.len()];
    let mut visited = vec![false; root.nodes.len()];

    // A stack of nodes to visit, the next one last; depth costs no recursion.
    let mut stack: Vec<(usize, DMat4)> = Vec::new();
    stack.extend(first_nodes(root, buffers)?.iter().rev().map(|node| (*node, DMat4::IDENTITY)));
    while let Some((index, world_from_parent)) = stack.pop() {
        let at = buffers.at(format!("nodes[{index}]"));
        let Some(node) = root.nodes.get(index) else {
            return Err(ScanError::malformed(at, "there is no such node"));
        };
        if std::mem::replace(&mut visited[index], true) {
            let what = "the node is its own ancestor or has two parents";
            return Err(ScanError::malformed(at, what));
        }
        let world_from_node = world_from_parent * parent_from_node(node);
        if let Some(mesh) = node.mesh {
            let Some(known) = parts_of_mesh.get_mut(mesh.value()) else {
                return Err(ScanError::malformed(at, "its mesh is not there"));
            };
            let range = match known {
                Some(range) => range.clone(),
                None => {
                    let begin = scene.parts.len();
                    open_mesh(root, buffers, mesh.value(), &mut scene.parts, report)?;
                    known.insert(begin..scene.parts.len()).clone()
                }
            };
            scene.instances.push(Instance { parts: range, world_from_mesh: world_from_node });
            if node.skin.is_some() {
                report.skipped.push(format!("nodes[{index}].skin"));
            }
        }
        let children = node.children.as_deref().unwrap_or_default();
        stack.extend(children.iter().rev().map(|child| (child.value(), world_from_node)));
    }
    Ok(scene)
}

fn first_nodes(root: &json::Root, buffers: &Buffers) -> Result<Vec<usize>, ScanError> {
    if let Some(index) = root.scene {
        let Some(scene) = root.scenes.get(index.value()) else {
            let at = buffers.at("scene");
            return Err(ScanError::malformed(at, "the default scene is not there"));
        };
        return Ok(scene.nodes.iter().map(|node| node.value()).collect());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(is_child) = is_child.get_mut(child.value()) {
            *is_child = true;
        }
    }
    let roots: Vec<usize> = (0..root.nodes.len()).filter(|node| !is_child[*node]).collect();
    if roots.is_empty() && !root.nodes.is_empty() {
        let what = "every node is the child of another: the nodes form a cycle";
        return Err(ScanError::malformed(buffers.at("nodes"), what));
    }
    Ok(roots)
}

fn parent_from_node(node: &json::scene::Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let translation = node.translation.unwrap_or_default().map(f64::from);
    let scale = node.scale.unwrap_or([1.0; 3]).map(f64::from);
    // Written with few digits, so that its length is only about 1.
    let rotation = node.rotation.unwrap_or_default().0.map(f64::from);
    let rotation = DQuat::from_array(rotation);
    let rotation = match rotation.length_squared() > 0.0 {
        true => rotation.normalize(),
        false => DQuat::IDENTITY,
    };
    DMat4::from_scale_rotation_translation(
        DVec3::from_array(scale),
        rotation,
        DVec3::from_array(translation),
    )
}

/// Opens the primitives of a mesh that are made of triangles.
fn open_mesh(
    root: &json::Root,
    buffers: &mut Buffers,
    mesh: usize,
    parts: &mut Vec<Part>,
    report: &mut ScanReport,
) -> Result<(), ScanError> {
    for (number, primitive) in root.meshes[mesh].primitives.iter().enumerate() {
        let item = format!("meshes[{mesh}].primitives[{number}]");
        let malformed = |buffers: &Buffers, what: &str| {
            Err(ScanError::malformed(buffers.at(item.clone()), what))
        };
        let shape = match primitive.mode {
            Checked::Valid(Mode::Triangles) => Shape::List,
            Checked::Valid(Mode::TriangleStrip) => Shape::Strip,
            Checked::Valid(Mode::TriangleFan) => Shape::Fan,
            Checked::Valid(other) => {
                report.skipped.push(format!("{item} ({other:?})"));
                continue;
            }
            Checked::Invalid => return malformed(buffers, "its mode is unknown"),
        };
        if primitive.targets.is_some() {
            report.skipped.push(format!("{item}.targets"));
        }
        let mut open = |semantic: Semantic, types: &[Type], scale: Scale| {
            let index = primitive.attributes.get(&Checked::Valid(semantic));
            index
                .map(|index| Accessor::open(root, buffers, index.value(), types, scale))
                .transpose()
        };
        let positions = open(Semantic::Positions, &[Type::Vec3], Scale::AsDeclared)?;
        let normals = open(Semantic::Normals, &[Type::Vec3], Scale::Normalised)?;
        let colours = open(Semantic::Colors(0), &[Type::Vec3, Type::Vec4], Scale::Normalised)?;
        let indices = primitive.indices.map(|index| {
            Accessor::open(root, buffers, index.value(), &[Type::Scalar], Scale::Plain)
        });
        let indices = indices.transpose()?;
        let Some(positions) = positions else {
            return malformed(buffers, "it has no POSITION");
        };
        for other in [&normals, &colours].into_iter().flatten() {
            if other.count != positions.count {
                return malformed(buffers, "its attributes differ in count");
            }
        }
        let part = Part { shape, primitive: (mesh, number), positions, normals, colours, indices };
        if shape == Shape::List && !part.corner_count().is_multiple_of(3) {
            let warning = format!("{item}: the last corners make no whole triangle");
            report.warnings.push(warning);
        }
        parts.push(part);
    }
    Ok(())
}
