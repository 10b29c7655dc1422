//! Cards: leaves, blades, feathers. A level has fewer of them, and what is left grows to cover what all did (after Cook et al. 2007, "Stochastic
//! simplification of aggregate detail").
//!
//! Growth is for what is handed out: the chain goes on from cards of their own size. Texture coordinates stay.

use super::prune::{Part, find_parts};
use crate::bvh::Bvh;
use crate::mesh::Mesh;
use crate::mesh::edges::{Edge, EdgeKind};
use crate::mesh::surface::Surface;
use glam::DVec3;
use hashbrown::HashMap;

/// A card has no more faces: larger ones are bark or cloth.
const MOST_FACES: usize = 64;
/// A card so near to something else, relative to its diagonal, hangs there.
const STEM_REACH: f64 = 0.1;
/// No card becomes larger by more than this factor.
const MOST_GROWTH: f64 = 3.0;

/// Belongs to no card.
const NONE: u32 = u32::MAX;

/// The cards of the source.
#[derive(Debug)]
pub(crate) struct Cards {
    /// The card of each point.
    of_point: Vec<u32>,
    /// Where each card hangs, if it does.
    stems: Vec<Option<DVec3>>,
    area: f64,
    /// Corners of the bounding box of everything.
    low: DVec3,
    high: DVec3,
}

impl Cards {
    /// The small open parts of the source, if there are several.
    pub fn find(surface: &Surface, edges: &[Edge]) -> Option<Self> {
        let mut is_open = vec![false; surface.points.len()];
        let outline = EdgeKind::BORDER.with(EdgeKind::FOLD);
        edges.iter().filter(|e| e.kind.has(outline)).for_each(|e| is_open[e.a as usize] = true);
        let points = |part: &Part| part.faces.iter().flat_map(|&f| surface.face(f as usize)).collect::<Vec<u32>>();
        let is_card = |p: &Part| p.faces.len() <= MOST_FACES && points(p).iter().any(|&p| is_open[p as usize]);
        let (cards, rest): (Vec<Part>, Vec<Part>) = find_parts(surface).into_iter().partition(is_card);
        if cards.len() < 2 {
            return None;
        }
        let branches = grow_tree(surface, &rest);
        let mut of_point = vec![NONE; surface.points.len()];
        let mut stems = Vec::with_capacity(cards.len());
        for (card, part) in cards.iter().enumerate() {
            let points = points(part);
            points.iter().for_each(|&p| of_point[p as usize] = card as u32);
            let reach = STEM_REACH * part.low.distance(part.high);
            let near = |&p: &u32| {
                let point = surface.points[p as usize];
                branches.closest(point, reach).map(|hit| (hit.distance_squared, point))
            };
            let nearest = points.iter().filter_map(near).min_by(|a, b| a.0.total_cmp(&b.0));
            stems.push(nearest.map(|(_, point)| point));
        }
        let bounds = |pick: fn(DVec3, DVec3) -> DVec3, of: fn(&Part) -> DVec3| {
            cards.iter().chain(&rest).map(of).reduce(pick).unwrap_or_default()
        };
        Some(Self {
            of_point,
            stems,
            area: cards.iter().map(|card| card.area).sum(),
            low: bounds(DVec3::min, |part| part.low),
            high: bounds(DVec3::max, |part| part.high),
        })
    }

    /// Lets the cards of `level` grow, which is `surface` as a mesh: about their stems, or else about their centres and not out of the bounding box.
    pub fn grow(&self, surface: &Surface, level: &mut Mesh) {
        let parts = find_parts(surface);
        let left: Vec<(u32, &Part)> =
            parts.iter().map(|part| (self.card_of(surface, part), part)).filter(|(card, _)| *card != NONE).collect();
        let growth = (self.area / left.iter().map(|(_, part)| part.area).sum::<f64>()).sqrt();
        if !(growth > 1.0 && growth.is_finite()) {
            return;
        }
        let mut places = HashMap::new();
        let key = |p: [f32; 3]| p.map(f32::to_bits);
        for (card, part) in left {
            let size = part.high - part.low;
            // As large as there is room for.
            let room = ((self.high - self.low) / size.max(DVec3::splat(f64::MIN_POSITIVE))).min_element();
            let growth = growth.min(MOST_GROWTH).min(room).max(1.0);
            let stem = self.stems[card as usize];
            let about = stem.unwrap_or((part.low + part.high) * 0.5);
            let [low, high] = [part.low, part.high].map(|x| about + (x - about) * growth);
            // What stands on nothing else stands on the floor of the box, or hangs from its ceiling.
            let inwards = || (self.low - low).max(DVec3::ZERO) + (self.high - high).min(DVec3::ZERO);
            let shift = if stem.is_none() { inwards() } else { DVec3::ZERO };
            for point in part.faces.iter().flat_map(|&f| surface.triangle(f as usize)) {
                let place = about + (point - about) * growth + shift;
                places.insert(key(surface.frame.leave(point)), surface.frame.leave(place));
            }
        }
        for position in &mut level.positions {
            *position = *places.get(&key(*position)).unwrap_or(position);
        }
    }

