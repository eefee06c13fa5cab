//! Tests of the queries' contract: the result is the best (t, triangle) over all triangles that the test
//! accepts, for any tree.

use super::bvh::{Bvh, Hit, MISS, Ray};
use super::triangle::{Frame, Line, bounds, is_degenerate};
use crate::num::rng::Rng;

/// Tests every ray against every triangle with the scalar test, and counts the accepted triangles.
struct Brute {
    frame: Frame,
    triangles: Vec<(u32, [[f32; 3]; 3])>,
}

impl Brute {
    fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let largest = positions.iter().flatten().fold(0.0_f32, |m, x| if x.abs() > m { x.abs() } else { m });
        let scale = Frame::scale_for(largest);
        let corners = |t: [u32; 3]| t.map(|i| positions[i as usize].map(|x| x * scale));
        let kept: Vec<_> = triangles
            .iter()
            .enumerate()
            .map(|(i, &t)| (i as u32, corners(t)))
            .filter(|t| !is_degenerate(t.1))
            .collect();
        let mut all = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for (_, t) in &kept {
            let [lo, hi] = bounds(*t);
            for k in 0..3 {
                all[0][k] = if lo[k] < all[0][k] { lo[k] } else { all[0][k] };
                all[1][k] = if hi[k] > all[1][k] { hi[k] } else { all[1][k] };
            }
        }
        let bounds = if kept.is_empty() { [[0.0; 3]; 2] } else { all };
        Self { frame: Frame { scale, bounds }, triangles: kept }
    }

    fn closest(&self, ray: &Ray) -> (Hit, usize) {
        let mut best = (Hit::NONE, 0);
        let Some(line) = Line::new(ray, &self.frame) else { return best };
        let mut nearest = f32::INFINITY;
        for &(i, corners) in &self.triangles {
            if let Some(m) = line.meet(corners) {
                best.1 += 1;
                if m.t < nearest {
                    nearest = m.t;
                    best.0 = Hit { t: line.in_caller_units(m.t), u: m.u, v: m.v, triangle: i };
                }
            }
        }
        best
    }
}

fn uniform(r: &Rng, i: usize, step: u32, k: u16) -> f32 {
    2.0 * r.uniform_f32(i as u64, step, 0x6700, k) - 1.0
}

fn point(r: &Rng, i: usize, step: u32) -> [f32; 3] {
    [0, 1, 2].map(|k| uniform(r, i, step, k))
}

