//! `shade.ggx` and `shade.envmap`.

use super::{ALBEDO, COSINES, on_sphere, uniform};
use crate::common::golden;
use lastlight::num::array::Arrays;
use lastlight::num::bits::ulp_f32;
use lastlight::num::lanes::f32x8;
use lastlight::ops::{self, Call, Case};
use lastlight::shade::ggx::{self, ALPHA_MIN, InBar, Material, Point};
use lastlight::shade::vector::{dot, unit};

fn relative(got: &[f64], want: &[f64]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (g, w) in got.iter().zip(want) {
        error += (g - w) * (g - w);
        norm += w * w;
    }
    (error / norm).sqrt()
}

#[test]
fn golden_ggx_in_both_precisions() {
    let Some(file) = golden("shade_ggx") else { return };
    let op = ops::find("shade.ggx").expect("it is on the list");
    let mut call = Call::default();
    for port in op.inputs {
        call.inputs.0.insert(port.name.to_owned(), file.need(port.name).expect("an input").clone());
    }
    call.cotangents.0.insert("brdf".to_owned(), file.need("brdf_bar").expect("a cotangent").clone());
    for (precision, output, gradient) in [("f32", 2e-6, 2e-5), ("f64", 1e-12, 1e-10)] {
        let ran = if precision == "f32" { ops::run(op, &call) } else { ops::run_f64(op, &call) };
        let ran = ran.expect("a golden file is a good call");
        let want = |name: &str| file.need(name).expect("an array").to_f64();
        let got = |arrays: &Arrays, name: &str| arrays.need(name).expect("an array").to_f64();
        let e = relative(&got(&ran.outputs, "brdf"), &want("brdf"));
        println!("{precision} brdf: {e:.2e}");
        assert!(e <= output, "{precision} brdf: relative error {e}");
        for name in ["normal", "albedo", "roughness", "metallic"] {
            let e = relative(&got(&ran.gradients, name), &want(&format!("{name}_bar")));
            println!("{precision} {name}_bar: {e:.2e}");
            assert!(e <= gradient, "{precision} {name}_bar: relative error {e}");
        }
    }
}

fn material(i: usize) -> Material<f32> {
    Material {
        albedo: [uniform(i, 1), uniform(i, 2), uniform(i, 3)],
        roughness: uniform(i, 4) * uniform(i, 5),
        metallic: uniform(i, 6),
    }
}

#[test]
fn the_brdf_is_reciprocal_to_the_bit() {
    let mut seen = 0;
    for i in 0..20_000 {
        let (n, v, l, m) = (on_sphere(i, 0), on_sphere(i, 1), on_sphere(i, 2), material(i));
        let there = Point::new(n, v, &m).eval(l).map(f32::to_bits);
        let back = Point::new(n, l, &m).eval(v).map(f32::to_bits);
        assert_eq!(there, back, "case {i}: view and light exchanged");
        seen += usize::from(there != [0; 3]);
    }
    assert!(seen > 4000, "{seen} of them reflect");
}

#[test]
fn a_lane_has_the_bits_of_a_scalar() {
    for i in (0..4000).step_by(8) {
        let lane = |f: &dyn Fn(usize) -> [f32; 3]| -> [f32x8; 3] {
            std::array::from_fn(|k| f32x8::new(std::array::from_fn(|l| f(i + l)[k])))
        };
        let number = |f: &dyn Fn(usize) -> f32| f32x8::new(std::array::from_fn(|l| f(i + l)));
        let m = Material {
            albedo: lane(&|i| material(i).albedo),
            roughness: number(&|i| material(i).roughness),
            metallic: number(&|i| material(i).metallic),
        };
        let f = Point::new(lane(&|i| on_sphere(i, 0)), lane(&|i| on_sphere(i, 1)), &m)
            .eval(lane(&|i| on_sphere(i, 2)))
            .map(f32x8::to_array);
        for l in 0..8 {
            let one = Point::new(on_sphere(i + l, 0), on_sphere(i + l, 1), &material(i + l))
                .eval(on_sphere(i + l, 2));
            for k in 0..3 {
                assert_eq!(f[k][l].to_bits(), one[k].to_bits(), "case {}, channel {k}", i + l);
            }
        }
    }
}

