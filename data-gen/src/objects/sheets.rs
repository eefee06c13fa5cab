//! Sheets from which many shapes are made: the surface of a ball in six squares, bodies of revolution, tubes.

use super::soup::Soup;
use crate::space::{V3, add, larger, length, scaled, smaller, sub, unit};
use reference::num::elem::{cos, sin};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Tangent of half the angle between neighbours on a cube's edge, so that the cells of a ball are of similar
/// size.
fn spread(k: i32, n: i32) -> f64 {
    let angle = std::f64::consts::FRAC_PI_4 * f64::from(k) / f64::from(n);
    sin(angle) / cos(angle)
}

/// A ball in six sheets of n × n cells: `place` maps a unit direction to its point and must be continuous.
/// The charts are rectangles whose cells have the mean length of the sheet's middle lines.
pub(crate) fn ball(n: usize, place: impl Fn(V3) -> V3) -> Soup {
    let half = n as i32;
    let mut soup = Soup::default();
    let squares = cube(&mut soup, n, |k| place(unit(k.map(|k| spread(k, half)))));
    for Square { index, .. } in squares {
        let at = |i: usize, j: usize| soup.points[index[j * (n + 1) + i] as usize];
        let (mut across, mut up) = (0.0, 0.0);
        for k in 0..n {
            across += length(sub(at(k + 1, n / 2), at(k, n / 2)));
            up += length(sub(at(n / 2, k + 1), at(n / 2, k)));
        }
        let step = [larger(across, 0.02 * up) / n as f64, larger(up, 0.02 * across) / n as f64];
        let st = |i: usize, j: usize| [step[0] * i as f64, step[1] * j as f64];
        soup.grid(n, n, |i, j| index[j * (n + 1) + i], st);
    }
    soup
}

/// A box of given half sides around the origin, with edges rounded by `round` times the smallest of them: `m`
/// cells over each rounding and `f` over the flat part of every side. Charts have true lengths.
pub(crate) fn rounded_box(half: V3, round: f64, m: usize, f: usize) -> Soup {
    let r = round * smaller(smaller(half[0], half[1]), half[2]);
    let n = 2 * m + f;
    // Position on the unrounded side and arc length of lattice coordinate k (−n..n in steps of 2).
    let along = |axis: usize, k: i32| -> [f64; 2] {
        let flat = half[axis] - r;
        let i = ((k + n as i32) / 2) as usize;
        let bend = |cells: usize| {
            let angle = std::f64::consts::FRAC_PI_4 * cells as f64 / m as f64;
            [flat + r * sin(angle) / cos(angle), flat + r * angle]
        };
        if i < m {
            bend(m - i).map(|x| -x)
        } else if i > m + f {
            bend(i - m - f)
        } else {
            [flat * (2.0 * (i - m) as f64 / f as f64 - 1.0); 2]
        }
    };
    let mut soup = Soup::default();
    let squares = cube(&mut soup, n, |k| {
        // The corner of the lattice is exactly the corner of the box on all three of its sides.
        let on: V3 = std::array::from_fn(|a| {
            if k[a].unsigned_abs() as usize == n {
                half[a] * f64::from(k[a].signum())
            } else {
                along(a, k[a])[0]
            }
        });
        let inner: V3 = std::array::from_fn(|a| crate::space::clamp(on[a], r - half[a], half[a] - r));
        add(inner, scaled(unit(sub(on, inner)), r))
    });
    for Square { index, axes: [u, v], flip } in squares {
        let at = |i: usize| 2 * i as i32 - n as i32;
        let st = |i: usize, j: usize| [f64::from(flip) * along(u, flip * at(i))[1], along(v, at(j))[1]];
        soup.grid(n, n, |i, j| index[j * (n + 1) + i], st);
    }
    soup
}

/// A side of a cube: points of its lattice, i to the right and j upwards seen from outside; the axes along
/// which they run, the first one backwards if `flip` is −1.
struct Square {
    index: Vec<u32>,
    axes: [usize; 2],
    flip: i32,
}

/// Points of the surface of the cube lattice −n..n (steps of 2), one per position, shared by the sides.
fn cube(soup: &mut Soup, n: usize, place: impl Fn([i32; 3]) -> V3) -> Vec<Square> {
    let half = n as i32;
    let mut known: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut squares = Vec::new();
    for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
        // Right-handed seen from outside: u × v points along side·axis; v is z on the four upright sides.
        let (u, v, flip) = match (axis, side) {
            (0, _) => (1, 2, side),
            (1, _) => (0, 2, -side),
            (_, 1) => (0, 1, 1),
            _ => (1, 0, 1),
        };
        let columns = n + 1;
        let mut index = vec![0_u32; columns * columns];
        for j in 0..=n {
            for i in 0..=n {
                let mut k = [0_i32; 3];
                k[axis] = side * half;
                k[u] = flip * (2 * i as i32 - half);
                k[v] = 2 * j as i32 - half;
                index[j * columns + i] = *known.entry(k).or_insert_with(|| soup.point(place(k)));
            }
        }
        squares.push(Square { index, axes: [u, v], flip });
    }
    squares
}

