//! The other direction: how far places on the level are from the source. Faces that bridge a gap, and edges that cut a corner, have no sample near
//! them that would tell.

use super::level::{Level, area, centre, unit_normal};
use super::lists::{NONE, NearestSample};
use super::source::Foot;
use super::step::Step;
use glam::Vec3;
use smallvec::SmallVec;
use wide::f32x4;

/// Shares of a face's area that its centre, the middle of each edge and each corner stand for: exact for cubic functions.
const CENTRE_SHARE: f32 = 9.0 / 20.0;
const MIDDLE_SHARE: f32 = 2.0 / 15.0;
const CORNER_SHARE: f32 = 1.0 / 20.0;

/// Places between these, by barycentric coordinates; the last two are on the first edge.
const BETWEEN: [[f32; 3]; 5] =
    [[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.25, 0.25, 0.5], [0.75, 0.25, 0.0], [0.25, 0.75, 0.0]];
/// How many of them are inside.
const INSIDE: usize = 3;
/// Squared distance, relative to that from which peaks count, below which no peak is looked for between the places above.
const NEAR_PEAK: f32 = 0.3;

/// A place on the level that follows a point by the share `lever`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probe {
    pub place: Vec3,
    pub area: f32,
    pub lever: f32,
    pub foot: Foot,
}

/// How far a face is from the source.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spots {
    /// The largest squared distance of its samples and places; below 0 if nobody has looked.
    pub worst: f32,
    /// The integral of the squared distances of its places.
    pub squares: f32,
    /// The source's faces closest to its centre and the middles of its edges when somebody looked last: `NONE` where nobody has. From there it is
    /// not far after a move.
    at_centre: u32,
    at_middles: [u32; 3],
}

impl Spots {
    pub const UNKNOWN: Self = Self { worst: -1.0, squares: 0.0, at_centre: NONE, at_middles: [NONE; 3] };

    /// Of the same face with other corners.
    pub fn moved(self) -> Self {
        Self { worst: Self::UNKNOWN.worst, ..self }
    }
}

pub(super) type Probes = SmallVec<[Probe; 32]>;

