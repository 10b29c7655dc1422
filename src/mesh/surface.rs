//! The working mesh of the simplifier: points, faces, corners with wedges, and the ring of corners around each point.
//!
//! Points are welded over all groups, so seams, hard edges and material borders are no holes in the topology. Rings hold every
//! corner at a point, whatever the order, so that non-manifold meshes need no special case.

use super::Mesh;
use super::edges::Irregular;
use super::order;
use super::regions::Region;
use super::surgery::{Merge, holds};
use super::wedges::Wedges;
use super::weld::weld;
use crate::tasks;
use glam::{DVec3, Vec3};
use smallvec::SmallVec;
use std::hint::select_unpredictable;

/// Names corner `k` of face `f` as `f << 2 | k`.
pub(crate) type Corner = u32;

/// In `faces[f][0]` of a face that is gone.
const DEAD: u32 = u32::MAX;

/// A triangle surface under edit.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    /// Object units → the unit frame that `points` are in.
    pub frame: Frame,
    /// Positions in the unit frame (the longest side of the source's bounding box is between 1 and 2).
    pub points: Vec<DVec3>,
    /// Point of each corner.
    faces: Vec<[u32; 3]>,
    /// Wedge of each corner; empty while every point has one wedge, of the same number.
    corners: Vec<[u32; 3]>,
    /// Attributes.
    pub wedges: Wedges,
    rings: Rings,
    live: usize,
    /// For each point the one it was joined to; itself if it was not. Empty where nobody asks: then points may be numbered anew.
    heirs: Vec<u32>,
}

/// A shift and a scale by a power of two: exact for the source's coordinates in both directions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    center: DVec3,
    scale: f64,
}

impl Frame {
    fn of(mesh: &Mesh, vertices: &[u32]) -> Self {
        let positions = vertices.iter().map(|&v| Vec3::from(mesh.positions[v as usize]));
        let (lo, hi) = positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        if lo.x > hi.x {
            return Self { center: DVec3::ZERO, scale: 1.0 };
        }
        let extent = (hi.as_dvec3() - lo.as_dvec3()).max_element();
        let scale = if extent > 0.0 { (-extent.log2().floor()).exp2() } else { 1.0 };
        // A centre that is an f32 keeps the differences representable in f64.
        let center = ((lo.as_dvec3() + hi.as_dvec3()) * 0.5).as_vec3().as_dvec3();
        Self { center, scale }
    }

    /// From object units.
    pub fn enter(&self, position: [f32; 3]) -> DVec3 {
        (DVec3::from(position.map(f64::from)) - self.center) * self.scale
    }

    /// Length in the unit frame of one object unit.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// To object units.
    pub fn leave(&self, point: DVec3) -> [f32; 3] {
        (point / self.scale + self.center).as_vec3().to_array()
    }
}

/// For each point the corners at it, one contiguous run a point in one pool.
#[derive(Debug, Clone, Default)]
struct Rings {
    pool: Vec<Corner>,
    spans: Vec<Span>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Span {
    start: u32,
    length: u32,
}

impl Rings {
    fn rebuild(&mut self, points: usize, faces: &[[u32; 3]]) {
        self.spans.clear();
        self.spans.resize(points, Span::default());
        for face in faces.iter().filter(|f| f[0] != DEAD) {
            face.iter().for_each(|&p| self.spans[p as usize].length += 1);
        }
        let mut start = 0;
        for span in &mut self.spans {
            span.start = start;
            start += span.length;
            span.length = 0;
        }
        self.pool.clear();
        // Joined rings go to the end.
        self.pool.reserve_exact(start as usize * 3 / 2);
        self.pool.resize(start as usize, 0);
        for (f, face) in faces.iter().enumerate().filter(|(_, f)| f[0] != DEAD) {
            for (k, &p) in face.iter().enumerate() {
                let span = &mut self.spans[p as usize];
                self.pool[(span.start + span.length) as usize] = (f as u32) << 2 | k as u32;
                span.length += 1;
            }
        }
    }