/// One smooth run of a profile: points (r, z) from bottom to top along the outside, at least two.
pub(crate) type Run = Vec<[f64; 2]>;

/// A body of revolution about z with `nu` columns. Runs follow one another end to start, with creases between
/// them; the first starts and the last ends on the axis (r = 0). `radius` scales r at an angle and height (1
/// for a round body).
pub(crate) fn lathe(nu: usize, runs: &[Run], radius: impl Fn(f64, f64) -> f64) -> Soup {
    let mut soup = Soup::default();
    let angle = |i: usize| TAU * i as f64 / nu as f64;
    let row = |soup: &mut Soup, [r, z]: [f64; 2]| -> Vec<u32> {
        if r <= 0.0 {
            let p = soup.point([0.0, 0.0, z]);
            return vec![p; nu + 1];
        }
        let mut row: Vec<u32> = (0..nu)
            .map(|i| {
                let a = angle(i);
                let r = r * radius(a, z);
                soup.point([r * cos(a), r * sin(a), z])
            })
            .collect();
        row.push(row[0]);
        row
    };
    let mut last = row(&mut soup, runs[0][0]);
    // Rows of the chart under construction, their arc length, and ∫ r along it.
    let mut open: (Vec<Vec<u32>>, Vec<f64>, f64) = (vec![last.clone()], vec![0.0], 0.0);
    for run in runs {
        let mut rows = vec![last.clone()];
        for &p in &run[1..] {
            rows.push(row(&mut soup, p));
        }
        last = rows[rows.len() - 1].clone();
        let nv = run.len() - 1;
        let mut along = vec![0.0];
        let mut area = 0.0;
        for w in run.windows(2) {
            let (dr, dz) = (w[1][0] - w[0][0], w[1][1] - w[0][1]);
            let step = (dr * dr + dz * dz).sqrt();
            area += 0.5 * step * (w[0][0] + w[1][0]);
            along.push(along[along.len() - 1] + step);
        }
        let total = along[nv];
        let (from_axis, to_axis) = (run[0][0] <= 0.0, run[nv][0] <= 0.0);
        if (from_axis || to_axis) && (run[nv][1] - run[0][1]).abs() < 0.5 * total {
            // A disc has a round chart. Seen from below, angles run clockwise.
            band(&mut soup, nu, std::mem::take(&mut open));
            let rho = |j: usize| if from_axis { -along[j] } else { total - along[j] };
            let st = |i: usize, j: usize| [rho(j).abs() * cos(angle(i)), rho(j) * sin(angle(i))];
            soup.sheet([0, nu], [0, nv], &|i, j| rows[j][i], &st);
            open = (vec![last.clone()], vec![0.0], 0.0);
        } else {
            let first = open.1[open.1.len() - 1];
            open.0.extend_from_slice(&rows[1..]);
            open.1.extend(along[1..].iter().map(|x| first + x));
            open.2 += area;
        }
    }
    band(&mut soup, nu, open);
    soup
}

/// The chart of a band of a body of revolution: around by its mean radius, upwards by arc length.
fn band(soup: &mut Soup, nu: usize, (rows, along, area): (Vec<Vec<u32>>, Vec<f64>, f64)) {
    if rows.len() > 1 {
        let step = TAU * (area / along[along.len() - 1]) / nu as f64;
        soup.grid(nu, rows.len() - 1, |i, j| rows[j][i], |i, j| [step * i as f64, along[j]]);
    }
}

/// Points of a smooth curve through (r, z) points (Catmull–Rom), `n` steps between neighbours; r is at least
/// `least`, except at ends given on the axis.
pub(crate) fn smooth_run(through: &[[f64; 2]], n: usize, least: f64) -> Run {
    let m = through.len();
    let at = |i: isize| through[i.clamp(0, m as isize - 1) as usize];
    let mut run = vec![through[0]];
    for k in 0..m as isize - 1 {
        let [a, b, c, d] = [at(k - 1), at(k), at(k + 1), at(k + 2)];
        for step in 1..=n {
            let t = step as f64 / n as f64;
            let p = [0, 1].map(|q| {
                let (m0, m1) = (0.5 * (c[q] - a[q]), 0.5 * (d[q] - b[q]));
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * b[q]
                    + (t3 - 2.0 * t2 + t) * m0
                    + (3.0 * t2 - 2.0 * t3) * c[q]
                    + (t3 - t2) * m1
            });
            run.push([if step == n { p[0] } else { larger(p[0], least) }, p[1]]);
        }
    }
    // The ends are exact, because rows of neighbouring runs share them.
    run[n * (m - 1)] = through[m - 1];
    run
}

