//! The shapes: each curved enough in some places and flat enough in others to be worth simplifying.

use super::portable::{cos_sin, noise, random, rough_noise};
use super::shape::{Grid, Shape, from_f32, to_f32};
use glam::DVec3;

/// A tube along a (2, 3) torus knot, closed both ways.
pub fn torus_knot(columns: usize, rows: usize) -> Shape {
    let curve = |t: f64| {
        let ((c2, s2), (c3, s3)) = (cos_sin(2.0 * t), cos_sin(3.0 * t));
        DVec3::new((2.0 + c3) * c2, s3, (2.0 + c3) * s2)
    };
    Shape::from_grid(Grid { columns, rows, wrap: [true, true] }, |u, v| {
        let centre = curve(v);
        let along = (curve(v + 1e-3) - curve(v - 1e-3)).normalize();
        let side = DVec3::new(centre.x, 0.0, centre.z).normalize().cross(along).normalize();
        let (c, s) = cos_sin(u);
        centre + 0.4 * (c * side + s * along.cross(side))
    })
}

/// A sphere of radius 1 with `bump` noise on it; seam in u, poles at ±y.
pub fn bumpy_sphere(columns: usize, rows: usize, bump: f64, seed: u32) -> Shape {
    Shape::from_grid(Grid { columns, rows, wrap: [true, false] }, |u, v| {
        let ((cu, su), (cv, sv)) = (cos_sin(-u), cos_sin(v / 2.0));
        let direction = DVec3::new(sv * cu, -cv, sv * su);
        direction * (1.0 + bump * rough_noise(direction * 2.0, seed))
    })
}

/// A box of half extents `half` with round edges; six charts, so that every edge is a UV seam but smooth.
pub fn rounded_box(half: DVec3, radius: f64, cells: usize) -> Shape {
    let mut shape = Shape::default();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let grid = Grid { columns: cells, rows: cells, wrap: [false, false] };
            shape.append(&Shape::from_grid(grid, |u, v| {
                let mut on_cube = [0.0; 3];
                on_cube[axis] = sign;
                on_cube[(axis + 1) % 3] = sign * (2.0 * u - 1.0);
                on_cube[(axis + 2) % 3] = 2.0 * v - 1.0;
                let outer = DVec3::from(on_cube) * half;
                let inner = outer.clamp(DVec3::splat(radius) - half, half - DVec3::splat(radius));
                inner + (outer - inner).normalize() * radius
            }));
        }
    }
    shape.smooth_normals();
    shape
}

/// A gear with a hole: flat lids, hard edges, small teeth.
pub fn gear(teeth: usize) -> Shape {
    const SAMPLES: usize = 8;
    let outline = |u: f64| {
        let phase = (u * teeth as f64 + 1e-9).fract();
        if (0.25..=0.75).contains(&phase) { 1.15 } else { 0.95 }
    };
    let point = |radius: f64, u: f64, z: f64| {
        let (c, s) = cos_sin(u);
        DVec3::new(radius * c, radius * s, z)
    };
    let grid = |rows| Grid { columns: teeth * SAMPLES, rows, wrap: [true, false] };
    let mut shape = Shape::from_grid(grid(3), |u, v| point(outline(u) * (1.0 - v) + 0.4 * v, u, 0.15));
    shape.append(&Shape::from_grid(grid(3), |u, v| point(0.4 * (1.0 - v) + outline(u) * v, u, -0.15)));
    shape.append(&Shape::from_grid(grid(2), |u, v| point(outline(u), u, 0.3 * v - 0.15)));
    shape.append(&Shape::from_grid(grid(2), |u, v| point(0.4, u, 0.15 - 0.3 * v)));
    shape
}

/// A square tile of side 2 in the xz plane with hills; open border.
pub fn terrain(cells: usize, height: f64, seed: u32) -> Shape {
    Shape::from_grid(Grid { columns: cells, rows: cells, wrap: [false, false] }, |u, v| {
        let p = DVec3::new(2.0 * u - 1.0, 0.0, 1.0 - 2.0 * v);
        p.with_y(height * rough_noise(p * 2.0 + DVec3::splat(0.5), seed))
    })
}

/// A closed cylinder along +y from 0 to `length`; `radius(v)` in metres along it.
pub fn cylinder(columns: usize, rows: usize, length: f64, radius: impl Fn(f64) -> f64) -> Shape {
    Shape::from_grid(Grid { columns, rows: rows + 4, wrap: [true, false] }, |u, v| {
        // The first and the last two rows close the ends.
        let row = v * (rows + 4) as f64;
        let along = ((row - 2.0) / rows as f64).clamp(0.0, 1.0);
        let share = (row / 2.0).min((rows as f64 + 4.0 - row) / 2.0).clamp(0.0, 1.0);
        let ((c, s), r) = (cos_sin(-u), radius(along) * share);
        DVec3::new(r * c, along * length, r * s)
    })
}

