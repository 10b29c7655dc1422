//! Taking the state of a reduction apart, and putting it together again.

use super::Reducer;
use crate::mesh::regions::{Region, cut, join_flags, renumber};
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

    /// Brings what collapses of a part look at here and there into the caches.
    pub fn read_through(&self) {
        self.surface.read_through();
        self.cost.read_through();
    }

    /// Puts the surface together again.
    pub fn join(&mut self, parts: Vec<(Region, Self)>) {
        let (mut regions, mut surfaces, mut costs) = (Vec::new(), Vec::new(), Vec::new());
        let (mut border, mut locked, mut irregular) = (Vec::new(), Vec::new(), Vec::new());
        for (region, part) in parts {
            regions.push(region);
            surfaces.push(part.surface);
            costs.push(part.cost);
            border.push(part.border);
            locked.push(part.locked);
            irregular.push(part.irregular);
            self.refusals.add(part.refusals);
        }
        let mut count = self.border.len();
        if self.surface.may_renumber() {
            count = renumber(regions.iter_mut().zip(&surfaces), count);
        }
        let others = || {
            self.border = join_flags(regions.iter().zip(border), count);
            self.locked.join(regions.iter().zip(locked), count);
            self.irregular.join(regions.iter().zip(irregular), count);
            self.cost.join(regions.iter().zip(costs).collect(), count);
        };
        rayon::join(|| self.surface.join(regions.iter().zip(surfaces), count), others);
    }
}