    fn of(&self, point: u32) -> &[Corner] {
        let span = self.spans[point as usize];
        &self.pool[span.start as usize..][..span.length as usize]
    }

    fn remove(&mut self, point: u32, corner: Corner) {
        let span = &mut self.spans[point as usize];
        let run = &mut self.pool[span.start as usize..][..span.length as usize];
        // Where it is cannot be foretold: moving all is faster than looking for it.
        let mut count = 0;
        for i in 0..run.len() {
            let other = run[i];
            run[count] = other;
            count += usize::from(other != corner);
        }
        span.length = count as u32;
    }

    fn push(&mut self, point: u32, corner: Corner) {
        let span = self.spans[point as usize];
        let end = (span.start + span.length) as usize;
        if end != self.pool.len() {
            let start = self.pool.len() as u32;
            self.pool.extend_from_within(span.start as usize..end);
            self.spans[point as usize].start = start;
        }
        self.pool.push(corner);
        self.spans[point as usize].length += 1;
    }

    fn clear(&mut self, point: u32) {
        self.spans[point as usize].length = 0;
    }

    #[cold]
    fn close_gaps(&mut self) {
        let live: usize = self.spans.iter().map(|span| span.length as usize).sum();
        let mut pool = Vec::with_capacity(live * 3 / 2 + 256);
        for span in &mut self.spans {
            let start = pool.len() as u32;
            pool.extend_from_slice(&self.pool[span.start as usize..][..span.length as usize]);
            span.start = start;
        }
        self.pool = pool;
    }

    /// Makes `corners` the ring of `point`: in the place of the one it has, if they fit.
    fn replace(&mut self, point: u32, corners: &[Corner]) {
        if self.pool.len() + corners.len() > self.pool.capacity() {
            self.close_gaps();
        }
        let span = &mut self.spans[point as usize];
        if corners.len() > span.length as usize {
            span.start = self.pool.len() as u32;
            self.pool.extend_from_slice(corners);
        } else {
            self.pool[span.start as usize..][..corners.len()].copy_from_slice(corners);
        }
        span.length = corners.len() as u32;
    }
}

/// What belongs to the two corners after this one, of what belongs to those of its face.
#[inline]
fn others_of([a, b, c]: [u32; 3], corner: Corner) -> [u32; 2] {
    // Which one it is cannot be foretold.
    let choose = |first, second, third| {
        select_unpredictable(corner & 3 == 0, first, select_unpredictable(corner & 3 == 1, second, third))
    };
    [choose(b, c, a), choose(c, a, b)]
}

impl Surface {
    /// Welds `mesh`, which must be valid. Triangles with two corners at one point, and exact copies of a triangle, are left out.
    pub fn new(mesh: &Mesh) -> Self {
        Self::with_irregular(mesh, false).0
    }

    /// [`Self::new`], and which of its points are irregular. If it `may_sort`, and the faces come in an order that [jumps](order::jumps), points and faces
    /// are sorted by space.
    pub fn with_irregular(mesh: &Mesh, may_sort: bool) -> (Self, Irregular) {
        let mut welded = weld(mesh);
        let frame = Frame::of(mesh, &welded.point_vertex);
        let vertices = &welded.point_vertex;
        let mut points = tasks::collect(vertices.len(), |p| frame.enter(mesh.positions[vertices[p] as usize]));
        // Both are numbered by their first vertices.
        let is_single = welded.wedge_vertex.len() == welded.point_vertex.len();
        let mut faces = Vec::with_capacity(mesh.triangles.len());
        let mut corners = Vec::with_capacity(if is_single { 0 } else { mesh.triangles.len() });
        for triangle in &mesh.triangles {
            let face = triangle.map(|v| welded.point_of[v as usize]);
            if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
                faces.push(face);
                if !is_single {
                    corners.push(triangle.map(|v| welded.wedge_of[v as usize]));
                }
            }
        }
        if may_sort && order::jumps(&faces) {
            let in_space = sort_by_space(&mut points, &mut faces, &mut corners);
            if is_single {
                welded.wedge_vertex = order::pick(&welded.wedge_vertex, &in_space);
            }
        }
        let wedges = Wedges::new(mesh, &welded.wedge_vertex);
        let live = faces.len();
        let heirs = (0..points.len() as u32).collect();
        let mut surface = Self { frame, points, faces, corners, wedges, rings: Rings::default(), live, heirs };
        surface.rings.rebuild(surface.points.len(), &surface.faces);
        let irregular = Irregular::find(&surface);
        let irregular = if surface.drop_copies(&irregular) { Irregular::find(&surface) } else { irregular };
        (surface, irregular)
    }