/// A closed sphere of 2·u·v triangles; each pole is shared by a fan.
fn sphere(u: usize, v: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    use crate::num::elem::{cos, sin};
    let mut p = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    for j in 1..v {
        for i in 0..u {
            let (a, b) =
                (std::f32::consts::TAU * i as f32 / u as f32, std::f32::consts::PI * j as f32 / v as f32);
            p.push([sin(b) * cos(a), sin(b) * sin(a), cos(b)]);
        }
    }
    let at = |i: usize, j: usize| (2 + (j - 1) * u + i % u) as u32;
    let mut t = vec![];
    for i in 0..u {
        t.push([0, at(i, 1), at(i + 1, 1)]);
        t.push([1, at(i + 1, v - 1), at(i, v - 1)]);
        for j in 1..v - 1 {
            t.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            t.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    (p, t)
}

/// Rays of all kinds: generic, parallel to axes (with both zeros), in planes of the grid, through corners and
/// edges.
fn rays(r: &Rng, p: &[[f32; 3]], t: &[[u32; 3]], n: usize) -> Vec<Ray> {
    let size = p.iter().flatten().fold(0.0_f32, |m, x| if x.abs() > m { x.abs() } else { m });
    (0..n)
        .map(|i| {
            let corners = t[i * 7919 % t.len()].map(|c| p[c as usize]);
            let start = point(r, i, 0).map(|x| 2.0 * size * x);
            let (a, b, c) =
                (r.uniform_f32(i as u64, 1, 0x6701, 0), r.uniform_f32(i as u64, 1, 0x6701, 1), i % 3);
            let on = |w: [f32; 3]| {
                [0, 1, 2].map(|k| w[0] * corners[0][k] + w[1] * corners[1][k] + w[2] * corners[2][k])
            };
            let towards = |q: [f32; 3]| [0, 1, 2].map(|k| q[k] - start[k]);
            let axis = |k: usize, s: f32| {
                let mut d = [if i & 8 == 0 { 0.0 } else { -0.0 }; 3];
                d[k] = s;
                d
            };
            let sign = if i & 16 == 0 { 1.0 } else { -1.0 };
            let (origin, direction) = match i % 8 {
                0 => (start, point(r, i, 2)),
                1 => (start, towards(corners[c])), // through a corner
                2 => (start, towards(on([a, 1.0 - a, 0.0]))), // through an edge
                3 => (start, towards(on([a * b, a * (1.0 - b), 1.0 - a]))), // through a triangle
                4 => (
                    [0, 1, 2].map(|k| if k == c { -3.0 * sign * size } else { corners[i / 8 % 3][k] }),
                    axis(c, sign),
                ),
                5 => (corners[c], [0, 1, 2].map(|k| corners[(c + 1) % 3][k] - corners[c][k])), // along an edge
                6 => (start, [point(r, i, 3)[0], point(r, i, 3)[1], 0.0]), // in a plane of an axis
                _ => (on([a * b, a * (1.0 - b), 1.0 - a]), point(r, i, 4)), // from the surface
            };
            let t_max = if i % 5 == 4 { a * 2.0 } else { f32::INFINITY };
            Ray { origin, direction, t_max }
        })
        .collect()
}

fn same(a: Hit, b: Hit) -> bool {
    let bits = |h: Hit| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.triangle];
    bits(a) == bits(b)
}

/// Compares all queries with brute force and returns the number of rays that hit.
fn hold(name: &str, p: &[[f32; 3]], t: &[[u32; 3]], rays: &[Ray]) -> usize {
    let (bvh, brute) = (Bvh::build(p, t), Brute::new(p, t));
    let mut hits = vec![Hit::NONE; rays.len()];
    let mut any = vec![false; rays.len()];
    bvh.closest_batch(rays, &mut hits);
    bvh.occluded_batch(rays, &mut any);
    let mut met = 0;
    for (i, ray) in rays.iter().enumerate() {
        let (wanted, accepted) = brute.closest(ray);
        let got = bvh.closest(ray);
        assert!(same(got, wanted), "{name}, ray {i} {ray:?}: got {got:?}, brute force {wanted:?}");
        assert!(
            same(hits[i], wanted),
            "{name}, ray {i} {ray:?} in a batch: got {:?}, brute force {wanted:?}",
            hits[i]
        );
        assert_eq!(bvh.occluded(ray), accepted > 0, "{name}, ray {i} {ray:?}: occlusion");
        assert_eq!(any[i], accepted > 0, "{name}, ray {i} {ray:?}: occlusion in a batch");
        assert!(
            wanted.t >= 0.0 && (wanted.t <= ray.t_max || wanted.triangle == MISS),
            "{name}, ray {i} {ray:?}: {wanted:?} is outside the interval"
        );
        met += usize::from(accepted > 0);
    }
    met
}

#[test]
fn queries_are_brute_force_on_a_closed_mesh() {
    let r = Rng::new(1);
    let (p, t) = sphere(40, 20);
    let rays = rays(&r, &p, &t, 8_000);
    let met = hold("sphere", &p, &t, &rays);
    assert!(met > 5_000, "most of these rays must hit, got {met}");
}

#[test]
fn queries_are_brute_force_at_any_scale_and_place() {
    let r = Rng::new(2);
    let (unit, t) = sphere(12, 8);
    for scale in [1e-38_f32, 1e-30, 1e-12, 1e-6, 1.0, 1e6, 1e12, 1e30, 1e38] {
        let p: Vec<_> = unit.iter().map(|p| p.map(|x| x * scale)).collect();
        let mut rays = rays(&r, &p, &t, 1_600);
        rays.iter_mut().for_each(|ray| {
            // Origins and directions beyond the range of f32 are not valid rays.
            ray.origin = ray.origin.map(|x| crate::num::order::clamp(x, -f32::MAX, f32::MAX));
            ray.direction = ray.direction.map(|x| crate::num::order::clamp(x, -f32::MAX, f32::MAX));
        });
        rays.retain(|ray| ray.direction.iter().any(|d| *d != 0.0));
        let met = hold(&format!("scale {scale:e}"), &p, &t, &rays);
        assert!(3 * met > rays.len(), "scale {scale:e}: {met} of {}", rays.len());
    }
    for far in [10.0_f32, 1e3, 1e5] {
        let p: Vec<_> = unit.iter().map(|p| [p[0] + far, p[1] - 2.0 * far, p[2] + 0.5 * far]).collect();
        let mut rays = rays(&r, &p, &t, 800);
        let near = rays.clone();
        rays.extend(near.iter().enumerate().map(|(i, ray)| {
            let c = p[i % p.len()];
            let d = point(&r, i, 9);
            Ray { origin: [0, 1, 2].map(|k| c[k] - 3.0 * d[k]), direction: d, ..*ray }
        }));
        hold(&format!("at {far}"), &p, &t, &rays);
    }
}

#[test]
fn queries_are_brute_force_on_heaps_slivers_and_copies() {
    let r = Rng::new(3);
    for (name, squeeze) in [("heap", 1.0_f32), ("needles", 1e-4), ("slivers", 1e-7)] {
        let p: Vec<[f32; 3]> = (0..300)
            .map(|i| {
                let (c, d) = (point(&r, i / 3, 5), point(&r, i, 6));
                let s = if i % 3 == 2 { squeeze } else { 1.0 };
                [0, 1, 2].map(|k| c[k] + 0.5 * s * d[k])
            })
            .collect();
        let mut t: Vec<[u32; 3]> = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        // The mesh contains copies, some with reversed orientation: t is equal, so the lowest index wins.
        for i in 0..100_u32 {
            t.push([[3 * i, 3 * i + 1, 3 * i + 2], [3 * i + 2, 3 * i + 1, 3 * i]][(i % 2) as usize]);
        }
        hold(name, &p, &t, &rays(&r, &p, &t, 4_000));
    }
    // There are more equal triangles than a leaf can contain.
    let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let t = [[0, 1, 2]; 50];
    let ray = Ray { origin: [0.2, 0.2, 1.0], direction: [0.0, -0.0, -1.0], t_max: f32::INFINITY };
    hold("copies", &p, &t, &[ray]);
    assert_eq!(Bvh::build(&p, &t).closest(&ray).triangle, 0, "the lowest index of equal triangles wins");
}

#[test]
fn rays_side_by_side_are_brute_force() {
    let r = Rng::new(6);
    for (name, (p, t)) in [("coarse", sphere(10, 6)), ("fine", sphere(60, 30))] {
        let base = rays(&r, &p, &t, 160);
        // Runs of 1 to 40 rays, nearer and further apart than a group allows, with equal and different
        // origins, some of length 0.
        let mut side = vec![];
        for (i, ray) in base.iter().enumerate() {
            let apart = [0.0, 1e-6, 1e-3, 0.02, 0.2][i % 5];
            for j in 0..1 + i % 40 {
                let (d, o) = (point(&r, 64 * i + j, 10), point(&r, 64 * i + j, 11));
                let shift = if i % 2 == 0 { apart } else { 0.0 };
                let mut next = *ray;
                for k in 0..3 {
                    next.direction[k] += apart * d[k];
                    next.origin[k] += shift * o[k];
                }
                next.t_max = if j % 11 == 10 { [0.0, -1.0, 0.5, f32::MAX][i % 4] } else { ray.t_max };
                side.push(next);
            }
        }
        let met = hold(name, &p, &t, &side);
        assert!(3 * met > side.len(), "{name}: {met} of {}", side.len());
    }
}

#[test]
fn a_grid_seen_along_its_lines() {
    // Every vertex, edge and diagonal of a flat grid, hit perpendicularly: coordinates are exact, so U, V, W
    // are 0.
    let n = 9_usize;
    let p: Vec<[f32; 3]> = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.25]).collect();
    let at = |x: usize, y: usize| (y * n + x) as u32;
    let mut t = vec![];
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            t.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            t.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    let mut rays = vec![];
    for i in 0..=4 * (n - 1) {
        for j in 0..=4 * (n - 1) {
            let (x, y) = (0.25 * i as f32, 0.25 * j as f32);
            for (z, d) in [(2.0, -1.0), (-2.0, 1.0), (0.25, 1.0)] {
                for zero in [0.0, -0.0] {
                    rays.push(Ray { origin: [x, y, z], direction: [zero, -zero, d], t_max: 2.25 });
                }
            }
            // In the plane of the grid, a ray is parallel to all triangles and hits none.
            rays.push(Ray { origin: [-1.0, y, 0.25], direction: [1.0, 0.0, 0.0], t_max: f32::INFINITY });
        }
    }
    let met = hold("grid", &p, &t, &rays);
    assert_eq!(met, rays.len() / 7 * 6, "every ray hits except those in the plane");
}

