//! Meshes that simplifiers stumble over, made by formulas: the same on every machine.

use glam::{Mat3, Quat, Vec3};
use gltf_lod::mesh::{Attribute, Mesh, Semantic};
use std::f32::consts::{PI, TAU};

/// A mesh with a name.
pub struct Awkward {
    pub name: &'static str,
    pub mesh: Mesh,
    /// Whether it encloses a volume.
    pub closed: bool,
}

/// All of them.
pub fn awkward_meshes() -> Vec<Awkward> {
    let open = |name, mesh| Awkward { name, mesh, closed: false };
    let closed = |name, mesh| Awkward { name, mesh, closed: true };
    vec![
        closed("bolt", bolt()),
        closed("bolts", scatter(&bolt(), 150, 10.0, |_| 1.0)),
        closed("shells", scatter(&ball(3), 2000, 100.0, |unit| 0.3 * unit.powf(-0.6).min(40.0))),
        open("foliage", foliage(250)),
        open("wires", wires()),
        open("flat sheet", sheet(40, |_, _| 0.0)),
        open("curved sheet", sheet(40, |x, y| 0.3 * (4.0 * x).sin() * (3.0 * y).cos())),
        open("fan", fan()),
        open("copies", with_copies(&bumpy(14))),
        open("two-sided", two_sided(&sheet(24, |x, y| 0.2 * (5.0 * x + 2.0 * y).sin()), false)),
        open("lined", two_sided(&sheet(24, |x, y| 0.2 * (5.0 * x + 2.0 * y).sin()), true)),
        open("t-junctions", t_junctions()),
        closed("character", character()),
        closed("no-area", with_faces_without_area(&bumpy(14))),
        closed("shuffled", shuffled(&bumpy(20))),
    ]
}

/// Random numbers that are the same everywhere.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        ((self.0 >> 40) as f32 + 0.5) / (1u64 << 24) as f32
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f32) as usize % count
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::from_array([(); 3].map(|()| self.between(-1.0, 1.0)))
    }

    fn turn(&mut self) -> Quat {
        Quat::from_axis_angle(self.vector().normalize_or(Vec3::X), self.between(0.0, TAU))
    }
}

fn append(mesh: &mut Mesh, part: &Mesh, place: impl Fn(Vec3) -> Vec3) {
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions.iter().map(|&p| place(p.into()).to_array()));
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + base)));
}