/// ∫ D cos θ dω by the trapezoidal rule in ln θ.
#[test]
fn the_distribution_of_normals_integrates_to_one() {
    for r in [1.0_f32, 0.5, 0.1, 0.03, 0.01] {
        let m = Material { albedo: [1.0; 3], roughness: r, metallic: 1.0 };
        let (lo, hi, n) = (libm::log(1e-6), libm::log(std::f64::consts::FRAC_PI_2), 8000);
        let step = (hi - lo) / f64::from(n);
        let mut sum = 0.0;
        for i in 0..n {
            let theta = libm::exp(lo + (f64::from(i) + 0.5) * step);
            let h = [libm::sin(theta) as f32, 0.0, libm::cos(theta) as f32];
            let d = Point::new([0.0, 0.0, 1.0], h, &m).facet(h).d; // v = l = h
            sum += f64::from(d) * libm::cos(theta) * libm::sin(theta) * theta * step * std::f64::consts::TAU;
        }
        println!("r {r}: ∫ D cos = {sum:.7}");
        assert!((sum - 1.0).abs() <= 2e-6, "r {r}: {sum}");
    }
}

/// The table is another program's; here the shipped BRDF is integrated over light directions, on a grid
/// warped towards the mirror direction.
#[test]
fn directional_albedo_is_the_tabulated_one() {
    for (metallic, roughness, want) in ALBEDO {
        for (cosine, want) in COSINES.into_iter().zip(want) {
            let m = Material { albedo: [1.0; 3], roughness, metallic };
            let v = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let point = Point::new([0.0, 0.0, 1.0], v, &m);
            let (n_polar, n_azimuth) = (1200, 1200);
            let mut sum = 0.0;
            for i in 0..n_polar {
                // polar angle and azimuth about the mirror direction −x..: dense near it
                let polar = std::f64::consts::PI * ((f64::from(i) + 0.5) / f64::from(n_polar));
                let (sin_p, cos_p) = (libm::sin(polar), libm::cos(polar));
                for j in 0..n_azimuth {
                    let azimuth = std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(n_azimuth);
                    let axis = [-f64::from(v[0]), 0.0, f64::from(v[2])];
                    let (side, up) = ([0.0, 1.0, 0.0], [-axis[2], 0.0, axis[0]]);
                    let l: [f32; 3] = std::array::from_fn(|k| {
                        (axis[k] * cos_p
                            + sin_p * (side[k] * libm::cos(azimuth) + up[k] * libm::sin(azimuth)))
                            as f32
                    });
                    if l[2] > 0.0 {
                        sum += f64::from(point.eval(l)[0] * l[2]) * sin_p;
                    }
                }
            }
            sum *= std::f64::consts::PI / f64::from(n_polar) * std::f64::consts::TAU / f64::from(n_azimuth);
            assert!(
                (sum - want).abs() <= 5e-4,
                "m {metallic}, r {roughness}, n·v {cosine}: {sum}, want {want}"
            );
        }
    }
}

#[test]
fn grazing_and_coincident_directions_stay_finite() {
    let n = [0.0, 0.0, 1.0];
    for r in [0.0, 0.01, 0.03, 0.5, 1.0] {
        let m = Material { albedo: [0.9, 0.5, 0.1], roughness: r, metallic: 0.5 };
        for nv in [0.0_f32, 1e-8, -1e-8, 1e-30, 1e-4, 1.0, 1.0 + f32::EPSILON] {
            for nl in [0.0_f32, 1e-8, -1e-8, 1e-30, 1e-4, 1.0, 1.0 + f32::EPSILON] {
                for side in [1.0, -1.0] {
                    let direction = |c: f32, x: f32| [if c < 0.5 { x } else { 0.0 }, 0.0, c];
                    let (v, l) = (direction(nv, 1.0), direction(nl, side));
                    let mut bar = InBar {
                        normal: vec![[0.0; 3]],
                        albedo: vec![[0.0; 3]],
                        roughness: vec![0.0],
                        metallic: vec![0.0],
                    };
                    let x = ggx::In {
                        normal: &[n],
                        view: &[v],
                        light: &[l],
                        albedo: &[m.albedo],
                        roughness: &[m.roughness],
                        metallic: &[m.metallic],
                    };
                    let mut f = [[0.0; 3]];
                    ggx::forward(x, &mut f);
                    ggx::adjoint(x, &[[1.0, -0.5, 0.25]], &mut bar);
                    let all = f[0].iter().chain(&bar.normal[0]).chain(&bar.albedo[0]);
                    let all: Vec<f32> = all.chain(&bar.roughness).chain(&bar.metallic).copied().collect();
                    assert!(all.iter().all(|x| x.is_finite()), "r {r}, n·v {nv}, n·l {nl}: {all:?}");
                    assert!(f[0].iter().all(|x| *x >= 0.0), "r {r}, n·v {nv}, n·l {nl}: f = {f:?}");
                    if nv <= 0.0 || nl <= 0.0 {
                        assert!(
                            all.iter().all(|x| *x == 0.0),
                            "r {r}, n·v {nv}, n·l {nl}: nothing, got {all:?}"
                        );
                    }
                }
            }
        }
    }
}