    /// The card that a part of a level is made of. Points that were added belong to none.
    fn card_of(&self, surface: &Surface, part: &Part) -> u32 {
        let points = part.faces.iter().flat_map(|&f| surface.face(f as usize));
        points.filter_map(|p| self.of_point.get(p as usize)).copied().find(|&card| card != NONE).unwrap_or(NONE)
    }
}

/// What cards may hang on.
fn grow_tree(surface: &Surface, parts: &[Part]) -> Bvh {
    let positions: Vec<[f32; 3]> = surface.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let triangles: Vec<[u32; 3]> =
        parts.iter().flat_map(|part| &part.faces).map(|&f| surface.face(f as usize)).collect();
    Bvh::new(&positions, &triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::edges::collect_edges;
    use crate::simplify::{Options, Target, simplify};

    /// A ground of 2 × 2 and 100 cards in rows on it, each of two faces, one tenth high.
    fn lawn() -> Mesh {
        let mut mesh = Mesh::default();
        let mut add = |corners: [[f32; 3]; 4]| {
            let base = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        };
        // Closed: the same from below.
        let [a, b, c, d] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let box_of = |z: f32| [a, b, c, d].map(|[x, y, _]| [x, y, z]);
        let (top, low) = (box_of(0.0), box_of(-0.5));
        add(top);
        add([low[3], low[2], low[1], low[0]]);
        (0..4).for_each(|i| add([low[i], low[(i + 1) % 4], top[(i + 1) % 4], top[i]]));
        for i in 0..100 {
            let (x, y) = ((i % 10) as f32 * 0.18 - 0.81, (i / 10) as f32 * 0.18 - 0.81);
            let place = |u: f32, v: f32| [x + u * 0.05, y, 0.001 + v * (0.1 + 0.001 * i as f32)];
            add([place(0.0, 0.0), place(1.0, 0.0), place(1.0, 1.0), place(0.0, 1.0)]);
        }
        mesh
    }

    fn card_area(mesh: &Mesh) -> f64 {
        let surface = Surface::new(mesh);
        let parts = find_parts(&surface);
        parts.iter().filter(|p| p.faces.len() == 2).map(|p| p.area).sum::<f64>() / surface.frame.scale().powi(2)
    }

    #[test]
    fn blades_grow_upwards_and_cover_what_all_did() {
        let mesh = lawn();
        let levels = vec![Target::triangles(12 + 100), Target::triangles(12 + 40)];
        let chain = simplify(&mesh, &Options { levels, keep_area: true, ..Options::default() }).expect("valid");
        for (level, cards) in chain.levels.iter().zip([50, 20]) {
            assert_eq!(level.mesh.triangles.len(), 12 + 2 * cards, "no half cards");
            assert!((card_area(&level.mesh) / card_area(&mesh) - 1.0).abs() < 1e-3, "{}", card_area(&level.mesh));
            let blades = level.mesh.positions.iter().filter(|p| p[2] > 0.0);
            let lowest = blades.map(|p| p[2]).fold(f32::INFINITY, f32::min);
            assert!((lowest - 0.001).abs() < 1e-5, "they stand where they stood: {lowest}");
        }
    }

    #[test]
    fn growth_has_a_limit() {
        let (mesh, levels) = (lawn(), vec![Target::triangles(12 + 6)]);
        let level =
            &simplify(&mesh, &Options { levels, keep_area: true, ..Options::default() }).expect("valid").levels[0];
        let share = card_area(&level.mesh) / card_area(&mesh);
        // Three cards of a hundred, nine times as large, if they are of the larger ones.
        assert!((0.25..0.4).contains(&share), "{share}");
    }

    #[test]
    fn one_sheet_has_no_cards() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let surface = Surface::new(&mesh);
        assert!(Cards::find(&surface, &collect_edges(&surface)).is_none());
    }
}
