//! Round trips of small and odd meshes through log, records and back.

use super::decode::End;
use super::encode::Encoded;
use super::*;
use crate::mesh::{Attribute, Mesh, Semantic};
use crate::simplify::{self, Options};
use proptest::prelude::*;

/// A progressive mesh and what it was made from.
struct Trip {
    source: Mesh,
    encoded: Encoded,
}

impl Trip {
    /// Down to `triangles`; positions and attributes as floats.
    fn down(source: Mesh, triangles: usize) -> Self {
        let (log, surface) = simplify::record(&source, &Options::default(), triangles).unwrap();
        let steps = Steps::of(&source);
        let float = |step, width| std::iter::repeat_n(Number::Float { step }, width);
        let columns = source.attributes.iter().zip(&steps.attributes);
        let layout: Vec<Number> =
            float(steps.position, 3).chain(columns.flat_map(|(a, &s)| float(s, a.width))).collect();
        let groups = source.groups.iter().copied().max().unwrap_or(0) as usize + 1;
        let mut nodes = State::new(vec![layout; groups]);
        let group_of = |v: u32| {
            let user = source.triangles.iter().position(|t| t.contains(&v));
            source.group(user.expect("a used vertex"))
        };
        for &v in &log.sources {
            nodes.add_vertex(group_of(v), &row(&source, v));
        }
        for (v, &group) in log.made_groups.iter().enumerate() {
            nodes.add_vertex(group, &row(&log.made, v as u32));
        }
        let encoded = encode(&log, &surface, &nodes);
        Self { source, encoded }
    }

    fn stream(&self) -> Vec<u8> {
        self.encoded.chunks.iter().flat_map(|c| c.bytes.clone()).collect()
    }

    fn full_count(&self) -> usize {
        self.encoded.chunks.last().map_or(self.encoded.base.faces().len(), |c| c.triangles)
    }

    /// Refined by as much of `bytes` as there is, to at most `triangles`.
    fn up(&self, bytes: &[u8], triangles: usize) -> (State, End) {
        let mut state = self.encoded.base.clone();
        let end = refine_to(&mut state, bytes, triangles);
        (state, end)
    }

    /// The source comes back, and every level on the way is sound.
    fn check(&self) {
        let stream = self.stream();
        let (full, end) = self.up(&stream, usize::MAX);
        assert_eq!((end.stop, end.bytes), (Stop::Bytes, stream.len()));
        assert_eq!(end.records, self.encoded.chunks.iter().map(|c| c.records).sum::<usize>());
        assert_eq!(triangles_of(&full), source_triangles(&self.source));
        let mut state = self.encoded.base.clone();
        let mut at = 0;
        while at < stream.len() {
            let before = state.faces().len();
            let end = refine_to(&mut state, &stream[at..], before + 1);
            let step = if end.records > 0 { end } else { self.one_record(&mut state, &stream[at..]) };
            at += step.bytes;
            check_sound(&state);
        }
        assert_eq!(triangles_of(&state), source_triangles(&self.source));
    }

    fn one_record(&self, state: &mut State, bytes: &[u8]) -> End {
        let before = state.faces().len();
        let end = (2..).map(|more| refine_to(state, bytes, before + more)).find(|end| end.records > 0);
        end.expect("some record comes next")
    }
}

fn refine_to(state: &mut State, bytes: &[u8], triangles: usize) -> End {
    refine(state, bytes, Most { triangles, numbers: 1 << 20 })
}

fn row(mesh: &Mesh, v: u32) -> Vec<i32> {
    let columns = mesh.attributes.iter().flat_map(|a| &a.values[v as usize * a.width..][..a.width]);
    mesh.positions[v as usize].iter().chain(columns).map(|x| x.to_bits() as i32).collect()
}

