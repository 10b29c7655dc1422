//! One surface being reduced: the state that both schedules work on, and the one way in which an edge collapses.

mod parts;

use super::Refusals;
use super::constraints::{Constraints, Locked};
use super::cost::{AtEnds, Candidate, Cost, UNRANKED, pinned};
use super::enhanced::Enhanced;
use super::fan::Fan;
use super::fms::Fms;
use super::guard::{Cause, Needles, check_needles, check_remains, check_topology};
use super::melax::Melax;
use super::options::{Algorithm, Effort, Mode, Options, Placement};
use super::paper::Paper;
use super::prune::{Piece, are_there_pieces, pieces};
use super::qfvp::Qfvp;
use crate::attributes::Solution;
use crate::curvature::border_points;
use crate::mesh::Mesh;
use crate::mesh::edges::{Edge, EdgeKind, Irregular, recollect_edges};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use crate::progressive::Log;
use crate::tasks;

/// A surface on its way from fine to coarse.
pub(crate) struct Reducer {
    pub surface: Surface,
    pub cost: Box<dyn Cost>,
    pub refusals: Refusals,
    /// Watches what the strict schedule takes away, if somebody wants it back.
    pub log: Option<Log>,
    /// The edges, as of the last refresh; none where nobody has use for them until the next one.
    pub edges: Vec<Edge>,
    /// Whether whole pieces may go: there are several.
    has_pieces: bool,
    constraints: Constraints,
    locked: Locked,
    /// Points on open borders.
    border: Vec<bool>,
    irregular: Irregular,
    solution: Solution,
    /// The collapse in work: kept for its memory.
    merge: Merge,
    fan: Fan,
    needles: Needles,
    /// Joined points go to an end and have its wedges.
    to_ends: bool,
    /// Of a card nothing or all of its last two faces goes.
    whole_cards: bool,
    effort: Effort,
}

impl Reducer {
    /// Starts from a valid mesh.
    pub fn new(mesh: &Mesh, options: &Options) -> Self {
        Self::start(options, Surface::with_irregular(mesh, true))
    }

    /// Starts from a valid mesh with a log, which takes points and faces as they come.
    pub fn with_log(mesh: &Mesh, options: &Options) -> Self {
        let start = Surface::with_irregular(mesh, false);
        let log = Log::new(mesh, &start.0);
        Self { log: Some(log), ..Self::start(options, start) }
    }

    fn start(options: &Options, (surface, irregular): (Surface, Irregular)) -> Self {
        let mut edges = Vec::new();
        let find_edges = || recollect_edges(&surface, &irregular, &mut edges);
        let (has_pieces, ()) = tasks::join(surface.face_count(), || are_there_pieces(&surface), find_edges);
        let constraints = Constraints::new(options);
        let cost: Box<dyn Cost> = match options.algorithm {
            Algorithm::Esqem(Mode::Enhanced) => Box::new(Enhanced::new(&surface, &edges, options)),
            Algorithm::Esqem(Mode::Paper) => Box::new(Paper::esqem(&surface, &edges, options)),
            Algorithm::Qem => Box::new(Paper::qem(&surface, &edges, options)),
            Algorithm::Qfvp => Box::new(Qfvp::new(&surface, &edges, options)),
            Algorithm::Fms => Box::new(Fms::new(&surface, &edges, options)),
            Algorithm::Melax => Box::new(Melax::new(&surface, &edges, options)),
        };
        let to_ends = options.placement == Placement::Subset;
        // The enhanced cost knows about ends itself.
        let cost = if to_ends && options.algorithm != Algorithm::Esqem(Mode::Enhanced) {
            Box::new(AtEnds(cost))
        } else {
            cost
        };
        let points = surface.points.len();
        Self {
            cost,
            refusals: Refusals::default(),
            log: None,
            constraints,
            locked: constraints.lock_points(points, &edges),
            border: border_points(points, &edges),
            irregular,
            has_pieces,
            edges,
            surface,
            solution: Solution::default(),
            merge: Merge::default(),
            fan: Fan::default(),
            needles: Needles::of(options),
            to_ends,
            whole_cards: options.keep_area,
            effort: options.effort,
        }
    }

    /// Points that may not move.
    pub fn locked(&self) -> &Locked {
        &self.locked
    }

    /// Goes on from another surface, made from this one by moving, adding and joining points.
    pub fn adopt(&mut self, surface: Surface) {
        let points = surface.points.len();
        self.locked.grow(points);
        self.border.resize(points, false);
        self.irregular.grow(points);
        self.cost.grow(&surface);
        self.surface = surface;
        self.surface.compact();
        recollect_edges(&self.surface, &self.irregular, &mut self.edges);
    }

    /// Whether joined points go to an end of their edge.
    pub fn goes_to_ends(&self) -> bool {
        self.to_ends
    }