#[test]
fn nothing_leaks_out_of_a_closed_mesh() {
    let r = Rng::new(4);
    let (p, t) = sphere(200, 100);
    let bvh = Bvh::build(&p, &t);
    let n = 600_000;
    let rays: Vec<Ray> = (0..n)
        .map(|i| {
            let inside = point(&r, i, 7).map(|x| 0.5 * x);
            let corner = p[i * 104_729 % p.len()];
            let other = t[i % t.len()].map(|c| p[c as usize]);
            let goal = match i % 3 {
                0 => corner,
                1 => [0, 1, 2].map(|k| 0.5 * (other[0][k] + other[1][k])),
                _ => point(&r, i, 8),
            };
            let mut direction = [0, 1, 2].map(|k| goal[k] - inside[k]);
            if i % 16 == 5 {
                direction =
                    [[0.0, 0.0, 1.0], [0.0, -0.0, -1.0], [1.0, -0.0, 0.0], [0.0, 1.0, 0.0]][i / 16 % 4];
            }
            let origin = if i % 16 == 5 { [0.0, 0.0, 0.5 * inside[2]] } else { inside };
            Ray { origin, direction, t_max: f32::INFINITY }
        })
        .collect();
    let mut hits = vec![Hit::NONE; n];
    bvh.closest_batch(&rays, &mut hits);
    let leak = hits.iter().position(|h| h.triangle == MISS);
    assert_eq!(leak.map(|i| rays[i]), None, "no ray from inside passes through a seam");
    let mut any = vec![false; n];
    bvh.occluded_batch(&rays, &mut any);
    assert!(any.iter().all(|a| *a), "occlusion agrees");
}

