//! Flat shapes with holes: triangulated with every corner of their outline, and extruded with bevelled edges.

use super::soup::Soup;
use crate::space::larger;

type P2 = [f64; 2];

fn area2(a: P2, b: P2, c: P2) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn distance2(a: P2, b: P2) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

/// Twice the signed area.
fn signed_area2(contour: &[P2]) -> f64 {
    (0..contour.len()).fold(0.0, |s, i| {
        let (a, b) = (contour[i], contour[(i + 1) % contour.len()]);
        s + (a[0] * b[1] - a[1] * b[0])
    })
}

/// The first contour counter-clockwise, the holes clockwise.
fn oriented(contours: &[Vec<P2>]) -> Vec<Vec<P2>> {
    let turn = |(k, c): (usize, &Vec<P2>)| {
        let mut c = c.clone();
        if (signed_area2(&c) > 0.0) != (k == 0) {
            c.reverse();
        }
        c
    };
    contours.iter().enumerate().map(turn).collect()
}

/// The contour moved to its left by `by`: corners move along their bisector, at most twice as far.
fn inset(contour: &[P2], by: f64) -> Vec<P2> {
    let n = contour.len();
    let left = |a: P2, b: P2| {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let l = (dx * dx + dy * dy).sqrt();
        [-dy / l, dx / l]
    };
    (0..n)
        .map(|i| {
            let (a, b, c) = (contour[(i + n - 1) % n], contour[i], contour[(i + 1) % n]);
            let (p, q) = (left(a, b), left(b, c));
            let sum = [p[0] + q[0], p[1] + q[1]];
            // |sum|² = 2 + 2 cos: the bisector has length 1/cos(half) when sum is scaled by 2/|sum|².
            let scale = 2.0 / larger(sum[0] * sum[0] + sum[1] * sum[1], 1.0);
            [b[0] + by * scale * sum[0], b[1] + by * scale * sum[1]]
        })
        .collect()
}

/// Whether the open segments a–b and c–d cross or touch, other than in a common end.
fn cross(a: P2, b: P2, c: P2, d: P2) -> bool {
    let (o1, o2) = (area2(a, b, c), area2(a, b, d));
    let (o3, o4) = (area2(c, d, a), area2(c, d, b));
    ((o1 > 0.0 && o2 < 0.0) || (o1 < 0.0 && o2 > 0.0)) && ((o3 > 0.0 && o4 < 0.0) || (o3 < 0.0 && o4 > 0.0))
}

/// Triangles of an outer contour (counter-clockwise) with holes (clockwise), as indices into the concatenated
/// contours. Every edge of the contours is the edge of one triangle; no triangle is degenerate.
pub(crate) fn triangulate(contours: &[Vec<P2>]) -> Vec<[u32; 3]> {
    let points: Vec<P2> = contours.concat();
    let mut loops: Vec<Vec<u32>> = Vec::new();
    let mut first = 0_u32;
    for c in contours {
        loops.push((first..first + c.len() as u32).collect());
        first += c.len() as u32;
    }
    let at = |i: u32| points[i as usize];
    let edges: Vec<(u32, u32)> =
        loops.iter().flat_map(|l| (0..l.len()).map(|i| (l[i], l[(i + 1) % l.len()]))).collect();
    // Holes are connected to the outer contour, one after another, by the shortest bridge that crosses no
    // edge.
    let mut outside = loops[0].clone();
    let mut bridges: Vec<(u32, u32)> = Vec::new();
    for hole in &loops[1..] {
        let mut best: Option<(f64, usize, usize)> = None;
        for (i, &a) in outside.iter().enumerate() {
            for (j, &b) in hole.iter().enumerate() {
                let d = distance2(at(a), at(b));
                let is_free = |&(p, q): &(u32, u32)| {
                    p == a || q == a || p == b || q == b || !cross(at(a), at(b), at(p), at(q))
                };
                // A corner with a bridge occurs twice in the loop, in different sectors; such corners are not
                // used again.
                let is_taken = bridges.iter().any(|&(p, q)| p == a || q == a);
                if !is_taken && best.is_none_or(|x| d < x.0) && edges.iter().chain(&bridges).all(is_free) {
                    best = Some((d, i, j));
                }
            }
        }
        let (_, i, j) = best.expect("a hole can be connected to a corner of the outline around it");
        bridges.push((outside[i], hole[j]));
        let around = hole[j..].iter().chain(&hole[..=j]).copied();
        let joined: Vec<u32> =
            outside[..=i].iter().copied().chain(around).chain(outside[i..].iter().copied()).collect();
        outside = joined;
    }
    clip(&points, outside)
}

