//! The edges of what is rendered: sheets lit from behind, layers of glass, views of their own noise, input
//! out of range.

use super::{look, object, shoot, square};
use lastlight::fit::passes::PassSet;
use lastlight::geometry::bvh::Bvh;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::light::{Environment, Lamp, Lights, MAX_RADIANCE};
use lastlight::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use lastlight::scene::mesh::Object;
use lastlight::shade::render::{Brdf, MAX_BOUNCES, Passes, Scene, Settings, render};
use lastlight::shade::vector::unit;
use std::sync::Arc;

/// A normal map that tilts by 84° to the right of the image.
fn tilted() -> Material {
    let map = Texture {
        width: 1,
        height: 1,
        texels: vec![[254, 128, 140, 255]],
        transfer: Transfer::Linear,
        wrap: [Wrap::Repeat; 2],
    };
    Material { normal_map: Some((Arc::new(map), 1.0)), roughness: 0.6, ..Material::default() }
}

/// 16×16 pixels, 4 per unit, parallel to −z.
fn above() -> Camera {
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation: [0.0, 0.0, 5.0],
        focal_px: [4.0; 2],
        center_px: [8.0; 2],
        width: 16,
        height: 16,
        model: Model::Orthographic,
    }
}

fn lamp(towards: [f32; 3]) -> Lights {
    let towards = unit(towards).0;
    Lights { environment: None, lamps: vec![Lamp::Distant { towards, irradiance: [1.0; 3] }] }
}

fn brightest(out: &Passes) -> f32 {
    out.color.iter().flatten().fold(0.0, |m, x| if *x > m { *x } else { m })
}

/// The shading normal sees the light; the sheet does not, and nothing else is in the way.
#[test]
fn an_open_sheet_is_not_lit_through_itself() {
    let sheet = object(square(3.0), tilted());
    // bright below 22.5° under the horizon
    let rows = (0..16 * 32).map(|i| if i / 32 >= 10 { [1.0; 3] } else { [0.0; 3] });
    let map = Environment { width: 32, height: 16, radiance: rows.collect() };
    let under = Lights { environment: Some(map), lamps: Vec::new() };
    // a glowing floor under the sheet
    let mut lit = sheet.clone();
    let base = lit.mesh.positions.len() as u32;
    lit.mesh.positions.extend(square(3.0).positions.iter().map(|p| [p[0], p[1], -1.0]));
    lit.mesh.uvs.extend(square(1.0).uvs);
    lit.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    lit.materials.push(Material { emission: [1.0; 3], ..Material::default() });
    lit.material_of.extend([1, 1]);
    for brdf in [Brdf::Lambert, Brdf::MetallicRoughness] {
        for bounces in [0, 1, 3] {
            let settings = Settings { samples: 64, bounces, seed: 1, brdf, ..Settings::default() };
            let cases = [
                (&sheet, lamp([0.99, 0.0, -0.1]), "a lamp"),
                (&sheet, under.clone(), "a map"),
                (&lit, Lights::default(), "a floor"),
            ];
            for (what, lights, name) in cases {
                let out = shoot(what, &lights, &above(), &settings);
                assert_eq!(brightest(&out), 0.0, "{brdf:?}, {bounces} bounces, {name} below");
            }
            let out = shoot(&sheet, &lamp([0.99, 0.0, 0.1]), &above(), &settings);
            assert!(brightest(&out) > 0.1, "{brdf:?}, {bounces} bounces: lit from above");
        }
    }
}

/// Seen from where the mapped normal turns away, it is bent for reflection, not in the pass.
#[test]
fn the_pass_of_normals_does_not_depend_on_the_eye() {
    let sheet = object(square(3.0), tilted());
    let settings = Settings { samples: 4, bounces: 0, seed: 1, ..Settings::default() };
    let normal = |eye: [f32; 3]| {
        let out = shoot(&sheet, &lamp([0.0, 0.0, 1.0]), &look(eye, [0.0; 3], 0.1, 9, 9), &settings);
        out.normal[4 * 9 + 4]
    };
    let want = unit([253.0_f32, 1.0, 25.0]).0; // texels are 2t − 255
    for eye in [[4.0, 0.0, 1.0], [-4.0, 0.0, 1.0], [0.0, -4.0, 0.5], [0.1, 0.0, 4.0]] {
        let n = normal(eye);
        assert!((0..3).all(|k| (n[k] - want[k]).abs() < 1e-5), "from {eye:?}: {n:?}, want {want:?}");
    }
}

/// Light through panes above the view: the product of their transmittances, and no light behind more than 256
/// of them.
#[test]
fn light_passes_layers_up_to_the_last_that_is_counted() {
    let through = |panes: usize, alpha: f32| {
        let mut scene = object(square(4.0), Material { roughness: 1.0, ..Material::default() });
        for i in 0..panes {
            let base = scene.mesh.positions.len() as u32;
            let z = 6.0 + 0.01 * i as f32;
            scene.mesh.positions.extend(square(20.0).positions.iter().map(|p| [p[0], p[1], z]));
            scene.mesh.uvs.extend(square(1.0).uvs);
            scene.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
            scene.material_of.extend([1, 1]);
        }
        scene.materials.push(Material {
            base_color: [1.0, 1.0, 1.0, alpha],
            alpha: Alpha::Blend,
            ..Material::default()
        });
        let settings =
            Settings { samples: 2, bounces: 0, seed: 1, brdf: Brdf::Lambert, ..Settings::default() };
        shoot(&scene, &lamp([0.1, 0.0, 1.0]), &above(), &settings).color[8 * 16 + 8][0]
    };
    let free = through(0, 0.0);
    assert!(free > 0.3, "lit: {free}");
    for (panes, alpha, share) in
        [(3, 0.5, 0.125), (1, 1.0, 0.0), (200, 0.0, 1.0), (256, 0.0, 1.0), (257, 0.0, 0.0), (300, 0.0, 0.0)]
    {
        let got = through(panes, alpha);
        assert!(
            (got - share * free).abs() <= 1e-6,
            "{panes} panes of {alpha}: {got}, want {share} of {free}"
        );
    }
}

