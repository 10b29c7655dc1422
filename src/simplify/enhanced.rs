//! The default cost: memoryless quadrics, volume-preserving placement, curvature and normal angle as factors.
//!
//! The quadric of a point is rebuilt from the current faces at each pass, weighted by area, so that errors of long gone faces do not
//! pile up (Lindstrom & Turk 1998, 1999). The joined point keeps the volume, or goes some of the way to where it would if refinement
//! follows. ESQEM's Gaussian curvature and QFVP's angle between the end normals multiply the cost rather than add to it: a dimensionless factor serves meshes of all sizes, and flat regions stay free.
//!
//! Limits: quadrics at the ends of an edge lag behind collapses next to it within one pass.

use super::constraints::{CONTINUES, Constraints, Locked, keep_outlines};
use super::cost::{Candidate, Cost, Room, UNRANKED};
use super::ends::Sweep;
use super::fan::{Fan, distance_squared};
use super::options::{AttributeWeights, Effort, Options, Placement};
use super::placement::{Apex, Estimate, Facet, Lanes, Subject, emphasis, estimate};
use crate::attributes::Metric;
use crate::curvature::{Form, border_points, forms};
use crate::lanes::LANES;
use crate::mesh::edges::{Edge, EdgeKind, Side, sides_of, special_edges};
use crate::mesh::regions::Region;
use crate::mesh::surface::{Corner, Surface};
use crate::mesh::surgery::{Merge, Pairs, pair_wedges};
use crate::tasks;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use smallvec::SmallVec;
use std::any::Any;
use std::borrow::Borrow;
use std::mem::take;

/// How much more normals and colours count where points stay.
const NORMALS_AT_ENDS: f32 = 3.5;
const COLORS_AT_ENDS: f32 = 10.0;

/// How much less curvature counts where the order of collapses is a rough one, and positions are all there is.
const CURVATURE_IN_HASTE: f32 = 0.5;

/// How far points go to where the volume is kept, if refinement follows: all of the way they stick out of what is round, and what is lost by less comes
/// back.
const REFINED_VOLUME_SHARE: f32 = 0.6;

/// Variance of the normals around a point from which there is a crease, along which needles are no use.
const CREASED: f64 = 0.05;

/// Mean of the smallest angles of the source's faces around an edge below which they are needles themselves: 10°.
const SLENDER: f32 = 0.174_533;

/// How much of what attributes cost counts for the place of a joined point: what they say of places is extrapolated.
const ATTRIBUTES_IN_PLACE: f64 = 0.3;

/// Variance of the normals around a point that no crease of a right angle has: limbs, blades and tips do, and open borders with their planes.
const TURNED_BACK: f32 = 0.5;
/// Share of the area around such a point that counts as far off as the point: the distance falls off towards the faces that stay.
const RETREAT: f32 = 0.25;

pub(crate) struct Enhanced {
    constraints: Constraints,
    room: Room,
    options: Options,
    apexes: Vec<Apex>,
    /// Of the points of the source, as long as there are no apexes.
    forms: Vec<Form>,
    /// Points at edges that have planes of their own.
    ridged: Vec<bool>,
    /// Of each face.
    facets: Vec<Facet>,
    metric: Metric,
    /// Joined points go to an end.
    at_ends: bool,
    volume_share: f32,
}

