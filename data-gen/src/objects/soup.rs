//! A closed mesh under construction: points shared by triangles, charts, and quantities derived from both.
//!
//! A **point** is a position; a **vertex** is a point on a chart, with its coordinates (s, t) there in
//! lengths of the object, s to the right and t upwards seen from outside. A seam consists of two vertices on
//! one point, so closedness follows from indices, and positions are never compared.

use crate::space::{V3, add, cross, dot, length, rotated, scaled, sub, unit};

/// A point on a chart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    pub(crate) point: u32,
    pub(crate) chart: u32,
    pub(crate) st: [f64; 2],
}

/// A mesh under construction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Soup {
    pub(crate) points: Vec<V3>,
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) charts: u32,
}

/// Largest ratio of the sides of a chart before it is cut.
const ASPECT: f64 = 3.0;

impl Soup {
    pub(crate) fn point(&mut self, p: V3) -> u32 {
        self.points.push(p);
        (self.points.len() - 1) as u32
    }

    pub(crate) fn chart(&mut self) -> u32 {
        self.charts += 1;
        self.charts - 1
    }

    pub(crate) fn vertex(&mut self, point: u32, chart: u32, st: [f64; 2]) -> u32 {
        self.vertices.push(Vertex { point, chart, st });
        (self.vertices.len() - 1) as u32
    }

    /// A sheet of `nu` × `nv` cells: `point` returns the point of a corner, `st` its position on the chart.
    /// Seen from outside, i increases to the right and j upwards. Cells with an edge of zero length (one
    /// point twice) get one triangle. Long sheets are cut into several charts.
    pub(crate) fn grid(
        &mut self,
        nu: usize,
        nv: usize,
        point: impl Fn(usize, usize) -> u32,
        st: impl Fn(usize, usize) -> [f64; 2],
    ) {
        let corners = [st(0, 0), st(nu, 0), st(0, nv), st(nu, nv), st(nu / 2, nv / 2)];
        let extent = |k: usize| {
            let low = corners.iter().map(|c| c[k]).fold(f64::INFINITY, crate::space::smaller);
            corners.iter().map(|c| c[k]).fold(f64::NEG_INFINITY, crate::space::larger) - low
        };
        let (w, h) = (extent(0), extent(1));
        let cuts = |long: f64, short: f64, n: usize| ((long / (ASPECT * short)).ceil() as usize).clamp(1, n);
        let (pu, pv) = (cuts(w, h, nu), cuts(h, w, nv));
        for bu in 0..pu {
            for bv in 0..pv {
                let (i0, i1) = (bu * nu / pu, (bu + 1) * nu / pu);
                let (j0, j1) = (bv * nv / pv, (bv + 1) * nv / pv);
                self.sheet([i0, i1], [j0, j1], &point, &st);
            }
        }
    }

    /// [`Self::grid`] of the cells from i0 to i1 and j0 to j1, in one chart.
    pub(crate) fn sheet(
        &mut self,
        [i0, i1]: [usize; 2],
        [j0, j1]: [usize; 2],
        point: &impl Fn(usize, usize) -> u32,
        st: &impl Fn(usize, usize) -> [f64; 2],
    ) {
        let chart = self.chart();
        let first = self.vertices.len() as u32;
        let columns = (i1 - i0 + 1) as u32;
        for j in j0..=j1 {
            for i in i0..=i1 {
                self.vertex(point(i, j), chart, st(i, j));
            }
        }
        for j in 0..(j1 - j0) as u32 {
            for i in 0..columns - 1 {
                let at = |di: u32, dj: u32| first + (j + dj) * columns + i + di;
                let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                let p = |v: u32| self.vertices[v as usize].point;
                let halves = if p(a) == p(b) {
                    [Some([a, c, d]), None]
                } else if p(c) == p(d) {
                    [Some([a, b, c]), None]
                } else if (i + j) % 2 == 0 {
                    [Some([a, b, c]), Some([a, c, d])]
                } else {
                    [Some([a, b, d]), Some([b, c, d])]
                };
                self.triangles.extend(halves.into_iter().flatten());
            }
        }
    }

