//! How attributes change over one face, four numbers at a time.

use crate::lanes::{LANES, Vec3x4};
use glam::Vec3;
use wide::f32x4;

/// A face thinner than this share of its length says little of its gradient across.
const THIN: f32 = 0.1;
/// A face that is smaller says nothing.
const LEAST_AREA: f32 = 1e-19;

/// Unit normal and area of a face.
pub(crate) type Facet = (Vec3, f32);

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
pub(super) type Spread = [f32; 6];

/// The same, lane by lane.
pub(super) type Products = [f32x4; 6];

/// How values change over a face.
pub(super) struct Slope {
    pub area: f32,
    /// The area, as far as gradients are trusted; its inverse.
    pub weight: f32,
    pub inverse: f32x4,
    /// The gradients of what goes from 0 to 1 along either edge, times the weight.
    along: [Vec3x4; 2],
    edges: [Vec3; 2],
    normal: Vec3,
}

impl Slope {
    /// Of a face with these edges from one of its corners; `None` if it says nothing.
    #[inline]
    pub fn new(edges: [Vec3; 2], (normal, area): Facet) -> Option<Self> {
        if area < LEAST_AREA {
            return None;
        }
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        let across = edges[0].distance_squared(edges[1]);
        let longest = larger(larger(edges[0].length_squared(), edges[1].length_squared()), across);
        let solid = 0.5 * THIN * longest;
        let trust = if area < solid { area / solid } else { 1.0 };
        let along = [edges[1].cross(normal), normal.cross(edges[0])].map(|along| splat(along * (0.5 * trust)));
        let weight = area * trust;
        Some(Self { area, weight, inverse: f32x4::splat(1.0 / weight), along, edges, normal })
    }

    /// The gradient of numbers that change by `steps` along the edges, times the weight. `displaces`: for a displacement, its scale in the unit frame.
    #[inline]
    pub fn gradient(&self, steps: [f32x4; 2], displaces: Option<f32>) -> Vec3x4 {
        let mut heavy = std::array::from_fn(|axis| self.along[0][axis] * steps[0] + self.along[1][axis] * steps[1]);
        if let Some(share) = displaces {
            self.add_turn(&mut heavy, steps, share);
        }
        heavy
    }

    /// Adds to the gradient of a displacement how what stands off the face moves as it turns.
    #[cold]
    fn add_turn(&self, heavy: &mut Vec3x4, steps: [f32x4; 2], share: f32) {
        let [to_b, to_c] = steps.map(|step| as_vec3(step) / share);
        let turned = (self.edges[0] + to_b).cross(self.edges[1] + to_c).try_normalize();
        let turn = turned.map_or(Vec3::ZERO, |turned| turned - self.normal) * (share * self.weight);
        let turn = f32x4::new([turn.x, turn.y, turn.z, 0.0]);
        heavy.iter_mut().zip(splat(self.normal)).for_each(|(g, normal)| *g += normal * turn);
    }
}

fn as_vec3(lanes: f32x4) -> Vec3 {
    let [x, y, z, _] = lanes.to_array();
    Vec3::new(x, y, z)
}

/// Adds the upper half of `a bᵀ`.
#[inline]
pub(super) fn add_products(products: &mut Products, a: Vec3x4, b: Vec3x4) {
    let added = [a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[1], a[1] * b[2], a[2] * b[2]];
    products.iter_mut().zip(added).for_each(|(sum, product)| *sum += product);
}

/// Over all lanes.
#[inline]
pub(super) fn sum_products([xx, xy, xz, yy, yz, zz]: Products) -> Spread {
    let sum = |vectors: [f32x4; LANES]| {
        let [a, b, c, d] = f32x4::transpose(vectors);
        (a + b + c + d).to_array()
    };
    let ([xx, xy, xz, yy], [yz, zz, ..]) = (sum([xx, xy, xz, yy]), sum([yz, zz, f32x4::ZERO, f32x4::ZERO]));
    [xx, xy, xz, yy, yz, zz]
}

#[inline]
fn splat(v: Vec3) -> Vec3x4 {
    v.to_array().map(f32x4::splat)
}