/// For v = l = n: f = (1−m)a/π + F₀/(4πα²) with α at its bound, and roughness has no gradient there.
#[test]
fn a_mirror_has_its_peak_and_no_gradient_of_roughness() {
    let n = [0.0, 0.0, 1.0];
    let m = Material { albedo: [0.5; 3], roughness: 0.0, metallic: 1.0 };
    let f = Point::new(n, n, &m).eval(n)[0];
    let want = 0.5 / (4.0 * std::f32::consts::PI * ALPHA_MIN * ALPHA_MIN);
    assert!(ulp_f32(f, want) <= 8, "peak {f}, want {want}");
    let rough = Point::new(n, n, &Material { roughness: ALPHA_MIN.sqrt() * 0.9, ..m }).eval(n)[0];
    assert_eq!(f, rough, "below the bound roughness does nothing");
}

#[test]
fn a_zero_normal_reflects_nothing_and_has_no_gradient() {
    for name in ["shade.ggx", "shade.envmap"] {
        let op = ops::find(name).expect("it is on the list");
        let Case { mut inputs, settings } = (op.case)(0);
        let mut normal = inputs.get("normal").expect("an input").to_f32();
        normal[3..6].fill(0.0);
        let p = normal.len() / 3;
        inputs.put("normal", &[p, 3], normal);
        let mut call = Call { inputs, settings, ..Call::default() };
        let outputs = ops::run(op, &call).expect("it runs").outputs;
        let row = outputs.get(op.outputs[0].name).expect("the output").to_f32()[3..6].to_vec();
        assert_eq!(row, [0.0; 3], "{name}: reflects nothing");
        call.cotangents = ops::draw_cotangents(op, &outputs);
        for run in [ops::run(op, &call), ops::run_f64(op, &call)] {
            let g = run.expect("it runs").gradients;
            let row = g.get("normal").expect("a gradient").to_f64()[3..6].to_vec();
            assert_eq!(row, [0.0; 3], "{name}: no gradient");
        }
    }
}

/// With an ordinary light the operators agree: one bright texel is a light of E·Δω.
#[test]
fn a_map_with_one_texel_lit_is_one_light() {
    use lastlight::shade::{environment, envmap};
    let (h, w) = (8, 12);
    let lit = 2 * w + 7;
    let mut env = vec![[0.0; 3]; h * w];
    env[lit] = [2.0, 3.0, 5.0];
    let l = environment::texel_center(w, h, 2, 7);
    let omega = environment::solid_angles(w, h).0[2] as f32;
    let n = 37;
    let normals: Vec<_> = (0..n).map(|i| on_sphere(i, 3)).collect();
    let views: Vec<_> = (0..n).map(|i| on_sphere(i, 4)).collect();
    let m: Vec<_> = (0..n).map(material).collect();
    let albedo: Vec<_> = m.iter().map(|m| m.albedo).collect();
    let (roughness, metallic): (Vec<_>, Vec<_>) = m.iter().map(|m| (m.roughness, m.metallic)).unzip();
    let x = envmap::In {
        normal: &normals,
        view: &views,
        albedo: &albedo,
        roughness: &roughness,
        metallic: &metallic,
        env: &env,
        height: h,
        width: w,
    };
    let mut out = vec![[0.0; 3]; n];
    envmap::forward(x, &mut out);
    for i in 0..n {
        let unit = unit(normals[i]).0;
        let f = Point::new(unit, views[i], &m[i]).eval(l);
        let weight = dot(unit, l) * omega;
        for k in 0..3 {
            let want = if f[k] == 0.0 { 0.0 } else { f[k] * weight * env[lit][k] };
            assert_eq!(out[i][k], want, "point {i}, channel {k}");
        }
    }
}

