//! Poses: where an animation or morph weights take the vertices of a mesh, and of its levels.

use super::{Attribute, Mesh, Semantic};
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4, Mat4, Vec3};

/// Vertices that poses are told apart by.
const PROBES: usize = 400;
/// Squarings towards the best rotation: enough for poses that are turned over and thin.
const SQUARINGS: usize = 20;

/// A moment of an animation, or an extreme of a morph target.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pose {
    /// For each joint what it does to positions; empty if joints do not count.
    pub joints: Vec<Mat4>,
    /// Weight of each morph target; those left out are 0.
    pub weights: Vec<f32>,
}

impl Pose {
    /// Where the vertices of `mesh` go.
    pub fn apply(&self, mesh: &Mesh) -> Vec<[f32; 3]> {
        let all: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        self.apply_to(mesh, &all).into_iter().map(Vec3::into).collect()
    }

    /// Vertices of another mesh of its kind, as they are in this pose.
    pub fn posed(&self, mesh: &Mesh) -> Mesh {
        Mesh {
            positions: self.apply(mesh),
            triangles: mesh.triangles.clone(),
            groups: mesh.groups.clone(),
            ..Mesh::default()
        }
    }

    /// The same pose moved, turned and scaled to lie as near as can be to `mesh` at rest: what is left is deformation.
    #[must_use]
    pub fn aligned(self, mesh: &Mesh) -> Self {
        if self.joints.is_empty() {
            return self;
        }
        let probes = probe(mesh);
        let rest: Vec<DVec3> = probes.iter().map(|&v| Vec3::from(mesh.positions[v as usize]).as_dvec3()).collect();
        let posed: Vec<DVec3> = self.apply_to(mesh, &probes).into_iter().map(|p| p.as_dvec3()).collect();
        let back = find_similarity(&posed, &rest);
        let joints = self.joints.iter().map(|joint| (back * joint.as_dmat4()).as_mat4()).collect();
        Self { joints, ..self }
    }

    fn apply_to(&self, mesh: &Mesh, vertices: &[u32]) -> Vec<Vec3> {
        let mut points: Vec<Vec3> = vertices.iter().map(|&v| Vec3::from(mesh.positions[v as usize])).collect();
        for attribute in mesh.attributes.iter().filter(|a| a.width == 3) {
            let Semantic::MorphPosition(target) = attribute.semantic else { continue };
            let weight = self.weights.get(target as usize).copied().unwrap_or(0.0);
            if weight != 0.0 {
                for (point, &v) in points.iter_mut().zip(vertices) {
                    *point += Vec3::from_slice(&attribute.values[3 * v as usize..]) * weight;
                }
            }
        }
        let (false, Some(skin)) = (self.joints.is_empty(), &mesh.skin) else { return points };
        for (point, &v) in points.iter_mut().zip(vertices) {
            let range = v as usize * skin.influences..(v as usize + 1) * skin.influences;
            let influences = skin.joints[range.clone()].iter().zip(&skin.weights[range]).filter(|(_, w)| **w > 0.0);
            let moved = influences.filter_map(|(&j, &w)| Some((self.joints.get(j as usize)?, w)));
            let (sum, total) = moved.fold((Vec3::ZERO, 0.0), |(sum, total), (joint, weight)| {
                (sum + joint.transform_point3(*point) * weight, total + weight)
            });
            // What no joint moves stays.
            *point = if total > 0.0 { sum / total } else { *point };
        }
        points
    }

    /// Displacements of the vertices of `mesh` as an attribute for [`simplify`](crate::simplify::simplify()): the pose number `index` then counts as
    /// the shape at rest does.
    pub fn attribute(&self, mesh: &Mesh, index: u32) -> Attribute {
        let displaced = self.apply(mesh).into_iter().zip(&mesh.positions);
        let values = displaced.flat_map(|(to, from)| (Vec3::from(to) - Vec3::from(*from)).to_array()).collect();
        Attribute { semantic: Semantic::Pose(index), width: 3, values }
    }
}

/// Puts those of `poses` first that differ most from the shape at rest and from each other, and keeps `count` at most. All must be
/// [aligned](Pose::aligned) to `mesh`. Poses that differ by less than `least` (a length) from rest or another one say nothing new.
pub fn choose_poses(mesh: &Mesh, poses: Vec<Pose>, count: usize, least: f64) -> Vec<Pose> {
    let probes = probe(mesh);
    let shapes: Vec<Vec<Vec3>> = poses.iter().map(|pose| pose.apply_to(mesh, &probes)).collect();
    let rest = Pose::default().apply_to(mesh, &probes);
    let mut nearest: Vec<f64> = shapes.iter().map(|shape| root_mean_square(shape, &rest)).collect();
    let mut chosen = Vec::new();
    while chosen.len() < count {
        let farthest = nearest.iter().enumerate().max_by(|(i, a), (j, b)| a.total_cmp(b).then(j.cmp(i)));
        let Some((index, _)) = farthest.filter(|(_, distance)| **distance > least) else { break };
        for (near, shape) in nearest.iter_mut().zip(&shapes) {
            *near = near.min(root_mean_square(shape, &shapes[index]));
        }
        chosen.push(index);
    }
    let mut poses: Vec<Option<Pose>> = poses.into_iter().map(Some).collect();
    chosen.into_iter().filter_map(|index| poses[index].take()).collect()
}