    /// A flat or slightly curved fan: `rim` counter-clockwise seen from outside, each point with its position
    /// on the chart.
    pub(crate) fn fan(&mut self, center: V3, center_st: [f64; 2], rim: &[(u32, [f64; 2])]) {
        let chart = self.chart();
        let p = self.point(center);
        let hub = self.vertex(p, chart, center_st);
        let first = self.vertices.len() as u32;
        for &(point, st) in rim {
            self.vertex(point, chart, st);
        }
        let n = rim.len() as u32;
        self.triangles.extend((0..n).map(|i| [hub, first + i, first + (i + 1) % n]));
    }

    /// Appends another mesh.
    pub(crate) fn append(&mut self, other: &Self) {
        let (points, vertices, charts) = (self.points.len() as u32, self.vertices.len() as u32, self.charts);
        self.points.extend_from_slice(&other.points);
        self.vertices.extend(other.vertices.iter().map(|v| Vertex {
            point: v.point + points,
            chart: v.chart + charts,
            st: v.st,
        }));
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + vertices)));
        self.charts += other.charts;
    }

    /// Moves every point; the charts keep their lengths.
    pub(crate) fn map(mut self, f: impl Fn(V3) -> V3) -> Self {
        for p in &mut self.points {
            *p = f(*p);
        }
        self
    }

    /// The mesh translated by a vector.
    pub(crate) fn moved(self, by: V3) -> Self {
        self.map(|p| add(p, by))
    }

    /// The mesh rotated about the origin.
    pub(crate) fn turned(self, m: &[V3; 3]) -> Self {
        self.map(|p| rotated(m, p))
    }

    /// The mesh scaled about the origin, including its charts.
    pub(crate) fn grown(mut self, s: f64) -> Self {
        for v in &mut self.vertices {
            v.st = v.st.map(|x| x * s);
        }
        self.map(|p| scaled(p, s))
    }

    /// Lowest and highest z.
    pub(crate) fn span(&self) -> [f64; 2] {
        self.points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            [crate::space::smaller(low, p[2]), crate::space::larger(high, p[2])]
        })
    }

    /// Divides every triangle into four until there are at least the given number.
    pub(crate) fn refined(mut self, at_least: usize) -> Self {
        while self.triangles.len() < at_least {
            self = self.quartered();
        }
        self
    }

    fn quartered(mut self) -> Self {
        use std::collections::BTreeMap;
        let mut points: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut vertices: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let old = std::mem::take(&mut self.triangles);
        for [a, b, c] in old {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(x, y)| {
                let key = if x < y { (x, y) } else { (y, x) };
                if let Some(&v) = vertices.get(&key) {
                    return v;
                }
                let (vx, vy) = (self.vertices[key.0 as usize], self.vertices[key.1 as usize]);
                let edge = if vx.point < vy.point { (vx.point, vy.point) } else { (vy.point, vx.point) };
                let point = match points.get(&edge) {
                    Some(&p) => p,
                    None => {
                        let sum = add(self.points[edge.0 as usize], self.points[edge.1 as usize]);
                        let p = self.point(scaled(sum, 0.5));
                        points.insert(edge, p);
                        p
                    }
                };
                let st = [0, 1].map(|k| 0.5 * (vx.st[k] + vy.st[k]));
                let v = self.vertex(point, vx.chart, st);
                vertices.insert(key, v);
                v
            });
            self.triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        self
    }

    /// Total area of the triangles.
    pub(crate) fn area(&self) -> f64 {
        self.triangles.iter().fold(0.0, |s, &t| {
            let [a, b, c] = self.corners(t);
            s + 0.5 * length(cross(sub(b, a), sub(c, a)))
        })
    }

    fn corners(&self, t: [u32; 3]) -> [V3; 3] {
        t.map(|v| self.points[self.vertices[v as usize].point as usize])
    }

    /// A mesh whose vertices have one normal each: faces that meet at a point share a normal if the angle
    /// between them is less than the one with the given cosine.
    pub(crate) fn shell(&self, crease_cos: f64) -> Shell {
        let faces: Vec<V3> = self
            .triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = self.corners(t);
                cross(sub(b, a), sub(c, a))
            })
            .collect();
        let units: Vec<V3> =
            faces.iter().map(|&f| if length(f) > 0.0 { unit(f) } else { [0.0; 3] }).collect();
        // Faces around a point, in order of their index.
        let mut start = vec![0_u32; self.points.len() + 1];
        for t in &self.triangles {
            for &v in t {
                start[self.vertices[v as usize].point as usize + 1] += 1;
            }
        }
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut next = start.clone();
        let mut around = vec![0_u32; 3 * self.triangles.len()];
        for (f, t) in self.triangles.iter().enumerate() {
            for &v in t {
                let slot = &mut next[self.vertices[v as usize].point as usize];
                around[*slot as usize] = f as u32;
                *slot += 1;
            }
        }
        let mut shell = Shell::default();
        // Copies of each vertex created so far, as a list through `link`.
        let mut head = vec![u32::MAX; self.vertices.len()];
        let mut link: Vec<u32> = Vec::new();
        for (f, t) in self.triangles.iter().enumerate() {
            let corner = t.map(|v| {
                let vertex = self.vertices[v as usize];
                let p = vertex.point as usize;
                let mut sum = [0.0; 3];
                for &g in &around[start[p] as usize..start[p + 1] as usize] {
                    if g as usize == f || dot(units[f], units[g as usize]) > crease_cos {
                        sum = add(sum, faces[g as usize]);
                    }
                }
                let normal = if length(sum) > 0.0 { unit(sum) } else { units[f] };
                let mut at = head[v as usize];
                while at != u32::MAX && shell.normals[at as usize] != normal {
                    at = link[at as usize];
                }
                if at == u32::MAX {
                    at = shell.positions.len() as u32;
                    shell.positions.push(self.points[p]);
                    shell.normals.push(normal);
                    shell.st.push(vertex.st);
                    shell.chart.push(vertex.chart);
                    link.push(head[v as usize]);
                    head[v as usize] = at;
                }
                at
            });
            shell.triangles.push(corner);
        }
        shell.charts = self.charts as usize;
        shell
    }
}