impl Enhanced {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let metric = Metric::new(surface, &attribute_weights(options));
        let at_ends = options.placement == Placement::Subset;
        let mut options = options.clone();
        if options.effort == Effort::Fast && !at_ends && metric.is_empty() {
            options.curvature_weight *= CURVATURE_IN_HASTE;
        }
        Self {
            volume_share: if options.effort == Effort::Fast { 1.0 } else { REFINED_VOLUME_SHARE },
            constraints: Constraints::new(&options),
            room: Room::of(&surface.points),
            options,
            apexes: Vec::new(),
            forms: forms(surface, &border_points(surface.points.len(), edges)),
            ridged: vec![false; surface.points.len()],
            facets: Vec::new(),
            metric,
            at_ends,
        }
    }

    /// The cheaper of the allowed ends. Without attributes that is mostly the one that is cheaper by the old faces, and only that one is looked at.
    fn judge_ends(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let subject = self.subject(surface, [a, b], None);
        let has_attributes = !self.metric.is_empty();
        let pairs = self.pairs(surface, [a, b]);
        let errors = [false, true].map(|backwards| {
            let [stays, goes] = if backwards { [b, a] } else { [a, b] };
            let mut error = subject.error_of_end(backwards);
            if has_attributes {
                let turned = |&(of_a, of_b): &(u32, u32)| if backwards { (of_b, of_a) } else { (of_a, of_b) };
                error += self.metric.deviation_of_end(surface, [stays, goes], pairs.iter().map(turned));
            }
            (error, self.apexes[goes as usize].weight())
        });
        let judge = |backwards: bool| {
            let [stays, goes] = if backwards { [b, a] } else { [a, b] };
            let (error, area) = errors[usize::from(backwards)];
            let sweep = Sweep::new(surface, &self.facets, stays, goes);
            // What is known of the point may be of yesterday; the faces are not.
            let is_bare = !has_attributes && !self.ridged[goes as usize];
            let error = if is_bare { f64::from(sweep.by_old + subject.least()) } else { error };
            let cost = sweep.cost(error, area) * subject.factor(self.options.curvature_weight);
            cost.is_finite().then_some(Candidate { cost, position: surface.points[stays as usize] })
        };
        match fixed {
            Some(x) => judge(x != surface.points[a as usize]),
            None if has_attributes => {
                [false, true].into_iter().filter_map(judge).min_by(|x, y| x.cost.total_cmp(&y.cost))
            }
            // Over the root of the area, squared.
            None => judge(errors[1].0.powi(2) * f64::from(errors[0].1) < errors[0].0.powi(2) * f64::from(errors[1].1)),
        }
    }

    /// Adds the planes through an edge with these sides, perpendicular to its faces, to the quadrics of the points `at`, by the square of its length.
    fn add_edge(&mut self, surface: &Surface, edge: &Edge, sides: &[Side], at: &[u32]) {
        let weight = self.constraints.weight(edge.kind);
        if weight == 0.0 {
            return;
        }
        let along = (surface.points[edge.b as usize] - surface.points[edge.a as usize]).as_vec3();
        let mut planes: SmallVec<[Vec3; 4]> = SmallVec::new();
        for &(corner, is_forward) in sides {
            let plane = self.facets[Surface::face_of(corner)].normal().cross(if is_forward { along } else { -along });
            if plane != Vec3::ZERO {
                planes.push(plane);
            }
        }
        if edge.kind.has(EdgeKind::COMPLEX) {
            keep_outlines(&mut planes, |m, n| m.dot(n) > -CONTINUES as f32 * along.length_squared());
        }
        let each = weight as f32 / planes.len().max(1) as f32;
        for &point in at {
            self.ridged[point as usize] = true;
            planes.iter().for_each(|&normal| self.apexes[point as usize].add_plane(normal, each));
        }
    }

    /// Brings the quadric of a point up to date.
    fn take_faces(&mut self, surface: &Surface, point: u32) {
        let faces = surface.ring(point).iter().map(|&c| self.facets[Surface::face_of(c)]);
        self.apexes[point as usize].set_faces(surface.points[point as usize], faces);
        if !self.ridged[point as usize] {
            return;
        }
        special_edges(surface, point, |edge, sides| self.add_edge(surface, edge, sides, &[point]));
    }

    fn subject<'a>(&'a self, surface: &Surface, [a, b]: [u32; 2], pin: Option<f64>) -> Subject<'a> {
        let edge = surface.points[b as usize] - surface.points[a as usize];
        let ends = [&self.apexes[a as usize], &self.apexes[b as usize]];
        Subject { ends, edge, pin, volume_share: self.volume_share }
    }

    /// Judges the edge between two points that share `faces`, which join `pairs` of wedges.
    fn judge_between(
        &self,
        surface: &Surface,
        [a, b]: [u32; 2],
        faces: impl Iterator<Item = usize>,
        pairs: &[(u32, u32)],
        fixed: Option<DVec3>,
    ) -> Option<Candidate> {
        let shared = faces.map(|face| self.facets[face].area_vector()).sum();
        let start = surface.points[a as usize];
        let subject = self.subject(surface, [a, b], fixed.map(|x| f64::from(x != start)));
        let factor = subject.factor(self.options.curvature_weight);
        let of_attributes = (fixed.is_none() && !self.metric.is_empty()).then(|| {
            let quadric = self.metric.quadric([a, b], pairs, subject.edge.as_vec3());
            quadric.scaled((ATTRIBUTES_IN_PLACE / factor) as f32)
        });
        let place = subject.place(shared, of_attributes, |offset| self.room.contains(start + offset));
        let position = fixed.unwrap_or(start + place.offset);
        let mut cost = place.error * factor;
        if !self.metric.is_empty() {
            cost += self.cost_of_attributes(surface, [a, b], pairs, position);
        }
        cost.is_finite().then_some(Candidate { cost, position })
    }

    /// What `candidate` costs besides where it leaves an end behind at which the surface turns back on itself: area · distance² from the faces around
    /// the joined point. Planes tell little of it: those along a limb or a blade go on in the tip that is taken away.
    fn with_retreat<M: Borrow<Merge>>(
        &self,
        surface: &Surface,
        ends: [u32; 2],
        candidate: Candidate,
        merge: impl FnOnce() -> M,
    ) -> Candidate {
        let is_turned_back = ends.map(|end| self.apexes[end as usize].varies_by(TURNED_BACK));
        if is_turned_back == [false; 2] {
            return candidate;
        }
        let merge = merge();
        let rims = merge.borrow().rims();
        let from = |p: u32| (surface.points[p as usize] - candidate.position).as_vec3();
        let lost = |end: u32| {
            let squared = distance_squared(from(end), rims.len(), |i| rims[i].map(from));
            f64::from(RETREAT * self.apexes[end as usize].weight() * squared)
        };
        let lost: f64 = ends.into_iter().zip(is_turned_back).map(|(end, is)| if is { lost(end) } else { 0.0 }).sum();
        let factor = self.subject(surface, ends, None).factor(self.options.curvature_weight);
        Candidate { cost: candidate.cost + lost * factor, ..candidate }
    }

    /// Keeps what the next refresh cannot find again.
    fn drop_apexes(&mut self) {
        self.forms.extend(take(&mut self.apexes).iter().map(Apex::form));
        self.facets = Vec::new();
    }

    /// About what four edges cost, given what is known of their ends.
    #[inline]
    fn estimate(&self, ends: [[u32; 2]; LANES], [a, b]: [&Lanes; 2]) -> [f32; LANES] {
        let Estimate { error, factor, edge } = estimate(a, b, self.options.curvature_weight, self.at_ends);
        if self.metric.is_empty() {
            return (error * factor).to_array();
        }
        let of_attributes = self.metric.guess(ends, edge);
        let costs = if self.metric.has_displacements() {
            (error + of_attributes) * factor
        } else {
            error * factor + of_attributes
        };
        costs.to_array()
    }

    /// Whether attributes at ends are judged, not estimated.
    fn judges_attributes(&self) -> bool {
        self.at_ends && !self.metric.is_empty()
    }

    /// Whether estimates are all that is needed.
    fn are_complete(&self, estimates: &[f32]) -> bool {
        !self.judges_attributes() && estimates.iter().fold(true, |all, cost| all & cost.is_finite())
    }

    /// Judges what cannot be estimated.
    fn complete(&self, surface: &Surface, a: u32, b: u32, cost: &mut f32) {
        if !cost.is_finite() || self.judges_attributes() {
            *cost = self.judge(surface, a, b, None).map_or(UNRANKED, |c| c.cost as f32);
        }
    }

    /// What attributes add to the cost of the edge. Errors of the shape in other poses have the factor that errors of the shape have.
    fn cost_of_attributes(&self, surface: &Surface, ends: [u32; 2], pairs: &[(u32, u32)], position: DVec3) -> f64 {
        let deviation = self.metric.deviation(surface, ends, pairs, position);
        if self.metric.has_displacements() {
            deviation * self.subject(surface, ends, None).factor(self.options.curvature_weight)
        } else {
            deviation
        }
    }

    /// The wedges that the faces of an edge join, as far as somebody asks for them.
    fn pairs(&self, surface: &Surface, [a, b]: [u32; 2]) -> Pairs {
        if self.metric.is_empty() { Pairs::new() } else { pair_wedges(surface, a, b) }
    }
}