/// Ear clipping, best-shaped ears first.
fn clip(points: &[P2], mut rest: Vec<u32>) -> Vec<[u32; 3]> {
    let at = |i: u32| points[i as usize];
    let quality = |rest: &[u32], k: usize| -> f64 {
        let n = rest.len();
        let [a, b, c] = [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]];
        let (pa, pb, pc) = (at(a), at(b), at(c));
        let area = area2(pa, pb, pc);
        let longest = larger(larger(distance2(pa, pb), distance2(pb, pc)), distance2(pc, pa));
        let shape = area / longest;
        if !(shape > 1e-6) {
            return -1.0;
        }
        let blocks = |i: usize| {
            let p = rest[i];
            let q = rest[(i + 1) % n];
            let is_corner = p == a || p == b || p == c;
            let inside = !is_corner
                && area2(pa, pb, at(p)) >= 0.0
                && area2(pb, pc, at(p)) >= 0.0
                && area2(pc, pa, at(p)) >= 0.0;
            let touches = p == a || q == a || p == c || q == c;
            inside || (!touches && cross(pa, pc, at(p), at(q)))
        };
        if (0..n).any(blocks) { -1.0 } else { shape }
    };
    let mut out = Vec::new();
    let mut score: Vec<f64> = (0..rest.len()).map(|k| quality(&rest, k)).collect();
    while rest.len() > 3 {
        let best = |score: &[f64]| {
            (0..score.len()).fold((0, -1.0), |b, k| if score[k] > b.1 { (k, score[k]) } else { b })
        };
        let (mut k, mut s) = best(&score);
        if s < 0.0 {
            score = (0..rest.len()).map(|k| quality(&rest, k)).collect();
            (k, s) = best(&score);
            assert!(s >= 0.0, "an outline without self-intersections must have an ear");
        }
        let n = rest.len();
        out.push([rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]]);
        rest.remove(k);
        score.remove(k);
        let n = rest.len();
        for near in [(k + n - 1) % n, k % n] {
            score[near] = quality(&rest, near);
        }
    }
    out.push([rest[0], rest[1], rest[2]]);
    out
}

/// A slab between z = 0 and `depth` over a shape, with edges bevelled at 45° by `bevel` (0: sharp).
pub(crate) fn extrude(contours: &[Vec<P2>], depth: f64, bevel: f64, rows: usize) -> Soup {
    let outer = oriented(contours);
    let inner: Vec<Vec<P2>> = outer.iter().map(|c| inset(c, bevel)).collect();
    let mut heights: Vec<(bool, f64)> = Vec::new();
    if bevel > 0.0 {
        heights.push((true, 0.0));
    }
    for k in 0..=rows {
        heights.push((false, bevel + (depth - 2.0 * bevel) * k as f64 / rows as f64));
    }
    if bevel > 0.0 {
        heights.push((true, depth));
    }
    let mut soup = Soup::default();
    let (mut back, mut front): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::new());
    for (wide, narrow) in outer.iter().zip(&inner) {
        let n = wide.len();
        let rings: Vec<Vec<u32>> = heights
            .iter()
            .map(|&(is_inner, z)| {
                let ring = if is_inner { narrow } else { wide };
                ring.iter().map(|p| soup.point([p[0], p[1], z])).collect()
            })
            .collect();
        let mut along = vec![0.0];
        for i in 0..n {
            along.push(along[i] + distance2(wide[i], wide[(i + 1) % n]).sqrt());
        }
        let mut up = vec![0.0];
        for w in heights.windows(2) {
            let slope = if w[0].0 == w[1].0 { 1.0 } else { std::f64::consts::SQRT_2 };
            up.push(up[up.len() - 1] + slope * (w[1].1 - w[0].1));
        }
        soup.grid(n, heights.len() - 1, |i, j| rings[j][i % n], |i, j| [along[i], up[j]]);
        back.extend(&rings[0]);
        front.extend(&rings[rings.len() - 1]);
    }
    let faces = triangulate(if bevel > 0.0 { &inner } else { &outer });
    for (points, side) in [(front, 1.0), (back, -1.0)] {
        let chart = soup.chart();
        let vertices: Vec<u32> = points
            .iter()
            .map(|&p| {
                let [x, y, _] = soup.points[p as usize];
                soup.vertex(p, chart, [side * x, y])
            })
            .collect();
        soup.triangles.extend(faces.iter().map(|&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|i| vertices[i as usize]);
            if side > 0.0 { [a, b, c] } else { [a, c, b] }
        }));
    }
    soup
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objects::glyphs;

    #[test]
    fn every_glyph_is_triangulated_without_flat_triangles() {
        for index in 0..glyphs::COUNT {
            for (steps, bevel) in [(3, 0.0), (6, 0.01), (10, 0.03)] {
                let contours = oriented(&glyphs::outline(index, steps));
                let inner: Vec<Vec<P2>> = contours.iter().map(|c| inset(c, bevel)).collect();
                let points = inner.concat();
                let triangles = triangulate(&inner);
                let want = inner.iter().fold(0.0, |s, c| s + signed_area2(c));
                let areas: Vec<f64> = triangles
                    .iter()
                    .map(|t| area2(points[t[0] as usize], points[t[1] as usize], points[t[2] as usize]))
                    .collect();
                assert!(
                    areas.iter().all(|&a| a > 1e-7),
                    "glyph {index}: degenerate triangle at bevel {bevel}"
                );
                let got = areas.iter().fold(0.0, |s, a| s + a);
                assert!((got - want).abs() < 1e-12, "glyph {index}: area {got} instead of {want}");
                assert_eq!(
                    triangles.len(),
                    points.len() + 2 * (contours.len() - 1) - 2,
                    "glyph {index}: Euler's count"
                );
            }
        }
    }
}
