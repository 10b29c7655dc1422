//! Nodes: who draws which mesh, what moves, what carries levels already.

use std::collections::BTreeSet;

/// The facts about the node graph that presets and the writer ask for.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// For each mesh: who draws it.
    pub uses: Vec<MeshUse>,
    /// Nodes that a channel (or KHR_animation_pointer) moves: translation, rotation, scale.
    pub animated_transform: BTreeSet<usize>,
    /// Nodes whose morph weights a channel animates.
    pub animated_weights: BTreeSet<usize>,
    /// Parent of each node.
    pub parent: Vec<Option<usize>>,
    /// Nodes with `MSFT_lod` in the source, with their `ids`.
    pub existing: Vec<(usize, Vec<usize>)>,
    /// Nodes at or below a node of some `ids`: lower levels already.
    pub lower: BTreeSet<usize>,
}

/// Who draws a mesh.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshUse {
    /// Nodes with this mesh, in order.
    pub nodes: Vec<usize>,
    /// Largest uniform scale (cube root of the world matrix's determinant) of those nodes.
    pub scale: f32,
}
