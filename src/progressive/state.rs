//! The mesh on its way from coarse to fine: what the encoder imagines and the decoder has.

use super::code::Number;
use smallvec::SmallVec;

/// Vertices as rows of numbers, faces over them, and which faces stand at each vertex.
#[derive(Debug, Clone, Default)]
pub(crate) struct State {
    /// The numbers of a row, by group; the first three are the position.
    layouts: Vec<Vec<Number>>,
    groups: Vec<u32>,
    /// Where each vertex's row starts.
    starts: Vec<usize>,
    numbers: Vec<i32>,
    faces: Vec<[u32; 3]>,
    /// Faces at each vertex, oldest first.
    rings: Vec<Vec<u32>>,
}

/// One step from coarse to fine, in terms of the state before it. New vertices are numbered from the number of vertices on: the children of
/// each split after its first, which takes the split vertex's place, then the added ones.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    /// Whether the vertices at either end of the split are the source's.
    pub exact: [bool; 2],
    pub splits: SmallVec<[Split; 1]>,
    /// Vertices that come from nowhere.
    pub added: Vec<Added>,
    /// Rows of the children of all splits, then of the added vertices.
    pub rows: Vec<i32>,
    pub faces: SmallVec<[[u32; 3]; 2]>,
}

/// A vertex that becomes one or more.
#[derive(Debug, Clone, Default)]
pub(super) struct Split {
    pub vertex: u32,
    /// The end of the split that each child is at.
    pub children: SmallVec<[u8; 2]>,
    /// For each face at the vertex the child that takes its corner; empty if there is one child only.
    pub owners: SmallVec<[u32; 16]>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Added {
    pub group: u32,
    pub exact: bool,
    /// The vertex it is predicted from: one before the record, or one that the record made before this.
    pub predictor: u32,
}

impl State {
    /// A mesh without vertices whose groups have these rows.
    pub fn new(layouts: Vec<Vec<Number>>) -> Self {
        Self { layouts, ..Self::default() }
    }

    /// Appends a vertex; `row` has the length that the layout of `group` says.
    pub fn add_vertex(&mut self, group: u32, row: &[i32]) -> u32 {
        self.groups.push(group);
        self.starts.push(self.numbers.len());
        self.numbers.extend_from_slice(row);
        self.rings.push(Vec::new());
        self.groups.len() as u32 - 1
    }

    /// Appends a face over vertices that are there.
    pub fn add_face(&mut self, face: [u32; 3]) {
        for vertex in face {
            self.rings[vertex as usize].push(self.faces.len() as u32);
        }
        self.faces.push(face);
    }

    /// All faces, oldest first.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.groups.len()
    }

    /// Number of numbers of all vertices.
    pub fn number_count(&self) -> usize {
        self.numbers.len()
    }

    /// The group of a vertex.
    pub fn group(&self, vertex: u32) -> u32 {
        self.groups[vertex as usize]
    }

    /// The numbers of a vertex.
    pub fn row(&self, vertex: u32) -> &[i32] {
        &self.numbers[self.starts[vertex as usize]..][..self.layout(self.group(vertex)).len()]
    }

    pub(super) fn layout(&self, group: u32) -> &[Number] {
        &self.layouts[group as usize]
    }

    /// Number of groups, with or without vertices.
    pub fn group_count(&self) -> usize {
        self.layouts.len()
    }

    pub(super) fn ring(&self, vertex: u32) -> &[u32] {
        &self.rings[vertex as usize]
    }

    /// The other corner `number` of the faces at `vertex`: two a face, each after the other counter-clockwise.
    pub(super) fn neighbour(&self, vertex: u32, number: usize) -> Option<u32> {
        let face = self.faces[*self.ring(vertex).get(number / 2)? as usize];
        let corner = face.iter().position(|&v| v == vertex)?;
        Some(face[(corner + 1 + number % 2) % 3])
    }

    /// Does what a record says, which was made for this very state; false if it splits a vertex twice.
    pub(super) fn apply(&mut self, record: &Record) -> bool {
        let mut at = 0;
        for split in &record.splits {
            let group = self.group(split.vertex);
            let width = self.layout(group).len();
            let mut ids: SmallVec<[u32; 2]> = SmallVec::new();
            for child in 0..split.children.len() {
                let row = &record.rows[at..at + width];
                at += width;
                if child == 0 {
                    let start = self.starts[split.vertex as usize];
                    self.numbers[start..start + width].copy_from_slice(row);
                    ids.push(split.vertex);
                } else {
                    ids.push(self.add_vertex(group, row));
                }
            }
            if !self.hand_over(split, &ids) {
                return false;
            }
        }
        for added in &record.added {
            let width = self.layout(added.group).len();
            self.add_vertex(added.group, &record.rows[at..at + width]);
            at += width;
        }
        for &face in &record.faces {
            self.add_face(face);
        }
        true
    }

    /// Gives the corners at a split vertex to its children; rings keep the order of their faces.
    fn hand_over(&mut self, split: &Split, ids: &[u32]) -> bool {
        if split.children.len() == 1 {
            return true;
        }
        if self.ring(split.vertex).len() != split.owners.len() {
            return false;
        }
        let ring = std::mem::take(&mut self.rings[split.vertex as usize]);
        for (&face, &owner) in ring.iter().zip(&split.owners) {
            let id = ids[owner as usize];
            if let Some(corner) = self.faces[face as usize].iter_mut().find(|v| **v == split.vertex) {
                *corner = id;
            }
            self.rings[id as usize].push(face);
        }
        true
    }
}