/// A grid of `columns` × `rows` cells; closed around if `wraps`.
fn grid(columns: u32, rows: u32, wraps: bool, place: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let width = if wraps { columns } else { columns + 1 };
    let positions = (0..width * (rows + 1))
        .map(|i| place((i % width) as f32 / columns as f32, (i / width) as f32 / rows as f32).to_array())
        .collect();
    let at = |x: u32, y: u32| y * width + x % width;
    let triangles = (0..columns * rows)
        .flat_map(|i| {
            let (x, y) = (i % columns, i / columns);
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// A body of revolution with single points at both ends.
fn turned(columns: u32, outline: &[[f32; 2]]) -> Mesh {
    let rows = outline.len() as u32 - 1;
    let mut mesh = grid(columns, rows, true, |u, v| {
        let [radius, z] = outline[(v * rows as f32).round() as usize];
        Vec3::new(radius * (TAU * u).cos(), radius * (TAU * u).sin(), z)
    });
    let positions = mesh.positions.clone();
    let spot = |v: u32| positions[v as usize];
    mesh.triangles.retain(|t| spot(t[0]) != spot(t[1]) && spot(t[1]) != spot(t[2]) && spot(t[2]) != spot(t[0]));
    mesh
}

/// A head and a shaft with six sides: 48 triangles.
fn bolt() -> Mesh {
    turned(6, &[[0.0, -1.5], [0.4, -1.5], [0.4, 0.0], [0.8, 0.0], [0.8, 0.5], [0.0, 0.5]])
}

fn ball(rings: u32) -> Mesh {
    let outline: Vec<[f32; 2]> = (0..=rings)
        .map(|i| (i, PI * i as f32 / rings as f32))
        .map(|(i, a)| [if i == 0 || i == rings { 0.0 } else { a.sin() }, -a.cos()])
        .collect();
    turned(2 * rings, &outline)
}

fn bumpy(rings: u32) -> Mesh {
    let mut mesh = ball(rings);
    for p in &mut mesh.positions {
        let d = Vec3::from(*p);
        *p = (d * (1.0 + 0.2 * (5.0 * d.x).sin() * (4.0 * d.z + 1.0).cos())).to_array();
    }
    mesh
}

/// Copies of a part in a cube of this size, turned at random, scaled by `scale` of a random number.
fn scatter(part: &Mesh, count: usize, size: f32, scale: impl Fn(f32) -> f32) -> Mesh {
    let (mut random, mut mesh) = (Random(7), Mesh::default());
    for _ in 0..count {
        let (at, turn, scale) = (random.vector() * size, random.turn(), scale(random.unit()));
        append(&mut mesh, part, |p| at + turn * p * scale);
    }
    mesh
}

/// Crossed cards of two triangles around a stem, each with its part of an atlas and a normal.
fn foliage(crosses: usize) -> Mesh {
    let (mut random, mut mesh) = (Random(3), Mesh::default());
    let (mut uvs, mut normals) = (Vec::new(), Vec::new());
    for i in 0..crosses {
        let height = 3.0 * i as f32 / crosses as f32;
        let around = random.between(0.0, TAU);
        let out = (0.2 + 0.5 * (3.0 - height) * 0.6) * random.unit().sqrt();
        let at = Vec3::new(out * around.cos(), height, out * around.sin());
        let (turn, size, tile) = (random.turn(), random.between(0.1, 0.25), random.below(4) as f32);
        for quarter in [0.0, PI / 2.0] {
            let frame = Mat3::from_quat(turn * Quat::from_rotation_y(quarter));
            let base = mesh.positions.len() as u32;
            for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0f32]] {
                mesh.positions.push((at + frame * Vec3::new((u - 0.5) * size, v * size, 0.0)).to_array());
                uvs.extend([(tile + u) / 4.0, v]);
                normals.extend((frame * Vec3::Z).to_array());
            }
            mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        }
    }
    mesh.attributes = vec![
        Attribute { semantic: Semantic::Normal, width: 3, values: normals },
        Attribute { semantic: Semantic::TexCoord(0), width: 2, values: uvs },
    ];
    mesh
}

/// Open tubes, two hundred times as long as thick.
fn wires() -> Mesh {
    let (mut random, mut mesh) = (Random(5), Mesh::default());
    for _ in 0..6 {
        let (at, turn) = (random.vector() * 0.5, random.turn());
        let (coils, width) = (random.between(0.5, 3.0), random.between(0.2, 0.6));
        let path = |t: f32| Vec3::new(width * (TAU * coils * t).cos(), width * (TAU * coils * t).sin(), 3.0 * t);
        let wire = grid(6, 120, true, |u, t| {
            let along = (path(t + 0.001) - path(t - 0.001)).normalize();
            let side = along.any_orthonormal_vector();
            path(t) + 0.015 * (side * (TAU * u).cos() + along.cross(side) * (TAU * u).sin())
        });
        append(&mut mesh, &wire, |p| at + turn * p);
    }
    mesh
}

/// A square sheet with round holes and UVs.
fn sheet(cells: u32, height: impl Fn(f32, f32) -> f32) -> Mesh {
    let place = |u: f32, v: f32| Vec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, height(2.0 * u - 1.0, 2.0 * v - 1.0));
    let mut mesh = grid(cells, cells, false, place);
    let holes = [([-0.4, -0.3], 0.25), ([0.45, 0.1], 0.3), ([-0.2, 0.6], 0.15f32)];
    let positions = mesh.positions.clone();
    mesh.triangles.retain(|t| {
        let middle = t.iter().map(|&v| Vec3::from(positions[v as usize])).sum::<Vec3>() / 3.0;
        holes.iter().all(|([x, y], radius)| (middle.x - x).hypot(middle.y - y) > *radius)
    });
    let uvs = mesh.positions.iter().flat_map(|p| [p[0] * 0.5 + 0.5, p[1] * 0.5 + 0.5]).collect();
    mesh.attributes = vec![Attribute { semantic: Semantic::TexCoord(0), width: 2, values: uvs }];
    mesh
}

/// Curved pages around one spine: its edges have seven faces.
fn fan() -> Mesh {
    let mut mesh = Mesh::default();
    for page in 0..7 {
        let angle = TAU * page as f32 / 7.0;
        let leaf = grid(16, 16, false, |u, v| {
            let bent = angle + 0.4 * u * u;
            Vec3::new(u * bent.cos(), u * bent.sin(), 2.0 * v)
        });
        append(&mut mesh, &leaf, |p| p);
    }
    mesh
}

/// Every third face is there twice, every fifth a third time.
fn with_copies(mesh: &Mesh) -> Mesh {
    let mut mesh = mesh.clone();
    let faces = mesh.triangles.clone();
    mesh.triangles.extend(faces.iter().step_by(3));
    mesh.triangles.extend(faces.iter().step_by(5).map(|[a, b, c]| [*b, *c, *a]));
    mesh
}