    /// Brings points, faces and rings into the caches.
    pub fn read_through(&self) {
        tasks::read_through(&self.points);
        tasks::read_through(&self.faces);
        tasks::read_through(&self.rings.spans);
        tasks::read_through(&self.rings.pool);
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.live
    }

    /// Whether some point has more than one wedge.
    pub fn has_seams(&self) -> bool {
        self.wedges.len() != self.points.len()
    }

    /// Face ids are below this, live or not.
    pub fn face_slots(&self) -> usize {
        self.faces.len()
    }

    /// Whether the face is still there.
    pub fn is_live(&self, face: usize) -> bool {
        self.faces[face][0] != DEAD
    }

    /// The corners of [`Self::opposite`].
    pub fn corners_opposite(corner: Corner) -> [Corner; 2] {
        others_of([0, 1, 2], corner).map(|k| corner & !3 | k)
    }

    /// The points of a live face.
    pub fn face(&self, face: usize) -> [u32; 3] {
        self.faces[face]
    }

    /// The wedges of a live face.
    pub fn face_wedges(&self, face: usize) -> [u32; 3] {
        self.corners_or_points()[face]
    }

    fn corners_or_points(&self) -> &[[u32; 3]] {
        if self.corners.is_empty() { &self.faces } else { &self.corners }
    }

    /// Wedges get numbers of their own.
    fn tell_wedges_apart(&mut self) {
        if self.corners.is_empty() {
            self.corners.clone_from(&self.faces);
        }
    }

    /// The positions of a live face.
    pub fn triangle(&self, face: usize) -> [DVec3; 3] {
        self.faces[face].map(|p| self.points[p as usize])
    }

