//! Plücker coordinates of the rays of a view.

use lastlight::num::order;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::rays::{moment, plucker};

fn camera(model: Model) -> Camera {
    let (c, s) = (0.8, 0.6);
    Camera {
        rotation: [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        translation: [0.3, -0.2, 1.7],
        focal_px: [5.0, 6.0],
        center_px: [3.5, 2.25],
        width: 7,
        height: 5,
        model,
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + f64::from(*a) * f64::from(*b))
}

#[test]
fn a_moment_is_that_of_every_point_of_the_ray() {
    for model in [Model::Pinhole, Model::Orthographic, Model::Fisheye] {
        let camera = camera(model);
        let rays = plucker(&camera);
        assert_eq!(rays.len(), 5 * 7 * 6);
        for (pixel, ray) in rays.chunks_exact(6).enumerate() {
            let at = [pixel % 7, pixel / 7].map(|at| at as f32 + 0.5);
            let (origin, direction) = camera.ray(at).expect("every pixel has a ray");
            assert_eq!(ray[..3], direction, "{model:?}");
            let m: [f32; 3] = ray[3..].try_into().expect("three numbers");
            assert!(dot(&direction, &m).abs() < 1e-7, "{model:?}: the moment is perpendicular to the ray");
            for s in [-3.0_f32, 0.5, 20.0] {
                let there: [f32; 3] = std::array::from_fn(|k| origin[k] + s * direction[k]);
                let again = moment(there, direction);
                for k in 0..3 {
                    assert!(
                        (again[k] - m[k]).abs() < 2e-6 * order::max(s.abs(), 1.0),
                        "{model:?}: {again:?} and {m:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_length_of_a_moment_is_the_distance_from_the_origin() {
    // Closest point p on the line: p = d × m, and ‖p‖ = ‖m‖.
    let camera = camera(Model::Pinhole);
    for ray in plucker(&camera).chunks_exact(6) {
        let (d, m): ([f32; 3], [f32; 3]) = (ray[..3].try_into().expect("3"), ray[3..].try_into().expect("3"));
        let p = moment(d, m);
        assert!((dot(&p, &p) - dot(&m, &m)).abs() < 1e-6, "{p:?}");
        let o = camera.center();
        let along = dot(&o, &d);
        let closest: [f64; 3] = std::array::from_fn(|k| f64::from(o[k]) - along * f64::from(d[k]));
        assert!((0..3).all(|k| (closest[k] - f64::from(p[k])).abs() < 1e-6), "{closest:?} and {p:?}");
    }
}

#[test]
fn cameras_that_see_one_line_agree_and_a_pixel_without_a_ray_is_0() {
    // Two pinhole cameras on the z axis, both directed along it: their middle pixels see the same line.
    let on_axis = |z: f32| Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [-0.25, 0.5, -z],
        focal_px: [9.0, 9.0],
        center_px: [1.5, 1.5],
        width: 3,
        height: 3,
        model: Model::Pinhole,
    };
    let [near, far] = [1.0, -4.0].map(|z| plucker(&on_axis(z)));
    // (1/4, −1/2, z) × (0, 0, 1) = (−1/2, −1/4, 0)
    assert_eq!(near[24..30], [0.0, 0.0, 1.0, -0.5, -0.25, 0.0]);
    assert_eq!(near[24..30], far[24..30]);
    assert_ne!(near[..6], far[..6]);

    let wide = Camera { focal_px: [0.25, 0.25], model: Model::Fisheye, ..on_axis(1.0) };
    let rays = plucker(&wide);
    // The corners are 5.7 radians from the axis: beyond the circle of π.
    assert_eq!(rays[..6], [0.0; 6]);
    assert!((dot(&rays[24..27], &rays[24..27]) - 1.0).abs() < 1e-6, "the middle has a ray");
}