/// A straight run of n steps.
pub(crate) fn straight_run(from: [f64; 2], to: [f64; 2], n: usize) -> Run {
    (0..=n).map(|k| if k == n { to } else { crate::space::mix(from, to, k as f64 / n as f64) }).collect()
}

/// A tube along points with frames (normal, binormal = tangent × normal), and a cross-section: `section(i,
/// j)` gives the offsets along the two, counter-clockwise in j seen against the tangent. Open tubes are
/// closed by flat fans; a closed one joins section j of its last point to section j + `shift` of its first.
pub(crate) fn tube(
    places: &[(V3, V3, V3)],
    nv: usize,
    closed: Option<usize>,
    section: impl Fn(usize, usize) -> [f64; 2],
) -> Soup {
    let mut soup = Soup::default();
    let n = places.len();
    let mut rings: Vec<Vec<u32>> = Vec::with_capacity(n + 1);
    for (i, &(center, normal, binormal)) in places.iter().enumerate() {
        // Clockwise, so that j is upwards when i is to the right seen from outside.
        let ring = (0..nv).map(|j| {
            let [a, b] = section(i, (nv - j) % nv);
            let p = add(center, add(scaled(normal, a), scaled(binormal, b)));
            soup.points.push(p);
            (soup.points.len() - 1) as u32
        });
        rings.push(ring.collect());
    }
    if let Some(shift) = closed {
        rings.push((0..nv).map(|j| rings[0][(j + shift) % nv]).collect());
    }
    let nu = rings.len() - 1;
    let at = |soup: &Soup, i: usize, j: usize| soup.points[rings[i][j % nv] as usize];
    let mut along = vec![0.0];
    let mut around = 0.0;
    for i in 0..nu {
        let (mut step, mut girth) = (0.0, 0.0);
        for j in 0..nv {
            step += length(sub(at(&soup, i + 1, j), at(&soup, i, j)));
            girth += length(sub(at(&soup, i, j + 1), at(&soup, i, j)));
        }
        along.push(along[i] + step / nv as f64);
        around += girth / nu as f64;
    }
    let per = around / nv as f64;
    soup.grid(nu, nv, |i, j| rings[i][j % nv], |i, j| [along[i], per * j as f64]);
    if closed.is_none() {
        for (end, i) in [(0, 0), (1, nu)] {
            let (center, normal, binormal) = places[i];
            let rim: Vec<(u32, [f64; 2])> = (0..nv)
                .map(|j| {
                    let k = if end == 0 { j } else { (nv - j) % nv };
                    let [a, b] = section(i, (nv - k) % nv);
                    (rings[i][k], if end == 0 { [b, a] } else { [a, b] })
                })
                .collect();
            let hub = rim.iter().fold([0.0; 2], |s, r| [s[0] + r.1[0], s[1] + r.1[1]]).map(|x| x / nv as f64);
            let [a, b] = if end == 0 { [hub[1], hub[0]] } else { hub };
            soup.fan(add(center, add(scaled(normal, a), scaled(binormal, b))), hub, &rim);
        }
    }
    soup
}

/// Frames along an open curve with minimal rotation (double reflection, Wang et al. 2008).
pub(crate) fn frames(curve: &[V3]) -> Vec<(V3, V3, V3)> {
    use crate::space::{cross, dot};
    let n = curve.len();
    let tangent = |i: usize| {
        let (a, b) = (i.saturating_sub(1), if i + 1 < n { i + 1 } else { i });
        unit(sub(curve[b], curve[a]))
    };
    let first = tangent(0);
    let helper = if first[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let mut normal = unit(cross(cross(first, helper), first));
    let mut out = vec![(curve[0], normal, cross(first, normal))];
    for i in 1..n {
        let (t0, t1) = (tangent(i - 1), tangent(i));
        let v1 = sub(curve[i], curve[i - 1]);
        let c1 = dot(v1, v1);
        let reflect = |x: V3, v: V3, c: f64| if c > 0.0 { sub(x, scaled(v, 2.0 * dot(v, x) / c)) } else { x };
        let (r, t) = (reflect(normal, v1, c1), reflect(t0, v1, c1));
        let v2 = sub(t1, t);
        normal = unit(reflect(r, v2, dot(v2, v2)));
        // Made orthogonal to the tangent again, to prevent drift.
        normal = unit(sub(normal, scaled(t1, dot(normal, t1))));
        out.push((curve[i], normal, cross(t1, normal)));
    }
    out
}