/// Under a constant map the operator is the sum of its terms, however many there are; and for n = z the part
/// that the albedo adds is the midpoint rule for ∫ cos dω/π, which is 1/cos(h/2) for rows of height h.
#[test]
fn a_large_constant_map_does_not_drift() {
    use lastlight::shade::{environment, envmap};
    let (h, w) = (512, 1024);
    let env = vec![[1.0; 3]; h * w];
    let mut normals: Vec<_> = (0..8).map(|i| on_sphere(i, 3)).collect();
    (normals[0], normals[1]) = ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]);
    let mut views: Vec<_> = (0..8).map(|i| unit([0.2 + uniform(i, 7), 0.1, 1.0]).0).collect();
    views[1] = views[0];
    for i in 2..8 {
        let up = dot(views[i], normals[i]) < 0.0;
        normals[i] = if up { normals[i].map(|x| -x) } else { normals[i] };
    }
    let mut albedo: Vec<_> = (0..8).map(|i| material(i).albedo).collect();
    (albedo[0], albedo[1]) = ([1.0; 3], [0.0; 3]);
    let (roughness, mut metallic) = (vec![0.8; 8], vec![0.3; 8]);
    (metallic[0], metallic[1]) = (0.0, 0.0);
    let x = envmap::In {
        normal: &normals,
        view: &views,
        albedo: &albedo,
        roughness: &roughness,
        metallic: &metallic,
        env: &env,
        height: h,
        width: w,
    };
    let mut out = vec![[0.0; 3]; 8];
    envmap::forward(x, &mut out);
    let centers = environment::texel_centers(w, h);
    let omega = environment::solid_angles(w, h).0;
    for p in 0..8 {
        let m = Material { albedo: albedo[p], roughness: roughness[p], metallic: metallic[p] };
        let point = Point::new(normals[p], views[p], &m);
        let mut want = 0.0;
        for (t, l) in centers.iter().enumerate() {
            let nl = f64::from(dot(normals[p], *l));
            if nl > 0.0 {
                want += f64::from(point.eval(*l)[1]) * nl * omega[t / w];
            }
        }
        let e = (f64::from(out[p][1]) / want - 1.0).abs();
        // half a unit in the last place each of Δω, of a term's products, and of the sum
        assert!(e <= 2e-7, "point {p}: {} against {want}, off by {e:.1e}", out[p][1]);
    }
    let irradiance = f64::from(out[0][0]) - f64::from(out[1][0]);
    let want = 1.0 / libm::cos(0.5 * std::f64::consts::PI / h as f64);
    println!("irradiance/π of a constant map: {irradiance:.8}, want {want:.8}");
    assert!((irradiance - want).abs() <= 1e-6, "{irradiance}, want {want}");
}

#[test]
fn normals_of_any_length_reflect_alike() {
    let (v, l) = (unit([0.3, 0.1, 0.9]).0, unit([-0.4, 0.2, 0.8]).0);
    let shoot = |length: f32| {
        let mut f = [[0.0; 3]];
        let normal = [0.1, -0.2, 0.97].map(|x| x * length);
        let x = ggx::In {
            normal: &[normal],
            view: &[v],
            light: &[l],
            albedo: &[[0.9, 0.5, 0.1]],
            roughness: &[0.4],
            metallic: &[0.5],
        };
        ggx::forward(x, &mut f);
        f[0][0]
    };
    let want = shoot(1.0);
    for length in [1e-36_f32, 1e-21, 1e-12, 1e-3, 1e4, 2e19, 1e38] {
        let f = shoot(length);
        assert!((f / want - 1.0).abs() <= 1e-5, "length {length:e}: {f}, want {want}");
    }
}

