//! One surface being reduced: the state that both schedules work on, and the one way in which an edge collapses.

use super::Refusals;
use super::constraints::Constraints;
use super::cost::{Candidate, Cost};
use super::enhanced::Enhanced;
use super::guard::{Cause, check_remains, check_shape, check_topology};
use super::options::{Algorithm, Mode, Options};
use super::paper::Paper;
use crate::attributes::Solution;
use crate::mesh::Mesh;
use crate::mesh::edges::{Edge, collect_edges};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;

/// A surface on its way from fine to coarse.
pub(crate) struct Reducer {
    pub surface: Surface,
    pub cost: Box<dyn Cost>,
    pub refusals: Refusals,
    constraints: Constraints,
    locked: Vec<bool>,
    solution: Solution,
}

impl Reducer {
    /// Starts from a valid mesh.
    pub fn new(mesh: &Mesh, options: &Options) -> Self {
        let surface = Surface::new(mesh);
        let edges = collect_edges(&surface);
        let constraints = Constraints::new(options);
        let cost: Box<dyn Cost> = match options.algorithm {
            Algorithm::Esqem(Mode::Enhanced) => Box::new(Enhanced::new(&surface, &edges, options)),
            Algorithm::Esqem(Mode::Paper) => Box::new(Paper::esqem(&surface, &edges, options)),
            Algorithm::Qem => Box::new(Paper::qem(&surface, &edges, options)),
        };
        let locked = constraints.lock_points(surface.points.len(), &edges);
        Self { surface, cost, refusals: Refusals::default(), constraints, locked, solution: Solution::default() }
    }

    /// Points that may not move.
    pub fn locked(&self) -> &[bool] {
        &self.locked
    }

    /// Goes on from another surface, made from this one by moving, adding and joining points.
    pub fn adopt(&mut self, surface: Surface) {
        self.locked.resize(surface.points.len(), false);
        self.cost.grow(&surface);
        self.surface = surface;
    }

    /// All edges as they are now, known to the cost.
    pub fn refresh(&mut self) -> Vec<Edge> {
        self.surface.compact();
        let edges = collect_edges(&self.surface);
        self.cost.refresh(&self.surface, &edges);
        edges
    }

    /// The candidate for an edge; `None` if it is locked or costs nothing finite.
    pub fn judge(&self, a: u32, b: u32) -> Option<Candidate> {
        let point = |p: u32| self.surface.points[p as usize];
        let fixed = match (self.locked[a as usize], self.locked[b as usize]) {
            (true, true) => return None,
            (true, false) => Some(point(a)),
            (false, true) => Some(point(b)),
            (false, false) => None,
        };
        self.cost.judge(&self.surface, a, b, fixed)
    }

    /// Counts the edges that may not collapse because both ends are locked.
    pub fn count_locked(&mut self, edges: &[Edge]) {
        let locked = |e: &&Edge| self.locked[e.a as usize] && self.locked[e.b as usize];
        self.refusals.border += edges.iter().filter(locked).count() as u64;
    }

    /// Collapses an edge unless a guard refuses.
    pub fn collapse(&mut self, (a, b): (u32, u32), candidate: Candidate, terms: Terms) -> Outcome {
        let merge = Merge::new(&self.surface, a, b);
        if merge.faces.is_empty() || merge.faces.len() > terms.most {
            return Outcome::Refused;
        }
        if let Err(cause) = self.check(&merge, candidate, terms) {
            self.refusals.count(cause);
            let length_squared = self.surface.points[a as usize].distance_squared(self.surface.points[b as usize]);
            return cause.fined(&*self.cost, candidate, length_squared).map_or(Outcome::Refused, Outcome::Fined);
        }
        let (start, end) = (self.surface.points[a as usize], self.surface.points[b as usize]);
        let along = end - start;
        let t = (candidate.position - start).dot(along) / along.length_squared();
        let t = if t.is_finite() { t.clamp(0.0, 1.0) as f32 } else { 0.5 };
        self.solution.solve(&self.surface, &merge, candidate.position, t);
        merge.apply(&mut self.surface, candidate.position);
        self.solution.write(&mut self.surface.wedges);
        self.locked[a as usize] |= self.locked[b as usize];
        self.cost.merged(a, b);
        Outcome::Done(merge.faces.len())
    }

    fn check(&self, merge: &Merge, candidate: Candidate, terms: Terms) -> Result<(), Cause> {
        check_remains(&self.surface, merge)?;
        check_shape(&self.surface, merge, candidate.position, !terms.paid)?;
        if !terms.paid {
            check_topology(&self.surface, merge)?;
            if !self.constraints.seams_are_free() && !merge.keeps_seams(&self.surface) {
                return Err(Cause::Seam);
            }
        }
        Ok(())
    }
}

/// On what terms a collapse is tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Terms {
    /// The fine is in its cost already: what it was for is allowed.
    pub paid: bool,
    /// Most faces that may go.
    pub most: usize,
}

/// What became of a collapse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outcome {
    /// Done; so many faces are gone.
    Done(usize),
    /// It may happen at this cost, when its turn comes.
    Fined(f64),
    /// It may not happen now.
    Refused,
}