/// A bowl of thin material: two parallel walls and a rim.
pub fn thin_bowl(columns: usize, rows: usize) -> Shape {
    Shape::from_grid(Grid { columns, rows: 2 * rows + 1, wrap: [true, false] }, |u, v| {
        let row = v * (2 * rows + 1) as f64;
        // Outside upward, then inside downward; the walls are 1 % of the radius apart.
        let (polar, radius) = if row <= rows as f64 + 0.5 {
            (row / rows as f64, 1.0)
        } else {
            ((2.0 * rows as f64 + 1.0 - row) / rows as f64, 0.99)
        };
        let ((cu, su), (cv, sv)) = (cos_sin(-u), cos_sin(polar * 0.3));
        DVec3::new(sv * cu, -cv, sv * su) * radius
    })
}

/// A tuft of bent, open leaf cards; both sides are meant to be seen.
pub fn plant(cards: u32, segments: usize) -> Shape {
    let mut shape = Shape::default();
    for card in 0..cards {
        let [turn, lean, size, start] = [0, 1, 2, 3].map(|k| random(card, 17 + k));
        let ((c, s), base) = (cos_sin(turn), 0.15 * start);
        let (out, side) = (DVec3::new(c, 0.0, s), DVec3::new(-s, 0.0, c));
        let grid = Grid { columns: 2, rows: segments, wrap: [false, false] };
        shape.append(&Shape::from_grid(grid, |u, v| {
            let half_width = 0.06 * (1.0 + 3.0 * v * (1.0 - v));
            let bend = (0.2 + 0.6 * lean) * v * v;
            let fold = 0.03 * (2.0 * u - 1.0) * (2.0 * u - 1.0);
            out * (base + bend)
                + side * half_width * (2.0 * u - 1.0)
                + DVec3::Y * ((0.5 + size) * v * (1.0 - 0.3 * v) + fold)
        }));
    }
    shape
}

/// A head: a sphere stretched, with brow, nose and chin.
pub fn head(columns: usize, rows: usize) -> Shape {
    let feature = |d: DVec3, at: DVec3, width: f64, height: f64| {
        let x = (1.0 - d.distance_squared(at.normalize()) / (width * width)).max(0.0);
        height * x * x
    };
    Shape::from_grid(Grid { columns, rows, wrap: [true, false] }, |u, v| {
        let ((cu, su), (cv, sv)) = (cos_sin(-u), cos_sin(v / 2.0));
        let d = DVec3::new(sv * cu, -cv, sv * su);
        let r = 1.0
            + feature(d, DVec3::new(0.0, -0.05, 1.0), 0.35, 0.3)
            + feature(d, DVec3::new(0.0, 0.4, 0.9), 0.5, 0.1)
            + feature(d, DVec3::new(0.0, -0.7, 0.7), 0.5, 0.15)
            + 0.01 * noise(d * 9.0, 3);
        d * r * DVec3::new(0.8, 1.1, 0.9)
    })
}

/// The unit cube: 12 triangles, hard edges.
pub fn cube() -> Shape {
    let mut shape = Shape::default();
    for axis in 0..3 {
        for sign in [0.5, -0.5] {
            let grid = Grid { columns: 1, rows: 1, wrap: [false, false] };
            shape.append(&Shape::from_grid(grid, |u, v| {
                let mut p = [0.0; 3];
                p[axis] = sign;
                p[(axis + 1) % 3] = 2.0 * sign * (u - 0.5);
                p[(axis + 2) % 3] = v - 0.5;
                DVec3::from(p)
            }));
        }
    }
    shape
}

/// A vase's wall as rows of points (from the foot to the rim) of `columns` positions each, and its radius profile.
pub fn vase_rings(columns: usize, rows: usize) -> Vec<Vec<[f32; 3]>> {
    let ring = |row: usize| {
        let v = row as f64 / rows as f64;
        let (_, wave) = cos_sin(0.8 * v + 0.05);
        let radius = 0.45 + 0.3 * wave - 0.15 * v;
        let point = |column: usize| {
            let (c, s) = cos_sin(-(column as f64) / columns as f64);
            let (flute, _) = cos_sin(6.0 * column as f64 / columns as f64);
            to_f32(DVec3::new(c, 0.0, s) * radius * (1.0 + 0.05 * flute) + DVec3::Y * 1.6 * v)
        };
        (0..columns).map(point).collect()
    };
    (0..=rows).map(ring).collect()
}

/// Smooth unit normals of rows of points as [`vase_rings`] gives them: across the direction to the neighbours.
pub fn ring_normals(rings: &[Vec<[f32; 3]>]) -> Vec<Vec<[f32; 3]>> {
    let at = |row: usize, column: usize| from_f32(rings[row][column]);
    let normal = |row: usize, column: usize| {
        let n = rings[row].len();
        let around = at(row, (column + 1) % n) - at(row, (column + n - 1) % n);
        let up = at((row + 1).min(rings.len() - 1), column) - at(row.saturating_sub(1), column);
        to_f32(around.cross(up).normalize())
    };
    (0..rings.len()).map(|row| (0..rings[row].len()).map(|column| normal(row, column)).collect()).collect()
}