/// Every face again, turned around: on the same vertices, or on others, which have the other normal.
fn two_sided(mesh: &Mesh, with_normals: bool) -> Mesh {
    let mut mesh = Mesh { attributes: Vec::new(), ..mesh.clone() };
    let (count, faces) = (mesh.positions.len(), mesh.triangles.clone());
    if !with_normals {
        mesh.triangles.extend(faces.iter().map(|[a, b, c]| [*a, *c, *b]));
        return mesh;
    }
    let mut normals = vec![Vec3::ZERO; count];
    for t in &faces {
        let [a, b, c] = t.map(|v| Vec3::from(mesh.positions[v as usize]));
        t.iter().for_each(|&v| normals[v as usize] += (b - a).cross(c - a));
    }
    mesh.positions.extend_from_within(..);
    mesh.triangles.extend(faces.iter().map(|[a, b, c]| [*a, *c, *b].map(|v| v + count as u32)));
    let units = normals.iter().map(|n| n.normalize_or_zero());
    let values = units.clone().chain(units.map(|n| -n)).flat_map(|n| n.to_array()).collect();
    mesh.attributes = vec![Attribute { semantic: Semantic::Normal, width: 3, values }];
    mesh
}

/// A fine and two coarse sheets that meet where only every third vertex has a partner.
fn t_junctions() -> Mesh {
    let wave = |x: f32, y: f32| Vec3::new(x, y, 0.15 * (6.0 * y).sin() + 0.1 * x * x);
    let mut mesh = grid(10, 30, false, wave);
    append(&mut mesh, &grid(4, 10, false, |u, v| wave(1.0 + u, v)), |p| p);
    append(&mut mesh, &grid(4, 10, false, |u, v| wave(u - 1.0, v)), |p| p);
    mesh
}

/// Sixty parts stuck into each other, in five materials: limbs, plates and pins.
fn character() -> Mesh {
    let (mut random, mut mesh) = (Random(11), Mesh::default());
    for part in 0..60 {
        let shape = match part % 3 {
            0 => ball(5),
            1 => turned(8, &[[0.0, -1.0], [0.7, -1.0], [0.9, 0.0], [0.7, 1.0], [0.0, 1.0]]),
            _ => turned(4, &[[0.0, -0.5], [0.7, -0.5], [0.7, 0.5], [0.0, 0.5]]),
        };
        let height = 1.8 * part as f32 / 60.0;
        let at = Vec3::new(0.35 * random.between(-1.0, 1.0), height, 0.15 * random.between(-1.0, 1.0));
        let (turn, size) = (random.turn(), random.between(0.03, 0.22));
        let stretch = Vec3::new(size, size * random.between(0.5, 1.0), size * random.between(1.0, 1.6));
        append(&mut mesh, &shape, |p| at + turn * (p * stretch));
        mesh.groups.resize(mesh.triangles.len(), part % 5);
    }
    mesh
}

/// Faces on a line, faces with a corner twice, and faces whose corners share a place.
fn with_faces_without_area(mesh: &Mesh) -> Mesh {
    let mut mesh = mesh.clone();
    for (i, [a, b, c]) in mesh.triangles.clone().into_iter().enumerate().step_by(4) {
        let new = mesh.positions.len() as u32;
        match i % 3 {
            0 => mesh.triangles.push([a, b, b]),
            1 => {
                mesh.positions.push(mesh.positions[a as usize]);
                mesh.triangles.push([a, new, c]);
            }
            _ => {
                let middle = (Vec3::from(mesh.positions[b as usize]) + Vec3::from(mesh.positions[c as usize])) * 0.5;
                mesh.positions.push(middle.to_array());
                mesh.triangles.push([b, new, c]);
            }
        }
    }
    mesh
}

/// Faces and vertices in an order of chance.
fn shuffled(mesh: &Mesh) -> Mesh {
    let mut random = Random(13);
    let mut order = |count: usize| -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        (1..count).for_each(|i| order.swap(i, random.below(i + 1)));
        order
    };
    let (vertices, faces) = (order(mesh.positions.len()), order(mesh.triangles.len()));
    let mut new = vec![0; vertices.len()];
    vertices.iter().enumerate().for_each(|(to, &from)| new[from] = to as u32);
    Mesh {
        positions: vertices.iter().map(|&v| mesh.positions[v]).collect(),
        triangles: faces.iter().map(|&f| mesh.triangles[f].map(|v| new[v as usize])).collect(),
        ..Mesh::default()
    }
}
