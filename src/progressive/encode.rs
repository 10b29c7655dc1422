//! From the log to the base and the records, by refining the base as a decoder will.

use super::log::{Log, Step};
use super::record::write_record;
use super::state::{Added, Record, Split, State};
use crate::mesh::surface::Surface;
use smallvec::SmallVec;
use std::collections::BTreeSet;

/// The first chunk ends where the source's triangles are halved so often.
const MOST_HALVINGS: u32 = 6;

/// A progressive mesh.
#[derive(Debug, Clone)]
pub(crate) struct Encoded {
    /// The coarsest mesh. Its vertices are ordered by group, then by the face that uses them first; its faces by group.
    pub base: State,
    /// The records, coarse to fine, cut where the number of triangles has about doubled.
    pub chunks: Vec<Chunk>,
}

/// Records in a row.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Chunk {
    /// Their bytes.
    pub bytes: Vec<u8>,
    /// Their number.
    pub records: usize,
    /// Triangles of the mesh after the last of them.
    pub triangles: usize,
    /// Vertices of the mesh after the last of them.
    pub vertices: usize,
    /// 0 for the finest, one more for each halving of the triangles.
    pub halvings: u32,
}

/// Encodes what `log` saw on the way to `surface`, which must have a face left. `nodes` has the rows of all nodes as its vertices.
pub(crate) fn encode(log: &Log, surface: &Surface, nodes: &State) -> Encoded {
    let mut encoder = Encoder { log, nodes, vertex_of: vec![NONE; nodes.vertex_count()], numbers: Vec::new() };
    let mut state = encoder.start(surface);
    let base = state.clone();
    let steps = || log.steps.iter().rev();
    let full = state.faces().len() + steps().map(|s| s.faces.len()).sum::<usize>() + log.left_out.len();
    let mut chunks = Chunks::new(full);
    for step in steps() {
        encoder.encode(step, &mut state, &mut chunks);
    }
    if let Some(step) = encoder.left_out() {
        encoder.encode(&step, &mut state, &mut chunks);
    }
    Encoded { base, chunks: chunks.finish() }
}

const NONE: u32 = u32::MAX;

struct Encoder<'a> {
    log: &'a Log,
    nodes: &'a State,
    /// The decoder's vertex that stands for each node now.
    vertex_of: Vec<u32>,
    /// The log's number of each of the decoder's faces.
    numbers: Vec<u32>,
}

impl Encoder<'_> {
    fn start(&mut self, surface: &Surface) -> State {
        let layouts = (0..self.nodes.group_count() as u32).map(|g| self.nodes.layout(g).to_vec()).collect();
        let mut state = State::new(layouts);
        let mut faces = self.log.base(surface);
        faces.sort_by_key(|(_, nodes)| self.nodes.group(nodes[0]));
        for &(_, face) in &faces {
            for node in face {
                if self.vertex_of[node as usize] == NONE {
                    self.vertex_of[node as usize] = state.add_vertex(self.nodes.group(node), &self.row(node));
                }
            }
        }
        for &(number, face) in &faces {
            state.add_face(face.map(|n| self.vertex_of[n as usize]));
            self.numbers.push(number);
        }
        state
    }

    fn is_exact(&self, node: u32) -> bool {
        (node as usize) < self.log.sources.len()
    }

    fn row(&self, node: u32) -> SmallVec<[i32; 32]> {
        let row = self.nodes.row(node);
        if self.is_exact(node) {
            return row.into();
        }
        self.nodes.layout(self.nodes.group(node)).iter().zip(row).map(|(n, &raw)| n.coarsen(raw)).collect()
    }

    fn encode(&mut self, step: &Step, state: &mut State, chunks: &mut Chunks) {
        let record = self.describe(step, state);
        chunks.make_room(state, record.faces.len());
        write_record(state, &record, &mut chunks.open.bytes);
        state.apply(&record);
        self.numbers.extend(step.faces.iter().map(|f| f.0));
        chunks.count(state);
    }

    fn describe(&mut self, step: &Step, state: &State) -> Record {
        let mut record = Record::default();
        let mut next = state.vertex_count() as u32;
        let mut positions: [Option<SmallVec<[i32; 3]>>; 2] = [None, None];
        for merged in &step.merged {
            let vertex = self.vertex_of[merged.node as usize];
            let mut split = Split { vertex, ..Split::default() };
            if merged.children.len() > 1 {
                let owner = |&face: &u32| self.owner(step, self.numbers[face as usize]);
                split.owners = state.ring(vertex).iter().map(owner).collect();
            }
            for &(node, end) in &merged.children {
                record.exact[usize::from(end)] = self.is_exact(node);
                split.children.push(end);
                self.vertex_of[node as usize] = if split.children.len() == 1 { vertex } else { next };
                next += u32::from(split.children.len() > 1);
                let mut row = self.row(node);
                // Equal but for the sign of a zero.
                let position = positions[usize::from(end)].get_or_insert_with(|| row[..3].into());
                row[..3].copy_from_slice(position);
                record.rows.extend_from_slice(&row);
            }
            record.splits.push(split);
        }
        let mut predictor = step.merged.first().map_or(0, |merged| self.vertex_of[merged.node as usize]);
        for &node in &step.lost {
            record.added.push(Added { group: self.nodes.group(node), exact: self.is_exact(node), predictor });
            record.rows.extend_from_slice(&self.row(node));
            self.vertex_of[node as usize] = next;
            predictor = next;
            next += 1;
        }
        record.faces = step.faces.iter().map(|(_, nodes)| nodes.map(|n| self.vertex_of[n as usize])).collect();
        record
    }

    fn owner(&self, step: &Step, number: u32) -> u32 {
        let found = step.owners.binary_search_by_key(&number, |o| o.0);
        found.map_or(0, |at| step.owners[at].1)
    }

    /// What the surface never had, as the finest step.
    fn left_out(&self) -> Option<Step> {
        let mut step = Step::default();
        let mut seen = BTreeSet::new();
        for &face in &self.log.left_out {
            step.faces.push((NONE, face));
            let new = face.into_iter().filter(|&n| self.vertex_of[n as usize] == NONE && seen.insert(n));
            step.lost.extend(new);
        }
        (!step.faces.is_empty()).then_some(step)
    }
}

/// Cuts the stream.
struct Chunks {
    finished: Vec<Chunk>,
    open: Chunk,
    full: usize,
}

impl Chunks {
    fn new(full: usize) -> Self {
        Self { finished: Vec::new(), open: Chunk { halvings: MOST_HALVINGS, ..Chunk::default() }, full }
    }

    /// Closes the open chunk if so many more triangles are too many for it.
    fn make_room(&mut self, state: &State, more: usize) {
        while self.open.halvings > 0 && state.faces().len() + more > self.full >> self.open.halvings {
            let next = Chunk { halvings: self.open.halvings - 1, ..Chunk::default() };
            let closed = std::mem::replace(&mut self.open, next);
            self.finished.extend((closed.records > 0).then_some(closed));
        }
    }

    fn count(&mut self, state: &State) {
        self.open.records += 1;
        self.open.triangles = state.faces().len();
        self.open.vertices = state.vertex_count();
    }

    fn finish(mut self) -> Vec<Chunk> {
        self.finished.extend((self.open.records > 0).then_some(self.open));
        self.finished
    }
}
