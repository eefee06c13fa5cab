//! What is digested: the foundations, every case of every operator, and the systems. All of it small.

use lastlight::fit::built_in;
use lastlight::fit::seeds::{self, Start};
use lastlight::fit::splat::{Settings, SplatFit, Strategy};
use lastlight::fit::training::Fit;
use lastlight::num::array::{Array, Arrays};
use lastlight::num::bits::{self, Digest};
use lastlight::num::elem;
use lastlight::num::lanes::f32x8;
use lastlight::num::rng::Rng;
use lastlight::ops::{self, Call, Case, Op};
use lastlight::splat::render;

/// One thing that has a line in the file.
pub(crate) struct Entry {
    /// its name there
    pub(crate) name: String,
    /// its arrays
    pub(crate) arrays: Arrays,
}

impl Entry {
    pub(crate) fn new(name: impl Into<String>, arrays: Arrays) -> Self {
        Self { name: name.into(), arrays }
    }

    /// Digest over names and digests of the arrays; there is none if one of them holds a NaN.
    pub(crate) fn try_digest(&self) -> lastlight::Result<String> {
        let mut all = Digest::new();
        for (name, a) in &self.arrays.0 {
            all.bytes(name.as_bytes());
            all.u64(bits::digest(a).map_err(|e| e.within(format!("{}: array '{name}'", self.name)))?);
        }
        Ok(format!("{:016x}", all.value()))
    }

    /// [`Self::try_digest`] of what must have one.
    pub(crate) fn digest(&self) -> String {
        self.try_digest().unwrap_or_else(|e| panic!("{e}"))
    }

    /// Names and shapes of the arrays.
    pub(crate) fn shape(&self) -> String {
        let one = |(name, a): (&String, &Array)| {
            let dims: Vec<String> = a.shape().iter().map(usize::to_string).collect();
            if dims.is_empty() { name.clone() } else { format!("{name} {}", dims.join("x")) }
        };
        self.arrays.0.iter().map(one).collect::<Vec<_>>().join(", ")
    }

    /// The arrays with their own digests, for the message of a failure.
    pub(crate) fn details(&self) -> String {
        let one = |(name, a): (&String, &Array)| match bits::digest(a) {
            Ok(digest) => format!("\n  {name} {:?} {digest:016x}", a.shape()),
            Err(e) => format!("\n  {name} {:?} {e}", a.shape()),
        };
        self.arrays.0.iter().map(one).collect()
    }
}

/// Names of [`foundations`].
pub(crate) const FOUNDATIONS: [&str; 2] = ["num.elem f32", "num.elem f64"];

/// Name of [`picture`].
pub(crate) const PICTURE: &str = "shade.render passes";

