//! Refinement: makes a level better at the same number of triangles.
//!
//! The source stands as samples (vertices, and places inside faces by area), each assigned to the face of the level nearest to it and followed from level
//! to level. A move replaces a few faces by others; what it is worth is measured on the samples of those faces alone:
//!
//! 1. **Sweeps** over all edges and points: the other diagonal of two faces, and the place of a point that is nearest to its samples.
//!    Distances near the largest are dear, so that the mean does not gain at their cost.
//! 2. **Peaks**, after each sweep: where the level is farthest from the source, in either direction, the same moves with the farthest distance
//!    counting most and with places on the level looked at, too; faces between the samples may bridge a gap or stick out. What that costs in the
//!    mean the next sweep wins back.
//! 3. **Exchanges** (`best`): a point comes in where the level is farthest from the source, in either direction, and one that is missed less goes.
//! 4. **Attributes** of points that moved are fitted to the source.
//!
//! What flips and exchanges take away from attributes counts as well: where all is flat distances do not speak for an edge, but normals may.
//!
//! Points at borders and edges of several faces stay, and so do locked ones; those on seams do not leave them. All such edges stay edges.
//!
//! Limits: distances are f32 in the unit frame, so errors below a millionth of the extent are noise; the collapses of such levels stay as they are.

mod attributes;
mod crowd;
mod exchange;
mod flip;
mod follow;
mod hold;
mod insert;
mod level;
mod lists;
mod nearest;
mod patch;
mod peaks;
mod plane;
mod prices;
mod probe;
mod relocate;
mod remove;
mod source;
mod step;
mod wants;

use super::constraints::Locked;
use super::options::Effort;
use crate::attributes::Metric;
use crate::mesh::surface::Surface;
use attributes::SourceAttributes;
use follow::Followed;
use glam::Vec3;
use hold::Hold;
use level::{Fan, Level, Manner};
use lists::{Lists, NONE, NearestSample};
use patch::Patch;
use prices::Prices;
use probe::Spots;
use source::{Foot, Source};
pub(super) use source::{closest_point, spread};
use wants::Wants;

/// Refines the levels of one chain, finest first.
#[derive(Debug)]
pub(crate) struct Refiner {
    source: Source,
    attributes: Option<SourceAttributes>,
    followed: Followed,
    lists: Lists,
    patch: Patch,
    budget: Budget,
}

/// How much is done.
#[derive(Debug, Clone, Copy)]
struct Budget {
    /// Samples inside faces of the source, for each face in the mean; all vertices are samples besides.
    inside: f32,
    /// Samples a face of the level at most, beyond the vertices.
    samples: f32,
    /// Vertices a face of the level at most.
    vertices: usize,
    /// Rounds: a sweep over all edges and points, then the worst spots; after the last one more sweep.
    rounds: usize,
    /// Rounds in which points go from where they are least needed to where they are missed most.
    exchanges: usize,
    /// Relative gain that a step of a point has to promise.
    promise: f32,
    /// Lengths of a step that are tried in sweeps.
    scales: usize,
    /// Whether peaks are looked for between the centre of a face, the middles of its edges and its corners, too.
    looks_between: bool,
}

/// Samples inside faces of the source at least: small meshes take little time whatever is done, and have few vertices to go by.
const FEWEST_INSIDE: f32 = 2500.0;
/// Samples a face below which a level stays as its collapses left it: where there are none, faces would go astray.
const FEWEST_SAMPLES: usize = 6;
/// Samples a face below which one round is all that pays.
const ENOUGH_SAMPLES: usize = 12;
/// Samples a face that are enough to judge a level by.
const MOST_JUDGES: usize = 6;
/// How much larger the mean square of the samples that judge may become: they are surer than places of the level, where it has cliffs.
const MOST_LOSS: f32 = 1.02;
/// Share of the faces whose worst spots are worked on in a round.
const PEAKS: f32 = 0.02;
/// Squared distance, relative to the largest of the level, from which sweeps avoid peaks.
const NEW_PEAK: f32 = 0.9;

impl Budget {
    fn of(effort: Effort) -> Self {
        match effort {
            Effort::Best => Self {
                inside: 4.0,
                samples: 24.0,
                vertices: 64,
                rounds: 2,
                exchanges: 1,
                promise: 0.01,
                scales: 2,
                looks_between: true,
            },
            _ => Self {
                inside: 0.5,
                samples: 6.0,
                vertices: 8,
                rounds: 1,
                exchanges: 0,
                promise: 0.02,
                scales: 1,
                looks_between: false,
            },
        }
    }
}

impl Refiner {
    /// `surface` is the source.
    pub fn new(surface: &Surface, effort: Effort) -> Self {
        let budget = Budget::of(effort);
        let source = Source::new(surface, budget.inside.max(FEWEST_INSIDE / surface.face_count() as f32));
        Self {
            attributes: SourceAttributes::new(surface),
            followed: Followed::new(&source),
            lists: Lists::default(),
            patch: Patch::default(),
            budget,
            source,
        }
    }

