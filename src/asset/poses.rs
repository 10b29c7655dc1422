//! Poses of a mesh as its document has them: key moments of its animations, and each morph target alone.

use super::Asset;
use super::accessor::{self, Reader, Select};
use super::cursor::Cursor;
use super::scene::{Scene, Transform};
use crate::mesh::Pose;
use glam::{DMat4, DQuat, DVec3, Mat4};
use serde_json::Value;
use std::collections::BTreeMap;

/// Key moments that are looked at over all animations, and the fewest of each.
const MOMENTS: usize = 240;
const FEWEST_MOMENTS: usize = 4;

/// The animations of a document, decoded as far as they can deform meshes.
#[derive(Debug, Default)]
pub struct Animations {
    clips: Vec<Clip>,
    /// Nodes as they stand in the document.
    rest: Vec<Transform>,
    parents: Vec<Option<usize>>,
}

/// One animation.
#[derive(Debug, Default)]
struct Clip {
    /// Of nodes.
    tracks: Vec<Track>,
    /// Moments worth looking at.
    moments: Vec<f32>,
}

/// One channel.
#[derive(Debug)]
struct Track {
    node: usize,
    path: Path,
    times: Vec<f32>,
    values: Vec<f32>,
    interpolation: Interpolation,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Path {
    Translation,
    Rotation,
    Scale,
    Weights,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Interpolation {
    Linear,
    Step,
    CubicSpline,
}

impl Animations {
    /// Of a checked document. What cannot be read does not move: poses only guide and measure.
    pub(super) fn of(asset: &Asset, scene: &Scene) -> Self {
        let document = &asset.document;
        let deforms = !document.array("skins").is_empty() || !scene.animated_weights.is_empty();
        if !deforms {
            return Self::default();
        }
        let animations = document.array("animations");
        let budget = (MOMENTS / animations.len().max(1)).max(FEWEST_MOMENTS);
        Self {
            clips: animations.iter().map(|animation| Clip::read(asset, animation, budget)).collect(),
            rest: document.array("nodes").iter().map(Transform::of).collect(),
            parents: scene.parent.clone(),
        }
    }

    /// All poses of `meshes[mesh]`: with the skin of the first node that draws it.
    pub fn poses(&self, asset: &Asset, scene: &Scene, mesh: usize) -> Vec<Pose> {
        let document = &asset.document;
        let targets = count_targets(document.array("meshes").get(mesh));
        let alone = (0..targets).map(|target| Pose { joints: Vec::new(), weights: unit(targets, target) });
        let mut poses: Vec<Pose> = alone.collect();
        let nodes = scene.uses.get(mesh).map_or(&[][..], |uses| &uses.nodes);
        let skin_of = |node: &usize| document.array("nodes").get(*node)?.get("skin")?.as_u64();
        let skin = nodes.iter().find_map(skin_of).and_then(|skin| Skin::read(asset, usize::try_from(skin).ok()?));
        for clip in &self.clips {
            let moves_weights = |track: &Track| track.path == Path::Weights && nodes.contains(&track.node);
            let morphs = clip.tracks.iter().filter(|track| moves_weights(track));
            if skin.is_none() && morphs.clone().next().is_none() {
                continue;
            }
            for &moment in &clip.moments {
                let weights = morphs.clone().next().map(|track| track.at(moment, targets)).unwrap_or_default();
                let joints = skin.as_ref().map(|skin| self.joints(clip, skin, moment)).unwrap_or_default();
                let is_finite = weights.iter().all(|w| w.is_finite()) && joints.iter().all(Mat4::is_finite);
                if is_finite {
                    poses.push(Pose { joints, weights });
                }
            }
        }
        poses
    }

    /// The matrices of a skin's joints at a moment.
    fn joints(&self, clip: &Clip, skin: &Skin, moment: f32) -> Vec<Mat4> {
        let mut moved: BTreeMap<usize, Transform> = BTreeMap::new();
        for track in &clip.tracks {
            let Some(rest) = self.rest.get(track.node) else { continue };
            track.move_node(moment, moved.entry(track.node).or_insert(*rest));
        }
        let mut known: BTreeMap<usize, DMat4> = BTreeMap::new();
        let joint = |(&node, bind): (&usize, &DMat4)| (self.world(node, &moved, &mut known) * *bind).as_mat4();
        skin.joints.iter().zip(&skin.binds).map(joint).collect()
    }

    fn world(&self, node: usize, moved: &BTreeMap<usize, Transform>, known: &mut BTreeMap<usize, DMat4>) -> DMat4 {
        let mut path = Vec::new();
        let mut at = Some(node);
        let mut world = DMat4::IDENTITY;
        // The document was checked to be a forest; the bound only keeps a bug there from hanging here.
        while let Some(node) = at.filter(|_| path.len() <= self.parents.len()) {
            if let Some(done) = known.get(&node) {
                world = *done;
                break;
            }
            path.push(node);
            at = self.parents.get(node).copied().flatten();
        }
        for node in path.into_iter().rev() {
            let local = moved.get(&node).or_else(|| self.rest.get(node));
            world *= local.map_or(DMat4::IDENTITY, Transform::matrix);
            known.insert(node, world);
        }
        world
    }
}

/// Joints and their inverse bind matrices.
struct Skin {
    joints: Vec<usize>,
    binds: Vec<DMat4>,
}

impl Skin {
    fn read(asset: &Asset, index: usize) -> Option<Self> {
        let skin = Cursor::top(asset.document.root(), "skins", index)?;
        let joints: Vec<usize> = skin.get("joints")?.elements().ok()?.filter_map(|j| j.integer().ok()).collect();
        let mut binds = Vec::new();
        if let Some(accessor) = skin.get("inverseBindMatrices") {
            let numbers = read_floats(asset, accessor.integer().ok()?)?;
            let matrices = numbers.as_chunks::<16>().0.iter();
            binds.extend(matrices.map(|m| DMat4::from_cols_array(&m.map(f64::from))));
        }
        binds.resize(joints.len(), DMat4::IDENTITY);
        Some(Self { joints, binds })
    }
}

impl Clip {
    fn read(asset: &Asset, animation: &Value, budget: usize) -> Self {
        let animation = Cursor::root(animation);
        let channels = animation.get("channels").and_then(|channels| channels.elements().ok());
        let read = |channel: Cursor| Track::read(asset, &animation, &channel);
        let tracks: Vec<Track> = channels.into_iter().flatten().filter_map(read).collect();
        let mut moments: Vec<f32> = tracks.iter().flat_map(|track| &track.times).copied().collect();
        moments.sort_by(f32::total_cmp);
        moments.dedup();
        let step = moments.len().div_ceil(budget).max(1);
        // The middle of each stretch: animations often end as they begin.
        let moments = moments.into_iter().skip(step / 2).step_by(step).collect();
        Self { tracks, moments }
    }
}

impl Track {
    fn read(asset: &Asset, animation: &Cursor, channel: &Cursor) -> Option<Self> {
        let target = channel.get("target")?;
        let path = match target.get("path")?.string().ok()? {
            "translation" => Path::Translation,
            "rotation" => Path::Rotation,
            "scale" => Path::Scale,
            "weights" => Path::Weights,
            _ => return None,
        };
        let sampler = animation.value.get("samplers")?.get(channel.get("sampler")?.integer().ok()?)?;
        let sampler = Cursor::root(sampler);
        let interpolation = match sampler.get("interpolation").and_then(|i| i.string().ok()) {
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::CubicSpline,
            _ => Interpolation::Linear,
        };
        Some(Self {
            node: target.get("node")?.integer().ok()?,
            path,
            times: read_floats(asset, sampler.get("input")?.integer().ok()?)?,
            values: read_floats(asset, sampler.get("output")?.integer().ok()?)?,
            interpolation,
        })
    }

    /// The `width` numbers at `moment`; zeros where the file has too few.
    fn at(&self, moment: f32, width: usize) -> Vec<f32> {
        let after = self.times.partition_point(|time| *time <= moment);
        let before = after.saturating_sub(1);
        let after = after.min(self.times.len().saturating_sub(1));
        let time = |key: usize| self.times.get(key).copied().unwrap_or(0.0);
        let span = time(after) - time(before);
        let t = if span > 0.0 { ((moment - time(before)) / span).clamp(0.0, 1.0) } else { 0.0 };
        let rows = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let number = |row: usize, i: usize| self.values.get(row * width + i).copied().unwrap_or(0.0);
        let value = |key: usize, i: usize| number(key * rows + rows / 2, i);
        let interpolate = |i: usize| match self.interpolation {
            Interpolation::Step => value(before, i),
            Interpolation::Linear => value(before, i) * (1.0 - t) + value(after, i) * t,
            Interpolation::CubicSpline => {
                let (leaves, arrives) = (number(before * 3 + 2, i) * span, number(after * 3, i) * span);
                let (start, end) = (value(before, i), value(after, i));
                let (t2, t3) = (t * t, t * t * t);
                start * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + leaves * (t3 - 2.0 * t2 + t)
                    + end * (3.0 * t2 - 2.0 * t3)
                    + arrives * (t3 - t2)
            }
        };
        let mut numbers: Vec<f32> = (0..width).map(interpolate).collect();
        if self.path == Path::Rotation && self.interpolation == Interpolation::Linear {
            let [start, end] =
                [before, after].map(|key| DQuat::from_array([0, 1, 2, 3].map(|i| f64::from(value(key, i)))));
            numbers = start.slerp(end, f64::from(t)).to_array().map(|x| x as f32).to_vec();
        }
        numbers
    }

    fn move_node(&self, moment: f32, node: &mut Transform) {
        let triple = || match *self.at(moment, 3) {
            [x, y, z] => DVec3::new(x.into(), y.into(), z.into()),
            _ => DVec3::ZERO,
        };
        match self.path {
            Path::Translation => node.translation = triple(),
            Path::Scale => node.scale = triple(),
            Path::Rotation => {
                if let [x, y, z, w] = *self.at(moment, 4) {
                    node.rotation = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into()).normalize();
                }
            }
            Path::Weights => {}
        }
    }
}

fn read_floats(asset: &Asset, accessor: usize) -> Option<Vec<f32>> {
    let root = asset.document.root();
    if accessor::compression(root, &asset.buffers, accessor).is_some() {
        return None;
    }
    let mut numbers = Vec::new();
    let read = Reader::open(root, &asset.buffers, accessor).and_then(|r| r.read_floats(Select::All, &mut numbers));
    read.is_ok().then_some(numbers)
}

/// Morph targets of a mesh: all its primitives have as many.
fn count_targets(mesh: Option<&Value>) -> usize {
    let primitives = mesh.and_then(|mesh| mesh.get("primitives")?.as_array()).into_iter().flatten();
    primitives.filter_map(|p| p.get("targets")?.as_array()).map(Vec::len).max().unwrap_or(0)
}

fn unit(length: usize, index: usize) -> Vec<f32> {
    (0..length).map(|i| if i == index { 1.0 } else { 0.0 }).collect()
}
