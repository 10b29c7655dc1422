use super::*;
use crate::mesh::{Attribute, Semantic};

const SAMPLING: Sampling = Sampling { samples: 4_000, seed: 1 };

fn near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-6 * expected.abs().max(1e-3)
}

/// A flat grid of 2 n² triangles over the unit square, facing +z.
fn plane(n: u32, z: f32) -> Mesh {
    let positions = (0..=n).flat_map(|y| (0..=n).map(move |x| [x as f32 / n as f32, y as f32 / n as f32, z])).collect();
    let corner = |x, y| y * (n + 1) + x;
    let cells = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
    let triangles = cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// A closed cube of 12 triangles; with `split`, every face has vertices of its own.
fn cube(split: bool) -> Mesh {
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|x| x as f32);
    let quads: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut mesh = Mesh { positions: (0..8).map(corner).collect(), ..Mesh::default() };
    for quad in quads {
        let [a, b, c, d] = if split {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(quad.map(corner));
            [first, first + 1, first + 2, first + 3]
        } else {
            quad
        };
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn moved(mesh: &Mesh, change: impl Fn([f32; 3]) -> [f32; 3]) -> Mesh {
    Mesh { positions: mesh.positions.iter().map(|&p| change(p)).collect(), ..mesh.clone() }
}

/// A latitude-longitude sphere of radius 1 with its vertices on the sphere.
fn sphere(rings: u32) -> Mesh {
    let segments = 2 * rings;
    let at = |ring: u32, segment: u32| {
        let (polar, azimuth) = (
            std::f64::consts::PI * f64::from(ring) / f64::from(rings),
            std::f64::consts::TAU * f64::from(segment % segments) / f64::from(segments),
        );
        let radius = if ring == 0 || ring == rings { 0.0 } else { polar.sin() };
        [radius * azimuth.cos(), radius * azimuth.sin(), polar.cos()].map(|x| x as f32)
    };
    let mut mesh = Mesh::default();
    for ring in 0..rings {
        for segment in 0..segments {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([
                at(ring, segment),
                at(ring + 1, segment),
                at(ring + 1, segment + 1),
                at(ring, segment + 1),
            ]);
            if ring + 1 < rings {
                mesh.triangles.push([first, first + 1, first + 2]);
            }
            if ring > 0 {
                mesh.triangles.push([first, first + 2, first + 3]);
            }
        }
    }
    mesh
}

#[test]
fn parallel_planes_are_everywhere_as_far_apart() {
    let result = Ruler::new(&plane(3, 0.0), SAMPLING).measure(&plane(7, 0.25));
    for distance in [result.to_level, result.to_source] {
        assert!(near(distance.max, 0.25) && near(distance.rms, 0.25) && near(distance.mean, 0.25), "{distance:?}");
    }
    assert!(near(result.hausdorff(), 0.25) && near(result.rms(), 0.25) && near(result.mean(), 0.25));
    assert!(near(result.diagonal, 2f64.sqrt()));
    assert_eq!((result.normal_deg, result.flipped, result.degenerate, result.nonmanifold_edges), (0.0, 0, 0, 0));
    assert_eq!((result.triangles, result.vertices), (98, 64));
}

/// Faces of the level lie 0.1 outside: at a corner the distance is 0.1 √3.
#[test]
fn a_larger_cube_is_farthest_at_its_corners() {
    let level = moved(&cube(true), |p| p.map(|x| (x - 0.5) * 1.2 + 0.5));
    let result = Ruler::new(&cube(false), SAMPLING).measure(&level);
    assert!(near(result.to_source.max, 0.1 * 3f64.sqrt()), "{result:?}");
    assert!(near(result.to_level.max, 0.1) && near(result.to_level.rms, 0.1), "{result:?}");
    assert_eq!((result.gap_edges, result.flipped), (0, 0));
}

/// Shifted by 0.1 along x, one side sticks out by 0.1 and one lies inside, where the four sides beside it may be
/// nearer: ∫₀^0.1 (1 − 2t)² dt. Of the four other sides a strip sticks out: ∫₀^0.1 t dt each.
#[test]
fn a_shifted_cube_is_partly_in_place() {
    let result = Ruler::new(&cube(false), SAMPLING).measure(&moved(&cube(false), |[x, y, z]| [x + 0.1, y, z]));
    let inside = 0.1 - 2.0 * 0.01 + 4.0 / 3.0 * 0.001;
    let mean = (0.1 + inside + 4.0 * 0.005) / 6.0;
    for found in [result.to_source.mean, result.to_level.mean] {
        assert!((found - mean).abs() < 0.01 * mean, "{found} {mean}");
    }
    assert!(near(result.hausdorff(), 0.1));
}

#[test]
fn an_inscribed_sphere_is_farthest_in_the_middle_of_its_faces() {
    let result = Ruler::new(&sphere(64), Sampling::default()).measure(&sphere(8));
    // The plane of a quad at the equator is 1/√(1 + 2 tan²(π/16)) from the centre; the fine one lies up to 0.0006
    // inside of the sphere itself.
    let expected = 1.0 - 1.0 / (1.0 + 2.0 * (std::f64::consts::PI / 16.0).tan().powi(2)).sqrt();
    let found = result.hausdorff();
    assert!(found < expected && found > expected - 0.0006, "{found} {expected}");
    assert_eq!((result.gap_edges, result.flipped), (0, 0));
}

#[test]
fn relative_figures_do_not_depend_on_scale_or_place() {
    let measure = |scale: f32, shift: f32| {
        let change = |p: [f32; 3]| p.map(|x| x * scale + shift);
        Ruler::new(&moved(&sphere(16), change), SAMPLING).measure(&moved(&sphere(6), change))
    };
    let unit = measure(1.0, 0.0);
    for (scale, shift, tolerance) in [(2f32.powi(60), 0.0, 1e-12), (2f32.powi(-60), 0.0, 1e-12), (1.0, 100.0, 1e-3)] {
        let other = measure(scale, shift);
        for figure in [Measurement::hausdorff, Measurement::rms, Measurement::mean] {
            let (a, b) = (figure(&unit) / unit.diagonal, figure(&other) / other.diagonal);
            assert!((a - b).abs() <= tolerance * a, "{a} {b}");
        }
        assert!((unit.normal_deg - other.normal_deg).abs() < tolerance * unit.normal_deg);
        assert_eq!((unit.slivers10, unit.flipped, unit.gap_edges), (other.slivers10, other.flipped, other.gap_edges));
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let measure = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Ruler::new(&sphere(30), SAMPLING).measure(&sphere(7)))
    };
    let one = format!("{:?}", measure(1));
    assert_eq!(one, format!("{:?}", measure(2)));
    assert_eq!(one, format!("{:?}", measure(7)));
}

#[test]
fn empty_meshes_give_numbers() {
    let (empty, full) = (Mesh::default(), cube(false));
    assert_eq!(Ruler::new(&empty, SAMPLING).measure(&empty), Measurement::default());
    let gone = Ruler::new(&full, SAMPLING).measure(&empty);
    assert_eq!(gone.hausdorff(), gone.diagonal);
    let from_nothing = Ruler::new(&empty, SAMPLING).measure(&full);
    assert!(near(from_nothing.hausdorff(), 3f64.sqrt()));
}

#[test]
fn a_point_and_a_line_give_numbers() {
    let point = Mesh { positions: vec![[1.0; 3]], triangles: vec![[0; 3]; 2], ..Mesh::default() };
    let line = Mesh {
        positions: vec![[0.0; 3], [3.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let same = Ruler::new(&point, SAMPLING).measure(&point);
    assert!(same.hausdorff() < 1e-12 && same.degenerate == 2, "{same:?}");
    let result = Ruler::new(&line, SAMPLING).measure(&point);
    assert!(near(result.to_level.max, 6f64.sqrt()), "{result:?}");
    assert!(near(result.to_source.rms, 2f64.sqrt()));
    assert_eq!((result.degenerate, result.slivers5), (2, 1.0));
}

#[test]
fn bounding_sphere_of_a_cube_is_half_its_diagonal() {
    let ruler = Ruler::new(&cube(true), SAMPLING);
    assert!(near(ruler.bounding_radius(), 3f64.sqrt() / 2.0) && near(ruler.diagonal(), 3f64.sqrt()));
    // Unused vertices do not count.
    let mut mesh = cube(false);
    mesh.positions.push([9.0; 3]);
    assert!(near(Ruler::new(&mesh, SAMPLING).diagonal(), 3f64.sqrt()));
}

#[test]
fn turned_faces_are_flipped() {
    let mut level = cube(false);
    level.triangles[3].swap(0, 1);
    let result = Ruler::new(&cube(false), SAMPLING).measure(&level);
    assert_eq!(result.flipped, 1);
    assert!((result.normal_deg - 180.0 / 12.0).abs() < 0.5, "{}", result.normal_deg);
}

#[test]
fn the_two_sides_of_a_sheet_are_not_flipped() {
    let mut sheet = plane(4, 0.0);
    sheet.triangles.extend(plane(4, 0.0).triangles.iter().map(|&[a, b, c]| [b, a, c]));
    let result = Ruler::new(&sheet, SAMPLING).measure(&sheet);
    assert_eq!((result.flipped, result.normal_deg), (0, 0.0));
}

#[test]
fn a_moved_seam_vertex_opens_gaps() {
    let ruler = Ruler::new(&cube(true), SAMPLING);
    assert_eq!(ruler.measure(&cube(true)).gap_edges, 0);
    let mut level = cube(true);
    level.positions[8][0] += 0.01;
    // The vertex lies on two edges of its face; each is open now, and so is its former partner.
    assert_eq!(ruler.measure(&level).gap_edges, 4);
    // A missing face leaves three open edges.
    let mut level = cube(true);
    level.triangles.pop();
    assert_eq!(ruler.measure(&level).gap_edges, 3);
}

/// Open at z = 1: the border may be simplified, the side must not crack.
#[test]
fn gaps_are_told_from_the_border() {
    let ring = |n: u32, crack: bool| {
        let at = |i: u32, z: u32| {
            let angle = std::f32::consts::TAU * (i % n) as f32 / n as f32;
            [angle.cos(), angle.sin(), 3.0 * z as f32]
        };
        let mut mesh = Mesh { positions: vec![[0.0, 0.0, 0.0]], ..Mesh::default() };
        for i in 0..n {
            let first = mesh.positions.len() as u32;
            let shift = if crack && i == 0 { 0.02 } else { 0.0 };
            let below = |i| at(i, 0).map(|x| x * (1.0 - shift));
            mesh.positions.extend([at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1), below(i), below(i + 1)]);
            mesh.triangles.extend([
                [first, first + 1, first + 2],
                [first, first + 2, first + 3],
                [0, first + 5, first + 4],
            ]);
        }
        mesh
    };
    let ruler = Ruler::new(&ring(64, false), SAMPLING);
    assert_eq!(ruler.measure(&ring(8, false)).gap_edges, 0);
    // The rim and its former partner, and the two spokes that moved with it.
    assert_eq!(ruler.measure(&ring(8, true)).gap_edges, 6);
}

fn with(mut mesh: Mesh, semantic: Semantic, width: usize, value: impl Fn([f32; 3]) -> Vec<f32>) -> Mesh {
    let values = mesh.positions.iter().flat_map(|&p| value(p)).collect();
    mesh.attributes.push(Attribute { semantic, width, values });
    mesh
}

#[test]
fn texture_coordinates_and_shading_are_compared_at_the_closest_points() {
    let uv = |shift: f32| move |[x, y, _]: [f32; 3]| vec![2.0 * x + shift, 2.0 * y];
    let source = with(plane(5, 0.0), Semantic::TexCoord(0), 2, uv(0.0));
    let ruler = Ruler::new(&with(source, Semantic::Normal, 3, |_| vec![0.0, 0.0, 1.0]), SAMPLING);
    let level = with(plane(2, 0.1), Semantic::TexCoord(0), 2, uv(0.5));
    let result = ruler.measure(&with(level, Semantic::Normal, 3, |_| vec![0.0, 3.0, 3.0]));
    // A slip of 0.1 % of the diagonal is forgiven, here 0.0028 UV.
    assert!(
        (result.uv_mean.unwrap() - 0.5).abs() < 0.003 && (result.uv_p95.unwrap() - 0.5).abs() < 0.003,
        "{result:?}"
    );
    assert!(near(result.shading_deg.unwrap(), 45.0));
    let bare = ruler.measure(&plane(2, 0.1));
    assert_eq!((bare.uv_mean, bare.uv_p95, bare.shading_deg), (None, None, None));
}

/// Two charts meet at x = ½; the level's samples there may hit the other chart, which must not count as a slip of 5.
#[test]
fn a_seam_does_not_count_as_a_slip() {
    let halves = |n: u32, z: f32| {
        let half = |from: f32, u: f32| {
            let mesh = moved(&plane(n, z), |[x, y, z]| [from + x / 2.0, y, z]);
            with(mesh, Semantic::TexCoord(0), 2, move |[x, y, _]| vec![x + u, y])
        };
        let (mut mesh, right) = (half(0.0, 0.0), half(0.5, 5.0));
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(right.positions);
        mesh.triangles.extend(right.triangles.iter().map(|t| t.map(|v| v + first)));
        mesh.attributes[0].values.extend(&right.attributes[0].values);
        mesh
    };
    // The level's seam lies 0.0005 beside the source's: closest points cross it.
    let level = moved(&halves(1, 0.0), |[x, y, z]| [if x == 0.5 { 0.5005 } else { x }, y, z]);
    let result = Ruler::new(&halves(4, 0.0), Sampling::default()).measure(&level);
    assert!(result.uv_mean.unwrap() < 0.001, "{result:?}");
}

#[test]
fn fewer_samples_do_for_small_meshes() {
    assert_eq!(Sampling::for_triangles(12).samples, 30_000);
    assert_eq!(Sampling::for_triangles(3_000).samples, 48_000);
    assert_eq!(Sampling::for_triangles(usize::MAX).samples, 100_000);
}
