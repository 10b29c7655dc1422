//! Taking the state of a reduction apart, and putting it together again.

use super::Reducer;
use crate::mesh::regions::{Region, cut};
use crate::mesh::surface::Surface;
use crate::simplify::Refusals;
use crate::simplify::cost::Cost;
use rayon::prelude::*;

impl Reducer {
    /// Whether [`Self::split`] may be called.
    pub fn is_separable(&self) -> bool {
        self.cost.is_separable() && self.surface.is_bare() && self.log.is_none()
    }

    /// Takes the surface apart; all parts have to be [joined](Self::join) again.
    pub fn split(&mut self, count: usize) -> Vec<(Region, Self)> {
        let parts = cut(&mut self.surface, count);
        self.edges = Vec::new();
        let costs = self.cost.split(&parts);
        let part = |((region, surface), cost): ((Region, Surface), Box<dyn Cost>)| {
            let part = self.part(surface, cost, &region.points);
            (region, part)
        };
        parts.into_par_iter().zip(costs).map(part).collect()
    }

    fn part(&self, surface: Surface, cost: Box<dyn Cost>, points: &[u32]) -> Self {
        let pick = |flags: &[bool]| points.iter().map(|&p| flags[p as usize]).collect::<Vec<bool>>();
        Self {
            surface,
            cost,
            refusals: Refusals::default(),
            log: None,
            edges: Vec::new(),
            has_pieces: false,
            constraints: self.constraints,
            locked: self.locked.pick(points),
            border: pick(&self.border),
            irregular: self.irregular.pick(points),
            solution: Default::default(),
            merge: Default::default(),
            fan: Default::default(),
            needles: self.needles,
            to_ends: self.to_ends,
            whole_cards: self.whole_cards,
            effort: self.effort,
        }
    }

    /// Puts the surface together again.
    pub fn join(&mut self, parts: Vec<(Region, Self)>) {
        let count = self.border.len();
        let take_apart = |(region, part): (Region, Self)| {
            let Self { surface, cost, border, locked, irregular, refusals, .. } = part;
            (region, (surface, (cost, border, locked, irregular, refusals)))
        };
        let (regions, (surfaces, others)): (Vec<_>, (Vec<_>, Vec<_>)) = parts.into_iter().map(take_apart).unzip();
        let surfaces = || self.surface.join(regions.iter().zip(surfaces), count);
        let others = || {
            for (Region { points, .. }, (cost, border, locked, irregular, refusals)) in regions.iter().zip(others) {
                points.iter().zip(border).for_each(|(&p, is)| self.border[p as usize] |= is);
                self.locked.merge(&locked, points);
                self.irregular.merge(&irregular, points);
                self.refusals.add(refusals);
                self.cost.join(cost, points);
            }
        };
        rayon::join(surfaces, others);
    }
}
