//! Plain triangle meshes and the operations the assets are made with.

use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// A triangle mesh with normals and one UV set.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    /// Positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates.
    pub uvs: Vec<[f32; 2]>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A grid of `columns` × `rows` cells. `wrap` makes the last column the first one again: vertices there are doubled
/// (they differ in u), their positions are equal bit for bit.
#[derive(Clone, Copy)]
pub struct Grid {
    /// Cells along u.
    pub columns: usize,
    /// Cells along v.
    pub rows: usize,
    /// Whether u and v close.
    pub wrap: [bool; 2],
}

impl Shape {
    /// The surface of `point(u, v)` over the unit square; its front is where ∂u × ∂v points. Cells that shrink to a
    /// point or a line (poles) lose those triangles.
    pub fn from_grid(grid: Grid, point: impl Fn(f64, f64) -> DVec3) -> Self {
        let mut shape = Self::default();
        let place = |i: usize, n: usize, wrap: bool| if wrap { i % n } else { i } as f64 / n as f64;
        for row in 0..=grid.rows {
            for column in 0..=grid.columns {
                let (u, v) = (place(column, grid.columns, grid.wrap[0]), place(row, grid.rows, grid.wrap[1]));
                shape.positions.push(to_f32(point(u, v)));
                shape.uvs.push([column as f32 / grid.columns as f32, row as f32 / grid.rows as f32]);
            }
        }
        for row in 0..grid.rows as u32 {
            for column in 0..grid.columns as u32 {
                let stride = grid.columns as u32 + 1;
                let a = row * stride + column;
                let (b, c, d) = (a + 1, a + stride + 1, a + stride);
                // Alternate diagonals: no direction is preferred.
                let pair = if (row + column) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                shape.triangles.extend(pair);
            }
        }
        shape.triangles.retain(|t| !has_equal_corners(&shape.positions, t));
        shape.drop_unused_vertices();
        shape.smooth_normals();
        shape
    }

    /// Area-weighted normals, shared by all vertices at one position.
    pub fn smooth_normals(&mut self) {
        let mut sums = BTreeMap::<[u32; 3], DVec3>::new();
        for t in &self.triangles {
            let normal = self.area_normal(t);
            t.iter().for_each(|&v| *sums.entry(self.key(v)).or_default() += normal);
        }
        self.normals = (0..self.positions.len() as u32).map(|v| to_f32(sums[&self.key(v)].normalize())).collect();
    }

    /// Adds `other`; nothing is welded, so that edges between the two stay hard.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.normals.extend(&other.normals);
        self.uvs.extend(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
    }

    /// Every triangle with corners of its own and a flat normal.
    pub fn faceted(&self) -> Self {
        let mut out = Self::default();
        for t in &self.triangles {
            let normal = to_f32(self.area_normal(t).normalize());
            let first = out.positions.len() as u32;
            out.triangles.push([first, first + 1, first + 2]);
            for &v in t {
                out.positions.push(self.positions[v as usize]);
                out.normals.push(normal);
                out.uvs.push(self.uvs[v as usize]);
            }
        }
        out
    }

    /// One vertex a position: what is left when a mesh has positions only.
    pub fn welded(&self) -> Self {
        let mut first = BTreeMap::new();
        let target: Vec<u32> =
            (0..self.positions.len() as u32).map(|v| *first.entry(self.key(v)).or_insert(v)).collect();
        let mut out = self.clone();
        out.triangles.iter_mut().flatten().for_each(|v| *v = target[*v as usize]);
        out.drop_unused_vertices();
        out
    }

    /// The triangles for whose centre `inside` holds, and the others; each with vertices of its own.
    pub fn split(&self, inside: impl Fn(DVec3) -> bool) -> (Self, Self) {
        let part = |wanted: bool| {
            let mut part = self.clone();
            part.triangles.retain(|t| inside(self.centre(t)) == wanted);
            part.drop_unused_vertices();
            part
        };
        (part(true), part(false))
    }

    /// Tangents along u with handedness, orthogonal to the normals.
    pub fn tangents(&self) -> Vec<[f32; 4]> {
        let mut sums = vec![(DVec3::ZERO, DVec3::ZERO); self.positions.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| from_f32(self.positions[v as usize]));
            let [p, q, r] = t.map(|v| DVec2::new(self.uvs[v as usize][0].into(), self.uvs[v as usize][1].into()));
            let (e, f, g, h) = (b - a, c - a, q - p, r - p);
            let turn = if g.x * h.y - g.y * h.x < 0.0 { -1.0 } else { 1.0 };
            for &v in t {
                sums[v as usize].0 += turn * (h.y * e - g.y * f);
                sums[v as usize].1 += turn * (g.x * f - h.x * e);
            }
        }
        let tangent = |(sum, normal): (&(DVec3, DVec3), &[f32; 3])| {
            let n = from_f32(*normal);
            let [x, y, z] = to_f32((sum.0 - n * n.dot(sum.0)).normalize());
            [x, y, z, if n.cross(sum.0).dot(sum.1) < 0.0 { -1.0 } else { 1.0 }]
        };
        sums.iter().zip(&self.normals).map(tangent).collect()
    }

    /// `value` of each vertex's position.
    pub fn per_vertex<T>(&self, value: impl Fn(DVec3) -> T) -> Vec<T> {
        self.positions.iter().map(|&p| value(from_f32(p))).collect()
    }

    /// Moves every vertex; normals follow.
    pub fn moved(&self, to: impl Fn(DVec3) -> DVec3) -> Self {
        let mut out = self.clone();
        out.positions.iter_mut().for_each(|p| *p = to_f32(to(from_f32(*p))));
        out.smooth_normals();
        out
    }

    fn drop_unused_vertices(&mut self) {
        let mut index = vec![None; self.positions.len()];
        let mut kept = Self::default();
        for v in self.triangles.iter_mut().flatten() {
            let old = *v as usize;
            *v = *index[old].get_or_insert_with(|| {
                kept.positions.push(self.positions[old]);
                kept.normals.extend(self.normals.get(old));
                kept.uvs.extend(self.uvs.get(old));
                kept.positions.len() as u32 - 1
            });
        }
        (self.positions, self.normals, self.uvs) = (kept.positions, kept.normals, kept.uvs);
    }

    fn key(&self, vertex: u32) -> [u32; 3] {
        self.positions[vertex as usize].map(f32::to_bits)
    }

    fn area_normal(&self, t: &[u32; 3]) -> DVec3 {
        let [a, b, c] = t.map(|v| from_f32(self.positions[v as usize]));
        (b - a).cross(c - a)
    }

    fn centre(&self, t: &[u32; 3]) -> DVec3 {
        t.iter().map(|&v| from_f32(self.positions[v as usize])).sum::<DVec3>() / 3.0
    }
}

fn has_equal_corners(positions: &[[f32; 3]], t: &[u32; 3]) -> bool {
    let [a, b, c] = t.map(|v| positions[v as usize]);
    a == b || b == c || c == a
}

/// Rounds to storage; adding zero turns −0 into 0, so that equal positions have equal bits.
pub fn to_f32(p: DVec3) -> [f32; 3] {
    [p.x as f32 + 0.0, p.y as f32 + 0.0, p.z as f32 + 0.0]
}

/// Widens for computing.
pub fn from_f32(p: [f32; 3]) -> DVec3 {
    DVec3::new(p[0].into(), p[1].into(), p[2].into())
}