/// Two edges of a face, from its first corner.
fn edges_of(surface: &Surface, face: usize) -> [Vec3; 2] {
    if !surface.is_live(face) {
        return [Vec3::ZERO; 2];
    }
    let [a, b, c] = surface.triangle(face);
    [(b - a).as_vec3(), (c - a).as_vec3()]
}

/// Where points stay no value is fitted to its place: the order has to make up for that.
fn attribute_weights(options: &Options) -> AttributeWeights {
    let AttributeWeights { normal, tex_coord, color } = options.attribute_weights;
    match options.placement {
        Placement::Optimal => options.attribute_weights,
        Placement::Subset => {
            AttributeWeights { normal: NORMALS_AT_ENDS * normal, tex_coord, color: COLORS_AT_ENDS * color }
        }
    }
}

impl Cost for Enhanced {
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]) {
        self.facets.resize(surface.face_slots(), Facet::default());
        tasks::for_some(&mut self.facets, |start, facets| {
            for (four, facets) in facets.chunks_mut(LANES).enumerate() {
                let first = start + four * LANES;
                let edges = std::array::from_fn(|lane| edges_of(surface, first + lane.min(facets.len() - 1)));
                facets.iter_mut().zip(Facet::of_four(edges)).for_each(|(facet, new)| *facet = new);
            }
        });
        let facets = &self.facets;
        self.apexes.extend(take(&mut self.forms).into_iter().map(Apex::with_form));
        tasks::for_each(&mut self.apexes, |p, apex| {
            let ring = surface.ring(p as u32);
            if ring.is_empty() {
                return;
            }
            apex.set_faces(surface.points[p], ring.iter().map(|&c| facets[Surface::face_of(c)]));
        });
        self.ridged.fill(false);
        for edge in edges.iter().filter(|e| !e.kind.is_plain()) {
            self.add_edge(surface, edge, &sides_of(surface, edge.a, edge.b), &[edge.a, edge.b]);
        }
        let facets = &self.facets;
        self.metric.refresh(surface, |face| facets[face].parts());
    }

    fn rank(&self, surface: &Surface, edges: &[Edge], locked: &Locked, costs: &mut [f32]) {
        let estimate = |edges: &[Edge; LANES]| {
            let a = Lanes::of(edges.each_ref().map(|e| &self.apexes[e.a as usize]));
            let b = Lanes::of(edges.each_ref().map(|e| &self.apexes[e.b as usize]));
            self.estimate(edges.map(|e| [e.a, e.b]), [&a, &b])
        };
        let (fours, rest) = edges.as_chunks();
        let (costs_of_fours, costs_of_rest) = costs.as_chunks_mut();
        fours.iter().zip(costs_of_fours).for_each(|(edges, costs)| *costs = estimate(edges));
        if let Some(&last) = rest.last() {
            let filled = std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(last));
            costs_of_rest.copy_from_slice(&estimate(&filled)[..rest.len()]);
        }
        if !locked.are_none() || !self.are_complete(costs) {
            for (edge, cost) in edges.iter().zip(costs) {
                if locked.has(edge.a) || locked.has(edge.b) {
                    *cost = self.rank_exactly(surface, edge, locked);
                } else {
                    self.complete(surface, edge.a, edge.b, cost);
                }
            }
        }
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        if self.at_ends {
            return self.judge_ends(surface, a, b, fixed);
        }
        let at_both = |&&c: &&u32| surface.opposite(c).contains(&b);
        let faces = surface.ring(a).iter().filter(at_both).map(|&c| Surface::face_of(c));
        let candidate = self.judge_between(surface, [a, b], faces, &self.pairs(surface, [a, b]), fixed)?;
        Some(self.with_retreat(surface, [a, b], candidate, || Merge::new(surface, a, b)))
    }

    fn judge_merge(&self, surface: &Surface, merge: &Merge, fixed: Option<DVec3>) -> Option<Candidate> {
        let ends = [merge.kept, merge.gone];
        if self.at_ends {
            return self.judge_ends(surface, ends[0], ends[1], fixed);
        }
        let candidate = self.judge_between(surface, ends, merge.faces(), &merge.pairs, fixed)?;
        Some(self.with_retreat(surface, ends, candidate, || merge))
    }

    fn rank_hub(&self, surface: &Surface, hub: u32, around: &[u32], costs: &mut [f32]) {
        let here = Lanes::splat(&self.apexes[hub as usize]);
        let estimate = |points: &[u32; LANES]| {
            let others = Lanes::of(points.each_ref().map(|&p| &self.apexes[p as usize]));
            self.estimate(points.map(|p| [hub, p]), [&here, &others])
        };
        let (fours, rest) = around.as_chunks();
        let (costs_of_fours, costs_of_rest) = costs.as_chunks_mut();
        fours.iter().zip(costs_of_fours).for_each(|(points, costs)| *costs = estimate(points));
        if let Some(&last) = rest.last() {
            let filled = estimate(&std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(last)));
            costs_of_rest.iter_mut().zip(filled).for_each(|(cost, new)| *cost = new);
        }
        if !self.are_complete(costs) {
            for (&p, cost) in around.iter().zip(costs) {
                self.complete(surface, hub.min(p), hub.max(p), cost);
            }
        }
    }

    fn metric(&self) -> &Metric {
        &self.metric
    }

    fn weigh(&self, area: f64, distance_squared: f64) -> f64 {
        if self.at_ends { area.sqrt() * distance_squared } else { area * distance_squared }
    }

    fn bend(&self, a: u32, b: u32) -> f64 {
        let bend = self.apexes[a as usize].bend().min(self.apexes[b as usize].bend());
        if bend < CREASED { bend } else { 0.0 }
    }

    fn is_slender(&self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|p| self.apexes[p as usize].form().angle);
        0.5 * (a + b) < SLENDER
    }

    fn emphasis(&self, points: &mut dyn Iterator<Item = u32>, square: f64) -> f64 {
        let (sum, count) = points.fold((0.0, 0.0), |(sum, count), p| {
            (sum + f64::from(self.apexes[p as usize].form().curvature), count + 1.0)
        });
        emphasis(sum / count, square, self.options.curvature_weight)
    }

    fn follow_faces(&mut self, spokes: &[Corner], fan: &Fan) {
        for (corners, four) in spokes.chunks(LANES).zip(fan.fours()) {
            for (&corner, facet) in corners.iter().zip(four.facets()) {
                self.facets[Surface::face_of(corner)] = Facet(facet);
            }
        }
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        if !self.metric.is_empty() {
            self.metric.merged(surface, kept);
        }
        self.ridged[kept as usize] |= self.ridged[gone as usize];
        let joint = self.apexes[kept as usize].form().mean(self.apexes[gone as usize].form());
        self.apexes[kept as usize].set_form(joint);
    }

    fn broke(&mut self, surface: &Surface, kept: u32) {
        self.ridged[kept as usize] = true;
        surface.around(kept).for_each(|p| self.ridged[p as usize] = true);
    }

    fn grow(&mut self, surface: &Surface) {
        let known = self.apexes.len();
        for p in known..surface.points.len() {
            // New points take the mean of their neighbours' forms; the rest is rebuilt at each pass.
            let neighbours = surface.neighbours(p as u32);
            let forms = neighbours.iter().filter_map(|&n| self.apexes.get(n as usize)).map(Apex::form);
            self.apexes.push(Apex::with_form(Form::mean_of(forms)));
            self.ridged.push(false);
        }
    }

    fn is_separable(&self) -> bool {
        self.metric.is_empty()
    }

    fn split(&mut self, parts: &[(Region, Surface)]) -> Vec<Box<dyn Cost>> {
        self.drop_apexes();
        let this = &*self;
        let part = |(region, _): &(Region, Surface)| -> Box<dyn Cost> {
            Box::new(Self {
                options: this.options.clone(),
                apexes: Vec::new(),
                forms: region.points.iter().map(|&p| this.forms[p as usize]).collect(),
                ridged: vec![false; region.points.len()],
                facets: Vec::new(),
                metric: Metric::default(),
                ..*this
            })
        };
        parts.par_iter().map(part).collect()
    }

    fn read_through(&self) {
        tasks::read_through(&self.apexes);
        tasks::read_through(&self.facets);
        tasks::read_through(&self.ridged);
    }

    fn join(&mut self, parts: Vec<(&Region, Box<dyn Cost>)>, count: usize) {
        self.forms = vec![Form::default(); count];
        self.ridged = vec![false; count];
        for (region, part) in parts {
            let Ok(mut part) = (part as Box<dyn Any>).downcast::<Self>() else { return };
            part.drop_apexes();
            region.in_whole(part.forms).for_each(|(p, form)| self.forms[p] = form);
        }
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.take_faces(surface, point);
        if !self.metric.is_empty() {
            let facets = &self.facets;
            self.metric.update(surface, point, |face| facets[face].parts());
        }
    }

    fn update_shape(&mut self, surface: &Surface, point: u32) {
        // Ends are judged by the faces themselves.
        if !self.at_ends || self.ridged[point as usize] {
            self.take_faces(surface, point);
        }
    }
}