#[test]
fn what_is_not_a_ray_or_not_a_triangle_hits_nothing() {
    let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [f32::MIN_POSITIVE; 3]];
    let ray = |direction: [f32; 3], t_max: f32| Ray { origin: [0.25, 0.25, 1.0], direction, t_max };
    let down = ray([0.0, 0.0, -1.0], f32::INFINITY);
    let one = Bvh::build(&p, &[[0, 1, 2]]);
    assert_eq!(one.closest(&down), Hit { t: 1.0, u: 0.25, v: 0.25, triangle: 0 }, "a single triangle");
    for bad in [
        ray([0.0; 3], 1.0),
        ray([0.0, -0.0, 0.0], f32::INFINITY),
        ray([0.0, 0.0, -1.0], 0.5),
        ray([0.0, 0.0, -1.0], -1.0),
        Ray { origin: [0.25, 0.25, 1e30], ..down },
    ] {
        assert_eq!(one.closest(&bad), Hit::NONE, "{bad:?}");
        assert!(!one.occluded(&bad), "{bad:?}");
    }
    assert_eq!(one.closest(&ray([0.0, 0.0, -1.0], 1.0)).t, 1.0, "t_max is included");
    assert_eq!(one.closest(&Ray { origin: [0.25, 0.25, 0.0], ..down }).t, 0.0, "t = 0 is included");
    // Triangles without area: a point, a repeated edge, three collinear corners.
    let none = Bvh::build(&p, &[[0, 0, 0], [0, 1, 1], [0, 1, 3], [1, 0, 1]]);
    hold("no area", &p, &[[0, 0, 0], [0, 1, 1], [0, 1, 3], [1, 0, 1]], &[down]);
    assert_eq!(none.closest(&Ray { origin: [0.5, 0.0, 1.0], ..down }), Hit::NONE, "no area");
    assert_eq!(Bvh::build(&[], &[]).closest(&down), Hit::NONE, "no triangles");
    let mut hits = [];
    one.closest_batch(&[], &mut hits);
    // The length of the direction only scales t.
    for e in [-120, -60, -3, 1, 50, 120] {
        let s = f32::from_bits(((e + 127) as u32) << 23);
        let hit = one.closest(&ray([0.0, 0.0, -s], f32::INFINITY));
        assert_eq!((hit.t, hit.triangle), (1.0 / s, 0), "direction 2^{e}");
    }
}