/// A finished mesh with its charts.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shell {
    /// Positions, shape (V).
    pub(crate) positions: Vec<V3>,
    /// Unit normals, shape (V).
    pub(crate) normals: Vec<V3>,
    /// Positions on the chart, as lengths, shape (V).
    pub(crate) st: Vec<[f64; 2]>,
    /// Chart of each vertex, shape (V).
    pub(crate) chart: Vec<u32>,
    /// Triangles, shape (T).
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Number of charts.
    pub(crate) charts: usize,
}

/// Centre and radius of a ball around all points, within about one percent of the smallest one (the algorithm
/// of Bădoiu and Clarkson, which moves towards the farthest point).
pub(crate) fn ball<'a>(points: impl Iterator<Item = &'a V3> + Clone) -> (V3, f64) {
    let farthest = |c: V3| {
        points.clone().fold((0.0, c), |best, &p| {
            let d = sub(p, c);
            let d = dot(d, d);
            if d > best.0 { (d, p) } else { best }
        })
    };
    let mut center = points.clone().next().copied().unwrap_or([0.0; 3]);
    for step in 0..64 {
        let (_, p) = farthest(center);
        center = add(center, scaled(sub(p, center), 1.0 / f64::from(step + 2)));
    }
    (center, farthest(center).0.sqrt())
}