    /// Whether there are enough samples to refine a level of so many faces.
    pub fn can_judge(&self, faces: usize) -> bool {
        self.has_samples(faces, FEWEST_SAMPLES)
    }

    fn has_samples(&self, faces: usize, each: usize) -> bool {
        self.source.held_out >= each * faces
    }

    /// Looks for the faces of samples anew.
    fn assign(&mut self, surface: &Surface, samples: impl Iterator<Item = usize>) {
        self.followed.assign(surface, &self.source, samples, &mut self.lists);
    }

    /// Refines `surface`, made from the level before by collapses; `metric` says what attributes count. Points that are `locked` stay. The number of
    /// faces is the same afterwards. Gives whether the surface is nearer to the source than it was: by the mean distance of samples that no move knows
    /// to it and of its places to the source, and by the largest of all that was looked at.
    pub fn refine(&mut self, surface: &mut Surface, locked: &Locked, metric: &Metric) -> bool {
        let holds = Hold::find(surface, locked);
        let faces = surface.face_count();
        let is_fine = !self.has_samples(faces, ENOUGH_SAMPLES);
        let (rounds, exchanges) = if is_fine { (1, 0) } else { (self.budget.rounds, self.budget.exchanges) };
        let wanted = (self.budget.samples * faces as f32) as usize;
        let chosen = self.source.choose(wanted, self.budget.vertices * faces);
        let judges = self.source.judges(MOST_JUDGES * faces);
        self.assign(surface, chosen.chain(judges.clone()));
        let judged = self.followed.distance_of(judges.clone());
        let anchors = self.followed.anchors.clone();
        let mut level = Level {
            surface,
            source: &self.source,
            lists: &mut self.lists,
            patch: &mut self.patch,
            holds,
            feet: Vec::new(),
            fan: Fan::default(),
            prices: Prices::default(),
            budget: self.budget,
            spots: Vec::new(),
            wants: self
                .attributes
                .as_ref()
                .filter(|_| !metric.is_empty())
                .map(|source| Wants { source, scales: metric.scales(faces) }),
        };
        level.spots.resize(level.surface.face_slots(), Spots::UNKNOWN);
        level.prices = Prices::of_level(&level);
        find_feet(&mut level);
        let was = level.distance();
        let most = (PEAKS * faces as f32).ceil() as usize;
        level.prices.set_peak(was.worst * NEW_PEAK);
        let mut peak = was.worst;
        for round in 0..rounds {
            sweep(&mut level);
            if round < exchanges {
                exchange::exchange(&mut level);
            }
            peak = peak.min(peaks::lower_peaks(&mut level, most, 0.0));
            level.prices.set_peak(peak * NEW_PEAK);
        }
        sweep(&mut level);
        // Sweeps do not look between samples: what they raise is lowered again.
        let mut is = level.distance();
        if is.worst > peak {
            peaks::lower_peaks(&mut level, most, peak);
            is = level.distance();
        }
        if let Some(attributes) = &self.attributes {
            attributes::fit(&mut level, attributes);
        }
        self.followed.move_anchors(level.surface, level.lists);
        let is_better = is.reaches_no_farther(&was) && {
            self.assign(surface, judges.clone());
            let judged_again = self.followed.distance_of(judges);
            judged_again.mean <= judged.mean * MOST_LOSS && judged_again.with(is).is_within(&judged.with(was))
        };
        if !is_better {
            self.followed.anchors = anchors;
        }
        is_better
    }
}

/// Tries all edges and points once.
fn sweep(level: &mut Level) {
    flip::flip_edges(level);
    for p in 0..level.surface.points.len() as u32 {
        relocate::relocate(level, p, Manner::Quick);
    }
}

/// Finds the source's closest point to every point of the level.
fn find_feet(level: &mut Level) {
    let unknown = Foot { distance_squared: 0.0, point: Vec3::ZERO, face: NONE };
    level.feet = vec![unknown; level.surface.points.len()];
    let mut missing = Vec::new();
    for p in 0..level.surface.points.len() as u32 {
        if level.surface.ring(p).is_empty() {
            continue;
        }
        match nearest_sample_around(level, p) {
            Some(start) => level.feet[p as usize] = level.look_back(level.point(p), start),
            None => missing.push(p),
        }
    }
    // No sample is near: start from what a neighbour has found.
    while !missing.is_empty() {
        let before = missing.len();
        missing.retain(|&p| {
            let near = level.surface.neighbours(p).into_iter().map(|q| level.foot(q).face).find(|&f| f != NONE);
            if let Some(start) = near {
                level.feet[p as usize] = level.look_back(level.point(p), start);
            }
            near.is_none()
        });
        if missing.len() == before {
            break;
        }
    }
}

/// The source face of the sample nearest to a point among those on its faces.
fn nearest_sample_around(level: &Level, p: u32) -> Option<u32> {
    let mut search = NearestSample::to(level.point(p));
    for &corner in level.surface.ring(p) {
        level.lists.of(Surface::face_of(corner)).for_each(|four| search.look_at(four, Vec3::ZERO));
    }
    search.found().map(|s| level.source.samples[s as usize].face)
}

#[cfg(test)]
mod tests;
