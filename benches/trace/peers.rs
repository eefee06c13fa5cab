//! The peers: Embree in a subprocess, obvhs in this one.

use super::scene::Mesh;
use lastlight::geometry::bvh::Ray;
use obvhs::{
    BvhBuildParams, aabb::Aabb, bvh2::Bvh2, bvh2::builder::build_bvh2, ray::RayHit, triangle::Triangle,
};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

/// `embree.py`, fed with the same mesh and rays.
pub(crate) struct Embree {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

fn write(folder: &Path, name: &str, bytes: impl Iterator<Item = [u8; 4]>) -> std::io::Result<()> {
    std::fs::write(folder.join(name), bytes.flatten().collect::<Vec<u8>>())
}

impl Embree {
    /// Starts the peer; without one, prints the reason and returns `None`.
    pub(crate) fn start(mesh: &Mesh, sets: &[(&str, Vec<Ray>)]) -> Option<Self> {
        let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let probe =
            Command::new(&python).args(["-c", "import embreex, numpy"]).stderr(Stdio::null()).status();
        if !probe.is_ok_and(|s| s.success()) {
            println!("embreex: skipped, {python} cannot import embreex and numpy (set LASTLIGHT_PYTHON)");
            return None;
        }
        let folder = std::env::temp_dir().join(format!("lastlight-trace-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("the folder of temporary files can be written");
        let put = || -> std::io::Result<()> {
            write(&folder, "vertices.f32", mesh.positions.iter().flatten().map(|x| x.to_le_bytes()))?;
            write(&folder, "triangles.i32", mesh.triangles.iter().flatten().map(|x| x.to_le_bytes()))?;
            for (name, rays) in sets {
                let numbers = rays.iter().flat_map(|r| r.origin.into_iter().chain(r.direction));
                write(&folder, &format!("{name}.f32"), numbers.map(f32::to_le_bytes))?;
            }
            Ok(())
        };
        put().expect("the folder of temporary files can be written");
        let script = folder.join("embree.py");
        std::fs::write(&script, include_str!("embree.py")).expect("the script can be written");
        let mut process = Command::new(&python)
            .arg(&script)
            .arg(&folder)
            .args(sets.iter().map(|(name, _)| name))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python starts");
        let to = process.stdin.take().expect("its input is piped");
        let from = BufReader::new(process.stdout.take().expect("its output is piped"));
        let mut peer = Self { process, to, from };
        let ready = peer.line();
        std::fs::remove_dir_all(&folder).expect("the folder of temporary files can be removed");
        println!("embreex builds its tree in {} s", ready.trim_start_matches("ready "));
        Some(peer)
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.from.read_line(&mut line).expect("the peer answers");
        line.trim().to_owned()
    }

    /// Seconds of one pass, and hits.
    pub(crate) fn pass(&mut self, query: &str, name: &str) -> (f64, usize) {
        writeln!(self.to, "{query} {name}").and_then(|()| self.to.flush()).expect("the peer listens");
        let line = self.line();
        let (seconds, hits) = line.split_once(' ').expect("seconds and hits");
        (seconds.parse().expect("seconds"), hits.parse().expect("hits"))
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // It ends when its input does; if it is gone already, nothing is lost.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// obvhs as its documentation shows it: its builder, its traversal, its triangles in leaf order.
pub(crate) struct Obvhs {
    boxes: Vec<Aabb>,
    tree: Bvh2,
    triangles: Vec<Triangle>,
}

impl Obvhs {
    pub(crate) fn build(mesh: &Mesh) -> Self {
        let given: Vec<Triangle> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [v0, v1, v2] = t.map(|i| mesh.positions[i as usize].into());
                Triangle { v0, v1, v2 }
            })
            .collect();
        let boxes: Vec<Aabb> = given.iter().map(Triangle::aabb).collect();
        let tree = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Default::default());
        let triangles = tree.primitive_indices.iter().map(|&i| given[i as usize]).collect();
        Self { boxes, tree, triangles }
    }

    /// Seconds of its builder alone.
    pub(crate) fn rebuild(&self) -> f64 {
        let start = Instant::now();
        let tree = build_bvh2(&self.boxes, BvhBuildParams::medium_build(), &mut Default::default());
        std::hint::black_box(&tree);
        start.elapsed().as_secs_f64()
    }

    /// Seconds of one pass.
    pub(crate) fn pass(&self, rays: &[Ray], any: bool) -> f64 {
        let start = Instant::now();
        let mut found = 0_usize;
        for r in rays {
            let ray = obvhs::ray::Ray::new_inf(r.origin.into(), r.direction.into());
            if any {
                let mut miss = true;
                miss &= self.tree.ray_traverse_miss(ray, |ray, i| self.triangles[i].intersect(ray));
                found += usize::from(!miss);
            } else {
                let mut hit = RayHit::none();
                found += usize::from(
                    self.tree.ray_traverse(ray, &mut hit, |ray, i| self.triangles[i].intersect(ray)),
                );
            }
        }
        std::hint::black_box(found);
        start.elapsed().as_secs_f64()
    }
}