#[test]
fn two_views_of_one_run_have_noise_of_their_own() {
    use lastlight::fit::relight::{Exposure, Relight, still};
    let plane = object(square(5.0), Material::default());
    let map = Environment { width: 2, height: 2, radiance: vec![[0.0; 3], [4.0; 3], [1.0; 3], [0.0; 3]] };
    let lights = Lights { environment: Some(map), lamps: Vec::new() };
    let pictures = |seed: u64| {
        let folder = tempfile::tempdir().expect("a folder");
        let settings = Settings { samples: 1, bounces: 0, seed, ..Settings::default() };
        let job = Relight {
            object: &plane,
            lights: &lights,
            settings,
            exposure: Exposure::Fixed(0.3),
            transparent: false,
            passes: PassSet::NONE,
        };
        let shots = ["a", "b"].map(|name| still(name.to_owned(), above()));
        let stop = std::sync::atomic::AtomicBool::new(false);
        job.to_folder(&shots, folder.path(), serde_json::Map::new(), false, &stop, &mut |_, _| ())
            .expect("rendered");
        let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a photo");
        ["images/a.png", "images/b.png"].map(read)
    };
    let (one, again, other) = (pictures(1), pictures(1), pictures(2));
    assert_eq!(one, again, "a run is reproducible");
    assert_ne!(one[0], one[1], "the same camera twice: other noise");
    assert!(!other.contains(&one[0]) && !other.contains(&one[1]), "another seed, other noise");
}

fn refused(
    object: &Object,
    lights: &Lights,
    camera: &Camera,
    end: Option<&Camera>,
    settings: &Settings,
) -> String {
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let made = Scene::new(object, &bvh, lights).and_then(|s| render(&s, camera, end, settings).map(|_| ()));
    made.expect_err("refused").to_string()
}

#[test]
fn what_would_leave_the_numbers_is_refused() {
    let plane = object(square(1.0), Material::default());
    let none = Lights::default();
    let few = Settings { samples: 1, bounces: 0, ..Settings::default() };
    let case = |what: String, word: &str| assert!(what.contains(word), "{what}, not about {word}");
    // settings and cameras
    let many = Settings { bounces: MAX_BOUNCES + 1, ..few };
    case(refused(&plane, &none, &above(), None, &many), "bounces");
    let flat = Camera { rotation: [[0.0; 3]; 3], ..above() };
    case(refused(&plane, &none, &flat, None, &few), "rotation");
    let mirrored = Camera { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], ..above() };
    case(refused(&plane, &none, &mirrored, None, &few), "rotation");
    case(refused(&plane, &none, &above(), Some(&flat), &few), "shutter close");
    case(refused(&plane, &none, &Camera { focal_px: [1e-30; 2], ..above() }, None, &few), "intrinsics");
    case(
        refused(&plane, &none, &Camera { translation: [0.0, 0.0, 3e38], ..above() }, None, &few),
        "translation",
    );
    for end in [
        Camera { width: 8, ..above() },
        Camera { model: Model::Pinhole, ..above() },
        Camera { focal_px: [4.0, 5.0], ..above() },
        Camera { center_px: [8.0, 7.0], ..above() },
    ] {
        case(refused(&plane, &none, &above(), Some(&end), &few), "another pose of the same camera");
    }
    // surfaces
    let mut far = plane.clone();
    far.mesh.positions[0][1] = 3e38;
    let bvh = Bvh::build(&plane.mesh.positions, &plane.mesh.triangles);
    case(Scene::new(&far, &bvh, &none).expect_err("refused").to_string(), "positions");
    let mut far = plane.clone();
    far.mesh.uvs[2][0] = -3e38;
    case(refused(&far, &none, &above(), None, &few), "uvs");
    for strength in [f32::INFINITY, f32::NAN, -1e20] {
        let mut m = tilted();
        m.normal_map.as_mut().expect("a map").1 = strength;
        case(refused(&object(square(1.0), m), &none, &above(), None, &few), "normal map");
    }
    let m = Material { emission: [0.0, 1e30, 0.0], ..Material::default() };
    case(refused(&object(square(1.0), m), &none, &above(), None, &few), "emission");
    // light
    let bright = Lights { environment: Some(Environment::constant([1e38; 3])), lamps: Vec::new() };
    case(refused(&plane, &bright, &above(), None, &few), "environment");
    let hot = Lamp::Point { position: [0.0; 3], intensity: [f32::INFINITY; 3] };
    case(refused(&plane, &Lights { environment: None, lamps: vec![hot] }, &above(), None, &few), "lamp 0");
    // and what is just allowed stays finite: the brightest light, on the surface itself
    let lights = Lights {
        environment: Some(Environment::constant([MAX_RADIANCE; 3])),
        lamps: vec![Lamp::Point { position: [0.0, 0.0, 1e-20], intensity: [MAX_RADIANCE; 3] }],
    };
    let mirror = Material { roughness: 0.0, metallic: 1.0, ..Material::default() };
    let settings = Settings { samples: 16, bounces: MAX_BOUNCES, ..few };
    let out = shoot(&object(square(1.0), mirror), &lights, &above(), &settings);
    assert!(out.color.iter().flatten().all(|x| x.is_finite()), "finite");
}