impl Level<'_> {
    /// Probes of all places that move with the first corner of a fan, whose samples are in the patch; `foot` is that corner's.
    pub fn probe_fan(&self, fan: &[[Vec3; 3]], foot: Foot) -> Probes {
        let mut probes = Probes::new();
        let Some(&[here, ..]) = fan.first() else { return probes };
        let total: f32 = fan.iter().map(area).sum();
        let mut push = |place: Vec3, area: f32, lever: f32, foot: Foot| {
            probes.push(Probe { place, area: area * self.prices.density, lever, foot });
        };
        push(here, total * CORNER_SHARE, 1.0, foot);
        for t in fan {
            let (area, inner) = (area(t), centre(t));
            let normal = unit_normal(t);
            let at_inner = self.look_back_from(inner, normal, foot.face);
            push(inner, area * CENTRE_SHARE, 1.0 / 3.0, at_inner);
            // The spoke's other face is part of the fan, too, wherever the fan is closed.
            let middle = t[0].midpoint(t[1]);
            let at_middle = self.look_back_from(middle, normal, foot.face);
            push(middle, area * MIDDLE_SHARE * 2.0, 0.5, at_middle);
            if self.may_peak(farthest([foot, at_inner, at_middle])) {
                for at in &BETWEEN {
                    let place = blend(t, at);
                    push(place, 0.0, at[0], self.look_back(place, at_inner.face));
                }
            }
        }
        probes
    }

    /// Probes inside two faces that share an edge, whose samples are in the patch: their centres and the middle of that edge, which runs from the
    /// first to the second corner of the first. `start` is a source face near it.
    pub fn probe_pair(&self, pair: &[[Vec3; 3]; 2], start: u32) -> Probes {
        let areas = pair.map(|t| area(&t) * self.prices.density);
        let mut probes = Probes::new();
        let middle = pair[0][0].midpoint(pair[0][1]);
        let foot = self.look_back_from(middle, unit_normal(&pair[0]), start);
        probes.push(Probe { place: middle, area: (areas[0] + areas[1]) * MIDDLE_SHARE, lever: 0.0, foot });
        for ((t, area), count) in pair.iter().zip(areas).zip([BETWEEN.len(), INSIDE]) {
            let place = centre(t);
            let at_inner = self.look_back_from(place, unit_normal(t), start);
            probes.push(Probe { place, area: area * CENTRE_SHARE, lever: 0.0, foot: at_inner });
            if self.may_peak(farthest([foot, at_inner])) {
                for place in BETWEEN[..count].iter().map(|at| blend(t, at)) {
                    let foot = self.look_back(place, at_inner.face);
                    probes.push(Probe { place, area: 0.0, lever: 0.0, foot });
                }
            }
        }
        probes
    }

    /// Whether a peak is looked for between places of which the farthest is so far off (squared).
    fn may_peak(&self, squared: f32) -> bool {
        self.budget.looks_between && squared > self.prices.peak() * NEAR_PEAK
    }

    /// The source's closest point to a place on a face with this normal: from the patch's nearest sample, or else from `start`. A walk that
    /// starts on the other side of a thin part would stay there.
    fn look_back_from(&self, place: Vec3, normal: Vec3, start: u32) -> Foot {
        let start = self.patch.nearest_sample(place, normal).map_or(start, |s| self.source.samples[s as usize].face);
        self.look_back(place, start)
    }

    /// What the probes' distances cost.
    pub fn price(&self, probes: &[Probe]) -> f32 {
        probes.iter().map(|p| self.prices.of_place(p.area, p.foot.distance_squared)).sum()
    }

    /// Adds the probes to the least squares problem of their point.
    pub fn add_probes(&self, probes: &[Probe], step: &mut Step) {
        for p in probes {
            step.add(p.foot.point - p.place, p.lever, self.prices.slope(p.area, p.foot.distance_squared));
        }
    }

    /// Looks at a face: its samples, corners, centre and the middles of the edges that the other face leaves to it, and between these.
    pub fn find_spots(&self, face: usize) -> Spots {
        let triangle = self.triangle(face);
        let (area, normal) = (area(&triangle), unit_normal(&triangle));
        let own = self.surface.face(face);
        let corners = own.map(|p| self.foot(p));
        let last = self.spots[face];
        let look = |place: Vec3, start: u32, corner: Foot| match start {
            NONE => self.look_back_on(face, place, normal, corner.face),
            start => self.look_back(place, start),
        };
        let inner = look(centre(&triangle), last.at_centre, corners[0]);
        let from = |k: usize| [k, (k + 1) % 3, (k + 2) % 3].map(|k| triangle[k]);
        let mine = [0, 1, 2].map(|k| own[k] < own[(k + 1) % 3]);
        let middles = [0, 1, 2].map(|k| {
            let [p, q, _] = from(k);
            mine[k].then(|| look(p.midpoint(q), last.at_middles[k], corners[k]))
        });
        let at_middles = middles.map(|foot| foot.map_or(NONE, |foot| foot.face));
        let middles = middles.map(|foot| foot.map_or(0.0, |foot| foot.distance_squared));
        let corners = corners.map(|foot| foot.distance_squared);
        let samples = self.lists.of(face).fold(f32x4::ZERO, |worst, four| worst.fast_max(four.squared)).to_array();
        let mut worst = samples.into_iter().chain(corners).chain(middles).fold(inner.distance_squared, f32::max);
        if self.may_peak(worst) {
            let (inside, along) = BETWEEN.split_at(INSIDE);
            let edges = (0..3).filter(|&k| mine[k]).flat_map(|k| along.iter().map(move |at| blend(&from(k), at)));
            for place in inside.iter().map(|at| blend(&triangle, at)).chain(edges) {
                worst = worst.max(self.look_back(place, inner.face).distance_squared);
            }
        }
        let sum = |squares: [f32; 3]| squares.iter().sum::<f32>();
        Spots {
            worst,
            at_centre: inner.face,
            at_middles,
            squares: area
                * (inner.distance_squared * CENTRE_SHARE
                    + sum(middles) * 2.0 * MIDDLE_SHARE
                    + sum(corners) * CORNER_SHARE),
        }
    }

    /// The source's closest point to a place on a face, from the face's nearest sample that looks its way or else from `start`.
    fn look_back_on(&self, face: usize, place: Vec3, normal: Vec3, start: u32) -> Foot {
        let mut search = NearestSample::to(place);
        self.lists.of(face).for_each(|four| search.look_at(four, normal));
        self.look_back(place, search.found().map_or(start, |s| self.source.samples[s as usize].face))
    }
}

fn farthest<const N: usize>(feet: [Foot; N]) -> f32 {
    feet.iter().map(|foot| foot.distance_squared).fold(0.0, f32::max)
}

fn blend([a, b, c]: &[Vec3; 3], [u, v, w]: &[f32; 3]) -> Vec3 {
    *a * *u + *b * *v + *c * *w
}
