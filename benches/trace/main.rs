//! Rays against one million triangles, beside Embree (`embreex`) and `obvhs` in the same run.
//!
//! `cargo bench --workspace --bench trace` prints Mrays/s and ratios; `-- --quick` does a small mesh and few
//! rays. The peer needs a Python with `embreex` and `numpy`, named by `LASTLIGHT_PYTHON` or `python3`;
//! without one there is - in its columns.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

mod peers;
mod scene;

use lastlight::geometry::bvh::{Bvh, Hit, Ray};
use lastlight::num::par;
use peers::{Embree, Obvhs};
use std::time::Instant;

/// Rays of one task.
const CHUNK: usize = 4096;

#[derive(Clone, Copy, PartialEq)]
enum Query {
    Closest,
    Occluded,
}

/// How the library is called.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    OneByOne,
    Batch,
}

fn median(v: &[f64]) -> f64 {
    let mut v = v.to_vec();
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

/// Seconds of one pass in a pool of that many threads, its hits, and its answers for occlusion.
fn pass(bvh: &Bvh, rays: &[Ray], query: Query, way: Way, threads: usize, answer: &mut Answer) -> f64 {
    par::with_threads(threads, || {
        let start = Instant::now();
        match (query, way) {
            (Query::Closest, Way::OneByOne) => par::chunks_mut(&mut answer.hits, CHUNK, |i, hits| {
                hits.iter_mut().zip(&rays[i * CHUNK..]).for_each(|(h, r)| *h = bvh.closest(r));
            }),
            (Query::Closest, Way::Batch) => par::chunks_mut(&mut answer.hits, CHUNK, |i, hits| {
                bvh.closest_batch(&rays[i * CHUNK..i * CHUNK + hits.len()], hits);
            }),
            (Query::Occluded, Way::OneByOne) => par::chunks_mut(&mut answer.occluded, CHUNK, |i, hits| {
                hits.iter_mut().zip(&rays[i * CHUNK..]).for_each(|(h, r)| *h = bvh.occluded(r));
            }),
            (Query::Occluded, Way::Batch) => par::chunks_mut(&mut answer.occluded, CHUNK, |i, hits| {
                bvh.occluded_batch(&rays[i * CHUNK..i * CHUNK + hits.len()], hits);
            }),
        }
        start.elapsed().as_secs_f64()
    })
    .expect("a pool starts")
}

#[derive(Clone, PartialEq)]
struct Answer {
    hits: Vec<Hit>,
    occluded: Vec<bool>,
}

fn main() {
    let quick = std::env::args().any(|a| a == "--quick" || a == "--test");
    let runs = if quick { 1 } else { 7 };
    let (u, v, side) = if quick { (200, 100, 128) } else { (1000, 500, 1024) };
    let mesh = scene::mesh(u, v);
    let obvhs = Obvhs::build(&mesh);
    let bvh = build(&mesh, &obvhs, if quick { 1 } else { 5 });
    let sets = scene::rays(&bvh, &mesh, side);
    let mut embree = Embree::start(&mesh, &sets);
    println!(
        "{:8} {:8} {:>8} {:>8} | {:>8} {:>6} {:>6} | {:>8} {:>6} {:>6}",
        "Mrays/s", "", "embreex", "obvhs", "1 by 1", "/emb", "2 thr", "batch", "/emb", "2 thr"
    );
    for (name, rays) in &sets {
        for query in [Query::Closest, Query::Occluded] {
            let label = if query == Query::Closest { "closest" } else { "occluded" };
            let blank = Answer { hits: vec![Hit::NONE; rays.len()], occluded: vec![false; rays.len()] };
            let mut first: Option<Answer> = None;
            let mut seconds = vec![vec![]; 6];
            for _ in 0..runs {
                if let Some(e) = &mut embree {
                    let (s, hits) = e.pass(label, name);
                    seconds[0].push(s);
                    if let Some(f) = &first {
                        let ours = match query {
                            Query::Closest => f.hits.iter().filter(|h| h.t.is_finite()).count(),
                            Query::Occluded => f.occluded.iter().filter(|&&o| o).count(),
                        };
                        assert!(
                            ours.abs_diff(hits) <= 4 + rays.len() / 10_000,
                            "{name} {label}: {ours} hits, the peer {hits}"
                        );
                    }
                }
                seconds[1].push(obvhs.pass(rays, query == Query::Occluded));
                for (slot, way, threads) in
                    [(2, Way::OneByOne, 1), (3, Way::OneByOne, 2), (4, Way::Batch, 1), (5, Way::Batch, 2)]
                {
                    let mut answer = blank.clone();
                    seconds[slot].push(pass(&bvh, rays, query, way, threads, &mut answer));
                    assert!(
                        *first.get_or_insert_with(|| answer.clone()) == answer,
                        "{name} {label}: other answers on {threads} threads or in a batch"
                    );
                }
            }
            let rate = |i: usize| 1e-6 * rays.len() as f64 / median(&seconds[i]);
            let peer = (!seconds[0].is_empty()).then(|| rate(0));
            let cell = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.2}"));
            let beside = |r: f64| cell(peer.map(|p| r / p));
            println!(
                "{name:8} {label:8} {:>8} {:8.2} | {:8.2} {:>6} {:6.2} | {:8.2} {:>6} {:6.2}",
                cell(peer),
                rate(1),
                rate(2),
                beside(rate(2)),
                rate(3) / rate(2),
                rate(4),
                beside(rate(4)),
                rate(5) / rate(4),
            );
        }
    }
}

/// Builds the tree beside obvhs and prints both times.
fn build(mesh: &scene::Mesh, obvhs: &Obvhs, runs: usize) -> Bvh {
    for threads in [1, 2] {
        let (mut ours, mut theirs) = (vec![], vec![]);
        for _ in 0..runs {
            let (a, b) = par::with_threads(threads, || {
                let start = Instant::now();
                let bvh = Bvh::build(&mesh.positions, &mesh.triangles);
                let a = start.elapsed().as_secs_f64();
                std::hint::black_box(&bvh);
                (a, obvhs.rebuild())
            })
            .expect("a pool starts");
            ours.push(a);
            theirs.push(b);
        }
        println!(
            "build of {} triangles, {threads} threads: {:.0} ms, obvhs alone {:.0} ms, ratio {:.2}",
            mesh.triangles.len(),
            1e3 * median(&ours),
            1e3 * median(&theirs),
            median(&ours) / median(&theirs)
        );
    }
    Bvh::build(&mesh.positions, &mesh.triangles)
}