    /// The live faces in order.
    pub fn live_faces(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.faces.len()).filter(|&f| self.is_live(f))
    }

    /// All corners at `point`.
    pub fn ring(&self, point: u32) -> &[Corner] {
        self.rings.of(point)
    }

    /// The points that share a face with `point`, each once, in the order in which its ring meets them.
    pub fn neighbours(&self, point: u32) -> SmallVec<[u32; 16]> {
        let mut found = SmallVec::new();
        for other in self.around(point) {
            if !found.contains(&other) {
                found.push(other);
            }
        }
        found
    }

    /// The points that share a face with `point`, most of them twice.
    pub fn around(&self, point: u32) -> impl Iterator<Item = u32> {
        self.ring(point).iter().flat_map(|&corner| self.opposite(corner))
    }

    /// Face of a corner.
    pub fn face_of(corner: Corner) -> usize {
        (corner >> 2) as usize
    }

    /// The wedge at a corner.
    pub fn wedge_at(&self, corner: Corner) -> u32 {
        self.corners_or_points()[Self::face_of(corner)][(corner & 3) as usize]
    }

    /// Whether all corners at `point` have the same wedge.
    pub fn has_one_wedge(&self, point: u32) -> bool {
        let ring = self.ring(point);
        self.corners.is_empty() || ring.iter().all(|&corner| self.wedge_at(corner) == self.wedge_at(ring[0]))
    }

    /// The two points after the corner in its face, counter-clockwise.
    pub fn opposite(&self, corner: Corner) -> [u32; 2] {
        others_of(self.faces[Self::face_of(corner)], corner)
    }

    /// The wedges that belong to [`Self::opposite`].
    pub fn opposite_wedges(&self, corner: Corner) -> [u32; 2] {
        others_of(self.corners_or_points()[Self::face_of(corner)], corner)
    }

    /// Removes a face.
    pub fn remove_face(&mut self, face: usize) {
        for k in 0..3 {
            self.rings.remove(self.faces[face][k], (face as u32) << 2 | k as u32);
        }
        self.faces[face][0] = DEAD;
        self.live -= 1;
    }

    /// Adds a face.
    pub fn add_face(&mut self, points: [u32; 3], wedges: [u32; 3]) -> usize {
        if points != wedges {
            self.tell_wedges_apart();
        }
        let face = self.faces.len();
        self.faces.push(points);
        if !self.corners.is_empty() || face == 0 {
            self.corners.push(wedges);
        }
        for (k, &p) in points.iter().enumerate() {
            self.rings.push(p, (face as u32) << 2 | k as u32);
        }
        self.live += 1;
        face
    }

    /// Puts another point, with a wedge, into corner `k` of a face.
    pub fn replace_corner(&mut self, face: usize, k: usize, point: u32, wedge: u32) {
        if point != wedge {
            self.tell_wedges_apart();
        }
        let corner = (face as u32) << 2 | k as u32;
        self.rings.remove(self.faces[face][k], corner);
        self.rings.push(point, corner);
        self.faces[face][k] = point;
        if !self.corners.is_empty() {
            self.corners[face][k] = wedge;
        }
    }

    /// Adds a point without faces.
    pub fn add_point(&mut self, position: DVec3) -> u32 {
        self.points.push(position);
        self.rings.spans.push(Span::default());
        let point = self.points.len() as u32 - 1;
        if !self.heirs.is_empty() {
            self.heirs.push(point);
        }
        point
    }

    /// The point that `point` has become part of.
    pub fn heir(&self, mut point: u32) -> u32 {
        while let Some(&heir) = self.heirs.get(point as usize).filter(|heir| **heir != point) {
            point = heir;
        }
        point
    }

    /// Nobody will ask for [heirs](Self::heir), or for any other point by the number it has now.
    pub fn forget_heirs(&mut self) {
        self.heirs = Vec::new();
    }

    /// Whether points may get other numbers.
    pub fn may_renumber(&self) -> bool {
        self.heirs.is_empty()
    }

    /// Does what `merge` says; `kept` moves to `position`.
    pub(super) fn collapse(&mut self, merge: &Merge, position: DVec3) {
        let (kept, gone) = (merge.kept, merge.gone);
        for &(point, corner) in &merge.across {
            self.rings.remove(point, corner);
            self.faces[Self::face_of(corner)][0] = DEAD;
        }
        self.live -= merge.across.len();
        for &corner in merge.spokes_of_gone() {
            self.faces[Self::face_of(corner)][(corner & 3) as usize] = kept;
        }
        for &corner in merge.spokes_of_gone().iter().take(self.corners.len()) {
            let wedge = &mut self.corners[Self::face_of(corner)][(corner & 3) as usize];
            *wedge = merge.target(*wedge);
        }
        self.rings.replace(kept, merge.spokes());
        self.rings.clear(gone);
        self.points[kept as usize] = position;
        if let Some(heir) = self.heirs.get_mut(gone as usize) {
            *heir = kept;
        }
    }

    /// Drops dead faces and the gaps in the rings. Face ids change, their order and all point ids stay. Gives whether there was anything to drop.
    pub fn compact(&mut self) -> bool {
        if self.faces.len() == self.live && self.rings.pool.len() == 3 * self.live {
            return false;
        }
        let mut next = 0;
        for f in 0..self.faces.len() {
            // Those that are dead are written over: which ones they are cannot be foretold.
            let is_live = self.is_live(f);
            self.faces[next] = self.faces[f];
            if !self.corners.is_empty() {
                self.corners[next] = self.corners[f];
            }
            next += usize::from(is_live);
        }
        self.faces.truncate(next);
        self.corners.truncate(next);
        self.rings.rebuild(self.points.len(), &self.faces);
        true
    }

    /// Whether every point has one wedge, which carries nothing.
    pub fn is_bare(&self) -> bool {
        !self.has_seams() && self.wedges.is_plain() && !self.wedges.has_groups()
    }

    /// The wedges of the points of a [bare](Self::is_bare) surface; empty if they have the same numbers.
    pub fn wedges_of(&self, points: &[u32]) -> Vec<u32> {
        if self.corners.is_empty() {
            return Vec::new();
        }
        points.iter().map(|&p| self.wedge_of(p)).collect()
    }

    /// The wedge of a point of a bare surface.
    fn wedge_of(&self, point: u32) -> u32 {
        self.ring(point).first().map_or(point, |&corner| self.wedge_at(corner))
    }

    /// A surface of these faces between points of this one, which is [bare](Self::is_bare).
    pub fn part(&self, region: &Region, faces: Vec<[u32; 3]>) -> Self {
        let points = &region.points;
        let mut part = Self {
            frame: self.frame,
            points: points.iter().map(|&p| self.points[p as usize]).collect(),
            live: faces.len(),
            faces,
            corners: Vec::new(),
            wedges: self.wedges.pick(region.wedges()),
            rings: Rings::default(),
            heirs: (0..if self.heirs.is_empty() { 0 } else { points.len() as u32 }).collect(),
        };
        part.rings.rebuild(points.len(), &part.faces);
        part
    }

    /// Drops all faces, and where points are; their number stays.
    pub fn drop_points_and_faces(&mut self) {
        self.points = Vec::new();
        (self.faces, self.corners) = Default::default();
        self.rings = Rings::default();
        self.live = 0;
    }

    /// Takes the faces of [parts](Self::part) and where their points are, of the `count` there are in all. If points [have](Self::may_renumber) other
    /// numbers now, so have their wedges.
    pub fn join<'a>(&mut self, parts: impl Iterator<Item = (&'a Region, Self)>, count: usize) {
        self.points.resize(count, DVec3::ZERO);
        if self.may_renumber() {
            self.wedges.renumber(count);
        }
        for (region, part) in parts {
            for (p, &position) in region.in_whole(&part.points) {
                self.points[p] = position;
            }
            if self.may_renumber() {
                self.wedges.take_origins(&part.wedges, region.in_whole((0..).map(|p| part.wedge_of(p))));
            } else {
                self.append_wedges_and_heirs(&part, region);
            }
            self.faces.extend(part.live_faces().map(|f| part.faces[f].map(|p| region.points[p as usize])));
        }
        self.live = self.faces.len();
        self.rings.rebuild(count, &self.faces);
    }

    /// Adds what stands at the corners of a part's faces, before these, and what became of its points, which have the numbers that they had.
    fn append_wedges_and_heirs(&mut self, part: &Self, region: &Region) {
        let (points, wedges) = (&region.points, region.wedges());
        let tells_apart = !region.wedges.is_empty() || !part.corners.is_empty();
        if tells_apart {
            self.tell_wedges_apart();
        }
        if tells_apart || !self.corners.is_empty() {
            let corners = part.corners_or_points();
            self.corners.extend(part.live_faces().map(|f| corners[f].map(|w| wedges[w as usize])));
        }
        for (&point, &heir) in points.iter().zip(&part.heirs) {
            if points[heir as usize] != point {
                self.heirs[point as usize] = points[heir as usize];
            }
        }
    }

    /// Leaves the first of several faces with the same wedges in the same cyclic order; gives whether there were any.
    fn drop_copies(&mut self, irregular: &Irregular) -> bool {
        let turned = |w: [u32; 3], k: usize| [w[k], w[(k + 1) % 3], w[(k + 2) % 3]];
        let mut after = Vec::new();
        for p in irregular.points() {
            let ring = self.ring(p);
            after.clear();
            after.extend(ring.iter().map(|&c| self.opposite(c)[0]));
            let copies: SmallVec<[usize; 4]> = (1..ring.len())
                .filter(|&i| holds(&after[..i], after[i]))
                .filter(|&i| {
                    let at = |c: Corner| turned(self.face_wedges(Self::face_of(c)), (c & 3) as usize);
                    (0..i).any(|j| after[j] == after[i] && at(ring[j]) == at(ring[i]))
                })
                .map(|i| Self::face_of(ring[i]))
                .collect();
            copies.into_iter().for_each(|face| self.remove_face(face));
        }
        self.compact()
    }

    /// The surface as plain arrays: only used vertices, in the order in which triangles first use them.
    pub fn to_mesh(&self) -> Mesh {
        let (mut mesh, order) = self.number_vertices();
        mesh.positions = tasks::collect(order.len(), |v| self.frame.leave(self.points[order[v].point as usize]));
        let wedges: Vec<u32> = order.into_iter().map(|v| v.wedge).collect();
        self.wedges.write(&wedges, &mut mesh);
        mesh
    }

    /// The surface, of which no vertex has moved or changed, as plain arrays in the order of [`Self::to_mesh`], and the vertex of `source` that each
    /// vertex is.
    pub fn to_subset(&self, source: &Mesh) -> (Mesh, Vec<u32>) {
        let (mesh, order) = self.number_vertices();
        let vertices: Vec<u32> = order.into_iter().map(|v| self.wedges.origin(v.wedge)).collect();
        (Mesh { triangles: mesh.triangles, groups: mesh.groups, ..source.pick_vertices(&vertices) }, vertices)
    }

    /// Triangles and groups as plain arrays, and what their vertices are.
    fn number_vertices(&self) -> (Mesh, Vec<Vertex>) {
        // A wedge may stand at several points only by a bug; keyed by wedge the vertex count stays minimal.
        let mut vertex_of = vec![u32::MAX; self.wedges.len()];
        // Which vertices are new cannot be foretold: those that are not are written over.
        let mut order = vec![Vertex { point: 0, wedge: 0 }; self.wedges.len().min(3 * self.live) + 1];
        let mut count = 0;
        let mut mesh = Mesh { triangles: Vec::with_capacity(self.live), ..Mesh::default() };
        for f in self.list_live_faces() {
            let (points, wedges) = (self.faces[f as usize], self.corners_or_points()[f as usize]);
            mesh.triangles.push([0, 1, 2].map(|k| {
                let (point, wedge) = (points[k], wedges[k]);
                let known = vertex_of[wedge as usize];
                let is_new = known == u32::MAX;
                let vertex = select_unpredictable(is_new, count as u32, known);
                vertex_of[wedge as usize] = vertex;
                order[count] = Vertex { point, wedge };
                count += usize::from(is_new);
                vertex
            }));
            if self.wedges.has_groups() {
                mesh.groups.push(self.wedges.group(wedges[0]));
            }
        }
        order.truncate(count);
        (mesh, order)
    }

    /// The live faces in order. Where many are dead, and which ones cannot be foretold, that is faster than looking for the next one each time.
    fn list_live_faces(&self) -> Vec<u32> {
        let mut live = vec![0; self.live + 1];
        let mut count = 0;
        for f in 0..self.faces.len() {
            live[count] = f as u32;
            count += usize::from(self.is_live(f));
        }
        live.truncate(count);
        live
    }
}

/// Sorts points by space, and faces, with what is at their corners, by points; gives which points were where the sorted ones are.
fn sort_by_space(points: &mut Vec<DVec3>, faces: &mut Vec<[u32; 3]>, corners: &mut Vec<[u32; 3]>) -> Vec<u32> {
    let in_space = order::order_roughly_in_space(points.iter().map(|p| p.as_vec3()));
    *points = order::pick(points, &in_space);
    let mut number = vec![0; points.len()];
    in_space.iter().zip(0..).for_each(|(&p, new)| number[p as usize] = new);
    faces.iter_mut().for_each(|face| *face = face.map(|p| number[p as usize]));
    let places = order::places_by_point(faces, points.len());
    *faces = order::put(faces, &places);
    if !corners.is_empty() {
        *corners = order::put(corners, &places);
    }
    in_space
}

/// What becomes a vertex of a plain mesh.
#[derive(Clone, Copy)]
struct Vertex {
    point: u32,
    wedge: u32,
}