/// Triangles as corner rows, smallest corner first, sorted. Zeros have no sign: vertices that differ in it are one.
fn sorted(triangles: impl Iterator<Item = (u32, [Vec<i32>; 3])>) -> Vec<(u32, [Vec<i32>; 3])> {
    let plain = |row: Vec<i32>| row.into_iter().map(|x| if x == i32::MIN { 0 } else { x }).collect::<Vec<_>>();
    let mut all: Vec<_> = triangles
        .map(|(group, corners)| {
            let mut corners = corners.map(plain);
            let first = (0..3).min_by_key(|&k| corners[k].clone()).unwrap();
            corners.rotate_left(first);
            (group, corners)
        })
        .collect();
    all.sort();
    all
}

fn triangles_of(state: &State) -> Vec<(u32, [Vec<i32>; 3])> {
    sorted(state.faces().iter().map(|f| (state.group(f[0]), f.map(|v| state.row(v).to_vec()))))
}

fn source_triangles(mesh: &Mesh) -> Vec<(u32, [Vec<i32>; 3])> {
    sorted(mesh.triangles.iter().enumerate().map(|(t, f)| (mesh.group(t), f.map(|v| row(mesh, v)))))
}

fn check_sound(state: &State) {
    for (number, face) in state.faces().iter().enumerate() {
        for &v in face {
            assert!((v as usize) < state.vertex_count());
            assert!(state.ring(v).contains(&(number as u32)));
            assert_eq!(state.group(v), state.group(face[0]));
        }
    }
}

/// A bumpy grid; with a seam in the middle column, and two groups if `groups`.
fn bumps(n: u32, seam: bool, groups: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let mut uv = Vec::new();
    let mut vertex = |x: u32, y: u32, right: bool| {
        let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
        mesh.positions.push([u, v, 0.1 * (9.0 * u).sin() * (7.0 * v).cos()]);
        uv.extend([if right && seam { u - 0.7 } else { u }, v * 0.3]);
        mesh.positions.len() as u32 - 1
    };
    let mut triangles = Vec::new();
    let mut group = Vec::new();
    for x in 0..n {
        let right = x >= n / 2;
        for y in 0..n {
            let [a, b, c, d] = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| vertex(x, y, right));
            triangles.extend([[a, b, c], [a, c, d]]);
            group.extend([u32::from(right && groups); 2]);
        }
    }
    mesh.triangles = triangles;
    mesh.groups = group;
    mesh.attributes = vec![Attribute { semantic: Semantic::TexCoord(0), width: 2, values: uv }];
    mesh
}

#[test]
fn plain_seamed_and_grouped_meshes_come_back() {
    for (seam, groups) in [(false, false), (true, false), (true, true)] {
        let trip = Trip::down(bumps(12, seam, groups), 8);
        assert!(trip.encoded.base.faces().len() <= 16, "{}", trip.encoded.base.faces().len());
        trip.check();
    }
}

#[test]
fn triangles_without_area_and_copies_come_back() {
    let mut mesh = bumps(4, false, false);
    let first = mesh.triangles[0];
    let lonely = mesh.positions.len() as u32;
    mesh.positions.extend([[5.0, 0.0, 0.0]; 2]);
    mesh.attributes[0].values.extend([0.1, 0.2, 0.3, 0.4]);
    mesh.triangles.extend([first, [first[0], first[0], first[1]], [lonely, lonely + 1, first[2]]]);
    mesh.groups.resize(mesh.triangles.len(), 0);
    let trip = Trip::down(mesh, 8);
    assert_eq!(trip.full_count(), trip.source.triangles.len());
    trip.check();
}

#[test]
fn pieces_that_vanish_whole_come_back() {
    let mut mesh = bumps(6, false, false);
    let offset = mesh.positions.len() as u32;
    for i in 0..5 {
        let x = 2.0 + i as f32;
        mesh.positions.extend([[x, 0.0, 0.0], [x, 0.01, 0.0], [x, 0.0, 0.01]]);
        mesh.attributes[0].values.extend([0.5; 6]);
        mesh.triangles.push([0, 1, 2].map(|k| offset + 3 * i + k));
        mesh.groups.push(0);
    }
    let trip = Trip::down(mesh, 4);
    assert!(trip.encoded.base.faces().len() < 9);
    trip.check();
}

