//! The order in which things lie in memory: what is close in space should be close there, as each collapse needs what is around it.

use glam::Vec3;

/// Points from one face to the next from which that is a jump: what is known of so many of them fills the first cache.
const FAR: u32 = 512;
/// Share of the faces that come after a jump from which sorting pays.
const MANY: f64 = 1.0 / 3.0;

/// Whether faces come in an order that jumps.
pub(super) fn jumps(faces: &[[u32; 3]]) -> bool {
    let jumps = faces.windows(2).filter(|pair| first_point(&pair[0]).abs_diff(first_point(&pair[1])) > FAR).count();
    jumps as f64 > MANY * faces.len() as f64
}

/// The first of a face's points.
fn first_point(&[a, b, c]: &[u32; 3]) -> u32 {
    a.min(b).min(c)
}

/// Indices in the order of a curve through space.
pub(crate) fn order_in_space(places: impl Iterator<Item = Vec3>) -> Vec<u32> {
    order_by(places.map(spatial_key))
}

/// The same, as far as 32 cells a side tell places apart.
pub(super) fn order_roughly_in_space(places: impl Iterator<Item = Vec3>) -> Vec<u32> {
    order_by(places.map(|place| (spatial_key(place) >> 15) as u16))
}

fn order_by<K: radsort::Key + Copy>(keys: impl Iterator<Item = K>) -> Vec<u32> {
    let mut order: Vec<(K, u32)> = keys.zip(0..).collect();
    radsort::sort_by_key(&mut order, |&(key, _)| key);
    order.into_iter().map(|(_, i)| i).collect()
}

/// For each face its place in the order of their first points, of which there are `points`.
pub(super) fn places_by_point(faces: &[[u32; 3]], points: usize) -> Vec<u32> {
    let mut next = vec![0; points + 1];
    faces.iter().for_each(|face| next[first_point(face) as usize + 1] += 1);
    (0..points).for_each(|p| next[p + 1] += next[p]);
    let mut take = |p: u32| {
        let next = &mut next[p as usize];
        *next += 1;
        *next - 1
    };
    faces.iter().map(|face| take(first_point(face))).collect()
}

/// The items, each at its place.
pub(super) fn put<T: Copy + Default>(items: &[T], places: &[u32]) -> Vec<T> {
    let mut put = vec![T::default(); items.len()];
    items.iter().zip(places).for_each(|(&item, &place)| put[place as usize] = item);
    put
}

/// The items in another order.
pub(super) fn pick<T: Copy>(items: &[T], order: &[u32]) -> Vec<T> {
    order.iter().map(|&i| items[i as usize]).collect()
}

/// Position along a Morton curve through the unit frame, [-1, 1]³, in 1024 cells a side.
fn spatial_key(position: Vec3) -> u32 {
    let spread = |x: f32| {
        let x = ((x + 1.0) * 512.0).clamp(0.0, 1023.0) as u32;
        let x = (x | x << 16) & 0x0300_00ff;
        let x = (x | x << 8) & 0x0300_f00f;
        let x = (x | x << 4) & 0x030c_30c3;
        (x | x << 2) & 0x0924_9249
    };
    spread(position.x) | spread(position.y) << 1 | spread(position.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::surface::Surface;
    use crate::shapes::make_stand_in;

    #[test]
    fn sorting_changes_the_order_alone() {
        let mut mesh = make_stand_in(12_000);
        let count = mesh.triangles.len();
        // Coprime to the count.
        mesh.triangles = (0..count).map(|t| mesh.triangles[t * 7919 % count]).collect();
        let [given, sorted] = [false, true].map(|may_sort| Surface::with_irregular(&mesh, may_sort).0);
        let faces = |surface: &Surface| surface.live_faces().map(|f| surface.face(f)).collect::<Vec<_>>();
        assert!(jumps(&faces(&given)) && !jumps(&faces(&sorted)));
        let triangles = |surface: &Surface| {
            let wedges = |f| surface.face_wedges(f).map(|w| surface.wedges.origin(w));
            let mut triangles: Vec<_> = surface.live_faces().map(|f| (wedges(f), surface.triangle(f))).collect();
            triangles.sort_by_key(|(vertices, _)| *vertices);
            triangles
        };
        assert!(triangles(&given) == triangles(&sorted));
    }
}