/// All passes of a small image: a map, two lamps, a glossy textured ball, motion.
pub(crate) fn picture() -> Entry {
    use lastlight::geometry::bvh::Bvh;
    use lastlight::scene::camera::{Camera, Model};
    use lastlight::scene::light::{Lamp, Lights};
    use lastlight::scene::material::{Material, Texture, Transfer, Wrap};
    use lastlight::scene::mesh::{Mesh, Object};
    use lastlight::shade::{axes, render};
    let (rings, mut mesh) = (12_u32, Mesh::default());
    for i in 0..=rings {
        for j in 0..=2 * rings {
            let [u, v] = [j as f32 / (2 * rings) as f32, i as f32 / rings as f32];
            let (a, t) = (u * std::f32::consts::TAU, v * std::f32::consts::PI);
            let n = [elem::sin(t) * elem::cos(a), elem::sin(t) * elem::sin(a), elem::cos(t)];
            mesh.positions.push(n);
            mesh.normals.push(n);
            mesh.uvs.push([u, v]);
        }
    }
    let w = 2 * rings + 1;
    for i in 0..rings {
        for j in 0..2 * rings {
            let a = i * w + j;
            mesh.triangles.extend([[a, a + w, a + w + 1], [a, a + w + 1, a + 1]]);
        }
    }
    let texels = (0..64_u32).map(|i| [(37 * i % 256) as u8, (91 * i % 256) as u8, (53 * i % 256) as u8, 255]);
    let map = Texture {
        width: 8,
        height: 8,
        texels: texels.collect(),
        transfer: Transfer::Srgb,
        wrap: [Wrap::Repeat; 2],
    };
    let material = Material {
        base_color_map: Some(std::sync::Arc::new(map)),
        roughness: 0.3,
        metallic: 0.4,
        ..Material::default()
    };
    let object = Object { material_of: vec![0; mesh.triangles.len()], mesh, materials: vec![material] };
    let lights = Lights {
        environment: Some(axes::map(16)),
        lamps: vec![
            Lamp::Point { position: [2.0, -3.0, 4.0], intensity: [9.0; 3] },
            Lamp::Distant { towards: [1.0, 0.0, 0.0], irradiance: [0.5, 1.0, 1.5] },
        ],
    };
    let camera = |x: f32| Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        translation: [x, 0.0, 3.0],
        focal_px: [20.0; 2],
        center_px: [12.0, 10.0],
        width: 24,
        height: 20,
        model: Model::Pinhole,
    };
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let scene = render::Scene::new(&object, &bvh, &lights).expect("a good scene");
    let settings = render::Settings { samples: 6, bounces: 2, seed: 3, ..render::Settings::default() };
    let p = render::render(&scene, &camera(0.0), Some(&camera(0.1)), &settings).expect("good cameras");
    let (n, mut all) = (24 * 20, Arrays::new());
    for (name, x) in [("color", p.color), ("normal", p.normal), ("albedo", p.albedo)] {
        all.put(name, &[n, 3], x.into_flattened());
    }
    for (name, x) in
        [("alpha", p.alpha), ("depth_z", p.depth_z), ("roughness", p.roughness), ("metallic", p.metallic)]
    {
        all.put(name, &[n], x);
    }
    Entry::new(PICTURE, all)
}

/// What every operator rests on: the elementary functions, eight lanes at a time and one by one.
pub(crate) fn foundations() -> Vec<Entry> {
    const N: usize = 1003;
    let rng = Rng::new(0x6269_7473); // "bits"
    let wide: Vec<f32> = (0..N).map(|i| 8.0 * rng.normal_f32(i as u64, 0, 0, 0)).collect();
    let unit: Vec<f32> = (0..N).map(|i| rng.uniform_f32(i as u64, 1, 0, 0)).collect();
    let mut single = Arrays::new();
    {
        let mut put = |name: &str, f: fn(&[f32], &mut [f32]), x: &[f32]| {
            let mut y = vec![0.0; x.len()];
            f(x, &mut y);
            single.put(name, &[x.len()], y);
        };
        put("exp", elem::exp_slice, &wide);
        put("exp_lanes", elem::exp_lanes_slice, &wide);
        put("expm1", elem::expm1_slice, &wide);
        put("ln", elem::ln_slice, &unit);
        put("log1p", elem::log1p_slice, &unit);
        put("logit", elem::logit_slice, &unit);
        put("sin", elem::sin_slice, &wide);
        put("cos", elem::cos_slice, &wide);
        put("acos", elem::acos_slice, &unit);
        put("tanh", elem::tanh_slice, &wide);
        put("sigmoid", elem::sigmoid_slice, &wide);
        put("softplus", elem::softplus_slice, &wide);
        put("erf", elem::erf_slice, &wide);
        put("pow", |x, y| elem::pow_slice(x, 2.4, y), &unit);
    }
    let eights = wide.as_chunks::<8>().0.iter().zip(unit.as_chunks::<8>().0);
    let angles: Vec<f32> =
        eights.flat_map(|(y, x)| elem::atan2(f32x8::new(*y), f32x8::new(*x)).to_array()).collect();
    single.put("atan2", &[angles.len()], angles);

    let mut double = Arrays::new();
    let (wide, unit): (Vec<f64>, Vec<f64>) =
        (0..N as u64).map(|i| (8.0 * rng.normal_f64(i, 2, 0, 0), rng.uniform_f64(i, 3, 0, 0))).unzip();
    let mut put = |name: &str, f: fn(f64) -> f64, x: &[f64]| {
        double.put(name, &[x.len()], x.iter().map(|&x| f(x)).collect());
    };
    put("exp", elem::f64::exp, &wide);
    put("ln", elem::f64::ln, &unit);
    put("log1p", elem::f64::log1p, &unit);
    put("sin", elem::f64::sin, &wide);
    put("cos", elem::f64::cos, &wide);
    put("acos", elem::f64::acos, &unit);
    put("tanh", elem::f64::tanh, &wide);
    put("cbrt", elem::f64::cbrt, &wide);
    put("erf", elem::f64::erf, &wide);
    put("sigmoid", elem::f64::sigmoid, &wide);
    let [f32_name, f64_name] = FOUNDATIONS;
    vec![Entry::new(f32_name, single), Entry::new(f64_name, double)]
}

