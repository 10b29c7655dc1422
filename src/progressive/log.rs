//! The log of a run of collapses: what each took away, so that it can be given back.

use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use crate::mesh::wedges::{Wedges, normalize_directions};
use crate::mesh::{Attribute, Mesh, Skin, source_wedges};
use smallvec::SmallVec;

/// Watches a surface from the source to the base.
///
/// A *node* is a wedge with its values at one time: the first [`Log::sources`] nodes are the source's wedges, each collapse makes new ones.
#[derive(Debug, Clone)]
pub(crate) struct Log {
    /// A source vertex of each source node.
    pub sources: Vec<u32>,
    /// The nodes that collapses have made, as vertices of a mesh without triangles.
    pub made: Mesh,
    /// The group of each made node.
    pub made_groups: Vec<u32>,
    /// What was taken away, fine to coarse.
    pub(super) steps: Vec<Step>,
    /// Source triangles that are no face of the surface (no area, or copies), as source nodes.
    pub(super) left_out: Vec<[u32; 3]>,
    /// Node of each wedge now.
    node_of: Vec<u32>,
    /// Number of each face, for good: the surface's own numbers change.
    number_of: Vec<u32>,
}

/// One step from fine to coarse.
#[derive(Debug, Clone, Default)]
pub(super) struct Step {
    pub merged: SmallVec<[Merged; 1]>,
    /// Faces that went, with their nodes.
    pub faces: SmallVec<[(u32, [u32; 3]); 2]>,
    /// Child of the corner at the joined point of each face there, ordered by face.
    pub owners: Vec<(u32, u32)>,
    /// Nodes that lost their last face and became part of no other.
    pub lost: Vec<u32>,
}

/// A node that a collapse made.
#[derive(Debug, Clone, Default)]
pub(super) struct Merged {
    pub node: u32,
    /// The nodes it was made of, each with its end of the edge: 0 for the point that was kept, 1 for the one that is gone.
    pub children: SmallVec<[(u32, u8); 2]>,
}

/// What is known of a collapse before it happens.
#[derive(Debug)]
pub(crate) struct Entry {
    step: Step,
    kept: u32,
    /// The wedge that each of `step.merged` will be.
    wedges: SmallVec<[u32; 2]>,
    /// Wedges that may lose their last face, with their points.
    at_risk: SmallVec<[(u32, u32); 4]>,
}

impl Log {
    /// Starts at the source; `surface` is the untouched surface of `mesh`.
    pub fn new(mesh: &Mesh, surface: &Surface) -> Self {
        let (wedge_of, sources) = source_wedges(mesh);
        let mut faces = surface.live_faces().map(|f| surface.face_wedges(f)).peekable();
        let wedges = mesh.triangles.iter().map(|t| t.map(|v| wedge_of[v as usize]));
        let left_out = wedges.filter(|wedges| faces.next_if_eq(wedges).is_none()).collect();
        let attributes = mesh.attributes.iter().map(|a| Attribute { values: Vec::new(), ..a.clone() }).collect();
        let skin = mesh.skin.as_ref().map(|s| Skin { influences: s.influences, ..Skin::default() });
        Self {
            node_of: (0..sources.len() as u32).collect(),
            number_of: (0..surface.face_count() as u32).collect(),
            sources,
            made: Mesh { attributes, skin, ..Mesh::default() },
            made_groups: Vec::new(),
            steps: Vec::new(),
            left_out,
        }
    }

    /// To be called before [`Surface::compact`], which numbers the faces anew.
    pub fn renumber(&mut self, surface: &Surface) {
        self.number_of = surface.live_faces().map(|f| self.number_of[f]).collect();
    }

    /// To be called before a collapse is applied.
    pub fn begin(&self, surface: &Surface, merge: &Merge) -> Entry {
        let mut entry =
            Entry { step: Step::default(), kept: merge.kept, wedges: SmallVec::new(), at_risk: SmallVec::new() };
        for face in merge.faces() {
            let (points, wedges) = (surface.face(face), surface.face_wedges(face));
            entry.step.faces.push((self.number_of[face], wedges.map(|w| self.node_of[w as usize])));
            for third in (0..3).filter(|&k| points[k] != merge.kept && points[k] != merge.gone) {
                entry.at_risk.push((wedges[third], points[third]));
            }
        }
        let ends = [(merge.kept, 0), (merge.gone, 1)];
        let corners = || ends.iter().flat_map(|&(point, end)| surface.ring(point).iter().map(move |&c| (c, end)));
        for (corner, end) in corners().filter(|(c, _)| merge.faces().all(|face| face != Surface::face_of(*c))) {
            let becomes = wedge_after(surface, merge, corner, end);
            if !entry.wedges.contains(&becomes) {
                entry.wedges.push(becomes);
                entry.step.merged.push(Merged::default());
            }
        }
        for (corner, end) in corners() {
            self.add_child(surface, merge, corner, end, &mut entry);
        }
        entry.step.owners.sort_unstable();
        entry
    }