/// Triangles that a tree is built from in other ways than usual: copies, rotated copies, one centre, one box,
/// and a row of equal boxes.
fn crowds(n: usize) -> Vec<(&'static str, Vec<[[f32; 3]; 3]>)> {
    let r = Rng::new(9);
    let unit = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
    let of = |f: &dyn Fn(usize) -> [[f32; 3]; 3]| (0..n).map(f).collect();
    let turned = |i: usize| [0, 1, 2].map(|k| unit[(k + i) % 3]);
    let centred = |i: usize| {
        let s = 1.0 + (i % 97) as f32;
        [[-s, -s, 0.0], [s, -s, 0.0], [0.0, s, 0.0]]
    };
    let boxed = |i: usize| {
        let [x, y, _] = point(&r, i, 0).map(|x| 0.5 + 0.4 * x);
        [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [x, y, 0.3]]
    };
    let row = |i: usize| [[i as f32, 0.0, 0.0], [i as f32 + 1.0, 0.0, 0.0], [i as f32, 1.0, 0.0]];
    vec![
        ("copies", of(&|_| unit)),
        ("turned copies", of(&turned)),
        ("one centre", of(&centred)),
        ("one box", of(&boxed)),
        ("a row", of(&row)),
    ]
}

#[test]
fn queries_are_brute_force_on_crowds() {
    let r = Rng::new(10);
    for (name, triangles) in crowds(300) {
        // A second crowd elsewhere and a few triangles of their own are in the same tree.
        let moved = triangles.iter().map(|t| t.map(|p| [p[0] + 4.0, p[1], p[2] - 1.0]));
        let others = (0..20).map(|i| [0, 1, 2].map(|k| point(&r, i, k)));
        let all: Vec<_> = triangles.iter().copied().chain(others).chain(moved).collect();
        let t: Vec<[u32; 3]> = (0..all.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let p = all.concat();
        let rays = rays(&r, &p, &t, 1_600);
        let met = hold(name, &p, &t, &rays);
        assert!(met > 400, "{name}: many of these rays must hit, got {met}");
    }
}