/// Names of [`operator`], all operators in the order of the list.
pub(crate) fn operator_names() -> Vec<String> {
    let of_case = |op: &Op, i: usize| {
        let parts: &[&str] = if op.adjoint { &["forward", "adjoint"] } else { &["forward"] };
        parts.iter().map(|part| format!("{}/{i} {part}", op.name)).collect::<Vec<_>>()
    };
    ops::LIST.iter().flat_map(|op| (0..op.cases).flat_map(move |i| of_case(op, i))).collect()
}

/// Every case of one operator, the shipped code: outputs, intermediates and plan, then gradients for drawn
/// cotangents.
pub(crate) fn operator(op: &'static Op) -> Vec<Entry> {
    let mut entries = Vec::new();
    for i in 0..op.cases {
        let Case { inputs, settings } = (op.case)(i);
        let mut call = Call { inputs, settings, dump: true, ..Call::default() };
        let run = |call: &Call| ops::run(op, call).unwrap_or_else(|e| panic!("{} case {i}: {e}", op.name));
        let ran = run(&call);
        if op.adjoint {
            call.cotangents = ops::draw_cotangents(op, &ran.outputs);
            let again = run(&call);
            assert_eq!(
                again.outputs, ran.outputs,
                "{} case {i}: outputs do not depend on cotangents",
                op.name
            );
            let bar = |(name, a): (String, Array)| (format!("{name}_bar"), a);
            let gradients = Arrays(again.gradients.0.into_iter().map(bar).collect());
            assert!(!gradients.0.is_empty(), "{} case {i}: it has an adjoint", op.name);
            entries.push(Entry::new(format!("{}/{i} adjoint", op.name), gradients));
        }
        let mut forward = ran.outputs;
        forward.0.extend(ran.intermediates.0);
        forward.0.extend(ran.plan.0.into_iter().map(|(name, a)| (format!("plan {name}"), a)));
        let at = entries.len() - usize::from(op.adjoint);
        entries.insert(at, Entry::new(format!("{}/{i} forward", op.name), forward));
    }
    entries
}

/// Names of [`twin`], all operators in the order of the list.
pub(crate) fn twin_names() -> Vec<String> {
    ops::LIST.iter().flat_map(|op| (0..op.cases).map(move |i| format!("{}/{i} twin", op.name))).collect()
}

/// Every case of one operator, run by the twin in f64: what `oracle mint` writes, with gradients.
pub(crate) fn twin(op: &'static Op) -> Vec<Entry> {
    let one = |i: usize| {
        let Case { inputs, settings } = (op.case)(i);
        let mut call = Call { inputs, settings, ..Call::default() };
        let run =
            |call: &Call| ops::run_f64(op, call).unwrap_or_else(|e| panic!("{} case {i}: {e}", op.name));
        let mut ran = run(&call);
        if op.adjoint {
            call.cotangents = ops::draw_cotangents(op, &ran.outputs);
            ran = run(&call);
        }
        let mut arrays = ran.outputs;
        arrays.0.extend(ran.gradients.0.into_iter().map(|(name, a)| (format!("{name}_bar"), a)));
        Entry::new(format!("{}/{i} twin", op.name), arrays)
    };
    (0..op.cases).map(one).collect()
}