    /// Makes the wedge at a corner of either end a child, and the owner of the corner if its face lives on.
    fn add_child(&self, surface: &Surface, merge: &Merge, corner: u32, end: u8, entry: &mut Entry) {
        let (wedge, face) = (surface.wedge_at(corner), Surface::face_of(corner));
        let becomes = wedge_after(surface, merge, corner, end);
        let node = self.node_of[wedge as usize];
        let Some(index) = entry.wedges.iter().position(|&w| w == becomes) else {
            if !entry.step.lost.contains(&node) {
                entry.step.lost.push(node);
            }
            return;
        };
        let children = &mut entry.step.merged[index].children;
        let child = children.iter().position(|c| c.0 == node).unwrap_or_else(|| {
            children.push((node, end));
            children.len() - 1
        });
        if merge.faces().all(|gone| gone != face) {
            entry.step.owners.push((self.number_of[face], child as u32));
        }
    }

    /// To be called after the collapse was applied and the joined wedges have their new values.
    pub fn finish(&mut self, mut entry: Entry, surface: &Surface) {
        for (merged, &wedge) in entry.step.merged.iter_mut().zip(&entry.wedges) {
            merged.node = self.add_node(surface, entry.kept, wedge);
        }
        for (wedge, point) in entry.at_risk {
            let (node, stays) = (self.node_of[wedge as usize], |c: &u32| surface.wedge_at(*c) == wedge);
            if !surface.ring(point).iter().any(stays) && !entry.step.lost.contains(&node) {
                entry.step.lost.push(node);
            }
        }
        self.steps.push(entry.step);
    }

    /// To be called before whole pieces are removed.
    pub fn remove(&mut self, surface: &Surface, faces: &[u32]) {
        let mut step = Step::default();
        let mut seen = std::collections::BTreeSet::new();
        for &face in faces {
            let nodes = surface.face_wedges(face as usize).map(|w| self.node_of[w as usize]);
            step.faces.push((self.number_of[face as usize], nodes));
            step.lost.extend(nodes.into_iter().filter(|&n| seen.insert(n)));
        }
        self.steps.push(step);
    }

    /// Whether nothing was taken away.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// To be called at the end: the made nodes get proper directions, as the levels of a chain do.
    pub fn finished(mut self) -> Self {
        normalize_directions(&mut self.made.attributes);
        self
    }

    /// The faces that are left, as numbers and nodes.
    pub(super) fn base(&self, surface: &Surface) -> Vec<(u32, [u32; 3])> {
        let node = |w: u32| self.node_of[w as usize];
        surface.live_faces().map(|f| (self.number_of[f], surface.face_wedges(f).map(node))).collect()
    }

    fn add_node(&mut self, surface: &Surface, point: u32, wedge: u32) -> u32 {
        let node = (self.sources.len() + self.made.positions.len()) as u32;
        self.made.positions.push(surface.frame.leave(surface.points[point as usize]));
        append_row(&surface.wedges, wedge, &mut self.made);
        self.made_groups.push(surface.wedges.group(wedge));
        self.node_of[wedge as usize] = node;
        node
    }
}

/// The wedge that the corner will have.
fn wedge_after(surface: &Surface, merge: &Merge, corner: u32, end: u8) -> u32 {
    let wedge = surface.wedge_at(corner);
    if end == 0 { wedge } else { merge.target(wedge) }
}

fn append_row(wedges: &Wedges, wedge: u32, mesh: &mut Mesh) {
    let row = wedges.row(wedge);
    for (attribute, column) in mesh.attributes.iter_mut().zip(wedges.columns()) {
        attribute.values.extend_from_slice(&row[column.offset..][..column.width]);
    }
    if let (Some(skin), Some((joints, weights))) = (&mut mesh.skin, wedges.influences(wedge)) {
        skin.joints.extend_from_slice(joints);
        skin.weights.extend_from_slice(weights);
    }
}