    /// How much time a level may take.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Finds all edges as they are now, and has the cost look at them.
    pub fn refresh(&mut self) {
        if let Some(log) = &mut self.log {
            log.renumber(&self.surface);
        }
        if self.surface.compact() || self.edges.is_empty() {
            self.irregular.review(&self.surface);
            recollect_edges(&self.surface, &self.irregular, &mut self.edges);
        }
        self.cost.refresh(&self.surface, &self.edges);
    }

    /// The pieces that may go as a whole, cheapest first.
    pub fn pieces(&self) -> Vec<Piece> {
        if self.has_pieces { pieces(&self.surface, &*self.cost) } else { Vec::new() }
    }

    /// About what all edges cost.
    pub fn rank(&mut self, costs: &mut Vec<f32>) {
        self.count_locked();
        costs.clear();
        costs.resize(self.edges.len(), UNRANKED);
        let (cost, surface, locked) = (&*self.cost, &self.surface, &self.locked);
        let edges = &self.edges;
        tasks::for_some(costs, |first, costs| cost.rank(surface, &edges[first..][..costs.len()], locked, costs));
    }

    fn look(&mut self, a: u32, b: u32) {
        if self.to_ends {
            // Which end stays is not known yet: that is looked at when it is carried out.
            (self.merge.kept, self.merge.gone) = (a, b);
        } else {
            self.merge.look(&self.surface, a, b);
        }
    }

    /// [`Self::judge`] of an edge, for [`Self::collapse_looked_at`].
    pub fn look_and_judge(&mut self, a: u32, b: u32) -> Option<Candidate> {
        self.look(a, b);
        if self.to_ends {
            return self.judge(a, b);
        }
        if self.merge.spokes().is_empty() {
            // Nothing would be left, whatever it costs.
            self.refusals.count(Cause::Vanish);
            return None;
        }
        pinned(&self.surface, &self.locked, a, b).and_then(|pin| self.cost.judge_merge(&self.surface, &self.merge, pin))
    }

    /// The points around the one that the last collapse joined, and about what the edges to them cost.
    pub fn rank_joined(&self, around: &mut Vec<u32>, costs: &mut Vec<f32>) {
        let hub = self.merge.kept;
        if self.irregular.is_either(hub, hub) {
            self.merge.around(around);
        } else {
            around.clear();
            around.extend(self.merge.firsts());
        }
        costs.clear();
        costs.resize(around.len(), UNRANKED);
        self.cost.rank_hub(&self.surface, hub, around, costs);
        if self.locked.are_none() {
            return;
        }
        for (&p, cost) in around.iter().zip(costs) {
            if self.locked.has(hub) || self.locked.has(p) {
                let edge = Edge { a: hub.min(p), b: hub.max(p), kind: EdgeKind::default() };
                *cost = self.cost.rank_exactly(&self.surface, &edge, &self.locked);
            }
        }
    }

    /// The candidate for an edge; `None` if it is locked or costs nothing finite.
    pub fn judge(&self, a: u32, b: u32) -> Option<Candidate> {
        pinned(&self.surface, &self.locked, a, b).and_then(|pin| self.cost.judge(&self.surface, a, b, pin))
    }

    /// Counts the edges that may not collapse because both ends are locked.
    pub fn count_locked(&mut self) {
        if self.locked.are_none() {
            return;
        }
        let locked = |e: &&Edge| self.locked.has(e.a) && self.locked.has(e.b);
        self.refusals.border += self.edges.iter().filter(locked).count() as u64;
    }

    /// Collapses an edge unless a guard refuses.
    pub fn collapse(&mut self, (a, b): (u32, u32), candidate: Candidate, terms: Terms) -> Outcome {
        self.look(a, b);
        self.collapse_looked_at(candidate, terms)
    }

    /// Collapses the edge looked at unless a guard refuses.
    pub fn collapse_looked_at(&mut self, candidate: Candidate, terms: Terms) -> Outcome {
        if self.to_ends { self.collapse_to_end(candidate, terms) } else { self.carry_out(candidate, terms) }
    }

    /// Tries the end that costs less, then the other one, if that may go now.
    fn collapse_to_end(&mut self, candidate: Candidate, terms: Terms) -> Outcome {
        let [a, b] = [self.merge.kept, self.merge.gone];
        let cheaper = self.carry_out_at_end([a, b], candidate, terms);
        let fined = match cheaper {
            Outcome::Done { .. } => return cheaper,
            Outcome::Fined(cost) => cost,
            _ => f64::INFINITY,
        };
        let ends = [a, b].map(|p| self.surface.points[p as usize]);
        let other = if candidate.position == ends[0] { ends[1] } else { ends[0] };
        let free = !self.locked.has(a) && !self.locked.has(b);
        match self.cost.judge(&self.surface, a, b, Some(other)).filter(|_| free) {
            Some(other) if other.cost <= terms.limit => match self.carry_out_at_end([a, b], other, terms) {
                Outcome::Fined(cost) => Outcome::Fined(cost.min(fined)),
                Outcome::Refused => cheaper,
                done => done,
            },
            Some(other) if other.cost < fined => Outcome::Later(other.cost),
            _ => cheaper,
        }
    }