#[test]
fn a_prefix_of_the_stream_is_a_level() {
    let trip = Trip::down(bumps(10, true, true), 8);
    let stream = trip.stream();
    let mut last = 0;
    for length in 0..stream.len() {
        let (state, end) = trip.up(&stream[..length], usize::MAX);
        assert!(matches!(end.stop, Stop::Bytes | Stop::Truncated) && end.bytes <= length);
        assert!(state.faces().len() >= last);
        last = state.faces().len();
        // The same as the whole stream up to that count.
        assert_eq!(triangles_of(&trip.up(&stream, last).0), triangles_of(&state));
    }
    let mut end_of_chunk = 0;
    for chunk in &trip.encoded.chunks {
        end_of_chunk += chunk.bytes.len();
        let (state, end) = trip.up(&stream[..end_of_chunk], usize::MAX);
        assert_eq!((state.faces().len(), state.vertex_count()), (chunk.triangles, chunk.vertices));
        assert_eq!(end.stop, Stop::Bytes);
    }
}

/// Faces over few points: edges with many faces, folds, copies, faces without area.
fn soup() -> impl Strategy<Value = Mesh> {
    let faces = prop::collection::vec((prop::array::uniform3(0u32..12), 0u32..2), 1..60);
    let points = prop::collection::vec(prop::array::uniform3(-4i8..4), 12);
    (faces, points).prop_map(|(faces, points)| {
        let values = (0..24).map(|v| (v % 12 / 3) as f32).collect();
        Mesh {
            // A copy of the points for each group.
            positions: [&points[..], &points].concat().into_iter().map(|p| p.map(f32::from)).collect(),
            triangles: faces.iter().map(|(t, group)| t.map(|v| v + 12 * group)).collect(),
            groups: faces.iter().map(|f| f.1).collect(),
            attributes: vec![Attribute { semantic: Semantic::Generic, width: 1, values }],
            skin: None,
        }
    })
}

proptest! {
    #[test]
    fn any_soup_comes_back(mesh in soup()) {
        // Without a face that has an area there is no base.
        let points = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
        let has_area = |t: &[u32; 3]| { let [a, b, c] = points(t); a != b && b != c && c != a };
        prop_assume!(mesh.triangles.iter().any(has_area));
        Trip::down(mesh, 1).check();
    }

    #[test]
    fn a_damaged_stream_is_refused_or_gives_a_sound_mesh(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let trip = damaged_trip();
        let mut stream = trip.stream();
        for (at, byte) in edits {
            let at = at.index(stream.len());
            stream[at] = byte;
        }
        let (state, end) = trip.up(&stream, usize::MAX);
        if !matches!(end.stop, Stop::Malformed(_)) {
            check_sound(&state);
        }
        prop_assert!(state.vertex_count() <= stream.len() + trip.encoded.base.vertex_count());
    }
}

fn damaged_trip() -> &'static Trip {
    static TRIP: std::sync::LazyLock<Trip> = std::sync::LazyLock::new(|| Trip::down(bumps(8, true, true), 8));
    &TRIP
}

#[test]
fn a_run_of_zeros_cannot_ask_for_more_memory_than_allowed() {
    let trip = damaged_trip();
    let mut state = trip.encoded.base.clone();
    // No split, 2³² − 1 vertices added, each of a few zeros.
    let mut bytes = vec![4 | 8, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F];
    bytes.extend([0, 0, 0, 4].repeat(100_000));
    let end = refine(&mut state, &bytes, Most { triangles: usize::MAX, numbers: 10_000 });
    assert_eq!(end.stop, Stop::Malformed("more vertices than the limit on memory allows"));
}