/// A system: its name and the strategies or modes it is run in.
const SYSTEMS: [(&str, Strategy); 2] =
    [("splat.fit/inria", Strategy::Inria), ("splat.fit/mcmc", Strategy::Mcmc)];

/// Iterations after which the complete state of a fit is digested; the last one ends it.
const AFTER: [usize; 2] = [10, 100];

/// Names of [`systems`].
pub(crate) fn system_names() -> Vec<String> {
    let fits = SYSTEMS.iter().flat_map(|(name, _)| AFTER.map(|n| format!("{name} {n} iterations")));
    let names = [PICTURE, FIGURE, OBJECT, MAP].into_iter().chain(super::person::NAMES);
    names.map(str::to_owned).chain(fits).chain(super::object::names()).chain(super::lirm::names()).collect()
}

/// Names of [`generated`].
const FIGURE: &str = "data_gen.figure surfaces";
const OBJECT: &str = "data_gen.objects surfaces";
const MAP: &str = "data_gen.environments map";

/// A posed person, two objects and a panorama, before anything is rendered.
fn generated() -> Vec<Entry> {
    let surfaces = |name: &str, list: &[data_gen::surface::Surface]| {
        let all =
            |f: &dyn Fn(&data_gen::surface::Surface) -> Vec<f64>| list.iter().flat_map(f).collect::<Vec<_>>();
        let mut arrays = Arrays::new();
        let mut put = |what: &str, width: usize, x: Vec<f64>| arrays.put(what, &[x.len() / width, width], x);
        put("positions", 3, all(&|s| s.positions.concat()));
        put("normals", 3, all(&|s| s.normals.concat()));
        put("uvs", 2, all(&|s| s.uvs.concat()));
        let maps = list.iter().filter_map(|s| s.material.base_color_map.as_ref());
        let texels: Vec<u8> = maps.flat_map(|m| m.texels.iter().flatten()).copied().collect();
        arrays.put("texels", &[texels.len()], texels);
        Entry::new(name, arrays)
    };
    let person = data_gen::figure::surface::Figure::new(&data_gen::figure::appearance::Appearance::new(7, 0));
    let drive = data_gen::figure::factors::Drive::new(&[0.7, -0.4, 1.2, 0.3]);
    let objects = [3, 8].map(|k| data_gen::objects::build(7, k, 64).surfaces).concat();
    let map = data_gen::environments::make(7, 1, 64, 32);
    let mut panorama = Arrays::new();
    panorama.put("radiance", &[map.height, map.width, 3], map.radiance.concat());
    vec![surfaces(FIGURE, &person.surfaces(&drive)), surfaces(OBJECT, &objects), Entry::new(MAP, panorama)]
}

/// A small image; state and losses of small fits of the built-in scene.
pub(crate) fn systems() -> Vec<Entry> {
    let views = built_in::miniature(3, 2, &render::Settings::default()).expect("the built-in scene renders");
    let mut entries = vec![picture()];
    entries.extend(generated());
    entries.extend(super::person::entries());
    for (name, strategy) in SYSTEMS {
        let settings = Settings {
            iterations: AFTER[1],
            seed: 7,
            sh_degree: 2,
            strategy,
            max_gaussians: 1200,
            render: render::Settings::default(),
            background: built_in::BACKGROUND,
        };
        let start = Start::Random { count: 400, bounds: None };
        let first = seeds::gaussians(&start, &views, &settings).expect("a valid start");
        let mut fit = SplatFit::new(settings, &views, first).expect("valid settings");
        let mut losses = Vec::new();
        for i in 0..AFTER[1] {
            losses.push(fit.step(i, &mut ()).expect("the fit continues").loss);
            if AFTER.contains(&losses.len()) {
                let mut state = Arrays::new();
                fit.save(&mut state);
                state.put("loss", &[losses.len()], losses.clone());
                entries.push(Entry::new(format!("{name} {} iterations", losses.len()), state));
            }
        }
        assert!(!fit.events().is_empty(), "{name}: density control has acted, or the digest proves little");
    }
    entries.extend(super::object::entries());
    entries.extend(super::lirm::entries());
    entries
}