/// Vertices spread over the mesh.
fn probe(mesh: &Mesh) -> Vec<u32> {
    let corners = mesh.triangles.as_flattened();
    corners.iter().step_by((corners.len() / PROBES).max(1)).copied().collect()
}

fn root_mean_square(a: &[Vec3], b: &[Vec3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(a.distance_squared(*b)));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}

/// The move, turn and uniform scale that bring the points `from` nearest to `to` (Horn 1987).
fn find_similarity(from: &[DVec3], to: &[DVec3]) -> DMat4 {
    let count = from.len().max(1) as f64;
    let centre = |points: &[DVec3]| points.iter().sum::<DVec3>() / count;
    let (from_centre, to_centre) = (centre(from), centre(to));
    let mut products = DMat3::ZERO;
    let mut square = 0.0;
    for (a, b) in from.iter().zip(to) {
        let (a, b) = (*a - from_centre, *b - to_centre);
        products += DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        square += a.length_squared();
    }
    let rotation = find_rotation(products);
    let turned = DMat3::from_quat(rotation);
    let matched = turned * products;
    let along = matched.x_axis.x + matched.y_axis.y + matched.z_axis.z;
    let scale = if square > 0.0 && along > 0.0 { along / square } else { 1.0 };
    let shift = to_centre - turned * from_centre * scale;
    DMat4::from_scale_rotation_translation(DVec3::splat(scale), rotation, shift)
}

/// The rotation `R` that makes the trace of `R Σ a bᵀ` largest.
fn find_rotation(s: DMat3) -> DQuat {
    let [[xx, yx, zx], [xy, yy, zy], [xz, yz, zz]] = s.to_cols_array_2d();
    let rows = [
        DVec4::new(xx + yy + zz, yz - zy, zx - xz, xy - yx),
        DVec4::new(yz - zy, xx - yy - zz, xy + yx, zx + xz),
        DVec4::new(zx - xz, xy + yx, yy - xx - zz, yz + zy),
        DVec4::new(xy - yx, zx + xz, yz + zy, zz - xx - yy),
    ];
    let size = rows.iter().map(|row| row.length_squared()).sum::<f64>().sqrt();
    if size == 0.0 {
        return DQuat::IDENTITY;
    }
    // A high power of the matrix has its foremost eigenvector in all columns.
    let columns = DMat4::from_cols_array_2d(&rows.map(|row| (row / size).to_array()));
    let mut power = columns + DMat4::IDENTITY;
    for _ in 0..SQUARINGS {
        power *= power;
        power *= 1.0 / power.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis, power.w_axis];
    let longest = columns.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let found = longest.and_then(DVec4::try_normalize).unwrap_or(DVec4::X);
    DQuat::from_xyzw(found.y, found.z, found.w, found.x)
}

#[cfg(test)]
mod tests {
    use super::super::Skin;
    use super::*;

    /// A strip along x, its far half bound to the second of two joints.
    fn strip() -> Mesh {
        let positions: Vec<[f32; 3]> = (0..16).map(|i| [(i / 2) as f32, (i % 2) as f32, 0.0]).collect();
        let joints = (0..16).map(|i| u16::from(i >= 8)).collect();
        Mesh {
            triangles: (0..14).map(|i| [i, i + 1, i + 2]).collect(),
            skin: Some(Skin { influences: 1, joints, weights: vec![1.0; 16] }),
            positions,
            ..Mesh::default()
        }
    }

    fn turn(degrees: f32) -> Mat4 {
        Mat4::from_rotation_y(degrees.to_radians())
    }

    #[test]
    fn motion_without_deformation_is_no_pose() {
        let mesh = strip();
        let moved = Mat4::from_scale_rotation_translation(
            Vec3::splat(0.01),
            glam::Quat::from_rotation_x(2.0),
            Vec3::new(5.0, -3.0, 2.0),
        );
        let pose = Pose { joints: vec![moved; 2], weights: Vec::new() }.aligned(&mesh);
        for (to, from) in pose.apply(&mesh).into_iter().zip(&mesh.positions) {
            assert!(Vec3::from(to).distance(Vec3::from(*from)) < 1e-4, "{to:?} instead of {from:?}");
        }
        assert_eq!(choose_poses(&mesh, vec![pose], 4, 1e-3), []);
    }

    #[test]
    fn poses_that_differ_come_first() {
        let mesh = strip();
        let bent = |degrees: f32| Pose { joints: vec![turn(0.0), turn(degrees)], weights: Vec::new() };
        let poses: Vec<Pose> = [10.0, 80.0, 81.0, -60.0].map(|d| bent(d).aligned(&mesh)).to_vec();
        let chosen = choose_poses(&mesh, poses.clone(), 2, 1e-3);
        assert_eq!(chosen, [poses[2].clone(), poses[3].clone()]);
        assert_eq!(choose_poses(&mesh, poses, 9, 0.1).len(), 3, "two are nearly the same");
    }

    #[test]
    fn what_no_joint_moves_stays() {
        let mut mesh = strip();
        mesh.skin.as_mut().unwrap().weights[15] = 0.0;
        let pose = Pose { joints: vec![Mat4::from_translation(Vec3::Z); 2], weights: Vec::new() };
        let posed = pose.apply(&mesh);
        assert_eq!((posed[14], posed[15]), ([7.0, 0.0, 1.0], [7.0, 1.0, 0.0]));
    }
}