#[test]
fn the_operators_refuse_what_is_out_of_range() {
    for name in ["shade.ggx", "shade.envmap"] {
        let op = ops::find(name).expect("it is on the list");
        for (array, value) in [("roughness", 2.0_f32), ("metallic", -0.1), ("albedo", 1.5), ("view", 2.0)] {
            let Case { mut inputs, settings } = (op.case)(0);
            let old = inputs.get(array).expect("an input");
            let (shape, mut values) = (old.shape().to_vec(), old.to_f32());
            values[4] = value;
            inputs.put(array, &shape, values);
            let e = ops::run(op, &Call { inputs, settings, ..Call::default() }).expect_err("refused");
            let row = if shape.len() == 2 { 1 } else { 4 };
            assert!(e.to_string().contains(&format!("array '{array}', row {row}")), "{name}: {e}");
        }
    }
}

/// A map of half a million texels, roughnesses as of scenes and one lobe of a few texels: the gradients of
/// points are sums over as many terms.
#[test]
fn gradients_under_a_large_map_are_those_of_the_twin() {
    use lastlight::shade::envmap;
    let (h, w, n) = (512, 1024, 8);
    let env: Vec<[f32; 3]> = (0..h * w)
        .map(|t| {
            let sun = if t % 4099 == 7 { 300.0 } else { 1.0 };
            [uniform(t, 20) * sun, uniform(t, 21) * sun, uniform(t, 22) * sun]
        })
        .collect();
    let normals: Vec<_> = (0..n).map(|i| on_sphere(i, 3)).collect();
    let views: Vec<_> =
        (0..n).map(|i| unit([0, 1, 2].map(|k| normals[i][k] + 0.6 * on_sphere(i, 4)[k])).0).collect();
    let albedo: Vec<_> = (0..n).map(|i| material(i).albedo).collect();
    let roughness: Vec<f32> = (0..n).map(|i| 0.2 + 0.1 * i as f32).collect();
    let metallic: Vec<f32> = (0..n).map(|i| uniform(i, 6)).collect();
    let bars: Vec<[f32; 3]> = (0..n).map(|i| [0, 1, 2].map(|k| uniform(i, 30 + k) - 0.5)).collect();
    let x = envmap::In {
        normal: &normals,
        view: &views,
        albedo: &albedo,
        roughness: &roughness,
        metallic: &metallic,
        env: &env,
        height: h,
        width: w,
    };
    let mut bar = InBar {
        normal: vec![[0.0; 3]; n],
        albedo: vec![[0.0; 3]; n],
        roughness: vec![0.0; n],
        metallic: vec![0.0; n],
    };
    let mut env_bar = vec![[0.0_f32; 3]; h * w];
    envmap::adjoint(x, &bars, &mut bar, &mut env_bar);
    let named =
        |name: &str, shape: &[usize], v: Vec<f64>| (name.to_owned(), reference::array::Arr::new(shape, v));
    let wide = |v: &[[f32; 3]]| v.iter().flatten().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let one = |v: &[f32]| v.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let inputs: reference::array::Named<f64> = [
        named("normal", &[n, 3], wide(&normals)),
        named("view", &[n, 3], wide(&views)),
        named("albedo", &[n, 3], wide(&albedo)),
        named("roughness", &[n], one(&roughness)),
        named("metallic", &[n], one(&metallic)),
        named("env", &[h, w, 3], wide(&env)),
    ]
    .into_iter()
    .collect();
    let cotangents: reference::array::Named<f64> =
        [named("radiance", &[n, 3], wide(&bars))].into_iter().collect();
    let settings = std::collections::BTreeMap::new();
    let request =
        reference::twins::Request { op: "shade.envmap", inputs: &inputs, settings: &settings, plan: None };
    let (_, want) = reference::twins::vjp(&request, &cotangents).expect("the twin runs");
    let f = |v: &[[f32; 3]]| wide(v);
    for (name, got) in [
        ("normal", f(&bar.normal)),
        ("albedo", f(&bar.albedo)),
        ("roughness", one(&bar.roughness)),
        ("metallic", one(&bar.metallic)),
        ("env", f(&env_bar)),
    ] {
        let e = relative(&got, &want[name].data);
        let top = want[name].data.iter().fold(0.0f64, |m, v| if v.abs() > m { v.abs() } else { m });
        let each = got.iter().zip(&want[name].data).fold(0.0f64, |m, (g, w)| {
            let e = (g - w).abs() / lastlight::num::order::max(w.abs(), 1e-3 * top);
            if e > m { e } else { m }
        });
        println!("{name}_bar: relative {e:.2e}, worst entry {each:.2e}");
        assert!(e <= 2e-5, "{name}_bar: relative error {e}");
    }
}