    /// Carries out a collapse to an end, whose wedges stay.
    fn carry_out_at_end(&mut self, ends: [u32; 2], candidate: Candidate, terms: Terms) -> Outcome {
        let [a, b] = ends;
        let [stays, goes] = if candidate.position == self.surface.points[a as usize] { [a, b] } else { [b, a] };
        self.merge.look(&self.surface, stays, goes);
        self.carry_out(candidate, terms)
    }

    fn carry_out(&mut self, candidate: Candidate, terms: Terms) -> Outcome {
        let (a, b, faces) = (self.merge.kept, self.merge.gone, self.merge.across.len());
        if faces == 0 || faces > terms.most {
            return Outcome::Refused;
        }
        let (start, end) = (self.surface.points[a as usize], self.surface.points[b as usize]);
        let along = end - start;
        let solves = !self.to_ends && !self.surface.wedges.is_plain();
        let checked = self.check(candidate, terms).and_then(|is_breaking| {
            if solves {
                let t = (candidate.position - start).dot(along) / along.length_squared();
                let t = if t.is_finite() { t.clamp(0.0, 1.0) as f32 } else { 0.5 };
                self.solution.solve(&self.surface, self.cost.metric(), &self.merge, candidate.position, t);
            }
            if self.solution.turns_charts(&self.surface, &self.merge) { Err(Cause::Chart) } else { Ok(is_breaking) }
        });
        let is_breaking = match checked {
            Ok(is_breaking) => is_breaking,
            Err(cause) => {
                self.refusals.count(cause);
                return cause
                    .fined(&*self.cost, candidate, along.length_squared(), self.needles, self.cost.bend(a, b))
                    .map_or(Outcome::Refused, Outcome::Fined);
            }
        };
        let entry = self.log.as_ref().map(|log| log.begin(&self.surface, &self.merge));
        self.merge.apply(&mut self.surface, candidate.position);
        if solves {
            self.solution.write(&mut self.surface.wedges);
        }
        if let (Some(log), Some(entry)) = (&mut self.log, entry) {
            log.finish(entry, &self.surface);
        }
        self.locked.follow(a, b);
        if is_breaking || self.irregular.is_either(a, b) {
            self.border[a as usize] |= self.border[b as usize];
            self.irregular.follow(&self.surface, a, b, is_breaking);
        }
        self.cost.follow_faces(&self.merge.spokes()[self.first_changed()..], &self.fan);
        self.cost.merged(&self.surface, a, b);
        if is_breaking {
            self.cost.broke(&self.surface, a);
        }
        Outcome::Done { kept: a, gone: b }
    }

    /// The first of the spokes whose faces the collapse changes.
    fn first_changed(&self) -> usize {
        if self.to_ends { self.merge.spokes_of_kept().len() } else { 0 }
    }

    /// Whether the collapse breaks rules that a fine buys it out of: then anything may become of the edges around it.
    fn check(&mut self, candidate: Candidate, terms: Terms) -> Result<bool, Cause> {
        let first = self.first_changed();
        check_remains(&self.merge, terms.paid)?;
        if self.whole_cards && self.merge.spokes().len() == self.merge.across.len() {
            return Err(Cause::Vanish);
        }
        let worst = self.fan.look(&self.surface, &self.merge, candidate.position, first)?;
        check_needles(&self.surface, &self.merge, &*self.cost, worst, self.needles, terms.paid)?;
        let rules = self.check_rules();
        if !terms.paid {
            rules?;
        }
        // At an end there are its own wedges only: one without a partner would get attributes from elsewhere.
        let merge = &mut self.merge;
        if self.to_ends && !merge.pair_up(&self.surface, terms.paid || self.constraints.seams_are_free()) {
            return Err(if terms.paid { Cause::Unpaired } else { Cause::Seam });
        }
        Ok(rules.is_err() || (terms.paid && self.to_ends && self.surface.has_seams()))
    }

    fn check_rules(&self) -> Result<(), Cause> {
        let merge = &self.merge;
        if self.irregular.is_either(merge.kept, merge.gone) {
            check_topology(&self.surface, merge, &self.border)?;
        } else if !merge.keeps_regular() {
            return Err(Cause::Link);
        }
        if !self.constraints.seams_are_free() && !merge.keeps_seams(&self.surface) {
            return Err(Cause::Seam);
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
    /// What may go now: where the cheaper end of an edge is refused, the other one may cost this much.
    pub limit: f64,
}

/// What became of a collapse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outcome {
    /// Done: one of the ends is part of the other now.
    Done { kept: u32, gone: u32 },
    /// It may happen at this cost, when its turn comes.
    Fined(f64),
    /// It may happen at this cost, when its turn comes, and no fine is in that.
    Later(f64),
    /// It may not happen now.
    Refused,
}
